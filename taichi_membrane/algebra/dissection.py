"""Nested dissection: an order of elimination in which a surface mesh's sparse factor stays small.

The mesh is halved across its longest extent again and again; the nodes where two halves touch are their separator and are
eliminated after both. What remains undivided, a leaf, is eliminated first. Separators and leaves are the fronts of
:mod:`taichi_membrane.algebra.multifrontal` (A. George, SIAM J. Numer. Anal. 10, 1973).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats, Ints

# Most nodes of a leaf: fewer make more fronts, whose handling costs time; more fill the factor.
_LEAF = 32


@dataclass(frozen=True, eq=False)
class Dissection:
    """Order of elimination and tree of fronts; a front's descendants come right before it.

    :param order: (node_count,) node numbers as they are eliminated.
    :param start: (front_count + 1,) where each front's nodes begin in ``order``.
    :param parent: (front_count,) number of the front that each one is condensed into, -1 for none.
    """

    order: NDArray[np.int64]
    start: NDArray[np.int64]
    parent: NDArray[np.int64]

    @cached_property
    def place(self) -> NDArray[np.int64]:
        """(node_count,) place of each node in the order."""
        place = np.empty_like(self.order)
        place[self.order] = np.arange(len(self.order))
        return place

    @cached_property
    def depth(self) -> NDArray[np.int64]:
        """(front_count,) number of each front's ancestors."""
        depth = np.zeros_like(self.parent)
        for front, above in reversed(list(enumerate(self.parent.tolist()))):
            depth[front] = depth[above] + 1 if above >= 0 else 0
        return depth


def dissect(points: Floats, edges: Ints) -> Dissection:
    """Nested dissection of a graph whose nodes have positions.

    :param points: (node_count, 3) positions.
    :param edges: (edge_count, 2) node numbers.
    """
    piece, home = _halve(points, edges)
    fronts, front_of = np.unique(home, return_inverse=True)
    # A front's descendants have numbers that begin with its own bits: sorted by the end of that interval, deeper ones first,
    # children come before parents and siblings stay together.
    level = np.frexp(fronts.astype(np.float64))[1] - 1
    interval_end = (fronts + 1) << (level.max() - level)
    after = np.lexsort((-level, interval_end))
    rank = np.empty_like(after)
    rank[after] = np.arange(len(after))
    front_of = rank[front_of]
    # Within a front, by piece: the nodes that a child shares with its parent then come in few unbroken runs.
    order = np.lexsort((piece, front_of))
    start = np.concatenate([[0], np.cumsum(np.bincount(front_of, minlength=len(fronts)))])
    return Dissection(order=order, start=start, parent=_parents(fronts[after]))


def _halve(points: Floats, edges: Ints) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The smallest piece that each node came to lie in, and the piece whose front eliminates it.

    Pieces are numbered as in a heap: the halves of piece p are 2p and 2p + 1. All pieces of a level are halved at once.
    """
    piece = np.ones(len(points), dtype=np.int64)
    home = np.zeros(len(points), dtype=np.int64)  # 0: not yet decided
    first, second = edges[:, 0], edges[:, 1]
    order, begin = np.arange(len(points)), np.zeros(1, dtype=np.int64)
    while True:
        left = np.add.reduceat(home[order] == 0, begin)  # undecided nodes of each piece
        count = np.diff(np.append(begin, len(order)))
        finished = np.repeat(left <= _LEAF, count)
        leaf = order[finished]
        home[leaf] = np.where(home[leaf] == 0, piece[leaf], home[leaf])
        order = order[~finished]
        if not len(order):
            return piece, home
        order, begin = _split(points, piece, order)
        alive = (home[first] == 0) & (home[second] == 0)
        first, second = first[alive], second[alive]
        _separate(piece, home, first, second)


def _split(
    points: Floats, piece: NDArray[np.int64], order: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Halve every piece by the number of nodes, across its longest extent; the nodes by new piece, and where each begins.

    :param order: nodes of the pieces to halve, those of a piece next to each other.
    """
    old = piece[order]
    begin = np.flatnonzero(np.concatenate([[True], old[1:] != old[:-1]]))
    count = np.diff(np.append(begin, len(order)))
    x = points[order]
    extent = np.maximum.reduceat(x, begin) - np.minimum.reduceat(x, begin)
    axis = np.repeat(extent.argmax(axis=1), count)
    group = np.repeat(np.arange(len(begin)), count)
    order = order[np.lexsort((x[np.arange(len(x)), axis], group))]
    upper = 2 * (np.arange(len(order)) - begin[group]) >= count[group]
    piece[order] = 2 * old + upper
    return order, np.sort(np.concatenate([begin, begin + (count + 1) // 2]))


def _separate(
    piece: NDArray[np.int64], home: NDArray[np.int64], first: NDArray[np.int32], second: NDArray[np.int32]
) -> None:
    """Give the nodes on one side of every cut to its separator: of the two sides, the one with fewer nodes."""
    cut = piece[first] != piece[second]
    a, b = first[cut], second[cut]
    swap = (piece[a] & 1) == 1
    lower, upper = np.unique(np.where(swap, b, a)), np.unique(np.where(swap, a, b))
    whole, inverse = np.unique(piece[np.concatenate([lower, upper])] >> 1, return_inverse=True)
    of_lower, of_upper = inverse[: len(lower)], inverse[len(lower) :]
    fewer_below = np.bincount(of_lower, minlength=len(whole)) <= np.bincount(of_upper, minlength=len(whole))
    separator = np.concatenate([lower[fewer_below[of_lower]], upper[~fewer_below[of_upper]]])
    home[separator] = piece[separator] >> 1


def _parents(fronts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Position of each front's nearest ancestor among the heap numbers ``fronts``; some ancestors have no nodes and are missing."""
    position = {number: at for at, number in enumerate(fronts.tolist())}
    parent = np.full(len(fronts), -1, dtype=np.int64)
    for at, number in enumerate(fronts.tolist()):
        ancestor = number >> 1
        while ancestor and ancestor not in position:
            ancestor >>= 1
        parent[at] = position.get(ancestor, -1)
    return parent
