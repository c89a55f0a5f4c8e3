"""Parametric shapes of what people build: tents on arches, mattresses."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import LARGEST, Count, Positive, Record

Length = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Cells = Annotated[int, Field(ge=1, le=1000)]
Half = Annotated[int, Field(ge=2, le=20_000)]


class ArchTentShape(Record):
    """Inflated arches in planes y = const, feet on z = 0, closed by flat plates, and a skin sewn to them from arch to arch.

    Element groups: ``arches``, ``arch_1``, … (a chamber each), ``plates`` (at the feet); ``skin``, ``bay_1``, … and the zones
    ``windward`` (-x), ``roof``, ``leeward`` of it; with closed ends ``gables``, ``gable_start`` (-y), ``gable_end``. Node groups:
    ``feet``, ``feet_1``, …; ``skirt_windward``, ``skirt_leeward`` (lower edges of the skin); ``seam_1``, …; of one node each
    ``crown_1``, ``guy_windward_1``, ``guy_leeward_1``, …; with closed ends ``sill_start``, ``sill_end``. Warp runs along the arcs.
    """

    shape: Literal["arch_tent"]
    """A tent on inflated arches."""
    span: Positive
    """Distance of the centres of an arch's feet, along x [length]."""
    radius: Positive
    """Radius of the tubes [length]."""
    spacing: Positive
    """Distance of the planes of neighbouring arches, along y [length]."""
    around: Annotated[int, Field(ge=4, le=20_000)]
    """Elements around a tube, even."""
    along: Annotated[int, Field(ge=4, le=20_000)]
    """Rings of elements from foot to foot, even."""
    across: Count
    """Elements of the skin from arch to arch."""
    arches: Annotated[int, Field(ge=2, le=100)] = 2
    """Number of arches."""
    angle: Annotated[float, Field(gt=0, lt=360)] = 180.0
    """Angle of the arcs [degrees]."""
    seam: Annotated[float, Field(ge=0, le=180)] = 0.0
    """Where the skin is sewn to a tube [degrees]: 0 on its outer line, 90 where it faces the next arch, 180 on its inner line."""
    sag: Length = 0.0
    """How much nearer to the arcs' axis the skin is cut half-way between arches, as a parabola [length]."""
    ends: Literal["open", "closed"] = "open"
    """``closed`` adds a flat gable within the first and the last arch, sewn to their inner lines."""
    roof: Annotated[float, Field(gt=0, lt=360)] = 90.0
    """Angle of the arc, about the crown, over which the skin is roof [degrees]."""
    guy: Annotated[float, Field(gt=0, lt=180)] = 45.0
    """Angle from the crown to the guy points, on the outer lines [degrees]."""


class MattressShape(Record):
    """Cells in a rectangle about the origin, standing on z = 0, with walls between them: a chamber each.

    Cells are numbered along x, then along y. Element groups: ``top``, ``bottom``, ``edges``, ``walls``, and of each cell
    ``top_1``, ``bottom_1``, ``cell_1`` and ``into_1``: its pressure has ``group = "cell_2"`` and, from the second on,
    ``against = "into_2"``. Node groups: ``top``, ``bottom``, ``rim_top``, ``rim_bottom``, ``corners``, and for even divisions
    ``centre_top``, ``centre_bottom``. Warp runs along y.
    """

    shape: Literal["mattress"]
    """A mattress of cells."""
    width: Positive
    """Size along x [length]."""
    length: Positive
    """Size along y [length]."""
    height: Positive
    """Height of the walls between cells [length]."""
    cells_x: Cells
    """Cells along x."""
    cells_y: Cells = 1
    """Cells along y."""
    along_x: Half
    """Elements along x in a cell."""
    along_y: Half
    """Elements along y in a cell."""
    up: Count
    """Elements up a wall."""
    bulge: Annotated[float, Field(ge=0, le=180)] = 0.0
    """Angle of the arcs over a cell's width that top and bottom are cut to [degrees]; flat without it."""
