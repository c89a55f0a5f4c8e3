"""Mends what can be mended without a guess: nodes at one place, unused nodes, mixed orientation, bodies inside out.

Elements keep their numbers, so element groups and directions stay as they are; node groups follow their nodes. Whatever else is
wrong with a mesh is left as it is, for the checks to refuse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from taichi_membrane.mesh import check
from taichi_membrane.mesh.topology import edge_table

# Nodes nearer than this share of the mesh's size are one node: far below any element, far above the round-off of files in text.
SAME_PLACE = 1e-9

HINT = "; --repair (in Python repair=True) does that"


@dataclass(frozen=True, eq=False)
class Mended:
    """A mesh's arrays after mending, and what was done, a line for each kind of fault; no lines where nothing was wrong."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    node_groups: dict[str, NDArray[np.int32]]
    told: tuple[str, ...]


def mend(
    points: NDArray[np.float64], triangles: NDArray[np.int32], node_groups: Mapping[str, NDArray[np.int32]]
) -> Mended:
    """Join, drop, turn over; see the module's text. Arrays in are unchanged."""
    told: list[str] = []
    number = _joined(points, triangles, told)
    triangles = number[triangles]
    used = np.unique(triangles)
    unused = np.setdiff1d(np.unique(number), used)
    if unused.size:
        told.append(f"left out {unused.size} nodes that no element uses, the first is node {unused[0]}")
    place = np.full(len(points), -1, dtype=np.int32)
    place[used] = np.arange(used.size)
    groups = {name: place[number[members]] for name, members in node_groups.items()}
    groups = {name: np.unique(members[members >= 0]) for name, members in groups.items()}
    points, triangles = points[used], place[triangles]
    triangles = _turned(points, triangles, told)
    return Mended(points, triangles, groups, tuple(told))


def _joined(points: NDArray[np.float64], triangles: NDArray[np.int32], told: list[str]) -> NDArray[np.int32]:
    """The lowest number of the nodes that are one with each node.

    Only the ends of two free edges at one place are joined: sheets that lie on each other touch in nodes that must stay apart.
    """
    number = np.arange(len(points), dtype=np.int32)
    table = edge_table(triangles, len(points))
    edges = table.nodes[table.tri_count == 1]
    free = np.unique(edges)
    if not free.size:
        return number
    near = cKDTree(points[free]).query_pairs(
        SAME_PLACE * float(np.linalg.norm(np.ptp(points, axis=0))), output_type="ndarray"
    )
    place = np.zeros(len(points), dtype=np.int64)
    place[free] = _linked(near, free.size)
    # Both edges of a pair written from the lower place to the higher: then their first ends are one node, and their second ends.
    edges = np.where((place[edges[:, 0]] > place[edges[:, 1]])[:, None], edges[:, ::-1], edges)
    _, which, count = np.unique(place[edges], axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    pairs = order[count[which[order]] == 2].reshape(-1, 2)
    crowded = int((count[which] > 2).sum())
    if crowded:
        told.append(
            f"left {crowded} free edges alone: more than two lie at one place, so nothing tells which belong together"
        )
    label = _linked(edges[pairs].transpose(0, 2, 1).reshape(-1, 2), len(points))
    _, first = np.unique(label, return_index=True)
    number = first[label].astype(np.int32)
    moved = np.flatnonzero(number != np.arange(len(points)))
    if moved.size:
        told.append(
            f"joined {moved.size} nodes to others at the same place, the first is node {moved[0]} to node {number[moved[0]]}"
        )
    return number


def _linked(pairs: NDArray[Any], count: int) -> NDArray[np.int32]:
    """One label for each of ``count`` things; those that pairs (n, 2) link, over others too, share it."""
    rows, columns = pairs.astype(np.int32).T
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), (rows, columns)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


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
    label = _linked(np.column_stack((rows, columns)), 2 * count)
    as_is, turned = label[:count], label[count:]
    if (as_is == turned).any():
        return None
    # A part's two sides are labelled as_is and turned on some triangles and the other way round on others.
    size = np.bincount(as_is, minlength=label.max() + 1)
    return np.asarray((size[turned] > size[as_is]) | ((size[turned] == size[as_is]) & (turned < as_is)))
