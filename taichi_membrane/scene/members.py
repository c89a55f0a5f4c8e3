"""What acts beside the fabric: cables, and planes that the structure may touch."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import MOST, Direction, Finite, GroupName, Positive, Record, Vector


class Cable(Record):
    """Straight two-node elements with the force T = prestress + EA (l - L)/L.

    They run along the mesh edges whose both ends are in a node group (``along``), along a group of line elements of the mesh
    (``lines``), or from node to node (``nodes``), each named by a group that holds it alone.
    """

    along: GroupName | None = None
    """Node group: every mesh edge with both ends in it is an element."""
    lines: GroupName | None = None
    """Group of line elements of the mesh; their loose points become nodes."""
    nodes: Annotated[list[GroupName], Field(min_length=2, max_length=MOST)] | None = None
    """Node groups of one node each: an element from each to the next."""
    EA: Positive
    """Modulus times cross section [force]."""
    prestress: Finite = 0.0
    """Force at the unstressed length [force]."""
    unstressed: Positive = 1.0
    """Unstressed length L over the distance of the nodes in the mesh."""
    mass_per_length: Annotated[Finite, Field(ge=0)] = 0.0
    """Mass per unstressed length [force · time²/length²], for self-weight."""
    kind: Literal["cable", "bar"] = "cable"
    """A ``cable`` goes slack, a ``bar`` bears compression as well."""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if sum(place is not None for place in (self.along, self.lines, self.nodes)) != 1:
            raise ValueError("give one of along, lines and nodes")
        return self


class Plane(Record):
    """A rigid plane that nodes touch without friction and do not pass."""

    through: Vector
    """A point of it."""
    normal: Direction
    """Direction of its normal, to the side where the structure is."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
