"""Tubes pressed along their axis, against the load at which the straight state loses its stability."""

from __future__ import annotations

from collections.abc import Iterator

from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import GIVEN
from taichi_membrane.assurance.verdicts import meshes
from taichi_membrane.assurance.verdicts.case import Case, Size, nothing
from taichi_membrane.assurance.verdicts.truth import stored
from taichi_membrane.assurance.verdicts.tubes import tube_mesh
from taichi_membrane.mesh import Mesh

RADIUS, PRESSURE = 25.0, 0.035
FABRIC = {"E": 400.0, "nu": 0.3, "thickness": 1.0}
ROW = 20.0  # length of the wall's triangles along the axis: twice that buckles 30 % late
LENGTHS, AROUND = (800.0, 1000.0, 1200.0, 1500.0, 1800.0, 2000.0, 2500.0), (12, 16, 24)
# Up to 0.95 of what the pressure on the lid, π p r² = 68.7 N, can carry before the wall goes slack.
_LARGEST = 65.0
# Beyond Euler's load a column's load rises by θ²/8 with its end's rotation θ; it wrinkles and falls before 0.05: by 3e-4. This is
# ten times that.
_BRANCH = 3e-3
# 1.4 times a cantilever's buckling load by Euler with the pressure's shear stiffness, rounded; no truth, only how far it goes.
_REACH = {800.0: 65.0, 1000.0: 60.0, 1200.0: 46.0, 1500.0: 30.7, 1800.0: 21.5, 2000.0: 17.5, 2500.0: 11.3}


def column_mesh(length: float, around: int) -> Mesh:
    """The column's tube."""
    return tube_mesh(RADIUS, (around, round(length / ROW)), length)


def column(mesh: Mesh, steps: int, reach: float, *, pull: bool = False) -> Problem:
    """A column fixed at its foot, its head free."""
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": FABRIC,
            "supports": [{"group": "start", "hold": "xyz"}],
            "loads": {"tip": {"group": "end", "direction": [1.0 if pull else -1.0, 0.0, 0.0]}},
            "stages": [
                {"name": "inflate", "pressure": PRESSURE},
                {"name": "load", "steps": steps, "loads": {"tip": reach}},
            ],
        },
        mesh=mesh,
        measure=nothing,
    )


def _columns() -> Iterator[Case]:
    for length in LENGTHS:
        for around in AROUND:
            size: Size = (
                "small" if (length, around) == (1000.0, 12) else "default" if length in (1000.0, 1500.0) else "full"
            )

            def problem(steps: int, length: float = length, around: int = around) -> Problem:
                return column(column_mesh(length, around), steps, _REACH[length])

            name = f"column_{length:g}_{around}"
            yield Case(
                name=name, family="columns", problem=problem, truth=stored(name, branch=_BRANCH), size=size,
                steps=(1, 3) if size == "small" else (1, 2, 3, 4, 5),
                setting=f"Column {length:g} long, {around} around, pressed to {_REACH[length]:g}.",
            )  # fmt: skip


def _below() -> Iterator[Case]:
    """Half the way to the buckling load, where the straight column holds, and pulled, where it always does."""
    for length, around in ((1500.0, 12), (2000.0, 16), (2500.0, 24)):
        for word, reach, pull in (("half", 0.5 * _REACH[length], False), ("pulled", _LARGEST, True)):

            def problem(
                steps: int, length: float = length, around: int = around, reach: float = reach, pull: bool = pull
            ) -> Problem:
                return column(column_mesh(length, around), steps, reach, pull=pull)

            name = f"column_{word}_{length:g}_{around}"
            yield Case(
                name=name, family="columns", problem=problem, truth=stored(name, branch=_BRANCH), size="default", steps=(1, 4),
                setting=f"Column {length:g} long, {around} around, {'pulled' if pull else 'pressed'} to {reach:g}.",
            )  # fmt: skip


def _needle() -> Iterator[Case]:
    def problem(steps: int) -> Problem:
        return column(meshes.with_needle(column_mesh(1500.0, 12)), steps, _REACH[1500.0])

    yield Case(
        name="column_needle", family="needles", problem=problem, truth=stored("column_needle", branch=_BRANCH), size="default",
        steps=(1, 3, 5),
        setting="Column 1500 long, 12 around, with one edge cut at a thousandth of its length.",
    )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _columns()
    yield from _below()
    yield from _needle()
