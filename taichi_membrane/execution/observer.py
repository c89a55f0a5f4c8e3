"""How a run tells what it is doing, and how long each phase took."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

from taichi_membrane.collector import no_collection

if TYPE_CHECKING:
    from taichi_membrane.simulation.results import StepResult
    from taichi_membrane.solvers.record import Progress

Result = TypeVar("Result")

# Phases before the first load step, which make much that stays.
_STARTING = ("setup", "start", "compile")


class Observer(Protocol):
    """Hears how a run gets on. The command line is one; a notebook may be another."""

    def phase(self, name: str) -> None:
        """A phase begins, such as "compiling kernels"."""

    def progress(self, stage: str, step: int, steps: int, iterations: int, residual: float, seconds: float) -> None:
        """A solver is at work on step ``step`` of ``steps`` of a stage."""

    def kept(self, steps: Sequence[StepResult]) -> None:
        """The load steps that a run which goes on has already; none where it was stopped during the first."""

    def step_done(self, step: StepResult) -> None:
        """A load step has ended, converged or not."""

    def wrote(self, path: Path) -> None:
        """A file is in place."""


class Silent:
    """The observer that says nothing."""

    def phase(self, name: str) -> None:
        """Say nothing."""

    def progress(self, stage: str, step: int, steps: int, iterations: int, residual: float, seconds: float) -> None:
        """Say nothing."""

    def kept(self, steps: Sequence[StepResult]) -> None:
        """Say nothing."""

    def step_done(self, step: StepResult) -> None:
        """Say nothing."""

    def wrote(self, path: Path) -> None:
        """Say nothing."""


class Clock:
    """Seconds spent in each phase, told to the observer as they begin."""

    def __init__(self, observer: Observer | None) -> None:
        self.observer: Observer = observer or Silent()
        self.seconds: dict[str, float] = {}
        self._stopped = False

    def stop(self) -> None:
        """End the run, from another thread, as Ctrl-C would, at the next thing it tells."""
        self._stopped = True

    def progress(self, stage: str, step: int, steps: int, found: Progress) -> None:
        """Tell what a solver is at."""
        if self._stopped:
            self._stopped = False  # what is there is still judged, written and drawn
            raise KeyboardInterrupt
        self.observer.progress(stage, step, steps, found.iteration, found.residual, found.seconds)

    @contextmanager
    def phase(self, key: str, told: str | None = None) -> Iterator[None]:
        """Add the time spent inside to a phase; ``told`` is what the observer hears first."""
        if told is not None:
            self.observer.phase(told)
        started = time.perf_counter()
        try:
            with no_collection() if key in _STARTING else nullcontext():
                yield
        finally:
            self.seconds[key] = self.seconds.get(key, 0.0) + time.perf_counter() - started

    def timed(self, key: str, call: Callable[[], Result]) -> Result:
        """The call's result; its time goes to the phase."""
        with self.phase(key):
            return call()
