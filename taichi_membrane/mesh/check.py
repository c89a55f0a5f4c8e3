"""Refuses triangle lists that cannot be a membrane, each with one message that says which element and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh.loose import Loose
from taichi_membrane.mesh.topology import EdgeTable, node_parts, sorted_unique

LARGEST_COORDINATE = 1e30  # areas squared, and their sums, must not overflow
# A triangle flatter than this (area over longest edge squared) has no usable normal in double precision.
FLATTEST_TRIANGLE = 1e-12
# Volume over area^(3/2) below which a closed body counts as flat, not inside out: the round-off of a sum over 1e6
# triangles is about 1e-13, a sheet of 1 m drawn with 1 mm of waviness has 1e-4.
FLAT_BODY = 1e-9
# Sine of the angle between a warp direction and the element's normal below which its projection is noise.
STEEPEST_WARP = 1e-9


class MeshFault(InputError):
    """A fault of named elements and nodes, so that a reader can say what they are called in its file."""

    def __init__(self, message: str, *, elements: Sequence[int] = (), nodes: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.elements, self.nodes = tuple(elements), tuple(nodes)


def as_points(points: ArrayLike, where: str) -> NDArray[np.float64]:
    """Return a private (n, 3) float64 copy; refuse other shapes, no points and coordinates that are not finite."""
    try:
        array = np.array(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: the points are not an array of numbers: {error}") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{where}: points must have shape (node_count, 3), got {array.shape}")
    if len(array) == 0:
        raise InputError(f"{where}: the mesh has no nodes")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        at = tuple(array[bad[0]].tolist())
        raise MeshFault(
            f"{where}: node {bad[0]} has coordinates {at} that are not finite; {bad.size} such nodes in all",
            nodes=[int(bad[0])],
        )
    bad = np.flatnonzero((np.abs(array) > LARGEST_COORDINATE).any(axis=1))
    if bad.size:
        at = tuple(array[bad[0]].tolist())
        raise InputError(
            f"{where}: node {bad[0]} has coordinates {at} beyond {LARGEST_COORDINATE:g}; {bad.size} such nodes in all"
        )
    return array


def _as_integers(values: ArrayLike, what: str) -> NDArray[np.int64]:
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} are not an array of whole numbers: {error}") from None
    if array.size and array.dtype.kind not in "iu":
        raise InputError(f"{what} must be whole numbers, got {array.dtype}")
    return array.astype(np.int64)


def as_triangles(triangles: ArrayLike, node_count: int, where: str) -> NDArray[np.int32]:
    """Return a private (m, 3) int32 copy; refuse other shapes, none at all and node numbers out of range."""
    array = _as_integers(triangles, f"{where}: the node numbers of the triangles")
    if array.size == 0:
        raise InputError(f"{where}: the mesh has no triangles")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{where}: triangles must have shape (tri_count, 3), got {array.shape}")
    bad = np.flatnonzero(((array < 0) | (array >= node_count)).any(axis=1))
    if bad.size:
        nodes = array[bad[0]]
        node = int(nodes[(nodes < 0) | (nodes >= node_count)][0])
        raise InputError(
            f"{where}: element {bad[0]} uses node {node}, but node numbers run from 0 to {node_count - 1}; "
            f"{bad.size} such elements in all"
        )
    return array.astype(np.int32)


def area_vectors(points: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return half the cross product of two sides per triangle (m, 3): length is the area, direction the normal."""
    p0, p1, p2 = (points[triangles[:, corner]] for corner in range(3))
    return 0.5 * np.cross(p1 - p0, p2 - p0)


def check_elements(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    tri_area: NDArray[np.float64],
    where: str,
    hint: str = "",
    middles: NDArray[np.int32] | None = None,
) -> None:
    """Refuse repeated corners, triangles without area, and nodes that no triangle uses (``hint`` says how to mend that)."""
    a, b, c = triangles.T
    bad = np.flatnonzero((a == b) | (b == c) | (c == a))
    if bad.size:
        nodes = tuple(triangles[bad[0]].tolist())
        told = f"{where}: element {bad[0]} repeats a node: {nodes}; {bad.size} such elements in all"
        raise MeshFault(told, elements=[int(bad[0])])
    longest = np.maximum.reduce([((points[i] - points[j]) ** 2).sum(axis=1) for i, j in ((a, b), (b, c), (c, a))])
    bad = np.flatnonzero(~(tri_area > FLATTEST_TRIANGLE * longest))
    if bad.size:
        t = bad[0]
        raise MeshFault(
            f"{where}: element {t} (nodes {tuple(triangles[t].tolist())}) is degenerate: area {tri_area[t]:.3g} with a "
            f"longest edge of {np.sqrt(longest[t]):.3g}; {bad.size} such elements in all",
            elements=[int(t)],
        )
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    if middles is not None:
        used[middles] = True
    bad = np.flatnonzero(~used)
    if bad.size:
        told = f"{bad.size} of {len(points)} nodes belong to no element, the first is node {bad[0]}"
        raise InputError(f"{where}: {told}" + (f". Leave them out{hint}" if hint else ""))


