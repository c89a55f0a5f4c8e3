"""A run that was stopped goes on from its last whole load step and ends as if nothing had been."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from resume_cases import NO_MOTION, RELAXATION, SCENE, run_until
from run_files import different, outcome, same
from typer.testing import CliRunner, Result

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.device import runtime
from taichi_membrane.device.runtime import Runtime
from taichi_membrane.execution.observer import Observer
from taichi_membrane.output import atomic
from taichi_membrane.output.reader import read_run, summary_checksum
from taichi_membrane.scene import GivenMesh


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The scene in an empty current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.toml").write_text(SCENE, encoding="utf-8")
    return "beam.toml"


def call(*arguments: str) -> Result:
    """The command in this process; errors other than exits are raised."""
    return CliRunner().invoke(app, arguments, catch_exceptions=False)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, runtime_cpu: Runtime) -> Path:
    """The folder of a run that nothing stopped."""
    directory = tmp_path_factory.mktemp("whole")
    (directory / "beam.toml").write_text(SCENE, encoding="utf-8")
    done = call("run", str(directory / "beam.toml"), *RELAXATION, "--no-render", "--out", str(directory / "run"))
    assert done.exit_code == 0, done.stderr
    return directory / "run"


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    return Path(shutil.copytree(whole, tmp_path / "run"))


def forge(directory: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the summary of a run, checksum included."""
    path = directory / "summary.json"
    summary = json.loads(path.read_text("utf-8"))
    change(summary)
    del summary["sha256"]
    path.write_text(json.dumps({**summary, "sha256": summary_checksum(summary)}), "utf-8")


def held(directory: Path) -> dict[str, tuple[bytes, int]]:
    """What is in the folder, and since when."""
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in directory.iterdir()}


def test_a_full_disk_ends_with_2_and_one_line_and_the_run_goes_on_later(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = str(whole.parent / "beam.toml"), str(tmp_path / "run")
    to_disk = atomic._to_disk

    def full(path: Path, flags: int) -> None:
        if "step_0003.vtu" in path.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        to_disk(path, flags)

    with monkeypatch.context() as patched:
        patched.setattr(atomic, "_to_disk", full)
        done = call("run", scene, *RELAXATION, "--out", out)  # with pictures, which must not be tried
    assert done.exit_code == 2
    assert done.stdout == ""
    told = f"error: {scene}: {out}/step_0003.vtu: cannot be written: No space left on device"
    assert done.stderr.splitlines()[-1] == told
    assert "drawing" not in done.stderr
    assert len(read_run(tmp_path / "run").steps) == 3
    done = call("run", "--resume", out, "--no-render")
    assert done.exit_code == 0
    assert "3 of 5 load steps are there already" in done.stderr
    assert re.findall(r"(\w+ \d)/\d: ", done.stderr) == ["load 2", "load 3"]
    assert not different(outcome(tmp_path / "run"), outcome(whole))


def test_a_run_stopped_from_python_goes_on_without_its_mesh_object(whole: Path, tmp_path: Path) -> None:
    saved = read_run(whole)
    scene = saved.scene.model_copy(update={"mesh": GivenMesh(shape="given")})
    run_until(1, scene, mesh=saved.mesh, out=tmp_path / "run", render=False)
    assert len(read_run(tmp_path / "run").steps) == 2
    forge(tmp_path / "run", lambda summary: summary["seconds"].update(solve=1000.0))
    result = tm.resume(tmp_path / "run", render=False)
    assert result.converged
    assert result.passed
    for one, other in zip(result.steps, saved.steps, strict=True):
        assert same(replace(one, seconds=0.0), replace(other, seconds=0.0))
    assert set(result.seconds) == {"setup", "start", "compile", "solve", "output"}
    assert 1000.0 < result.seconds["solve"] < 1100.0  # times add up


def ended_ill(summary: dict[str, Any]) -> None:
    summary["steps"][-1].update(converged=False, reason="no equilibrium")
    summary["outcome"] = "not converged"


def collapses(summary: dict[str, Any]) -> None:
    summary["steps"][-1].update(limit={"load.side": [1.9, 2.0]}, reason="collapse: at last")
    summary["outcome"] = "collapse"


def check_fails(summary: dict[str, Any]) -> None:
    summary["scene"]["checks"][0]["absolute"] = 1e-9


@pytest.mark.parametrize(
    ("change", "code", "expected"),
    [
        (lambda summary: None, 0, ""),
        (check_fails, 1, "CHECK FAILS: deflection at load 3: "),
        (ended_ill, 3, "NOT CONVERGED: load step 4 (load 3/3): no equilibrium\n"),
        (collapses, 4, "COLLAPSE: load step 4 (load 3/3): at last\n"),
    ],
    ids=["passed", "check fails", "not converged", "collapse"],
)
def test_of_a_run_that_has_ended_nothing_is_done_again(
    run: Path, change: Callable[[dict[str, Any]], None], code: int, expected: str
) -> None:
    forge(run, change)
    before = held(run)
    done = call("run", "--resume", str(run))
    assert done.exit_code == code
    assert done.stdout.startswith(f"{run}: nothing is left to do, the run has ended\n{expected}")
    assert bool(expected) == ("\n" in done.stdout.rstrip("\n"))
    quiet = call("run", "--resume", str(run), "--quiet")
    assert (quiet.exit_code, quiet.stderr) == (code, "")
    assert quiet.stdout.startswith(expected)
    assert "nothing" not in quiet.stdout
    assert held(run) == before


def test_a_step_that_did_not_converge_is_not_tried_again(run: Path) -> None:
    """It was killed between that step and the end of the run; the same step would fail the same way."""

    def change(summary: dict[str, Any]) -> None:
        del summary["steps"][3:]
        ended_ill(summary)
        summary["complete"] = False

    forge(run, change)
    done = call("run", "--resume", str(run), "--no-render")
    assert done.exit_code == 3
    assert "NOT CONVERGED: load step 2 (load 1/3): no equilibrium" in done.stdout
    saved = read_run(run)
    assert saved.complete
    assert [step.converged for step in saved.steps] == [True, True, False]
    assert not (run / "step_0003.vtu").exists()


def begun_with(key: str, value: str) -> Callable[[dict[str, Any]], None]:
    def change(summary: dict[str, Any]) -> None:
        summary["provenance"][key] = value
        summary["complete"] = False

    return change


def asked(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(summary: dict[str, Any]) -> None:
        summary["settings"][key] = value
        summary["complete"] = False

    return change


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (begun_with("numpy", "1.0"), "this run was begun with numpy 1.0, and here it is "),
        (begun_with("scipy", "1.0"), "this run was begun with scipy 1.0, and here it is "),
        (begun_with("arch", "cuda"), "this run was begun with arch cuda, and here it is "),
        (begun_with("precision", "f32"), "this run was begun with precision f32, and here it is f64: "),
        (asked("precision", "f16"), "precision = 'f16' is not one of f64, f32"),
        (asked("threads", "many"), "summary.json: damaged: ValueError: invalid literal for int()"),
        (lambda summary: summary.update(format="other"), "not the summary of a run of this program"),
        (lambda summary: summary.update(format_version=1), "format version 1, but this program reads version 9"),
    ],
)
def test_what_cannot_go_on_bit_by_bit_is_refused_and_left_alone(
    run: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Any], None], expected: str
) -> None:
    forge(run, change)
    monkeypatch.setattr(runtime, "_started", None if "f16" in expected else runtime._started)
    before = held(run)
    done = call("run", "--resume", str(run))
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr.count("error:") == 1
    assert expected in done.stderr.splitlines()[-1]
    assert held(run) == before


