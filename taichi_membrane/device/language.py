"""Taichi itself, under the one name ``ti`` that all kernels use: another maintained fork of it would be named here alone.

Importing this module imports Taichi, which takes a second and starts nothing; :mod:`taichi_membrane.device.runtime` starts it.
"""

from __future__ import annotations

import os

from taichi_membrane.device.python_pass import hasten
from taichi_membrane.errors import InputError

__all__ = ["ti"]

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # the banner goes to standard output, which is ours
try:
    import taichi as ti
except ImportError as error:
    raise InputError(f"Taichi cannot be imported: {error}. On Debian it needs the package libx11-6") from error

hasten(ti)
