"""Which triangle each node may touch, on either side of its own wall: a search by place, then by neighbours.

A node has two feelers, along its normal and against it. What a feeler has found it keeps, and follows from triangle to neighbouring
triangle, so that the side on which a node lies of a wall is known even where it has been pushed through by a trial state. A feeler
without a triangle takes the nearest one that faces it, within reach, and on its side. Triangles at the node and beside those are
no partners. Walls that coincide touch by their backs, as those of a flat bag.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.mesh import Mesh

# How far feelers reach, and how far along a wall partners are kept in the matrix's pattern, in mean sides.
REACH, MARGIN = 2.0, 0.75
# Least cosine between two walls that face each other, and between the way to a wall and its normal.
_FACES, _ACROSS = 0.3, 0.7
# Length of the sum of the directed areas at a node, over the sum of their lengths, from which its wall has one normal there.
_WHOLE = 0.5
# In mean sides, a distance at which that is not asked for.
_CLOSE = 0.1
# Distances over the size of the structure that are none.
SAME = 1e-6
# Neighbours that a partner is followed over at once.
_WALK = 12


@dataclass(frozen=True, eq=False)
class Walls:
    """Elements of a mesh that touch each other.

    :param tri: their numbers.
    """

    mesh: Mesh
    tri: Ints

    @cached_property
    def corners(self) -> Ints:
        """(m, 3) nodes of the elements."""
        return np.asarray(self.mesh.triangles[self.tri], dtype=np.int64)

    @cached_property
    def nodes(self) -> Ints:
        """Nodes of the elements."""
        return np.unique(self.corners)

    @cached_property
    def middles(self) -> Floats:
        """(m, 3) of the elements at rest."""
        return np.asarray(self.mesh.points[self.corners].mean(axis=1))

    @cached_property
    def size(self) -> float:
        """Size of the structure."""
        return float(np.linalg.norm(np.ptp(self.mesh.points, axis=0)))

    @cached_property
    def _at_node(self) -> scipy.sparse.csr_matrix:
        rows = np.repeat(np.arange(len(self.corners)), 3)
        ones = np.ones(len(rows), dtype=np.int32)
        return scipy.sparse.csr_matrix(
            (ones, (rows, self.corners.ravel())), shape=(len(self.corners), self.mesh.node_count)
        )

    @cached_property
    def beside(self) -> scipy.sparse.csr_matrix:
        """(m, m) which elements share a node, each with itself."""
        return (self._at_node @ self._at_node.T).tocsr()

    @cached_property
    def parts(self) -> tuple[Ints, Ints]:
        """Number of the part that hangs together, of each node (-1 of what is no wall) and of each element."""
        _, of_tri = scipy.sparse.csgraph.connected_components(self.beside, directed=False)
        of_node = np.full(self.mesh.node_count, -1)
        of_node[self.corners] = of_tri[:, None]
        return of_node, np.asarray(of_tri)

    @cached_property
    def wide(self) -> scipy.sparse.csr_matrix:
        """(m, m) elements that share a node with such."""
        return (self.beside @ self.beside).tocsr()

    @cached_property
    def own(self) -> scipy.sparse.csr_matrix:
        """(node_count, m) elements that are no partners of a node: those at it, and all that share a node with these."""
        return (self._at_node.T @ self.beside).tocsr()

    def is_own(self, nodes: Ints, tri: Ints) -> NDArray[np.bool_]:
        """(k,) whether elements are no partners of nodes."""
        if not len(nodes):
            return np.zeros(0, dtype=bool)
        return np.asarray(self.own[nodes, tri]).ravel() > 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Touched:
    """What one load step hands to the next: of each node's two feelers, (node_count, 2).

    :param partner: elements that they have, by their places among the walls', -1 where none.
    :param push: contact forces.
    """

    partner: Ints
    push: Floats


class Found(NamedTuple):
    """Pairs of a feeler and an element.

    :param node: of the feeler; ``side`` 0 along its normal, 1 against it. ``tri``: place of the element among the walls'.
    :param share: (k, 3) of the corners in the nearest point; ``normal`` (k, 3) from it to the node, where the node is on its side.
    :param gap: along the normal. ``distance`` from the nearest point.
    """

    node: Ints
    side: Ints
    tri: Ints
    share: Floats
    normal: Floats
    gap: Floats
    distance: Floats

    def some(self, which: Ints) -> Found:
        """Some of them."""
        parts: list[Any] = [np.asarray(one)[which] for one in self]
        return Found(*parts)

    def joined(self, other: Found) -> Found:
        """Both, one after the other."""
        parts: list[Any] = [np.concatenate([a, b]) for a, b in zip(self, other, strict=True)]
        return Found(*parts)


class Search:
    """The walls at one instant.

    :param places: (node_count, 3) of all nodes.
    """

    def __init__(self, walls: Walls, places: Floats) -> None:
        self.walls, self.places = walls, places
        self.at = places[walls.corners]
        directed = np.cross(self.at[:, 1] - self.at[:, 0], self.at[:, 2] - self.at[:, 0])
        self.normal = directed / np.linalg.norm(directed, axis=1, keepdims=True).clip(1e-300)
        total, area = np.zeros_like(places), np.zeros(len(places))
        for corner in walls.corners.T:
            np.add.at(total, corner, directed)
            np.add.at(area, corner, np.linalg.norm(directed, axis=1))
        length = np.linalg.norm(total, axis=1)
        # None where the wall is folded, as at the rim of a flat bag.
        whole = length > _WHOLE * area
        self.node_normal = np.where(whole[:, None], total / length.clip(1e-300)[:, None], 0.0)
        sides = np.linalg.norm(self.at - np.roll(self.at, 1, axis=1), axis=2)
        self.side = float(sides.mean())
        self.radius = float(np.linalg.norm(self.at - self.at.mean(axis=1, keepdims=True), axis=2).max())

    def pairs(self, node: Ints, side: Ints, tri: Ints) -> Found:
        """Where feelers and elements lie to each other."""
        share, distance = closest(self.places[node], self.at[tri])
        facing = np.einsum("ij,ij->i", self.node_normal[node], self.normal[tri])
        # From the wall to a feeler along its normal: against that normal.
        sign = np.where(side == 0, -1.0, 1.0) * np.where(facing < 0.0, -1.0, 1.0)
        smooth = np.einsum("ij,ijk->ik", share, self.node_normal[self.walls.corners[tri]])
        length = np.linalg.norm(smooth, axis=1, keepdims=True)
        smooth = smooth / length.clip(1e-300)
        along = np.einsum("ij,ij->i", smooth, self.normal[tri])[:, None]
        smooth = np.where((length > _FACES) & (along > _ACROSS), smooth, self.normal[tri])
        normal = sign[:, None] * smooth
        way = self.places[node] - np.einsum("ij,ijk->ik", share, self.at[tri])
        return Found(node, side, tri, share, normal, np.einsum("ij,ij->i", way, normal), distance)

    def facing(self, node: Ints, tri: Ints) -> Ints:
        """(k,) how walls at a node and of an element face each other: -1 front to front or back to back, 1 front to back, 0 not at
        all. What hangs together and is near at rest does not so front to back: no bend of one wall is taken for two."""
        cosine = np.einsum("ij,ij->i", self.node_normal[node], self.normal[tri])
        apart = np.linalg.norm(self.walls.mesh.points[node] - self.walls.middles[tri], axis=1)
        node_part, tri_part = self.walls.parts
        other = (node_part[node] != tri_part[tri]) | (apart > 3.0 * REACH * self.side)
        forward = (cosine >= _FACES) & other
        return np.where(cosine <= -_FACES, -1, np.where(forward, 1, 0))

    def near(self, reach: float) -> tuple[Ints, Ints]:
        """Nodes and elements whose nearest points may be within a distance."""
        tree, nodes = scipy.spatial.cKDTree(self.at.mean(axis=1)), self.walls.nodes
        lists: Any = tree.query_ball_point(self.places[nodes], reach + self.radius, return_sorted=True)
        node = np.repeat(nodes, [len(one) for one in lists])
        tri = np.concatenate([np.zeros(0), *lists]).astype(np.int64)
        kept = ~self.walls.is_own(node, tri)
        return node[kept], tri[kept]

    def partners(self, known: Ints, before: Search) -> Found:
        """What every feeler touches or may touch soon, one element each.

        :param known: (node_count, 2) elements that feelers have, -1 where none.
        :param before: at the last equilibrium, which tells on which side of a wall a node is that a trial state has moved.
        """
        kept = self._followed(known)
        has = np.zeros_like(known, dtype=bool)
        has[kept.node, kept.side] = True
        node, tri = self.near(REACH * self.side)
        fresh = self.pairs(np.tile(node, 2), np.repeat([0, 1], len(node)), np.tile(tri, 2))
        none = SAME * self.walls.size
        was = before.pairs(fresh.node, fresh.side, fresh.tri)
        ahead = (was.gap > none) & (was.gap >= _FACES * was.distance)
        ahead &= (np.abs(fresh.gap) >= _ACROSS * fresh.distance) | (fresh.distance <= _CLOSE * self.side)
        # Walls that coincide touch by their backs; one that a feeler of the node has already is no other one.
        same = (np.abs(was.gap) <= none) & (was.distance <= 2.0 * none) & (fresh.side == 1)
        same &= ~has[fresh.node].any(axis=1)
        facing = self.facing(fresh.node, fresh.tri)
        good = (ahead | same) & (fresh.distance <= REACH * self.side)
        good &= (facing != 0) & (facing == before.facing(fresh.node, fresh.tri))
        good &= ~has[fresh.node, fresh.side]
        every = kept.joined(nearest(fresh.some(np.flatnonzero(good))))
        return every.some(self._one_each(every, len(kept.node)))

    def _one_each(self, found: Found, first: int) -> Ints:
        """Numbers of those that stay where both feelers of a node have one wall: it is on one side alone.

        :param first: so many that come first were there before, and stay rather than others; else the nearer one.
        """
        pair = np.full((len(self.places), 2), -1)
        pair[found.node, found.side] = np.arange(len(found.node))
        front, back = pair[(pair >= 0).all(axis=1)].T
        same = np.asarray(self.walls.wide[found.tri[front], found.tri[back]]).ravel() > 0 if len(front) else front > 0
        front, back = front[same], back[same]
        old = np.column_stack([front < first, back < first])
        goes_back = np.where(old[:, 0] == old[:, 1], found.distance[back] >= found.distance[front], old[:, 0])
        return np.setdiff1d(np.arange(len(found.node)), np.where(goes_back, back, front))

    def _followed(self, known: Ints) -> Found:
        """The elements that feelers have, or those beside that have come nearer; without those that are out of reach."""
        node, side = np.nonzero(known >= 0)
        tri = known[node, side]
        for _ in range(_WALK):
            rows = self.walls.beside[tri]
            owner = np.repeat(np.arange(len(tri)), np.diff(rows.indptr))
            found = self.pairs(node[owner], side[owner], rows.indices.astype(np.int64))
            distance = np.where(self.walls.is_own(found.node, found.tri), np.inf, found.distance)
            best = nearest(found._replace(distance=distance))
            order = np.lexsort((best.side, best.node))
            best = best.some(order)
            if np.array_equal(best.tri, tri):
                break
            tri = best.tri
        found = self.pairs(node, side, tri)
        beyond = (np.abs(found.gap) < _ACROSS * found.distance) & (found.distance > SAME * self.walls.size)
        off = (found.distance > REACH * self.side) | (beyond & (found.distance > _CLOSE * self.side))
        off |= self.walls.is_own(node, tri)
        return found.some(np.flatnonzero(~off))

    def pattern(self, found: Found) -> Ints:
        """(k, 2) nodes that contact may couple while feelers slide by the margin, the lower number first; sorted."""
        node, tri = self.near((REACH + MARGIN) * self.side)
        beside = self.pairs(node, np.zeros(len(node), dtype=np.int64), tri)
        least = np.full(len(self.places), np.inf)
        np.minimum.at(least, node, np.where(self.facing(node, tri) != 0, beside.distance, np.inf))
        near = beside.distance <= least[node] + MARGIN * self.side
        pairs = [couples(self.walls, found), couples(self.walls, beside.some(np.flatnonzero(near)))]
        return np.unique(np.concatenate(pairs), axis=0)


def couples(walls: Walls, found: Found) -> Ints:
    """(3 k, 2) nodes that pairs couple beyond the elements' own sides, the lower number first."""
    ends = np.stack([np.repeat(found.node[:, None], 3, axis=1), walls.corners[found.tri]], axis=2).reshape(-1, 2)
    return np.asarray(np.sort(ends, axis=1))


