"""Runs by motions alone, against the balance of their reactions; tubes moved through their collapse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from taichi_membrane import shapes
from taichi_membrane.assurance.stability import state, structures
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import GIVEN
from taichi_membrane.assurance.verdicts.building import BALANCED, cut, in_balance
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case, holds, nothing
from taichi_membrane.assurance.verdicts.columns import FABRIC, PRESSURE, column_mesh
from taichi_membrane.assurance.verdicts.meshes import scattered, with_needle

_Z_AXIS = {"axis": [0.0, 0.0, 1.0], "through": [0.0, 0.0, 0.0]}


def annulus(rings: int, turn: float, steps: int, prestress: float, *, needle: bool = False) -> Problem:
    """Hub turned by ``turn`` degrees in a fixed rim, E t = 1e5."""
    mesh = shapes.annulus(inner=1.0, outer=4.0, around=4 * min(rings, 15), rings=rings)
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": {"E": 1e5, "nu": 0.3, "thickness": 1.0, "prestress": [prestress, prestress, 0.0]},
            "supports": [{"group": "all", "hold": "z"}, {"group": "outer", "hold": "xy"}],
            "motions": {"hub": {"kind": "rotation", "group": "inner", **_Z_AXIS, "hold": "xy"}},
            "stages": [{"name": "turn", "steps": steps, "motions": {"hub": turn}}],
        },
        mesh=with_needle(mesh) if needle else mesh,
        measure=in_balance,
        exact=BALANCED,
    )


def strip(size: int, steps: int, shear: float, stretch: float, seed: int | None = None) -> Problem:
    """A strip between two clamps, one of which moves along and across."""
    mesh = shapes.panel(width=2.0, height=1.0, along_x=2 * size, along_y=size, pattern="alternating")
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
            "supports": [{"group": "all", "hold": "z"}, {"group": "x_min", "hold": "xy"}],
            "motions": {
                "clamp": {"kind": "translation", "group": "x_max", "direction": [stretch, shear, 0.0], "hold": "xy"}
            },
            "stages": [{"name": "move", "steps": steps, "motions": {"clamp": 1.0}}],
        },
        mesh=mesh if seed is None else scattered(mesh, 0.1, seed),
        measure=in_balance,
        exact=BALANCED,
    )


def _flat() -> Iterator[Case]:
    for rings in (8, 15, 30, 60):
        for prestress in (0.0, 1.0):

            def turned(steps: int, rings: int = rings, prestress: float = prestress) -> Problem:
                return annulus(rings, 0.1 if prestress else 1.0, steps, prestress)

            yield Case(
                name=f"annulus_{rings}_{prestress:g}", family="motions", problem=turned, truth=holds(), steps=(1, 3),
                size="small" if (rings, prestress) == (15, 0.0) else "default",
                setting=f"Annulus of {rings} rings, prestress {prestress:g}, its hub turned.",
            )  # fmt: skip
    for size, shear, stretch, seed in (
        (8, 0.02, 0.01, None),
        (8, 0.2, 0.001, None),
        (16, 0.3, 0.0, None),
        (8, 0.1, 0.02, 3),
    ):

        def moved(
            steps: int, size: int = size, shear: float = shear, stretch: float = stretch, seed: int | None = seed
        ) -> Problem:
            return strip(size, steps, shear, stretch, seed)

        word = "" if seed is None else ", scattered"
        yield Case(
            name=f"strip_{size}_{shear:g}_{stretch:g}{'_scattered' if word else ''}", family="motions",
            problem=moved, truth=holds(),
            steps=(1, 4), size="default",
            setting=f"Strip, {size} rows, sheared by {shear:g} and stretched by {stretch:g}{word}.",
        )  # fmt: skip

    def needle(steps: int) -> Problem:
        return annulus(15, 0.1, steps, 1.0, needle=True)

    yield Case(
        name="annulus_needle", family="needles", problem=needle, truth=holds(), steps=(1, 3), size="default",
        setting="Annulus of 15 rings, its hub turned, with one edge cut at a thousandth of its length.",
    )  # fmt: skip


def _tubes() -> Iterator[Case]:
    for level in (0.1, 0.9):

        def compressed(steps: int, level: float = level) -> Problem:
            return cut(state.compressed().problem(level), steps)

        yield Case(
            name=f"compressed_{level:g}", family="motions", problem=compressed, truth=holds(), steps=(1, 4),
            size="default", allowed=1e-4,
            setting=f"Open tube without pressure shortened by {level:g} of its length: nothing resists.",
        )  # fmt: skip

    def pushed(steps: int) -> Problem:
        scene: dict[str, Any] = structures.beam()
        scene["motions"] = {"tip": {"kind": "translation", "group": "end", "direction": [0.0, 0.0, -1.0], "hold": "z"}}
        scene["loads"] = {}
        scene["stages"][1] = {"name": "push", "steps": steps, "motions": {"tip": 2.0}}
        scene["supports"].append({"group": "end", "hold": "y"})
        return Problem(scene=scene, measure=nothing)

    yield Case(
        name="pushed_tip", family="motions", problem=pushed,
        truth=holds("mechanics", "a motion passes the largest load"), steps=(2, 5, 20),
        size="default", setting="Beam whose end is moved down by half its length, kept upright.",
    )  # fmt: skip
    for shortening in (2.0, 20.0):

        def shortened(steps: int, shortening: float = shortening) -> Problem:
            return Problem(
                scene={
                    "mesh": GIVEN,
                    "fabric": FABRIC,
                    "supports": [{"group": "start", "hold": "xyz"}],
                    "motions": {
                        "head": {
                            "kind": "translation",
                            "group": "end",
                            "direction": [-shortening, 0.0, 0.0],
                            "hold": "x",
                        }
                    },
                    "stages": [
                        {"name": "inflate", "pressure": PRESSURE},
                        {"name": "shorten", "steps": steps, "motions": {"head": 1.0}},
                    ],
                },
                mesh=column_mesh(1500.0, 12),
                measure=nothing,
            )

        yield Case(
            name=f"shortened_{shortening:g}", family="motions", problem=shortened, truth=UNKNOWN, steps=(1, 3),
            size="default",
            setting=f"Column 1500 long whose head keeps its plane and comes down by {shortening:g}.",
        )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _flat()
    yield from _tubes()
