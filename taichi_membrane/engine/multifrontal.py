"""Sparse direct solution of symmetric systems of 3×3 blocks on a surface mesh: the multifrontal method in dense BLAS.

Fronts (see :mod:`taichi_membrane.engine.dissection`) are eliminated from the leaves to the root. Each is a dense matrix over its
own nodes and the later nodes they touch; what its elimination leaves on the latter, the Schur complement, is added to its
parent (Duff and Reid, ACM Trans. Math. Softw. 9, 1983). Cholesky where the front is positive definite; on request Bunch and
Kaufman's factorisation where it is not, whose pivots count the negative eigenvalues (Haynsworth: inertias add up over the
fronts).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, lapack
from threadpoolctl import ThreadpoolController

from taichi_membrane.engine.dissection import Dissection, dissect
from taichi_membrane.engine.preparation import Floats, Ints

# A pivot below this share of its diagonal entry is round-off: the matrix is singular in double precision.
_CANCELLED = 1e-14

Runs = list[tuple[slice, slice]]


@dataclass(frozen=True)
class Front:
    """What never changes of a front; numbers are places in the order of elimination, sizes count nodes.

    :param start: first of the nodes it eliminates; ``stop`` is past the last.
    :param border: later nodes they touch, ascending.
    :param blocks: the matrix blocks that enter here, as a range of block numbers.
    :param entry: (9 · blocks,) place of their entries in the front, column by column.
    :param runs: for each child, where unbroken runs of its border (in rows) lie in this front: (in the child, here).
    """

    start: int
    stop: int
    border: NDArray[np.int64]
    blocks: slice
    entry: NDArray[np.int64]
    children: tuple[int, ...]
    runs: tuple[Runs, ...]

    @property
    def rows(self) -> int:
        """Rows of the front's matrix."""
        return 3 * (self.stop - self.start + len(self.border))


@dataclass(frozen=True, eq=False)
class Elimination:
    """Symbolic factorisation: where every block of the lower triangle goes.

    :param dissection: order of elimination.
    :param node_block: (node_count,) number of each node's diagonal block.
    :param edge_block: (edge_count,) number of each edge's block.
    :param edge_node: (edge_count, 2) node of the block's columns (eliminated first) and node of its rows.
    """

    dissection: Dissection
    fronts: list[Front]
    node_block: NDArray[np.int32]
    edge_block: NDArray[np.int32]
    edge_node: NDArray[np.int32]

    @property
    def block_count(self) -> int:
        """Blocks on and below the diagonal."""
        return len(self.node_block) + len(self.edge_block)

    def factor_entries(self) -> int:
        """Numbers that a factor stores."""
        return sum(3 * (front.stop - front.start) * front.rows for front in self.fronts)


def eliminate(points: Floats, edges: Ints) -> Elimination:
    """Order and symbolic factorisation for nodes at ``points`` (n, 3) that ``edges`` (m, 2) couple."""
    dissection = dissect(points, edges)
    place, start = dissection.place, dissection.start
    first, second = place[edges[:, 0]], place[edges[:, 1]]
    column = np.concatenate([np.arange(len(points)), np.minimum(first, second)])
    row = np.concatenate([np.arange(len(points)), np.maximum(first, second)])
    front_of = np.searchsorted(start, column, side="right") - 1
    # Blocks are numbered by fronts, so that each front finds its own next to each other.
    order = np.argsort(front_of, kind="stable")
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    bounds = np.concatenate([[0], np.cumsum(np.bincount(front_of, minlength=len(start) - 1))])
    swapped = first > second
    return Elimination(
        dissection=dissection,
        fronts=list(_fronts(dissection, row[order], column[order], bounds)),
        node_block=number[: len(points)][place],
        edge_block=number[len(points) :],
        edge_node=np.where(swapped[:, None], edges[:, ::-1], edges).astype(np.int32),
    )


def _fronts(
    dissection: Dissection, row: NDArray[np.int64], column: NDArray[np.int64], bounds: NDArray[np.int64]
) -> Iterator[Front]:
    """Fronts from the leaves to the root."""
    borders: list[NDArray[np.int64]] = []
    where = np.empty(len(dissection.order), dtype=np.int64)  # place in the front at hand
    within = np.arange(3)[:, None]  # rows of a block
    for number, (start, stop) in enumerate(pairwise(dissection.start.tolist())):
        blocks = slice(int(bounds[number]), int(bounds[number + 1]))
        children = dissection.children[number]
        touched = np.concatenate([row[blocks], *(borders[child] for child in children)])
        border = np.unique(touched[touched >= stop])
        borders.append(border)
        where[start:stop] = np.arange(stop - start)
        where[border] = np.arange(stop - start, stop - start + len(border))
        rows = 3 * (stop - start + len(border))
        corner = 3 * where[row[blocks]] + 3 * rows * where[column[blocks]]
        entry = corner[:, None, None] + within + rows * within.T
        yield Front(
            start=start,
            stop=stop,
            border=border,
            blocks=blocks,
            entry=entry.ravel(),
            children=tuple(children),
            runs=tuple(_runs(where[borders[child]]) for child in children),
        )


def _runs(places: NDArray[np.int64]) -> Runs:
    """Unbroken runs of ascending places: rows in the child, and rows here."""
    breaks = np.flatnonzero(np.diff(places) != 1) + 1
    begin = np.concatenate([[0], breaks]).tolist() if len(places) else []
    end = [*breaks.tolist(), len(places)]
    return [
        (slice(3 * a, 3 * b), slice(3 * int(places[a]), 3 * int(places[a]) + 3 * (b - a)))
        for a, b in zip(begin, end, strict=False)
    ]