def check_edges(triangles: NDArray[np.int32], table: EdgeTable, where: str, hint: str = "") -> None:
    """Refuse duplicate triangles, and neighbours with opposite normals.

    Any number of triangles may meet at an edge. Where more than two do, no orientation suits all of them: that is asked of each
    chamber (:mod:`taichi_membrane.simulation.chambers`).
    """
    _check_duplicates(triangles, table, where)
    tail = triangles.reshape(-1)[table.half_edges]
    head = triangles[:, [1, 2, 0]].reshape(-1)[table.half_edges]
    ascending = np.add.reduceat((tail < head).astype(np.int64), table.start)
    bad = np.flatnonzero((table.tri_count == 2) & (ascending != 1))
    if bad.size:
        first, second = table.triangles_at(int(bad[0]))
        raise MeshFault(
            f"{where}: elements {first} and {second} run along their common edge, nodes {_pair(table, int(bad[0]))}, "
            f"in the same direction, so their normals point to opposite sides; {bad.size} such edges in all. "
            f"Orient the triangles alike (counter-clockwise seen from the positive side){hint}",
            elements=[first, second],
        )


def _check_duplicates(triangles: NDArray[np.int32], table: EdgeTable, where: str) -> None:
    # The edge of the two lower nodes and the highest node name a triangle whatever its corner order.
    edge = np.empty(3 * len(triangles), dtype=np.int64)
    edge[table.half_edges] = np.repeat(np.arange(len(table.start)), table.tri_count)
    top_corner = np.argmax(triangles, axis=1)
    rows = np.arange(len(triangles))
    key = edge[3 * rows + (top_corner + 1) % 3] * (int(triangles.max()) + 1) + triangles[rows, top_corner]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    if same.size:
        first, second = sorted(order[same[0] : same[0] + 2].tolist())
        raise MeshFault(
            f"{where}: elements {first} and {second} have the same three nodes {sorted(triangles[first].tolist())}; "
            f"{same.size} duplicates in all",
            elements=[first, second],
        )


def check_bodies(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    table: EdgeTable,
    tri_area: NDArray[np.float64],
    where: str,
    hint: str = "",
) -> None:
    """Refuse a closed body that is inside out: pressure would act inwards."""
    inverted, label, volume = inverted_bodies(points, triangles, table, tri_area)
    if inverted:
        part = inverted[0]
        several = label.any()
        which = f" with node {int(np.argmax(label == part))}, one of {len(inverted)} such bodies," if several else ""
        raise InputError(
            f"{where}: the closed body{which} is inside out: its enclosed volume is {volume[part]:.6g}, so a positive "
            f"pressure would act inwards. Reverse the corner order of its triangles{hint}"
        )


def inverted_bodies(
    points: NDArray[np.float64], triangles: NDArray[np.int32], table: EdgeTable, tri_area: NDArray[np.float64]
) -> tuple[list[int], NDArray[np.int32], NDArray[np.float64]]:
    """Return the closed parts that are inside out, the part of each node, and the enclosed volume of each part.

    A cavity inside a larger body, whose own normals point into it, is right and is not among them; nor is a body with inner walls.
    """
    count, label = node_parts(table.nodes, len(points))
    closed = np.ones(count, dtype=bool)
    closed[label[table.nodes[table.tri_count != 2, 0]]] = False
    volume = part_volumes(points, triangles, label)
    area = np.bincount(label[triangles[:, 0]], weights=tri_area, minlength=count)
    negative = np.flatnonzero(closed & (volume < -FLAT_BODY * area**1.5))
    inverted = [part for part in negative.tolist() if not _is_cavity(points, label, volume, closed, part)]
    return inverted, label, volume


