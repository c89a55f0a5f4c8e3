"""Mends what can be mended without a guess: nodes at one place, unused nodes, mixed orientation, bodies inside out.

Elements keep their numbers, so element groups and directions stay as they are; node groups follow their nodes. Whatever else is
wrong with a mesh is left as it is, for the checks to refuse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import check
from taichi_membrane.mesh.cracks import linked, seams
from taichi_membrane.mesh.topology import edge_table

HINT = "; --repair (in Python repair=True) does that"


@dataclass(frozen=True, eq=False)
class Mended:
    """A mesh's arrays after mending, and what was done, a line for each kind of fault; no lines where nothing was wrong.

    :param new_number: the number that each node has now; -1 for those left out.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    node_groups: dict[str, NDArray[np.int32]]
    new_number: NDArray[np.int32]
    told: tuple[str, ...]


def mend(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    node_groups: Mapping[str, NDArray[np.int32]],
    tolerance: float | None,
) -> Mended:
    """Join, drop, turn over; see the module's text. Arrays in are unchanged.

    :param tolerance: nodes of free edges no farther apart are one [length]; None joins none.
    """
    told: list[str] = []
    number = (
        np.arange(len(points), dtype=np.int32) if tolerance is None else _joined(points, triangles, tolerance, told)
    )
    triangles = number[triangles]
    used = np.unique(triangles)
    unused = np.setdiff1d(np.unique(number), used)
    if unused.size:
        told.append(f"left out {unused.size} nodes that no element uses, the first is node {unused[0]}")
    place = np.full(len(points), -1, dtype=np.int32)
    place[used] = np.arange(used.size)
    groups = {name: place[number[members]] for name, members in node_groups.items()}
    groups = {name: np.unique(members[members >= 0]) for name, members in groups.items()}
    told += [f"left out node group '{name}': no element uses its nodes" for name in groups if not groups[name].size]
    groups = {name: members for name, members in groups.items() if members.size}
    points, triangles = points[used], place[triangles]
    triangles = _turned(points, triangles, told)
    return Mended(points, triangles, groups, place[number], tuple(told))


def _joined(
    points: NDArray[np.float64], triangles: NDArray[np.int32], tolerance: float, told: list[str]
) -> NDArray[np.int32]:
    """The lowest number of the nodes that are one with each node.

    Only the ends of two free edges at one place are joined: sheets that lie on each other touch in nodes that must stay apart.
    """
    number = np.arange(len(points), dtype=np.int32)
    found = seams(points, edge_table(triangles, len(points)), tolerance)
    if found.crowded:
        told.append(
            f"left {found.crowded} free edges alone: more than two lie at one place, so nothing tells which belong together"
        )
    label = linked(found.edges[found.pairs].transpose(0, 2, 1).reshape(-1, 2), len(points))
    _, first = np.unique(label, return_index=True)
    number = first[label].astype(np.int32)
    moved = np.flatnonzero(number != np.arange(len(points)))
    if moved.size:
        gap = float(np.linalg.norm(points[moved] - points[number[moved]], axis=1).max())
        told.append(
            f"joined {moved.size} nodes to others at the same place, the first is node {moved[0]} to node {number[moved[0]]}; "
            f"{len(found.pairs)} pairs of free edges, largest gap {gap:.3g}, tolerance {tolerance:.3g}"
        )
    return number


def _turned(points: NDArray[np.float64], triangles: NDArray[np.int32], told: list[str]) -> NDArray[np.int32]:
    """The triangles with one orientation on each part, and closed bodies with outward normals."""
    table = edge_table(triangles, len(points))
    flip = _flips(triangles, table.half_edges, table.start[table.tri_count == 2])
    if flip is None:
        return triangles
    turned = np.where(flip[:, None], triangles[:, [0, 2, 1]], triangles)
    area = np.linalg.norm(check.area_vectors(points, turned), axis=1)
    inverted, label, _ = check.inverted_bodies(points, turned, table, area)
    inside_out = np.isin(label[triangles[:, 0]], inverted)
    flip = flip ^ inside_out
    first = np.flatnonzero(flip)
    if first.size:
        told.append(
            f"turned over {first.size} of {len(triangles)} elements, the first is element {first[0]}"
            + (f"; {len(inverted)} closed bodies had their normals inwards" if inverted else "")
        )
    return np.where(flip[:, None], triangles[:, [0, 2, 1]], triangles)


def _flips(
    triangles: NDArray[np.int32], half_edges: NDArray[np.int64], start: NDArray[np.int64]
) -> NDArray[np.bool_] | None:
    """Which triangles to turn so that neighbours agree, the smaller side of each part; None on a surface with one side only."""
    tail, head = triangles.reshape(-1), triangles[:, [1, 2, 0]].reshape(-1)
    one, other = half_edges[start], half_edges[start + 1]
    opposed = (tail[one] < head[one]) == (tail[other] < head[other])
    count = len(triangles)
    # Each triangle twice, as it is and turned over: an edge ties what agrees. Two sides of one part are then two parts.
    a, b = one // 3, other // 3
    rows = np.concatenate((a, a + count))
    columns = np.concatenate((np.where(opposed, b + count, b), np.where(opposed, b, b + count)))
    label = linked(np.column_stack((rows, columns)), 2 * count)
    as_is, turned = label[:count], label[count:]
    if (as_is == turned).any():
        return None
    # A part's two sides are labelled as_is and turned on some triangles and the other way round on others.
    size = np.bincount(as_is, minlength=label.max() + 1)
    return np.asarray((size[turned] > size[as_is]) | ((size[turned] == size[as_is]) & (turned < as_is)))
