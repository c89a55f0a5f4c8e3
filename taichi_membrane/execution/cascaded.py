"""A run's load steps by a cascade from coarse to fine meshes, where that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from taichi_membrane.errors import InputError
from taichi_membrane.scene.adapt import adapt_of

if TYPE_CHECKING:
    from taichi_membrane.execution.observer import Clock
    from taichi_membrane.simulation.accuracy import Cascade
    from taichi_membrane.simulation.analysis import Analysis
    from taichi_membrane.simulation.model import Model
    from taichi_membrane.simulation.refined import Refined
    from taichi_membrane.simulation.results import StepResult


def cascade_of(model: Model, count: int) -> Sequence[Refined]:
    """The models on finer meshes that load steps are carried over to; none where no cascade is asked for.

    :raises InputError: their states cannot be carried over.
    """
    if not count:
        return ()
    if adapt_of(model.scene) is not None:
        raise InputError(
            "cascade: of a mesh that is refined for a probe (mesh.adapt) is not implemented: its meshes are one"
        )
    if count < 0:
        raise InputError(f"cascade = {count} must not be below 0")
    from taichi_membrane.simulation.cascade import levels

    return levels(model, count)


def stepping(
    work: Analysis, coarse: Model, chain: Sequence[Refined], clock: Clock, done: Sequence[StepResult]
) -> tuple[Iterator[StepResult], Callable[[], Cascade | None]]:
    """The load steps of a run, and how it came from coarse meshes to its own, once they are done.

    :param work: an analysis of the model that is run.
    """
    if not chain:
        return work.steps(clock.progress, done=done), lambda: None
    from taichi_membrane.simulation.cascade import Cascading

    cascading = Cascading(coarse, list(chain), clock.progress)
    return cascading.steps(), lambda: cascading.told
