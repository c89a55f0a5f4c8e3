"""Two processes never write in one folder: the second is told who does, and a lock dies with its process."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys
import types
from pathlib import Path

import pytest
from run_files import a_run, a_step
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.output import lock
from taichi_membrane.output.lock import LOCK, sole_writer
from taichi_membrane.output.writer import check_directory

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(params=["posix", "windows"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """This system; and the calls that Windows is asked for, by a module that stands for its own."""
    if request.param == "windows":

        def locking(descriptor: int, mode: int, count: int) -> None:
            assert (mode, count) == (2, 1)
            assert os.lseek(descriptor, 0, os.SEEK_CUR) > 32, "Windows would keep others from reading the number"
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise OSError(errno.EACCES, "Permission denied") from error

        monkeypatch.setitem(sys.modules, "msvcrt", types.SimpleNamespace(locking=locking, LK_NBLCK=2))
        monkeypatch.setattr(lock, "sys", types.SimpleNamespace(platform="win32"))
    return str(request.param)


@pytest.mark.usefixtures("system")
def test_the_second_is_told_folder_and_process_and_comes_in_later(tmp_path: Path) -> None:
    with sole_writer(tmp_path):
        assert (tmp_path / LOCK).read_text() == str(os.getpid())
        expected = rf"{tmp_path}: another run writes in this folder \(process {os.getpid()}\)"
        for _ in range(2):  # being refused does not take the lock from its holder
            with pytest.raises(InputError, match=expected), sole_writer(tmp_path):
                raise AssertionError("two are in")
    assert not list(tmp_path.iterdir())
    with sole_writer(tmp_path):
        pass


def test_a_lock_dies_with_its_process(tmp_path: Path) -> None:
    program = (
        "import sys, time\nfrom pathlib import Path\nfrom taichi_membrane.output.lock import sole_writer\n"
        "with sole_writer(Path(sys.argv[1])):\n    print('in', flush=True)\n    time.sleep(60)\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "in\n"
        with pytest.raises(InputError, match=f"process {process.pid}"), sole_writer(tmp_path):
            raise AssertionError("two are in")
        process.kill()
        assert process.wait() == -signal.SIGKILL
    assert (tmp_path / LOCK).exists()
    check_directory(tmp_path)  # what is left makes no foreign folder of it
    with sole_writer(tmp_path):
        assert (tmp_path / LOCK).read_text() == str(os.getpid())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["run", "resume"])
def test_a_run_where_another_one_writes_ends_with_2_and_leaves_all_alone(command: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    a_run(out, [a_step(0)])
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    arguments = ["--resume", str(out)] if command == "resume" else ["sphere", "--out", str(out)]
    with sole_writer(out):
        done = CliRunner().invoke(app, ["run", *arguments])
        assert done.exit_code == 2, done.output
        (line,) = done.stderr.splitlines()
        assert f"{out}: another run writes in this folder (process {os.getpid()})" in line
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_folder_made_for_nothing_is_gone_again(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing works"), sole_writer(tmp_path / "new" / "run"):
        raise InputError("nothing works")
    assert not list(tmp_path.iterdir())
    with sole_writer(tmp_path / "new" / "run"):
        (tmp_path / "new" / "file").touch()
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["file"]


def test_a_file_removed_by_its_last_holder_is_not_mistaken_for_the_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between opening the file and locking it its holder may end, and another one begin."""
    taken, flock = [], fcntl.flock

    def late(descriptor: int, how: int) -> None:
        if not taken:
            (tmp_path / LOCK).unlink()
        taken.append(descriptor)
        flock(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with sole_writer(tmp_path):
        assert len(taken) == 2
        with pytest.raises(InputError, match="another run writes"), sole_writer(tmp_path):
            raise AssertionError("two are in")


def test_a_file_system_without_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(descriptor: int, how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    expected = r"cannot be locked against others \(No locks available\)"
    with pytest.raises(InputError, match=expected), sole_writer(tmp_path):
        raise AssertionError("it is not locked")


def test_a_second_study_in_a_folder_ends_with_2_and_leaves_all_alone(tmp_path: Path) -> None:
    """It would take the runs of the first, which are not done, for left-overs and remove them."""
    out = tmp_path / "study"
    half = out / "runs" / "case"
    half.mkdir(parents=True)
    (half / "summary.json").write_text("half a run", "utf-8")
    program = (
        "import sys\nfrom pathlib import Path\nfrom taichi_membrane.output.lock import sole_writer\n"
        "with sole_writer(Path(sys.argv[1]), 'study'):\n    print('in', flush=True)\n    input()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(out)], env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as first:  # fmt: skip
        assert first.stdout is not None
        assert first.stdout.readline() == "in\n"
        done = CliRunner().invoke(app, ["study", "sphere", "--vary", "mesh.divisions=2,3", "--out", str(out)])
        assert (done.exit_code, done.stdout) == (2, ""), done.output
        assert f"{out}: another study writes in this folder (process {first.pid})" in done.stderr.splitlines()[-1]
        assert (half / "summary.json").read_text("utf-8") == "half a run"
        first.communicate("\n")
    assert not (out / LOCK).exists()
