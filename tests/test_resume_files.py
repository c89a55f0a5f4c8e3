"""Files of a run that is stopped at any system call, or meets a full disk, and is then gone on with: no engine is needed."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from run_files import FABRIC, MESH, PROVENANCE, SCENE, SETTINGS, a_result, a_run, a_step, different, outcome

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.output import atomic
from taichi_membrane.output.reader import read_run
from taichi_membrane.output.writer import Writer

STEPS = [a_step(0), a_step(1), a_step(2, residual=float("nan"), converged=False)]


def go_on(directory: Path) -> int:
    """What a resume does to the files; how many load steps were there already."""
    saved = read_run(directory)
    writer = Writer(directory, SCENE, MESH, settings=SETTINGS, provenance=PROVENANCE, tri_fabric=FABRIC, saved=saved)
    for step in STEPS[len(saved.steps) :]:
        writer.write_step(step, {"solve": 1.0})
    writer.finish(a_result(STEPS, directory))
    return len(saved.steps)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing here loses power, so nobody need wait for the disk."""
    monkeypatch.setattr(os, "fsync", lambda _: None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The outcome of a run that nothing stopped."""
    directory = tmp_path_factory.mktemp("whole")
    a_run(directory, STEPS)
    return outcome(directory)


def stop_at(number: int, how: Callable[[], Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes system calls that do ``how`` instead at call ``number``, counted over all of them."""
    calls = []

    def around(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            calls.append(real)
            return how() if len(calls) == number + 1 else real(*arguments)

        return call

    return around


def full() -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


# A write makes three calls: the file to the disk, its new name, the folder to the disk. A run writes the mesh, a first summary
# within it, two tables, then four files for each step, two tables and the summary.
CALLS = 3 * (1 + 1 + 2 + 4 * len(STEPS) + 3)


def test_a_full_disk_at_any_write_is_told_and_spoils_nothing(
    tmp_path: Path, whole: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    met = []
    for number in range(CALLS):
        directory = tmp_path / str(number)
        patch = stop_at(number, full)
        with monkeypatch.context() as patched:
            for name in ("fsync", "replace"):
                patched.setattr(atomic.os, name, patch(getattr(os, name)))
            with pytest.raises(InputError, match=r"cannot be written: No space left on device$"):
                a_run(directory, STEPS)
        assert not list(directory.glob(".*"))
        if not (directory / "mesh.vtu").exists():
            a_run(directory, STEPS)  # nothing was begun, and the folder is not locked
        else:
            met.append(go_on(directory))
        assert not different(outcome(directory), whole), number
    assert set(met) == {0, 1, 2, 3}


def test_a_kill_at_any_system_call_is_made_good(tmp_path: Path, whole: dict[str, Any]) -> None:
    """Each in a process of its own that ends on the spot, as by SIGKILL."""
    script = """
import os, sys
from pathlib import Path
from run_files import a_run
from test_resume_files import CALLS, STEPS, stop_at
from taichi_membrane.output import atomic
os.fsync = lambda _: None
for number in range(CALLS):
    child = os.fork()
    if not child:
        around = stop_at(number, lambda: os._exit(9))
        atomic.os.fsync, atomic.os.replace = around(os.fsync), around(os.replace)
        a_run(Path(sys.argv[1]) / str(number), STEPS)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9, number
"""
    tests = Path(__file__).resolve().parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tests), str(tests.parent)))}
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], env=environment, check=True)
    met = []
    for number in range(CALLS):
        directory = tmp_path / str(number)
        try:
            met.append(go_on(directory))
        except InputError:  # not even begun
            assert not (directory / "mesh.vtu").exists()
            a_run(directory, STEPS)
        assert not different(outcome(directory), whole), number
    assert met == sorted(met)
    assert set(met) == {0, 1, 2, 3}


def test_a_run_killed_while_it_replaces_an_earlier_one_is_never_a_mixture(
    tmp_path: Path, whole: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    earlier = tmp_path / "earlier"
    larger = Mesh.build(2.0 * MESH.points, MESH.triangles)
    writer = Writer(earlier, SCENE, larger, settings=SETTINGS, provenance=PROVENANCE, tri_fabric=FABRIC)
    writer.write_step(a_step(0), {})
    writer.finish(a_result([a_step(0)], earlier))
    for number in range(12):  # up to the tables
        directory = tmp_path / str(number)
        shutil.copytree(earlier, directory)
        patch = stop_at(number, full)
        with monkeypatch.context() as patched:
            for name in ("fsync", "replace"):
                patched.setattr(atomic.os, name, patch(getattr(os, name)))
            with pytest.raises(InputError, match="No space left"):
                a_run(directory, STEPS)
        if number < 2:
            assert not different(outcome(directory), outcome(earlier))
        elif number < 5:  # the summary is new, its mesh not in place yet
            with pytest.raises(InputError, match=r"mesh\.vtu: damaged or changed"):
                read_run(directory)
        else:
            assert go_on(directory) == 0
            assert not different(outcome(directory), whole)


def test_what_a_stopped_run_left_beside_its_steps_goes(tmp_path: Path, whole: dict[str, Any]) -> None:
    """Pictures of half a run, a step that the summary does not know, a table with its row, temporary files."""
    writer = Writer(tmp_path, SCENE, MESH, settings=SETTINGS, provenance=PROVENANCE, tri_fabric=FABRIC)
    writer.write_step(STEPS[0], {})
    (tmp_path / "history.csv").write_text("half a table", "utf-8")
    for name in ("step_0000.png", "step_0001.vtu", "curve.png", ".step_0001.vtu.77.tmp"):
        (tmp_path / name).touch()
    (tmp_path / "notes.txt").touch()
    assert go_on(tmp_path) == 1
    (tmp_path / "notes.txt").unlink()
    assert not different(outcome(tmp_path), whole)
