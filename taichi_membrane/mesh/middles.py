"""Nodes amid the sides of six-node triangles: what is asked of them, and how a mesh of three-node triangles gets them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import quadratic
from taichi_membrane.mesh.check import MeshFault, frozen
from taichi_membrane.mesh.quadratic import Floats
from taichi_membrane.mesh.topology import EdgeTable

if TYPE_CHECKING:
    from taichi_membrane.mesh.surface import Mesh

# Places of the nodes amid edges, (k, 3), from those of the edges' two ends.
Place = Callable[[Floats, Floats], Floats]

_ENDS = np.array([[1, 2, 0], [2, 0, 1]])  # corners at the ends of the side opposite each corner


def as_middles(
    middles: ArrayLike | None, triangles: NDArray[np.int32], node_count: int, where: str, *, repair: bool
) -> NDArray[np.int32] | None:
    """A private read-only (tri_count, 3) int32 copy of the nodes amid the side opposite each corner; None where there are none.

    :raises InputError: another shape, numbers out of range, a node that is a corner too; a mesh that is to be repaired.
    """
    if middles is None:
        return None
    if repair:
        raise InputError(f"{where}: meshes of six-node triangles cannot be repaired")
    array = np.array(middles)
    if array.shape != triangles.shape or array.dtype.kind not in "iu":
        raise InputError(
            f"{where}: nodes amid sides must be whole numbers of shape {triangles.shape}, got {array.dtype} {array.shape}"
        )
    bad = np.flatnonzero(((array < 0) | (array >= node_count)).any(axis=1))
    if bad.size:
        raise InputError(
            f"{where}: element {bad[0]} has the nodes {tuple(array[bad[0]].tolist())} amid its sides, but node numbers run from 0 "
            f"to {node_count - 1}"
        )
    corner = np.zeros(node_count, dtype=bool)
    corner[triangles] = True
    bad = np.flatnonzero(corner[array].any(axis=1))
    if bad.size:
        node = int(array[bad[0]][corner[array[bad[0]]]][0])
        told = f"{where}: node {node} is amid a side of element {bad[0]}, but a corner as well; {bad.size} such elements in all"
        raise MeshFault(told, elements=[int(bad[0])], nodes=[node])
    return frozen(array.astype(np.int32))


def edge_middles(middles: NDArray[np.int32], table: EdgeTable, where: str) -> NDArray[np.int32]:
    """(edge_count,) the node amid each edge.

    :raises InputError: triangles that meet at an edge have different nodes amid it, or two edges share one.
    """
    of_half_edge = np.roll(middles, -2, axis=1).ravel()[table.half_edges]  # half-edge c is opposite corner c + 2
    first = of_half_edge[table.start]
    bad = np.flatnonzero(of_half_edge != np.repeat(first, table.tri_count))
    if bad.size:
        edge = int(np.searchsorted(table.start, bad[0], side="right")) - 1
        elements = table.triangles_at(edge)
        raise MeshFault(
            f"{where}: elements {elements} meet at the edge of nodes {tuple(table.nodes[edge].tolist())}, but have different nodes "
            "amid it",
            elements=elements,
        )
    if len(np.unique(first)) != len(first):
        node = int(np.flatnonzero(np.bincount(first) > 1)[0])
        raise MeshFault(f"{where}: node {node} is amid more than one edge", nodes=[node])
    return first


def check_shape(points: Floats, cells: NDArray[np.int32], where: str) -> None:
    """Refuse cells (m, 6) that are folded: at a corner or a point within, the normal points against the mean one."""
    vector = quadratic.area_vectors(points, cells)
    places = quadratic.Rule(np.concatenate([np.eye(3), quadratic.RULES[6].places]), np.zeros(9))
    turned = np.einsum("mkd,md->mk", quadratic.normals(points, cells, places), vector)
    bad = np.flatnonzero(~(turned > 0.0).all(axis=1))
    if bad.size:
        raise MeshFault(
            f"{where}: element {bad[0]} is folded: its nodes {tuple(cells[bad[0], 3:].tolist())} lie too far from the middles of "
            f"its sides; {bad.size} such elements in all",
            elements=[int(bad[0])],
        )


def pieces(table: EdgeTable, middles: NDArray[np.int32]) -> NDArray[np.int32]:
    """(2 edge_count, 2) both halves of each edge, lower node number first, sorted."""
    halves = np.concatenate([np.column_stack([table.nodes[:, end], middles]) for end in range(2)])
    halves = np.sort(halves, axis=1)
    return halves[np.lexsort((halves[:, 1], halves[:, 0]))].astype(np.int32)


def with_middles(mesh: Mesh, place: Place) -> Mesh:
    """A mesh of three-node triangles with a node amid each edge, numbered after its own in the order of the edges.

    A group of nodes gets those amid edges with both ends in it.

    :param place: where the surface has them.
    """
    table, count = mesh.edge_table, mesh.node_count
    ends = table.nodes
    number = np.empty(3 * mesh.tri_count, dtype=np.int64)
    number[table.half_edges] = np.repeat(np.arange(len(ends)), table.tri_count)
    middles = count + np.roll(number.reshape(-1, 3), 2, axis=1)  # side a is half-edge a + 1
    points = np.concatenate([mesh.points, place(mesh.points[ends[:, 0]], mesh.points[ends[:, 1]])])
    groups = {}
    for name, members in mesh.node_groups.items():
        if name in ("all", "boundary"):
            continue
        inside = np.zeros(count, dtype=bool)
        inside[members] = True
        groups[name] = np.concatenate([members, count + np.flatnonzero(inside[ends].all(axis=1))])
    tri_groups = {name: members for name, members in mesh.tri_groups.items() if name != "all"}
    return type(mesh).build(
        points,
        mesh.triangles,
        groups,
        tri_groups,
        mesh.tri_warp,
        tri_middle=middles,
        where="mesh",
        tri_fields=mesh.tri_fields,
    )


def straight(first: Floats, second: Floats) -> Floats:
    """Places halfway, of flat surfaces."""
    return 0.5 * (first + second)
