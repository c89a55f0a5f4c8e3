"""Sweeps on a Dask cluster: a real scheduler and workers on the loopback, one of them killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from parametric_cases import tube

from taichi_membrane.errors import InputError
from taichi_membrane.parametric import cluster
from taichi_membrane.parametric.plan import build_sweep
from taichi_membrane.parametric.rows import Row
from taichi_membrane.parametric.sweep import run_sweep

pytest.importorskip("distributed", reason="Dask distributed is not installed (extra 'cluster')")
pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parent.parent


@contextmanager
def dask(*arguments: str, imports: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """A ``dask`` command in a session of its own, ended with all its children."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    program = [sys.executable, "-m", "dask"]
    if not imports:  # a worker on a machine where this package is not installed
        hide = "import sys; sys.modules['taichi_membrane'] = None; from dask.__main__ import main; main()"
        program = [sys.executable, "-c", hide]
    process = subprocess.Popen(
        [*program, *arguments],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """Address of a scheduler without workers."""
    file = tmp_path / "scheduler.json"
    with dask(
        "scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", ":0", "--scheduler-file", str(file)
    ):
        deadline = time.monotonic() + 60.0  # of a failing test only
        while not file.exists() or '"address"' not in file.read_text():
            assert time.monotonic() < deadline, "the scheduler never came up"
            time.sleep(0.1)
        import json

        yield json.loads(file.read_text())["address"]


def worker(address: str, folder: Path, **how: bool) -> object:
    options = ("--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder))
    return dask("worker", address, *options, **how)


def test_a_killed_worker_loses_no_row_and_no_bit(tmp_path: Path, scheduler: str) -> None:
    plan = build_sweep(tube(tmp_path), vary=["fabric.E_warp=3600:4400:12"])
    local = run_sweep(plan, jobs=1)
    killed: list[int] = []

    with worker(scheduler, tmp_path), worker(scheduler, tmp_path):

        def told(row: Row, done: int, total: int, remaining: float) -> None:
            if done == 3:
                killed.append(int(row.worker.rpartition(":")[2]))
                os.kill(killed[0], signal.SIGKILL)

        found = run_sweep(plan, cluster=scheduler, out=tmp_path / "out", files=True, told=told)
    assert killed
    assert found.complete
    assert [row.outcome for row in found.rows] == ["finished"] * 12
    assert [row.steps for row in found.rows] == [row.steps for row in local.rows]
    assert (tmp_path / "out" / "runs" / "12" / "summary.json").is_file()


def test_no_worker_and_workers_that_cannot_work_end_with_a_message(
    tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = build_sweep(tube(tmp_path), vary=["fabric.nu=0.1,0.2"])
    monkeypatch.setattr(cluster, "NO_WORKER", 3.0)
    with pytest.raises(InputError, match="has no worker after 3 s"):
        run_sweep(plan, cluster=scheduler)
    monkeypatch.setattr(cluster, "NO_WORKER", 60.0)
    with worker(scheduler, tmp_path, imports=False), pytest.raises(InputError, match="cannot import taichi_membrane"):
        run_sweep(plan, cluster=scheduler)


def test_no_scheduler_ends_with_a_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "NO_WORKER", 2.0)
    with pytest.raises(InputError, match="no scheduler answers there"):
        run_sweep(build_sweep(tube(tmp_path), vary=["fabric.nu=0.1,0.2"]), cluster="tcp://127.0.0.1:9")
