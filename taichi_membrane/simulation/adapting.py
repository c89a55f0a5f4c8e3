"""A mesh refined until the estimated error of a probe meets a tolerance, from the state at the end of the last stage.

Each round bisects the elements that contribute half of the indicator (:mod:`.indicator`), and all beside lines whose boundary
layers the mesh does not resolve, as the estimate says nothing of these; carries the state over, and estimates the error by the mesh
cut in four (:mod:`.estimating`). The indicator ranks elements and is never taken for the error.

Rings and other lines whose nodes count alike, in equal shares of a load or in a probe's mean, are cut as a whole or not at all.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats
from taichi_membrane.errors import InputError
from taichi_membrane.names import AdaptVerdict
from taichi_membrane.scene.adapt import Adapt, adapt_of
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.accuracy import Adaption, Layer, Round
from taichi_membrane.simulation.adaptable import even_groups, surface_words
from taichi_membrane.simulation.analysis import Analysis, ProgressCallback, ready
from taichi_membrane.simulation.estimating import Again
from taichi_membrane.simulation.indicator import adjoint, indicator
from taichi_membrane.simulation.model import Model, build_model
from taichi_membrane.simulation.refined import Refined, locally_refined, refined
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.simulation.solver_choice import chosen_solver
from taichi_membrane.simulation.told_layers import unseen

# Share of the indicator whose largest contributions are refined in a round.
_SHARE = 0.5

RoundCallback = Callable[[Round], None]


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A mesh of the refinement.

    :param fine: its model on the mesh cut in four.
    :param steps: of stages up to the last one their ends, of which those before are found on earlier meshes where no gas is shut
        in; the last of them is the state that errors are told of.
    :param adjoint: (node_count, 3) of that state; None where it is singular.
    """

    model: Model
    fine: Refined
    steps: tuple[StepResult, ...]
    adjoint: Floats | None
    started: float


