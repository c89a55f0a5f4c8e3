"""What a load step could tell and does not: each has its reason."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_threads import sheet

import taichi_membrane as tm
from taichi_membrane.output.reader import read_run

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def test_what_is_not_known_says_why(tmp_path: Path) -> None:
    """In results, read back, and of every name that has no value."""
    relaxed = tm.run(sheet(4, "relaxation"), out=tmp_path / "out", render=False)
    newton = tm.run(sheet(4, "hybrid"))
    off = sheet(4, "hybrid").model_dump()
    off["solver"]["stability"] = False
    for result, told in (
        (relaxed, {"stable", "derivatives", "modes", "limit"}),
        (newton, {"derivatives", "modes", "limit"}),
        (tm.run(tm.Scene.model_validate(off)), {"stable", "derivatives", "modes", "limit"}),
    ):
        for step in result.steps:
            assert set(step.unknown) == told
            assert (step.stable is None) == ("stable" in told)
    assert relaxed.steps[0].unknown["stable"] == "relaxation has no tangent (solver.kind = relaxation)"
    assert newton.steps[0].unknown["limit"] == "none was met"
    assert [step.unknown for step in read_run(tmp_path / "out").steps] == [step.unknown for step in relaxed.steps]
