"""Runs of several threads take turns: the same bits as one after another, and one within another is refused."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import taichi_membrane as tm
from taichi_membrane.execution.observer import Silent
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import StepResult

ROOT = Path(__file__).resolve().parent.parent


def sheet(cells: int, solver: str) -> Scene:
    """A square sheet blown up: the meshes differ, and so do the kernels of the two solvers."""
    return Scene.model_validate(
        {
            "name": f"sheet_{cells}",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": cells, "along_y": cells},
            "fabric": {"E": 1e5, "nu": 0.3, "thickness": 0.01},
            "supports": [{"group": "boundary", "hold": "xyz"}],
            "stages": [{"name": "inflate", "pressure": 20.0, "steps": 2}],
            "solver": {"kind": solver},
        }
    )


# In a process of its own, where no test has started Taichi in the main thread before.
THREADS = """
import sys, threading
import numpy as np
from test_threads import sheet
import taichi_membrane as tm
scenes = [sheet(cells, solver) for cells, solver in ((4, "hybrid"), (5, "relaxation"), (4, "hybrid"), (6, "hybrid"))]
scenes = scenes[: int(sys.argv[1])]
found, at_once = {}, threading.Barrier(len(scenes))
def work(number):
    at_once.wait()
    found[number] = tm.run(scenes[number])
workers = [threading.Thread(target=work, args=(number,)) for number in range(len(scenes))]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
for number, scene in enumerate(scenes):
    alone = tm.run(scene)  # from the main thread, one after another
    assert alone.converged
    for one, other in zip(found[number].steps, alone.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement) and one.energy == other.energy, number
print("the same")
"""


def process(program: str, *arguments: str) -> subprocess.Popen[str]:
    path = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments], env={**os.environ, "PYTHONPATH": path}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@pytest.mark.parametrize("count", [2, 4])
def test_threads_get_the_bits_of_runs_one_after_another(count: int) -> None:
    with process(THREADS, str(count)) as work:
        said, complaints = work.communicate(timeout=300)
    assert (work.returncode, said) == (0, "the same\n"), complaints


INTERRUPTED = """
import os, signal, sys, threading
from pathlib import Path
from test_threads import sheet
import taichi_membrane as tm
from taichi_membrane.execution.observer import Silent
worker = threading.Thread(target=lambda: tm.run(sheet(3, "relaxation")))
worker.start()
worker.join()
class Told(Silent):
    steps = 0
    def step_done(self, step):
        self.steps += 1
        os.kill(os.getpid(), signal.SIGINT)
        told.wait(10)  # until the main thread has asked for an end
told, heard = threading.Event(), Told()
from taichi_membrane.execution import observer
stop = observer.Clock.stop
observer.Clock.stop = lambda clock: (stop(clock), told.set())
try:
    tm.run(sheet(3, "relaxation"), out=Path(sys.argv[1]), render=False, observer=heard)
except KeyboardInterrupt:
    from taichi_membrane.output.reader import read_run
    saved = read_run(Path(sys.argv[1]))
    print(heard.steps, len(saved.steps), saved.complete, tm.run(sheet(3, "relaxation")).converged)
"""


def test_ctrl_c_reaches_a_run_in_another_thread(tmp_path: Path) -> None:
    """It ends before its next step; what it had is kept, and the next one's turn comes."""
    with process(INTERRUPTED, str(tmp_path / "out")) as work:
        said, complaints = work.communicate(timeout=300)
    assert (work.returncode, said) == (0, "1 1 False True\n"), complaints


@pytest.mark.usefixtures("runtime_cpu")
def test_a_run_within_a_run_is_refused_and_the_outer_one_goes_on(tmp_path: Path) -> None:
    class Nested(Silent):
        def __init__(self) -> None:
            self.refused: list[str] = []

        def step_done(self, step: StepResult) -> None:
            for start in (
                lambda: tm.run(sheet(3, "relaxation")),
                lambda: tm.run(sheet(3, "relaxation"), out=tmp_path / "out"),
                lambda: tm.resume(tmp_path / "out"),
            ):
                with pytest.raises(tm.InputError) as caught:
                    start()
                self.refused.append(str(caught.value))

    nested = Nested()
    result = tm.run(sheet(3, "relaxation"), out=tmp_path / "out", render=False, observer=nested)
    assert result.converged
    assert len(nested.refused) == 6
    assert all(told.startswith("a run cannot start another one, say from its observer") for told in nested.refused)


@pytest.mark.usefixtures("runtime_cpu")
def test_where_this_thread_holds_taichi_another_one_is_told_so() -> None:
    """And nothing of Taichi is broken by it."""
    refused: list[str] = []

    def work() -> None:
        with pytest.raises(tm.InputError) as caught:
            tm.run(sheet(3, "relaxation"))
        refused.append(str(caught.value))

    worker = threading.Thread(target=work, name="worker")
    worker.start()
    worker.join()
    assert "Taichi was started by the thread 'MainThread' of this process and works in no other one" in refused[0]
    assert tm.run(sheet(3, "relaxation")).converged
