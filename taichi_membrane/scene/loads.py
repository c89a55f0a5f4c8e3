"""What presses and pulls: pressures and dead loads, which stages ramp."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from taichi_membrane.scene.base import (
    MOST,
    Direction,
    Finite,
    ForceVector,
    GroupName,
    MomentVector,
    Name,
    Place,
    PositiveAcceleration,
    PositivePerVolume,
    PositiveStress,
    Record,
)
from taichi_membrane.scene.element_field import ElementField

Groups = GroupName | Annotated[list[GroupName], Field(max_length=MOST)]


class Pressure(Record):
    """A surface that pressure acts on, by element groups.

    It acts along the normals of ``group`` and against those of ``against``. A wall between two chambers, whose normals point from
    one into the other, is in ``group`` of the first and in ``against`` of the second.
    ``follower`` pressure stays normal to the moving surface; ``fixed`` keeps direction and size of the unstressed shape. Pressures
    are above ``ambient``, the absolute pressure outside, which only stages that shut the valve (``closed``, ``amount``) need: the
    gas then keeps p_abs Vⁿ with n = ``exponent``, 1 at constant temperature, 1.4 for air that exchanges no heat. Its amount is the
    volume A that it would have at the pressure ``ambient``: p_abs Vⁿ = ambient Aⁿ. Several closed surfaces in one ``group`` are
    joined for good: one gas fills them all; a stage joins those of several pressures (``joined``).
    """

    group: Groups = "all"
    """Element groups along whose normals it acts; ``all`` is every element."""
    against: Groups = []
    """Element groups against whose normals it acts: walls whose normals point into the chamber."""
    kind: Literal["follower", "fixed"] = "follower"
    """``follower`` stays normal to the moving surface, ``fixed`` keeps direction and size of the unstressed shape."""
    ambient: PositiveStress | None = None
    """Absolute pressure outside [force/length²], for stages that shut the valve, until a stage changes it; amounts refer to it."""
    exponent: Annotated[float, Field(ge=1, le=2)] = 1.0
    """Exponent n of p_abs Vⁿ in a shut chamber: 1 isothermal, 1.4 adiabatic air."""
    relief: PositiveStress | None = None
    """Pressure at which a relief valve lets gas out of a shut chamber, which never has more [force/length²]; none without it."""


class Load(Record):
    """A dead load of unit factor; stages multiply it.

    ``kind``: ``total`` spreads a force over the nodes of a group, ``line`` is force per length along the mesh edges whose both
    ends are in the node group, ``area`` is force per area of an element group. ``direction`` need not be a unit vector.
    ``spread`` of a total: ``equal`` shares, or by the length of ``edges`` or the ``area`` that belongs to each node. With six-node
    triangles ``edges`` is what is even along a line: there two thirds of it act on the nodes amid sides.
    """

    kind: Literal["total", "line", "area"] = "total"
    """``total`` force over nodes, ``line`` force per length of edges, ``area`` force per area."""
    group: GroupName
    """Node group (``total``, ``line``) or element group (``area``) that it acts on."""
    direction: Direction
    """Direction of the force; its length multiplies the factor."""
    spread: Literal["equal", "edges", "area"] = "equal"
    """How a total is shared out: ``equal``, or by the length of ``edges`` or the ``area`` of each node."""

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        return self.group

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return self.direction


class WeightLoad(Record):
    """The weight of all fabrics and cables, a dead load; stages give its factor, 1 for the weight itself.

    Each element's mass, that of its unstressed area or length, hangs in equal parts at its ends. Fabrics have ``density`` or
    ``mass_per_area``, cables ``mass_per_length``.
    """

    kind: Literal["weight"]
    """Self-weight."""
    g: PositiveAcceleration
    """Acceleration of gravity [length/time²], in the time unit of the masses."""
    direction: Direction = (0.0, 0.0, -1.0)
    """Direction of gravity; its length does not matter."""

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        return "all"

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return self.direction


class SnowLoad(Record):
    """A load on each unit of plan area, the area seen along ``direction``; stages give its size [force/length²].

    It keeps its direction and follows the present plan area of the elements whose outer side, to which their normals point, faces
    it; one that turns over bears nothing. Such loads have no potential: there is no energy and no saddle is left, and no modes.
    """

    kind: Literal["snow"]
    """A load per plan area."""
    group: Groups = "all"
    """Element groups that it lies on."""
    direction: Direction = (0.0, 0.0, -1.0)
    """Direction of the force, one for all snow of a scene; its length does not matter."""

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        return self.group if isinstance(self.group, str) else ", ".join(self.group)

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return self.direction


class WindTable(Record):
    """Pressure coefficients of a round shell over the angle from the windward side: ``angles`` with ``cp``, or ``flow``.

    Between the angles they are linear.

    The angle is that between the direction the wind comes from and the radius to an element's centre on the unstressed shape: from
    ``centre`` for a sphere, square to ``axis`` for a cylinder, standing or lying.
    """

    angles: Annotated[list[Annotated[float, Field(ge=0, le=180)]], Field(min_length=2, max_length=MOST)] = []
    """Angles from the windward side, ascending [degrees]."""
    cp: Annotated[list[Finite], Field(min_length=2, max_length=MOST)] = []
    """Coefficient at each angle; suction is negative."""
    flow: Literal["potential"] | None = None
    """``potential``: flow without friction, the ideal, in place of a table: 1 - 9/4 sin² of the angle on a sphere, 1 - 4 sin² on a
    cylinder, of the wind across its axis. Real wind separates behind; here there is no drag."""
    direction: Direction
    """Direction that the wind blows in."""
    centre: Place
    """Centre of the sphere, or a point of the cylinder's axis [length]."""
    axis: Direction | None = None
    """Direction of the cylinder's axis; a sphere without it."""
    group: GroupName = "all"
    """Element group that it blows on."""

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if bool(self.angles or self.cp) == (self.flow is not None):
            raise ValueError("give either angles with cp, or flow = 'potential'")
        if len(self.angles) != len(self.cp):
            raise ValueError(f"{len(self.angles)} angles, but {len(self.cp)} values of cp; each angle needs one")
        for low, high in zip(self.angles[:-1], self.angles[1:], strict=True):
            if not low < high:
                raise ValueError(f"angles must ascend, but {high:g} follows {low:g}")
        return self


