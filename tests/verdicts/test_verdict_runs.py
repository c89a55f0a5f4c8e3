"""The small set of verdict cases, run: nothing that a run says of itself is untrue."""

from __future__ import annotations

import pytest

from taichi_membrane.assurance.verdicts import bench, catalogue, report
from taichi_membrane.assurance.verdicts.case import Case

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# Until load steps are accepted by the stiffness at their ends, limits are missed and unstable states taken for results here.
@pytest.mark.xfail(reason="limits missed and unstable states accepted", strict=False)
@pytest.mark.parametrize("case", catalogue.chosen([], "small"), ids=lambda case: case.name)
def test_what_runs_say_of_themselves_is_true(case: Case) -> None:
    one = report.judged(case, [bench.run(case, steps) for steps in case.steps])
    assert [(run.steps, fault) for run, wrong in zip(one.findings, one.wrong, strict=True) for fault in wrong] == []
