"""Stages and load steps: ramp pressures and loads, find equilibrium, halve a step that fails, tell collapse from failure."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace

from taichi_membrane.names import Outcome
from taichi_membrane.scene import Stage
from taichi_membrane.simulation.equilibrium import Equilibrium, Report
from taichi_membrane.simulation.forming import Forming
from taichi_membrane.simulation.load_state import Course, LoadState, stage_target
from taichi_membrane.simulation.measure import Measure
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.policy import Passage
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.simulation.state import PathState, State
from taichi_membrane.simulation.stiffest import Stiffest
from taichi_membrane.solvers.path import PathPoint
from taichi_membrane.solvers.record import Progress, SolveRecord

ProgressCallback = Callable[[str, int, int, Progress], None]
Limit = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class _End:
    """Where a stage came to its end: the course it took, and its last load step."""

    stage: Stage
    course: Course
    step: StepResult


class Analysis:
    """Runs the stages of a model on one system, step by step.

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
        self.system, self.relaxation, self.newton = (
            self.equilibrium.system,
            self.equilibrium.relaxation,
            self.equilibrium.newton,
        )
        self.measure = Measure(self.equilibrium)
        self.stiffest = Stiffest()
        self.outcome: Outcome = "interrupted"

    def compile(self) -> None:
        """Compile every kernel a run needs, moving nothing; so that compile time is a figure of its own."""
        self.equilibrium.compile()

    def steps(
        self, progress: ProgressCallback | None = None, *, done: Sequence[StepResult] = ()
    ) -> Iterator[StepResult]:
        """Yield each load step as it is done: those of the stages, up to the first that does not reach its load, then those of the
        cases whose stage came to its end, of each up to the first that does not.

        :param done: the first load steps, from an earlier analysis, which are not done again.
        """
        ends: dict[str, _End] = {}
        outcome, number = yield from self._stages(progress, done, ends)
        for case in self.model.scene.cases:
            end = ends.get(self.model.scene.start_of(case))
            if end is not None:
                number += yield from self._case(number, self.model.scene.ramp(case.name), end, done, progress)
        self.outcome = outcome

    def _stages(
        self, progress: ProgressCallback | None, done: Sequence[StepResult], ends: dict[str, _End]
    ) -> Generator[StepResult, None, tuple[Outcome, int]]:
        """The steps of the stages; returns how they ended, and the number of steps.

        :param ends: gets the end of each stage that came to it.
        """
        state = self.model.unloaded
        number = 0
        for stage in self.model.scene.stages:
            course = Course(state, stage_target(state, stage))
            if done and stage.name == done[-1].stage:
                self._go_on(done[-1], stage, course)
            elif number >= len(done):
                self.equilibrium.shut(stage)
            run_stage = self._arc_length_stage if stage.control == "arc_length" else self._load_stage
            run_stage = self._form_stage if stage.kind == "form_find" else run_stage
            had = [step for step in done if step.stage == stage.name]
            for result in run_stage(number, stage, course, had, progress):
                if number >= len(done):
                    yield result
                number += 1
                if not result.converged:
                    return "not converged", number
                if result.limit is not None and stage.until == "target":
                    return "collapse", number
                state = LoadState(result.drivers)
            if missed := _missed(stage, result, course):
                return missed, number
            ends[stage.name] = _End(stage, course, result)
        return "finished", number

    def _case(
        self, number: int, case: Stage, end: _End, done: Sequence[StepResult], progress: ProgressCallback | None
    ) -> Generator[StepResult, None, int]:
        """The steps of a case, from the end of a stage; returns their number."""
        had = [step for step in done if step.stage == case.name]
        if had and (had[-1].stage_step == case.steps or not had[-1].converged or had[-1].limit is not None):
            return len(had)
        start = LoadState(end.step.drivers)
        course = Course(start, stage_target(start, case))
        self._go_on(end.step, end.stage, end.course)
        if had:
            self._go_on(had[-1], case, course)
        else:
            self.equilibrium.shut(case)
        count = 0
        for result in self._load_stage(number, case, course, had, progress):
            count += 1
            if count > len(had):
                yield result
        return count

    def _form_stage(
        self,
        number: int,
        stage: Stage,
        course: Course,
        had: Sequence[StepResult],
        progress: ProgressCallback | None,
    ) -> Iterator[StepResult]:
        """The rest shape, which this analysis has from now on; displacements are counted from it."""
        if had:
            yield from had
            return
        started = time.perf_counter()
        form = Forming(self.model, self.equilibrium, self.take, stage, course.target).find(
            reporting(stage, 1, progress)
        )
        step = self.measure.step(number, stage, 1, course, 1.0, form.record, 0, started)
        # To the last bit what the model is made of, as a run that goes on makes it anew.
        fields = {**step.fields, "stress": form.stress, "cable_force": form.cable_force}
        yield replace(step, fields=fields)

    def _go_on(self, step: StepResult, stage: Stage, course: Course) -> None:
        """Take over the state that a load step, from an earlier analysis, has handed on."""
        self.equilibrium.shut(stage)
        self.measure.again(step)
        self.equilibrium.filling.let_out = dict(step.state.let_out)
        self.stiffest.value = step.state.stiffest
        self.stiffest.resume(course.start.change(course.target))

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
        report = reporting(stage, k, progress)
        reached, end = (k - 1) / stage.steps, k / stage.steps
        size, cuts, iterations = end - reached, 0, 0
        trace: list[Passage] = []

        def finished(share: float, record: SolveRecord, limit: Limit | None = None) -> StepResult:
            step = self.measure.step(number, stage, k, course, share, record, cuts, started, limit=limit)
            return replace(
                step, trace=(*trace, *_relief(step, share)), state=replace(step.state, stiffest=self.stiffest.value)
            )

        while True:
            aim = min(end, reached + size)
            part = self.equilibrium.step(
                course.at(reached), course.at(aim), report, stiffest=self.stiffest, snaps=stage.snaps == "pass"
            )
            iterations += part.record.iterations
            record = replace(part.record, iterations=iterations)
            trace += [replace(one, share=reached + one.share * (aim - reached)) for one in part.trace]
            if part.limit is not None:
                at, *bounds = (reached + share * (aim - reached) for share in (part.reached, *part.limit))
                limit = _bracket(course, *bounds)
                return finished(at, replace(record, reason=_collapse(limit)), limit=limit)
            if part.record.converged:
                reached = aim
                if reached == end:
                    missed = k == stage.steps and stage.until == "collapse"
                    return finished(end, replace(record, reason=_no_collapse(course)) if missed else record)
            elif cuts == self.model.scene.solver.max_cuts:
                bounds = [100.0 * (share * stage.steps - (k - 1)) for share in (reached, aim)]
                reason = (
                    f"no equilibrium found between {bounds[0]:.4g} and {bounds[1]:.4g} % of the step "
                    f"({record.reason}, {cuts} halvings); {part.trouble}; the last equilibrium is kept"
                )
                return finished(reached, replace(record, reason=reason))
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
        yield from had
        if had and (had[-1].state.path is None or had[-1].state.path.factor == 1.0):
            return  # it has ended
        newton = self.newton
        assert newton is not None  # chosen_solver refuses arc length without it
        path = self.equilibrium.path(self.equilibrium.way(course.start, course.target))
        started = time.perf_counter()
        origin = self.system.displacement()
        if had:
            point, length = _path_point(had[-1].state)
        else:
            point = path.start(origin, 0.0)
            length = 0.0 if point is None else point.length_for(1.0 / stage.steps)
        for k in range(len(had) + 1, stage.steps + 1):
            following: PathPoint | None = None
            if point is not None and not point.tangent.any():
                following = path.start(point.position, 1.0)  # the load moves nothing: an equilibrium at all of it
            elif point is not None:
                following, length = path.step(point, length)
                if following is not None and following.factor > 1.0:
                    following = path.land(point, following, 1.0)
            if following is None:
                self.system.set_displacement(origin if point is None else point.position)
                reason = (
                    "the tangent is singular" if point is None else "the path is lost; the last equilibrium is kept"
                )
                share = 0.0 if point is None else point.factor
                failed = _walked(point, converged=False, reason=reason)
                yield self.measure.step(number + k - 1, stage, k, course, share, failed, 0, started)
                return
            report = reporting(stage, k, progress)
            if report is not None:
                report(Progress(iteration=following.iterations, residual=following.residual, seconds=0.0))
            point = following
            record = _walked(point)
            if k == stage.steps and point.factor < 1.0 and stage.until == "target":
                record = replace(
                    record, reason=f"the steps are used up at {100.0 * point.factor:.4g} % of the stage's way"
                )
            step = self.measure.step(number + k - 1, stage, k, course, point.factor, record, 0, started)
            state = replace(step.state, path=_path_state(point, length))
            way = Passage(event="path", share=point.factor)
            yield replace(step, trace=(way, *_relief(step, point.factor)), state=state)
            started = time.perf_counter()
            if point.factor == 1.0:
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


