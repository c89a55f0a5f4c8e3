"""The vtu files of a run: triangles, of six nodes as quadratic ones, and where there are cables, their straight pieces as lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh
from taichi_membrane.output.reader import file_checksum

# Nodes of a quadratic triangle as VTK has them: amid the sides from corner 0 to 1, 1 to 2, 2 to 0.
_VTK_ORDER = [0, 1, 2, 5, 3, 4]

Arrays = Mapping[str, NDArray[Any]]


def write_vtu(
    path: Path, mesh: Mesh, lines: NDArray[Any], point_data: Arrays, tri_data: Arrays, line_data: Arrays
) -> str:
    """Write a vtu file and return its checksum; triangles have no value of cables, nor lines one of triangles: NaN, or -1.

    :param lines: (k, 2) nodes of the lines; without any, nothing of them is written.
    """
    import meshio  # here, not above: it takes a quarter of a second that other commands do not need

    blocks: list[tuple[str, NDArray[Any]]] = [("triangle", mesh.triangles)]
    if mesh.order == 2:
        blocks = [("triangle6", mesh.cells[:, _VTK_ORDER])]
    cells = {name: [array] for name, array in tri_data.items()}
    if len(lines):
        blocks.append(("line", lines))
        for name, array in tri_data.items():
            cells[name] = [array, line_data.get(name, _nothing(array, len(lines)))]
        for name, array in line_data.items():
            if name not in tri_data:
                cells[name] = [_nothing(array, mesh.tri_count), array]
    content = meshio.Mesh(mesh.points, blocks, point_data=dict(point_data), cell_data=cells)
    content.write(path, file_format="vtu")
    return file_checksum(path)


def _nothing(like: NDArray[Any], count: int) -> NDArray[Any]:
    """Values of what has none, of the shape and kind of those of others."""
    return np.full((count, *like.shape[1:]), -1 if like.dtype.kind == "i" else np.nan, dtype=like.dtype)
