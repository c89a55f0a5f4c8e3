"""Stages and load steps: ramp pressures and loads, find equilibrium, halve a step that fails, tell collapse from failure."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from taichi_membrane.names import Outcome
from taichi_membrane.scene import Stage
from taichi_membrane.simulation.equilibrium import Equilibrium, Report
from taichi_membrane.simulation.load_state import Course, LoadState, stage_target, unloaded
from taichi_membrane.simulation.measure import Measure
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.solvers.path import PathPoint
from taichi_membrane.solvers.record import Progress, SolveRecord

ProgressCallback = Callable[[str, int, int, Progress], None]


class Analysis:
    """Runs the stages of a model on one membrane, step by step.

    ``outcome`` tells how the stages ended; until they have, ``interrupted``.
    """

    def __init__(self, model: Model) -> None:
        self.equilibrium = Equilibrium(model)
        self._settle(model)

    def take(self, model: Model) -> bool:
        """Go on with another model, at rest, in the kernels compiled for this one; False, and no change, where they do not fit."""
        fits = self.equilibrium.take(model)
        if fits:
            self._settle(model)
        return fits

    def _settle(self, model: Model) -> None:
        self.model = model
        self.membrane, self.relaxation, self.newton = (
            self.equilibrium.membrane,
            self.equilibrium.relaxation,
            self.equilibrium.newton,
        )
        self.measure = Measure(self.equilibrium)
        self.outcome: Outcome = "interrupted"

    def compile(self) -> None:
        """Compile every kernel a run needs, moving nothing; so that compile time is a figure of its own."""
        self.equilibrium.compile()

    def steps(
        self, progress: ProgressCallback | None = None, *, done: Sequence[StepResult] = ()
    ) -> Iterator[StepResult]:
        """Yield each load step as it is done; stop after the first that does not reach its load.

        :param done: the first load steps, from an earlier analysis, which are not done again; of a stage by arc length all or none.
        """
        state = unloaded(self.model.scene)
        number = 0
        if done:
            self.measure.again(done[-1])
        for stage in self.model.scene.stages:
            course = Course(state, stage_target(state, stage))
            self.equilibrium.shut(stage.closed, state)
            run_stage = self._arc_length_stage if stage.control == "arc_length" else self._load_stage
            had = [step for step in done if step.stage == stage.name]
            for result in run_stage(number, stage, course, had, progress):
                if number >= len(done):
                    yield result
                number += 1
                if not result.converged:
                    self.outcome = "not converged"
                    return
                if result.limit is not None and stage.until == "target":
                    self.outcome = "collapse"
                    return
                state = LoadState(result.drivers)
        self.outcome = "finished"

    def _load_stage(
        self,
        number: int,
        stage: Stage,
        course: Course,
        had: Sequence[StepResult],
        progress: ProgressCallback | None,
    ) -> Iterator[StepResult]:
        """Equal steps of the load; the last one done is the one that meets a limit."""
        for k in range(1, stage.steps + 1):
            known = had[k - 1] if k <= len(had) else None
            result = known or self._load_step(number + k - 1, stage, k, course, progress)
            yield result
            if not result.converged or result.limit is not None:
                return

    def _load_step(
        self, number: int, stage: Stage, k: int, course: Course, progress: ProgressCallback | None
    ) -> StepResult:
        """One load step, halved as often as allowed while it fails; a failed one keeps the last equilibrium it reached."""
        started = time.perf_counter()
        report = _report(stage, k, progress)
        reached, end = (k - 1) / stage.steps, k / stage.steps
        size, cuts, iterations = end - reached, 0, 0
        while True:
            aim = min(end, reached + size)
            part = self.equilibrium.step(course.at(reached), course.at(aim), report)
            iterations += part.record.iterations
            record = replace(part.record, iterations=iterations)
            if part.limit is not None:
                lower, upper = (reached + share * (aim - reached) for share in part.limit)
                limit = _bracket(course.at(lower), course.at(upper))
                record = replace(record, reason=_collapse(limit))
                return self.measure.step(number, stage, k, course, lower, record, cuts, started, limit=limit)
            if part.record.converged:
                reached = aim
                if reached == end:
                    return self.measure.step(number, stage, k, course, end, record, cuts, started)
            elif cuts == self.model.scene.solver.max_cuts:
                bounds = [100.0 * (share * stage.steps - (k - 1)) for share in (reached, aim)]
                reason = (
                    f"no equilibrium found between {bounds[0]:.4g} and {bounds[1]:.4g} % of the step "
                    f"({record.reason}, {cuts} halvings); {part.trouble}; the last equilibrium is kept"
                )
                record = replace(record, reason=reason)
                return self.measure.step(number, stage, k, course, reached, record, cuts, started)
            else:
                cuts, size = cuts + 1, 0.5 * size

    def _arc_length_stage(
        self,
        number: int,
        stage: Stage,
        course: Course,
        had: Sequence[StepResult],
        progress: ProgressCallback | None,
    ) -> Iterator[StepResult]:
        """Steps along the equilibrium path, through limit points, until the stage's loads are reached or its steps are used up."""
        if had:
            yield from had
            return
        newton = self.newton
        assert newton is not None  # chosen_solver refuses arc length without it
        path = self.equilibrium.path(newton, course.start, course.target)
        started = time.perf_counter()
        origin = self.membrane.displacement()
        point = path.start(origin, 0.0)
        length = 0.0 if point is None else point.length_for(1.0 / stage.steps)
        for k in range(1, stage.steps + 1):
            following: PathPoint | None = None
            if point is not None:
                following, length = path.step(point, length)
            if following is None:
                self.membrane.set_displacement(origin if point is None else point.position)
                reason = (
                    "the tangent is singular" if point is None else "the path is lost; the last equilibrium is kept"
                )
                share = 0.0 if point is None else point.factor
                failed = _walked(point, converged=False, reason=reason)
                yield self.measure.step(number + k - 1, stage, k, course, share, failed, 0, started)
                return
            report = _report(stage, k, progress)
            if report is not None:
                report(Progress(iteration=following.iterations, residual=following.residual, seconds=0.0))
            point = following
            yield self.measure.step(number + k - 1, stage, k, course, point.factor, _walked(point), 0, started)
            started = time.perf_counter()
            if point.factor >= 1.0:
                return