class Adapting:
    """The refinement of a model's mesh.

    :param told: hears of each round.
    """

    def __init__(
        self, model: Model, progress: ProgressCallback | None = None, told: RoundCallback | None = None
    ) -> None:
        asked = adapt_of(model.scene)
        assert asked is not None
        self.model, self.progress, self.told = model, progress, told
        self.asked: Adapt = asked
        self.gas = any(shut_by(model.scene, stage) for stage in model.scene.stages)
        self.rounds: list[Round] = []

    def run(self) -> tuple[Model, Adaption]:
        """The model on its refined mesh, and what became of it.

        :raises InputError: there is no tangent.
        """
        choice = chosen_solver(self.model)
        if choice.kind == "relaxation":
            raise InputError(f"mesh.adapt needs a tangent, which relaxation has none of ({choice.reason})")
        model, verdict, words = self._refine()
        if model.structure.mesh is not self.model.structure.mesh:
            model = build_model(self.model.scene, model.structure.mesh, self.model.own_probes)
        else:
            model = self.model
        adaption = Adaption(
            probe=self.asked.probe,
            surface=surface_words(self.model),
            rounds=tuple(self.rounds),
            verdict=verdict,
            told=words,
        )
        return model, adaption

    def _refine(self) -> tuple[Model, AdaptVerdict, str]:
        """Rounds until one meets the tolerance, or there is no further one; the model of the last, the verdict, and why."""
        started = time.perf_counter()
        bare = self.model.scene.model_copy(update={"cases": [], "derivatives": [], "modes": None})
        first = replace(self.model, scene=bare)
        fine = refined(first)
        work = self._work(first, fine)
        steps = list(work.steps(self.progress))
        if work.outcome != "finished" or steps[-1].limit is not None:
            return self.model, "not run to its end", f"on the first mesh: {steps[-1].reason}"
        ends = {step.stage: step for step in steps}
        here = _Mesh(first, fine, tuple(ends.values()), adjoint(work.equilibrium, self.asked.probe), started)
        while True:
            found, ranked, layers, beside = self._round(here)
            self.rounds.append(found)
            if self.told is not None:
                self.told(found)
            if found.meets and not layers:
                return here.model, "reached", ""
            if len(self.rounds) == self.asked.max_rounds:
                return here.model, *self._left(found, layers, "rounds used up", f"{len(self.rounds)} rounds")
            try:
                following = locally_refined(here.model, self._marked(ranked, found, beside), even_groups(here.model))
            except InputError as error:
                return here.model, "state lost", str(error)
            if following.model.structure.mesh.tri_count > self.asked.max_elements:
                told = f"{following.model.structure.mesh.tri_count} elements would be needed, {self.asked.max_elements} are allowed"
                return here.model, *self._left(found, layers, "elements used up", told)
            started = time.perf_counter()
            fine = refined(following.model)
            work = self._work(following.model, fine)
            again = Again(here.model, following, work, self.progress, "the refined mesh")
            wanted = {step.number for step in (here.steps if self.gas else here.steps[-1:])}
            steps = [] if self.gas else list(here.steps[:-1])
            for step, end, why in again.solved(here.steps, wanted):
                if end is None:
                    return here.model, "state lost", f"{step.stage} {step.stage_step}: {why}"
                steps.append(end)
            here = _Mesh(following.model, fine, tuple(steps), adjoint(work.equilibrium, self.asked.probe), started)

    @staticmethod
    def _work(model: Model, fine: Refined) -> Analysis:
        """An analysis of a model, in kernels in which there is room for that on its mesh cut in four."""
        for one in (fine.model, model):
            one.structure.prepare(matrix=True)
        ready(fine.model)
        return ready(model)

    def _left(
        self, found: Round, layers: Sequence[Layer], verdict: AdaptVerdict, told: str
    ) -> tuple[AdaptVerdict, str]:
        """The verdict where there is no further round."""
        if found.meets and layers:
            return (
                "layers not resolved",
                f"{told}, and the mesh does not resolve the layers of {'; '.join(found.layers)}",
            )
        if found.error is None:
            return "error not known", f"{told}; {found.unknown}"
        return verdict, told

    def _round(self, here: _Mesh) -> tuple[Round, Floats | None, tuple[Layer, ...], NDArray[np.bool_]]:
        """What a mesh tells: the round, the indicator if any, layers that it does not resolve, and the triangles beside."""
        name, last = self.asked.probe, here.steps[-1]
        layers, beside = unseen(here.model, here.steps)
        work = ready(here.fine.model)
        again = Again(here.model, here.fine, work, self.progress)
        estimate = again.estimate(here.steps, "last").steps[0]
        probe = estimate.probes.get(name)
        ranked = None
        value, mesh = last.probes[name], here.model.structure.mesh
        if probe is not None and here.adjoint is not None:
            ranked = indicator(mesh, here.adjoint, last.displacement, here.fine, work.equilibrium, name)
        found = Round(
            node_count=mesh.node_count, tri_count=mesh.tri_count, value=value, allowed=self.asked.allowed(value),
            error=None if probe is None else probe.error, fine=None if probe is None else probe.fine,
            unknown=estimate.unknown, layers=tuple(dict.fromkeys(", ".join(one.causes) for one in layers)),
            indicator=0.0 if ranked is None else float(ranked.sum()), iterations=last.iterations,
            seconds=time.perf_counter() - here.started,
        )  # fmt: skip
        return found, ranked, layers, beside

    @staticmethod
    def _marked(ranked: Floats | None, found: Round, beside: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(tri_count,) the triangles to refine: all where nothing tells which."""
        marked = beside.copy()
        if found.meets:
            return marked
        if ranked is None:
            return np.ones_like(marked)
        order = np.argsort(-ranked, kind="stable")
        share = np.cumsum(ranked[order])
        marked[order[: int(np.searchsorted(share, _SHARE * share[-1])) + 1]] = True
        return marked
