"""Worker processes on this machine, each keeping its compiled kernels."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from taichi_membrane.execution.side_by_side import side_by_side
from taichi_membrane.parametric.plan import Trial

RETRIES = 2  # of a trial whose worker died: by chance once in a while, three times in a row by its own doing
_THREADS_OF_BLAS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
# -P: a file in the present folder must not be taken for a module.
COMMAND = (sys.executable, "-P", "-m", "taichi_membrane.parametric.worker")
Answer = dict[str, Any]


class WorkerDied(Exception):
    """A worker ended without an answer; the text says how."""


class Worker:
    """A process of :mod:`taichi_membrane.parametric.worker`.

    :param threads: of its BLAS; those of Taichi come with each trial.
    """

    def __init__(self, threads: int) -> None:
        package = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, (package, os.environ.get("PYTHONPATH"))))
        environment = os.environ | dict.fromkeys(_THREADS_OF_BLAS, str(threads)) | {"PYTHONPATH": path}
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  (closed in end)
        self.process = subprocess.Popen(
            COMMAND,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, env=environment,
            start_new_session=True,  # Ctrl-C is the parent's business
        )  # fmt: skip

    def ask(self, text: str) -> str:
        """The answer to a trial's text.

        :raises WorkerDied: the process has ended.
        """
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(text.encode() + b"\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except OSError:  # its end of the pipe is closed
            line = b""
        if not line.endswith(b"\n"):
            code = self.process.wait()
            self._said.seek(0)
            words = self._said.read().decode(errors="replace").strip().rpartition("\n")[2]
            raise WorkerDied(f"the worker ended with code {code}{f': {words}' if words else ''}")
        return line.decode()

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self._said):
            if pipe is not None:
                with suppress(OSError):  # what was not written yet finds no reader
                    pipe.close()


class LocalPool:
    """Workers that are kept from call to call, until the context ends.

    :param jobs: how many at a time; ``threads`` of each one's BLAS.
    :param fresh: a new process for every trial.
    """

    def __init__(self, *, jobs: int, threads: int = 1, fresh: bool = False) -> None:
        self._jobs, self._threads, self._fresh = jobs, threads, fresh
        self._lock = threading.Lock()
        self._idle: list[Worker] = []
        self._alive: set[Worker] = set()
        self._stopped = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()
        for worker in list(self._alive):
            worker.end()
        self._alive.clear()

    def answers(self, trials: Sequence[Trial], text: Callable[[Trial], str]) -> Generator[tuple[Trial, Answer]]:
        """Each trial with its answer, as they end, begun in the order given.

        A worker that dies costs its trial another try, not the others; after :data:`RETRIES` of them the outcome is ``crashed``.
        """
        yield from side_by_side(
            trials, lambda trial: self._answer(trial, text(trial)), jobs=self._jobs, stop=self._stop
        )

    def _answer(self, trial: Trial, asked: str) -> tuple[Trial, Answer]:
        reason = ""
        for attempt in range(1, RETRIES + 2):
            worker = self._lent()
            try:
                answer = json.loads(worker.ask(asked))
            except WorkerDied as death:
                self._end(worker)
                reason = str(death)
                continue
            if self._fresh:
                self._end(worker)
            else:
                self._idle.append(worker)
            return trial, {**answer, "attempts": attempt}
        return trial, {"outcome": "crashed", "reason": f"{reason}, {RETRIES + 1} times", "attempts": RETRIES + 1}

    def _lent(self) -> Worker:
        with self._lock:
            if self._stopped:
                raise InterruptedError("the sweep was interrupted")
            worker = self._idle.pop() if self._idle else Worker(self._threads)
            self._alive.add(worker)
            return worker

    def _end(self, worker: Worker) -> None:
        worker.end()
        self._alive.discard(worker)

    def _stop(self) -> None:
        """Make the work in progress end; no worker is started after this."""
        with self._lock:
            self._stopped = True
            for worker in list(self._alive):
                worker.process.kill()
