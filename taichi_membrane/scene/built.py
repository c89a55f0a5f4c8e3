"""Parametric shapes of what people build: tents, mattresses, sails, panels with yarns, bags, balloons, hulls."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import Count, LengthFromZero, PositiveLength, Record

Cells = Annotated[int, Field(ge=1, le=1000)]
Share = Annotated[float, Field(ge=0.05, le=0.95)]
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
    span: PositiveLength
    """Distance of the centres of an arch's feet, along x [length]."""
    radius: PositiveLength
    """Radius of the tubes [length]."""
    spacing: PositiveLength
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
    sag: LengthFromZero = 0.0
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
    width: PositiveLength
    """Size along x [length]."""
    length: PositiveLength
    """Size along y [length]."""
    height: PositiveLength
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


class HyparShape(Record):
    """A four-point sail: a hyperbolic paraboloid between two low and two high corners, its edges cut inwards.

    Its corners are at (±``width``/2, ±``depth``/2), at z = 0 where x y > 0 and at z = ``rise`` where x y < 0. Node groups:
    ``low_1`` (x, y < 0), ``low_2``, ``high_1`` (x > 0, y < 0), ``high_2``, ``corners``; ``edge_1`` (y < 0), ``edge_2`` (x > 0),
    ``edge_3``, ``edge_4``, for cables along them; ``edges``, ``centre`` (even ``along``). Warp runs from low corner to low
    corner.
    """

    shape: Literal["hypar"]
    """A four-point sail."""
    width: PositiveLength
    """Distance of the corners along x [length]."""
    depth: PositiveLength
    """Distance of the corners along y [length]."""
    rise: LengthFromZero
    """Height of the high corners over the low ones [length]; 0 is a flat sail."""
    along: Half
    """Elements along an edge."""
    sag: Annotated[float, Field(ge=0, le=0.4)] = 0.1
    """How far an edge is cut inwards, as a parabola in plan, over the distance of its corners."""


class ConeShape(Record):
    """A tent from a rim in z = 0 up to a ring about the z axis, as a mast carries it.

    The rim is a circle, or runs from corner to corner of a regular polygon along edges that are cut inwards. Node groups: ``ring``,
    ``rim``; with corners ``corners``, ``corner_1`` (on the x axis), …, and ``edge_1`` (from the first corner to the second), …, for
    cables along them. Warp runs from rim to ring.
    """

    shape: Literal["cone"]
    """A tent that a mast lifts."""
    radius: PositiveLength
    """Radius of the rim, of its corners where it has some [length]."""
    ring: PositiveLength
    """Radius of the ring [length]."""
    height: LengthFromZero
    """Height of the ring over the rim [length]; 0 is a flat tent."""
    around: Annotated[int, Field(ge=3, le=20_000)]
    """Elements round the ring, a multiple of ``corners``."""
    up: Count
    """Elements from ring to rim."""
    corners: Annotated[int, Field(ge=0, le=1000)] = 0
    """Corners of the rim, 3 at least; 0 is a circle."""
    sag: Annotated[float, Field(ge=0, le=0.4)] = 0.1
    """How far an edge is cut inwards, as a parabola, over the distance of its corners."""


class DropStitchShape(Record):
    """A rectangular panel about the z axis on z = 0: two flat skins, a wall round them, and yarns between: one closed chamber.

    Element groups: ``shell`` (the chamber: all but the webs), ``top``, ``bottom``, ``wall``; ``webs``. Group of line elements:
    ``yarns`` (``[cables.NAME]`` with ``lines = "yarns"``). Node groups: ``rim_top``, ``rim_bottom``, ``x_min``, ``x_max``,
    ``y_min``, ``y_max`` (both rims' edges there), ``middle`` (both skins at y = 0), ``stitched`` (ends of yarns), ``centre_top``,
    ``centre_bottom``. Warp runs along y, up the wall in z.
    """

    shape: Literal["drop_stitch"]
    """A panel of two skins that yarns hold."""
    width: PositiveLength
    """Size of the skins along x [length]."""
    length: PositiveLength
    """Size of the skins along y [length]."""
    height: PositiveLength
    """Distance of the skins [length]."""
    along_x: Half
    """Elements of a skin along x."""
    along_y: Half
    """Elements of a skin along y."""
    up: Count
    """Elements of the wall, and of webs, from skin to skin."""
    every: Annotated[int, Field(ge=1, le=1000)] = 1
    """A yarn, or web, at every so many nodes of a skin, counted from its middle."""
    yarns: Literal["cables", "webs"] = "cables"
    """``cables``: line elements from skin to skin; ``webs``: walls along y, sewn to both skins but for their ends."""
    bulge: Annotated[float, Field(ge=0, le=180)] = 0.0
    """Angle of the arc that the wall is cut to [degrees], 0 (flat) to 180 (half a circle)."""


class AirbagShape(Record):
    """Two flat sheets in z = 0 about the origin, sewn to each other along their rim; or a quarter of the upper one.

    Node group ``seam`` (the rim). A whole bag: ``centre_top``, ``centre_bottom``, element groups ``top`` (normal +z) and
    ``bottom``. A quarter: ``centre``, ``mirror_x`` (on x = 0), ``mirror_y`` (on y = 0), ``end_x`` and ``end_y`` (nodes of the
    seam on the axes). A square has ``corners``. Warp runs along x.
    """

    shape: Literal["airbag"]
    """Two flat sheets sewn along their rim."""
    outline: Literal["square", "disc"]
    """Outline of the sheets."""
    size: PositiveLength
    """Side of the square, or diameter of the disc [length]."""
    divisions: Annotated[int, Field(ge=2, le=3000)]
    """Elements from the middle to the rim."""
    part: Literal["whole", "quarter"] = "whole"
    """``whole``, or the quarter x, y >= 0 of the upper sheet, for three planes of symmetry."""


