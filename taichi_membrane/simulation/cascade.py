"""Load steps solved on a coarse mesh and carried over to finer ones, each cut in four of the one before (nested iteration).

What is found on the finest mesh is an equilibrium to the run's own tolerance, no less stable than that of the mesh before and near
it. From the first load step that is not found so, or has no equilibrium on a coarser mesh, such as one that meets collapse there,
the run goes on by load steps on the finest mesh as any other does.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

from taichi_membrane.errors import InputError
from taichi_membrane.simulation.accuracy import Cascade
from taichi_membrane.simulation.analysis import Analysis, ProgressCallback, ready
from taichi_membrane.simulation.estimating import Again
from taichi_membrane.simulation.model import Model, build_model
from taichi_membrane.simulation.policy import Passage
from taichi_membrane.simulation.refined import Refined, refined
from taichi_membrane.simulation.results import StepResult


def levels(model: Model, count: int) -> list[Refined]:
    """A model on its mesh cut in four, ``count`` times; the last one is what is run.

    :raises InputError: its states cannot be carried over.
    """
    for stage in model.scene.ramps:
        if stage.control == "arc_length":
            raise InputError(f"cascade: of a stage by arc length ({stage.key}.control) is not implemented")
    found: list[Refined] = []
    for _ in range(count):
        found.append(refined(found[-1].model if found else model, "cascade"))
    last = found[-1]
    found[-1] = replace(last, model=build_model(model.scene, last.model.structure.mesh, model.own_probes))
    return found


class Cascading:
    """The load steps of a run by a cascade.

    :param coarse: the model on its own mesh, and ``finer`` those on the meshes that it is carried over to.
    """

    def __init__(self, coarse: Model, finer: list[Refined], progress: ProgressCallback | None = None) -> None:
        self.coarse, self.finer, self.progress = coarse, finer, progress
        count = coarse.structure.mesh.tri_count
        self.told = Cascade(
            elements=(count, *(one.model.structure.mesh.tri_count for one in finer)), iterations=(), seconds=()
        )
        self.work: Analysis | None = None

    def steps(self) -> Iterator[StepResult]:
        """Yield each load step on the finest mesh."""
        started = time.perf_counter()
        here, work = self.coarse, ready(self.coarse)
        steps = _carried_on(list(work.steps(self.progress)))
        self._note([step.iterations for step in steps], started)
        for fine in self.finer[:-1]:
            started = time.perf_counter()
            again = Again(here, fine, ready(fine.model), self.progress, "the mesh cut in four")
            steps = list(self._found(again, steps))
            here = fine.model
            self._note([step.iterations for step in steps], started)
        started, last = time.perf_counter(), self.finer[-1]
        work = self.work = ready(last.model)
        done: list[StepResult] = []
        for step in self._found(Again(here, last, work, self.progress, "the mesh cut in four"), steps):
            done.append(step)
            yield step
        self._note([step.iterations for step in done], started)
        self.told = replace(self.told, carried=len(done))
        yield from work.steps(self.progress, done=done)

    def _found(self, again: Again, steps: list[StepResult]) -> Iterator[StepResult]:
        """Load steps on a finer mesh, up to the first that is not found."""
        for step, end, why in again.solved(steps, {one.number for one in steps}):
            if end is None:
                self.told = replace(self.told, reason=f"{step.stage} {step.stage_step}: {why}")
                return
            share = step.stage_step / self.coarse.scene.ramp(step.stage).steps
            yield replace(end, trace=(Passage(event="carried over", share=share),))

    def _note(self, iterations: list[int], started: float) -> None:
        self.told = replace(
            self.told,
            iterations=(*self.told.iterations, sum(iterations)),
            seconds=(*self.told.seconds, time.perf_counter() - started),
        )


def _carried_on(steps: list[StepResult]) -> list[StepResult]:
    """The first load steps that reach their loads."""
    found: list[StepResult] = []
    for step in steps:
        if not step.converged or step.limit is not None:
            break
        found.append(step)
    return found
