"""Taichi itself, under the one name ``ti`` that all kernels use: another maintained fork of it would be named here alone.

Importing this module imports Taichi, which takes a second and starts nothing; :mod:`taichi_membrane.device.runtime` starts it.
"""

from __future__ import annotations

import contextlib
import os
from typing import Any

from taichi_membrane.errors import InputError

__all__ = ["ti"]

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # the banner goes to standard output, which is ours
try:
    import taichi as ti
except ImportError as error:
    raise InputError(f"Taichi cannot be imported: {error}. On Debian it needs the package libx11-6") from error


def _remember_positions() -> None:
    """Let Taichi write out each source position once, where its internals are those of 1.7.4; else leave it as it is.

    For messages that are rarely shown, Taichi 1.7.4 wraps the source text of every node it visits, and of each again wherever it is
    inlined or unrolled. Without that the cantilever's kernels came from the cache in 1.8 s instead of 2.1 s.
    """
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    written, known = ASTTransformerContext.get_pos_info, dict[tuple[object, ...], str]()

    def get_pos_info(self: Any, node: Any) -> str:
        try:
            function = (self.file, self.func.func.__name__, self.lineno_offset, self.indent)
            key = (*function, type(node), node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        except AttributeError:
            return str(written(self, node))
        if key not in known:
            known[key] = written(self, node)
        return known[key]

    ASTTransformerContext.get_pos_info = get_pos_info


with contextlib.suppress(ImportError, AttributeError):  # only a matter of speed
    _remember_positions()
