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
from taichi_membrane.output.reader import file_checksum, read_run, summary_checksum


def damage(directory: Path, change: str) -> None:
    """Break one thing in a run."""
    summary_path = directory / "summary.json"
    step = directory / "step_0000.vtu"
    if change == "no summary":
        summary_path.unlink()
    elif change == "half a summary":
        summary_path.write_bytes(summary_path.read_bytes()[:300])
    elif change == "no step file":
        step.unlink()
    elif change == "half a step file":
        step.write_bytes(step.read_bytes()[: step.stat().st_size // 2])
    elif change == "one bit of a step file":
        content = bytearray(step.read_bytes())
        content[len(content) // 2] ^= 1
        step.write_bytes(content)
    elif change == "another mesh":
        MESH_OF_ANOTHER_RUN.write(directory / "mesh.vtu", file_format="vtu")
    elif change == "no mesh":
        (directory / "mesh.vtu").unlink()
    elif change == "a number changed":
        summary_path.write_text(summary_path.read_text(encoding="utf-8").replace('"nu": 0.3', '"nu": 0.4'), "utf-8")


MESH_OF_ANOTHER_RUN = meshio.Mesh(MESH.points[:3], [("triangle", np.array([[0, 1, 2]]))])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("no summary", "run: not the folder of a run: it has no summary.json"),
        ("half a summary", "summary.json: damaged, not valid JSON"),
        ("a number changed", "summary.json: damaged or changed: its checksum is not that of its content"),
        ("no step file", "step_0000.vtu: this file of the run is missing"),
        ("half a step file", "step_0000.vtu: damaged or changed: its checksum is not the one in summary.json"),
        ("one bit of a step file", "step_0000.vtu: damaged or changed: its checksum is not the one in summary.json"),
        ("another mesh", "mesh.vtu: damaged or changed: its checksum is not the one in summary.json"),
        ("no mesh", "mesh.vtu: this file of the run is missing"),
    ],
)
def test_a_damaged_run_is_refused(tmp_path: Path, change: str, expected: str) -> None:
    directory = tmp_path / "run"
    a_run(directory, [a_step(0)])
    damage(directory, change)
    refuse(directory, expected)


def refuse(directory: Path, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        read_run(directory)
    assert str(directory) in str(caught.value)
    assert expected in str(caught.value)


def forge(directory: Path, change: str) -> None:
    """Break one thing in a run, and make the checksums those of what is there."""
    summary_path = directory / "summary.json"
    summary = json.loads(summary_path.read_text(encoding="utf-8"))
    step = directory / "step_0000.vtu"
    if change == "half a step file":
        step.write_bytes(step.read_bytes()[: step.stat().st_size // 2])
    elif change == "another mesh's step":
        MESH_OF_ANOTHER_RUN.write(step)
    elif change == "array of another width":
        content = meshio.read(step)
        content.cell_data["stress_warp_pk2"] = [np.zeros((MESH.tri_count, 2))]
        content.write(step)
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
    elif change == "another setting":
        summary["settings"]["speed"] = "high"
    elif change == "path out of the folder":
        shutil.move(step, directory.parent / "step_0000.vtu")
        summary["steps"][0]["file"] = "../step_0000.vtu"
    if step.exists() and "steps" in summary:
        summary["steps"][0]["sha256"] = file_checksum(step)
    del summary["sha256"]
    summary["sha256"] = summary_checksum(summary)
    summary_path.write_text(json.dumps(summary), encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("half a step file", "step_0000.vtu: damaged: "),
        ("another mesh's step", "step_0000.vtu: damaged: no array 'displacement'"),
        ("array of another width", "step_0000.vtu: damaged: array 'stress_warp_pk2' is (12, 2), but (12,) is expected"),
        ("foreign", "summary.json: not the summary of a run of this program"),
        ("newer", "summary.json: format version 99, but this program reads version 9"),
        ("no steps", "summary.json: damaged: KeyError: 'steps'"),
        ("bad scene", "summary.json: damaged scene: fabric.thickness: -1 must be above 0"),
        ("no number", "summary.json: damaged: KeyError: 'number'"),
        ("another setting", "summary.json: damaged: TypeError: _settings() got an unexpected keyword argument 'speed'"),
        ("path out of the folder", "step_0000.vtu: this file of the run is missing"),
    ],
)
def test_what_no_run_can_have_written_is_refused_whatever_its_checksums(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str, expected: str
) -> None:
    directory = tmp_path / "run"
    a_run(directory, [a_step(0)])
    forge(directory, change)
    refuse(directory, expected)
    assert capsys.readouterr() == ("", "")  # meshio prints its complaints


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none: there is no such folder"):
        read_run(tmp_path / "none")
