"""What holds or moves a structure: supports and prescribed motions."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from taichi_membrane.scene.base import Direction, GroupName, Record, Vector


def _distinct(value: str) -> str:
    """Refuse a list of components that names one twice."""
    if len(set(value)) != len(value):
        raise ValueError(f"a component is named twice in {value!r}")
    return value


Components = Annotated[str, Field(pattern=r"^[xyz]{1,3}$"), AfterValidator(_distinct)]


class Support(Record):
    """Displacement components of a node group that are held at zero: some of x, y, z, or the one along ``normal``.

    ``normal`` makes a plane of symmetry of any direction: the nodes slide in it.
    """

    group: GroupName
    """Node group."""
    hold: Components | None = None
    """Which of x, y, z are held."""
    normal: Direction | None = None
    """Direction along which nodes are held: a plane of symmetry."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.hold is None) == (self.normal is None):
            raise ValueError("give either hold (some of x, y, z) or normal (a direction)")
        return self


class Translation(Record):
    """A prescribed motion: the named components of a node group move by the stage's factor times ``direction``."""

    kind: Literal["translation"]
    """A translation."""
    group: GroupName
    """Node group."""
    direction: Vector
    """Displacement at factor 1 [length]."""
    hold: Components = "xyz"
    """Components that are prescribed; the others stay free."""


class Rotation(Record):
    """A prescribed motion: a node group turns rigidly by the stage's factor, in degrees, about an axis; finite angles.

    Only the components in ``hold`` are prescribed; the others stay free.
    """

    kind: Literal["rotation"]
    """A rigid rotation."""
    group: GroupName
    """Node group."""
    axis: Direction
    """Direction of the axis, right-handed."""
    through: Vector
    """A point on it."""
    hold: Components = "xyz"
    """Components that are prescribed; the others stay free."""


Motion = Annotated[Translation | Rotation, Field(discriminator="kind")]
