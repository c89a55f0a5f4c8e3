"""Triangles of a mesh bisected at the middles of their longest edges, conforming, with all groups and what nodes have carried over.

An edge that is cut is cut in all triangles that meet there. Where any edge of a triangle is cut its longest one is, so that the
edges that are cut spread from those of the marked triangles until that holds (Rivara 1984); angles stay bounded from below by half
the least of the mesh. Six-node triangles keep the node amid an edge that is cut as a corner. Edges of a line that has to stay even
are cut all or none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from taichi_membrane.mesh import quadratic
from taichi_membrane.mesh.finer import Finer, NewNodes, Numbers, edge_of_side, given_groups, tri_groups, with_others
from taichi_membrane.mesh.middles import Place
from taichi_membrane.mesh.quadratic import Floats
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import EdgeTable, edge_table

# Places of a parent in area coordinates: its corners from the one opposite the longest edge on, then the middles of the edges
# opposite them. The children, by which of the other two edges are cut as well: that opposite place 1, that opposite place 2.
_PLACES = np.concatenate([np.eye(3), 0.5 * (1.0 - np.eye(3))])
_CHILDREN = {
    (False, False): ((0, 1, 3), (0, 3, 2)),
    (False, True): ((3, 0, 5), (3, 5, 1), (0, 3, 2)),
    (True, False): ((0, 1, 3), (3, 2, 4), (3, 4, 0)),
    (True, True): ((3, 0, 5), (3, 5, 1), (3, 2, 4), (3, 4, 0)),
}


@dataclass(frozen=True, eq=False)
class _Parts:
    """The triangles that a mesh's become.

    :param triangles: (n, 3) corners; ``parent`` (n,) the coarse triangle of each, ascending, and ``places`` (n, 3, 3) the area
        coordinates of its corners there.
    """

    triangles: Numbers
    parent: Numbers
    places: Floats


def bisected(
    mesh: Mesh, marked: NDArray[np.bool_], place: Place | None, *, times: int = 1, even: Sequence[str] = ()
) -> Finer:
    """Bisect marked triangles, and the parts of them again.

    :param marked: (tri_count,) which.
    :param place: where the true surface has new nodes; on the coarse mesh's own surface when None.
    :param even: node groups whose edges are cut together.
    :raises InputError: what becomes of its surface is none, say where triangles fold.
    """
    found, parent = _once(mesh, marked, place, even)
    for _ in range(times - 1):
        again, of = _once(found.mesh, marked[parent], place, even)
        parent = parent[of]
        found = Finer(again.mesh, sparse.csr_matrix(again.prolongation @ found.prolongation))
    return found


def _once(mesh: Mesh, marked: NDArray[np.bool_], place: Place | None, even: Sequence[str]) -> tuple[Finer, Numbers]:
    """The mesh with marked triangles bisected, and the parent of each element."""
    count = int(mesh.cells.max()) + 1  # nodes that only cables use come after those of triangles
    table = mesh.edge_table
    of_side = edge_of_side(table, mesh.tri_count)
    longest = _longest(mesh, table, of_side)
    lines = [_edges_of(table, mesh.node_groups[name], mesh.node_count) for name in even]
    cut = _spread(marked, of_side, longest, len(table.nodes), lines)
    if mesh.order == 1:
        amid = count + np.cumsum(cut) - 1
        parts = _parts(mesh, of_side, longest, cut, amid)
        nodes = NewNodes(table.nodes[cut], table.tri_count[cut] == 1, np.full(int(cut.sum()), -1), count)
        middles, weights = None, _halves(nodes)
    else:
        parts = _parts(mesh, of_side, longest, cut, mesh.edge_middles)
        nodes, middles, weights = _amid(mesh, parts, cut, count)
    prolongation = sparse.csr_matrix(sparse.vstack([sparse.identity(count, format="csr"), weights], format="csr"))
    ends = mesh.points[nodes.ends]
    new = weights @ mesh.points[:count] if place is None else place(ends[:, 0], ends[:, 1])
    parent = parts.parent
    made = Mesh.build(
        np.concatenate([mesh.points[:count], new]),
        parts.triangles,
        nodes.groups(mesh, given_groups(mesh)),
        tri_groups(mesh, parent),
        None if mesh.tri_warp is None else mesh.tri_warp[parent],
        where="the refined mesh",
        open_seams=True,  # the coarse mesh has said what becomes of them
        tri_fields={name: values[parent] for name, values in mesh.tri_fields.items()},
        tri_middle=middles,
    )
    return with_others(made, mesh, prolongation, nodes), parent


def _longest(mesh: Mesh, table: EdgeTable, of_side: Numbers) -> Numbers:
    """(tri_count,) the corner opposite the longest edge of each triangle; of edges of one length the same one on both sides."""
    length = np.linalg.norm(mesh.points[table.nodes[:, 1]] - mesh.points[table.nodes[:, 0]], axis=1)
    rank = np.empty(len(length), dtype=np.int64)
    rank[np.lexsort((np.arange(len(length)), length))] = np.arange(len(length))
    return np.asarray(np.argmax(rank[of_side], axis=1))


def _edges_of(table: EdgeTable, nodes: Numbers, node_count: int) -> Numbers:
    """The edges between nodes of a group."""
    inside = np.zeros(node_count, dtype=bool)
    inside[nodes] = True
    return np.flatnonzero(inside[table.nodes].all(axis=1))


def _spread(
    marked: NDArray[np.bool_],
    of_side: Numbers,
    longest: Numbers,
    edge_count: int,
    lines: Sequence[Numbers],
) -> NDArray[np.bool_]:
    """(edge_count,) which edges are cut.

    :param lines: edges that are cut all or none.
    """
    own = of_side[np.arange(len(of_side)), longest]
    cut = np.zeros(edge_count, dtype=bool)
    reached = np.asarray(marked)
    while (reached & ~cut[own]).any():
        cut[own[reached]] = True
        for line in lines:
            if cut[line].any():
                cut[line] = True
        reached = np.asarray(cut[of_side].any(axis=1))
    return cut


def _parts(mesh: Mesh, of_side: Numbers, longest: Numbers, cut: NDArray[np.bool_], amid: Numbers) -> _Parts:
    """The triangles that those of a mesh become.

    :param amid: (edge_count,) the node amid each edge that is cut.
    """
    turned = (longest[:, None] + np.arange(3)) % 3  # corners, and sides opposite them, from the longest side on
    rows = np.arange(mesh.tri_count)[:, None]
    sides = of_side[rows, turned]
    nodes = np.concatenate([mesh.triangles[rows, turned], amid[sides]], axis=1)
    places = np.zeros((mesh.tri_count, 6, 3))
    for corner in range(3):  # place k has the coordinate of turned corner c as its turned_c-th
        places[rows[:, 0], :, turned[:, corner]] = _PLACES[:, corner]
    whole = ~cut[sides[:, 0]]
    triangles, parent, at = [mesh.triangles[whole]], [np.flatnonzero(whole)], [np.tile(np.eye(3), (whole.sum(), 1, 1))]
    for others, children in _CHILDREN.items():
        own = np.flatnonzero(~whole & (cut[sides[:, 1:]] == np.array(others)).all(axis=1))
        for child in children:
            triangles.append(nodes[own][:, child])
            parent.append(own)
            at.append(places[own][:, child])
    owner = np.concatenate(parent)
    order = np.argsort(owner, kind="stable")
    return _Parts(np.concatenate(triangles)[order], owner[order], np.concatenate(at)[order])


def _halves(nodes: NewNodes) -> sparse.csr_matrix:
    """Prolongation to nodes halfway between others."""
    new = len(nodes.ends)
    rows = np.repeat(np.arange(new), 2)
    return sparse.csr_matrix((np.full(2 * new, 0.5), (rows, nodes.ends.ravel())), shape=(new, nodes.count))


def _amid(mesh: Mesh, parts: _Parts, cut: NDArray[np.bool_], count: int) -> tuple[NewNodes, Numbers, sparse.csr_matrix]:
    """New nodes amid the edges of the parts of six-node triangles, (n, 3) those amid all sides, and the prolongation to them."""
    old, table = mesh.edge_table, edge_table(np.ascontiguousarray(parts.triangles.astype(np.int32)), count)
    size = np.array([count, 1])
    keys = table.nodes.astype(np.int64) @ size
    kept = old.nodes.astype(np.int64) @ size  # ascending
    at = np.minimum(np.searchsorted(kept, keys), len(kept) - 1)
    is_new = kept[at] != keys
    node = np.where(is_new, count + np.cumsum(is_new) - 1, mesh.edge_middles[at])
    triangle, corner = np.divmod(table.half_edges[table.start[is_new]], 3)
    parent = parts.parent[triangle]
    places = 0.5 * (parts.places[triangle, corner] + parts.places[triangle, (corner + 1) % 3])
    rows = np.repeat(np.arange(len(parent)), 6)
    weights = sparse.csr_matrix(
        (quadratic.shapes(places).ravel(), (rows, mesh.cells[parent].ravel())), shape=(len(parent), count)
    )
    weights.eliminate_zeros()
    # Halves of old edges are pairs of an end and the node amid it; other new edges lie within triangles.
    amid, ends = mesh.edge_middles[cut], old.nodes[cut]
    halves = np.sort(np.concatenate([np.column_stack([ends[:, k], amid]) for k in range(2)]), axis=1) @ size
    free = np.tile(old.tri_count[cut] == 1, 2)
    new_keys = keys[is_new]
    nodes = NewNodes(
        table.nodes[is_new],
        np.isin(new_keys, halves[free]),
        np.where(np.isin(new_keys, halves), -1, parent),
        count,
    )
    return nodes, node[edge_of_side(table, len(parts.triangles))], weights
