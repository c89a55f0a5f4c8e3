"""Lines of mesh edges on a surface: where they run, the triangles on each of their sides, and how the surface curves along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import quadratic
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import node_parts

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Marks = NDArray[np.bool_]

# A kink turns the normal by more than this [degrees], and by so many times as much as the edges beside it: of facets of a round
# surface all edges turn it alike.
_KINK, _SHARPER = 20.0, 2.0


@dataclass(frozen=True, eq=False)
class LineSide:
    """One side of a line.

    :param edges: (k,) numbers of the line's edges, once for each triangle on this side; ``half_edges`` (k,) those of the triangles.
    :param around: numbers of all triangles on this side that touch a node of the line.
    """

    edges: Numbers
    half_edges: Numbers
    around: Numbers

    @property
    def triangles(self) -> Numbers:
        """(k,) numbers of the triangles."""
        return self.half_edges // 3


@dataclass(frozen=True, eq=False)
class SurfaceLine:
    """Connected edges of a mesh.

    :param edges: their numbers in the mesh's edge table.
    :param edge_of: (3 tri_count,) number of the edge of each half-edge of the mesh.
    """

    mesh: Mesh
    edges: Numbers
    edge_of: Numbers

    @cached_property
    def sides(self) -> tuple[LineSide, ...]:
        """The parts that the line divides the triangles in that touch it."""
        mesh, table = self.mesh, self.mesh.edge_table
        on_line, own = np.zeros(mesh.node_count, dtype=bool), np.zeros(len(table.nodes), dtype=bool)
        on_line[table.nodes[self.edges]], own[self.edges] = True, True
        near = np.flatnonzero(on_line[mesh.triangles].any(axis=1))
        edge_of = self.edge_of[3 * near[:, None] + np.arange(3)]
        # Triangles hang together at edges that touch the line and are not its own.
        joins = ~own[edge_of] & on_line[table.nodes[edge_of]].any(axis=2)
        row, column = np.nonzero(joins)
        names, numbered = np.unique(edge_of[row, column], return_inverse=True)
        _, label = node_parts(np.column_stack([row, len(near) + numbered]), len(near) + len(names))
        label = label[: len(near)]
        row, column = np.nonzero(own[edge_of])
        return tuple(
            LineSide(edge_of[row[here], column[here]], 3 * near[row[here]] + column[here], near[label == one])
            for one in np.unique(label[row])
            for here in [label[row] == one]
        )

    def sizes(self, side: LineSide) -> Floats:
        """(k,) heights of a side's triangles over their edges of the line, at rest and between corners."""
        corners = self.mesh.points[self.mesh.triangles[side.triangles]]
        double = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        return np.asarray(double / self.lengths(side))

    def lengths(self, side: LineSide) -> Floats:
        """(k,) lengths of the edges at rest."""
        ends = self.mesh.points[self.mesh.edge_table.nodes[side.edges]]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def along(self, side: LineSide, points: Floats) -> Floats:
        """(k, 3) unit vectors along the edges, with the nodes at ``points``."""
        ends = points[self.mesh.edge_table.nodes[side.edges]]
        return _unit(ends[:, 1] - ends[:, 0])

    def across(self, side: LineSide, points: Floats) -> Floats:
        """(k, 3) unit vectors from the edges into their triangles, square to the edges."""
        nodes = self.mesh.edge_table.nodes[side.edges]
        middle = points[self.mesh.triangles[side.triangles]].mean(axis=1) - points[nodes[:, 0]]
        along = self.along(side, points)
        return _unit(middle - np.einsum("ij,ij->i", middle, along)[:, None] * along)

    def curvature(self, side: LineSide, points: Floats) -> Floats:
        """(k,) normal curvature, without sign, of a side's surface along its edges; nan where the line is too short to tell.

        By Meusnier's theorem the part along the surface's normal of the line's own curvature, which is that of the circle through
        three nodes in a row.
        """
        if self.mesh.order == 2:
            middles = points[self.mesh.edge_middles[side.edges]]
            arms = points[self.mesh.edge_table.nodes[side.edges]] - middles[:, None]
            reach = np.linalg.norm(arms, axis=2).sum(axis=1)
            vector = 2.0 * _unit(arms).sum(axis=1) / reach[:, None]
            return np.abs(np.einsum("ij,ij->i", vector, _half_edge_normals(self.mesh, side.half_edges, points)))
        nodes, count = self.mesh.edge_table.nodes[self.edges], self.mesh.node_count
        ends, others = nodes.ravel(), nodes[:, ::-1].ravel()
        arm = points[others] - points[ends]
        total, reach = np.zeros((count, 3)), np.zeros(count)
        np.add.at(total, ends, _unit(arm))
        np.add.at(reach, ends, np.linalg.norm(arm, axis=1))
        inner = np.bincount(ends, minlength=count) == 2
        vector, found = 2.0 * total[inner] / reach[inner, None], np.full(count, np.nan)
        found[inner] = np.abs(np.einsum("ij,ij->i", vector, _node_normals(self.mesh, side.around, points)[inner]))
        at_ends = found[self.mesh.edge_table.nodes[side.edges]]
        known = np.isfinite(at_ends)
        return np.divide(
            np.where(known, at_ends, 0.0).sum(axis=1), known.sum(axis=1),
            out=np.full(len(at_ends), np.nan), where=known.any(axis=1),
        )  # fmt: skip


