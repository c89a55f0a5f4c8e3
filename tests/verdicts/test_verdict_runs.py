"""The small set of verdict cases, and hard ones, run: nothing that a run says of itself is untrue."""

from __future__ import annotations

import pytest

from taichi_membrane.assurance.verdicts import bench, catalogue, report
from taichi_membrane.assurance.verdicts.case import Case

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# Beside the small set: where the path softens twentyfold in a step, where a pressure fails, and where it passes through nothing.
HARD = ("scatter_8", "leak_0.5", "dome_blown_fails")
# Points that drift to a branch beside (a twelve-sided column), and a way through where nothing acts any more.
IN_STEPS = {"column_1500_12": (1, 3), "joined_through": (3, 10)}


@pytest.mark.parametrize(
    "case",
    [pytest.param(one, id=one.name) for one in (*catalogue.chosen([], "small"), *catalogue.chosen(HARD, "full"))],
)
def test_what_runs_say_of_themselves_is_true(case: Case) -> None:
    one = report.judged(case, [bench.run(case, steps) for steps in case.steps])
    assert [(run.steps, fault) for run, wrong in zip(one.findings, one.wrong, strict=True) for fault in wrong] == []


@pytest.mark.parametrize("name", IN_STEPS)
def test_what_some_ways_to_cut_them_say_is_true(name: str) -> None:
    case = catalogue.CASES[name]
    one = report.judged(case, [bench.run(case, steps) for steps in IN_STEPS[name]])
    assert [(run.steps, fault) for run, wrong in zip(one.findings, one.wrong, strict=True) for fault in wrong] == []
    assert all(run.outcome in ("collapse", "finished") for run in one.findings)
