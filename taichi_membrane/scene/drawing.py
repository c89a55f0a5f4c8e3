"""What is drawn: the camera of the pictures, and the curve."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from taichi_membrane import fields
from taichi_membrane.scene.base import AllowedNames, Finite, Label, Positive, Record

LARGEST_PICTURE = 8192 * 4320  # pixels; drawing takes about 150 bytes for each


def _drawn(name: str) -> str:
    """Refuse what no picture can show."""
    if name not in fields.drawn():
        raise ValueError(f"pictures cannot show {name!r}; allowed: {', '.join(fields.drawn())}")
    return name


class Camera(Record):
    """How the pictures look; one camera and one colour range serve all steps of a run."""

    field: Annotated[str, AfterValidator(_drawn), AllowedNames(fields.drawn)] = "state"
    """What the colours show: wrinkling states, or a field by a colour scale."""
    azimuth: Finite = -60.0
    """Where the camera stands, about z [degrees]."""
    elevation: Annotated[float, Field(ge=-90, le=90)] = 20.0
    """Height above the xy plane [degrees]."""
    projection: Literal["perspective", "orthographic"] = "perspective"
    """Perspective or orthographic."""
    size: tuple[Annotated[int, Field(ge=240, le=8192)], Annotated[int, Field(ge=160, le=8192)]] = (1600, 1000)
    """Width and height [pixels]."""
    outline: bool = True
    """Draw the unstressed shape."""
    loads: bool = True
    """Draw arrows at loads."""
    supports: bool = False
    """Draw marks at supports."""
    directions: bool = True
    """Draw lines along wrinkles."""
    magnify: Annotated[Positive, Field(le=1e6)] = 1.0
    """Displacements are drawn so many times larger, which the picture says; loads, obstacles and numbers stay as they are."""

    @field_validator("size")
    @classmethod
    def _not_too_large(cls, value: tuple[int, int]) -> tuple[int, int]:
        if value[0] * value[1] > LARGEST_PICTURE:
            raise ValueError(
                f"{value[0]} × {value[1]} = {value[0] * value[1]} pixels, at most {LARGEST_PICTURE} are allowed"
            )
        return value


class CurveLine(Record):
    """A line across the curve plot at a value of x or of y."""

    label: Label
    """What is written at the line."""
    axis: Literal["x", "y"]
    """Axis whose value it marks."""
    value: Finite
    """Value on that axis."""


class CurveReference(Record):
    """A reference curve, drawn beside the computed one."""

    label: Label
    """What the legend says."""
    x: list[Finite]
    """Values along x."""
    y: list[Finite]
    """Values along y, as many."""

    @model_validator(mode="after")
    def _same_length(self) -> Self:
        if len(self.x) != len(self.y):
            raise ValueError(f"len(x) = {len(self.x)}, but len(y) = {len(self.y)}")
        return self


class Curve(Record):
    """What ``curve.png`` plots on each axis: a probe, ``pressure[.NAME]``, ``load.NAME``, ``motion.NAME`` or ``volume``.

    ``stage`` limits it to one stage (with the state before it as first point). ``x_scale`` and ``y_scale`` multiply, say -1 for a
    deflection that is negative along z.
    """

    x: str
    """Quantity along x."""
    y: str
    """Quantity along y."""
    stage: str | None = None
    """Stage it is limited to; all stages without it."""
    x_scale: Finite = 1.0
    """Factor on x."""
    y_scale: Finite = 1.0
    """Factor on y, say -1 for a deflection along -z."""
    x_label: Label | None = None
    """Text at the x axis; made from name and unit without it."""
    y_label: Label | None = None
    """Text at the y axis."""
    lines: list[CurveLine] = []
    """Lines across the plot."""
    references: list[CurveReference] = []
    """Curves to compare with."""
    formats: Annotated[list[Literal["png", "svg", "pdf"]], Field(min_length=1, max_length=3)] = ["png"]
    """Files that are written: ``curve.png``, and drawings that stay sharp at any size."""
