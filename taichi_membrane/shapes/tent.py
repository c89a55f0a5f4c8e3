"""Tents that inflated arches carry, their skin sewn to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_count, check_length, check_name, check_size
from taichi_membrane.shapes.patchwork import Floats, Ints, Patchwork, quads, zip_rows
from taichi_membrane.shapes.rings import Ring, ring_directions
from taichi_membrane.shapes.round import cap_of

TentEnds = Literal["open", "closed"]


def arch_tent(
    *,
    span: float,
    radius: float,
    spacing: float,
    around: int,
    along: int,
    across: int,
    arches: int = 2,
    angle: float = 180.0,
    seam: float = 0.0,
    sag: float = 0.0,
    ends: TentEnds = "open",
    roof: float = 90.0,
    guy: float = 45.0,
) -> Mesh:
    """Inflated arches in planes y = const, closed at their feet, and a skin sewn to them from arch to arch along x.

    Each arch is a closed body, a tube along a circular arc whose feet are centred at x = ±``span``/2, z = 0 and end in flat
    plates. The skin shares the nodes of the arches along the lines it is sewn to, whose edges have three elements, or four.

    :param span: distance of the centres of the feet [length]; ``radius`` that of the tubes, less than that of the arc.
    :param spacing: distance of the planes of neighbouring arches [length]; the tent is symmetric about y = 0.
    :param around: elements round a tube, even; ``along`` from foot to foot, even; ``across`` of the skin from arch to arch.
    :param arches: number of arches, at least 2.
    :param angle: angle of the arc [degrees], above 0 and below 360.
    :param seam: where the skin is sewn to a tube [degrees]: 0 on the outer line, 90 on the side that faces the next arch, up to
        180, the inner line; the line of nodes nearest to it.
    :param sag: how much nearer to the arc's axis the skin is cut half-way between two arches [length], as a parabola: a saddle.
    :param ends: ``closed`` adds a flat gable within the first and the last arch, sewn to their inner lines.
    :param roof: angle of the arc over which the skin is roof [degrees], about the crown.
    :param guy: angle from the crown to the guy points [degrees], on the outer lines.
    :return: element groups ``arches``, ``arch_1``, … (with plates), ``plates``; ``skin``, ``bay_1``, …, ``windward`` (-x),
        ``roof``, ``leeward``; with closed ends ``gables``, ``gable_start`` (-y), ``gable_end``. Node groups ``feet`` and
        ``feet_1``, … (nodes of the plates), ``skirt_windward``, ``skirt_leeward`` (lower edges of the skin), ``seam_1``, …
        (lines of an arch that skin is sewn to), ``crown_1``, …, ``guy_windward_1``, ``guy_leeward_1``, … (one node each), with
        closed ends ``sill_start``, ``sill_end``. Normals point out of the arches, and outwards. Warp runs along the arcs.
    """
    form = _Form(
        check_length("arch_tent", "span", span),
        check_length("arch_tent", "radius", radius),
        math.radians(_angle("angle", angle, 360.0, "a full turn")) / 2.0,
        along,
        around,
    )
    _check_tent(form, spacing, across, arches, seam, sag, ends)
    _angle("roof", roof, angle, "angle, so that two sides are left")
    _angle("guy", guy, angle / 2.0, "half of angle")

    work = Patchwork()
    places = [spacing * (number - 0.5 * (arches - 1)) for number in range(arches)]
    tubes = [_add_arch(work, form, y, number) for number, y in enumerate(places, 1)]
    _name_guys(work, tubes, form, math.radians(guy))
    work.node_groups["feet"] = np.concatenate([work.node_groups[f"feet_{k + 1}"] for k in range(arches)])
    _add_bays(work, form, tubes, round(seam / 360.0 * around), sag, across, math.radians(roof))
    if ends == "closed":
        _add_gable(work, tubes[0][:, around // 2], "start")
        _add_gable(work, tubes[-1][:, around // 2], "end")
    return work.mesh("arch_tent")


@dataclass(frozen=True)
class _Form:
    """An arch in its plane: half its angle [radians]; the arc's axis lies at x = 0, ``height`` below z = 0."""

    span: float
    radius: float
    half: float
    along: int
    around: int

    @property
    def arc(self) -> float:
        return self.span / (2.0 * math.sin(self.half))

    @property
    def height(self) -> float:
        return self.arc * math.cos(self.half)

    @property
    def turns(self) -> Floats:
        """(along + 1,) angle of each ring from the crown, counted from there for symmetry to the last bit."""
        return self.half * (2 * np.arange(self.along + 1) - self.along) / self.along

    def places(self, turn: Floats, y: Floats, outwards: Floats) -> Floats:
        """Points at angles from the crown, at distances from the arc."""
        distance = self.arc + outwards
        turn, y, distance = np.broadcast_arrays(turn, y, distance)
        return np.stack((distance * np.sin(turn), y, distance * np.cos(turn) - self.height), axis=-1)