def reporting(stage: Stage, k: int, progress: ProgressCallback | None) -> Report:
    """What a solver calls to tell how far step ``k`` of a stage is."""
    return None if progress is None else lambda p: progress(stage.name, k, stage.steps, p)


def _path_state(point: PathPoint, length: float) -> PathState:
    """What a path needs of a point to go on from it, and the length to try."""
    return PathState(
        factor=point.factor, tangent=point.tangent, advance=point.advance, negative=point.negative, length=length
    )


def _path_point(state: State) -> tuple[PathPoint | None, float]:
    """The point of a path that a load step ended at, and the length to try next."""
    at = state.path
    assert at is not None
    point = PathPoint(
        position=state.displacement, factor=at.factor, tangent=at.tangent, negative=at.negative, advance=at.advance,
        iterations=0, residual=0.0,
    )  # fmt: skip
    return point, at.length


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


def _relief(step: StepResult, share: float) -> tuple[Passage, ...]:
    """The passage of a step in which a relief valve let out gas."""
    return (Passage(event="relief", share=share),) if step.relieved else ()


def _missed(stage: Stage, last: StepResult, course: Course) -> Outcome | None:
    """How the run ends where a stage has not come to the end it names; None where it has."""
    if stage.until == "collapse" and last.limit is None:
        return "no collapse"
    path = last.state.path
    if stage.control == "arc_length" and stage.until == "target" and path is not None and path.factor != 1.0:
        return "steps used up"
    return None


def _bracket(course: Course, lower: float, upper: float) -> Limit:
    """Bounds of each value that changes along a course, at two shares of it."""
    low, high = course.at(lower), course.at(upper)
    return {name: (low.values[name], high.values[name]) for name in course.changing()}


def _no_collapse(course: Course) -> str:
    """What a stage that should have met its largest stable load says at its end."""
    return "no collapse up to " + ", ".join(f"{name} = {course.target.values[name]:.6g}" for name in course.changing())


def _collapse(limit: Limit) -> str:
    """What a step that met a limit says."""
    bounds = ", ".join(f"{name} between {_apart(low, high)}" for name, (low, high) in limit.items())
    return f"collapse: the largest stable load has {bounds}"


def _apart(low: float, high: float) -> str:
    """Two bounds with as many digits as tell them apart, from six to nine."""
    digits = next((one for one in range(6, 10) if f"{low:.{one}g}" != f"{high:.{one}g}"), 6)
    return f"{low:.{digits}g} and {high:.{digits}g}"
