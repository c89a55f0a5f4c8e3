"""A mesh cut in four: each triangle at the middles of its sides, with all its groups, and how what nodes have is carried over.

Nodes keep their numbers, new ones follow; element t becomes the elements 4 t … 4 t + 3. Groups of nodes get the new nodes on
edges between their members.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.mesh import quadratic
from taichi_membrane.mesh.check import frozen
from taichi_membrane.mesh.line_nodes import with_added_nodes
from taichi_membrane.mesh.middles import Place
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import EdgeTable, edge_table

Numbers = NDArray[np.integer]

# The nodes at the two ends of the side opposite each corner.
_SIDES = np.array([[1, 2], [2, 0], [0, 1]])
# Area coordinates of the six nodes of a cell, and shape functions (4, 3, 6) there amid the sides of the four that it is cut in.
_PLACES = np.concatenate([np.eye(3), 0.5 * (1.0 - np.eye(3))])
_AMID = np.stack([quadratic.shapes(_PLACES[four][_SIDES].mean(axis=1)) for four in quadratic.QUARTERS])


@dataclass(frozen=True, eq=False)
class Quartered:
    """A mesh cut in four.

    :param prolongation: (nodes, nodes of the coarse mesh) values at its nodes from those of the coarse mesh, by shape functions.
    """

    mesh: Mesh
    prolongation: scipy.sparse.csr_matrix


def quartered(mesh: Mesh, place: Place | None) -> Quartered:
    """Cut a mesh in four.

    :param place: where the true surface has new nodes; on the coarse mesh's own surface when None.
    :raises InputError: what becomes of its surface is none, say where triangles fold.
    """
    count = int(mesh.cells.max()) + 1  # nodes that only cables use come after those of triangles
    flat = mesh.triangles if mesh.order == 1 else mesh.flat_triangles
    table = edge_table(np.ascontiguousarray(flat), count)
    amid = count + _edge_of_side(table, len(flat))  # (m, 3) new node amid the side opposite each corner
    if mesh.order == 1:
        triangles, middles = quadratic.quarters(np.concatenate([flat, amid], axis=1)), None
        prolongation = _halves(table, count)
    else:
        triangles, middles = flat, amid
        prolongation = _within(mesh, amid, count, len(table.nodes))
    ends = mesh.points[table.nodes]
    new = prolongation[count:] @ mesh.points[:count] if place is None else place(ends[:, 0], ends[:, 1])
    total = count + len(new)
    own = {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    children = {
        name: (4 * members[:, None] + np.arange(4)).ravel()
        for name, members in mesh.tri_groups.items()
        if name != "all"
    }
    made = Mesh.build(
        np.concatenate([mesh.points[:count], new]),
        triangles,
        _groups(mesh, own, table, count),
        children,
        None if mesh.tri_warp is None else np.repeat(mesh.tri_warp, 4, axis=0),
        where="the mesh cut in four",
        open_seams=True,  # the coarse mesh has said what becomes of them
        tri_fields={name: np.repeat(values, 4, axis=0) for name, values in mesh.tri_fields.items()},
        tri_middle=middles,
    )
    number = np.concatenate([np.arange(count), total + np.arange(mesh.node_count + len(mesh.loose_points) - count)])
    made = _with_others(made, mesh, own, number, table, count)
    extra = scipy.sparse.identity(mesh.node_count - count, format="csr")
    return Quartered(made, scipy.sparse.csr_matrix(scipy.sparse.block_diag([prolongation, extra], format="csr")))


def _edge_of_side(table: EdgeTable, tri_count: int) -> Numbers:
    """(tri_count, 3) number of the edge opposite each corner."""
    found = np.empty(3 * tri_count, dtype=np.int64)
    found[table.half_edges] = np.repeat(np.arange(len(table.nodes)), table.tri_count)
    return np.roll(found.reshape(-1, 3), 2, axis=1)  # half-edge c is opposite corner c + 2


def _halves(table: EdgeTable, count: int) -> scipy.sparse.csr_matrix:
    """Prolongation to the middles of edges, halfway between their ends."""
    edges = len(table.nodes)
    new = scipy.sparse.csr_matrix(
        (np.full(2 * edges, 0.5), (np.repeat(np.arange(edges), 2), table.nodes.ravel())), shape=(edges, count)
    )
    return scipy.sparse.csr_matrix(scipy.sparse.vstack([scipy.sparse.identity(count, format="csr"), new], format="csr"))


def _within(mesh: Mesh, amid: Numbers, count: int, edges: int) -> scipy.sparse.csr_matrix:
    """Prolongation to nodes amid the sides of the four triangles that six-node ones are cut in, by their shape functions."""
    rows, first = np.unique(amid.ravel(), return_index=True)
    parent, which = np.divmod(first, 12)
    weights = _AMID.reshape(12, 6)[which]
    new = scipy.sparse.csr_matrix(
        (weights.ravel(), (np.repeat(rows - count, 6), mesh.cells[parent].ravel())), shape=(edges, count)
    )
    new.eliminate_zeros()
    return scipy.sparse.csr_matrix(scipy.sparse.vstack([scipy.sparse.identity(count, format="csr"), new], format="csr"))


def _groups(mesh: Mesh, groups: Mapping[str, Numbers], table: EdgeTable, count: int) -> dict[str, Numbers]:
    """Members of node groups on the fine mesh: those they had, and the new nodes amid edges between them.

    Of a group on free edges alone, as a rim, edges within the surface are no part, say across a corner. Between nodes amid sides a
    new one is a member where the whole of its six-node triangle is.
    """
    free = table.nodes[table.tri_count == 1]
    on_free = np.zeros(count, dtype=bool)
    on_free[free] = True
    edge_count = len(table.nodes)
    inner = np.full(edge_count, -1)
    if mesh.order == 2:
        # The last of each four lies between the nodes amid sides; its sides are theirs alone or run amid the whole cell.
        of_side = _edge_of_side(table, 4 * mesh.tri_count).reshape(-1, 4, 3)
        inner[of_side[:, 3]] = np.arange(mesh.tri_count)[:, None]
    found = {}
    for name, members in groups.items():
        members = members[members < count]
        if not members.size:
            continue
        inside = np.zeros(count, dtype=bool)
        inside[members] = True
        part = inside[table.nodes].all(axis=1)
        if on_free[members].all():
            part &= table.tri_count == 1
        whole = np.asarray(inside[mesh.cells].all(axis=1))
        part &= (inner < 0) | whole[inner]
        found[name] = np.concatenate([members, count + np.flatnonzero(part)])
    return found


def _with_others(
    made: Mesh, mesh: Mesh, groups: Mapping[str, Numbers], number: Numbers, table: EdgeTable, count: int
) -> Mesh:
    """The fine mesh with nodes that no triangle uses, loose points and lines of the coarse one; lines along edges are cut in two.

    :param number: new number of each node and loose point of the coarse mesh.
    """
    if mesh.node_count > count:
        joined = {
            name: np.concatenate(
                [made.node_groups.get(name, np.zeros(0, dtype=np.int32)), number[members[members >= count]]]
            )
            for name, members in groups.items()
            if (members >= count).any()
        }
        made = with_added_nodes(made, mesh.points[count:], joined)
    if not len(mesh.lines) and not len(mesh.loose_points):
        return made
    lines, owner = _cut_lines(mesh.lines, number, table, count)
    return replace(
        made,
        lines=frozen(lines.astype(np.int32)),
        line_groups={
            name: frozen(np.flatnonzero(np.isin(owner, members)).astype(np.int32))
            for name, members in mesh.line_groups.items()
        },
        loose_points=mesh.loose_points,
        loose_groups={name: frozen(number[members].astype(np.int32)) for name, members in mesh.loose_groups.items()},
    )


def _cut_lines(lines: Numbers, number: Numbers, table: EdgeTable, count: int) -> tuple[Numbers, Numbers]:
    """Lines by their new numbers, those along edges in two halves, and the old line of each."""
    size = len(number)
    keys = table.nodes.astype(np.int64) @ np.array([size, 1])  # ascending, as edges are sorted
    own = np.sort(lines.astype(np.int64), axis=1) @ np.array([size, 1])
    at = np.minimum(np.searchsorted(keys, own), len(keys) - 1)
    cut = keys[at] == own
    whole = number[lines[~cut]]
    first = np.column_stack([number[lines[cut, 0]], count + at[cut]])
    second = np.column_stack([count + at[cut], number[lines[cut, 1]]])
    pairs, owner = (
        np.concatenate([whole, first, second]),
        np.concatenate([np.flatnonzero(~cut), np.flatnonzero(cut), np.flatnonzero(cut)]),
    )
    order = np.argsort(owner, kind="stable")
    return pairs[order], owner[order]
