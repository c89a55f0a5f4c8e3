"""What acts beside the fabric: cables with their anchors, springs, and planes that the structure may touch."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import (
    MOST,
    Direction,
    Force,
    Friction,
    GroupName,
    MassPerLengthFromZero,
    PerLengthFromZero,
    Place,
    Positive,
    PositiveForce,
    PositiveLength,
    PositivePerLength,
    Record,
)


class Cable(Record):
    """Straight two-node elements with the force T = prestress + EA (l - L)/L.

    They run along the mesh edges whose both ends are in a node group (``along``), along a group of line elements of the mesh
    (``lines``), or from node to node (``nodes``), each named by a group that holds it alone, an anchor or a joint.
    A spring between two nodes is a ``bar`` with EA its stiffness times its unstressed length.
    """

    along: GroupName | None = None
    """Node group: every mesh edge with both ends in it is an element."""
    lines: GroupName | None = None
    """Group of line elements of the mesh; their loose points become nodes."""
    nodes: Annotated[list[GroupName], Field(min_length=2, max_length=MOST)] | None = None
    """Node groups of one node each, anchors or joints: an element from each to the next."""
    parts: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Elements from each of ``nodes`` to the next; their new nodes are the node group of the cable's name."""
    sliding: bool = False
    """The cable runs over its inner ``nodes`` without friction: one force all along. Closed where the last node is the first."""
    EA: PositiveForce
    """Modulus times cross section [force]."""
    force: PositiveForce | None = None
    """Force in the shape that a stage of kind ``form_find`` finds [force]; it decides the unstressed length."""
    force_density: PositivePerLength | None = None
    """Force over length of each element in that shape, in place of ``force`` [force/length]."""
    prestress: Force = 0.0
    """Force at the unstressed length [force]."""
    unstressed: Positive | None = None
    """Unstressed length L over the distance of the nodes in the mesh; 1 without it and ``length``."""
    length: PositiveLength | None = None
    """Unstressed length of the whole cable, in place of ``unstressed`` [length]; elements share it by their lengths in the mesh."""
    mass_per_length: MassPerLengthFromZero = 0.0
    """Mass per unstressed length [force · time²/length²], for self-weight."""
    kind: Literal["cable", "bar"] = "cable"
    """A ``cable`` goes slack, a ``bar`` bears compression as well."""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if sum(place is not None for place in (self.along, self.lines, self.nodes)) != 1:
            raise ValueError("give one of along, lines and nodes")
        if self.unstressed is not None and self.length is not None:
            raise ValueError("give one of unstressed (a ratio) and length")
        if self.parts > 1 and self.nodes is None:
            raise ValueError(f"parts = {self.parts} needs nodes: mesh edges and line elements are not divided")
        self._check_force()
        if self.sliding:
            self._check_sliding()
        return self

    def _check_force(self) -> None:
        asked = [key for key in ("force", "force_density") if getattr(self, key) is not None]
        if len(asked) > 1:
            raise ValueError("give one of force and force_density")
        extra = [key for key in ("unstressed", "length", "prestress") if getattr(self, key)]
        if asked and extra:
            raise ValueError(f"{asked[0]} decides the unstressed length; leave out {', '.join(extra)}")
        if self.force_density is not None and self.sliding:
            raise ValueError("sliding = true needs force, not force_density: it has one force all along")

    def _check_sliding(self) -> None:
        if self.nodes is None or len(self.nodes) < 3:
            raise ValueError("sliding = true needs nodes, three at least: it slides over those between its ends")
        if self.kind == "bar":
            raise ValueError("sliding = true needs kind 'cable': a bar does not run over pulleys")
        if self.parts > 1:
            raise ValueError(f"sliding = true and parts = {self.parts}: nothing would hold the nodes between")
        ways = self.nodes[:-1] if self.nodes[-1] == self.nodes[0] else self.nodes
        twice = next((name for number, name in enumerate(ways) if name in ways[:number]), None)
        if twice is not None or len(ways) < 3:
            raise ValueError(
                f"sliding = true: it passes {twice or self.nodes[0]!r} twice; only its two ends may be one"
            )


class Spring(Record):
    """A spring from each node of a group to the ground, slack at rest; its force is a support force.

    Give ``stiffness`` along x, y and z, or one number and ``direction``. It turns with nothing: its direction stays.
    """

    group: GroupName
    """Node group."""
    stiffness: PositivePerLength | tuple[PerLengthFromZero, PerLengthFromZero, PerLengthFromZero]
    """Of each node's spring, along ``direction`` or along x, y, z [force/length]."""
    direction: Direction | None = None
    """From the ground to the node, of a spring along one direction."""
    kind: Literal["both", "tension", "compression"] = "both"
    """What it bears: both, ``tension`` where nodes move along ``direction``, or ``compression`` where they move against it."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if isinstance(self.stiffness, tuple) == (self.direction is not None):
            raise ValueError("give stiffness as three numbers, or as one number with a direction")
        if isinstance(self.stiffness, tuple) and not any(self.stiffness):
            raise ValueError("stiffness = [0, 0, 0] is no spring")
        if self.kind != "both" and self.direction is None:
            raise ValueError(f"kind = {self.kind!r} needs a direction: one number as stiffness, and direction")
        return self


class Plane(Record):
    """A rigid plane that nodes touch and do not pass; what touches it at rest may lie on it by weight."""

    through: Place
    """A point of it [length]."""
    normal: Direction
    """Direction of its normal, to the side where the structure is."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
