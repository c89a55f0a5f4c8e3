"""What holds or moves a structure: supports, rigid bodies and prescribed motions."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from taichi_membrane.scene.base import Direction, GroupName, Name, Place, Record


def _distinct(value: str) -> str:
    """Refuse a list of components that names one twice."""
    if len(set(value)) != len(value):
        raise ValueError(f"a component is named twice in {value!r}")
    return value


Components = Annotated[str, Field(pattern=r"^[xyz]{1,3}$"), AfterValidator(_distinct)]


class Support(Record):
    """Displacement components of a node group that are held at zero: some of x, y, z, or the one along ``normal``.

    ``normal`` makes a plane of symmetry of any direction: the nodes slide in it.
    """

    group: GroupName
    """Node group."""
    hold: Components | None = None
    """Which of x, y, z are held."""
    normal: Direction | None = None
    """Direction along which nodes are held: a plane of symmetry."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.hold is None) == (self.normal is None):
            raise ValueError("give either hold (some of x, y, z) or normal (a direction)")
        return self


class Translation(Record):
    """A prescribed motion: the named components of a node group move by the stage's factor times ``direction``."""

    kind: Literal["translation"]
    """A translation."""
    group: GroupName
    """Node group."""
    direction: Place
    """Displacement at factor 1 [length]."""
    hold: Components = "xyz"
    """Components that are prescribed; the others stay free."""


class Rotation(Record):
    """A prescribed motion: a node group turns rigidly by the stage's factor, in degrees, about an axis; finite angles.

    Only the components in ``hold`` are prescribed; the others stay free.
    """

    kind: Literal["rotation"]
    """A rigid rotation."""
    group: GroupName
    """Node group."""
    axis: Direction
    """Direction of the axis, right-handed."""
    through: Place
    """A point on it [length]."""
    hold: Components = "xyz"
    """Components that are prescribed; the others stay free."""


class Body(Record):
    """A node group that moves as one rigid body: an end plate, a ring, a mast, an anchor.

    It has six freedoms, the displacement of its centre and a rotation of any size; nodes on a line, as of a mast, have none about
    it. Its nodes have no supports and motions of their own. A body is a node group of its name, too.
    """

    group: GroupName | None = None
    """Node group that is rigid."""
    lines: GroupName | None = None
    """Group of line elements whose nodes are rigid, in place of ``group``; their loose points become nodes."""
    centre: Place | None = None
    """Point whose displacement ``hold`` refers to and that rotations leave in place [length]; the mean of the nodes without it."""
    hold: Components | None = None
    """Which displacements of the centre are held."""
    turn_hold: Components | None = None
    """About which of x, y, z rotations are held: two, so that it turns about the third alone, or all."""

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.group is None) == (self.lines is None):
            raise ValueError("give either group (of nodes) or lines (a group of line elements)")
        if self.turn_hold is not None and len(self.turn_hold) == 1:
            raise ValueError(
                f"turn_hold = {self.turn_hold!r}: finite rotations about two axes make one about the third, so that none can be "
                "held alone; hold two, or all"
            )
        return self

    @property
    def told(self) -> str:
        """What is held, in words; nothing where nothing is."""
        parts = [f"in {self.hold}"] if self.hold else []
        return " and ".join([*parts, *([f"about {self.turn_hold}"] if self.turn_hold else [])])


class BodyTranslation(Record):
    """A prescribed motion: the named components of a body's centre move by the stage's factor times ``direction``."""

    kind: Literal["body_translation"]
    """A translation of a rigid body."""
    body: Name
    """Name of the body."""
    direction: Place
    """Displacement of the centre at factor 1 [length]."""
    hold: Components = "xyz"
    """Components that are prescribed; the others stay free, or held."""

    @property
    def group(self) -> str:
        """Group of its nodes."""
        return self.body


class BodyRotation(Record):
    """A prescribed motion: a body turns by the stage's factor, in degrees, about an axis through its centre; finite angles.

    All its rotations are prescribed; of several such motions of one body the first of the scene comes first. The centre moves as
    it may.
    """

    kind: Literal["body_rotation"]
    """A rotation of a rigid body."""
    body: Name
    """Name of the body."""
    axis: Direction
    """Direction of the axis, right-handed."""

    @property
    def group(self) -> str:
        """Group of its nodes."""
        return self.body

    @property
    def hold(self) -> str:
        """What is prescribed, in words."""
        return "all rotations"


Motion = Annotated[Translation | Rotation | BodyTranslation | BodyRotation, Field(discriminator="kind")]
