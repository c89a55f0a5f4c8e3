"""Mattresses: cells side by side, with walls between them."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_count, check_length, check_size
from taichi_membrane.shapes.patchwork import Floats, Ints, Patchwork, quads


def mattress(
    *,
    width: float,
    length: float,
    height: float,
    cells_x: int,
    along_x: int,
    along_y: int,
    up: int,
    cells_y: int = 1,
    bulge: float = 0.0,
) -> Mesh:
    """Cells in a rectangle about the origin, with walls between them, standing on z = 0: a chamber each.

    Cells are numbered from 1 along x, then along y. Top and bottom of a cell are flat, or arcs over its width along x.

    :param width: size along x [length]; ``length`` that along y; ``height`` that of the walls between cells.
    :param cells_x: cells along x, at least 1; ``cells_y`` along y.
    :param along_x: elements along x in a cell, ``along_y`` along y in a cell, ``up`` up a wall.
    :param bulge: angle of the arcs [degrees], 0 (flat) to 180 (half circles, as of tubes side by side).
    :return: element groups ``top``, ``bottom``, ``edges`` (outer sides), ``walls``; of each cell ``top_1``, ``bottom_1``,
        ``cell_1`` (what has the cell behind it: top, bottom, edges, and its walls towards +x and +y) and ``into_1`` (walls
        whose normals point into it, from its neighbours at -x and -y): a pressure has ``group = "cell_2"``,
        ``against = "into_2"``. Node groups ``top``, ``bottom``, ``rim_top``, ``rim_bottom``, ``corners`` (four, of the
        bottom) and, where there is one, ``centre_top`` and ``centre_bottom``. Warp runs along y, on walls along y or x.
    """
    _check_mattress(width, length, height, (cells_x, cells_y), (along_x, along_y, up), bulge)
    nx, ny = cells_x * along_x, cells_y * along_y
    x, rise = _section(width, cells_x, along_x, bulge)
    exists = np.zeros((nx + 1, ny + 1, up + 1), dtype=bool)
    exists[::along_x], exists[:, ::along_y], exists[:, :, [0, -1]] = True, True, True
    i, j, k = np.nonzero(exists)
    tall = height + 2.0 * rise[i]
    work = Patchwork()
    number = np.full(exists.shape, -1)
    number[exists] = work.nodes(np.column_stack((x[i], length * (j / ny - 0.5), rise.max() - rise[i] + tall * k / up)))
    for cell_y in range(cells_y):
        for cell_x in range(cells_x):
            block = number[cell_x * along_x : (cell_x + 1) * along_x + 1, cell_y * along_y : (cell_y + 1) * along_y + 1]
            _add_cell(work, block, cell_y * cells_x + cell_x + 1, (cell_x, cell_y), (cells_x, cells_y))
    work.node_groups |= {
        "top": number[:, :, -1].ravel(),
        "bottom": number[:, :, 0].ravel(),
        "rim_top": _rim(number[:, :, -1]),
        "rim_bottom": _rim(number[:, :, 0]),
        "corners": number[[0, -1, 0, -1], [0, 0, -1, -1], 0],
    }
    if nx % 2 == 0 and ny % 2 == 0:
        work.node_groups["centre_top"] = number[nx // 2, ny // 2, -1:]
        work.node_groups["centre_bottom"] = number[nx // 2, ny // 2, :1]
    return work.mesh("mattress")


def _check_mattress(
    width: float, length: float, height: float, cells: tuple[int, int], parts: tuple[int, int, int], bulge: float
) -> None:
    for name, value in (("width", width), ("length", length), ("height", height)):
        check_length("mattress", name, value)
    for name, count in zip(("cells_x", "cells_y"), cells, strict=True):
        check_count("mattress", name, count, 1)
    for name, count, lowest in zip(("along_x", "along_y", "up"), parts, (2, 2, 1), strict=True):
        check_count("mattress", name, count, lowest)
    if bulge != 0.0 and check_length("mattress", "bulge", bulge) > 180.0:
        raise InputError(f"mattress: bulge = {bulge:g} must be 0 to 180 degrees")
    nx, ny = cells[0] * parts[0], cells[1] * parts[1]
    check_size("mattress", 4 * nx * ny + 2 * parts[2] * ((cells[0] + 1) * ny + (cells[1] + 1) * nx))


def _section(width: float, cells: int, parts: int, bulge: float) -> tuple[Floats, Floats]:
    """Places along x of all columns of nodes, and how far the arcs rise there."""
    cell, half = width / cells, math.radians(bulge) / 2.0
    steps = (2 * np.arange(parts + 1) - parts) / parts  # from -1 to 1, symmetric to the last bit
    if half > 0.0:
        radius = cell / (2.0 * math.sin(half))
        across, rise = radius * np.sin(half * steps), radius * (np.cos(half * steps) - math.cos(half))
    else:
        across, rise = 0.5 * cell * steps, np.zeros(parts + 1)
    across[[0, -1]], rise[[0, -1]] = (-0.5 * cell, 0.5 * cell), 0.0
    middles = cell * (np.arange(cells) - 0.5 * (cells - 1))
    x = np.append((middles[:, None] + across[:-1]).ravel(), 0.5 * width)
    return x, np.append(np.tile(rise[:-1], cells), 0.0)


def _add_cell(work: Patchwork, block: Ints, number: int, place: tuple[int, int], cells: tuple[int, int]) -> None:
    """Add top, bottom, the walls towards +x and +y, and what edges a cell has at -x and -y.

    :param block: nodes of the cell by their place along x, y and z.
    """
    own, warp = f"cell_{number}", [0.0, 1.0, 0.0]
    work.piece(quads(block[:, :, -1]), (own, "top", f"top_{number}"), warp)
    work.piece(quads(block[:, :, 0].T), (own, "bottom", f"bottom_{number}"), warp)
    faces = (
        (block[-1], place[0] == cells[0] - 1, number + 1, warp),
        (block[:, -1].T, place[1] == cells[1] - 1, number + cells[0], [1.0, 0.0, 0.0]),
    )
    for face, outside, neighbour, along in faces:
        work.piece(quads(face), (own, "edges") if outside else (own, "walls", f"into_{neighbour}"), along)
    if place[0] == 0:
        work.piece(quads(block[0].T), (own, "edges"), warp)
    if place[1] == 0:
        work.piece(quads(block[:, 0]), (own, "edges"), [1.0, 0.0, 0.0])


def _rim(sheet: Ints) -> Ints:
    """Nodes on the four sides of a grid."""
    return np.concatenate((sheet[0], sheet[-1], sheet[:, 0], sheet[:, -1]))