_compiled: list[Analysis] = []


def ready(model: Model) -> Analysis:
    """An analysis of a model at rest, compiled; in kernels that an earlier run of this process has left, where it fits them.

    Taichi frees no fields before the process ends, so that keeping them costs nothing.
    """
    for work in reversed(_compiled):
        if work.take(model):
            break
    else:
        work = Analysis(model)
        _compiled.append(work)
    work.compile()
    return work


def _report(stage: Stage, k: int, progress: ProgressCallback | None) -> Report:
    return None if progress is None else lambda p: progress(stage.name, k, stage.steps, p)


def _walked(point: PathPoint | None, *, converged: bool = True, reason: str = "residual") -> SolveRecord:
    """Record of a step by arc length."""
    return SolveRecord(
        converged=converged,
        reason=reason,
        iterations=0 if point is None else point.iterations,
        residual=float("nan") if point is None else point.residual,
        seconds=0.0,
        method="arc length",
    )


def _bracket(lower: LoadState, upper: LoadState) -> dict[str, tuple[float, float]]:
    """Bounds of each value that changes between two states."""
    pairs = {name: (low, upper.values[name]) for name, low in lower.values.items()}
    return {name: (low, high) for name, (low, high) in pairs.items() if low != high}


def _collapse(limit: dict[str, tuple[float, float]]) -> str:
    """What a step that met a limit says."""
    bounds = ", ".join(f"{name} between {low:.6g} and {high:.6g}" for name, (low, high) in limit.items())
    return f"collapse: the largest stable load has {bounds}"
