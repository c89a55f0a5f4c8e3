"""Free edges that lie on each other, or nearly, and nodes that lie on a free edge: seams that were never joined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.mesh.check import MeshFault
from taichi_membrane.mesh.precision import resolution
from taichi_membrane.mesh.topology import EdgeTable, node_parts

# Nodes nearer than this share of the mesh's size are one node, however many digits the coordinates have: far below any element,
# far above round-off.
SAME_PLACE = 1e-9
# Two roundings of one position differ by at most one digit in each direction, a little more where they were worked out twice.
_DIGITS = 4.0
# Share of the shortest edge that a tolerance never exceeds, and within which free edges count as nearly coincident whatever the
# digits are: nodes moved by it change no element's shape by more than a thousandth.
NEARLY = 1e-3
_BLOCK = 20_000  # edges that are looked at together
# As many pairs of free nodes are looked at one by one: importing SciPy's trees would take longer than most meshes do.
_FEW_PAIRS = 100_000

KEEP_APART = "open_seams = true in the scene's mesh (in Python open_seams=True) keeps them apart"


@dataclass(frozen=True, eq=False)
class Tolerance:
    """How near two nodes are one: by the digits of the coordinates (``same``), and how near is suspicious (``near``)."""

    same: float
    near: float

    @classmethod
    def of(
        cls,
        points: NDArray[np.float64],
        triangles: NDArray[np.int32],
        *,
        digit: float | None = None,
        join: float | None = None,
    ) -> Tolerance:
        """From the coordinates.

        :param digit: size of their last digit [length]; found from the points when None.
        :param join: the user's own tolerance [length], in place of the digits'.
        """
        a, b, c = (points[triangles[:, corner]] for corner in range(3))
        squares = np.concatenate([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))])
        shortest = float(np.sqrt(squares[squares > 0.0].min(initial=np.inf)))
        shortest = shortest if np.isfinite(shortest) else 0.0
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        last = resolution(points) if digit is None else digit
        same = min(max(SAME_PLACE * size, _DIGITS * last), NEARLY * shortest)
        same = same if join is None else join
        return cls(same, max(same, NEARLY * shortest))


@dataclass(frozen=True, eq=False)
class Seams:
    """Free edges that lie on each other.

    :param edges: (n, 2) ends of all free edges, written from the same end where two lie on each other.
    :param pairs: (m, 2) edges that lie on each other by two.
    :param crowded: number of edges that lie on each other by more than two.
    :param gap: largest distance of two ends that lie on each other [length].
    """

    edges: NDArray[np.int32]
    pairs: NDArray[np.int64]
    crowded: int
    gap: float


def linked(pairs: NDArray[Any], count: int) -> NDArray[np.int32]:
    """One label for each of ``count`` things; those that pairs (n, 2) link, over others too, share it."""
    return node_parts(pairs.astype(np.int32), count)[1]


def seams(points: NDArray[np.float64], table: EdgeTable, distance: float) -> Seams:
    """Find free edges both of whose ends lie within ``distance`` of another's."""
    edges = table.nodes[table.tri_count == 1]
    free = np.unique(edges)
    none = Seams(edges, np.empty((0, 2), dtype=np.int64), 0, 0.0)
    if not free.size:
        return none
    near = _close(points[free], distance)
    if not len(near):
        return none
    place = np.zeros(len(points), dtype=np.int64)
    place[free] = linked(near, free.size)
    # Both edges of a pair written from the lower place to the higher: then their first ends are one node, and their second ends.
    edges = np.where((place[edges[:, 0]] > place[edges[:, 1]])[:, None], edges[:, ::-1], edges)
    _, which, count = np.unique(place[edges], axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    pairs = order[count[which[order]] == 2].reshape(-1, 2)
    ends = points[edges[pairs]]
    gap = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=2).max(initial=0.0))
    return Seams(edges, pairs, int((count[which] > 2).sum()), gap)


def check_seams(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    table: EdgeTable,
    tolerance: Tolerance,
    where: str,
    repaired: bool,
) -> None:
    """Refuse free edges that nearly coincide, and nodes on free edges: a crack that pressure would open.

    :param repaired: edges within the tolerance were joined before; what is left is not mended by asking again.
    """
    found = seams(points, table, tolerance.near)
    if len(found.pairs) or (found.crowded and not repaired):
        raise MeshFault(_told(points, found, tolerance, where, repaired), nodes=_first_nodes(found))
    node, edge, distance, count = _on_an_edge(points, triangles, table, tolerance.near)
    if count:
        a, b = table.nodes[edge].tolist()
        raise MeshFault(
            f"{where}: node {node} at {_at(points[node])} lies on the free edge of nodes ({a}, {b}), {distance:.3g} from it, "
            f"and is not one of its ends; {count} such nodes in all (T-joints). Divide the edge's element there; {KEEP_APART}",
            elements=table.triangles_at(edge),
            nodes=[node, a, b],
        )


