"""The small set of verdict cases, run: nothing that a run says of itself is untrue."""

from __future__ import annotations

import pytest

from taichi_membrane.assurance.verdicts import bench, catalogue, report
from taichi_membrane.assurance.verdicts.case import Case

pytestmark = pytest.mark.usefixtures("runtime_cpu")


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in catalogue.chosen([], "small")])
def test_what_runs_say_of_themselves_is_true(case: Case) -> None:
    one = report.judged(case, [bench.run(case, steps) for steps in case.steps])
    assert [(run.steps, fault) for run, wrong in zip(one.findings, one.wrong, strict=True) for fault in wrong] == []
