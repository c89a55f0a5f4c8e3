"""Flat rings and sectors of discs, for problems with rotational symmetry."""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_count, check_length, check_size
from taichi_membrane.shapes.rings import wall_triangles
from taichi_membrane.shapes.true_surface import of_order, on_rings


def annulus(*, inner: float, outer: float, around: int, rings: int, order: int = 1) -> Mesh:
    """Flat ring in z = 0 about the origin, normals along +z.

    Circles of ``around`` nodes, each turned by half a pitch against the one before, at radii in geometric progression: the
    triangles keep their shape from the inner to the outer edge.

    :return: node groups ``inner`` and ``outer``. Warp runs along x.
    """
    inner, outer = check_length("annulus", "inner", inner), check_length("annulus", "outer", outer)
    if not outer > inner:
        raise InputError(f"annulus: outer = {outer:g} must be larger than inner = {inner:g}")
    check_count("annulus", "around", around, 3)
    check_count("annulus", "rings", rings, 1)
    check_size("annulus", 2 * around * rings)
    ring = np.arange(rings + 1)[:, None]
    angle = 2 * np.pi * (np.arange(around)[None, :] + 0.5 * (ring % 2)) / around
    radius = inner * (outer / inner) ** (ring / rings)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], axis=2).reshape(-1, 3)
    triangles = _upwards(points, wall_triangles(around=around, along=rings, pattern="staggered", first_phase=0))
    groups = {"inner": np.arange(around), "outer": np.arange(around) + rings * around}
    mesh = Mesh.build(points, triangles, groups, None, np.tile([1.0, 0.0, 0.0], (len(triangles), 1)), where="annulus")
    return of_order(mesh, order, on_rings(inner, outer), "annulus")


def wedge(*, radius: float, angle: float, rings: int, around: int = 1, order: int = 1) -> Mesh:
    """Sector of a flat disc in z = 0: apex at the origin, from the x axis counter-clockwise over ``angle`` degrees.

    :param rings: bands of elements from the apex to the rim; ``around`` elements across each.
    :return: node groups ``centre`` (the apex), ``rim``, ``side_start`` (on the x axis) and ``side_end``, both with the apex.
    """
    radius = check_length("wedge", "radius", radius)
    if not 0.0 < angle <= 180.0:
        raise InputError(f"wedge: angle = {angle:g} must lie above 0 and up to 180 degrees")
    check_count("wedge", "rings", rings, 1)
    check_count("wedge", "around", around, 1)
    check_size("wedge", 2 * rings * around)
    turn = np.deg2rad(angle) * np.arange(around + 1) / around
    distance = radius * np.arange(1, rings + 1)[:, None] / rings
    ring_points = np.stack([distance * np.cos(turn), distance * np.sin(turn), 0.0 * distance * turn], axis=2)
    points = np.concatenate([np.zeros((1, 3)), ring_points.reshape(-1, 3)])
    number = 1 + np.arange(rings * (around + 1)).reshape(rings, around + 1)
    tip = np.stack([np.zeros(around, dtype=int), number[0, :-1], number[0, 1:]], axis=1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    # Diagonals alternate, so that neither side of a thin wedge is stiffer than the other.
    flip = (np.add.outer(np.arange(rings - 1), np.arange(around)) % 2 == 0)[..., None]
    first = np.where(flip, np.stack([a, b, c], axis=-1), np.stack([a, b, d], axis=-1)).reshape(-1, 3)
    second = np.where(flip, np.stack([a, c, d], axis=-1), np.stack([b, c, d], axis=-1)).reshape(-1, 3)
    triangles = np.concatenate([tip, first, second])
    groups = {
        "centre": np.array([0]),
        "rim": number[-1],
        "side_start": np.append(0, number[:, 0]),
        "side_end": np.append(0, number[:, -1]),
    }
    mesh = Mesh.build(points, triangles, groups, None, np.tile([1.0, 0.0, 0.0], (len(triangles), 1)), where="wedge")
    return of_order(mesh, order, on_rings(radius), "wedge")


def _upwards(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles, turned over where needed so that their normals point along +z."""
    corner = points[triangles]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    down = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0.0
    return np.where(down[:, None], triangles[:, [0, 2, 1]], triangles)
