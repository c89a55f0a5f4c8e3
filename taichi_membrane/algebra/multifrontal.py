"""Sparse direct solution of symmetric systems of 3×3 blocks on a surface mesh: the multifrontal method in dense BLAS.

Cholesky where a front is positive definite; on request Bunch and Kaufman's factorisation where it is not, whose pivots count the
negative eigenvalues (Haynsworth: inertias add up over the fronts). Threads share out subtrees of fronts; each front's arithmetic is
the same whichever thread does it.
"""

from __future__ import annotations

import os
import weakref
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from threading import Lock
from typing import ClassVar

import numpy as np
from scipy import sparse
from scipy.linalg import lapack

from taichi_membrane.algebra import blas
from taichi_membrane.algebra.elimination import Elimination, Group
from taichi_membrane.algebra.refinement import SINGULAR, USELESS, refined, sure
from taichi_membrane.arrays import Floats

# A pivot below this share of its diagonal entry is round-off: the matrix is singular in double precision.
_CANCELLED = 1e-14
# So is an eigenvalue of an indefinite matrix, its rows scaled to size 1, below this: eps, times the few hundred by which round-off
# adds up. A singular matrix has its zeros at 1e-17 to 1e-15; its inertia would be that of round-off.
_ZERO = 1e-14
# Threads help above this many operations in all; in fronts whose panels have fewer numbers they would wait for Python's lock.
_WORTH_SHARING, _LARGE_PANEL = 1.5e10, 10_000


class _Memory:
    """Arrays that are lent out and come back: touching fresh pages took as long as the arithmetic."""

    def __init__(self) -> None:
        self._spare: list[Floats] = []
        self._lock = Lock()

    def take(self, size: int) -> Floats:
        """An array of at least ``size`` numbers, of any value."""
        with self._lock:
            fitting = [at for at, array in enumerate(self._spare) if len(array) >= size]
            if fitting:
                return self._spare.pop(min(fitting, key=lambda at: len(self._spare[at])))
        return np.empty(size)

    def give(self, array: Floats) -> None:
        """Take an array back."""
        with self._lock:
            self._spare.append(array)


class Multifrontal:
    """Factorises matrices of one pattern; keeps the memory that this takes.

    :param threads: how many to use; as many as there are cores where 0. Results do not depend on it.
    """

    def __init__(self, elimination: Elimination, threads: int = 0) -> None:
        self.elimination = elimination
        self.threads = threads or os.cpu_count() or 1
        self.panel_memory, self.memory = _Memory(), _Memory()
        # Plain numbers and views: NumPy's own cost more than the work on a small front.
        self.sizes: list[list[int]] = elimination.sizes.tolist()
        self.panel_start: list[int] = elimination.panel_start.tolist()
        self.start: list[int] = elimination.dissection.start.tolist()
        self.borders = [elimination.border[a:b] for a, b in pairwise(elimination.border_start.tolist())]
        blocks = (9 * elimination.block_start).tolist()
        self.values = [slice(a, b) for a, b in pairwise(blocks)]
        self.places = [elimination.entries[part] for part in self.values]

    def factorise(self, blocks: Floats, diagonal: Floats | None = None, *, indefinite: bool = False) -> Factor | None:
        """Factorise a symmetric matrix.

        :param blocks: (block_count, 3, 3) lower triangle; held components have 1 on the diagonal and 0 beside it.
        :param diagonal: (node_count, 3) to be added to the diagonal.
        :param indefinite: go on where the matrix is not positive definite, and count its negative eigenvalues.
        :return: None when the matrix is singular in double precision, or not positive definite and ``indefinite`` is not set.
        """
        blocks = blocks.copy()  # what the factor is of, whatever its owner does with the array
        if diagonal is not None:
            blocks[self.elimination.node_block[:, None], np.arange(3), np.arange(3)] += diagonal
        panels = self.panel_memory.take(self.elimination.factor_entries())
        numeric = _Numeric(self, blocks, panels, indefinite)
        with blas.one_thread():
            done = numeric.run()
        for workspace in numeric.lent.values():
            self.memory.give(workspace)
        if not done:
            self.panel_memory.give(panels)
            return None
        share = 0.0 if numeric.inverse else numeric.share()
        factor = Factor(self, blocks, panels, numeric.inverse, sum(numeric.negative.values()), share)
        weakref.finalize(factor, self.panel_memory.give, panels).atexit = False
        # Pivots of a definite matrix are tested one by one; pairs of an indefinite one hide each other's cancellation.
        return None if numeric.inverse and factor.smallest() <= _ZERO else factor


