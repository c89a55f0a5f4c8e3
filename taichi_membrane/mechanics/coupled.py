"""Terms of the tangent that couple many nodes at once: κ b bᵀ, dense but of rank one, added to the sparse factor.

Shut chambers (:mod:`gas`) have one each, b = ∂V/∂x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.algebra.refinement import SINGULAR, USELESS, refined
from taichi_membrane.mechanics.preparation import Floats


@dataclass(frozen=True, eq=False)
class RankOne:
    """A term κ b bᵀ.

    :param stiffness: κ, of either sign but not zero.
    :param gradient: b, (node_count, 3) in the axes that supports refer to.
    """

    stiffness: float
    gradient: Floats


def coupled(factor: Factor, terms: Sequence[RankOne], free: NDArray[np.bool_]) -> Factor | None:
    """A factorised matrix with terms of rank one added; None where their sum is singular.

    :param free: (node_count, 3) components that are not held; the others have no part in the terms.
    """
    if not terms:
        return factor
    gradients = [np.where(free, term.gradient, 0.0) for term in terms]
    stiffness = np.array([term.stiffness for term in terms])
    softened = [factor.solve(gradient) for gradient in gradients]
    if not np.isfinite(softened).all():
        return None
    inner = np.diag(1.0 / stiffness)
    inner += np.array([[np.vdot(a, b) for b in softened] for a in gradients])
    # Sylvester's law on the bordered matrix [[K, B], [Bᵀ, -1/κ]], whose inertia can be read both ways.
    against = int((np.linalg.eigvalsh(0.5 * (inner + inner.T)) > 0.0).sum())
    negative = factor.negative + against - int((stiffness > 0.0).sum())
    return CoupledFactor(factor, gradients, stiffness.tolist(), softened, inner, negative)


@dataclass(frozen=True, eq=False)
class CoupledFactor:
    """A factorised matrix with rank-one terms added, by the formula of Sherman, Morrison and Woodbury.

    :param negative: number of negative eigenvalues of the sum.
    """

    factor: Factor
    gradients: list[Floats]
    stiffness: list[float]
    softened: list[Floats]
    inner: Floats
    negative: int
    doubt: ClassVar[str] = ""
    refusal: ClassVar[str] = SINGULAR

    def solve(self, right: Floats, within: float = USELESS) -> Floats:
        """Solution (n, 3) for a right-hand side (n, 3), by nodes; not a number where more than ``within`` of that is left."""
        return refined(self.substituted, self.times, right, within)

    def solve_transposed(self, right: Floats, within: float = USELESS) -> Floats:
        """The same: the matrix is symmetric."""
        return self.solve(right, within)

    def substituted(self, right: Floats) -> Floats:
        """Solution by the formula."""
        solution = self.factor.substituted(right)
        shares = np.linalg.solve(self.inner, [np.vdot(gradient, solution) for gradient in self.gradients])
        for share, softened in zip(shares, self.softened, strict=True):
            solution = solution - share * softened
        return solution

    def times(self, vector: Floats) -> Floats:
        """The sum times a vector (n, 3)."""
        return self.factor.times(vector) + self._terms_times(vector)

    def residual(self, solution: Floats, right: Floats) -> float:
        """Backward error of a solution, in largest components, over the size of the matrix without the terms."""
        return self.factor.residual(solution, right - self._terms_times(solution))

    def _terms_times(self, vector: Floats) -> Floats:
        parts = zip(self.stiffness, self.gradients, strict=True)
        return np.asarray(sum(stiffness * np.vdot(gradient, vector) * gradient for stiffness, gradient in parts))