def _angle(name: str, value: float, limit: float, what: str) -> float:
    """Return an angle, refused unless it lies above 0 and below a limit."""
    check_length("arch_tent", name, value)
    if value >= limit:
        raise InputError(f"arch_tent: {name} = {value:g} must be below {limit:g} degrees, {what}")
    return value


def _check_tent(form: _Form, spacing: float, across: int, arches: int, seam: float, sag: float, ends: str) -> None:
    check_length("arch_tent", "spacing", spacing)
    for name, count, lowest in (("around", form.around, 4), ("along", form.along, 4)):
        if check_count("arch_tent", name, count, lowest) % 2:
            raise InputError(f"arch_tent: {name} = {count} must be even, so that there are inner lines and a crown")
    check_count("arch_tent", "across", across, 1)
    check_count("arch_tent", "arches", arches, 2)
    if seam != 0.0 and check_length("arch_tent", "seam", seam) > 180.0:
        raise InputError(f"arch_tent: seam = {seam:g} must be 0 to 180 degrees")
    check_name("arch_tent", "ends", ends, get_args(TentEnds))
    check_size("arch_tent", 2 * form.along * ((form.around + across) * arches + form.along) + arches * form.around**2)
    if form.radius >= form.arc:
        raise InputError(
            f"arch_tent: radius = {form.radius:g} must be below the radius of the arc, {form.arc:g} at this span and angle"
        )
    if 2.0 * form.radius >= spacing:
        raise InputError(
            f"arch_tent: spacing = {spacing:g} must be above 2 radius = {2.0 * form.radius:g}; the arches would overlap"
        )
    reach = form.arc - form.radius
    if sag != 0.0 and check_length("arch_tent", "sag", sag) >= reach:
        raise InputError(f"arch_tent: sag = {sag:g} must be below the radius of the arches' inner lines, {reach:g}")


