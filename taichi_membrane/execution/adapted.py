"""A run's mesh refined before its load steps are solved, where its scene asks for that."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_membrane.scene.adapt import adapt_of

if TYPE_CHECKING:
    from taichi_membrane.execution.observer import Clock
    from taichi_membrane.simulation.accuracy import Adaption, Round
    from taichi_membrane.simulation.model import Model


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
