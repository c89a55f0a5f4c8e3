"""Hulls of airships and aerostats: a body of revolution with inflated fins."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_between, check_count, check_length, check_multiple, check_size
from taichi_membrane.shapes.patchwork import Floats, Ints, Patchwork, quads, zip_rows
from taichi_membrane.shapes.rings import Ring, ring_directions, zip_rings


def hull(
    *,
    length: float,
    radius: float,
    around: int,
    along: int,
    nose: float = 0.4,
    fins: int = 0,
    fin_from: float = 0.7,
    fin_to: float = 0.9,
    fin_reach: float | None = None,
    fin_sweep: float = 0.0,
    fin_up: int = 4,
    ribs: int = 1,
    bridle_from: float = 0.25,
    bridle_to: float = 0.6,
    bridle_angle: float = 40.0,
) -> Mesh:
    """Two halves of ellipsoids about the x axis, the largest section at x = 0, the nose towards -x, with fins at the tail.

    A fin is a chamber of its own: two skins from lines on the hull, an element to either side of its plane, to its tip edge, with
    ribs between them. Its root is a wall of the hull.

    :param length: from nose to tail [length]; ``radius`` that of the largest section.
    :param around: elements round the hull, a multiple of 8 and of ``fins``, fewer near the ends; ``along`` from nose to tail.
    :param nose: share of the length that lies before the largest section.
    :param fins: number of fins, evenly round the hull, the first one above; 0 is a bare hull.
    :param fin_from: where a fin's root begins, as a share of the length from the nose; ``fin_to`` where it ends; at nodes.
    :param fin_reach: distance of the tip edge from the axis [length]; 1.3 ``radius`` without it.
    :param fin_sweep: how far behind the front of the root the tip edge begins [length].
    :param fin_up: elements of a fin from hull to tip; ``ribs`` walls between its skins, evenly.
    :param bridle_from: where bridles are tied, as shares of the length from the nose, here and at ``bridle_to``.
    :param bridle_angle: angle of these points from the lowest line [degrees].
    :return: element groups ``hull`` (closed, roots included), ``roots``, ``fins`` (skins and ends), ``ribs``; of each fin ``fin_1``
        (skins and ends) and ``into_fin_1`` (its root, whose normals point into it): its pressure has ``group = "fin_1"``,
        ``against = "into_fin_1"``. Node groups ``nose``, ``tail``, ``equator`` (largest section), ``tip_1``, … (a fin's tip edge),
        ``bridle_1`` (front, +y), ``bridle_2`` (front, -y), ``bridle_3``, ``bridle_4`` (rear). Warp runs along the hull.
    """
    _check_hull(length, radius, around, along, nose, fins)
    for name, value in (("bridle_from", bridle_from), ("bridle_to", bridle_to)):
        check_between("hull", name, value, 0.05, 0.95)
    check_between("hull", "bridle_angle", bridle_angle, 0.0, 180.0, "degrees")
    work = Patchwork()
    body = _add_body(work, length, radius, around, along, nose)
    for number, (share, way) in enumerate(itertools.product((bridle_from, bridle_to), (1.0, -1.0)), 1):
        ring = body.rings[body.station(share)]
        turn = way * (math.pi - math.radians(bridle_angle))  # from the top, towards -y
        work.node_groups[f"bridle_{number}"] = ring[round(-turn / (2.0 * math.pi) * len(ring)) % len(ring), None]
    if fins:
        plan = _plan(body, radius, fin_from, fin_to, fin_reach, fin_sweep, fin_up, ribs)
        for number in range(fins):
            _add_fin(work, body, plan, number * (around // fins), number + 1)
    return work.mesh("hull")


@dataclass(frozen=True)
class _Body:
    """The hull: (station,) places along the axis, nodes of its rings, and all its triangles."""

    x: Floats
    radii: Floats
    rings: list[Ints]
    triangles: Ints
    around: int

    def station(self, share: float) -> int:
        """The ring nearest to a share of the length from the nose."""
        return int(np.argmin(np.abs(self.x - self.x[0] - share * (self.x[-1] - self.x[0]))))


@dataclass(frozen=True)
class _Plan:
    """Outline of a fin: stations of its root, places of its tip edge at each of them, and stations of its walls."""

    first: int
    last: int
    tip: Floats
    reach: float
    up: int
    walls: tuple[int, ...]


def _check_hull(length: float, radius: float, around: int, along: int, nose: float, fins: int) -> None:
    check_length("hull", "length", length)
    check_length("hull", "radius", radius)
    check_multiple("hull", "around", around, 8, "so that rings near the ends may have half and a quarter of it")
    check_count("hull", "along", along, 4)
    check_between("hull", "nose", nose, 0.1, 0.9)
    check_count("hull", "fins", fins, 0)
    if fins:
        check_multiple("hull", "around", around, fins, "so that all fins are alike")
        if around < 4 * fins:
            raise InputError(
                f"hull: around = {around} must be at least 4 fins = {4 * fins}, so that there is hull between them"
            )
    check_size("hull", 2 * around * along)


def _add_body(work: Patchwork, length: float, radius: float, around: int, along: int, nose: float) -> _Body:
    """Add the body of revolution, its rings at even arcs of the meridian."""
    halves = nose * length, (1.0 - nose) * length
    turn = np.linspace(0.0, np.pi, 20001)
    fine_x = np.where(turn < 0.5 * np.pi, -halves[0], -halves[1]) * np.cos(turn)
    fine_r = radius * np.sin(turn)
    arc = np.append(0.0, np.cumsum(np.hypot(np.diff(fine_x), np.diff(fine_r))))
    # The largest section is a ring: arcs are even on either side of it.
    middle = arc[len(arc) // 2]
    front = min(max(round(along * middle / arc[-1]), 2), along - 2)
    at = np.append(np.linspace(0.0, middle, front + 1), np.linspace(middle, arc[-1], along - front + 1)[1:])
    x, radii = np.interp(at, arc, fine_x), np.interp(at, arc, fine_r)
    x[front], radii[[0, front, -1]] = 0.0, (0.0, radius, 0.0)
    counts = [_count(2.0 * np.pi * r, around, arc[-1] / along) for r in radii]
    rings, places = [Ring(count) for count in counts], []
    for ring, place, r in zip(rings, x, radii, strict=True):
        cosine, sine = ring_directions(ring)
        places.append(np.column_stack((np.full(ring.count, place), -r * sine, r * cosine)))
    nodes = [work.nodes(place) for place in places]
    bands = [
        np.concatenate((lower, upper))[zip_rings(first, second)]
        for (first, second), (lower, upper) in zip(itertools.pairwise(rings), itertools.pairwise(nodes), strict=True)
    ]
    triangles = np.concatenate(bands)
    work.piece(triangles, ("hull",), [1.0, 0.0, 0.0])
    work.node_groups |= {"nose": nodes[0], "tail": nodes[-1], "equator": nodes[front]}
    return _Body(x, radii, nodes, triangles, around)


def _count(girth: float, around: int, step: float) -> int:
    """Nodes of a ring: the full number, a half or a quarter of it, so that sides are not far below the distance of rings."""
    if girth == 0.0:
        return 1
    for count in (around, around // 2):
        if girth / count >= 0.4 * step:
            return count
    return around // 4


def _plan(
    body: _Body, radius: float, start: float, end: float, reach: float | None, sweep: float, up: int, ribs: int
) -> _Plan:
    """Check and lay out a fin.

    :raises InputError: a fin of no length, that begins where rings have fewer nodes, or whose tip edge lies within the hull.
    """
    check_between("hull", "fin_from", start, 0.05, 0.95)
    check_between("hull", "fin_to", end, 0.05, 0.95)
    check_count("hull", "fin_up", up, 1)
    check_count("hull", "ribs", ribs, 0)
    first, last = body.station(start), body.station(end)
    if last - first < 2:
        raise InputError(
            f"hull: fin_from = {start:g} and fin_to = {end:g} must be two rings of elements apart at least"
        )
    for station in (first, last):
        if len(body.rings[station]) != body.around:
            share = (body.x[station] - body.x[0]) / (body.x[-1] - body.x[0])
            raise InputError(
                f"hull: a fin's root ends at {share:.3g} of the length, where a ring has {len(body.rings[station])} nodes of "
                f"around = {body.around}; move it towards the largest section"
            )
    tip_radius = 1.3 * radius if reach is None else check_length("hull", "fin_reach", reach)
    widest = body.radii[first : last + 1].max()
    if tip_radius <= 1.05 * widest:
        raise InputError(
            f"hull: fin_reach = {tip_radius:g} must be above {1.05 * widest:g}, 1.05 times the hull's radius at the fin"
        )
    root = body.x[first : last + 1]
    check_between("hull", "fin_sweep", sweep, 0.0, 0.9 * (root[-1] - root[0]))
    tip = root + sweep * (root[-1] - root) / (root[-1] - root[0])
    walls = np.unique(np.round(np.linspace(0, last - first, ribs + 2)).astype(int))
    return _Plan(first, last, tip, tip_radius, up, tuple(int(one) for one in walls))


def _add_fin(work: Patchwork, body: _Body, plan: _Plan, column: int, number: int) -> None:
    """Add skins, ends and ribs of a fin about a line of the hull's nodes, and name its root."""
    turn = 2.0 * np.pi * column / body.around
    columns = [(column + k) % body.around for k in (-1, 0, 1)]
    root = np.stack([np.stack(body.rings[plan.first : plan.last + 1])[:, k] for k in columns])
    crest_at = np.column_stack(
        (
            plan.tip,
            np.full_like(plan.tip, -plan.reach * np.sin(turn)),
            np.full_like(plan.tip, plan.reach * np.cos(turn)),
        )
    )
    crest = work.nodes(crest_at)
    share = np.arange(1, plan.up)[None, :, None] / plan.up
    names = ("fins", f"fin_{number}")
    sides = []
    for line, flip in ((root[0], True), (root[2], False)):
        foot = work.points[line][:, None]
        at = np.column_stack((line, work.nodes(foot + share * (crest_at[:, None] - foot)), crest))
        work.piece(quads(at.T if flip else at, banded=True), names, [1.0, 0.0, 0.0])
        sides.append(at)
    for wall in plan.walls:
        rows = [
            root[:, wall],
            *(np.array([left, right]) for left, right in zip(sides[0][wall, 1:-1], sides[1][wall, 1:-1], strict=True)),
            crest[wall, None],
        ]
        triangles = np.concatenate([zip_rows(lower, upper) for lower, upper in itertools.pairwise(rows)])
        rear = wall == plan.last - plan.first
        groups = names if rear or wall == 0 else ("ribs",)
        # Rows run from the side of smaller angles over, with the tip above: seen from the front.
        work.piece(triangles[:, ::-1] if rear else triangles, groups, crest_at[wall] * (0.0, 1.0, 1.0))
    inside = np.isin(body.triangles, root).sum(axis=1) == 3
    work.name(np.flatnonzero(inside), "roots", f"into_fin_{number}")
    work.node_groups[f"tip_{number}"] = crest
