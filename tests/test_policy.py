"""Verdicts about load steps: what is accepted, what is refused, and that neither depends on how the load is cut into steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation import load_step
from taichi_membrane.simulation.policy import POLICY, Passage, told
from taichi_membrane.simulation.results import RunResult


def beam(pressure: float, radius: float, steps: int, **changes: Any) -> Scene:
    """A cantilever of 400 mm, pushed sideways to 1.4 times the load at which a membrane tube of its dimensions folds."""
    theory = float(np.pi * pressure * radius**3 / 400.0)
    return Scene.model_validate({
        "name": "beam",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": radius, "length": 400.0, "around": 12, "along": 30},
        "fabric": {"E": 4000.0, "nu": 0.1, "thickness": 0.1},
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": (0, 0, -1)}},
        "stages": [
            {"name": "inflate", "pressure": pressure},
            {"name": "load", "steps": steps, "loads": {"tip": 1.4 * theory}, "until": "collapse"},
        ],
        **changes,
    })  # fmt: skip


def column(around: int, steps: int) -> Scene:
    """A slender tube pressed along its axis to 30 N, well beyond its buckling load."""
    return Scene.model_validate({
        "name": "column",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 25.0, "length": 1500.0, "around": around, "along": 40, "cap_end": "hemisphere"},
        "fabric": {"E": 400.0, "nu": 0.3, "thickness": 1.0},
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": (-1, 0, 0)}},
        "stages": [{"name": "inflate", "pressure": 0.035}, {"name": "press", "steps": steps, "loads": {"tip": 30.0}}],
    })  # fmt: skip


def bracket(result: RunResult) -> tuple[float, float]:
    limit = result.steps[-1].limit
    assert limit is not None, result.steps[-1].reason
    return limit["load.tip"]


def overlap(brackets: Sequence[tuple[float, float]]) -> bool:
    return max(low for low, _ in brackets) <= min(high for _, high in brackets)


@pytest.mark.parametrize(("pressure", "radius"), [(0.03, 18.0), (0.1, 39.0)])
def test_a_collapse_load_does_not_depend_on_the_number_of_steps(pressure: float, radius: float) -> None:
    found = [run(beam(pressure, radius, steps)) for steps in (1, 4, 14)]
    assert {result.outcome for result in found} == {"finished"}  # the stage is meant to meet it
    brackets = [bracket(result) for result in found]
    assert all(low < high for low, high in brackets)
    assert overlap(brackets)
    assert all(step.negative_pivots == 0 for result in found for step in result.steps)


def test_a_tube_that_only_stiffens_says_that_it_met_no_collapse() -> None:
    result = run(beam(0.08, 15.0, 2))
    last = result.steps[-1]
    assert (result.outcome, result.converged, last.limit) == ("no collapse", False, None)
    assert last.reason.startswith("no collapse up to load.tip = 2.96")
    assert last.converged
    stages = beam(0.08, 15.0, 2).model_dump()["stages"]
    stages[1]["until"] = "collapse_or_target"
    assert run(beam(0.08, 15.0, 2, stages=stages)).outcome == "finished"


@pytest.mark.parametrize("around", [12, 16])
def test_a_column_buckles_at_its_linearised_load_in_any_number_of_steps(around: int) -> None:
    """The axial prestress state hardly moves, so that buckling linearised from 20 N is right to a thousandth."""
    below = column(around, 1).model_dump()
    below["stages"][1]["loads"] = {"tip": 20.0}
    linearised = run(Scene.model_validate(below | {"modes": {"kind": "buckling", "count": 1, "stage": "press"}}))
    assert linearised.steps[-1].modes is not None
    buckling = 20.0 * linearised.steps[-1].modes.values[0]
    found = [run(column(around, steps)) for steps in (1, 3)]
    assert [result.outcome for result in found] == ["collapse"] * 2
    brackets = [bracket(result) for result in found]
    assert overlap(brackets)
    assert brackets[1] == pytest.approx((buckling, buckling), rel=1e-3)
    assert all(step.stable for result in found for step in result.steps)
    assert {"unstable", "path"} < {passage.event for passage in found[0].steps[-1].trace}


def test_the_trace_tells_how_a_step_came_to_its_end() -> None:
    trace = run(beam(0.03, 18.0, 4)).steps[-1].trace
    assert trace[-1].event == "limit"
    assert [one.share for one in trace] == sorted(one.share for one in trace)
    once = (
        Passage(event="bisected", share=0.5),
        Passage(event="bisected", share=0.25),
        Passage(event="path", share=0.25),
    )
    assert told(once) == "bisected ×2, path"


def annulus(rings: int, **changes: Any) -> Scene:
    """A flat ring, its rim held, its hub turned by 10 degrees: nothing but a motion acts."""
    return Scene.model_validate({
        "name": "annulus",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "annulus", "inner": 5.0, "outer": 12.5, "around": 4 * rings, "rings": rings},
        "fabric": {"E": 1e5, "nu": 0.3, "thickness": 1.0},
        "supports": [{"group": "outer", "hold": "xyz"}, {"group": "all", "hold": "z"}],
        "motions": {"turn": {"kind": "rotation", "group": "inner", "axis": [0, 0, 1], "through": [0, 0, 0], "hold": "xy"}},
        "stages": [{"name": "turn", "motions": {"turn": 10.0}}],
        "probes": {
            name: {"kind": "moment", "group": name, "axis": [0, 0, 1], "through": [0, 0, 0]} for name in ("inner", "outer")
        },
        **changes,
    })  # fmt: skip


@pytest.mark.parametrize("rings", [12, 24])
@pytest.mark.parametrize("kind", ["hybrid", "relaxation"])
def test_reactions_of_a_motion_balance_whatever_the_mesh(rings: int, kind: str) -> None:
    result = run(annulus(rings, solver={"kind": kind}))
    assert result.outcome == "finished"
    if kind == "hybrid":
        assert result.steps[-1].iterations < 35  # the unstrained start is no reason to cut the step to pieces
    hub, rim = (result.probe(name)[-1] for name in ("inner", "outer"))
    assert hub == pytest.approx(-rim, rel=1e-5)


def test_a_path_ends_at_its_target_and_says_where_its_steps_were_used_up() -> None:
    stages = beam(0.03, 18.0, 4).model_dump()["stages"]
    stages[1] |= {"control": "arc_length", "until": "target", "loads": {"tip": 1.0}}
    there = run(beam(0.03, 18.0, 4, stages=[stages[0], stages[1] | {"steps": 12}]))
    assert there.outcome == "finished"
    assert there.steps[-1].loads == {"tip": 1.0}
    short = run(beam(0.03, 18.0, 4, stages=[stages[0], stages[1] | {"steps": 2, "loads": {"tip": 5.0}}]))
    assert short.outcome == "steps used up"
    assert not short.converged
    assert "the steps are used up at" in short.steps[-1].reason
    as_meant = run(
        beam(0.03, 18.0, 4, stages=[stages[0], stages[1] | {"steps": 2, "loads": {"tip": 5.0}, "until": "steps"}])
    )
    assert as_meant.outcome == "finished"


# What each rule and constant of the policy is there for: with it switched off, one of these cases is judged otherwise.
CASES = {
    "beam": lambda: run(beam(0.03, 18.0, 1)),
    "column": lambda: run(column(12, 1)),
}


@pytest.mark.parametrize(
    ("change", "case"),
    [({"resolution": 10.0, "nearer": 10.0, "soft": 0.0}, "beam")],
)
def test_without_its_rules_the_policy_judges_wrong(
    change: dict[str, Any], case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = CASES[case]()
    monkeypatch.setattr(load_step.LoadStep.__init__, "__kwdefaults__", {"policy": replace(POLICY, **change)})
    bad = CASES[case]()
    assert (good.outcome, good.steps[-1].limit) != (bad.outcome, bad.steps[-1].limit)


def test_every_constant_of_the_policy_says_where_it_comes_from() -> None:
    text = type(POLICY).__doc__ or ""
    assert all(f":param {one.name}:" in text for one in fields(POLICY))
