"""Runs the cases of a study, each in a fresh process, and keeps what is done for the next time."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Literal

from taichi_membrane.errors import InputError
from taichi_membrane.execution.side_by_side import side_by_side
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.lock import LOCK
from taichi_membrane.output.reader import SUMMARY
from taichi_membrane.study.plan import Case, Plan

Status = Literal["converged", "not converged", "over budget", "refused", "crashed"]
RUNS = "runs"

_POLL = 0.02  # s between looks at a child: the resolution of its wall time
_MEBIBYTE = 2**20
_RSS_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes; getrusage counts in bytes on macOS, in KiB elsewhere
# Taichi's cache on disk would make the second run on a mesh faster than the first, set-up included.
_ENVIRONMENT = {"TI_OFFLINE_CACHE": "0"}
_EXIT_BAD_INPUT = 2  # of the command ``run``


@dataclass(frozen=True, kw_only=True)
class Run:
    """What one case gave.

    :param probes: values at the measured load step; empty unless the whole run converged.
    :param residual: of the measured load step; ``iterations`` of all load steps.
    :param seconds: per phase: ``setup``, ``start``, ``compile``, ``solve``, ``output``.
    :param wall_seconds: of the whole process; ``peak_memory`` in MiB, its largest resident set.
    :param jobs: how many processes shared the machine.
    """

    case: Case
    status: Status
    reason: str
    probes: dict[str, float]
    residual: float | None
    iterations: int
    seconds: dict[str, float]
    wall_seconds: float
    peak_memory: float
    jobs: int

    @property
    def cost(self) -> float:
        """Seconds that depend on the problem: set-up and solve."""
        return self.seconds.get("setup", 0.0) + self.seconds.get("solve", 0.0)


@dataclass(frozen=True, kw_only=True)
class _Record:
    """What the process of a case did, kept beside the files of the run."""

    fingerprint: str
    settings: dict[str, str]
    status: Status
    reason: str
    wall_seconds: float
    peak_memory: float
    jobs: int
    budget: float | None


Told = Callable[[Run, bool], None]


def check_folder(directory: Path) -> None:
    """Make sure that a study may write here.

    :raises InputError: the folder holds files, but no study; or it is no folder.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: the output folder is a file")
    held = sorted(path.name for path in directory.iterdir() if path.name != LOCK) if directory.is_dir() else []
    if held and RUNS not in held:
        raise InputError(
            f"{directory}: the output folder holds {held[0]!r} but no earlier study; give an empty or new one"
        )


def run_all(
    plan: Plan, directory: Path, *, jobs: int = 1, budget: float | None = None, told: Told = lambda run, reused: None
) -> tuple[Run, ...]:
    """Run every case that is not done yet; results in the order of the plan's cases. What was begun and is not done is removed, so
    that the caller must be the folder's :func:`taichi_membrane.output.lock.sole_writer`.

    :param jobs: processes side by side; more than one and they disturb each other's times.
    :param budget: seconds after which a process is ended.
    :param told: hears of each run as it ends, and whether it was done before.
    :raises InputError: the output folder cannot be written.
    """
    runs_folder = directory / RUNS
    try:
        runs_folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: the output folder cannot be made: {error.strerror}") from error
    done: dict[str, Run] = {}
    for case in plan.cases:
        if (run := _reused(case, runs_folder, budget)) is not None:
            done[case.identity] = run
            told(run, True)
    stop = threading.Event()
    left = [case for case in plan.cases if case.identity not in done]
    runs = side_by_side(left, lambda case: _run(case, runs_folder, jobs, budget, stop), jobs=jobs, stop=stop.set)
    with closing(runs):
        for run in runs:
            done[run.case.identity] = run
            told(run, False)
    return tuple(done[case.identity] for case in plan.cases)


def command(case: Case, folder: Path) -> list[str]:
    """The command line of a case's process."""
    settings = case.settings
    options = [f"--set={override}" for override in case.overrides]
    options += [f"--{key}={settings[key]}" for key in ("precision", "arch", "threads") if settings[key]]
    return [
        *(sys.executable, "-m", "taichi_membrane", "run", str(case.path.resolve())),
        *options,
        *("--no-render", "--quiet", f"--out={folder}"),
    ]