class WindLoad(Record):
    """Wind by pressure coefficients, as pressure cp q along the moving normal; stages give its factor, 1 for q itself.

    Coefficients are those of element groups or of the mesh's element data (``cp``), or of a round shell over the angle from the
    windward side (``table``). A positive one presses on the ``front``, the side that the normals point to, or on the ``back``;
    suction is negative. It adds to the pressures of chambers.
    """

    kind: Literal["wind"]
    """Wind by pressure coefficients."""
    q: PositiveStress
    """Velocity pressure [force/length²]."""
    cp: ElementField | Annotated[dict[GroupName, Finite], Field(max_length=MOST)] = {}
    """Coefficient of each element group, where that of ``all`` is for what no other group holds; or ``{ field = "NAME" }``."""
    table: WindTable | None = None
    """Coefficients over the angle, or those of potential flow, in place of ``cp``."""
    face: Literal["front", "back"] = "front"
    """Side of the elements that it presses on: ``front``, which their normals point to, or ``back``, as inside pressure does."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.cp) == (self.table is not None):
            raise ValueError("give either cp, a coefficient for each element group or their field, or table")
        return self

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        if self.table is not None:
            return self.table.group
        return "all" if isinstance(self.cp, ElementField) else ", ".join(self.cp)

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return None if self.table is None else self.table.direction


class WaterLoad(Record):
    """A liquid that stands on one side of the surface; stages give the height of its level above ``floor`` [length].

    It presses along the moving normal with its specific weight times the present depth below the level; what lies above the level
    is dry. At level zero, where it is until a stage raises it, everything has to be dry at rest. By arc length it rises from a
    level that wets something. ``given = "volume"``: stages give the volume of the liquid [length³], one level for all of the
    group; it stands over the group's elements alone, as if a wall stood on their rim, which has to be held or to move in vertical
    planes that it lies in.
    """

    kind: Literal["water"]
    """A standing liquid."""
    specific_weight: PositivePerVolume
    """Weight per volume [force/length³]."""
    given: Literal["level", "volume"] = "level"
    """What stages give: the height of the ``level``, or the ``volume``, whose level follows the moving surface."""
    face: Literal["front", "back"] = "back"
    """Side of the elements that it stands on: ``front``, which their normals point to, or ``back``, the inside of a body."""
    group: Groups = "all"
    """Element groups that it wets."""
    floor: Place = (0.0, 0.0, 0.0)
    """A point at the height where the level is zero [length]; no element of the group lies below it at rest."""
    up: Direction = (0.0, 0.0, 1.0)
    """Direction upwards; its length does not matter."""

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        return self.group if isinstance(self.group, str) else ", ".join(self.group)

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return None


class BodyLoad(Record):
    """A force and a moment on a rigid body, at factor 1; stages multiply them.

    The force keeps its direction and stays at its point of the body. A ``dead`` moment is that of forces at the body's nodes that
    keep their directions: it is ``moment`` while the body has not turned, and falls with the cosine of an angle about itself. An
    ``axial`` one keeps size and direction, which has a potential only where its axis is the one that the body may turn about; its
    energy counts angles from -180 to 180 degrees.
    """

    kind: Literal["body"]
    """A force and a moment on a rigid body."""
    body: Name
    """Name of the body."""
    force: ForceVector = (0.0, 0.0, 0.0)
    """Force at factor 1 [force]."""
    at: Place | None = None
    """Point of the unstressed body at which the force acts [length], in the plane or line of nodes that lie in one; the centre
    without it."""
    moment: MomentVector = (0.0, 0.0, 0.0)
    """Moment at factor 1, right-handed [force · length]."""
    couple: Literal["dead", "axial"] = "dead"
    """What the moment does where the body turns: ``dead`` as forces that keep their directions, ``axial`` stays as it is."""

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not any(self.force) and not any(self.moment):
            raise ValueError("give a force or a moment other than zero")
        return self

    @property
    def acts_on(self) -> str:
        """Groups that it acts on, in words."""
        return self.body

    @property
    def towards(self) -> tuple[float, float, float] | None:
        """The direction that it is given by, if any."""
        return self.force if any(self.force) else self.moment


def _with_kind(item: Any) -> Any:
    """A load that names no kind is a total."""
    return {"kind": "total", **item} if isinstance(item, Mapping) and "kind" not in item else item


AnyLoad = Annotated[
    Annotated[Load | WeightLoad | SnowLoad | WindLoad | WaterLoad | BodyLoad, Field(discriminator="kind")],
    BeforeValidator(_with_kind),
]