def border(mesh: Mesh, nodes: NDArray[np.integer]) -> Marks:
    """(edge_count,) edges with all their nodes among ``nodes`` beside which not every triangle is all of these."""
    member = np.zeros(mesh.node_count, dtype=bool)
    member[nodes] = True
    table = mesh.edge_table
    inside = member[table.nodes].all(axis=1)
    if mesh.order == 2:
        inside &= member[mesh.edge_middles]
    whole = np.asarray(member[mesh.triangles].all(axis=1))
    return np.asarray(inside & ~_all_beside(mesh, whole))


def between(mesh: Mesh, label: NDArray[np.integer]) -> Marks:
    """(edge_count,) edges at which triangles of different labels (tri_count,) meet."""
    table = mesh.edge_table
    values = label[table.half_edges // 3]
    return np.minimum.reduceat(values, table.start) != np.maximum.reduceat(values, table.start)


def kinks(mesh: Mesh) -> Marks:
    """(edge_count,) edges of two triangles at which the surface has a kink at rest."""
    table = mesh.edge_table
    inner = np.flatnonzero(table.tri_count == 2)
    first, second = (table.half_edges[table.start[inner] + side] for side in range(2))
    one, other = (_half_edge_normals(mesh, half, mesh.points) for half in (first, second))
    angle = np.zeros(len(table.nodes))
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other)
    angle[inner] = np.degrees(np.arctan2(sine, cosine))
    if mesh.order == 2:
        return angle > _KINK
    # Of all triangles around a node, the largest angle at the edges opposite it.
    opposite = np.zeros(mesh.node_count)
    np.maximum.at(opposite, np.roll(mesh.triangles, -2, axis=1).ravel(), angle[_edge_of_half(mesh)])
    return (angle > _KINK) & (angle > _SHARPER * opposite[table.nodes].max(axis=1))


def connected(mesh: Mesh, marked: Marks) -> list[SurfaceLine]:
    """The lines that marked edges make, in the order of their first edges."""
    edges = np.flatnonzero(marked)
    label = node_parts(mesh.edge_table.nodes[edges], mesh.node_count)[1][mesh.edge_table.nodes[edges, 0]]
    first, edge_of = np.unique(label, return_index=True)[1], _edge_of_half(mesh)
    return [SurfaceLine(mesh, edges[label == label[one]], edge_of) for one in np.sort(first)]


def _edge_of_half(mesh: Mesh) -> Numbers:
    """(3 tri_count,) number of the edge of each half-edge."""
    table = mesh.edge_table
    found = np.empty(3 * mesh.tri_count, dtype=np.int64)
    found[table.half_edges] = np.repeat(np.arange(len(table.nodes)), table.tri_count)
    return found


def _all_beside(mesh: Mesh, marked: Marks) -> Marks:
    """(edge_count,) edges beside which all triangles are marked."""
    table = mesh.edge_table
    return np.logical_and.reduceat(marked[table.half_edges // 3], table.start)


def _half_edge_normals(mesh: Mesh, half: Numbers, points: Floats) -> Floats:
    """(k, 3) unit normals of the triangles of half-edges, of six-node ones amid that edge."""
    triangle, corner = np.divmod(half, 3)
    if mesh.order == 1:
        return _flat_normals(points[mesh.triangles[triangle]])
    # Half-edge c runs from corner c to the next: the area coordinate of the third is zero amid it.
    places = 0.5 * (1.0 - np.eye(3))[[2, 0, 1]]
    normals = quadratic.normals(points, mesh.cells[triangle], quadratic.Rule(places, np.zeros(3)))
    return _unit(normals[np.arange(len(half)), corner])


def _node_normals(mesh: Mesh, triangles: Numbers, points: Floats) -> Floats:
    """(node_count, 3) unit normals at nodes of some triangles, the mean by their angles; zero elsewhere."""
    corners = points[mesh.triangles[triangles]]
    normal = _flat_normals(corners)
    found = np.zeros((len(points), 3))
    for k in range(3):
        one, other = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other))
        np.add.at(found, mesh.triangles[triangles, k], angle[:, None] * normal)
    return _unit(found)


def _flat_normals(corners: Floats) -> Floats:
    """(k, 3) unit normals of triangles by their corners (k, 3, 3)."""
    return _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def node_normals(mesh: Mesh, points: Floats) -> Floats:
    """(node_count, 3) unit normals at corners, the mean of the triangles around them by their angles; zero at other nodes."""
    return _node_normals(mesh, np.arange(mesh.tri_count), points)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))