@pytest.mark.parametrize("name", ["summary.json", "mesh.vtu", "step_0004.vtu"])
def test_a_damaged_file_is_refused_and_everything_left_alone(run: Path, name: str) -> None:
    forge(run, lambda summary: summary.update(complete=False))
    content = bytearray((run / name).read_bytes())
    content[len(content) // 2] ^= 1
    (run / name).write_bytes(content)
    before = held(run)
    done = call("run", "--resume", str(run))
    assert done.exit_code == 2
    assert done.stderr.splitlines()[-1].startswith(f"error: {run / name}: damaged")
    assert held(run) == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--set", "stages.load.steps=9", "beam"], "leave out SCENE, --set"),
        (["--precision", "f64", "--arch", "cpu", "--threads", "2"], "leave out --arch, --precision, --threads"),
        (["--out", "elsewhere"], "leave out --out"),
    ],
)
def test_resume_takes_no_scene_and_no_settings(run: Path, arguments: list[str], expected: str) -> None:
    done = call("run", "--resume", str(run), *arguments)
    told = f"error: --resume {run}: scene and settings are those of the run in that folder; {expected}\n"
    assert (done.exit_code, done.stdout, done.stderr) == (2, "", told)


@pytest.mark.parametrize(("options", "drawn"), [((), False), (("--render",), True), (("--no-render",), False)])
def test_pictures_are_drawn_as_the_run_was_begun_unless_asked_anew(
    run: Path, options: tuple[str, ...], drawn: bool
) -> None:
    """The run was begun without; and what a resume is asked for holds for the next one."""

    def stopped(summary: dict[str, Any]) -> None:
        summary["complete"] = False
        del summary["steps"][4:]

    forge(run, stopped)
    for arguments in (options, ()):
        assert call("run", "--resume", str(run), *arguments).exit_code == 0
        assert (run / "step_0004.png").exists() == drawn
        assert (run / "curve.png").exists() == drawn
        forge(run, stopped)


def test_ctrl_c_counts_the_steps_that_were_there_before(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(directory: Path, *, render: bool | None, observer: Observer) -> None:
        observer.kept(read_run(directory).steps)
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["taichi_membrane.execution.run"], "resume", interrupted)
    done = call("run", "--resume", str(run))
    assert (done.exit_code, done.stdout) == (130, "")
    assert done.stderr == f"5 of 5 load steps are there already\ninterrupted: 5 load steps are kept in {run}\n"


@pytest.mark.parametrize("way", ["arc length", "shut chamber"])
def test_a_path_and_a_shut_chamber_go_on_from_within(
    scene: str, tmp_path: Path, runtime_cpu: Runtime, way: str
) -> None:
    changes = {
        "arc length": ("stages.load.control=arc_length", *NO_MOTION),
        "shut chamber": (
            "stages.load.closed=['inside']",
            "pressures={inside = {ambient = 0.1}}",
            "mesh.cap_start=flat",
        ),
    }[way]
    settings = (*(f"--set={one}" for one in changes), "--no-render")
    assert call("run", scene, *settings, "--out", "run").exit_code == 0
    whole = outcome(tmp_path / "run")
    assert (read_run(tmp_path / "run").steps[3].solver == "arc length") == (way == "arc length")
    assert (read_run(tmp_path / "run").steps[3].pressures["inside"] != 0.03) == (way == "shut chamber")

    for kept in (2, 3, 4):

        def stopped(summary: dict[str, Any], kept: int = kept) -> None:
            summary["complete"] = False
            del summary["steps"][kept:]

        forge(tmp_path / "run", stopped)
        done = call("run", "--resume", "run", "--no-render")
        assert done.exit_code == 0
        assert f"{kept} of 5 load steps are there already" in done.stderr
        assert not different(outcome(tmp_path / "run"), whole), kept
