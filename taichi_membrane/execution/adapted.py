"""Finer meshes of a run: refined before its load steps are solved, and cut in four to estimate errors, where that is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_membrane.scene.adapt import adapt_of

if TYPE_CHECKING:
    from taichi_membrane.execution.observer import Clock
    from taichi_membrane.simulation.accuracy import Adaption, Round
    from taichi_membrane.simulation.model import Model
    from taichi_membrane.simulation.refined import Refined
    from taichi_membrane.simulation.results import Settings


def check_adaptable(model: Model) -> None:
    """Refuse what a mesh cannot be refined for, where the scene asks for that.

    :raises InputError: a state that is not carried over, loads or a probe that an uneven mesh would change.
    """
    if adapt_of(model.scene) is not None:
        from taichi_membrane.simulation.adaptable import check

        check(model)


def adapted(model: Model, clock: Clock) -> tuple[Model, Adaption | None]:
    """The model on its refined mesh, and what became of the refinement; as it was, and None, where the scene asks for none."""
    asked = adapt_of(model.scene)
    if asked is None:
        return model, None
    from taichi_membrane.output.tables import round_text
    from taichi_membrane.simulation.adapting import Adapting

    def told(found: Round) -> None:
        clock.observer.phase(f"mesh of {found.tri_count} elements: {round_text(model.scene, asked.probe, found)}")

    with clock.phase("adapt", "refining the mesh"):
        return Adapting(model, clock.progress, told).run()


def refined_for(model: Model, settings: Settings) -> Refined | None:
    """The model on its mesh cut in four, where errors are to be estimated.

    :raises InputError: it cannot be.
    """
    if not settings.estimate:
        return None
    from taichi_membrane.simulation.refined import refined

    return refined(model)
