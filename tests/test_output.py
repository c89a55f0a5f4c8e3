"""Files of a run: round trips, valid formats, atomic replacement, refusal of foreign folders."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from run_files import FABRIC, MESH, PROVENANCE, SCENE, SETTINGS, a_result, a_run, a_step, a_writer, same

from taichi_membrane.errors import InputError
from taichi_membrane.output import atomic
from taichi_membrane.output.reader import read_run
from taichi_membrane.output.writer import Writer
from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import driver_unit
from taichi_membrane.shapes import tube


def strict_json(path: Path) -> Any:
    """JSON as the standard has it: no NaN, no Infinity."""

    def refuse(token: str) -> None:
        raise AssertionError(f"{token} in {path}")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_a_run_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    steps = [
        a_step(0),
        a_step(1, energy=None, probes={**a_step(1).probes, "tip": float("nan")}),
        a_step(2, converged=False, reason="stagnated", residual=float("nan")),
    ]
    a_run(tmp_path / "run", steps)
    saved = read_run(tmp_path / "run")
    scene, mesh, read = saved.scene, saved.mesh, saved.steps
    assert scene == SCENE
    assert saved.settings == SETTINGS
    assert saved.provenance == PROVENANCE
    assert saved.seconds == {"compile": 1.0}
    assert saved.complete
    assert same(mesh.points, MESH.points)
    assert same(mesh.triangles, MESH.triangles)
    assert same(dict(mesh.node_groups), dict(MESH.node_groups))
    assert same(dict(mesh.tri_groups), dict(MESH.tri_groups))
    assert same(mesh.tri_warp, MESH.tri_warp)
    assert len(read) == 3
    assert all(same(a, b) for a, b in zip(steps, read, strict=True))


def test_warp_directions_are_read_back_to_the_last_bit(tmp_path: Path) -> None:
    """Unit vectors askew to the axes, which made unit once more would change."""
    mesh = tube(radius=25.0, length=100.0, around=8, along=6)
    fabric = np.zeros(mesh.tri_count, dtype=np.int32)
    Writer(tmp_path, SCENE, mesh, settings=SETTINGS, provenance=PROVENANCE, tri_fabric=fabric)
    assert same(read_run(tmp_path).mesh.tri_warp, mesh.tri_warp)


def test_paraview_gets_reference_points_a_displacement_vector_and_all_fields(tmp_path: Path) -> None:
    step = a_step(0)
    a_run(tmp_path / "run", [step])
    read = meshio.read(tmp_path / "run" / "step_0000.vtu")
    assert same(read.points, MESH.points)
    assert same(read.point_data["displacement"], step.displacement)
    assert same(read.point_data["reaction"], step.reaction)
    cells = {name: blocks[0] for name, blocks in read.cell_data.items()}
    assert cells.keys() == {
        "state", "fold_strain", "major_stress_pk2", "minor_stress_pk2", "major_direction", "taut_margin", "slack_margin", "fabric",
        "stress_warp_pk2", "stress_weft_pk2", "stress_shear_pk2", "strain_warp", "strain_weft", "strain_shear",
        "major_resultant_cauchy", "minor_resultant_cauchy", "warp_resultant_cauchy", "weft_resultant_cauchy",
        "shear_resultant_cauchy",
    }  # fmt: skip
    assert same(cells["stress_weft_pk2"], step.elements.stress[:, 1])
    assert same(cells["strain_shear"], step.elements.strain[:, 2])
    assert same(cells["major_direction"], step.elements.major_direction)
    assert same(cells["fabric"], FABRIC)


def test_the_series_lists_the_steps_in_order(tmp_path: Path) -> None:
    a_run(tmp_path / "run", [a_step(0), a_step(1)])
    root = ElementTree.parse(tmp_path / "run" / "steps.pvd").getroot()
    assert root.attrib["type"] == "Collection"
    sets = [(item.attrib["timestep"], item.attrib["file"]) for item in root.iter("DataSet")]
    assert sets == [("0", "step_0000.vtu"), ("1", "step_0001.vtu")]


def test_history_has_a_row_per_step_and_units_in_distinct_headers(tmp_path: Path) -> None:
    step = a_step(1)
    a_run(tmp_path / "run", [a_step(0), step])
    with (tmp_path / "run" / "history.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == [
        "step", "stage", "stage_step", "pressure.inside [MPa]", "load.pull [N]", "load.wind", "load.seam [N/mm]",
        "volume [mm³]", "tip [mm]", "foot [N]", "girth [mm]", "probe.volume [mm³]", "peak [MPa PK2]", "wrinkled",
        "taut_count", "wrinkled_count", "slack_count", "iterations", "residual", "potential_energy [N·mm]", "solver",
        "converged", "reason", "cuts", "negative_pivots", "stability", "trace", "seconds",
    ]  # fmt: skip
    assert len(rows) == 3
    row = dict(zip(rows[0], rows[2], strict=True))
    assert float(row["load.pull [N]"]) == 1.0 / 3.0
    assert float(row["tip [mm]"]) == step.probes["tip"]
    assert int(row["slack_count"]) == np.count_nonzero(step.elements.state == 2)
    assert row["reason"] == "residual, with a comma"


def test_a_unit_vector_alone_gives_a_load_factor_its_unit() -> None:
    assert driver_unit(SCENE, "load.wind") == ""
    unit = SCENE.loads["wind"].model_copy(update={"direction": (0.0, 0.6, 0.8)})
    assert driver_unit(SCENE.model_copy(update={"loads": {"wind": unit}}), "load.wind") == "N/mm²"


def test_summary_is_strict_json_with_what_a_reader_needs(tmp_path: Path) -> None:
    bad = a_step(1, residual=float("inf"), energy=None, converged=False, reason="not finite")
    a_run(tmp_path / "run", [a_step(0), bad])
    summary = strict_json(tmp_path / "run" / "summary.json")
    assert summary["complete"] is True  # it ended by itself
    assert summary["converged"] is False
    assert summary["passed"] is False
    assert summary["provenance"] == PROVENANCE
    settings = {"arch": "cpu", "precision": "f32", "threads": 2, "render": False, "estimate": "", "cascade": 0}
    assert summary["settings"] == settings
    assert summary["seconds"] == {"compile": 1.0}
    assert summary["checks"][0]["value"] is None
    assert summary["mesh"]["node_count"] == MESH.node_count
    assert summary["mesh"]["node_groups"]["x_min"] == 3
    assert [step["converged"] for step in summary["steps"]] == [True, False]
    assert summary["steps"][1]["residual"] is None
    assert summary["steps"][1]["reason"] == "not finite"
    assert Scene.model_validate(summary["scene"]) == SCENE
    assert set(summary["files"]) == {path.name for path in (tmp_path / "run").iterdir()}


def test_every_step_leaves_a_run_that_can_be_read_and_is_not_complete(tmp_path: Path) -> None:
    writer = a_writer(tmp_path)
    assert read_run(tmp_path).steps == ()
    for number in range(3):
        paths = writer.write_step(a_step(number), {})
        assert [path.name for path in paths] == [f"step_{number:04d}.vtu", "history.csv", "steps.pvd", "summary.json"]
        assert len(read_run(tmp_path).steps) == number + 1
        assert strict_json(tmp_path / "summary.json")["complete"] is False
    writer.finish(
        a_result([a_step(k) for k in range(2)], tmp_path)
    )  # as after Ctrl-C: all converged, but not all steps
    assert strict_json(tmp_path / "summary.json")["complete"] is False
    writer.finish(a_result([a_step(k) for k in range(3)], tmp_path))
    assert strict_json(tmp_path / "summary.json")["complete"] is True


def test_finish_returns_all_files_in_order_noted_ones_last(tmp_path: Path) -> None:
    writer = a_writer(tmp_path)
    writer.write_step(a_step(0), {})
    writer.note(tmp_path / "curve.png")
    names = [path.name for path in writer.finish(a_result([a_step(0)], tmp_path))]
    assert names == ["summary.json", "history.csv", "steps.pvd", "mesh.vtu", "step_0000.vtu", "curve.png"]


def test_files_of_an_earlier_run_go_and_those_of_the_user_stay(tmp_path: Path) -> None:
    a_run(tmp_path, [a_step(0), a_step(1), a_step(2)])
    for name in ("step_0002.png", "animation.gif", "curve.png", "notes.txt", "step_x.vtu", ".step_0001.vtu.77.tmp"):
        (tmp_path / name).touch()
    a_run(tmp_path, [a_step(0)])
    held = {path.name for path in tmp_path.iterdir()}
    assert held == {
        "summary.json", "history.csv", "steps.pvd", "mesh.vtu", "step_0000.vtu", "notes.txt", "step_x.vtu",
    }  # fmt: skip


@pytest.mark.parametrize("name", ["notes.txt", ".hidden"])
def test_a_folder_that_is_no_run_is_refused_and_left_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=f"holds '{name}' .1 files in all. but no summary.json"):
        a_writer(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("content", ["{}", "[]", "", '{"format": "other"}', "[" * 100_000])
def test_somebody_elses_summary_does_not_make_a_folder_ours(tmp_path: Path, content: str) -> None:
    (tmp_path / "summary.json").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=r"no summary\.json of an earlier run"):
        a_writer(tmp_path)
    assert (tmp_path / "summary.json").read_text(encoding="utf-8") == content


def test_a_file_in_the_way_of_the_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="output folder cannot be read: Not a directory"):
        a_writer(tmp_path / "file")
    with pytest.raises(InputError, match="output folder cannot be made: Not a directory"):
        a_writer(tmp_path / "file" / "below")


def test_a_file_that_cannot_be_written_is_told_and_leaves_the_old_one(tmp_path: Path) -> None:
    writer = a_writer(tmp_path)
    writer.write_step(a_step(0), {})
    shutil.rmtree(tmp_path)
    with pytest.raises(InputError, match=r"step_0001.vtu: cannot be written: No such file or directory"):
        writer.write_step(a_step(1), {})


@pytest.mark.parametrize("stop", range(8))
def test_an_interrupt_at_any_replacement_leaves_a_readable_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop: int
) -> None:
    """Two steps make eight replacements; Ctrl-C at each of them in turn."""
    writer = a_writer(tmp_path)
    done = []
    real_replace = os.replace

    def interrupted(source: Path, target: Path) -> None:
        if len(done) == stop:
            raise KeyboardInterrupt
        done.append(target)
        real_replace(source, target)

    steps = [a_step(0), a_step(1)]
    monkeypatch.setattr(atomic.os, "replace", interrupted)
    with contextlib.suppress(KeyboardInterrupt):
        for step in steps:
            writer.write_step(step, {})
    assert len(done) == stop
    monkeypatch.undo()
    assert not list(tmp_path.glob(".*"))  # no temporary files
    read = read_run(tmp_path).steps
    assert len(read) == stop // 4  # a step counts once its summary, the last of four files, is in place
    assert all(same(a, b) for a, b in zip(steps, read, strict=False))
    # What run() does next: hand over all steps that were computed, including one whose writing was cut short.
    begun = steps[: stop // 4 + 1]
    writer.finish(a_result(begun, tmp_path))
    assert all(same(a, b) for a, b in zip(begun, read_run(tmp_path).steps, strict=True))
    with (tmp_path / "history.csv").open(encoding="utf-8") as file:
        assert len(list(csv.reader(file))) == 1 + len(begun)


def test_a_kill_leaves_at_most_a_temporary_file_that_the_next_run_removes(tmp_path: Path) -> None:
    script = """
import os, sys
from pathlib import Path
from run_files import a_step, a_writer
from taichi_membrane.output import atomic
writer = a_writer(Path(sys.argv[1]))
writer.write_step(a_step(0), {})
atomic.os.replace = lambda source, target: os._exit(9)
writer.write_step(a_step(1), {})
"""
    tests = Path(__file__).resolve().parent
    path = os.pathsep.join((str(tests), str(tests.parent)))
    command = [sys.executable, "-c", script, str(tmp_path)]
    run = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, check=False)
    assert run.returncode == 9
    assert [path.name.split(".")[1] for path in tmp_path.glob(".*")] == ["step_0001"]
    assert same(read_run(tmp_path).steps[0], a_step(0))
    a_run(tmp_path, [a_step(2)])
    assert not list(tmp_path.glob(".*"))


def test_a_kill_before_the_first_summary_does_not_lock_the_folder(tmp_path: Path) -> None:
    (tmp_path / ".summary.json.4711.tmp").touch()
    a_run(tmp_path, [a_step(0)])
    assert not list(tmp_path.glob(".*"))
