"""Tube with caps, arch, sphere and disc, from rings of nodes.

Every function takes keyword arguments only, lengths in the user's unit, and returns a validated
:class:`~taichi_membrane.mesh.Mesh` whose normals point outwards (flat shapes: along +z). Arguments out of range raise
:class:`~taichi_membrane.errors.InputError` with the argument, its value and the allowed range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_count, check_length, check_name, check_size
from taichi_membrane.shapes.grading import positions, ring_places
from taichi_membrane.shapes.rings import Ring, ring_directions, wall_triangles, zip_stack
from taichi_membrane.shapes.true_surface import of_order, on_rings, on_sphere, on_torus, on_tube

Cap = Literal["none", "flat", "hemisphere"]
WallPattern = Literal["staggered", "diagonal", "alternating"]

# Height over side of an equilateral triangle: the distance of rings that suits a given side.
_EVEN = math.sqrt(3.0) / 2.0


def tube(
    *,
    radius: float,
    length: float,
    around: int,
    along: int,
    cap_start: Cap = "none",
    cap_end: Cap = "hemisphere",
    pattern: WallPattern = "staggered",
    order: int = 1,
    grade: Mapping[str, float] | None = None,
) -> Mesh:
    """Straight tube along +x, its wall from x = 0 to ``length``; a hemisphere reaches ``radius`` beyond its end.

    Nodes 0 to ``around`` - 1 are the ring at x = 0, node 0 at the top (+z). Symmetric about y = 0.

    :param radius: radius of the nodes of the wall [length].
    :param around: nodes on a ring, at least 3; even keeps the symmetry about z = 0 too.
    :param along: bands of elements along the wall, at least 1.
    :param pattern: ``staggered`` turns each ring half a pitch; ``diagonal`` has straight generators, ``alternating`` (order 2,
        even ``around``) too, with diagonals that turn from one square to the next.
    :param order: 1 for three-node triangles, 2 for six-node ones with the nodes amid their sides on the round surface.
    :param grade: lengths of the bands beside the rings ``start``, ``middle`` and ``end``, on caps too; from there they grow until
        they are as long as ``along`` even ones (:mod:`.grading`).
    :return: node groups ``start``, ``end``, ``middle`` (where a ring lies there, as with even ``along``), ``cap_start``,
        ``cap_end`` (with their rims), ``tip`` (pole of the end cap); element groups ``wall``, ``cap_start``, ``cap_end``. Warp runs
        along the axis, on caps from the rim to the pole.
    """
    radius, length = check_length("tube", "radius", radius), check_length("tube", "length", length)
    _check_wall("tube", around, along, 1, pattern, order)
    for name, cap_kind in (("cap_start", cap_start), ("cap_end", cap_end)):
        check_name("tube", name, cap_kind, get_args(Cap))
    places = ring_places("tube", length, along, grade, ("start", "middle", "end"), pattern)
    along = len(places) - 1
    check_size("tube", 2 * around * (along + around))
    phases = _wall_phases(along, pattern, first=0)
    cosine, sine = _wall_directions(around, phases)
    points = np.column_stack((np.repeat(places, around), -radius * sine, radius * cosine))
    triangles = wall_triangles(around=around, along=along, pattern=pattern, first_phase=0)
    warp = np.tile([1.0, 0.0, 0.0], (len(triangles), 1))
    start = np.arange(around)
    node_groups = {"start": start, "end": start + around * along}
    if along % 2 == 0 and abs(places[along // 2] - 0.5 * length) <= 1e-9 * length:
        node_groups["middle"] = start + around * along // 2
    tri_groups = {"wall": np.arange(len(triangles))}
    for end, kind, phase, outwards in (("start", cap_start, phases[0], -1), ("end", cap_end, phases[-1], 1)):
        if kind == "none":
            continue
        name, rim, first = f"cap_{end}", node_groups[end], (grade or {}).get(end)
        cap_points, cap = cap_of(kind, radius, Ring(around, int(phase)), outwards, first=first)
        cap_points[:, 0] += points[rim[0], 0]
        node_groups[name] = np.concatenate((rim, len(points) + np.arange(len(cap_points))))
        tri_groups[name] = len(triangles) + np.arange(len(cap))
        points = np.concatenate((points, cap_points))
        triangles = np.concatenate((triangles, node_groups[name][cap]))
        warp = np.concatenate((warp, cap_points[-1] - points[node_groups[name][cap]].mean(axis=1)))
    if cap_end != "none":
        node_groups["tip"] = node_groups["cap_end"][-1:]
    mesh = Mesh.build(points, triangles, node_groups, tri_groups, warp, where="tube")
    return of_order(mesh, order, on_tube(radius, length, (cap_start, cap_end)), "tube")


def _check_wall(where: str, around: int, along: int, lowest_along: int, pattern: str, order: int) -> None:
    check_count(where, "around", around, 3)
    check_count(where, "along", along, lowest_along)
    check_name(where, "pattern", pattern, get_args(WallPattern))
    if pattern == "alternating":
        if order == 1:
            raise InputError(
                f"{where}: pattern = 'alternating' is for order = 2; flat triangles on it are wrong by up to 65 % once they wrinkle"
            )
        if around % 2:
            raise InputError(f"{where}: pattern = 'alternating' needs an even number of elements around, not {around}")
    check_size(where, 2 * around * (along + around))  # a cap has fewer elements than around²


def _wall_phases(along: int, pattern: str, *, first: int) -> NDArray[np.int64]:
    """Return the phase of each ring of a wall, in half pitches."""
    return (np.arange(along + 1) + first) % 2 if pattern == "staggered" else np.zeros(along + 1, dtype=np.int64)


def _wall_directions(around: int, phases: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return cosine and sine of all nodes of successive rings with the given phases, ring after ring."""
    directions = np.array([ring_directions(Ring(around, phase)) for phase in (0, 1)])[phases]
    return directions[:, 0].ravel(), directions[:, 1].ravel()


