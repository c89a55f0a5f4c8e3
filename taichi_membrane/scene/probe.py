"""What a scene measures at every load step."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import Component, Direction, GroupName, Name, Place, Record

DIFFERENTIABLE = ("displacement", "radius", "rotation", "volume")  # kinds that derivatives exist for


class DisplacementProbe(Record):
    """Mean displacement of a node group along x, y, z, or its ``magnitude``."""

    kind: Literal["displacement"]
    """Mean displacement [length]."""
    group: GroupName
    """Node group."""
    component: Literal["x", "y", "z", "magnitude"]
    """Along an axis, or its magnitude."""


class PositionProbe(Record):
    """Mean place of a node group, along an axis."""

    kind: Literal["position"]
    """Mean place [length]."""
    group: GroupName
    """Node group."""
    component: Component
    """Along an axis."""


class ReactionProbe(Record):
    """Sum of the support forces on a node group."""

    kind: Literal["reaction"]
    """Sum of support forces [force]."""
    group: GroupName
    """Node group."""
    component: Component
    """Along an axis."""


class MomentProbe(Record):
    """Moment of the support forces on a node group about an axis through a point, right-handed, on the deformed shape."""

    kind: Literal["moment"]
    """Moment of support forces [force · length]."""
    group: GroupName
    """Node group."""
    axis: Direction
    """Direction of the axis."""
    through: Place
    """A point on it [length]."""


class RotationProbe(Record):
    """Mean rotation, in degrees, of a node group about an axis through a point: least squares over its nodes."""

    kind: Literal["rotation"]
    """Mean rotation [degrees]."""
    group: GroupName
    """Node group."""
    axis: Direction
    """Direction of the axis."""
    through: Place
    """A point on it [length]."""


class RadiusProbe(Record):
    """Mean distance of a node group's deformed positions from an axis (through the group's middle), or from that middle."""

    kind: Literal["radius"]
    """Mean distance [length]."""
    group: GroupName
    """Node group."""
    axis: Component | Literal["centre"]
    """From an axis, or from the group's middle."""


class VolumeProbe(Record):
    """Volume enclosed by a closed body; for an open one, the volume swept since rest. ``pressure`` asks for one chamber's."""

    kind: Literal["volume"]
    """Enclosed, or swept, volume [length³]."""
    pressure: Name | None = None
    """Follower pressure whose chamber is meant; the whole body without it."""


class AbsoluteProbe(Record):
    """Absolute pressure of a chamber: its pressure and that outside. ``factor`` has the pressure above that outside."""

    kind: Literal["absolute_pressure"]
    """Absolute pressure [force/length²]."""
    pressure: Name
    """Pressure, with ``ambient``, whose chamber is meant."""


class LevelProbe(Record):
    """Height of a liquid's level above its floor, given or following its volume."""

    kind: Literal["level"]
    """Height of a level [length]."""
    load: Name
    """Load of kind ``water`` that is meant."""


class StressProbe(Record):
    """Extreme or area-mean principal stress (second Piola–Kirchhoff, on the unstressed fabric) of an element group."""

    kind: Literal["stress"]
    """Principal stress, second Piola–Kirchhoff [force/length²]."""
    group: GroupName = "all"
    """Element group."""
    which: Literal["major", "minor"] = "major"
    """Major or minor one."""
    reduce: Literal["max", "min", "mean"] = "max"
    """Extreme or area mean."""


class ResultantProbe(Record):
    """Extreme or area-mean stress resultant, force per width, of an element group."""

    kind: Literal["resultant"]
    """Stress resultant [force/length]."""
    group: GroupName = "all"
    """Element group."""
    which: Literal["major", "minor", "warp", "weft", "shear"] = "major"
    """Principal ones, or along the fabric: ``warp``, ``weft``, and ``shear``."""
    measure: Literal["Cauchy", "PK2"] = "Cauchy"
    """``Cauchy``: per deformed width, along the deformed warp or weft; ``PK2``: second Piola–Kirchhoff stress times thickness at
    rest, per unstressed width."""
    reduce: Literal["max", "min", "mean"] = "max"
    """Extreme or area mean."""


