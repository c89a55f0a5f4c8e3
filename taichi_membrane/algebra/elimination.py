"""Symbolic factorisation: which front every node and matrix block belongs to, and where a front's remainder goes in its parent.

A front (see :mod:`taichi_membrane.algebra.dissection`) couples its own nodes, which it eliminates, and its border, the later nodes
they touch. Its panel has its own nodes' columns; what their elimination leaves on the border, its update, is added to its parent's
panel and update (Duff and Reid, ACM Trans. Math. Softw. 9, 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.dissection import Dissection, dissect
from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.collector import no_collection

Places = NDArray[np.int64]


# Operations of a group of fronts that a thread takes at once: at most this share of all, but no group is cut below this many.
_LARGEST_GROUP, _SMALLEST_GROUP = 1 / 32, 2e7

Slices = tuple[slice, slice]
# Part of a child's update: whether it is added to the panel (else to the update), where to there, and where from in the child.
Addition = tuple[bool, Slices, Slices]


@dataclass(frozen=True)
class Group:
    """Fronts that one thread eliminates one after the other: a subtree, or a front above the subtrees.

    :param place: where each front's update begins in a workspace of ``workspace`` numbers.
    """

    fronts: range
    place: list[int]
    workspace: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Elimination:
    """Where everything goes. Places are node numbers in the order of elimination; those in a front count its own nodes, then its
    border.

    :param dissection: order of elimination.
    :param border_start: (front_count + 1,) where each front's border begins in ``border``.
    :param border: places of all borders' nodes, ascending in each.
    :param border_in_parent: their places in the parent front.
    :param block_start: (front_count + 1,) number of the first block that enters each front.
    :param block_in_front: (block_count, 2) places in that front of each block's rows and columns.
    :param node_block: (node_count,) number of each node's diagonal block.
    :param edge_block: (edge_count,) number of each edge's block.
    :param edge_node: (edge_count, 2) node of the block's columns (eliminated first) and node of its rows.
    """

    dissection: Dissection
    border_start: Places
    border: Places
    border_in_parent: Places
    block_start: Places
    block_in_front: Places
    node_block: NDArray[np.int32]
    edge_block: NDArray[np.int32]
    edge_node: NDArray[np.int32]

    @property
    def block_count(self) -> int:
        """Blocks on and below the diagonal."""
        return len(self.block_in_front)

    @cached_property
    def sizes(self) -> NDArray[np.int32]:
        """(front_count, 3) rows that each front eliminates, rows of its border, and both."""
        own, border = np.diff(self.dissection.start), np.diff(self.border_start)
        return 3 * np.column_stack([own, border, own + border]).astype(np.int32)

    @cached_property
    def operations(self) -> Floats:
        """(front_count,) multiplications that each elimination takes."""
        own, border, _ = self.sizes.T.astype(np.float64)
        return own * (own * own / 3.0 + own * border + border * border)

    @cached_property
    def panel_start(self) -> Places:
        """(front_count + 1,) where each front's panel begins among the numbers of the factor."""
        own, _, rows = self.sizes.T.astype(np.int64)
        return np.concatenate([[0], np.cumsum(own * rows)])

    @cached_property
    def pivots(self) -> Places:
        """(3 · node_count,) place of each pivot among the numbers of the factor, in the order of elimination."""
        own, _, rows = self.sizes.T.astype(np.int64)
        within = np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)
        return np.repeat(self.panel_start[:-1], own) + within * np.repeat(rows + 1, own)

    def factor_entries(self) -> int:
        """Numbers that a factor stores."""
        return int(self.panel_start[-1])

    def memory(self) -> int:
        """Bytes that a factorisation takes beside the matrix: the factor, and the updates at their most."""
        return 8 * (self.factor_entries() + sum(group.workspace for group in self.groups))

    @cached_property
    def entries(self) -> Places:
        """(9 · block_count,) place of the blocks' entries in the panel of their front, column by column."""
        front = np.repeat(np.arange(len(self.sizes)), np.diff(self.block_start))
        rows = self.sizes[front, 2].astype(np.int64)
        row, column = 3 * self.block_in_front.T
        within = np.arange(3)
        corner = row + column * rows
        return (corner[:, None, None] + within[:, None] + rows[:, None, None] * within).ravel()

    @cached_property
    def whole(self) -> tuple[NDArray[np.int32], NDArray[np.int32], Places]:
        """The whole matrix by rows of blocks: where each begins, the columns, and where the blocks' entries are among all given."""
        nodes, within = np.arange(len(self.node_block)), np.arange(9)
        column, row = self.edge_node.T
        rows, columns = np.concatenate([nodes, row, column]), np.concatenate([nodes, column, row])
        diagonal, below = (9 * blocks[:, None].astype(np.int64) for blocks in (self.node_block, self.edge_block))
        above = below + within.reshape(3, 3).T.ravel()
        entry = np.concatenate([diagonal + within, below + within, above])
        order = np.lexsort((columns, rows))
        start = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(nodes)))])
        return start.astype(np.int32), columns[order].astype(np.int32), entry[order].ravel()

    @cached_property
    def additions(self) -> list[list[Addition]]:
        """What each front's update adds to its parent (lower triangle), by blocks: the places come in few unbroken runs."""
        own = np.diff(self.dissection.start)[self.dissection.parent]
        front = np.repeat(np.arange(len(own)), np.diff(self.border_start))
        place = self.border_in_parent
        begins = (np.diff(place, prepend=-2) != 1) | (place == own[front])
        begins[self.border_start[:-1][np.diff(self.border_start) > 0]] = True
        first = np.flatnonzero(begins)
        length = np.diff(first, append=len(place))
        source = first - self.border_start[front[first]]
        with no_collection():
            runs: list[list[tuple[int, int, int]]] = [[] for _ in own]
            for number, a, b, n in zip(
                *(x.tolist() for x in (front[first], source, place[first], length)), strict=True
            ):
                runs[number].append((3 * a, 3 * b, 3 * n))
            return [_additions(of_front, 3 * n) for of_front, n in zip(runs, own.tolist(), strict=True)]

    @cached_property
    def children(self) -> list[list[int]]:
        """Numbers of the fronts that are condensed into each front."""
        lists: list[list[int]] = [[] for _ in self.sizes]
        for front, parent in enumerate(self.dissection.parent.tolist()):
            if parent >= 0:
                lists[parent].append(front)
        return lists

    @cached_property
    def groups(self) -> list[Group]:
        """The fronts in groups, children first."""
        parent, total = self.dissection.parent.tolist(), self.operations.tolist()
        first = list(range(len(total)))
        for number, above in enumerate(parent):
            if above >= 0:
                total[above] += total[number]
                first[above] = min(first[above], first[number])
        most = max(_SMALLEST_GROUP, _LARGEST_GROUP * self.operations.sum())
        groups, stop = [], len(total)
        while stop:
            start = first[stop - 1] if total[stop - 1] <= most else stop - 1
            groups.append(self._group(range(start, stop)))
            stop = start
        return groups[::-1]

    def _group(self, fronts: range) -> Group:
        """Places for the updates of a group: two stacks that grow towards each other, one for every other level of the tree, since
        a front's update comes before its children's are dropped."""
        sizes = (self.sizes[fronts.start : fronts.stop, 1].astype(np.int64) ** 2).tolist()
        sides = (self.dissection.depth[fronts.start : fronts.stop] % 2).tolist()
        tops, begin, most = [0, 0], [], 0
        for number, size, side in zip(fronts, sizes, sides, strict=True):
            begin.append(tops[side])
            tops[side] += size
            most = max(most, sum(tops))
            for child in self.children[number]:
                if child in fronts:
                    tops[1 - side] -= sizes[child - fronts.start]
        place = [most - at - size if side else at for at, size, side in zip(begin, sizes, sides, strict=True)]
        return Group(fronts, place, most)