def cap_of(
    kind: str, radius: float, rim: Ring, outwards: int, *, first: float | None = None
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Close a rim in the plane x = 0 towards +x or -x: the points beyond the rim, pole last, and the triangles.

    The triangles number the rim first. Rings follow it at the distance that suits its side length, and each has as
    many nodes as keep that side.

    :param first: length of the band beside the rim, from which they grow, in rings that are not turned; None where bands are even.
    """
    meridian = radius * (math.pi / 2.0 if kind == "hemisphere" else 1.0)
    steps = max(1, round(meridian / (_EVEN * 2.0 * math.pi * radius / rim.count)))
    shares = np.arange(steps + 1) / steps
    if first is not None and first < meridian / steps:
        shares = positions(meridian, meridian / steps, first, None) / meridian
    multiple = 2 - rim.count % 2  # an even rim is followed by even rings: two planes of symmetry
    rings, points = [rim], []
    for step, share in enumerate(shares[1:-1], 1):
        if kind == "hemisphere":
            ring_radius, x = math.cos(share * math.pi / 2.0), math.sin(share * math.pi / 2.0)
        else:
            ring_radius, x = 1.0 - share, 0.0
        count = max(multiple * round(rim.count * ring_radius / multiple), 3 if multiple == 1 else 4)
        rings.append(Ring(count, (rim.phase + (step if first is None else 0)) % 2))
        cosine, sine = ring_directions(rings[-1])
        points.append(np.column_stack((np.full(count, outwards * x), -ring_radius * sine, ring_radius * cosine)))
    rings.append(Ring(1))
    points.append(np.array([[outwards if kind == "hemisphere" else 0.0, 0.0, 0.0]]))
    triangles = zip_stack(rings)
    return radius * np.concatenate(points), triangles if outwards > 0 else triangles[:, ::-1]


def arch(
    *,
    span: float,
    radius: float,
    around: int,
    along: int,
    angle: float = 180.0,
    pattern: WallPattern = "staggered",
    order: int = 1,
    grade: Mapping[str, float] | None = None,
) -> Mesh:
    """Open tube bent to a circular arc in the xz plane: feet centred at x = ±``span``/2, z = 0, crown at the top.

    :param span: distance of the centres of the feet [length].
    :param radius: radius of the tube [length], less than that of the arc.
    :param around: nodes on a ring, at least 3.
    :param along: bands of elements from foot to foot, at least 2.
    :param angle: angle of the arc [degrees], above 0 and below 360; 180 stands upright on its feet.
    :param order, grade: as of :func:`tube`; lengths along the arc of the bands beside ``start``, ``crown`` and ``end``.
    :return: node groups ``start`` (foot at -x), ``end``, and where a ring lies there, as with even ``along``, ``crown`` (it) and
        ``crown_top`` (its highest node); element group ``wall``. Warp runs along the tube.
    """
    span = check_length("arch", "span", span)
    radius = check_length("arch", "radius", radius)
    _check_wall("arch", around, along, 2, pattern, order)
    angle = check_length("arch", "angle", angle)
    if angle >= 360.0:
        raise InputError(f"arch: angle = {angle:g} must be below 360 degrees")
    half = math.radians(angle) / 2.0
    arc_radius = span / (2.0 * math.sin(half))
    if radius >= arc_radius:
        raise InputError(f"arch: radius = {radius:g} must be below the radius of the arc, {arc_radius:g}")

    # Counted from the crown, so that the two halves are mirror images to the last bit.
    if grade:
        places = ring_places("arch", 2.0 * half * arc_radius, along, grade, ("start", "crown", "end"), pattern)
        along = len(places) - 1
        check_size("arch", 2 * around * along)
        turns = places / arc_radius - half
        if grade.get("start") == grade.get("end"):
            turns = 0.5 * (turns - turns[::-1])
    else:
        turns = half * (2 * np.arange(along + 1) - along) / along
    first_phase = (along // 2) % 2  # so that the middle ring has a node on the outer side
    cosine, sine = _wall_directions(around, _wall_phases(along, pattern, first=first_phase))
    turn = np.repeat(turns, around)
    from_centre = arc_radius + radius * cosine
    height = arc_radius * math.cos(half)
    points = np.column_stack((from_centre * np.sin(turn), -radius * sine, from_centre * np.cos(turn) - height))
    triangles = wall_triangles(around=around, along=along, pattern=pattern, first_phase=first_phase)
    centroid = points[triangles].mean(axis=1)
    warp = np.column_stack((centroid[:, 2] + height, np.zeros(len(centroid)), -centroid[:, 0]))
    node_groups = {"start": np.arange(around), "end": around * along + np.arange(around)}
    if along % 2 == 0 and abs(turns[along // 2]) <= 1e-9 * half:
        node_groups["crown"] = around * along // 2 + np.arange(around)
        node_groups["crown_top"] = node_groups["crown"][:1]
    mesh = Mesh.build(points, triangles, node_groups, {"wall": np.arange(len(triangles))}, warp, where="arch")
    return of_order(mesh, order, on_torus(arc_radius, radius, height), "arch")


def sphere(*, radius: float, divisions: int, order: int = 1) -> Mesh:
    """Sphere from an octahedron, each face cut into ``divisions``² triangles; the three axes meet it in nodes.

    :param divisions: elements along a quarter of a great circle, at least 1.
    :return: node groups ``north`` (+z), ``south``, ``x_plus``, ``x_minus``, ``y_plus``, ``y_minus`` (one node each) and
        ``equator`` (z = 0). Warp runs along the meridians, northwards.
    """
    radius = check_length("sphere", "radius", radius)
    check_count("sphere", "divisions", divisions, 1)
    check_size("sphere", 8 * divisions**2)
    n = divisions
    # Rings of 4, 8, … 4 n … 8, 4 nodes between the poles are the rows of the eight faces.
    rows = [*range(n + 1), *range(n - 1, -1, -1)]
    triangles = zip_stack([Ring(max(4 * row, 1)) for row in rows])
    southern = np.concatenate([_octahedron_row(row, n) for row in rows[:n]]) * (1.0, 1.0, -1.0)
    northern = np.concatenate([_octahedron_row(row, n) for row in rows[n:]])
    equator = len(southern) + np.arange(4 * n)
    points = radius * np.concatenate((southern, northern))
    node_groups = {"south": np.array([0]), "north": np.array([len(points) - 1]), "equator": equator}
    for quarter, name in enumerate(("x_plus", "y_plus", "x_minus", "y_minus")):
        node_groups[name] = equator[quarter * n : quarter * n + 1]
    warp = np.tile([0.0, 0.0, 1.0], (len(triangles), 1))
    mesh = Mesh.build(points, triangles, node_groups, None, warp, where="sphere")
    return of_order(mesh, order, on_sphere(radius), "sphere")


def _octahedron_row(row: int, divisions: int) -> NDArray[np.float64]:
    """Return the nodes of one row of the northern faces, 0 at the pole, as points of the unit sphere from +x round."""
    step = np.arange(max(row, 1))
    a, b = (row - step) / divisions, step / divisions
    c = np.full(len(step), (divisions - row) / divisions)
    # The sines space the nodes of the face's sides evenly along their great circles. The product widens the middle of
    # the face: areas then differ by a factor of 1.32 (1.75 without it, 4.9 for a projection) with angles above 41.5°.
    bulge = 2.0 * a * b * c
    x, y, z = (np.sin(np.pi / 2.0 * weight) + bulge for weight in (a, b, c))
    length = np.sqrt((x**2 + y**2) + z**2)
    x, y, z = x / length, y / length, z / length
    quarters = ((x, y, z), (-y, x, z), (-x, -y, z), (y, -x, z))
    return np.concatenate([np.column_stack(quarter) for quarter in (quarters if row else quarters[:1])])


def disc(*, radius: float, rings: int, sectors: int = 6, order: int = 1) -> Mesh:
    """Flat disc in z = 0 about the origin; ring k has ``sectors`` * k nodes at k / ``rings`` of the radius.

    :param rings: bands of elements from the centre to the rim, at least 1.
    :param sectors: elements round the centre, at least 3; 6 makes them nearly equilateral.
    :return: node groups ``rim`` and ``centre``; normals along +z. Warp runs along x.
    """
    radius = check_length("disc", "radius", radius)
    check_count("disc", "rings", rings, 1)
    check_count("disc", "sectors", sectors, 3)
    check_size("disc", sectors * rings**2)
    inwards = [Ring(sectors * k) for k in range(rings, 0, -1)]
    points = []
    for ring in inwards:
        cosine, sine = ring_directions(ring)
        ring_radius = radius * (ring.count // sectors) / rings
        points.append(np.column_stack((ring_radius * cosine, ring_radius * sine, np.zeros(ring.count))))
    points.append(np.zeros((1, 3)))
    xyz = np.concatenate(points)
    triangles = zip_stack([*inwards, Ring(1)])
    node_groups = {"rim": np.arange(sectors * rings), "centre": np.array([len(xyz) - 1])}
    warp = np.tile([1.0, 0.0, 0.0], (len(triangles), 1))
    mesh = Mesh.build(xyz, triangles, node_groups, None, warp, where="disc")
    return of_order(mesh, order, on_rings(radius), "disc")
