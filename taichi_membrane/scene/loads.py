"""What presses and pulls: pressures and dead loads, which stages ramp."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import MOST, Direction, GroupName, Positive, Record


class Pressure(Record):
    """A surface that pressure acts on, by element groups.

    It acts along the normals of ``group`` and against those of ``against``. A wall between two chambers, whose normals point from
    one into the other, is in ``group`` of the first and in ``against`` of the second.
    ``follower`` pressure stays normal to the moving surface; ``fixed`` keeps direction and size of the unstressed shape. Pressures
    are above ``ambient``, the absolute pressure outside, which only stages that shut the valve (``closed``) need; the gas then
    keeps p_abs Vⁿ with n = ``exponent``: 1 at constant temperature, 1.4 for air that exchanges no heat.
    """

    group: GroupName | Annotated[list[GroupName], Field(max_length=MOST)] = "all"
    """Element groups along whose normals it acts; ``all`` is every element."""
    against: GroupName | Annotated[list[GroupName], Field(max_length=MOST)] = []
    """Element groups against whose normals it acts: walls whose normals point into the chamber."""
    kind: Literal["follower", "fixed"] = "follower"
    """``follower`` stays normal to the moving surface, ``fixed`` keeps direction and size of the unstressed shape."""
    ambient: Positive | None = None
    """Absolute pressure outside [force/length²], for stages that shut the valve."""
    exponent: Annotated[float, Field(ge=1, le=2)] = 1.0
    """Exponent n of p_abs Vⁿ in a shut chamber: 1 isothermal, 1.4 adiabatic air."""


class Load(Record):
    """A dead load of unit factor; stages multiply it.

    ``kind``: ``total`` spreads a force over the nodes of a group, ``line`` is force per length along the mesh edges whose both
    ends are in the node group, ``area`` is force per area of an element group. ``direction`` need not be a unit vector.
    ``spread`` of a total: ``equal`` shares, or by the length of ``edges`` or the ``area`` that belongs to each node.
    """

    group: GroupName
    """Node group (``total``, ``line``) or element group (``area``) that it acts on."""
    direction: Direction
    """Direction of the force; its length multiplies the factor."""
    kind: Literal["total", "line", "area"] = "total"
    """``total`` force over nodes, ``line`` force per length of edges, ``area`` force per area."""
    spread: Literal["equal", "edges", "area"] = "equal"
    """How a total is shared out: ``equal``, or by the length of ``edges`` or the ``area`` of each node."""
