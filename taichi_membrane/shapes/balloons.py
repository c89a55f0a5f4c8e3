"""Balloons: pumpkins of gores with tendons between them."""

from __future__ import annotations

import math

import numpy as np
import scipy

from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_between, check_count, check_length, check_size
from taichi_membrane.shapes.patchwork import Floats, Ints, Patchwork, quads


def isotensoid(radius: float, arc: Floats) -> tuple[Floats, Floats]:
    """Meridian of a balloon that has no hoop tension (Taylor 1919): distance from the axis and height at arcs from the equator.

    Tendons of one force carry the pressure alone: sin φ = (x/R)², φ being the angle of the meridian from the plane of the equator,
    as in the Mylar balloon. From the equator x = R cn(√2 s/R), z = R/√2 (2 E(am u) - u) with u = √2 s/R, of parameter 1/2.

    :param radius: R, at the equator [length]; ``arc``: s, up to :func:`half_meridian` either way.
    :return: x and z, of the shape of ``arc`` [length].
    """
    u = math.sqrt(2.0) * arc / radius
    _, cn, _, amplitude = scipy.special.ellipj(u, 0.5)
    return np.asarray(radius * cn), radius / math.sqrt(2.0) * (2.0 * scipy.special.ellipeinc(amplitude, 0.5) - u)


def half_meridian(radius: float) -> float:
    """Length of its meridian from the equator to a pole, 1.3110288 R."""
    return radius * float(scipy.special.ellipk(0.5)) / math.sqrt(2.0)


def pumpkin(*, radius: float, gores: int, along: int, across: int, bulge: float = 90.0, fitting: float = 0.1) -> Mesh:
    """Balloon of lobes between tendons that run from fitting to fitting along the z axis; its equator lies in z = 0.

    Tendons lie on the meridian of :func:`isotensoid`; across a gore, square to them, the fabric is cut as an arc.

    :param radius: of the tendons at the equator [length].
    :param gores: number of gores and of tendons, at least 3; ``along`` elements of a gore from fitting to fitting, ``across`` it.
    :param bulge: angle of the arcs between tendons [degrees], at least 360/``gores`` (a round body), at most 180.
    :param fitting: radius of the flat discs at the poles over ``radius``.
    :return: element groups ``gores``, ``gore_1``, … (from the x axis on), ``fittings``; group of line elements ``tendons``. Node
        groups ``fitting_top``, ``fitting_bottom`` (discs with their rims), ``tendon_1`` (in the plane y = 0, x > 0), …,
        ``pole_top``, ``pole_bottom``; for even ``along`` ``equator`` (tendons' nodes) and for even ``across`` ``crests`` (tops of
        the lobes there). Normals point outwards, warp runs along the tendons.
    """
    check_length("pumpkin", "radius", radius)
    check_count("pumpkin", "gores", gores, 3)
    check_count("pumpkin", "along", along, 2)
    check_count("pumpkin", "across", across, 1)
    check_size("pumpkin", 2 * gores * (across * along + 1))
    check_between(
        "pumpkin", "bulge", bulge, 360.0 / gores, 180.0, f"degrees; 360/gores = {360.0 / gores:g} is a round body"
    )
    check_between("pumpkin", "fitting", fitting, 0.01, 0.9)
    work = Patchwork()
    at = work.nodes(_lobes(radius, gores, along, across, math.radians(bulge) / 2.0, fitting))
    looped = np.column_stack((at, at[:, :1]))
    for gore in range(gores):
        piece = quads(looped[:, gore * across : (gore + 1) * across + 1].T, banded=True)
        work.piece(piece, ("gores", f"gore_{gore + 1}"), _upwards(work.points[piece].mean(axis=1), radius))
    for side, rim, way in (("bottom", at[0], -1), ("top", at[-1], 1)):
        _add_fitting(work, side, rim, way)
    for number in range(gores):
        tendon = at[:, number * across]
        work.node_groups[f"tendon_{number + 1}"] = tendon
        work.line("tendons", np.column_stack((tendon[:-1], tendon[1:])))
    if along % 2 == 0:
        work.node_groups["equator"] = at[along // 2, ::across]
        if across % 2 == 0:
            work.node_groups["crests"] = at[along // 2, across // 2 :: across]
    return work.mesh("pumpkin")


def _lobes(radius: float, gores: int, along: int, across: int, half: float, fitting: float) -> Floats:
    """(along + 1, gores · across, 3) places of the gores' nodes, from the lower fitting up, from the x axis round."""
    end = radius / math.sqrt(2.0) * float(scipy.special.ellipkinc(math.acos(fitting), 0.5))
    arc = end * (2 * np.arange(along + 1) - along) / along
    x, z = isotensoid(radius, arc)
    rises = (x / radius) ** 2  # sine of the meridian's angle; the normal is (rises, leans) in radius and height
    leans = np.sign(arc) * np.sqrt(1.0 - rises**2)
    share = 2.0 * np.arange(across) / across - 1.0
    # Chord from tendon to tendon and the arc over it, in the plane of the middle of the gore.
    chord = x * math.sin(math.pi / gores)
    bow = chord / math.sin(half)
    side = bow[:, None] * np.sin(half * share)
    out = bow[:, None] * (np.cos(half * share) - math.cos(half))
    out[:, 0] = 0.0
    base = x[:, None] * math.cos(math.pi / gores) + out * rises[:, None]
    height = z[:, None] + out * leans[:, None]
    base[[0, -1]], side[[0, -1]] = (
        fitting * radius * np.cos(math.pi / gores * share),
        fitting * radius * np.sin(math.pi / gores * share),
    )
    height[[0, -1]] = z[[0, -1], None]
    middles = 2.0 * math.pi * (np.arange(gores) + 0.5) / gores
    cosine, sine = np.cos(middles)[None, :, None], np.sin(middles)[None, :, None]
    base, side = base[:, None, :], side[:, None, :]
    places = np.stack(
        np.broadcast_arrays(base * cosine - side * sine, base * sine + side * cosine, height[:, None, :]), axis=-1
    )
    return np.asarray(places.reshape(along + 1, gores * across, 3))


def _upwards(places: Floats, radius: float) -> Floats:
    """(n, 3) directions of the meridian, towards the upper pole, nearly where places of the fabric are."""
    distance = np.hypot(places[:, 0], places[:, 1])
    rise = np.minimum((distance / radius) ** 2, 1.0)
    inwards = -np.sign(places[:, 2]) * np.sqrt(1.0 - rise**2) / distance
    return np.column_stack((places[:, :2] * inwards[:, None], rise))


def _add_fitting(work: Patchwork, side: str, rim: Ints, way: int) -> None:
    """Add the disc at a pole: one triangle for each side of its rim."""
    middle = work.nodes(work.points[rim].mean(axis=0, keepdims=True) * (0.0, 0.0, 1.0))
    triangles = np.column_stack((rim, np.roll(rim, -1), np.repeat(middle, len(rim))))
    work.piece(triangles[:, ::way], ("fittings",), [1.0, 0.0, 0.0])
    work.node_groups[f"fitting_{side}"] = np.append(rim, middle)
    work.node_groups[f"pole_{side}"] = middle
