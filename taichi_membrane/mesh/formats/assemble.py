"""From what a file says to the arrays of a mesh: quads split, nodes counted, lines and lone points kept apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import CORNERS, RawMesh
from taichi_membrane.mesh.formats.source import Source, listed, several
from taichi_membrane.mesh.precision import resolution
from taichi_membrane.mesh.topology import sorted_unique

Ints = NDArray[np.int64]
_ROUND_OFF = 1e-12  # relative; figures of a quad that differ by less are equal but for the rounding of its coordinates


@dataclass(frozen=True, eq=False)
class MeshParts:
    """What a file holds, before validation. Nodes of triangles come first; the numbers after theirs are loose points.

    :param points: (n, 3) nodes that triangles use.
    :param loose_points: (k, 3) nodes that only lines and groups use; node n + i is the i-th of them.
    :param lines: (m, 2) node numbers of line elements.
    :param loose_groups: named node numbers, all of them n or above.
    :param line_groups: named numbers of lines.
    :param tri_middle: (m, 3) nodes amid the sides opposite each corner, of six-node triangles.
    :param tri_fields: numbers of the triangles, (m,) or (m, k), by name.
    :param resolution: last digit of the coordinates as the file gives them [length].
    :param element_name, node_name: what the file calls a triangle and a node, for messages.
    """

    points: NDArray[np.float64]
    triangles: Ints
    node_groups: dict[str, Ints]
    tri_groups: dict[str, Ints]
    tri_warp: NDArray[np.float64] | None
    loose_points: NDArray[np.float64]
    lines: Ints
    loose_groups: dict[str, Ints]
    line_groups: dict[str, Ints]
    resolution: float
    element_name: Callable[[int], str] | None
    node_name: Callable[[int], str] | None
    notes: list[str] = field(default_factory=list)
    tri_fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    tri_middle: Ints | None = None


def assemble(source: Source, raw: RawMesh) -> MeshParts:
    """Turn a file's content into the arrays of a mesh.

    :raises InputError: no triangles, cells of nodes that there are not, coordinates that are not finite.
    """
    notes = list(raw.notes)
    _check(source, raw)
    points, raw = _welded(raw)
    cells, tri_cell = _surface(source, points, raw, notes)
    triangles, middles = cells[:, :3], cells[:, 3:] if cells.shape[1] == 6 else None
    lines, line_cell = _lines(raw)
    first = np.full(raw.cell_count, -1, dtype=np.int64)
    count = np.zeros(raw.cell_count, dtype=np.int64)
    first[tri_cell[::-1]] = np.arange(len(tri_cell))[::-1]
    np.add.at(count, tri_cell, 1)
    nodes, tri_groups, line_groups = _groups(raw, cells, lines, first, count, line_cell, notes)
    used = np.zeros(len(points), dtype=bool)
    used[cells] = True
    kept = np.zeros(len(points), dtype=bool)
    kept[lines] = True
    for members in nodes.values():
        kept[members] = True
    kept &= ~used
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = np.arange(used.sum())
    number[kept] = used.sum() + np.arange(kept.sum())
    unused = int((number < 0).sum())
    if unused:
        notes.append(f"left out {several(unused, 'node')} that no element and no group uses")
    nodes, tri_groups = (
        _without_reserved(nodes, int(used.sum()), notes),
        _without_reserved(tri_groups, len(triangles), notes),
    )
    renumbered = {name: number[members] for name, members in nodes.items()}
    loose = {name: np.sort(members[members >= used.sum()]) for name, members in renumbered.items()}
    inside = {name: np.sort(members[members < used.sum()]) for name, members in renumbered.items()}
    for name, members in loose.items():
        if members.size and not inside[name].size:
            notes.append(f"group '{name}' holds only {several(members.size, 'point')} that no triangle uses")
    return MeshParts(
        points=points[used],
        triangles=number[triangles],
        node_groups={name: members for name, members in inside.items() if members.size},
        tri_groups=tri_groups,
        tri_warp=None if raw.tri_warp is None else raw.tri_warp[tri_cell],
        loose_points=points[kept],
        lines=number[lines],
        loose_groups={name: members for name, members in loose.items() if members.size},
        line_groups=line_groups,
        resolution=resolution(raw.points) if raw.resolution is None else raw.resolution,
        element_name=_through(raw.cell_name, tri_cell),
        node_name=_through(raw.node_name, np.flatnonzero(used)),
        notes=notes,
        tri_fields={name: values[tri_cell] for name, values in raw.cell_fields.items()},
        tri_middle=None if middles is None else number[middles],
    )


def _without_reserved(groups: dict[str, Ints], count: int, notes: list[str]) -> dict[str, Ints]:
    """The groups with other names for those that a mesh cannot give: none, and "all" for a part."""
    found: dict[str, Ints] = {}
    for name, members in groups.items():
        own = name if name.strip() else "unnamed"
        own = "all_of_file" if own == "all" and len(members) != count else own
        while own != name and (own in groups or own in found):
            own += "_2"
        told = f"the group named {name!r} goes by the name '{own}'"
        if own != name and told not in notes:
            notes.append(told)
        found[own] = members
    return found


def _through(name: Callable[[int], str] | None, places: Ints) -> Callable[[int], str] | None:
    """The names of things that stand at other places in the file."""
    return None if name is None else lambda number: name(int(places[number]))


def _check(source: Source, raw: RawMesh) -> None:
    """Refuse what no numbering can make good: points without three numbers, cells without nodes, no triangles."""
    if raw.points.ndim != 2 or raw.points.shape[1] != 3:
        raise source.fault(f"points of three coordinates are expected, got an array of shape {raw.points.shape}")
    if not any(block.kind in ("triangle", "triangle6", "quad") and len(block.nodes) for block in raw.cells):
        held = [
            several(len(block.nodes), block.kind, "vertices" if block.kind == "vertex" else "")
            for block in raw.cells
            if len(block.nodes)
        ]
        told = f", only {listed(held)}" if held else " and no cells"
        told += f", and {several(len(raw.points), 'node')}"
        raise source.fault(f"the file holds no triangles{told}{'; ' if raw.notes else ''}{'; '.join(raw.notes)}")
    number = 0
    for block in raw.cells:
        bad = np.flatnonzero(((block.nodes < 0) | (block.nodes >= len(raw.points))).any(axis=1))
        if bad.size:
            nodes = block.nodes[bad[0]]
            node = int(nodes[(nodes < 0) | (nodes >= len(raw.points))][0])
            cell = int(number + bad[0])
            name = raw.cell_name(cell) if raw.cell_name else f"{block.kind} {cell}"
            raise source.fault(f"{name} uses node {node}, but node numbers run from 0 to {len(raw.points) - 1}")
        number += len(block.nodes)


def _welded(raw: RawMesh) -> tuple[NDArray[np.float64], RawMesh]:
    """Points and content with equal positions made one node, where the format has no node numbers."""
    if not raw.welded:
        return raw.points, raw
    points, number = weld(raw.points)
    for at, block in enumerate(raw.cells):
        raw.cells[at] = type(block)(block.kind, number[block.nodes])
    raw.point_groups = {name: np.unique(number[members]) for name, members in raw.point_groups.items()}
    return points, raw


def weld(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], Ints]:
    """The distinct positions in the order they first come, and the number of each point among them.

    Exactly equal positions only. Sorted by a 64-bit mixture of the coordinates, which takes a sixth of the time of sorting rows;
    positions of one mixture that differ (never seen) are left to sorting rows.
    """
    clean = points + 0.0  # -0.0 and 0.0 are one place
    bits = np.ascontiguousarray(clean).view(np.uint64)
    key = bits[:, 0].copy()
    for column in (1, 2):
        key = (key ^ (key >> np.uint64(31))) * np.uint64(0x9E3779B97F4A7C15) + bits[:, column]
    key = (key ^ (key >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    order = np.argsort(key, kind="stable")
    new = np.concatenate(([True], np.diff(key[order]) != 0)) if len(order) else np.empty(0, dtype=bool)
    label = np.cumsum(new) - 1
    if (clean[order] != clean[order[new]][label]).any():
        _, first, inverse = np.unique(clean, axis=0, return_index=True, return_inverse=True)
        label_of, first = inverse.ravel(), first
    else:
        label_of = np.empty(len(points), dtype=np.int64)
        label_of[order] = label
        first = order[new]  # the sort is stable: the first point of each place
    rank = np.empty(len(first), dtype=np.int64)
    by_first = np.argsort(first)
    rank[by_first] = np.arange(len(first))
    return clean[first[by_first]], rank[label_of]


def _of_kind(raw: RawMesh, kind: str) -> tuple[Ints, Ints]:
    """All cells of one kind and their numbers."""
    nodes, numbers, offset = [np.empty((0, CORNERS[kind]), dtype=np.int64)], [np.empty(0, dtype=np.int64)], 0  # type: ignore[index]
    for block in raw.cells:
        if block.kind == kind:
            nodes.append(block.nodes)
            numbers.append(np.arange(offset, offset + len(block.nodes)))
        offset += len(block.nodes)
    return np.concatenate(nodes), np.concatenate(numbers)


def _surface(source: Source, points: NDArray[np.float64], raw: RawMesh, notes: list[str]) -> tuple[Ints, Ints]:
    """Triangles as of :func:`_triangles`, or six-node ones, corners first, then the nodes amid the sides opposite them.

    :raises InputError: both kinds.
    """
    triangles, tri_cell = _triangles(source, points, raw, notes)
    six, six_cell = _of_kind(raw, "triangle6")
    if len(six) and len(triangles):
        told = f"{several(len(six), 'six-node triangle')} beside {several(len(triangles), 'triangle')} of three nodes"
        raise source.fault(f"{told}: save elements of one kind")
    return (six[:, [0, 1, 2, 4, 5, 3]], six_cell) if len(six) else (triangles, tri_cell)


def _lines(raw: RawMesh) -> tuple[Ints, Ints]:
    """Straight lines, of a curved one both halves, and the cell that each comes from."""
    straight, straight_cell = _of_kind(raw, "line")
    curved, curved_cell = _of_kind(raw, "line3")
    halves = np.stack((curved[:, [0, 2]], curved[:, [2, 1]]), axis=1).reshape(-1, 2)
    every, cell = np.concatenate((straight, halves)), np.concatenate((straight_cell, np.repeat(curved_cell, 2)))
    order = np.argsort(cell, kind="stable")
    return every[order], cell[order]


def _triangles(source: Source, points: NDArray[np.float64], raw: RawMesh, notes: list[str]) -> tuple[Ints, Ints]:
    """Triangles in the order of the file, quads as two, and the cell that each comes from.

    A quad that gives one corner twice in a row is how some programs write a triangle; it is one.

    :raises InputError: a quad that crosses itself or is folded.
    """
    tri, tri_cell = _of_kind(raw, "triangle")
    quad, quad_cell = _of_kind(raw, "quad")
    if not len(quad):
        return tri, tri_cell
    same = quad == np.roll(quad, -1, axis=1)
    three = same.sum(axis=1) == 1
    if three.any():
        notes.append(f"{several(int(three.sum()), 'quadrilateral')} with a repeated corner: one triangle each")
        tri = np.concatenate((tri, quad[three][~same[three]].reshape(-1, 3)))
        tri_cell = np.concatenate((tri_cell, quad_cell[three]))
        quad, quad_cell = quad[~three], quad_cell[~three]
    if len(quad):
        told = several(len(quad), "quadrilateral")
        notes.append(f"split {told} in two triangles each, along the shorter diagonal")
    a, b, c, d = np.where(
        _turned(source, points, quad, quad_cell, raw, notes)[:, None], np.roll(quad, -1, axis=1), quad
    ).T
    halves = np.stack((np.column_stack((a, b, c)), np.column_stack((a, c, d))), axis=1).reshape(-1, 3)
    every = np.concatenate((tri, halves))
    cell = np.concatenate((tri_cell, np.repeat(quad_cell, 2)))
    order = np.argsort(cell, kind="stable")
    return every[order], cell[order]


def _turned(
    source: Source, points: NDArray[np.float64], quad: Ints, quad_cell: Ints, raw: RawMesh, notes: list[str]
) -> NDArray[np.bool_]:
    """Whether each quad is divided from its second corner to its fourth: along the shorter diagonal, unless that lies outside.

    A diagonal outside a quad, beside a corner that points inwards, gives halves that face opposite ways and overlap.

    :raises InputError: both diagonals do.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates beyond all bounds are refused later
        one = ((points[quad[:, 2]] - points[quad[:, 0]]) ** 2).sum(axis=1)
        other = ((points[quad[:, 3]] - points[quad[:, 1]]) ** 2).sum(axis=1)
        folded = [_folded(points, quad), _folded(points, np.roll(quad, -1, axis=1))]
    both = np.flatnonzero(folded[0] & folded[1])
    if both.size:
        cell = int(quad_cell[both[0]])
        name = raw.cell_name(cell) if raw.cell_name else f"cell {cell}"
        raise source.fault(
            f"{name} is a quadrilateral that crosses itself, is folded or has no area; {both.size} such in all: "
            "its corners must go around it"
        )
    # Squares have equal diagonals: round-off must not choose between them.
    shorter = other < one * (1.0 - _ROUND_OFF)
    turn = np.where(folded[0] | folded[1], folded[0], shorter)
    outside = int((turn != shorter).sum())
    if outside:
        notes.append(
            f"of these {outside} along the longer diagonal: the shorter one lies outside, beside a corner that points inwards"
        )
    return turn


