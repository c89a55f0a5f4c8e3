"""Probes of one's own: functions of the mesh and the load step, in results, files and tables like the scene's."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from resume_cases import run_until
from test_threads import sheet

import taichi_membrane as tm
from taichi_membrane.mesh import Mesh
from taichi_membrane.output.reader import read_run
from taichi_membrane.output.tables import step_columns

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def top(mesh: Mesh, step: tm.StepResult) -> float:
    """Height of the highest node."""
    return float((mesh.points + step.displacement)[:, 2].max())


def tension(mesh: Mesh, step: tm.StepResult) -> np.float64:
    return np.float64(step.elements.major_resultant.max())


OWN = {"top": top, "tension": tension}


def test_values_stand_beside_the_scenes_in_results_and_files(tmp_path: Path) -> None:
    result = tm.run(sheet(4, "relaxation"), out=tmp_path / "out", render=False, probes=OWN)
    assert result.converged
    assert list(result.probe("top")) == [top(result.mesh, step) for step in result.steps]
    assert result.probe("tension")[1] > result.probe("tension")[0] > 0.0
    with (tmp_path / "out/history.csv").open(encoding="utf-8") as file:
        assert [float(row["top"]) for row in csv.DictReader(file)] == list(result.probe("top"))
    assert [step.probes for step in read_run(tmp_path / "out").steps] == [step.probes for step in result.steps]
    assert {"top", "tension"} <= {column.header for column in step_columns(result.scene, result.steps)}


def test_a_run_goes_on_with_the_functions_it_was_begun_with_alone(tmp_path: Path) -> None:
    run_until(0, sheet(4, "relaxation"), out=tmp_path / "out", render=False, probes=OWN)
    for given, now in ({}, "none"), ({"top": top}, "top"):
        with pytest.raises(
            tm.InputError, match=f"with probes of its own: tension, top; given are: {now}; go on with resume"
        ):
            tm.resume(tmp_path / "out", probes=given)
    result = tm.resume(tmp_path / "out", probes=OWN)
    whole = tm.run(sheet(4, "relaxation"), probes=OWN)
    assert len(result.steps) == 2
    assert list(result.probe("tension")) == list(whole.probe("tension"))
    assert tm.resume(tmp_path / "out").steps[1].probes == result.steps[1].probes  # nothing is left to measure


@pytest.mark.parametrize(
    ("probes", "told"),
    [
        ({"two words": top}, "'two words' is no name: a letter, then letters, digits and _"),
        ({"top": 3.0}, "'top' is 3.0; give a function of the mesh and the load step"),
        ({"top": lambda mesh, step: None}, "'top' gave None at inflate 1; a number is needed"),
        ({"top": lambda mesh, step: step.displacement}, "'top' gave .* at inflate 1; a number is needed"),
    ],
)
def test_what_is_no_probe_is_told(probes: dict[str, Any], told: str) -> None:
    with pytest.raises(tm.InputError, match=told):
        tm.run(sheet(3, "relaxation"), probes=probes)


def test_a_name_of_the_scene_is_taken() -> None:
    scene = tm.Scene.model_validate(sheet(3, "relaxation").model_dump() | {"probes": {"top": {"kind": "volume"}}})
    with pytest.raises(tm.InputError, match="'top' is a probe of the scene already"):
        tm.run(scene, probes=OWN)