@dataclass(frozen=True)
class _Pivots:
    """A factorised front: Cholesky (``factor`` and the rows ``below`` it), or where ``order`` is given Bunch and Kaufman's, with
    ``below`` the solution of the front's own equations for its border columns."""

    factor: Floats
    below: Floats
    order: NDArray[np.int32] | None = None


@dataclass(frozen=True, eq=False)
class Factor:
    """A factorised matrix.

    :param negative: number of negative eigenvalues.
    """

    elimination: Elimination
    pivots: list[_Pivots]
    negative: int

    def solve(self, right: Floats) -> Floats:
        """Solution (n, 3) for a right-hand side (n, 3), by nodes."""
        order = self.elimination.dissection.order
        x = np.ascontiguousarray(right[order])
        fronts = list(zip(self.elimination.fronts, self.pivots, strict=True))
        with _one_thread():
            for front, pivots in fronts:
                own = x[front.start : front.stop].reshape(-1)
                if pivots.order is None:
                    own[:] = blas.dtrsv(pivots.factor, own, lower=1)
                if len(front.border):
                    x[front.border] -= (own @ pivots.below.T).reshape(-1, 3)
            for front, pivots in reversed(fronts):
                own = x[front.start : front.stop].reshape(-1)
                later = x[front.border].reshape(-1)
                if pivots.order is None:
                    own[:] = blas.dtrsv(pivots.factor, own - later @ pivots.below, lower=1, trans=1)
                else:
                    solution, _ = lapack.dsytrs(pivots.factor, pivots.order, own, lower=1)
                    own[:] = solution.reshape(-1) - later @ pivots.below
        result = np.empty_like(x)
        result[order] = x
        return result


def factorise(
    elimination: Elimination, blocks: Floats, diagonal: Floats | None = None, *, indefinite: bool = False
) -> Factor | None:
    """Factorise a symmetric matrix.

    :param blocks: (block_count, 3, 3) lower triangle; held components have 1 on the diagonal and 0 beside it.
    :param diagonal: (node_count, 3) to be added to the diagonal.
    :param indefinite: go on where the matrix is not positive definite, and count its negative eigenvalues.
    :return: None when the matrix is singular, or not positive definite and ``indefinite`` is not set.
    """
    added = None if diagonal is None else diagonal[elimination.dissection.order].reshape(-1)
    values = blocks.reshape(len(blocks), 9)
    updates: dict[int, Floats] = {}
    pivots: list[_Pivots] = []
    negative = 0
    with _one_thread():
        for number, front in enumerate(elimination.fronts):
            matrix, diagonal_entries = _assembled(front, values, added, updates)
            result = _eliminated(matrix, diagonal_entries, indefinite)
            if result is None:
                return None
            factorised, updates[number], count = result
            pivots.append(factorised)
            negative += count
    return Factor(elimination, pivots, negative)


def _assembled(front: Front, values: Floats, added: Floats | None, updates: dict[int, Floats]) -> tuple[Floats, Floats]:
    """The front's matrix (lower triangle): its blocks and what its children left. And its own nodes' diagonal before the latter."""
    rows, own = front.rows, 3 * (front.stop - front.start)
    flat = np.zeros(rows * rows)
    flat[front.entry] = values[front.blocks].reshape(-1)
    if added is not None:
        flat[: own * rows : rows + 1] += added[3 * front.start : 3 * front.stop]
    diagonal = flat[: own * rows : rows + 1].copy()
    matrix = flat.reshape(rows, rows, order="F")
    for child, runs in zip(front.children, front.runs, strict=True):
        update = updates.pop(child)
        for at, (column_from, column_to) in enumerate(runs):
            for row_from, row_to in runs[at:]:
                matrix[row_to, column_to] += update[row_from, column_from]
    return matrix, diagonal


def _eliminated(matrix: Floats, diagonal: Floats, indefinite: bool) -> tuple[_Pivots, Floats, int] | None:
    """Factor of a front's own, leading rows, what is left on the others, and how many pivots were negative."""
    result = _cholesky(matrix, diagonal)
    return _bunch_kaufman(matrix, len(diagonal)) if result is None and indefinite else result


def _cholesky(matrix: Floats, diagonal: Floats) -> tuple[_Pivots, Floats, int] | None:
    """:func:`_eliminated` where the leading rows are positive definite, else None."""
    own = len(diagonal)
    factor, failed = lapack.dpotrf(matrix[:own, :own], lower=1, clean=0)
    if failed or np.any(np.diagonal(factor) ** 2 <= _CANCELLED * diagonal):
        return None
    below = blas.dtrsm(1.0, factor, matrix[own:, :own], side=1, lower=1, trans_a=1)
    return _Pivots(factor, below), matrix[own:, own:] - below @ below.T, 0


def _bunch_kaufman(matrix: Floats, own: int) -> tuple[_Pivots, Floats, int] | None:
    """:func:`_eliminated` where the leading rows are indefinite; None where they are singular."""
    factor, order, failed = lapack.dsytrf(matrix[:own, :own], lower=1)
    if failed:
        return None
    coupling = matrix[own:, :own]
    solved, _ = lapack.dsytrs(factor, order, coupling.T, lower=1)
    # A pair of rows shares a 2×2 pivot, marked by a negative entry in both; such a pivot has one eigenvalue of either sign.
    single = order > 0
    negative = int((np.diagonal(factor)[single] < 0.0).sum()) + int((~single).sum()) // 2
    return _Pivots(factor, solved.T, order), matrix[own:, own:] - coupling @ solved, negative


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def _one_thread() -> AbstractContextManager[object]:
    """Keep BLAS to one thread: on fronts of up to 2500 rows a second one was slower, and beside other work ten times slower."""
    return _controller().limit(limits=1, user_api="blas")
