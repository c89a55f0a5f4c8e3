"""What changes the stress-free size of the fabric: shrinkage and temperature, which stages ramp."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import MOST, Finite, GroupName, Record

Groups = GroupName | Annotated[list[GroupName], Field(max_length=MOST)]


class Shrinkage(Record):
    """A loss of the stress-free length along warp and weft; stages give its factor, 1 for the shares given here.

    A free element shortens by exactly this, one that is held is stressed. Shrinkages and temperatures of an element add up.
    """

    group: Groups = "all"
    """Element groups that shrink."""
    warp: Finite = 0.0
    """Share of its length that the fabric loses along the warp at factor 1; less than zero where it grows."""
    weft: Finite = 0.0
    """The same along the weft."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.warp == self.weft == 0.0:
            raise ValueError("give warp, weft, or both: the share of its length that the fabric loses")
        return self


class Temperature(Record):
    """A change of temperature; stages give its degrees. Fabrics answer by their ``expansion``, cables do not."""

    group: Groups = "all"
    """Element groups that are warmed."""
