"""Studies: processes and restart, with a stand-in for the solver; a real study of a small sphere."""

from __future__ import annotations

import csv
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.study import runner
from taichi_membrane.study.plan import Plan, build_plan
from taichi_membrane.study.runner import Run, run_all

ROOT = Path(__file__).resolve().parent.parent
SPHERE = ROOT / "scenes" / "sphere.toml"
STAND_IN = """
import json, os, pathlib, sys, time
folder, log, behaviour = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
with log.open("a") as file:
    file.write(f"{os.getpid()}\\n")
if behaviour == "refuse":
    print("error: cache", os.environ["TI_OFFLINE_CACHE"], file=sys.stderr)
    sys.exit(2)
if behaviour == "crash":
    print("Traceback", "boom", sep="\\n", file=sys.stderr)
    sys.exit(1)
if behaviour == "hang":
    time.sleep(20)
fails = behaviour == "fail"
step = {"stage": "large", "stage_step": 4, "probes": {"radius": 7.0, "volume": None}, "residual": 1e-8, "iterations": 5,
        "converged": not fails, "reason": "iteration limit" if fails else "residual"}
first = dict(step, stage="small", stage_step=1, probes={"radius": 3.0})
folder.mkdir(parents=True)
summary = {"complete": True, "converged": not fails, "steps": [first, step], "seconds": {"setup": 1.0, "solve": 2.0}}
(folder / "summary.json").write_text(json.dumps(summary))
sys.exit(3 if fails else 1)  # 1: a check of the scene does not hold, which is no matter here
"""


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Replaces the solver by a script; returns a function that sets its behaviours, case by case, and returns its processes."""
    script, log = tmp_path / "stand_in.py", tmp_path / "log"
    script.write_text(STAND_IN)
    log.touch()
    behaviours: list[str] = []

    def command(case: object, folder: Path) -> list[str]:
        return [sys.executable, "-S", str(script), str(folder), str(log), behaviours.pop(0) if behaviours else "work"]

    monkeypatch.setattr(runner, "command", command)

    def processes(*following: str) -> list[str]:
        behaviours[:] = following
        return log.read_text().split()

    return processes


def sphere_plan(at: str | None = None, *fixed: str) -> Plan:
    return build_plan(SPHERE, ["mesh.divisions=2,3", "precision=f64,f32"], probes=["radius"], at=at, fixed=fixed)


def test_of_a_stage_that_ends_early_the_last_step_done_is_measured(
    tmp_path: Path, stand_in: Callable[..., list[str]]
) -> None:
    """The stand-in does 4 steps of the stage; the scene allows 6 up to collapse."""
    early = ("stages.large.steps=6", "stages.large.until=collapse", "checks=[]")
    assert [run.probes for run in run_all(sphere_plan(None, *early), tmp_path / "a")] == [{"radius": 7.0}] * 4
    assert [run.probes for run in run_all(sphere_plan("large:6", *early), tmp_path / "b")] == [{}] * 4
    assert [run.probes for run in run_all(sphere_plan(None, *early[::2]), tmp_path / "c")] == [{}] * 4


def test_restart_runs_only_what_is_missing(tmp_path: Path, stand_in: Callable[..., list[str]]) -> None:
    out, heard = tmp_path / "out", []
    first = run_all(sphere_plan(), out)
    assert len(stand_in()) == 4
    again = run_all(sphere_plan(), out, told=lambda run, reused: heard.append(reused))
    assert (len(stand_in()), heard) == (4, [True] * 4)
    assert [run.probes for run in again] == [run.probes for run in first] == [{"radius": 7.0}] * 4
    earlier = run_all(sphere_plan("small:-1"), out)  # another load step of the same runs
    assert ([run.probes["radius"] for run in earlier], len(stand_in())) == ([3.0] * 4, 4)
    run_all(sphere_plan(None, "fabric.nu=0.2"), out)  # other settings
    assert len(stand_in()) == 8
    record = out / runner.RUNS / f"{first[0].case.identity}.json"
    record.write_text(record.read_text().replace(first[0].case.fingerprint, "of another version"))
    (out / runner.RUNS / first[1].case.identity / "summary.json").write_text("{")
    run_all(sphere_plan(), out, jobs=2)
    assert len(stand_in()) == 10


def test_every_end_of_a_process_is_told(tmp_path: Path, stand_in: Callable[..., list[str]]) -> None:
    stand_in("fail", "refuse", "crash", "hang")
    runs = run_all(sphere_plan(), tmp_path / "out", budget=1.0)
    assert [run.status for run in runs] == ["not converged", "refused", "crashed", "over budget"]
    told = ["large 4: iteration limit", "error: cache 0", "exit code 1: boom", "ended after 1 s"]
    assert [run.reason for run in runs] == told
    assert [run.probes for run in runs] == [{}] * 4
    assert runs[0].iterations == 10
    assert runs[0].peak_memory > 1.0  # MiB; a Python process takes more, and a wrong unit would give 1/1000 of it
    # What ended for a reason that may be gone is tried again, and what ran out of time once it is given more.
    assert [run.status for run in run_all(sphere_plan(), tmp_path / "out", budget=1.0)][1:3] == ["converged"] * 2
    assert len(stand_in()) == 6
    assert run_all(sphere_plan(), tmp_path / "out", budget=30.0)[3].status == "converged"
    assert len(stand_in()) == 7


def test_what_a_crash_leaves_is_no_result(tmp_path: Path, stand_in: Callable[..., list[str]]) -> None:
    (case,) = (plan := build_plan(SPHERE, ["precision=f64"])).cases
    run_all(plan, tmp_path / "out")
    (tmp_path / "out" / runner.RUNS / f"{case.identity}.json").unlink()
    stand_in("crash")
    assert run_all(plan, tmp_path / "out")[0].status == "crashed"  # and not the summary of the run before


def test_interrupting_leaves_no_process_behind(tmp_path: Path, stand_in: Callable[..., list[str]]) -> None:
    stand_in("work", "hang", "hang")

    def interrupt(run: Run, reused: bool) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_all(sphere_plan(), tmp_path / "out", jobs=2, told=interrupt)
    assert (
        len(list((tmp_path / "out" / runner.RUNS).glob("*/summary.json"))) == 1
    )  # the others were ended, not waited for
    for process in stand_in():
        with pytest.raises(ProcessLookupError):
            os.kill(int(process), 0)


def test_study_of_a_sphere(tmp_path: Path) -> None:
    arguments = [
        *("study", str(SPHERE), "--vary", "mesh.divisions=2,3,4", "--set", "solver.kind=relaxation"),
        *("--set", "stages.large.steps=1", "--set", "threads=1", "--out", str(tmp_path), "--jobs", "2"),
    ]
    result = CliRunner().invoke(app, [*arguments, "--reference", "check"])
    assert result.exit_code == 0, result.output
    assert "[3/3]" in result.stderr
    with (tmp_path / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["triangles"], row["probe"]) for row in rows] == [("32", "radius"), ("72", "radius"), ("128", "radius")]
    errors = [float(row["error"]) for row in rows]
    assert errors == [abs(float(row["value"]) - 110.0) / 110.0 for row in rows]
    # The radius of nodes on a coarse octahedron: within 3 % (h/R is 0.8 on the coarsest), and better on each finer mesh.
    assert 0.03 > errors[0] > errors[1] > errors[2] > 0
    assert all(float(row["peak_memory_MiB"]) > 50 and float(row["compile_s"]) > 0 for row in rows)
    assert {row["threads"] for row in rows} == {"1"}
    with Image.open(tmp_path / "study.png") as picture:
        assert picture.size[0] > 1000
    again = CliRunner().invoke(app, [*arguments, "--reference", "extrapolated", "--at", "small:1"])
    assert again.exit_code == 0, again.output
    assert again.stderr.count("(done before)") == 3
    assert "Richardson on the three finest meshes: order" in again.stdout


def test_study_with_a_run_that_fails(tmp_path: Path) -> None:
    arguments = ["--vary", "solver.max_iterations=1", "--set", "solver.kind=relaxation", "--set", "solver.max_cuts=0"]
    result = CliRunner().invoke(
        app, ["study", str(SPHERE), *arguments, "--set", "mesh.divisions=2", "--out", str(tmp_path)]
    )
    assert result.exit_code == 3, result.output
    assert "NOT CONVERGED: small 1:" in result.stderr
    assert json.loads((tmp_path / "study.json").read_text())["measurements"][0]["value"] is None