@dataclass(frozen=True, eq=False)
class Factor:
    """A factorised matrix.

    :param blocks: the matrix.
    :param panels: the fronts' factors, one after the other: Cholesky's L; of a front in ``inverse`` only the rows below count,
        already multiplied by that inverse.
    :param inverse: inverse of the leading rows of fronts that are not positive definite.
    :param negative: number of negative eigenvalues.
    :param share: the smallest pivot's share of its diagonal entry; 0 where the matrix is indefinite.
    """

    solver: Multifrontal
    blocks: Floats
    panels: Floats
    inverse: dict[int, Floats]
    negative: int
    share: float
    doubt: ClassVar[str] = ""
    refusal: ClassVar[str] = SINGULAR

    def solve(self, right: Floats, within: float = USELESS) -> Floats:
        """Solution (n, 3) for a right-hand side (n, 3), by nodes; not a number where more than ``within`` of that is left."""
        return self.substituted(right) if self.sure else refined(self.substituted, self.times, right, within)

    @property
    def sure(self) -> bool:
        """Whether the pivots alone say that solutions are good."""
        return sure(self.share, 3 * len(self.solver.elimination.node_block))

    def solve_transposed(self, right: Floats, within: float = USELESS) -> Floats:
        """The same: the matrix is symmetric."""
        return self.solve(right, within)

    def substituted(self, right: Floats) -> Floats:
        """Solution by forward and back substitution."""
        order = self.solver.elimination.dissection.order
        x = np.ascontiguousarray(right[order], dtype=np.float64)
        with blas.one_thread():
            self._substitute(x, forward=True)
            self._substitute(x, forward=False)
        result = np.empty_like(x)
        result[order] = x
        return result

    def times(self, vector: Floats) -> Floats:
        """The matrix times a vector (n, 3)."""
        return np.asarray(self._matrix @ vector.reshape(-1)).reshape(vector.shape)

    @cached_property
    def _matrix(self) -> sparse.bsr_matrix:
        """The matrix with both its triangles."""
        start, column, entry = self.solver.elimination.whole
        size = 3 * (len(start) - 1)
        data = self.solver.memory.take(len(entry))
        weakref.finalize(self, self.solver.memory.give, data).atexit = False
        np.take(self.blocks.reshape(-1), entry, out=data[: len(entry)], mode="clip")
        blocks = data[: len(entry)].reshape(-1, 3, 3)
        return sparse.bsr_matrix((blocks, column, start), shape=(size, size), copy=False)

    def row_sizes(self) -> Floats:
        """(n,) largest entry in each node's three rows."""
        elimination = self.solver.elimination
        size = np.abs(self.blocks).max(axis=(1, 2))
        largest = size[elimination.node_block]
        for nodes in elimination.edge_node.T:
            np.maximum.at(largest, nodes, size[elimination.edge_block])
        return np.asarray(largest)

    def residual(self, solution: Floats, right: Floats) -> float:
        """Backward error |b - K x|/(|K| |x| + |b|) of a solution, in largest components: round-off where it is right."""
        scale = self.row_sizes().max() * np.abs(solution).max() + np.abs(right).max()
        left = np.abs(right - self.times(solution)).max()
        return float(left / scale) if scale > 0.0 else 0.0

    def smallest(self) -> float:
        """About the size of the eigenvalue nearest zero, rows scaled to size 1, by one solve; 0 where that makes no sense.

        K = D A D; A y = c, c of independent normal components, has |y| ≥ |c·v|/|λ| for each eigenvector v, where c·v is a normal
        number: below a hundredth in one case of 120. The start is fixed, so that runs repeat bit by bit.
        """
        root = np.sqrt(np.maximum(self.row_sizes(), np.finfo(float).tiny))[:, None]
        right = root * np.random.default_rng(0).standard_normal((len(root), 3))
        solution = self.substituted(right)
        length = float(np.linalg.norm(root * solution))
        return 1.0 / length if np.isfinite(length) and length > 0.0 else 0.0

    def _substitute(self, x: Floats, *, forward: bool) -> None:
        """Forward or back substitution in ``x`` (n, 3), which is in the order of elimination."""
        solver = self.solver
        later = np.empty((max(map(len, solver.borders)), 3))  # a front's border, gathered
        gathered, vector, sizes = later.ctypes.data, x.ctypes.data, solver.elimination.sizes.ctypes.data
        panels, turned = self.panels.ctypes.data, blas.NO if forward else blas.TRANSPOSED
        numbers = range(len(solver.borders))
        for number in numbers if forward else reversed(numbers):
            panel, border, inverse = (
                panels + 8 * solver.panel_start[number],
                solver.borders[number],
                self.inverse.get(number),
            )
            own, part = sizes + 12 * number, vector + 24 * solver.start[number]
            if forward and inverse is None:
                blas.locked.dtrsv(blas.LOWER, turned, blas.NO, own, panel, own + 8, part, blas.STEP)
            elif inverse is not None and not forward:
                mine = x[solver.start[number] : solver.start[number + 1]]
                mine[:] = (inverse @ mine.reshape(-1)).reshape(-1, 3)
            if len(border):
                border_part = later[: len(border)]
                x.take(border, axis=0, out=border_part, mode="clip")
                source, target = (part, gathered) if forward else (gathered, part)
                below = panel + 8 * solver.sizes[number][0]
                blas.locked.dgemv(
                    turned, own + 4, own, blas.MINUS, below, own + 8, source, blas.STEP, blas.ONE, target, blas.STEP
                )
                if forward:
                    x[border] = border_part
            if inverse is None and not forward:
                blas.locked.dtrsv(blas.LOWER, turned, blas.NO, own, panel, own + 8, part, blas.STEP)


