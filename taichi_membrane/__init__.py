"""How pressurised fabric deforms, carries load, wrinkles and collapses.

``tm.run(scene)`` runs a :class:`Scene` and returns NumPy results. Importing this package starts nothing and prints nothing; Taichi
starts with the first run.
"""

from __future__ import annotations

from taichi_membrane.errors import InputError
from taichi_membrane.run import run
from taichi_membrane.scene import Scene

__all__ = ["InputError", "Scene", "run"]
