"""A mesh that is refined until a probe's error is small enough."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import Name, Positive, Record
from taichi_membrane.scene.probe import DIFFERENTIABLE

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


class Adapt(Record):
    """Refine the mesh, where the error of a probe at the end of the last stage comes from, until its estimate meets a tolerance.

    Each round bisects triangles, carries the state over, and estimates the error by the mesh cut in four. One of ``tolerance`` and
    ``absolute`` is given. Beside lines with a boundary layer that the mesh does not see the estimate tells nothing: triangles there
    are bisected first. Load steps are then solved on the mesh so found. What is not reached is told, and ends with exit code 1.
    """

    probe: Name
    """Probe whose error is meant: of kind ``displacement``, ``radius``, ``rotation`` or ``volume``."""
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Error allowed, as a share of the probe's value."""
    absolute: Positive | None = None
    """Error allowed, in the probe's unit."""
    max_elements: Annotated[int, Field(ge=1, le=2_000_000)] = 20_000
    """Elements of the mesh at most; that cut in four has four times as many."""
    max_rounds: Annotated[int, Field(ge=1, le=40)] = 12
    """Meshes at most, the first among them."""

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("one of tolerance and absolute is needed, and no more")
        return self

    def allowed(self, value: float) -> float:
        """Error allowed of a value."""
        return self.absolute if self.absolute is not None else (self.tolerance or 0.0) * abs(value)


def adapt_of(scene: Scene) -> Adapt | None:
    """What a scene's mesh is refined for, where it is."""
    found = getattr(scene.mesh, "adapt", None)
    return found if isinstance(found, Adapt) else None


def check(scene: Scene) -> None:
    """Refuse what a mesh cannot be refined for.

    :raises ValueError: with the key.
    """
    asked = adapt_of(scene)
    if asked is None:
        return
    if asked.probe not in scene.probes:
        raise ValueError(
            f"mesh.adapt.probe = {asked.probe!r} is not a probe; allowed: {', '.join(scene.probes) or 'none'}"
        )
    if scene.probes[asked.probe].kind not in DIFFERENTIABLE:
        raise ValueError(
            f"mesh.adapt.probe: {asked.probe!r} is of kind {scene.probes[asked.probe].kind!r}; allowed: {', '.join(DIFFERENTIABLE)}"
        )
    if scene.solver.kind == "relaxation":
        raise ValueError("mesh.adapt needs the tangent of solver.kind 'hybrid' or 'newton'")
    last = scene.stages[-1]
    if last.control == "arc_length":
        raise ValueError(f"mesh.adapt: of a stage by arc length ({last.key}.control) is not implemented")
