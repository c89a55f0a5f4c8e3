"""Shows on a terminal, or in plain lines where there is none, how a run gets on."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import StepResult

SECONDS_BETWEEN_LINES = 10.0  # of a solve in progress, where no line can be rewritten


class ProgressView:
    """An observer of runs: one line that is rewritten on a terminal, else a line per phase and load step.

    :param console: where to show it; None keeps silent and only remembers.
    """

    def __init__(self, scene: Scene, console: Console | None) -> None:
        self.steps: list[StepResult] = []
        self.paths: list[Path] = []
        self._console = console
        self._line = Spinner("line")
        self._live: Live | None = None
        if console is not None and console.is_interactive:
            # Taichi looks at sys.stdout when it is imported, so that must stay what it is.
            self._live = Live(self._line, console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
        self._stage_steps = {stage.name: stage.steps for stage in scene.ramps}
        self._step_count = sum(self._stage_steps.values())
        self._last_line = time.monotonic()

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def phase(self, name: str) -> None:
        """A phase begins."""
        if self._live is not None:
            self._line.update(text=Text(f"{name} …"))
        else:
            self._print(f"{name} …")

    def progress(self, stage: str, step: int, steps: int, iterations: int, residual: float, seconds: float) -> None:
        """The solver is at work on a load step."""
        line = f"{stage} {step}/{steps}: {iterations} iterations, residual {residual:.1e}, {seconds:.1f} s"
        if self._live is not None:
            self._line.update(text=Text(f"{line} (load step {len(self.steps) + 1} of {self._step_count})"))
        elif time.monotonic() - self._last_line >= SECONDS_BETWEEN_LINES:
            self._print(f"  {line}")

    def kept(self, steps: Sequence[StepResult]) -> None:
        """Load steps that are there already."""
        self.steps.extend(steps)
        self._print(f"{len(steps)} of {self._step_count} load steps are there already")

    def step_done(self, step: StepResult) -> None:
        """A load step has ended."""
        self.steps.append(step)
        ended = "NOT CONVERGED, " if not step.converged else "" if step.limit is None else "COLLAPSE, "
        share = step.elements.count()["wrinkled"] / len(step.elements.state)
        self._print(
            f"{step.stage} {step.stage_step}/{self._stage_steps[step.stage]}: {ended}{step.iterations} iterations, "
            f"residual {step.residual:.1e}, {share:.1%} wrinkled, {step.seconds:.1f} s"
        )

    def wrote(self, path: Path) -> None:
        """A file is in place."""
        if path not in self.paths:
            self.paths.append(path)

    def _print(self, line: str) -> None:
        self._last_line = time.monotonic()
        if self._console is not None:
            self._console.print(Text(line), soft_wrap=True)
