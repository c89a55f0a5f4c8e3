"""Load steps solved again on a finer mesh, from their own states carried over, and what the differences tell of errors.

With the exact value v, one of size h is v + C h^p, so that v_h - v = (v_h - v_{h/2}) 2^p/(2^p - 1). The order p is taken, not
measured. Triangles of degree k in equilibrium have strains wrong by h^k, and what is smooth in the displacements, a deflection, a
resultant force, a volume or a mean stress, by h^2k: p = 2 with three nodes, whose flat facets are h^2 off as well, and 4 with six.
Where fabric wrinkles strains have kinks within elements, at which those of six nodes are wrong by h in a share h of the surface:
p = 3. A largest or least stress, of one element, has p = k; means over the nodes of a line with ends, which count the ends in full,
have 1, and so do areas and shares that are counted by elements. Near collapse, beside boundary layers that the mesh does not see,
and under forces at single nodes errors fall otherwise.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_membrane import scene as scenes
from taichi_membrane.arrays import Floats
from taichi_membrane.names import TAUT, EstimatedSteps
from taichi_membrane.scene import Stage
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.accuracy import Estimate, ProbeEstimate, StepEstimate
from taichi_membrane.simulation.analysis import Analysis, ProgressCallback, reporting
from taichi_membrane.simulation.equilibrium import Report
from taichi_membrane.simulation.load_state import Course, LoadState, stage_target
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.refined import Refined
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.solvers.record import SolveRecord, joined

# Distance of a state from the one carried over, over the size of its displacements, beyond which it is another one.
_FAR = 0.3


# A load step, its end on the fine mesh, and why there is none.
Solved = tuple[StepResult, StepResult | None, str]


@dataclass(frozen=True)
class _End:
    """Where a stage or case ended.

    :param coarse: its load state; ``fine`` that on the fine mesh, which has other pressures and amounts of gas.
    :param step: its end on the fine mesh, where gas has to be carried on from there.
    :param lost: why there is none.
    """

    coarse: LoadState
    fine: LoadState
    step: StepResult | None = None
    lost: str = ""


class Again:
    """A run's load steps on a finer mesh.

    :param work: an analysis of the fine model, compiled.
    :param what: what the fine mesh is called in messages.
    """

    def __init__(
        self,
        coarse: Model,
        fine: Refined,
        work: Analysis,
        progress: ProgressCallback | None = None,
        what: str = "the mesh cut in four",
    ) -> None:
        self.coarse, self.fine, self.work, self.progress, self.what = coarse, fine, work, progress, what
        self.equilibrium = work.equilibrium

    def estimate(self, steps: Sequence[StepResult], which: EstimatedSteps) -> Estimate:
        """Estimates of the last load step that is an equilibrium, or of all."""
        done = [step for step in steps if step.converged]
        wanted = done if which == "all" else done[-1:]
        mesh = self.fine.model.structure.mesh
        return Estimate(
            node_count=mesh.node_count,
            tri_count=mesh.tri_count,
            left_out=self.fine.left_out,
            steps=tuple(self._of_step(*one) for one in self.solved(done, {step.number for step in wanted})),
        )

    def solved(self, done: Sequence[StepResult], wanted: set[int]) -> Iterator[Solved]:
        """Wanted load steps, by their numbers, each with its end on the fine mesh; none, and why, where that is not found.

        The gas that a stage or case shuts in is that of the stage before, on this mesh as well.

        :param done: the load steps of the run, without those that are no equilibrium; of each stage or case at least the last one.
        """
        scene = self.coarse.scene
        ran = [ramp for ramp in scene.ramps if any(step.stage == ramp.name for step in done)]
        gas = any(shut_by(scene, ramp) for ramp in ran)
        ends = {"": _End(self.coarse.unloaded, self.fine.model.unloaded)}
        for ramp in ran:
            leading = scene.before(ramp)
            start = ends[leading[-1].name if leading else ""]
            own = [step for step in done if step.stage == ramp.name]
            ends[ramp.name] = yield from self._of_ramp(ramp, start, own, wanted, gas)

    def _of_ramp(
        self, ramp: Stage, start: _End, own: Sequence[StepResult], wanted: set[int], gas: bool
    ) -> Generator[Solved, None, _End]:
        """Those of a stage or case; returns its end."""
        course = Course(start.fine, stage_target(start.fine, ramp))
        if start.step is not None:
            self.work.measure.again(start.step)  # a case before may have left the gas elsewhere
        self.equilibrium.shut(ramp)
        lost, end = start.lost, None
        for number, step in enumerate(own):
            asked, carries = step.number in wanted, gas and step is own[-1]
            if not (asked or carries):
                continue
            share = _share(step, ramp, Course(start.coarse, stage_target(start.coarse, ramp)))
            since = own[number - 1] if number else None
            found, why = (None, lost) if lost else self._solved(step, ramp, course, share, since)
            if found is None and carries:
                lost = lost or f"{step.stage} {step.stage_step}: {why}"
            if asked:
                yield step, found, why
            if carries:
                end = found
        coarse = LoadState(own[-1].drivers)
        if not gas:
            return _End(coarse, coarse)
        return _End(coarse, start.fine if end is None else LoadState(end.drivers), end, lost)

    def _of_step(self, step: StepResult, found: StepResult | None, why: str) -> StepEstimate:
        """The estimates of a load step from its state on the fine mesh."""
        here = StepEstimate(number=step.number, stage=step.stage, stage_step=step.stage_step, unknown=why)
        if found is None:
            return here
        probes = {
            name: ProbeEstimate(value=step.probes[name], fine=value, order=_order(self.coarse, name, found))
            for name, value in found.probes.items()
            if not isinstance(self.coarse.scene.probes.get(name), scenes.FactorProbe)
        }
        return replace(here, probes=probes, iterations=found.iterations)

    def _solved(
        self, step: StepResult, stage: Stage, course: Course, share: float, since: StepResult | None
    ) -> tuple[StepResult | None, str]:
        """A load step's equilibrium on the fine mesh; none, and why, where what is found is not a finer image of it."""
        started = time.perf_counter()
        report = reporting(stage, step.stage_step, self.progress)
        start = self.fine.displacement(step.displacement)
        state = course.at(share)
        record = self._from(start, state, report)
        if not record.converged:
            record = joined(record, self._walked(stage, course, share, since, report))
        if not record.converged:
            return None, f"no equilibrium was found on {self.what} ({record.reason})"
        found = self._measured(step, stage, course, share, record, started)
        if _less_stable(found, step) and self.equilibrium.newton is not None:
            self.equilibrium.newton.disturb()
            again = self.equilibrium.solve(state, report)
            if again.converged:
                found = self._measured(step, stage, course, share, joined(record, again), started)
        if _less_stable(found, step):
            told = f"{found.negative_pivots} negative pivots, {step.negative_pivots} on its own mesh"
            return None, f"the equilibrium found on {self.what} is unstable ({told})"
        off, size = (float(np.sqrt((one**2).sum(axis=1).mean())) for one in (found.displacement - start, start))
        if off > _FAR * size > 0.0:
            return (
                None,
                f"what was found on {self.what} is {100.0 * off / size:.0f} % of the displacements away",
            )
        return found, ""

    def _walked(
        self, stage: Stage, course: Course, share: float, since: StepResult | None, report: Report
    ) -> SolveRecord:
        """By a verified step from the load step before."""
        reached = 0.0
        start = np.zeros((self.fine.model.structure.node_count, 3))
        if since is not None:
            reached, start = since.stage_step / stage.steps, self.fine.displacement(since.displacement)
            if since.state.path is not None:
                reached = since.state.path.factor
        record = self._from(start, course.at(reached), report)
        if not record.converged:
            return record
        found = self.equilibrium.step(course.at(reached), course.at(share), report)
        if found.record.converged and (found.limit is not None or found.reached != 1.0):
            return replace(found.record, converged=False, reason="it meets a limit before")
        return found.record

    def _from(self, displacement: Floats, state: LoadState, report: Report) -> SolveRecord:
        """Equilibrium at a load state from given displacements, with relaxation where Newton alone finds none."""
        self.equilibrium.system.set_displacement(displacement)
        self.equilibrium.contact.begin()
        record = self.equilibrium.solve(state, report)
        if record.converged or self.equilibrium.kind != "hybrid":
            return record
        self.equilibrium.system.set_displacement(displacement)
        return joined(record, self.equilibrium.solve(state, report, relax=True))

    def _measured(
        self, step: StepResult, stage: Stage, course: Course, share: float, record: SolveRecord, started: float
    ) -> StepResult:
        return self.work.measure.step(step.number, stage, step.stage_step, course, share, record, 0, started)


