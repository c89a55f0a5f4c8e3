"""Values that differ from element to element: data that the mesh carries."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import Direction, GroupName, Place, Positive, Record


class ElementField(Record):
    """Values of the elements from the mesh: an array of its file's element data, or of ``Mesh.build(tri_fields=...)``."""

    field: Annotated[str, Field(min_length=1, max_length=200)]
    """Name of the array; ``check`` lists those that a mesh has."""
    scale: Positive = 1.0
    """Factor on its values, say 1e-3 from kPa to MPa."""


class WarpSource(Record):
    """Warp directions that differ from element to element; each is projected on its element. Give one of the three."""

    field: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """Array of vectors among the mesh's element data."""
    along: GroupName | None = None
    """A line: the mesh edges with both ends in a node group, or a group of line elements; the direction of its nearest piece."""
    around: Direction | None = None
    """Direction of an axis that the warp runs around, as a hoop."""
    through: Place | None = None
    """A point of the axis of ``around`` [length]; the origin without it."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if sum(one is not None for one in (self.field, self.along, self.around)) != 1:
            raise ValueError("give one of field, along and around")
        if self.around is None and self.through is not None:
            raise ValueError("through is a point of the axis of around; leave it out")
        return self


def given_text(value: float | tuple[float, ...] | ElementField) -> str:
    """A number, some numbers, or where they come from, in words."""
    if isinstance(value, ElementField):
        return f"by {value.field!r}" + ("" if value.scale == 1.0 else f" × {value.scale:g}")
    return f"{value:g}" if isinstance(value, float) else ", ".join(f"{part:g}" for part in value)