class UtilisationProbe(Record):
    """Largest utilisation of an element group, whose fabrics all have a strength: Cauchy resultant times factor on effects, over
    strength over safety factor; in warp and weft, or of the major resultant."""

    kind: Literal["utilisation"]
    """Largest utilisation, 1 where a strength over its safety factor is reached."""
    group: GroupName = "all"
    """Element group."""


class FactorProbe(Record):
    """Value of a load's, motion's or pressure's factor, such as ``load.tip``: what a run that stops at collapse, or follows the
    equilibrium path, found."""

    kind: Literal["factor"]
    """Value of a driver."""
    of: Annotated[str, Field(pattern=r"^\w+\.\w+$")]
    """``load.NAME``, ``motion.NAME``, ``pressure.NAME``, ``amount.NAME`` or ``ambient.NAME``."""


class AreaProbe(Record):
    """Share (0 to 1) of an element group's area that is in a state."""

    kind: Literal["area_share"]
    """Share of area, 0 to 1."""
    group: GroupName = "all"
    """Element group."""
    state: Literal["taut", "wrinkled", "slack"] = "wrinkled"
    """State that counts."""


class DrainageProbe(Record):
    """Whether water runs off a roof: the least slope of an element group, or the depth of the water that would stand in its hollows
    after any amount of rain, on the shape as it is (the water's own weight, which may deepen them, is a load of kind ``water``).
    Water leaves at the edges where the group ends."""

    kind: Literal["drainage"]
    """Least slope [degrees], or depth of standing water [length]."""
    group: GroupName
    """Element group of the roof."""
    of: Literal["slope", "depth"]
    """``slope`` of the flattest element against the horizontal [degrees]; largest ``depth`` of standing water [length], 0 where all
    runs off."""
    up: Direction = (0.0, 0.0, 1.0)
    """Against gravity."""


class CableProbe(Record):
    """Force, length, or slack share of a cable of the scene."""

    kind: Literal["cable"]
    """Force [force], length [length], or slack share of a cable."""
    cable: Name
    """Name of the cable."""
    what: Literal["force", "length", "slack"] = "force"
    """``force`` of its elements, tension positive; present ``length`` of all of them; ``slack``, the share (0 to 1) of its length
    in the mesh whose elements bear nothing."""
    reduce: Literal["max", "min", "mean"] = "max"
    """Extreme force, or the mean over its length in the mesh."""


class ContactProbe(Record):
    """What a plane or an obstacle of the scene does to the structure, or walls to each other."""

    kind: Literal["contact"]
    """Of an obstacle or a plane."""
    obstacle: Name
    """Name of the obstacle or plane; ``contact`` for walls that touch each other."""
    group: GroupName = "all"
    """Nodes that are looked at: of walls that touch each other the resultant on all of them is zero."""
    of: Literal["force", "area", "pressure"] = "force"
    """Resultant ``force`` on the structure, with friction [force]; ``area`` of the nodes in contact, a third of each element around
    [length²]; largest ``pressure``, what a node is pushed with across the obstacle over its area [force/length²]."""
    component: Literal["x", "y", "z", "magnitude"] = "magnitude"
    """Of the force: along an axis, or its magnitude."""


class BodyProbe(Record):
    """What a rigid body does: displacement of its centre, rotation, and what its supports and motions push with."""

    kind: Literal["body"]
    """Of a rigid body."""
    body: Name
    """Name of the body."""
    of: Literal["displacement", "rotation", "force", "moment"]
    """``displacement`` of the centre [length], ``rotation`` as a vector along its axis [degrees, up to 180], or resultant
    ``force`` [force] and ``moment`` about the present centre [force · length] of what holds and moves the body."""
    component: Literal["x", "y", "z", "magnitude"]
    """Along an axis, or its magnitude."""


Probe = Annotated[
    DisplacementProbe
    | PositionProbe
    | ReactionProbe
    | MomentProbe
    | RotationProbe
    | RadiusProbe
    | VolumeProbe
    | AbsoluteProbe
    | LevelProbe
    | StressProbe
    | ResultantProbe
    | UtilisationProbe
    | FactorProbe
    | AreaProbe
    | DrainageProbe
    | CableProbe
    | BodyProbe
    | ContactProbe,
    Field(discriminator="kind"),
]