def _additions(runs: list[tuple[int, int, int]], own: int) -> list[Addition]:
    """The parts of an update, from its unbroken runs of rows: where each begins in the child, where in the parent, and how many."""
    source = [slice(a, a + count) for a, _, count in runs]
    panel = [slice(b, b + count) for _, b, count in runs]
    update = [slice(b - own, b - own + count) for _, b, count in runs]
    parts = []
    for column, (_, begin, _) in enumerate(runs):
        in_panel = begin < own
        to = panel if in_panel else update
        for row in range(column, len(runs)):
            parts.append((in_panel, (to[row], to[column]), (source[row], source[column])))
    return parts


_last: tuple[Floats, Ints, Elimination] | None = None  # a sweep runs one mesh many times


def kept_elimination(points: Floats, edges: Ints) -> Elimination:
    """What :func:`eliminate` gives, from the call before where points and edges are the same to the bit.

    It is only read once it is made, so that models may share it. The last one stays in memory.
    """
    global _last
    known = _last
    if known is None or not (np.array_equal(known[0], points) and np.array_equal(known[1], edges)):
        known = points.copy(), edges.copy(), eliminate(points, edges)
        _last = known
    return known[2]


def eliminate(points: Floats, edges: Ints) -> Elimination:
    """Order and symbolic factorisation for nodes at ``points`` (n, 3) that ``edges`` (m, 2) couple."""
    dissection = dissect(points, edges)
    place, start = dissection.place, dissection.start
    size, count = len(points), np.diff(start)
    first, second = place[edges[:, 0]], place[edges[:, 1]]
    column = np.concatenate([place, np.minimum(first, second)])
    row = np.concatenate([place, np.maximum(first, second)])
    front = np.repeat(np.arange(len(count)), count)[column]
    # Blocks are numbered by fronts, so that each front finds its own next to each other.
    order = np.argsort(front, kind="stable")
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    front, column, row = front[order], column[order], row[order]
    keys = _borders(dissection, front, row)
    border_start = np.searchsorted(keys, size * np.arange(len(count) + 1))
    border_front, border = np.divmod(keys, size)

    def in_front(front: Places, node: Places) -> Places:
        """Places in ``front`` of the nodes at the places ``node``."""
        at = np.searchsorted(keys, front * size + node) - border_start[front]
        return np.where(node < start[front + 1], node - start[front], count[front] + at)

    return Elimination(
        dissection=dissection,
        border_start=border_start,
        border=border,
        border_in_parent=in_front(dissection.parent[border_front], border),
        block_start=np.searchsorted(front, np.arange(len(count) + 1)),
        block_in_front=np.column_stack([in_front(front, row), column - start[front]]),
        node_block=number[:size],
        edge_block=number[size:],
        edge_node=np.where((first > second)[:, None], edges[:, ::-1], edges).astype(np.int32),
    )


def _borders(dissection: Dissection, front: Places, row: Places) -> Places:
    """Every front's border, as node_count · front + place for each of its nodes, ascending.

    :param front: front of each block, ``row`` the place of its rows.
    """
    start, parent, size = dissection.start, dissection.parent, len(dissection.order)
    beyond = row >= start[front + 1]
    direct = np.unique(front[beyond] * size + row[beyond])
    level_of = dissection.depth[direct // size]
    levels: list[Places] = []
    below = np.empty(0, dtype=np.int64)
    for level in reversed(range(int(dissection.depth.max()) + 1)):
        child, node = np.divmod(below, size)
        inherited = (parent[child] * size + node)[node >= start[parent[child] + 1]]
        below = np.unique(np.concatenate([direct[level_of == level], inherited]))
        levels.append(below)
    return np.sort(np.concatenate(levels))
