"""Where the surfaces of shapes have the nodes amid edges, for six-node triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.middles import Place, straight, with_middles
from taichi_membrane.shapes.arguments import check_count

Floats = NDArray[np.float64]

# Share of a radius below which two distances are one.
_SAME = 1e-9


def of_order(mesh: Mesh, order: int, place: Place, where: str) -> Mesh:
    """A shape's mesh as it is for ``order`` 1, with nodes amid edges on its true surface for 2."""
    check_count(where, "order", order, 1)
    return mesh if order == 1 else with_middles(mesh, place)


def place_of(shape: str, given: Mapping[str, Any]) -> Place | None:
    """Where the surface of a shape has nodes amid edges, by its name and arguments; None of one whose surface is not known."""
    if shape == "tube":
        return on_tube(given["radius"], given["length"], (given["cap_start"], given["cap_end"]))
    if shape == "arch":
        half = np.deg2rad(given["angle"]) / 2.0
        arc_radius = float(given["span"] / (2.0 * np.sin(half)))
        return on_torus(arc_radius, given["radius"], float(arc_radius * np.cos(half)))
    if shape == "water_tube":
        radius, length = given["radius"], given["length"]
        ends = "none" if given["ends"] == "open" else given["ends"]
        return moved(on_tube(radius, length, (ends, ends)), np.array([-0.5 * length, 0.0, radius]))
    if shape == "sphere":
        return on_sphere(given["radius"])
    if shape in ("disc", "wedge"):
        return on_rings(given["radius"])
    if shape == "annulus":
        return on_rings(given["inner"], given["outer"])
    if shape == "airbag" and given["outline"] == "disc":
        return on_rings(0.5 * given["size"])
    return straight if shape in ("panel", "cushion", "airbag") else None


def moved(place: Place, by: Floats) -> Place:
    """Of a surface moved by a vector (3,)."""
    return lambda first, second: place(first - by, second - by) + by


def on_tube(radius: float, length: float, caps: tuple[str, str]) -> Place:
    """Of a tube along x from 0 to ``length`` with caps at its start and end."""

    def place(first: Floats, second: Floats) -> Floats:
        middle = straight(first, second)
        ends = np.stack([first, second])
        on_wall = (np.hypot(ends[..., 1], ends[..., 2]) > radius * (1.0 - _SAME)) & (
            (ends[..., 0] > -_SAME * radius) & (ends[..., 0] < length + _SAME * radius)
        )
        wall = on_wall.all(axis=0)
        middle[wall, 1:] *= radius / np.linalg.norm(middle[wall, 1:], axis=1, keepdims=True)
        for kind, x, there in zip(caps, (0.0, length), (middle[:, 0] <= 0.0, middle[:, 0] >= length), strict=True):
            if kind == "hemisphere":
                chosen = there & ~wall
                middle[chosen] = on_sphere(radius, (x, 0.0, 0.0))(first[chosen], second[chosen])
        return middle

    return place


def on_sphere(radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Place:
    """Of a sphere."""

    def place(first: Floats, second: Floats) -> Floats:
        arm = straight(first, second) - centre
        return np.asarray(centre + radius * arm / np.linalg.norm(arm, axis=1, keepdims=True))

    return place


def on_torus(arc_radius: float, radius: float, height: float) -> Place:
    """Of a tube about the arc of a circle in the xz plane with its centre at z = -``height``: halfway in both angles."""

    def angles(points: Floats) -> tuple[Floats, Floats]:
        x, z = points[:, 0], points[:, 2] + height
        out = np.hypot(x, z) - arc_radius
        return np.arctan2(x, z), np.arctan2(points[:, 1], out)

    def place(first: Floats, second: Floats) -> Floats:
        (turn_1, round_1), (turn_2, round_2) = angles(first), angles(second)
        turn = 0.5 * (turn_1 + turn_2)
        # The two halves of the round: of its two middles the one between.
        round_by = round_1 + 0.5 * ((round_2 - round_1 + np.pi) % (2.0 * np.pi) - np.pi)
        from_centre = arc_radius + radius * np.cos(round_by)
        return np.column_stack(
            [from_centre * np.sin(turn), radius * np.sin(round_by), from_centre * np.cos(turn) - height]
        )

    return place


def on_rings(*radii: float) -> Place:
    """Of a flat shape in z = 0 that ends at circles about the origin: halfway, but on the circle where both ends are."""

    def place(first: Floats, second: Floats) -> Floats:
        middle = straight(first, second)
        ends = np.linalg.norm(np.stack([first, second]), axis=2)
        for radius in radii:
            both = (np.abs(ends - radius) <= _SAME * radius).all(axis=0)
            middle[both] *= radius / np.linalg.norm(middle[both], axis=1, keepdims=True)
        return middle

    return place