def _told(points: NDArray[np.float64], found: Seams, tolerance: Tolerance, where: str, repaired: bool) -> str:
    if not len(found.pairs):
        return (
            f"{where}: {found.crowded} free edges lie on each other by more than two, so nothing tells which belong together "
            f"(tolerance {tolerance.near:.3g}). Join them in the program that made the mesh; {KEEP_APART}"
        )
    (a, b), (c, d) = found.edges[found.pairs[0]].tolist()
    middle = points[[a, b]].mean(axis=0)
    text = (
        f"{where}: {len(found.pairs)} pairs of free edges coincide or nearly do, the first of nodes ({a}, {b}) and ({c}, {d}) at "
        f"{_at(middle)}; largest gap {found.gap:.3g}, tolerance {tolerance.same:.3g}. The mesh is cracked there. "
    )
    if found.gap <= tolerance.same and not repaired:
        return text + f"--repair (in Python repair=True) joins them; {KEEP_APART}"
    wanted = f"{float(f'{1.01 * found.gap:.2e}'):g}"
    return text + (
        f"The gap is larger than the digits of the coordinates explain: --repair with join = {wanted} in the scene's mesh "
        f"(in Python repair=True, join={wanted}) joins them; {KEEP_APART}"
    )


def _first_nodes(found: Seams) -> list[int]:
    return found.edges[found.pairs[0]].ravel().tolist() if len(found.pairs) else []


def _at(point: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{x:.6g}' for x in point.tolist())})"


def _close(points: NDArray[np.float64], distance: float) -> NDArray[np.int64]:
    """(n, 2) points no further from each other than a distance, the lower number first."""
    if len(points) ** 2 > _FEW_PAIRS:
        return np.asarray(scipy.spatial.cKDTree(points).query_pairs(distance, output_type="ndarray"))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    return np.argwhere(np.triu(apart <= distance, 1))


def _on_an_edge(
    points: NDArray[np.float64], triangles: NDArray[np.int32], table: EdgeTable, distance: float
) -> tuple[int, int, float, int]:
    """The first node that lies on a free edge between its ends: node, edge, distance; and the number of such nodes."""
    rows = np.flatnonzero(table.tri_count == 1)
    edges = table.nodes[rows]
    free = np.unique(edges)
    found: list[NDArray[np.int64]] = []
    if free.size:
        tree = None if free.size**2 <= _FEW_PAIRS else scipy.spatial.cKDTree(points[free])
        owner = table.half_edges[table.start[rows]] // 3
        for begin in range(0, len(rows), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            found.append(_near_edges(points, triangles[owner[part]], edges[part], free, tree, distance, begin))
    pairs = np.concatenate([np.empty((0, 2), dtype=np.int64), *found])
    if not len(pairs):
        return -1, -1, 0.0, 0
    edge, node = int(rows[pairs[0, 0]]), int(pairs[0, 1])
    a, b = points[table.nodes[edge]]
    along = (b - a) / np.linalg.norm(b - a)
    offset = points[node] - a
    return node, edge, float(np.linalg.norm(offset - (offset @ along) * along)), len(np.unique(pairs[:, 1]))


def _near_edges(
    points: NDArray[np.float64],
    owners: NDArray[np.int32],
    edges: NDArray[np.int32],
    free: NDArray[np.int32],
    tree: scipy.spatial.cKDTree | None,
    distance: float,
    first: int,
) -> NDArray[np.int64]:
    """(n, 2) edges, counted from ``first``, and free nodes that lie on them between their ends.

    :param tree: of the free nodes; None where all of them may be tried.
    """
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    length = np.linalg.norm(b - a, axis=1)
    if tree is None:
        near: Any = [np.arange(free.size)] * len(edges)
    else:
        near = tree.query_ball_point(0.5 * (a + b), 0.5 * length + distance)
    count = np.array([len(nodes) for nodes in near])
    edge = np.repeat(np.arange(len(edges)), count)
    node = free[np.concatenate([np.asarray(nodes, dtype=np.int64) for nodes in near])]
    own = (owners[edge] == node[:, None]).any(axis=1)
    edge, node = edge[~own], node[~own]
    along = ((points[node] - a[edge]) * (b - a)[edge]).sum(axis=1) / length[edge]
    off = np.sqrt(np.maximum(((points[node] - a[edge]) ** 2).sum(axis=1) - along**2, 0.0))
    on = (along > distance) & (along < length[edge] - distance) & (off <= distance)
    return np.column_stack((edge[on] + first, node[on]))
