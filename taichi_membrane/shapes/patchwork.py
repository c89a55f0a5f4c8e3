"""Shapes sewn of several pieces: nodes are numbered once and handed from piece to piece, so that seams share them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.mesh import Mesh

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Patchwork:
    """Nodes, pieces of triangles with their groups and warp directions, and lines, collected until a mesh is made."""

    def __init__(self) -> None:
        self.node_groups: dict[str, Ints] = {}
        self._points: list[Floats] = []
        self._triangles: list[Ints] = []
        self._warp: list[Floats] = []
        self._members: dict[str, list[Ints]] = {}
        self._lines: dict[str, Ints] = {}
        self.node_count = 0
        self.tri_count = 0

    @property
    def points(self) -> Floats:
        """(node_count, 3) places of all nodes so far."""
        return np.concatenate(self._points)

    def nodes(self, points: ArrayLike) -> Ints:
        """Add nodes; returns their numbers in the shape of ``points`` but for its last axis, x, y, z."""
        places = np.asarray(points, dtype=np.float64)
        count = int(np.prod(places.shape[:-1]))
        self._points.append(places.reshape(count, 3))
        numbers = self.node_count + np.arange(count).reshape(places.shape[:-1])
        self.node_count += count
        return numbers

    def piece(self, triangles: Ints, groups: Sequence[str], warp: ArrayLike) -> Ints:
        """Add triangles to element groups; returns their numbers.

        :param warp: direction of the warp, one for all or one for each.
        """
        numbers = self.tri_count + np.arange(len(triangles))
        self._triangles.append(triangles)
        self._warp.append(np.broadcast_to(np.asarray(warp, dtype=np.float64), (len(triangles), 3)))
        self.tri_count += len(triangles)
        self.name(numbers, *groups)
        return numbers

    def name(self, numbers: Ints, *groups: str) -> None:
        """Put elements in groups."""
        for group in groups:
            self._members.setdefault(group, []).append(numbers)

    def line(self, group: str, nodes: Ints) -> None:
        """Add a group of line elements, (n, 2) node numbers, or more to it."""
        self._lines[group] = np.concatenate((self._lines[group], nodes)) if group in self._lines else nodes

    def mesh(self, where: str) -> Mesh:
        """The mesh of all pieces."""
        ends = np.cumsum([len(nodes) for nodes in self._lines.values()])
        starts = ends - [len(nodes) for nodes in self._lines.values()]
        groups: Mapping[str, ArrayLike] = {name: np.unique(np.concatenate(m)) for name, m in self._members.items()}
        return Mesh.build(
            self.points,
            np.concatenate(self._triangles),
            self.node_groups,
            groups,
            np.concatenate(self._warp),
            where=where,
            lines=np.concatenate(list(self._lines.values())) if self._lines else None,
            line_groups={
                name: np.arange(start, end) for name, start, end in zip(self._lines, starts, ends, strict=True)
            },
        )


def quads(at: Ints, *, banded: bool = False) -> Ints:
    """Cut a grid of nodes in triangles; their normal is the first direction times the second.

    :param at: (m, n) node numbers.
    :param banded: diagonals change from one column of cells to the next, along the second direction; without it from each cell to
        its neighbours. Banded, every inner node has six triangles and an even share of their areas, where neighbours otherwise
        have four and eight.
    :return: (2 (m - 1) (n - 1), 3) node numbers, two triangles of a cell after each other, cells of a row after each other.
    """
    i, j = np.indices((at.shape[0] - 1, at.shape[1] - 1))
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    rising = (j if banded else i + j) % 2 == 0
    first = np.stack((a, b, np.where(rising, c, d)), axis=-1)
    second = np.stack((np.where(rising, a, b), c, d), axis=-1)
    return np.stack((first, second), axis=2).reshape(-1, 3)


def zip_rows(lower: Ints, upper: Ints) -> Ints:
    """Triangulate the band between two rows of nodes of any counts, both even from end to end.

    Seen from where rows run to the right and the upper row is above, triangles run counter-clockwise. A row may be one node.
    """
    n, m = len(lower) - 1, len(upper) - 1
    i, j = np.arange(n), np.arange(m)
    # Middles of the sides in whole numbers; ties are broken one way on either half, as a mirror does.
    low_middle, high_middle = max(m, 1) * (2 * i + 1), max(n, 1) * (2 * j + 1)
    low_middle = 2 * low_middle + np.where(low_middle < n * m, -1, 1)
    high_middle = 2 * high_middle
    low = np.column_stack((lower[i], lower[i + 1], upper[np.searchsorted(high_middle, low_middle)]))
    high = np.column_stack((upper[j + 1], upper[j], lower[np.searchsorted(low_middle, high_middle)]))
    return np.concatenate((low, high))
