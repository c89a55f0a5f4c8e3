"""Pressure without a potential: two pressures side by side, free rims; and a box with an inner wall."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import GIVEN
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case, holds, nothing
from taichi_membrane.mesh import Mesh

_SAIL = {"E": 1000.0, "nu": 0.3, "thickness": 0.01, "prestress": [10.0, 10.0, 0.0], "warp": [1.0, 0.0, 0.0]}


def two_pressures(wall: float, cap: float, steps: int) -> Problem:
    """A tube whose cap has another pressure than its wall."""
    return Problem(
        scene={
            "mesh": {"shape": "tube", "radius": 1.0, "length": 4.0, "around": 10, "along": 8, "cap_end": "hemisphere"},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
            "supports": [{"group": "start", "hold": "xyz"}],
            "pressures": {"wall": {"group": "wall"}, "cap": {"group": "cap_end"}},
            "loads": {"tip": {"group": "end", "direction": [0.0, 0.0, -1.0]}},
            "stages": [
                {"name": "load", "steps": steps, "pressure": {"wall": wall, "cap": cap}, "loads": {"tip": 0.1 * wall}}
            ],
        },
        measure=nothing,
    )


def sail(
    pressure: float, steps: int, *, warped: float = 0.0, held: tuple[str, ...] = ("x_min", "x_max", "y_min")
) -> Problem:
    """A prestressed square with free edges in the wind, flat or a hyperbolic paraboloid."""
    flat = shapes.panel(width=1.0, height=1.0, along_x=6, along_y=6, pattern="crossed")
    x, y = flat.points[:, 0], flat.points[:, 1]
    points = np.column_stack((x, y, warped * (2.0 * x - 1.0) * (2.0 * y - 1.0)))
    groups = {name: members for name, members in flat.node_groups.items() if name not in ("all", "boundary")}
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": _SAIL,
            "supports": [{"group": group, "hold": "xyz"} for group in held],
            "stages": [{"name": "blow", "steps": steps, "pressure": pressure}],
        },
        mesh=Mesh.build(points, flat.triangles, groups),
        measure=nothing,
    )


def box(steps: int) -> Problem:
    """Two cubes side by side under different pressures with a common wall: three triangles meet at its edges."""
    points = np.array([[x, y, z] for x in range(3) for y in range(2) for z in range(2)], dtype=float)

    def node(x: int, y: int, z: int) -> int:
        return 4 * x + 2 * y + z

    quads = [[node(0, 0, 0), node(0, 0, 1), node(0, 1, 1), node(0, 1, 0)]]  # the end at x = 0, outwards
    for x in range(2):
        quads += [
            [node(x, 0, 0), node(x + 1, 0, 0), node(x + 1, 0, 1), node(x, 0, 1)],
            [node(x, 1, 0), node(x, 1, 1), node(x + 1, 1, 1), node(x + 1, 1, 0)],
            [node(x, 0, 0), node(x, 1, 0), node(x + 1, 1, 0), node(x + 1, 0, 0)],
            [node(x, 0, 1), node(x + 1, 0, 1), node(x + 1, 1, 1), node(x, 1, 1)],
            [node(x + 1, 0, 0), node(x + 1, 1, 0), node(x + 1, 1, 1), node(x + 1, 0, 1)],
        ]
    triangles = np.array([[q[a], q[b], q[c]] for q in quads for a, b, c in ((0, 1, 2), (0, 2, 3))])
    left = [*range(12)]
    right = [*range(12, 22)]
    mesh = Mesh.build(points, triangles, {"foot": [0, 1, 2, 3]}, {"left": left, "right": right})
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
            "supports": [{"group": "foot", "hold": "xyz"}],
            "pressures": {"left": {"group": "left"}, "right": {"group": "right"}},
            "stages": [{"name": "inflate", "steps": steps, "pressure": {"left": 0.2, "right": 0.4}}],
        },
        mesh=mesh,
        measure=nothing,
    )


def cases() -> Iterator[Case]:
    """All of this family's."""
    for wall, cap in ((0.6, 0.6), (0.6, 1.2), (1.2, 0.6), (0.6, 0.0)):

        def pressed(steps: int, wall: float = wall, cap: float = cap) -> Problem:
            return two_pressures(wall, cap, steps)

        yield Case(
            name=f"two_pressures_{wall:g}_{cap:g}", family="skew", problem=pressed, truth=holds(),
            steps=(1, 3), size="default",
            potential=wall == cap, setting=f"Tube with {wall:g} in its wall and {cap:g} in its cap, loaded sideways.",
        )  # fmt: skip
    for word, pressure, warped, held in (
        ("light", 0.02, 0.0, ("x_min", "x_max", "y_min")), ("strong", 0.5, 0.0, ("x_min", "x_max", "y_min")),
        ("gale", 2.0, 0.0, ("x_min", "x_max", "y_min")), ("hypar_light", 0.02, 0.25, ("x_min", "x_max")),
        ("hypar_strong", 0.5, 0.25, ("x_min", "x_max")), ("hypar_lee", -0.5, 0.25, ("x_min", "x_max")),
    ):  # fmt: skip

        def blown(
            steps: int, pressure: float = pressure, warped: float = warped, held: tuple[str, ...] = held
        ) -> Problem:
            return sail(pressure, steps, warped=warped, held=held)

        yield Case(
            name=f"sail_{word}", family="skew", problem=blown, truth=holds(), steps=(1, 2, 6), size="default",
            potential=False,
            setting=f"Prestressed sail with free edges ({word.replace('_', ', ')}), wind {pressure:g}.",
        )  # fmt: skip

    def framed(steps: int) -> Problem:
        return sail(2.0, steps, warped=0.25, held=("x_min", "x_max", "y_min", "y_max"))

    yield Case(
        name="sail_framed", family="skew", problem=framed, truth=holds(), steps=(1, 4), size="default",
        setting="Hyperbolic paraboloid held at all its edges, wind 2.",
    )  # fmt: skip
    yield Case(
        name="box", family="skew", problem=box, truth=UNKNOWN, steps=(1, 3), size="default", may_refuse="edge",
        setting="Two cubes with a common wall under 0.2 and 0.4: three triangles meet at its edges.",
    )  # fmt: skip
