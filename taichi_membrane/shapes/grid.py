"""Flat shapes on a rectangular grid: panel and cushion."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.middles import straight
from taichi_membrane.shapes.arguments import check_count, check_length, check_name, check_size
from taichi_membrane.shapes.true_surface import of_order

GridPattern = Literal["diagonal", "alternating", "crossed"]


def panel(
    *, width: float, height: float, along_x: int, along_y: int, pattern: GridPattern = "diagonal", order: int = 1
) -> Mesh:
    """Flat rectangle in z = 0 from the origin to (``width``, ``height``), normals along +z.

    :param along_x: cells along x, at least 1; ``along_y`` the same along y.
    :param pattern: ``diagonal`` cuts every cell from its lower left, ``alternating`` neighbouring cells crosswise,
        ``crossed`` each cell by both diagonals.
    :return: node groups ``x_min``, ``x_max``, ``y_min``, ``y_max``, ``corner_00``, ``corner_10`` (x_max, y_min),
        ``corner_01``, ``corner_11`` and, where there is one, ``centre``. Warp runs along x.
    """
    _check_grid("panel", width, height, along_x, along_y, 1, pattern)
    nx, ny = along_x, along_y
    points = grid_points(nx, ny, pattern) * (float(width), float(height), 0.0)
    triangles = grid_triangles(nx, ny, pattern, corners_cut=False)
    at = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    groups: dict[str, NDArray[np.int64]] = {
        "x_min": at[:, 0],
        "x_max": at[:, -1],
        "y_min": at[0],
        "y_max": at[-1],
        "corner_00": at[0, :1],
        "corner_10": at[0, -1:],
        "corner_01": at[-1, :1],
        "corner_11": at[-1, -1:],
    }
    centre = _centre(nx, ny, pattern)
    if centre is not None:
        groups["centre"] = np.array([centre])
    warp = np.tile([1.0, 0.0, 0.0], (len(triangles), 1))
    mesh = Mesh.build(points, triangles, groups, None, warp, where="panel")
    return of_order(mesh, order, straight, "panel")


def cushion(
    *, width: float, height: float, along_x: int, along_y: int, pattern: GridPattern = "alternating", order: int = 1
) -> Mesh:
    """Two flat rectangular sheets in z = 0, centred on the origin and seamed along their rim: a closed, empty body.

    In the corner cells the diagonal runs into the corner, whatever the pattern: otherwise one triangle of each sheet
    would have all its nodes on the seam, the same three for both, and could never part from the other.

    :param width: size along x [length]; ``height`` the size along y.
    :param along_x: cells along x, at least 2; ``along_y`` the same along y.
    :param pattern: see :func:`panel`.
    :return: element groups ``top`` (normal +z) and ``bottom`` (normal -z); node groups ``seam``, ``corners`` and, where
        there is one, ``centre_top`` and ``centre_bottom``. Warp runs along x.
    """
    _check_grid("cushion", width, height, along_x, along_y, 2, pattern)
    nx, ny = along_x, along_y
    sheet = (grid_points(nx, ny, pattern) - (0.5, 0.5, 0.0)) * (float(width), float(height), 0.0)
    at = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    seam = np.unique(np.concatenate((at[0], at[-1], at[:, 0], at[:, -1])))
    inner = np.setdiff1d(np.arange(len(sheet)), seam)
    lower_number = np.arange(len(sheet))
    lower_number[inner] = len(sheet) + np.arange(len(inner))
    top = grid_triangles(nx, ny, pattern, corners_cut=True)
    triangles = np.concatenate((top, lower_number[top[:, ::-1]]))
    groups = {"seam": seam, "corners": at[[0, 0, -1, -1], [0, -1, 0, -1]]}
    centre = _centre(nx, ny, pattern)
    if centre is not None:
        groups["centre_top"] = np.array([centre])
        groups["centre_bottom"] = lower_number[[centre]]
    tri_groups = {"top": np.arange(len(top)), "bottom": len(top) + np.arange(len(top))}
    warp = np.tile([1.0, 0.0, 0.0], (len(triangles), 1))
    mesh = Mesh.build(np.concatenate((sheet, sheet[inner])), triangles, groups, tri_groups, warp, where="cushion")
    return of_order(mesh, order, straight, "cushion")


def _check_grid(where: str, width: float, height: float, nx: int, ny: int, lowest: int, pattern: str) -> None:
    check_length(where, "width", width)
    check_length(where, "height", height)
    check_count(where, "along_x", nx, lowest)
    check_count(where, "along_y", ny, lowest)
    check_name(where, "pattern", pattern, get_args(GridPattern))
    check_size(where, 4 * nx * ny)


def grid_points(nx: int, ny: int, pattern: str) -> NDArray[np.float64]:
    """Return the nodes of the unit square, row after row along x; for ``crossed`` the middles of the cells follow."""
    y, x = np.meshgrid(np.arange(ny + 1) / ny, np.arange(nx + 1) / nx, indexing="ij")
    points = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
    if pattern != "crossed":
        return points
    y, x = np.meshgrid((np.arange(ny) + 0.5) / ny, (np.arange(nx) + 0.5) / nx, indexing="ij")
    return np.concatenate((points, np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))))


def grid_triangles(nx: int, ny: int, pattern: str, *, corners_cut: bool) -> NDArray[np.int64]:
    """Cut the cells counter-clockwise; ``corners_cut`` turns the diagonals of the corner cells to the corner."""
    j, i = (index.ravel() for index in np.meshgrid(np.arange(ny), np.arange(nx), indexing="ij"))
    a = j * (nx + 1) + i
    b, c, d = a + 1, a + nx + 2, a + nx + 1
    if pattern == "crossed":
        middle = (nx + 1) * (ny + 1) + np.arange(nx * ny)
        sides = ((a, b), (b, c), (c, d), (d, a))
        return np.stack([np.column_stack((p, q, middle)) for p, q in sides], axis=1).reshape(-1, 3)
    rising = np.ones(nx * ny, dtype=bool) if pattern == "diagonal" else (i + j) % 2 == 0
    if corners_cut:
        at_corner = np.isin(i, (0, nx - 1)) & np.isin(j, (0, ny - 1))
        rising = np.where(at_corner, (i == 0) == (j == 0), rising)
    first = np.column_stack((a, b, np.where(rising, c, d)))
    second = np.column_stack((np.where(rising, a, b), c, d))
    return np.stack((first, second), axis=1).reshape(-1, 3)


def _centre(nx: int, ny: int, pattern: str) -> int | None:
    """Return the number of the node in the middle of the grid, if there is one."""
    if nx % 2 == 0 and ny % 2 == 0:
        return (ny // 2) * (nx + 1) + nx // 2
    if pattern == "crossed" and nx % 2 == 1 and ny % 2 == 1:
        return (nx + 1) * (ny + 1) + (ny // 2) * nx + nx // 2
    return None
