"""Torsion, end moments, falling pressure, loads to and fro: the stability sweeps' structures, their last stage cut anew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from taichi_membrane.assurance.stability import loading, state, structures
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts.building import cut, traced
from taichi_membrane.assurance.verdicts.case import Case, holds, limit

# By load steps of 5e-5 and arc length in the last; assurance/stability/loading.py.
_SLENDER = 1.049836
# Below the smallest of the limits of the beam (traced at 1.02 and more of π p r³/L for its 12 × 12 triangles).
_BELOW = 0.8


def _torsion() -> Iterator[Case]:
    for level in (0.5, 2.0, 10.0):

        def problem(steps: int, level: float = level) -> Problem:
            return cut(loading.torsion().problem(level), steps, exact={})

        yield Case(
            name=f"torsion_{level:g}", family="loading", problem=problem,
            truth=holds("mechanics", "torque under a motion"), size="default",
            steps=(1, 3, 8), setting=f"Tube turned to {level:g} times the angle of its wrinkling torque.",
        )  # fmt: skip


def _limits() -> Iterator[Case]:
    for level in (1.1, 2.0, 10.0):

        def bent(steps: int, level: float = level) -> Problem:
            return cut(loading.moment().problem(level), steps, until="collapse")

        yield traced(
            f"moment_{level:g}", family="loading", problem=bent, size="default", steps=(1, 4, 14),
            setting=f"Beam bent by a couple at its end to {level:g} of π p r³.",
        )  # fmt: skip
    for level in (1.06, 2.0, 10.0):

        def pressed(steps: int, level: float = level) -> Problem:
            return cut(loading.collapse().problem(level), steps, until="collapse")

        yield Case(
            name=f"slender_{level:g}", family="loading", problem=pressed, size="default", steps=(1, 4, 14),
            truth=limit("load.tip", _SLENDER, width=1e-6, source="fine load steps"),
            setting=f"Slender tube pressed at its end to {level:g} of π p r³/L.",
        )  # fmt: skip
    for level in (0.95, 0.5, 0.1):

        def leaking(steps: int, level: float = level) -> Problem:
            return cut(loading.failing_pressure().problem(level), steps, until="collapse")

        yield traced(
            f"leak_{level:g}", family="loading", problem=leaking, size="default", steps=(1, 4, 14),
            setting=f"Beam at 40 % of its collapse load, its pressure let off to {level:g} of what theory says that it needs.",
        )  # fmt: skip


def _cycles() -> Iterator[Case]:
    for peak in (0.6, _BELOW):

        def back(steps: int, peak: float = peak) -> Problem:
            return cut(state.reversed_load().problem(peak), steps)

        yield Case(
            name=f"back_{peak:g}", family="loading", problem=back, truth=holds("mechanics", "elastic"),
            size="default", steps=(1, 5),
            allowed=1e-3, setting=f"Beam loaded to {peak:g} of its collapse load and unloaded again: nothing is left.",
        )  # fmt: skip

    def breathing(steps: int) -> Problem:
        return cut(state.cyclic().problem(5.0), steps)

    yield Case(
        name="breathing", family="loading", problem=breathing, truth=holds("mechanics", "elastic"),
        size="default", steps=(1, 3),
        allowed=1e-4, setting="Sphere blown up and let down five times: nothing is left.",
    )  # fmt: skip
    for peak in (0.7, 1.6):

        def swayed(steps: int, peak: float = peak) -> Problem:
            problem = structures.beam(steps=1)
            turns = [0.5, -0.5, 0.7, -0.7, peak]
            problem["stages"][1:] = [{"name": f"turn_{k}", "loads": {"tip": share}} for k, share in enumerate(turns)]
            problem["stages"][-1] |= {"steps": steps, **({"until": "collapse"} if peak > 1.0 else {})}
            return Problem(scene=problem, measure=structures.beam_tip)

        yield traced(
            f"sway_{peak:g}", family="loading", problem=swayed, size="default", steps=(1, 4, 14),
            setting=f"Beam swayed to ±0.5 and ±0.7 of its collapse load, then pushed to {peak:g}.",
        )  # fmt: skip


def _large() -> Iterator[Case]:
    def at_once(steps: int) -> Problem:
        problem = loading.large_steps().problem(1.0)
        return replace(cut(problem, steps), exact={})

    yield Case(
        name="at_once", family="loading", problem=at_once, size="default", steps=(1, 5, 30),
        truth=holds("fine load steps", "a hundred load steps hold all the way"),
        setting="Beam, pressure and 0.8 of its collapse load rising together from nothing.",
    )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _torsion()
    yield from _limits()
    yield from _cycles()
    yield from _large()