def part_volumes(
    points: NDArray[np.float64], triangles: NDArray[np.int32], label: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the enclosed volume of each connected part (signed; meaningful for closed parts only)."""
    # Measured from the middle of the mesh: far from the origin the sum would cancel to round-off.
    p0, p1, p2 = (points[triangles[:, corner]] - points.mean(axis=0) for corner in range(3))
    weights = (p0 * np.cross(p1, p2)).sum(axis=1)
    return np.bincount(label[triangles[:, 0]], weights=weights, minlength=int(label.max()) + 1) / 6.0


def _is_cavity(
    points: NDArray[np.float64],
    label: NDArray[np.int32],
    volume: NDArray[np.float64],
    closed: NDArray[np.bool_],
    part: int,
) -> bool:
    inner = points[label == part]
    for other in np.flatnonzero(closed & (volume > -volume[part])).tolist():
        outer = points[label == other]
        if (outer.min(axis=0) < inner.min(axis=0)).all() and (inner.max(axis=0) < outer.max(axis=0)).all():
            return True
    return False


def as_groups(groups: Mapping[str, ArrayLike], count: int, kind: str, where: str) -> dict[str, NDArray[np.int32]]:
    """Return the groups as sorted unique int32 arrays; ``kind`` is "node", "element" or "line" for the message."""
    out: dict[str, NDArray[np.int32]] = {}
    for name, members in groups.items():
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"{where}: a {kind} group must have a name, got {name!r}")
        array = sorted_unique(_as_integers(members, f"{where}: the members of {kind} group '{name}'").ravel())
        if array.size == 0:
            raise InputError(f"{where}: {kind} group '{name}' is empty")
        if array[0] < 0 or array[-1] >= count:
            bad = array[0] if array[0] < 0 else array[-1]
            raise InputError(
                f"{where}: {kind} group '{name}' holds {bad}, but {kind} numbers run from 0 to {count - 1}"
            )
        if name == "all" and array.size != count:
            raise InputError(
                f"{where}: the {kind} group name 'all' is reserved for all {count}, the group given holds {array.size}"
            )
        out[name] = frozen(array.astype(np.int32))
    return out


def as_loose(
    points: ArrayLike | None,
    lines: ArrayLike | None,
    line_groups: Mapping[str, ArrayLike] | None,
    groups: Mapping[str, ArrayLike] | None,
    node_count: int,
    where: str,
) -> Loose:
    """Return lines and loose points with frozen arrays; refuse numbers out of range and lines from a node to itself."""
    empty = points is None or np.size(points) == 0
    at = frozen(np.empty((0, 3)) if empty else as_points(np.asarray(points), f"{where}: loose points"))
    total = node_count + len(at)
    if lines is None or np.size(lines) == 0:
        pairs = np.empty((0, 2), dtype=np.int32)
    else:
        wide = _as_integers(lines, f"{where}: the node numbers of the lines")
        if wide.ndim != 2 or wide.shape[1] != 2:
            raise InputError(f"{where}: lines must have shape (line_count, 2), got {wide.shape}")
        bad = np.flatnonzero(((wide < 0) | (wide >= total)).any(axis=1) | (wide[:, 0] == wide[:, 1]))
        if bad.size:
            told = f"joins nodes {tuple(wide[bad[0]].tolist())}; two different ones from 0 to {total - 1} are needed"
            raise InputError(f"{where}: line {bad[0]} {told}")
        pairs = wide.astype(np.int32)
    named = as_groups(groups or {}, total, "node", where)
    for name, members in named.items():
        if members[0] < node_count:
            raise InputError(
                f"{where}: loose group '{name}' holds {members[0]}; loose points are {node_count} to {total - 1}"
            )
    return Loose(at, named, frozen(pairs), as_groups(line_groups or {}, len(pairs), "line", where), node_count)


def as_warp(directions: ArrayLike, area_vector: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Return the directions (m, 3) projected on their elements and made unit; refuse those along a normal."""
    try:
        array = np.array(directions, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: the warp directions are not an array of numbers: {error}") from None
    if array.shape != area_vector.shape:
        raise InputError(f"{where}: warp directions must have shape {area_vector.shape}, got {array.shape}")
    normal = area_vector / np.linalg.norm(area_vector, axis=1, keepdims=True)
    in_plane = array - (array * normal).sum(axis=1, keepdims=True) * normal
    length = np.linalg.norm(in_plane, axis=1)
    bad = np.flatnonzero(~(length > STEEPEST_WARP * np.linalg.norm(array, axis=1)))
    if bad.size:
        t = bad[0]
        raise InputError(
            f"{where}: the warp direction {tuple(array[t].tolist())} of element {t} has no part in the element's plane "
            f"(normal {tuple(np.round(normal[t], 6).tolist())}); {bad.size} such elements in all"
        )
    return in_plane / length[:, None]


def as_fields(fields: Mapping[str, ArrayLike], count: int, where: str) -> dict[str, NDArray[np.float64]]:
    """Return element data as read-only arrays (count,) or (count, k); their numbers are looked at where they are used."""
    found = {}
    for name, values in fields.items():
        try:
            array = np.array(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{where}: the element data {name!r} are not an array of numbers: {error}") from None
        if array.ndim not in (1, 2) or len(array) != count or not array.size:
            raise InputError(f"{where}: the element data {name!r} have shape {array.shape}, {count} elements are there")
        found[name] = frozen(array)
    return found


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array


def _pair(table: EdgeTable, edge: int) -> tuple[int, int]:
    low, high = table.nodes[edge].tolist()
    return low, high


def _listed(numbers: list[int]) -> str:
    shown = ", ".join(str(n) for n in numbers[:5])
    return shown if len(numbers) <= 5 else f"{shown}, …"