class WaterTubeShape(Record):
    """A tube along x that lies on the plane z = 0, its middle above the origin, for a filling with a level.

    Node groups: ``start`` (ring at -x), ``end``, ``base`` (the lowest line), ``crown`` (the highest one); for even ``along``
    ``middle`` (ring at x = 0), ``middle_base``, ``middle_crown``, ``middle_left`` (towards +y), ``middle_right``. Element groups:
    ``tube`` and with ends ``caps``. Warp runs along the tube.
    """

    shape: Literal["water_tube"]
    """A tube on a plane."""
    radius: PositiveLength
    """Radius of its round section [length]."""
    length: PositiveLength
    """Length of its wall [length]."""
    around: Annotated[int, Field(ge=4, le=20_000)]
    """Elements round it, a multiple of 4."""
    along: Count
    """Elements from end to end."""
    ends: Literal["open", "flat", "hemisphere"] = "open"
    """``open``, as a slice between planes of symmetry; ``flat`` or ``hemisphere``, which close it."""


class PumpkinShape(Record):
    """A balloon of lobes between tendons that run from fitting to fitting along the z axis; its equator lies in z = 0.

    Tendons lie on the meridian that needs no hoop tension; across a gore, square to them, the fabric is cut as an arc. Element
    groups: ``gores``, ``gore_1``, …, ``fittings``. Group of line elements: ``tendons`` (``[cables.NAME]`` with ``lines =
    "tendons"``). Node groups: ``fitting_top``, ``fitting_bottom`` (discs with their rims), ``tendon_1``, …, ``pole_top``,
    ``pole_bottom``, ``equator`` (tendons' nodes there), ``crests`` (tops of the lobes there). Warp runs along the tendons.
    """

    shape: Literal["pumpkin"]
    """A balloon of lobes between tendons."""
    radius: PositiveLength
    """Radius of the tendons at the equator [length]."""
    gores: Annotated[int, Field(ge=3, le=1000)]
    """Gores, and tendons."""
    along: Half
    """Elements of a gore from fitting to fitting."""
    across: Count
    """Elements across a gore."""
    bulge: Annotated[float, Field(gt=0, le=180)] = 90.0
    """Angle of the arcs between tendons [degrees], at least 360/``gores``, a round body."""
    fitting: Annotated[float, Field(ge=0.01, le=0.9)] = 0.1
    """Radius of the flat discs at the poles over ``radius``."""


class HullShape(Record):
    """Two halves of ellipsoids about the x axis, the largest section at x = 0, the nose towards -x, with inflated fins at the tail.

    A fin is a chamber of its own: two skins from lines on the hull to its tip edge, with ribs between them; its root is a wall of
    the hull. Element groups: ``hull`` (closed, roots included), ``roots``, ``fins``, ``ribs``; of each fin ``fin_1`` and
    ``into_fin_1``: its pressure has ``group = "fin_1"`` and ``against = "into_fin_1"``. Node groups: ``nose``, ``tail``,
    ``equator`` (largest section), ``tip_1``, … (a fin's tip edge), ``bridle_1`` (front, +y), ``bridle_2`` (front, -y),
    ``bridle_3``, ``bridle_4`` (rear). Warp runs along the hull.
    """

    shape: Literal["hull"]
    """The hull of an airship."""
    length: PositiveLength
    """From nose to tail [length]."""
    radius: PositiveLength
    """Radius of the largest section [length]."""
    around: Annotated[int, Field(ge=8, le=20_000)]
    """Elements round the hull, a multiple of 8 and of ``fins``; fewer near the ends."""
    along: Annotated[int, Field(ge=4, le=20_000)]
    """Elements from nose to tail."""
    nose: Annotated[float, Field(ge=0.1, le=0.9)] = 0.4
    """Share of the length that lies before the largest section."""
    fins: Annotated[int, Field(ge=0, le=100)] = 0
    """Number of fins, evenly round the hull, the first one above."""
    fin_from: Share = 0.7
    """Where a fin's root begins, as a share of the length from the nose."""
    fin_to: Share = 0.9
    """Where it ends."""
    fin_reach: PositiveLength | None = None
    """Distance of the tip edge from the axis [length]; 1.3 ``radius`` without it."""
    fin_sweep: LengthFromZero = 0.0
    """How far behind the front of the root the tip edge begins [length]."""
    fin_up: Count = 4
    """Elements of a fin from hull to tip."""
    ribs: Annotated[int, Field(ge=0, le=1000)] = 1
    """Walls between the skins of a fin, evenly."""
    bridle_from: Share = 0.25
    """Where the front bridles are tied, as a share of the length from the nose."""
    bridle_to: Share = 0.6
    """Where the rear bridles are tied."""
    bridle_angle: Annotated[float, Field(ge=0, le=180)] = 40.0
    """Angle of these points from the lowest line [degrees]."""
