"""Air beams pressed sideways to collapse, with needles and scatter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import GIVEN
from taichi_membrane.assurance.verdicts import meshes
from taichi_membrane.assurance.verdicts.case import Case, Size, nothing
from taichi_membrane.assurance.verdicts.truth import stored
from taichi_membrane.mesh import Mesh

LENGTH = 400.0
COARSE, FINE = (12, 30), (16, 40)  # triangles around and along
PRESSURES, RADII = np.linspace(0.01, 0.1, 10), np.linspace(15.0, 42.0, 10)
# Of the hundred: those run by the default set, far apart, and the two of the small one.
_DEFAULT = {(0.01, 27.0), (0.03, 39.0), (0.05, 27.0), (0.06, 18.0), (0.1, 42.0), (0.1, 15.0)}
_SMALL = {(0.05, 27.0)}
FABRIC: Mapping[str, Any] = {"E": 4000.0, "nu": 0.1, "thickness": 0.1}
SCATTERED = 30
_SCATTER_PRESSURES, _SCATTER_RADII = (0.02, 0.05, 0.09), (20.0, 25.0, 33.0)


def collapse_load(pressure: float, radius: float) -> float:
    """Of a cantilever by Comer and Levy: π p r³/L."""
    return math.pi * pressure * radius**3 / LENGTH


def tube_mesh(radius: float, counts: tuple[int, int] = COARSE, length: float = LENGTH) -> Mesh:
    """A tube with a hemisphere at its far end."""
    around, along = counts
    return shapes.tube(radius=radius, length=length, around=around, along=along, cap_end="hemisphere")


def beam(
    mesh: Mesh, pressure: float, radius: float, steps: int, *, reach: float = 1.4, fabric: Mapping[str, Any] = FABRIC
) -> Problem:
    """A cantilever whose load is told as a share of the theory's."""
    load = collapse_load(pressure, radius)
    scene = {
        "mesh": GIVEN,
        "fabric": fabric,
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": [0.0, 0.0, -load]}},
        "stages": [
            {"name": "inflate", "pressure": pressure},
            {"name": "load", "steps": steps, "loads": {"tip": reach}, "until": "collapse"},
        ],
    }
    return Problem(scene=scene, mesh=mesh, measure=nothing)


def _size(pressure: float, radius: float) -> Size:
    at = (round(pressure, 6), round(radius, 6))
    return "small" if at in _SMALL else "default" if at in _DEFAULT else "full"


def _grid(counts: tuple[int, int], word: str, pressures: Any, radii: Any) -> Iterator[Case]:
    for pressure in pressures:
        for radius in radii:
            p, r = float(pressure), float(radius)
            name = f"tube_{word}_p{p:g}_r{r:g}"

            def problem(steps: int, p: float = p, r: float = r) -> Problem:
                return beam(tube_mesh(r, counts), p, r, steps)

            size = _size(p, r) if counts == COARSE else "default" if (p, r) == (0.05, 27.0) else "full"
            yield Case(
                name=name, family="tubes", problem=problem, truth=stored(name), size=size,
                steps=(1, 4) if size == "small" else (1, 4, 14),
                setting=f"Cantilever of radius {r:g} under {p:g}, {counts[0]} × {counts[1]} triangles, loaded to 1.4 π p r³/L.",
            )  # fmt: skip


def _with_needles() -> Iterator[Case]:
    for p, r in ((0.05, 27.0), (0.02, 36.0)):

        def problem(steps: int, p: float = p, r: float = r) -> Problem:
            return beam(meshes.with_needle(tube_mesh(r)), p, r, steps)

        yield Case(
            name=f"tube_needle_p{p:g}_r{r:g}", family="needles", problem=problem, truth=stored(f"tube_needle_p{p:g}_r{r:g}"),
            steps=(1, 4, 14), size="default",
            setting=f"Cantilever of radius {r:g} under {p:g} with one edge cut at a thousandth of its length.",
        )  # fmt: skip


def _scatter() -> Iterator[Case]:
    for seed in range(SCATTERED):
        p, r = _SCATTER_PRESSURES[seed % 3], _SCATTER_RADII[seed // 3 % 3]
        share = (0.02, 0.05, 0.1, 0.15)[seed % 4]

        def problem(steps: int, seed: int = seed, p: float = p, r: float = r, share: float = share) -> Problem:
            return beam(meshes.scattered(tube_mesh(r), share, seed), p, r, steps, reach=2.0)

        yield Case(
            name=f"scatter_{seed}", family="scatter", problem=problem, truth=stored(f"scatter_{seed}"),
            steps=(1, 3, 4, 16), size="default" if seed % 10 == 0 else "full",
            setting=f"Cantilever of radius {r:g} under {p:g}, nodes moved by up to {share:g} of the shortest edge (seed {seed}), "
            "loaded to twice π p r³/L.",
        )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _grid(COARSE, "12", PRESSURES, RADII)
    yield from _grid(FINE, "16", (0.02, 0.05, 0.08), (15.0, 21.0, 27.0, 36.0))
    yield from _with_needles()
    yield from _scatter()