def _share(step: StepResult, stage: Stage, course: Course) -> float:
    """How far along its stage's course a load step's state is."""
    if step.state.path is not None:
        return step.state.path.factor
    if step.limit is None:
        return step.stage_step / stage.steps
    name = max(step.limit, key=lambda one: abs(course.target.values[one] - course.start.values[one]))
    first, last = course.start.values[name], course.target.values[name]
    return (step.drivers[name] - first) / (last - first)


def _less_stable(found: StepResult, step: StepResult) -> bool:
    """Whether an equilibrium has more unstable modes than that of the coarse mesh, as far as they are known."""
    return (found.negative_pivots or 0) > (step.negative_pivots or 0)


def _order(model: Model, name: str, found: StepResult) -> float:
    """Power of the size with which the error of a probe is taken to fall; see above.

    :param found: the load step on the fine mesh.
    """
    mesh, probe = model.structure.mesh, model.scene.probes.get(name)
    if isinstance(probe, scenes.StressProbe | scenes.ResultantProbe) and probe.reduce != "mean":
        return float(mesh.order)
    if isinstance(probe, scenes.AreaProbe) or (isinstance(probe, scenes.ContactProbe) and probe.of != "force"):
        return 1.0
    means = scenes.DisplacementProbe | scenes.PositionProbe | scenes.RadiusProbe | scenes.RotationProbe
    if isinstance(probe, means) and not _even(model, probe.group):
        return 1.0
    if mesh.order == 1:
        return 2.0
    states = found.fields.get("point_state", found.fields["state"])
    return 4.0 if (states == TAUT).all() else 3.0


def _even(model: Model, group: str) -> bool:
    """Whether the mean over a group's nodes is that along closed lines, of nodes apart, or of a whole closed surface."""
    mesh = model.structure.mesh
    if mesh.is_closed and len(mesh.node_groups[group]) == mesh.node_count:
        return True
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[mesh.node_groups[group]] = True
    edges = mesh.edges()
    edges = edges[inside[edges].all(axis=1)]
    count = np.bincount(edges.ravel(), minlength=mesh.node_count)[inside]
    return bool((count == 2).all() or (count == 0).all())
