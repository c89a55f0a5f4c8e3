"""What a scene measures at every load step."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import Component, Direction, GroupName, Record, Vector


class DisplacementProbe(Record):
    """Mean displacement of a node group along x, y, z, or its ``magnitude``."""

    kind: Literal["displacement"]
    group: GroupName
    component: Literal["x", "y", "z", "magnitude"]


class ReactionProbe(Record):
    """Sum of the support forces on a node group."""

    kind: Literal["reaction"]
    group: GroupName
    component: Component


class MomentProbe(Record):
    """Moment of the support forces on a node group about an axis through a point, right-handed, on the deformed shape."""

    kind: Literal["moment"]
    group: GroupName
    axis: Direction
    through: Vector


class RotationProbe(Record):
    """Mean rotation, in degrees, of a node group about an axis through a point: least squares over its nodes."""

    kind: Literal["rotation"]
    group: GroupName
    axis: Direction
    through: Vector


class RadiusProbe(Record):
    """Mean distance of a node group's deformed positions from an axis (through the group's middle), or from that middle."""

    kind: Literal["radius"]
    group: GroupName
    axis: Component | Literal["centre"]


class VolumeProbe(Record):
    """Volume enclosed by a closed body; for an open one, the volume swept since rest."""

    kind: Literal["volume"]


class StressProbe(Record):
    """Extreme or area-mean principal stress of an element group."""

    kind: Literal["stress"]
    group: GroupName = "all"
    which: Literal["major", "minor"] = "major"
    reduce: Literal["max", "min", "mean"] = "max"


class FactorProbe(Record):
    """Value of a load's, motion's or pressure's factor, such as ``load.tip``: what a run that stops at collapse, or follows the
    equilibrium path, found."""

    kind: Literal["factor"]
    of: Annotated[str, Field(pattern=r"^(load|motion|pressure)\.\w+$")]


class AreaProbe(Record):
    """Share (0 to 1) of an element group's area that is in a state."""

    kind: Literal["area_share"]
    group: GroupName = "all"
    state: Literal["taut", "wrinkled", "slack"] = "wrinkled"


Probe = Annotated[
    DisplacementProbe
    | ReactionProbe
    | MomentProbe
    | RotationProbe
    | RadiusProbe
    | VolumeProbe
    | StressProbe
    | FactorProbe
    | AreaProbe,
    Field(discriminator="kind"),
]