def _folded(points: NDArray[np.float64], quad: Ints) -> NDArray[np.bool_]:
    """Whether the halves of each quad on the two sides of its first diagonal face opposite ways, or one of them has no area."""
    a, b, c, d = points[quad].transpose(1, 0, 2)
    one, other = np.cross(b - a, c - a), np.cross(c - a, d - a)
    largest = np.maximum((one**2).sum(axis=1), (other**2).sum(axis=1))
    return np.asarray((one * other).sum(axis=1) <= _ROUND_OFF * largest)


def _groups(
    raw: RawMesh, triangles: Ints, lines: Ints, first: Ints, count: Ints, line_cell: Ints, notes: list[str]
) -> tuple[dict[str, Ints], dict[str, Ints], dict[str, Ints]]:
    """Groups of nodes (places in the points), of triangles and of lines.

    :param triangles: all nodes of each.
    :param first, count: of each cell the first triangle that it gives, and how many.
    :param line_cell: cell that each line comes from, ascending.

    A set of cells also names its nodes. Where several sets of one name differ in kind, the name stands for the nodes of the
    lowest kind: points before lines before triangles.
    """
    vertices, vertex_cell = _of_kind(raw, "vertex")
    vertex_number = np.full(raw.cell_count, -1, dtype=np.int64)
    vertex_number[vertex_cell] = np.arange(len(vertex_cell))
    tri_groups: dict[str, Ints] = {}
    line_groups: dict[str, Ints] = {}
    by_kind: dict[str, dict[int, Ints]] = {name: {-1: members} for name, members in raw.point_groups.items()}
    for group in raw.cell_groups:
        has_tri = group.members[first[group.members] >= 0]
        elements = np.concatenate([first[has_tri], first[has_tri[count[has_tri] == 2]] + 1])
        begin, end = (np.searchsorted(line_cell, group.members, side) for side in ("left", "right"))
        of_lines = np.concatenate([begin[end > begin], begin[end > begin + 1] + 1])  # a curved one is two
        of_points = vertex_number[group.members][vertex_number[group.members] >= 0]
        for held, members in ((tri_groups, elements), (line_groups, of_lines)):
            if members.size:
                if group.name in held and not np.array_equal(held[group.name], members):
                    notes.append(f"several groups are named '{group.name}': they are joined")
                held[group.name] = sorted_unique(np.concatenate((held.get(group.name, members[:0]), members)))
        nodes = sorted_unique(
            np.concatenate([triangles[elements].ravel(), lines[of_lines].ravel(), vertices[of_points].ravel()])
        )
        kind = 0 if of_points.size else 1 if of_lines.size else 2
        mine = by_kind.setdefault(group.name, {})
        mine[kind] = sorted_unique(np.concatenate((mine.get(kind, nodes[:0]), nodes)))
    names = {-1: "points", 0: "points", 1: "lines", 2: "triangles"}
    for name, kinds in by_kind.items():
        lowest = min(kinds)
        differing = [k for k in kinds if k != lowest and not np.array_equal(kinds[k], kinds[lowest])]
        if differing:
            others = " and ".join(names[k] for k in sorted(differing))
            notes.append(
                f"'{name}' names {names[lowest]} and {others}: as a node group it stands for the {names[lowest]} alone"
            )
    return {name: kinds[min(kinds)] for name, kinds in by_kind.items()}, tri_groups, line_groups