def _add_arch(work: Patchwork, form: _Form, y: float, number: int) -> Ints:
    """Add a closed tube; returns (along + 1, around) nodes, the first of a ring on the outer line."""
    cosine, sine = ring_directions(Ring(form.around))
    at = work.nodes(form.places(form.turns[:, None], y - form.radius * sine, form.radius * cosine))
    groups = ("arches", f"arch_{number}")
    ring_first = np.column_stack((at, at[:, :1])).T
    wall = quads(ring_first)
    work.piece(wall, groups, _tangents(work.points[wall], form))
    feet = [at[0], at[-1]]
    for ring, turn, outwards in ((at[0], -form.half, -1), (at[-1], form.half, 1)):
        local, triangles = cap_of("flat", form.radius, Ring(form.around), outwards)
        plate = work.nodes(form.places(np.full(len(local), turn), y + local[:, 1], local[:, 2]))
        feet.append(plate)
        work.piece(np.concatenate((ring, plate))[triangles], (*groups, "plates"), [0.0, 1.0, 0.0])
    work.node_groups[f"feet_{number}"] = np.concatenate(feet)
    work.node_groups[f"crown_{number}"] = at[form.along // 2, :1]
    return at


def _name_guys(work: Patchwork, tubes: list[Ints], form: _Form, guy: float) -> None:
    """Name the node on the outer line of each arch that is nearest to an angle from the crown, on either side."""
    for side, way in (("windward", -1.0), ("leeward", 1.0)):
        near = round(form.along / 2 * (1.0 + way * guy / form.half))
        for number, tube in enumerate(tubes, 1):
            work.node_groups[f"guy_{side}_{number}"] = tube[near, :1]


def _add_bays(
    work: Patchwork, form: _Form, tubes: list[Ints], column: int, sag: float, across: int, roof: float
) -> None:
    """Add the skins between neighbouring arches; name the lines that they are sewn to, and their lower edges.

    :param column: line of nodes of a tube that faces the next arch, counted from the outer line.
    """
    skirts: list[tuple[Ints, Ints]] = []
    lines: list[list[Ints]] = [[] for _ in tubes]
    for bay in range(len(tubes) - 1):
        pair = tubes[bay][:, -column], tubes[bay + 1][:, column]  # angles run from the outer line towards -y
        lines[bay].append(pair[0])
        lines[bay + 1].append(pair[1])
        skirts.append(_add_skin(work, form, pair, sag, across, roof, bay + 1))
    for number, sewn in enumerate(lines, 1):
        work.node_groups[f"seam_{number}"] = np.unique(np.concatenate(sewn))
    for side, row in (("windward", 0), ("leeward", 1)):
        work.node_groups[f"skirt_{side}"] = np.concatenate([skirt[row] for skirt in skirts])


def _add_skin(
    work: Patchwork,
    form: _Form,
    pair: tuple[Ints, Ints],
    sag: float,
    across: int,
    roof: float,
    bay: int,
) -> tuple[Ints, Ints]:
    """Add the skin between two lines of neighbouring arches; returns the nodes of its lower edges."""
    first = work.points[pair[0][0]]
    reach = math.hypot(first[0], first[2] + form.height)
    share = np.arange(1, across) / across
    ends = first[1], work.points[pair[1][0], 1]
    between = form.places(
        form.turns[:, None],
        (1.0 - share) * ends[0] + share * ends[1],
        reach - form.arc - 4.0 * sag * share * (1.0 - share),
    )
    at = np.column_stack((pair[0], work.nodes(between), pair[1]))
    triangles = quads(at)
    numbers = work.piece(triangles, ("skin", f"bay_{bay}"), _tangents(work.points[triangles], form))
    middle = np.repeat(0.5 * (form.turns[1:] + form.turns[:-1]), 2 * across)
    for name, chosen in (
        ("windward", middle < -0.5 * roof),
        ("roof", np.abs(middle) <= 0.5 * roof),
        ("leeward", middle > 0.5 * roof),
    ):
        if not chosen.any():
            raise InputError(
                f"arch_tent: with along = {form.along} no element of the skin is {name}; roof = {math.degrees(roof):g} degrees"
            )
        work.name(numbers[chosen], name)
    return at[0], at[-1]


def _add_gable(work: Patchwork, rim: Ints, side: str) -> None:
    """Close the plane within an arch, from its inner line to the straight line between that one's ends."""
    places = work.points[rim]
    middle = 0.5 * (places[0] + places[-1])
    steps = max(2, round((len(rim) - 1) / math.pi))
    rows, bands = [rim], []
    for step in range(steps - 1, -1, -1):
        count = round((len(rim) - 1) * step / steps / 2) * 2
        if step and count < 2:
            count = 2
        if step == 0:
            row = work.nodes(middle[None, :])
        else:
            along = np.linspace(0.0, len(rim) - 1, count + 1)
            on_rim = np.column_stack([np.interp(along, np.arange(len(rim)), places[:, axis]) for axis in range(3)])
            row = work.nodes(middle + step / steps * (on_rim - middle))
        bands.append(zip_rows(row, rows[-1]))
        rows.append(row)
    triangles = np.concatenate(bands)
    # Rows run along +x with the rim above, seen from -y.
    work.piece(triangles if side == "start" else triangles[:, ::-1], ("gables", f"gable_{side}"), [0.0, 0.0, 1.0])
    work.node_groups[f"sill_{side}"] = np.concatenate([row[[0, -1]] for row in rows])


def _tangents(corners: Floats, form: _Form) -> Floats:
    """(n, 3) directions along the arc, towards +x at the crown, at the middles of triangles."""
    middle = corners.mean(axis=1)
    return np.column_stack((middle[:, 2] + form.height, np.zeros(len(middle)), -middle[:, 0]))
