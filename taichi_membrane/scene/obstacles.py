"""Rigid obstacles beside planes, which stages may move: what nodes touch and do not pass."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import (
    Direction,
    Friction,
    GroupName,
    LengthFromZero,
    Place,
    Positive,
    PositiveLength,
    Record,
    Vector,
)

_MOST_FACETS = 200_000
_ALONG = 1e-6  # how far two axes may be off the right angle


# The name that contact of walls with each other has among what is touched.
WALLS = "contact"


class WallContact(Record):
    """Walls that touch each other, without friction, and do not pass through each other."""

    group: GroupName | Annotated[list[GroupName], Field(min_length=1, max_length=100)] = "all"
    """Elements that touch each other, by group or groups; ``all`` is every element."""


class PlaneObstacle(Record):
    """A rigid plane that a stage may move."""

    kind: Literal["plane"]
    """The obstacle is a plane."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    direction: Direction | None = None
    """Displacement at value 1 of its motion, which stages set in ``obstacles``; without it the obstacle stays."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
    through: Place
    """A point of it [length]."""
    normal: Direction
    """Direction of its normal, to the side where the structure is."""


class SphereObstacle(Record):
    """A rigid sphere, solid or hollow."""

    kind: Literal["sphere"]
    """The obstacle is a sphere."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    direction: Direction | None = None
    """Displacement at value 1 of its motion, which stages set in ``obstacles``; without it the obstacle stays."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
    centre: Place
    """Its centre [length]."""
    radius: PositiveLength
    """Its radius [length]."""
    inside: bool = False
    """Whether it is hollow, with the structure inside."""


class CylinderObstacle(Record):
    """A rigid cylinder, solid or hollow, infinite or with ends."""

    kind: Literal["cylinder"]
    """The obstacle is a cylinder."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    direction: Direction | None = None
    """Displacement at value 1 of its motion, which stages set in ``obstacles``; without it the obstacle stays."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
    centre: Place
    """A point of its axis [length], the middle where it has ends."""
    axis: Direction
    """Direction of its axis."""
    radius: PositiveLength
    """Its radius [length]."""
    length: PositiveLength | None = None
    """From end to end [length]; infinite without it."""
    rounding: PositiveLength | None = None
    """Radius of the edges of its ends [length]; a twentieth of the radius, or of the length where that is shorter."""
    inside: bool = False
    """Whether it is hollow, with the structure inside."""

    @model_validator(mode="after")
    def _round_edges(self) -> Self:
        if self.rounding is not None:
            if self.length is None or self.inside:
                raise ValueError("rounding is for the edges of a solid cylinder with a length")
            _check_rounding(self.rounding, [2.0 * self.radius, self.length])
        return self


class BoxObstacle(Record):
    """A rigid box, solid with rounded edges, or hollow."""

    kind: Literal["box"]
    """The obstacle is a box."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    direction: Direction | None = None
    """Displacement at value 1 of its motion, which stages set in ``obstacles``; without it the obstacle stays."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
    centre: Place
    """Its centre [length]."""
    size: tuple[PositiveLength, PositiveLength, PositiveLength]
    """Lengths of its sides along its own axes [length]."""
    axis_x: Direction = (1.0, 0.0, 0.0)
    """Direction of its first side."""
    axis_z: Direction = (0.0, 0.0, 1.0)
    """Direction of its third side, at right angles to the first."""
    rounding: PositiveLength | None = None
    """Radius of its edges [length]; a twentieth of its shortest side without it."""
    inside: bool = False
    """Whether it is hollow, with the structure inside."""

    @model_validator(mode="after")
    def _right_angles(self) -> Self:
        sizes = math.hypot(*self.axis_x) * math.hypot(*self.axis_z)
        cosine = sum(a * b for a, b in zip(self.axis_x, self.axis_z, strict=True)) / sizes
        if abs(cosine) > _ALONG:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            raise ValueError(
                f"axis_x = {list(self.axis_x)} and axis_z = {list(self.axis_z)} make {angle:.6g} degrees, not 90"
            )
        if self.rounding is not None:
            if self.inside:
                raise ValueError("rounding is for the edges of a solid box")
            _check_rounding(self.rounding, self.size)
        return self


class SurfaceObstacle(Record):
    """A rigid triangulated surface, from a mesh file or given; its normals are those of counter-clockwise winding."""

    kind: Literal["surface"]
    """The obstacle is a triangulated surface."""
    group: GroupName = "all"
    """Nodes that it holds up; ``all`` is every node."""
    direction: Direction | None = None
    """Displacement at value 1 of its motion, which stages set in ``obstacles``; without it the obstacle stays."""
    friction: Friction = 0.0
    """Coefficient of Coulomb friction; nodes slide freely without it."""
    path: str | None = None
    """Mesh file, relative to the scene's; all its triangles count."""
    scale: Positive = 1.0
    """Factor on the coordinates of the file."""
    points: Annotated[list[Vector], Field(min_length=3, max_length=_MOST_FACETS)] | None = None
    """Its points, in place of a file."""
    triangles: (
        Annotated[
            list[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]],
            Field(min_length=1, max_length=_MOST_FACETS),
        ]
        | None
    ) = None
    """Numbers, from 0, of the three ``points`` of each triangle."""
    face: Literal["front", "back"] = "front"
    """Side where the structure is: to which the normals point, or the other one."""
    offset: LengthFromZero = 0.0
    """Distance from the surface at which nodes touch, which rounds its edges [length]."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = self.points is not None, self.triangles is not None
        if given != (self.path is None,) * 2:
            raise ValueError("give path, or both points and triangles")
        for number, corners in enumerate(self.triangles or ()):
            if max(corners) >= len(self.points or ()):
                raise ValueError(
                    f"triangles: number {number} names point {max(corners)}, but there are {len(self.points or ())}"
                )
        return self


Obstacle = Annotated[
    PlaneObstacle | SphereObstacle | CylinderObstacle | BoxObstacle | SurfaceObstacle, Field(discriminator="kind")
]


def _check_rounding(rounding: float, sides: list[float] | tuple[float, ...]) -> None:
    if 2.0 * rounding > min(sides):
        raise ValueError(f"rounding = {rounding:g} is more than half the shortest side, {min(sides):g}")
