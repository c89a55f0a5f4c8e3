"""Damaged and foreign folders are refused with the file and what is wrong with it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest
from run_files import MESH, a_run, a_step

from taichi_membrane.errors import InputError
from taichi_membrane.output.reader import read_run


def damage(directory: Path, change: str) -> None:
    """Break one thing in a run."""
    summary_path = directory / "summary.json"
    summary = json.loads(summary_path.read_text(encoding="utf-8"))
    step = directory / "step_0000.vtu"
    if change == "no summary":
        summary_path.unlink()
        return
    if change == "half a summary":
        summary_path.write_bytes(summary_path.read_bytes()[:300])
        return
    if change == "no step file":
        step.unlink()
    elif change == "half a step file":
        step.write_bytes(step.read_bytes()[: step.stat().st_size // 2])
    elif change == "another mesh's step":
        other = meshio.Mesh(MESH.points[:3], [("triangle", np.array([[0, 1, 2]]))], {"displacement": np.zeros((3, 3))})
        other.write(step)
    elif change == "array of another width":
        content = meshio.read(step)
        content.cell_data["stress_warp"] = [np.zeros((MESH.tri_count, 2))]
        content.write(step)
    elif change == "no mesh":
        (directory / "mesh.vtu").unlink()
    elif change == "foreign":
        summary["format"] = "something else"
    elif change == "newer":
        summary["format_version"] = 99
    elif change == "no steps":
        del summary["steps"]
    elif change == "bad scene":
        summary["scene"]["fabric"]["thickness"] = -1
    elif change == "no number":
        del summary["steps"][0]["number"]
    elif change == "path out of the folder":
        shutil.move(step, directory.parent / "step_0000.vtu")
        summary["steps"][0]["file"] = "../step_0000.vtu"
    summary_path.write_text(json.dumps(summary), encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("no summary", "run: not the folder of a run: it has no summary.json"),
        ("half a summary", "summary.json: damaged, not valid JSON"),
        ("no step file", "step_0000.vtu: this file of the run is missing"),
        ("half a step file", "step_0000.vtu: damaged: "),
        ("another mesh's step", "step_0000.vtu: damaged: no array 'strain_warp'"),
        ("array of another width", "step_0000.vtu: damaged: array 'stress_warp' is (12, 2), but (12,) is expected"),
        ("no mesh", "mesh.vtu: this file of the run is missing"),
        ("foreign", "summary.json: not the summary of a run of this program"),
        ("newer", "summary.json: format version 99, but this program reads version 2"),
        ("no steps", "summary.json: damaged: no list of load steps"),
        ("bad scene", "summary.json: damaged scene: fabric.thickness: -1 must be above 0"),
        ("no number", "summary.json: damaged load step: KeyError: 'number'"),
        ("path out of the folder", "step_0000.vtu: this file of the run is missing"),
    ],
)
def test_a_damaged_run_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str, expected: str
) -> None:
    directory = tmp_path / "run"
    a_run(directory, [a_step(0)])
    damage(directory, change)
    with pytest.raises(InputError) as caught:
        read_run(directory)
    assert str(directory) in str(caught.value)
    assert expected in str(caught.value)
    assert capsys.readouterr() == ("", "")  # meshio prints its complaints


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none: there is no such folder"):
        read_run(tmp_path / "none")
