"""Sweeps that run: workers that die, restart, two on one folder, and the same bits whoever computes them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from parametric_cases import tube

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.output.lock import sole_writer
from taichi_membrane.parametric import pool
from taichi_membrane.parametric.plan import SweepPlan, build_sweep
from taichi_membrane.parametric.pool import LocalPool
from taichi_membrane.parametric.sweep import run_sweep
from taichi_membrane.parametric.task import packed

STAND_IN = """
import json, os, pathlib, sys, time
log = pathlib.Path(sys.argv[1])
for line in sys.stdin:
    radius = json.loads(line)["scene"]["mesh"]["radius"]
    with log.open("a") as file:
        file.write(f"{radius} {os.getpid()}\\n")
    tries = sum(entry.startswith(f"{radius} ") for entry in log.read_text().split("\\n"))
    if radius == 66.0 or (radius == 26.0 and tries == 1):
        print("out of luck", file=sys.stderr, flush=True)
        os.kill(os.getpid(), 9)
    if radius == 99.0:
        time.sleep(60)
    answer = {"outcome": "finished", "probes": {"deflection": radius, "root": 6.0}, "passed": True}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replaces workers by a script; the file it logs every request in."""
    script, log = tmp_path / "stand_in.py", tmp_path / "log"
    script.write_text(STAND_IN)
    log.touch()
    monkeypatch.setattr(pool, "COMMAND", (sys.executable, "-S", str(script), str(log)))
    return log


def plan_of(folder: Path, radii: str) -> SweepPlan:
    return build_sweep(tube(folder), vary=[f"mesh.radius={radii}"])


def test_a_dead_worker_costs_a_retry_and_not_the_pool(tmp_path: Path, asked: Path) -> None:
    table = run_sweep(plan_of(tmp_path, "25,26,27,66"), jobs=2)
    assert [row.outcome for row in table.rows] == ["finished"] * 3 + ["crashed"]
    assert [row.attempts for row in table.rows] == [1, 2, 1, 3]
    assert "out of luck" in table.rows[3].reason
    assert "-9" in table.rows[3].reason
    assert table.values("deflection") == [25.0, 26.0, 27.0, None]


def test_workers_are_kept(tmp_path: Path, asked: Path) -> None:
    run_sweep(plan_of(tmp_path, "20:24:5"), jobs=1)
    assert len({line.split()[1] for line in asked.read_text().splitlines()}) == 1
    plan = plan_of(tmp_path, "20:24:5")
    with LocalPool(jobs=1, fresh=True) as workers:
        assert (
            len(list(workers.answers(plan.trials, lambda t: packed(t, plan.base, plan.conditions, send_mesh=False))))
            == 5
        )
    assert len({line.split()[1] for line in asked.read_text().splitlines()}) == 6


def test_the_largest_mesh_goes_first(tmp_path: Path, asked: Path) -> None:
    plan = build_sweep(tube(tmp_path), vary=["mesh.around+mesh.radius=8:20,12:21,10:22"])
    run_sweep(plan, jobs=1)
    assert [line.split()[0] for line in asked.read_text().splitlines()] == ["21.0", "22.0", "20.0"]


def test_restart_does_only_the_rest(tmp_path: Path, asked: Path) -> None:
    out = tmp_path / "out"
    run_sweep(plan_of(tmp_path, "25,66"), out=out, jobs=1)
    asked.write_text("")
    again = run_sweep(plan_of(tmp_path, "25,27,66"), out=out, jobs=1)
    assert {line.split()[0] for line in asked.read_text().splitlines()} == {
        "27.0",
        "66.0",
    }  # what crashed is tried again
    assert again.values("deflection") == [25.0, 27.0, None]
    with (out / "rows.jsonl").open("a") as file:
        file.write('{"fingerprint": "cut off by a ki')
    asked.write_text("")
    run_sweep(plan_of(tmp_path, "25,27,28"), out=out, jobs=1)
    assert {line.split()[0] for line in asked.read_text().splitlines()} == {"28.0"}
    assert [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()][-1]["answer"]["probes"][
        "deflection"
    ] == 28.0
    other = build_sweep(tube(tmp_path), vary=["mesh.radius=25,27"], fixed=["name=other"])
    with pytest.raises(InputError, match="is of scene 'stub'"):
        run_sweep(other, out=out)


def test_the_second_sweep_on_a_folder_is_refused(tmp_path: Path, asked: Path) -> None:
    out = tmp_path / "out"
    with sole_writer(out), pytest.raises(InputError, match=f"process {os.getpid()}"):
        run_sweep(plan_of(tmp_path, "25,27"), out=out)


def test_what_arrived_is_kept_when_it_is_interrupted(tmp_path: Path, asked: Path) -> None:
    """A real interrupt: the process that sweeps gets SIGINT while a worker is busy, and leaves none behind."""
    out = tmp_path / "out"
    program = (
        f"import sys; sys.path[:0] = {sys.path!r}\n"
        "from pathlib import Path\n"
        "from taichi_membrane.parametric import pool\n"
        "from taichi_membrane.parametric.plan import build_sweep\n"
        "from taichi_membrane.parametric.sweep import run_sweep\n"
        f"pool.COMMAND = {pool.COMMAND!r}\n"
        f"plan = build_sweep(Path({str(tube(tmp_path))!r}), vary=['mesh.radius=25,99,27'])\n"
        f"run_sweep(plan, out=Path({str(out)!r}), jobs=1)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE)
    deadline = time.monotonic() + 60.0  # of a failing test only
    while "99.0" not in asked.read_text():
        assert time.monotonic() < deadline, "the second trial never began"
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, words = process.communicate(timeout=60.0)
    assert b"KeyboardInterrupt" in words
    worker = int(asked.read_text().split()[-1])
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert [row["run"] for row in json.loads((out / "sweep.json").read_text())["rows"]] == [1]
    assert not (out / ".lock").exists()


def test_kept_and_fresh_processes_give_the_same_bits(tmp_path: Path) -> None:
    """Real runs: larger and smaller meshes on one kept worker; then the last of them in a process of its own."""
    vary = {"mesh.around": [10, 8], "fabric.nu": [0.1, 0.3, 7.0]}
    with pytest.raises(InputError, match="not positive definite"):  # told before anything runs
        tm.sweep(tube(tmp_path), vary, progress=False)
    plan = build_sweep(tube(tmp_path), vary=["mesh.around=10,8", "fabric.nu=0.1,0.3"])
    kept = run_sweep(plan, jobs=1, out=tmp_path / "out", files=True)
    assert [row.outcome for row in kept.rows] == ["finished"] * 4
    assert len({row.worker for row in kept.rows}) == 1
    assert (tmp_path / "out" / "runs" / "3" / "summary.json").is_file()
    for row in kept.rows:
        assert row.probes["root"] == pytest.approx(6.0, rel=1e-4)  # equilibrium, to some times the tolerance of 1e-6
        assert row.curve is not None
        assert row.curve[0][-1] == -row.probes["deflection"]  # type: ignore[operator]
    last = plan.trials[3]
    with LocalPool(jobs=1, fresh=True) as workers:
        ((_, fresh),) = workers.answers([last], lambda t: packed(t, plan.base, plan.conditions, send_mesh=True))
    assert fresh["probes"] == kept.rows[3].probes
    assert fresh["steps"] == kept.rows[3].steps


def test_a_table_as_a_data_frame(tmp_path: Path, asked: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = tm.sweep(
        tube(tmp_path), {"mesh.radius": [25, 27.5]}, tie={"mesh.length": "4*mesh.radius"}, progress=False
    ).to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame["deflection [mm]"]) == [25.0, 27.5]
    assert list(frame["mesh.length"]) == [100.0, 110.0]
