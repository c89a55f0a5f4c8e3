"""Sails and tents between points: a four-point sail, and a cone that a mast lifts."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_between, check_count, check_length, check_multiple, check_size
from taichi_membrane.shapes.grid import grid_points, grid_triangles
from taichi_membrane.shapes.patchwork import Floats, Patchwork, quads


def hypar(*, width: float, depth: float, rise: float, along: int, sag: float = 0.1) -> Mesh:
    """Four-point sail: a hyperbolic paraboloid between two low and two high corners, its edges cut inwards.

    Its corners are at (±``width``/2, ±``depth``/2), at z = 0 where x y > 0 and at z = ``rise`` where x y < 0.

    :param width: size along x [length]; ``depth`` along y.
    :param rise: height of the high corners over the low ones [length]; 0 is a flat sail.
    :param along: elements along an edge, at least 2; squares are cut by both diagonals.
    :param sag: how far an edge is cut inwards, as a parabola in plan, over the distance of its corners.
    :return: node groups ``low_1`` (x, y < 0), ``low_2``, ``high_1`` (x > 0, y < 0), ``high_2``, ``corners``; ``edge_1`` (y < 0),
        ``edge_2`` (x > 0), ``edge_3``, ``edge_4``, for cables along them; ``edges``, ``centre`` (even ``along``). Normals point
        upwards, warp runs from low corner to low corner.
    """
    for name, value in (("width", width), ("depth", depth)):
        check_length("hypar", name, value)
    check_between("hypar", "rise", rise, 0.0, math.inf)
    check_count("hypar", "along", along, 2)
    check_size("hypar", 4 * along**2)
    check_between("hypar", "sag", sag, 0.0, 0.4)
    reach = 0.5 * min(width / depth, depth / width)
    if sag >= reach:
        raise InputError(
            f"hypar: sag = {sag:g} must be below {reach:g}; opposite edges would meet at this width and depth"
        )
    u, v, _ = 2.0 * grid_points(along, along, "crossed").T - 1.0  # -1 to 1
    x = u * (0.5 * width - sag * depth * (1.0 - v**2))
    y = v * (0.5 * depth - sag * width * (1.0 - u**2))
    triangles = grid_triangles(along, along, "crossed", corners_cut=False)
    at = np.arange((along + 1) ** 2).reshape(along + 1, along + 1)
    groups = {
        "low_1": at[0, :1], "low_2": at[-1, -1:], "high_1": at[0, -1:], "high_2": at[-1, :1],
        "edge_1": at[0], "edge_2": at[:, -1], "edge_3": at[-1], "edge_4": at[:, 0],
    }  # fmt: skip
    groups["corners"] = np.concatenate([groups[name] for name in ("low_1", "low_2", "high_1", "high_2")])
    groups["edges"] = np.concatenate([groups[f"edge_{k}"] for k in (1, 2, 3, 4)])
    if along % 2 == 0:
        groups["centre"] = at[along // 2, along // 2, None]
    warp = np.tile([float(width), float(depth), 0.0], (len(triangles), 1))
    points = np.column_stack((x, y, 0.5 * rise * (1.0 - u * v)))
    return Mesh.build(points, triangles, groups, None, warp, where="hypar")


def cone(
    *, radius: float, ring: float, height: float, around: int, up: int, corners: int = 0, sag: float = 0.1
) -> Mesh:
    """Tent from a rim in z = 0 up to a ring about the z axis, as a mast carries it.

    The rim is a circle, or runs from corner to corner of a regular polygon along edges that are cut inwards. Heights fall with the
    logarithm of the distance from the axis, near to a uniformly stretched film; elements keep their shape from ring to rim.

    :param radius: radius of the rim, of its corners where it has some [length]; ``ring`` that of the ring.
    :param height: height of the ring over the rim [length]; 0 is a flat tent.
    :param around: elements round the ring, a multiple of ``corners``; ``up`` from ring to rim.
    :param corners: corners of the rim, 3 at least; 0 is a circle.
    :param sag: how far an edge is cut inwards, as a parabola, over the distance of its corners.
    :return: node groups ``ring``, ``rim``; with corners ``corners``, ``corner_1`` (on the x axis), ``corner_2``, …, and ``edge_1``
        (from the first corner to the second), …, for cables along them. Normals point upwards, warp runs from rim to ring.
    """
    check_length("cone", "radius", radius)
    check_length("cone", "ring", ring)
    check_between("cone", "height", height, 0.0, math.inf)
    check_count("cone", "around", around, 3)
    check_count("cone", "up", up, 1)
    check_size("cone", 2 * around * up)
    rim = _rim(radius, around, corners, sag)
    distance = np.hypot(rim[:, 0], rim[:, 1])
    if not distance.min() > ring:
        raise InputError(
            f"cone: ring = {ring:g} must be below {distance.min():g}, where the rim comes nearest to the axis"
        )
    share = np.arange(up + 1)[:, None] / up
    scale = (ring / distance) ** (1.0 - share)
    points = np.stack((rim[:, 0] * scale, rim[:, 1] * scale, height * (1.0 - share) + 0.0 * scale), axis=-1)
    work = Patchwork()
    at = work.nodes(points)
    triangles = quads(np.column_stack((at, at[:, :1])).T, banded=True)[:, ::-1]
    work.piece(triangles, (), (points[0].mean(axis=0) - work.points[triangles].mean(axis=1)) * (1.0, 1.0, 0.0))
    work.node_groups |= {"ring": at[0], "rim": at[-1]}
    if corners:
        side = around // corners
        work.node_groups["corners"] = at[-1, ::side]
        looped = np.append(at[-1], at[-1, 0])
        for number in range(corners):
            work.node_groups[f"corner_{number + 1}"] = at[-1, number * side, None]
            work.node_groups[f"edge_{number + 1}"] = looped[number * side : (number + 1) * side + 1]
    return work.mesh("cone")


def _rim(radius: float, around: int, corners: int, sag: float) -> Floats:
    """(around, 2) places of the rim of a cone, the first on the x axis."""
    if corners == 0:
        turn = 2.0 * np.pi * np.arange(around) / around
        return radius * np.column_stack((np.cos(turn), np.sin(turn)))
    check_count("cone", "corners", corners, 3)
    check_multiple("cone", "around", around, corners, "so that each corner has a node")
    check_between("cone", "sag", sag, 0.0, 0.4)
    turn = 2.0 * np.pi * np.arange(corners + 1) / corners
    corner = radius * np.column_stack((np.cos(turn), np.sin(turn)))
    share = np.arange(around // corners)[None, :, None] / (around // corners)
    first, second = corner[:-1, None], corner[1:, None]
    middle = 0.5 * (first + second)
    inwards = -middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    chord = np.linalg.norm(second - first, axis=-1, keepdims=True)
    return np.asarray(first + share * (second - first) + 4.0 * sag * chord * share * (1.0 - share) * inwards).reshape(
        -1, 2
    )
