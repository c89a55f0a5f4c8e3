"""What solvers of linear systems have to offer: Newton is handed one and knows no more of it than this."""

from __future__ import annotations

from typing import Protocol

from taichi_membrane.algebra.elimination import Elimination, eliminate
from taichi_membrane.algebra.multifrontal import Multifrontal
from taichi_membrane.algebra.refinement import USELESS
from taichi_membrane.arrays import Floats, Ints


class Factor(Protocol):
    """A factorised matrix. Vectors are (node_count, 3), by nodes."""

    @property
    def negative(self) -> int:
        """Number of negative eigenvalues; where the matrix is not symmetric of real ones, as far as they are found."""

    @property
    def doubt(self) -> str:
        """What no negative eigenvalue leaves open of stability; empty where it means that the structure is stable."""

    @property
    def refusal(self) -> str:
        """Why the last solution that is not a number was refused."""

    def solve(self, right: Floats, within: float = USELESS) -> Floats:
        """x with K x = ``right``; not a number where more than ``within`` of it is left, see :mod:`.refinement`."""

    def solve_transposed(self, right: Floats, within: float = USELESS) -> Floats:
        """x with Kᵀ x = ``right``, likewise."""

    def substituted(self, right: Floats) -> Floats:
        """What the factor makes of ``right``, unproved: for products of many, and for directions of matrices near singular."""

    def times(self, vector: Floats) -> Floats:
        """K times a vector."""

    def residual(self, solution: Floats, right: Floats) -> float:
        """Backward error |b - K x|/(|K| |x| + |b|) of a solution, in largest components: round-off where it is right."""


class LinearSolver(Protocol):
    """Factorises matrices of one pattern."""

    def factorise(self, blocks: Floats, diagonal: Floats | None = None, *, indefinite: bool = False) -> Factor | None:
        """Factorise a matrix; None where it is singular in double precision, or indefinite and that is not asked for."""


class Algebra(Protocol):
    """A way to solve linear systems of 3×3 blocks."""

    def order(self, points: Floats, edges: Ints) -> Elimination:
        """Where the blocks of nodes at ``points`` (n, 3), coupled by ``edges`` (m, 2), go."""

    def solver(self, pattern: Elimination, threads: int) -> LinearSolver:
        """A solver for matrices of a pattern."""


class Direct:
    """Our multifrontal factorisation."""

    def order(self, points: Floats, edges: Ints) -> Elimination:
        """Nested dissection."""
        return eliminate(points, edges)

    def solver(self, pattern: Elimination, threads: int) -> LinearSolver:
        """A multifrontal solver."""
        return Multifrontal(pattern, threads)


DIRECT = Direct()
