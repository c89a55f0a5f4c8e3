"""How verdicts are judged and reported, with made-up runs: no mechanics. Every judging function has to find what is wrong."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from typer.testing import CliRunner

from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts import catalogue, judge, report, truth
from taichi_membrane.assurance.verdicts.bench import scene_of
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case, Finding, State, Truth, holds, limit, nothing
from taichi_membrane.commands import verdicts as command
from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.simulation.model import build_mesh

AT_ONE = limit("load.tip", 1.0, width=0.0, source="closed form")
FALLING = limit("pressure.inside", 1.0, width=0.0, source="closed form")
OPEN_END = Truth(kind="limit", name="load.tip", lower=1.0, upper=math.inf, source="fine arc length")
STATE = State(stage="load", stage_step=1, residual=5e-7, tolerance=1e-6, reactions=0.0, negative=0, told=0)
REACHED: dict[str, Any] = {"outcome": "finished", "passed": True, "at_target": True}


def case(known: Truth, **changes: Any) -> Case:
    def problem(steps: int) -> Problem:
        return Problem(scene={"stages": [{"name": "load", "steps": steps}]}, measure=nothing)

    parts: dict[str, Any] = {
        "name": "made_up",
        "family": "made",
        "setting": "Nothing.",
        "problem": problem,
        "steps": (1, 3),
    }
    return Case(truth=known, **(parts | changes))


def found(
    low: float | None = None, high: float = 0.0, *, name: str = "load.tip", target: float = 2.0, **changes: Any
) -> Finding:
    """A run that tells a limit between two loads, or where there is none that it reached its loads."""
    parts: dict[str, Any] = {
        "case": "made_up",
        "steps": 1,
        "states": (STATE,),
        "iterations": 7,
        "seconds": 0.1,
        "reason": "residual",
    }
    if low is None:
        parts |= REACHED
    else:
        parts |= {"outcome": "collapse", "limits": {name: (low, high)}, "targets": {name: target}}
    return Finding(**(parts | changes))


def kinds(known: Truth, one: Finding, **changes: Any) -> list[str]:
    return [fault.kind for fault in judge.faults(case(known, **changes), one)]


@pytest.mark.parametrize(
    ("known", "one", "wrong"),
    [
        (AT_ONE, found(0.9999, 1.0001), []),
        (AT_ONE, found(1.0 + 0.9e-5, 1.001), []),  # as near as equilibria are known
        (AT_ONE, found(1.0 + 1.1e-5, 1.001), [judge.OUTSIDE]),
        (AT_ONE, found(1.5, 1.6), [judge.OUTSIDE]),
        (AT_ONE, found(0.5, 0.6), [judge.FALSE]),
        (AT_ONE, found(1.0001, 0.9999), [judge.UPSIDE_DOWN]),
        (AT_ONE, found(1.3, 1.2), [judge.UPSIDE_DOWN, judge.OUTSIDE]),
        (AT_ONE, found(), [judge.MISSED]),
        (AT_ONE, found(outcome="no collapse"), [judge.MISSED]),
        (AT_ONE, found(snapped=True), []),
        (AT_ONE, found(outcome="not converged", passed=False), []),
        (AT_ONE, found(outcome="collapse", limits={}), [judge.OUTSIDE]),
        (AT_ONE, found(0.9, 1.1, name="load.other"), [judge.OUTSIDE]),
        (FALLING, found(1.01, 0.99, name="pressure.inside", target=0.0), []),
        (FALLING, found(0.99, 1.01, name="pressure.inside", target=0.0), [judge.UPSIDE_DOWN]),
        (FALLING, found(1.5, 1.4, name="pressure.inside", target=0.0), [judge.FALSE]),
        (FALLING, found(0.5, 0.4, name="pressure.inside", target=0.0), [judge.OUTSIDE]),
        (holds(), found(), []),
        (holds(), found(0.9, 1.1), [judge.FALSE]),
        (OPEN_END, found(), []),
        (OPEN_END, found(7.0, 7.1, target=9.0), []),
        (OPEN_END, found(0.8, 0.9), [judge.FALSE]),
        (UNKNOWN, found(0.9, 1.1), []),
        (UNKNOWN, found(1.1, 0.9), [judge.UPSIDE_DOWN]),
    ],
)
def test_verdicts_against_the_truth(known: Truth, one: Finding, wrong: list[str]) -> None:
    assert kinds(known, one) == wrong


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, []),
        ({"residual": 1.9e-6}, []),
        ({"residual": 2.1e-6}, [judge.UNBALANCED]),
        ({"residual": math.nan}, [judge.UNBALANCED]),
        ({"reactions": 1e-8}, [judge.UNBALANCED]),
        ({"negative": 1, "told": 0}, [judge.UNSTABLE]),
        ({"negative": 1, "told": 1}, [judge.UNSTABLE]),
        ({"negative": None, "told": None}, []),
        ({"negative": 0, "told": 1}, []),
    ],
)
@pytest.mark.parametrize("limits", [None, (0.9, 1.1)])
def test_states_that_are_passed_off_as_results(
    changes: dict[str, Any], wrong: list[str], limits: tuple[float, float] | None
) -> None:
    one = found(*(limits or ()), passed=True)
    assert kinds(UNKNOWN, replace(one, states=(replace(STATE, **changes),))) == wrong


def test_an_unstable_state_that_is_owned_up_to() -> None:
    state = replace(STATE, negative=2, told=2)
    assert kinds(UNKNOWN, found(states=(state,), passed=False)) == []
    assert kinds(UNKNOWN, found(states=(state,), followed=True)) == []
    assert kinds(UNKNOWN, found(states=(replace(state, told=1),), followed=True)) == [judge.UNSTABLE]
    failed = found(states=(state,), outcome="not converged")
    assert kinds(UNKNOWN, failed) == []  # the last state of a run that failed is no result, those before are
    assert kinds(UNKNOWN, replace(failed, states=(state, STATE))) == [judge.UNSTABLE]


def test_a_run_that_ends_elsewhere() -> None:
    assert kinds(holds(), found(at_target=False)) == [judge.OFF_TARGET]
    assert kinds(holds(), found(at_target=False, outcome="not converged")) == []


def test_numbers_of_a_run_that_reached_its_loads() -> None:
    one = found(values={"way back": 2e-3}, exact={"way back": 0.0})
    assert kinds(holds(), one, allowed=1e-3) == [judge.VALUE]
    assert kinds(holds(), one, allowed=3e-3) == []
    assert kinds(holds(), replace(one, values={"way back": math.nan}), allowed=1.0) == [judge.VALUE]
    assert kinds(holds(), replace(one, outcome="not converged")) == []


def test_crashes_and_refusals() -> None:
    broken = Finding(case="made_up", steps=1, crashed="ZeroDivisionError: float division by zero")
    refused = Finding(case="made_up", steps=1, refused="mesh: an edge of three elements")
    assert kinds(UNKNOWN, broken) == [judge.CRASH]
    assert kinds(UNKNOWN, refused) == [judge.CRASH]
    assert kinds(UNKNOWN, refused, may_refuse="edge of three") == []
    assert kinds(UNKNOWN, refused, may_refuse="other words") == [judge.CRASH]


@pytest.mark.parametrize(
    ("findings", "wrong"),
    [
        ([found(0.99, 1.01), found(1.0, 1.02)], []),
        ([found(0.99, 1.01), found(1.02, 1.03)], [1]),
        ([found(0.99, 1.01), found()], [1]),
        ([found(), found(0.99, 1.01), found()], [1, 2]),
        ([found(), found()], []),
        ([found(0.99, 1.01), found(outcome="not converged")], []),
        ([found(0.99, 1.01), Finding(case="made_up", steps=3, crashed="no")], []),
        ([found(1.01, 0.99), found(1.0, 1.0)], []),  # upside down, but that is another fault
    ],
)
def test_runs_in_other_numbers_of_steps_must_not_contradict(findings: list[Finding], wrong: list[int]) -> None:
    across = judge.dependent(findings)
    assert list(across) == wrong
    assert all(fault.kind == judge.DEPENDENT for fault in across.values())


def test_report_counts_every_fault_and_writes_all_runs(tmp_path: Path) -> None:
    wrong = report.judged(case(AT_ONE), [found(0.9999, 1.0001), found(steps=3)])
    silent = report.judged(case(holds(), name="other", family="rest"), [found(outcome="not converged")])
    assert report.counts([wrong, silent]) == {judge.MISSED: 1, judge.DEPENDENT: 1}
    assert (wrong.silent, silent.silent) == (0, 1)
    paths = report.write([wrong, silent], tmp_path, "--full")
    page = paths[0].read_text(encoding="utf-8")
    assert "`taichi-membrane stress --set verdicts --full`" in page
    assert "| made_up | 3 | missed limit | finished (residual), but load.tip between 1 and 1 (closed form) |" in page
    heads, *rows, last = report.summary([wrong, silent])
    assert [row[0] for row in (*rows, last)] == ["made", "rest", "all"]
    assert dict(zip(heads, last, strict=True)) | {
        "runs": "3",
        "missed limit": "1",
        "no verdict": "1",
        "iterations": "21",
    } == dict(zip(heads, last, strict=True))
    with paths[1].open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [(line["case"], line["faults"]) for line in lines] == [
        ("made_up", ""),
        ("made_up", "missed limit; depends on steps"),
        ("other", ""),
    ]
    with Image.open(paths[2]) as picture:
        assert picture.size[0] > 800
    assert report.write([silent], tmp_path / "none", "")[-1].suffix == ".csv"  # no limit is known: nothing to draw


def test_sets_and_names() -> None:
    sizes = [len(catalogue.chosen([], size)) for size in ("small", "default", "full")]
    assert sizes == sorted(set(sizes))
    assert sum(len(one.steps) for one in catalogue.chosen([], "full")) >= 400
    assert {one.family for one in catalogue.chosen(["snaps"], "default")} == {"snaps"}
    with pytest.raises(InputError, match="no verdict case or family is called 'nonsense'"):
        catalogue.chosen(["nonsense"], "full")
    assert all(len(one.steps) > 1 or "path" in one.name for one in catalogue.CASES.values())


def test_stored_truths_are_of_cases_that_there_are() -> None:
    names = truth._entries()
    assert names
    assert names.keys() <= catalogue.CASES.keys()
    with pytest.raises(ValueError, match="no such truth"):
        truth.read({"kind": "limit", "source": "hearsay"}, math.inf)
    entry = {
        "kind": "limit",
        "name": "load.tip",
        "lower": 1.0,
        "upper": 1.1,
        "source": "fine arc length",
        "branching": True,
    }
    assert truth.read({**entry, "target": 2.0}, math.inf).upper == math.inf
    assert truth.read({**entry, "target": 0.0}, 0.5).lower == 0.5
    assert truth.read({**entry, "branching": False}, math.inf).upper == 1.1


def test_the_command_fails_where_a_verdict_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = case(AT_ONE)
    monkeypatch.setattr(command.catalogue, "chosen", lambda names, size: (made,))
    for one, code in ((found(0.9999, 1.0001), 0), (found(), 1)):
        monkeypatch.setattr(
            command, "run_all", lambda cases, jobs, told, one=one: told(made, [one]) or {"made_up": [one]}
        )
        result = CliRunner().invoke(app, ["stress", "--set", "verdicts", "--out", str(tmp_path)])
        assert result.exit_code == code, result.output
        assert f"missed limit {code}" in result.output


def test_stored_truths_are_of_the_meshes_that_their_cases_have() -> None:
    for name, entry in truth._entries().items():
        problem = catalogue.CASES[name].problem(1)
        mesh = build_mesh(scene_of(problem)) if problem.mesh is None else problem.mesh
        assert mesh.node_count == entry["nodes"], name
