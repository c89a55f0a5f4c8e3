"""A mesh cut in four: each triangle at the middles of its sides, with all its groups, and how what nodes have is carried over.

Nodes keep their numbers, new ones follow; element t becomes the elements 4 t … 4 t + 3. Groups of nodes get the new nodes on
edges between their members.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from taichi_membrane.mesh import quadratic
from taichi_membrane.mesh.finer import Finer, NewNodes, Numbers, edge_of_side, given_groups, tri_groups, with_others
from taichi_membrane.mesh.middles import Place
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import EdgeTable, edge_table

# The nodes at the two ends of the side opposite each corner.
_SIDES = np.array([[1, 2], [2, 0], [0, 1]])
# Area coordinates of the six nodes of a cell, and shape functions (4, 3, 6) there amid the sides of the four that it is cut in.
_PLACES = np.concatenate([np.eye(3), 0.5 * (1.0 - np.eye(3))])
_AMID = np.stack([quadratic.shapes(_PLACES[four][_SIDES].mean(axis=1)) for four in quadratic.QUARTERS])


def quartered(mesh: Mesh, place: Place | None) -> Finer:
    """Cut a mesh in four.

    :param place: where the true surface has new nodes; on the coarse mesh's own surface when None.
    :raises InputError: what becomes of its surface is none, say where triangles fold.
    """
    count = int(mesh.cells.max()) + 1  # nodes that only cables use come after those of triangles
    flat = mesh.triangles if mesh.order == 1 else mesh.flat_triangles
    table = edge_table(np.ascontiguousarray(flat), count)
    amid = count + edge_of_side(table, len(flat))  # (m, 3) new node amid the side opposite each corner
    if mesh.order == 1:
        triangles, middles = quadratic.quarters(np.concatenate([flat, amid], axis=1)), None
        prolongation = _halves(table, count)
    else:
        triangles, middles = flat, amid
        prolongation = _within(mesh, amid, count, len(table.nodes))
    ends = mesh.points[table.nodes]
    new = prolongation[count:] @ mesh.points[:count] if place is None else place(ends[:, 0], ends[:, 1])
    inner = np.full(len(table.nodes), -1)
    if mesh.order == 2:
        # The last of each four lies between the nodes amid sides; its sides are theirs alone or run amid the whole cell.
        of_side = edge_of_side(table, 4 * mesh.tri_count).reshape(-1, 4, 3)
        inner[of_side[:, 3]] = np.arange(mesh.tri_count)[:, None]
    nodes = NewNodes(table.nodes, table.tri_count == 1, inner, count)
    made = Mesh.build(
        np.concatenate([mesh.points[:count], new]),
        triangles,
        nodes.groups(mesh, given_groups(mesh)),
        tri_groups(mesh, np.repeat(np.arange(mesh.tri_count), 4)),
        None if mesh.tri_warp is None else np.repeat(mesh.tri_warp, 4, axis=0),
        where="the mesh cut in four",
        open_seams=True,  # the coarse mesh has said what becomes of them
        tri_fields={name: np.repeat(values, 4, axis=0) for name, values in mesh.tri_fields.items()},
        tri_middle=middles,
    )
    return with_others(made, mesh, prolongation, nodes)


def _halves(table: EdgeTable, count: int) -> sparse.csr_matrix:
    """Prolongation to the middles of edges, halfway between their ends."""
    edges = len(table.nodes)
    new = sparse.csr_matrix(
        (np.full(2 * edges, 0.5), (np.repeat(np.arange(edges), 2), table.nodes.ravel())), shape=(edges, count)
    )
    return sparse.csr_matrix(sparse.vstack([sparse.identity(count, format="csr"), new], format="csr"))


def _within(mesh: Mesh, amid: Numbers, count: int, edges: int) -> sparse.csr_matrix:
    """Prolongation to nodes amid the sides of the four triangles that six-node ones are cut in, by their shape functions."""
    rows, first = np.unique(amid.ravel(), return_index=True)
    parent, which = np.divmod(first, 12)
    weights = _AMID.reshape(12, 6)[which]
    new = sparse.csr_matrix(
        (weights.ravel(), (np.repeat(rows - count, 6), mesh.cells[parent].ravel())), shape=(edges, count)
    )
    new.eliminate_zeros()
    return sparse.csr_matrix(sparse.vstack([sparse.identity(count, format="csr"), new], format="csr"))