class _Numeric:
    """One factorisation at work."""

    def __init__(self, solver: Multifrontal, blocks: Floats, panels: Floats, indefinite: bool) -> None:
        self.solver, self.values, self.panels, self.indefinite = solver, blocks.reshape(-1), panels, indefinite
        self.updates: dict[int, Floats] = {}  # what fronts left whose parents are not done
        self.lent: dict[int, Floats] = {}  # the workspace each of them is in, where that is another group's
        self.failed = np.zeros(len(solver.sizes), dtype=np.int32)
        self.inverse: dict[int, Floats] = {}
        self.negative: dict[int, int] = {}
        elimination = solver.elimination
        diagonal = blocks[elimination.node_block[elimination.dissection.order]][:, np.arange(3), np.arange(3)]
        self.diagonal = diagonal.reshape(-1)
        self.least = _CANCELLED * self.diagonal

    def run(self) -> bool:
        """Eliminate all fronts; False where one could not be."""
        groups, parent = self.solver.elimination.groups, self.solver.elimination.dissection.parent
        if self.solver.threads == 1 or self.solver.elimination.operations.sum() < _WORTH_SHARING:
            return all(self._eliminate(group) for group in groups)
        group_of = np.repeat(np.arange(len(groups)), [len(group.fronts) for group in groups])
        above = np.array([parent[group.fronts[-1]] for group in groups])
        waits_for = np.bincount(group_of[above[above >= 0]], minlength=len(groups))
        running: dict[Future[bool], int] = {}
        ready = np.flatnonzero(waits_for == 0).tolist()
        with ThreadPoolExecutor(self.solver.threads) as pool:
            while ready or running:
                running |= {pool.submit(self._eliminate, groups[number]): number for number in ready}
                ready = []
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    if not future.result():
                        pool.shutdown(cancel_futures=True)
                        return False
                    if above[number] >= 0:
                        waiting = int(group_of[above[number]])
                        waits_for[waiting] -= 1
                        ready += [waiting] if waits_for[waiting] == 0 else []
        return True

    def share(self) -> float:
        """The smallest pivot's share of its diagonal entry, of a matrix that was found definite."""
        pivots = self.panels[self.solver.elimination.pivots]
        return float((pivots * pivots / self.diagonal).min(initial=1.0))

    def _eliminate(self, group: Group) -> bool:
        """Eliminate a group of fronts; False where one could not be."""
        workspace = self.lent[group.fronts[-1]] = self.solver.memory.take(group.workspace)
        for number, place in zip(group.fronts, group.place, strict=True):
            columns, update = self._assembled(number, workspace[place:])
            if not (self._cholesky(number, columns, update) or self._inverted(number, columns, update)):
                return False
            self.updates[number] = update
        return True

    def _assembled(self, number: int, workspace: Floats) -> tuple[Floats, Floats]:
        """A front's panel (its own columns) and update (over its border, at the beginning of ``workspace``) before elimination, in
        their lower triangles: its matrix entries and what its children left."""
        solver = self.solver
        own, border, rows = solver.sizes[number]
        panel = self.panels[solver.panel_start[number] : solver.panel_start[number + 1]]
        panel.fill(0.0)
        panel[solver.places[number]] = self.values[solver.values[number]]
        columns = panel.reshape(rows, own, order="F")
        update = workspace[: border * border]
        update.fill(0.0)
        update = update.reshape(border, border, order="F")
        for child in solver.elimination.children[number]:
            left = self.updates.pop(child)
            for in_panel, to, source in solver.elimination.additions[child]:
                part = columns[to] if in_panel else update[to]
                part += left[source]
            if child in self.lent:
                solver.memory.give(self.lent.pop(child))
        return columns, update

    def _cholesky(self, number: int, columns: Floats, update: Floats) -> bool:
        """Eliminate an assembled front; False where its leading rows are not positive definite."""
        solver = self.solver
        height, width = columns.shape[1], len(update)
        own = solver.elimination.sizes.ctypes.data + 12 * number
        border, rows = own + 4, own + 8
        kept = columns[:height].copy(order="F") if self.indefinite else None
        panel = self.panels.ctypes.data + 8 * solver.panel_start[number]
        routines = blas.unlocked if columns.size > _LARGE_PANEL else blas.locked
        routines.dpotrf(blas.LOWER, own, panel, rows, self.failed.ctypes.data + 4 * number)
        pivots = np.diagonal(columns)
        least = self.least[3 * solver.start[number] : 3 * solver.start[number + 1]]
        if self.failed[number] or not (pivots * pivots > least).all():
            if kept is not None:
                columns[:height] = kept
            return False
        if width:
            below = panel + 8 * height
            routines.dtrsm(
                blas.RIGHT, blas.LOWER, blas.TRANSPOSED, blas.NO, border, own, blas.ONE, panel, rows, below, rows
            )
            routines.dsyrk(
                blas.LOWER, blas.NO, border, own, blas.MINUS, below, rows, blas.ONE, update.ctypes.data, border
            )
        return True

    def _inverted(self, number: int, columns: Floats, update: Floats) -> bool:
        """Eliminate an assembled front whose leading rows are indefinite; False where they are singular, or that is not wanted."""
        if not self.indefinite:
            return False
        own = columns.shape[1]
        factor, order, failed = lapack.dsytrf(columns[:own], lower=1)
        if failed:
            return False
        inverse, _ = lapack.dsytrs(factor, order, np.eye(own), lower=1)
        below = columns[own:]
        coupling = below.copy()
        below[:] = coupling @ inverse
        update -= below @ coupling.T
        # A pair of rows shares a 2×2 pivot, marked by a negative entry in both; such a pivot has one eigenvalue of either sign.
        single = order > 0
        self.negative[number] = int((np.diagonal(factor)[single] < 0.0).sum()) + int((~single).sum()) // 2
        self.inverse[number] = inverse
        return True