def _run(case: Case, runs_folder: Path, jobs: int, budget: float | None, stop: threading.Event) -> Run:
    folder, record_file = _places(case, runs_folder)
    # What an earlier run left must not be taken for the result of this one, should it be interrupted.
    record_file.unlink(missing_ok=True)
    if folder.exists():
        shutil.rmtree(folder)
    started = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command(case, folder), stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=os.environ | _ENVIRONMENT
        )
        code, peak_memory = _wait(process, budget, stop)
        wall_seconds = time.perf_counter() - started
        if stop.is_set():
            raise InterruptedError("the study was interrupted")
        words = _last_line(said)
    summary = _summary(folder)
    status, reason = _verdict(code, summary, words, budget)
    record = _Record(
        fingerprint=case.fingerprint,
        settings=case.settings,
        status=status,
        reason=reason,
        wall_seconds=wall_seconds,
        peak_memory=peak_memory,
        jobs=jobs,
        budget=budget,
    )
    with replacing(record_file) as temporary:
        temporary.write_text(json.dumps(asdict(record), indent=1) + "\n", encoding="utf-8")
    return _result(case, record, summary)


def _wait(process: subprocess.Popen[bytes], budget: float | None, stop: threading.Event) -> tuple[int | None, float]:
    """Exit code (None where the budget was spent) and peak memory in MiB of a child.

    The kernel carries the parent's resident set over to the child, so the peak is never below this process's own; a child with
    Taichi in it is always larger.
    """
    deadline = None if budget is None else time.monotonic() + budget
    spent = False
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)  # it is reaped: Popen must not wait for it again
            return None if spent else process.returncode, usage.ru_maxrss * _RSS_UNIT / _MEBIBYTE
        if not spent and (stop.is_set() or (deadline is not None and time.monotonic() > deadline)):
            spent = True
            process.kill()
        time.sleep(_POLL)


def _verdict(code: int | None, summary: dict[str, Any], words: str, budget: float | None) -> tuple[Status, str]:
    if code is None:
        return "over budget", f"ended after {budget:g} s"
    if code == _EXIT_BAD_INPUT:
        return "refused", words
    if not summary.get("complete") or "converged" not in summary:
        return "crashed", f"exit code {code}: {words}"
    if not summary["converged"]:
        failed = summary["steps"][-1]
        return "not converged", f"{failed['stage']} {failed['stage_step']}: {failed['reason']}"
    return "converged", ""


def _result(case: Case, record: _Record, summary: dict[str, Any]) -> Run:
    """Join what the process did with what the run found; a run that is no equilibrium has no values."""
    steps = summary.get("steps", [])
    of_stage = {step["stage_step"]: step for step in steps if step["stage"] == case.stage}
    measured = of_stage.get(max(of_stage, default=0) if case.last_done else case.step)
    found = measured is not None and record.status == "converged"
    return Run(
        case=case,
        status=record.status,
        reason=record.reason,
        probes={k: v for k, v in measured["probes"].items() if v is not None} if measured and found else {},
        residual=measured["residual"] if measured and found else None,
        iterations=sum(step["iterations"] for step in steps),
        seconds=dict(summary.get("seconds", {})),
        wall_seconds=record.wall_seconds,
        peak_memory=record.peak_memory,
        jobs=record.jobs,
    )


def _reused(case: Case, runs_folder: Path, budget: float | None) -> Run | None:
    """The result of an earlier study, where it is whole and of the same scene, settings and versions."""
    folder, record_file = _places(case, runs_folder)
    try:
        record = _Record(**json.loads(record_file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None  # none, or damaged: run it
    if record.fingerprint != case.fingerprint:
        return None
    summary = _summary(folder)
    if record.status == "over budget":
        whole = record.budget is not None and budget is not None and budget <= record.budget
    else:
        whole = record.status in ("converged", "not converged") and bool(summary.get("complete"))
    return _result(case, record, summary) if whole else None


def _places(case: Case, runs_folder: Path) -> tuple[Path, Path]:
    return runs_folder / case.identity, runs_folder / f"{case.identity}.json"


def _summary(folder: Path) -> dict[str, Any]:
    """What a run told, empty where it told nothing."""
    try:
        content = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _last_line(said: IO[bytes]) -> str:
    said.seek(0)
    lines = said.read().decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
