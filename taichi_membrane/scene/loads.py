"""What presses and pulls: pressures and dead loads, which stages ramp."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

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

    kind: Literal["total", "line", "area"] = "total"
    """``total`` force over nodes, ``line`` force per length of edges, ``area`` force per area."""
    group: GroupName
    """Node group (``total``, ``line``) or element group (``area``) that it acts on."""
    direction: Direction
    """Direction of the force; its length multiplies the factor."""
    spread: Literal["equal", "edges", "area"] = "equal"
    """How a total is shared out: ``equal``, or by the length of ``edges`` or the ``area`` of each node."""


class WeightLoad(Record):
    """The weight of all fabrics and cables, a dead load; stages give its factor, 1 for the weight itself.

    Each element's mass, that of its unstressed area or length, hangs in equal parts at its ends. Fabrics have ``density`` or
    ``mass_per_area``, cables ``mass_per_length``.
    """

    kind: Literal["weight"]
    """Self-weight."""
    g: Positive
    """Acceleration of gravity [length/time²], in the time unit of the masses."""
    direction: Direction = (0.0, 0.0, -1.0)
    """Direction of gravity; its length does not matter."""


def _with_kind(item: Any) -> Any:
    """A load that names no kind is a total."""
    return {"kind": "total", **item} if isinstance(item, Mapping) and "kind" not in item else item


AnyLoad = Annotated[
    Annotated[Load | WeightLoad, Field(discriminator="kind")],
    BeforeValidator(_with_kind),
]
