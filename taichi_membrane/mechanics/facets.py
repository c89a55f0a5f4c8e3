"""A rigid triangulated surface, and a grid that tells which of its triangles can be the nearest ones.

Pseudo-normals tell the side of what is nearest to an edge or a corner (J. A. Baerentzen and H. Aanaes, IEEE Trans. Vis.
Comput. Graph. 11, 2005): the sum of the normals at an edge, at a corner the sum weighted by the angles there.

The grid is made once, as obstacles move without turning: each cell lists every triangle that is nearest to some point of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.mechanics.preparation import gather_lists

# Cells of the grid, about; and by how much of the surface's size it reaches beyond the surface.
_CELLS, _MARGIN = 20_000, 0.1
# Distances computed at a time.
_AT_A_TIME = 2_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Cells in the order x, y, z, the last one fastest.

    :param low: lowest corner. ``size`` is the length of a cell's sides, ``count`` the number of cells along x, y, z.
    :param start: (cells + 1,) where each cell's triangles begin in ``triangles``.
    """

    low: Floats
    size: float
    count: Ints
    start: Ints
    triangles: Ints


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles of a rigid surface, their normals to the side where the structure is.

    :param points: (n, 3). ``triangles``: (m, 3) corners, counter-clockwise seen from the front.
    """

    points: Floats
    triangles: Ints

    @cached_property
    def corners(self) -> Floats:
        """(m, 3, 3) places of the corners."""
        return np.asarray(self.points[self.triangles])

    @cached_property
    def normals(self) -> Floats:
        """(m, 3) unit normals."""
        directed = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        return np.asarray(directed / np.linalg.norm(directed, axis=1, keepdims=True))

    @cached_property
    def pseudo_normals(self) -> tuple[Floats, Floats]:
        """(m, 3, 3) of the corners and of the edges opposite them, unit vectors; zero at the rim of an open surface, beyond which
        there is neither front nor back."""
        corner_sum = np.zeros_like(self.points)
        for k in range(3):
            a, b, c = (self.corners[:, (k + j) % 3] for j in range(3))
            first, second = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in (b - a, c - a))
            angle = np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0))
            np.add.at(corner_sum, self.triangles[:, k], angle[:, None] * self.normals)
        opposite = np.stack([np.roll(self.triangles, -1, axis=1), np.roll(self.triangles, -2, axis=1)], axis=2)
        keys = np.sort(opposite.reshape(-1, 2), axis=1)
        _, edge, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        edge = edge.reshape(-1)
        edge_sum = np.zeros((len(count), 3))
        np.add.at(edge_sum, edge, np.repeat(self.normals, 3, axis=0))
        edge_sum[count == 1] = 0.0
        corner_sum[np.unique(keys[count[edge] == 1])] = 0.0
        of_edges = _unit(edge_sum)[edge].reshape(-1, 3, 3)
        return _unit(corner_sum)[self.triangles], of_edges

    @cached_property
    def grid(self) -> Grid:
        """The nearest triangles by place."""
        extent = np.ptp(self.points, axis=0)
        low = self.points.min(axis=0) - _MARGIN * np.linalg.norm(extent)
        whole = extent + 2.0 * _MARGIN * np.linalg.norm(extent)
        size = float((whole.prod() / _CELLS) ** (1.0 / 3.0))
        count = np.ceil(whole / size).astype(np.int64)
        places = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
        centres = low + size * places
        reach = np.sqrt(3.0) * size  # twice what a point of a cell is off its centre
        middles = self.corners.mean(axis=1)
        radius = float(np.linalg.norm(self.corners - middles[:, None], axis=2).max())
        tree = scipy.spatial.cKDTree(middles)
        nearest = np.asarray(tree.query(centres)[0])
        cells, triangles = [], []
        lists = tree.query_ball_point(centres, nearest + reach + radius, return_length=True)
        ends = np.cumsum(lists)
        for begin, stop in _batches(ends):
            near = tree.query_ball_point(centres[begin:stop], nearest[begin:stop] + reach + radius)
            owner = np.repeat(np.arange(begin, stop), lists[begin:stop])
            of = np.concatenate([np.asarray(one, dtype=np.int64) for one in near])
            distance = distances(centres[owner], self.corners[of])
            least = np.full(stop - begin, np.inf)
            np.minimum.at(least, owner - begin, distance)
            kept = distance <= least[owner - begin] * (1.0 + 1e-9) + reach
            cells.append(owner[kept])
            triangles.append(of[kept])
        start, order = gather_lists(np.concatenate(cells).astype(np.int32), len(centres))
        return Grid(low=low, size=size, count=count, start=start, triangles=np.concatenate(triangles)[order])


def _batches(ends: Ints) -> list[tuple[int, int]]:
    """Ranges of cells with so many triangles in all, at least one cell each."""
    found, begin = [], 0
    while begin < len(ends):
        before = ends[begin - 1] if begin else 0
        stop = max(int(np.searchsorted(ends, before + _AT_A_TIME, side="right")), begin + 1)
        found.append((begin, stop))
        begin = stop
    return found


def distances(points: Floats, corners: Floats) -> Floats:
    """(n,) distance of each point (n, 3) from its triangle (n, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    least = np.minimum(np.minimum(_from_side(points, a, b), _from_side(points, b, c)), _from_side(points, c, a))
    normal = np.cross(b - a, c - a)
    inside = np.ones(len(points), dtype=bool)
    for first, second in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(second - first, points - first), normal) >= 0.0
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / np.linalg.norm(normal, axis=1)
    return np.where(inside, height, least)


def _from_side(points: Floats, a: Floats, b: Floats) -> Floats:
    along = b - a
    share = np.clip(np.einsum("ij,ij->i", points - a, along) / np.einsum("ij,ij->i", along, along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 1e-12, length, np.inf))