def nearest(found: Found) -> Found:
    """Of each feeler's pairs the nearest one; of those as near the first."""
    order = np.lexsort((found.tri, found.distance, found.side, found.node))
    key = 2 * found.node[order] + found.side[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = key[1:] != key[:-1]
    return found.some(order[first])


def closest(points: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Shares (n, 3) of the corners in the nearest point of each triangle (n, 3, 3), and its distance (n,)."""
    best = np.full(len(points), np.inf)
    share = np.zeros((len(points), 3))
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        along = b - a
        part = np.einsum("ij,ij->i", points - a, along) / np.einsum("ij,ij->i", along, along).clip(1e-300)
        part = np.clip(part, 0.0, 1.0)
        away = np.linalg.norm(points - a - part[:, None] * along, axis=1)
        nearer = away < best
        one = np.zeros((len(points), 3))
        one[:, k], one[:, (k + 1) % 3] = 1.0 - part, part
        best, share = np.where(nearer, away, best), np.where(nearer[:, None], one, share)
    first, second, way = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    normal = np.cross(first, second)
    square = np.einsum("ij,ij->i", normal, normal).clip(1e-300)
    v = np.einsum("ij,ij->i", np.cross(way, second), normal) / square
    w = np.einsum("ij,ij->i", np.cross(first, way), normal) / square
    inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    height = np.abs(np.einsum("ij,ij->i", way, normal)) / np.sqrt(square)
    inner = np.column_stack([1.0 - v - w, v, w])
    return np.where(inside[:, None], inner, share), np.where(inside, height, best)
