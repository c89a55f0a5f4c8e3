"""Gas in shut chambers, which keeps p_abs Vⁿ, so that their pressure follows the volume.

Its amount is the volume A that it would have at a reference pressure: p_abs = p_ref (A/V)ⁿ. To the tangent each gas adds a dense
but rank-one term κ b bᵀ, κ = n p_abs/V, b = ∂V/∂x: it resists a change of volume. A relief valve holds the pressure at p_r where
the gas would have more, in volumes below A (p_ref/(p_r + p_out))^(1/n): there κ is zero, and an equilibrium leaves behind the
amount that fills the volume at p_r.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.algebra.refinement import SINGULAR, USELESS, refined
from taichi_membrane.mechanics.preparation import Floats, Ints

# A valve counts as open from this share of its volume on: a state that it has left is at the border, up to rounding.
_OPEN = 1e-9


@dataclass(frozen=True, kw_only=True)
class ShutChamber:
    """Chambers whose valve is shut and that one gas fills: one, or several that tubes join.

    :param numbers: of their pressures among the system's.
    :param triangles: numbers of the triangles that enclose them; ``sign`` (k,) 1 where their normals point out of it, else -1.
    :param rest_volume: volume they enclose at rest.
    :param reference: absolute pressure at which amounts are told.
    :param exponent: n; 1 for constant temperature.
    :param relief: pressure above that outside at which gas is let out; infinite for no such valve.
    :param amount: volume of the gas at the reference pressure.
    :param ambient: absolute pressure outside.
    """

    numbers: tuple[int, ...]
    triangles: Ints
    sign: Ints
    rest_volume: float
    reference: float
    exponent: float
    amount: float
    ambient: float
    relief: float = float("inf")

    def pressure_at(self, volume: float) -> float:
        """Pressure above ambient; infinite where nothing is left of the volume and nothing is let out."""
        return min(self.relief, self._unrelieved(volume))

    def _unrelieved(self, volume: float) -> float:
        """Pressure without a relief valve."""
        if volume <= 0.0:
            return float("inf")
        return self.reference * (self.amount / volume) ** self.exponent - self.ambient

    @property
    def opening(self) -> float:
        """Volume below which the relief valve is open; 0 without one."""
        return self.amount * (self.reference / (self.relief + self.ambient)) ** (1.0 / self.exponent)

    def is_open(self, volume: float) -> bool:
        """Whether the relief valve lets gas out when the volume falls."""
        return volume <= self.opening * (1.0 + _OPEN)

    def left(self, volume: float) -> float:
        """Amount that an equilibrium at a volume leaves in the chamber."""
        if volume >= self.opening:
            return self.amount
        return volume * ((self.relief + self.ambient) / self.reference) ** (1.0 / self.exponent)

    def resistance(self, volume: float) -> float:
        """-dp/dV; 0 where the relief valve is open."""
        if self.is_open(volume):
            return 0.0
        return self.exponent * (self.pressure_at(volume) + self.ambient) / volume

    def by_amount(self, volume: float) -> float:
        """∂p/∂A at a fixed volume."""
        if self.is_open(volume):
            return 0.0
        return self.exponent * (self.pressure_at(volume) + self.ambient) / self.amount

    def work(self, volume: float) -> float:
        """Work of the gas, that let out included, and of the ambient pressure since the volume was the amount, ∫ p dV."""
        if volume < self.opening:
            return self.work(self.opening) - self.relief * (self.opening - volume)
        if volume <= 0.0:
            return float("-inf")
        n, ratio = self.exponent, volume / self.amount
        done = np.log(ratio) if n == 1.0 else (ratio ** (1.0 - n) - 1.0) / (1.0 - n)
        return float(self.reference * self.amount * done - self.ambient * (volume - self.amount))


def amount_of(pressure: float, volume: float, *, ambient: float, reference: float, exponent: float) -> float:
    """Amount of a gas: the volume that it has at the reference pressure.

    :param pressure: above ambient, at a volume.
    """
    return max(volume, 0.0) * (max(pressure + ambient, 0.0) / reference) ** (1.0 / exponent)


@dataclass(frozen=True, eq=False)
class CoupledFactor:
    """A factorised matrix with rank-one terms added, by the formula of Sherman, Morrison and Woodbury.

    :param negative: number of negative eigenvalues of the sum.
    """

    factor: Factor
    gradients: list[Floats]
    resistance: list[float]
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
        return self.factor.times(vector) + self._gas_times(vector)

    def residual(self, solution: Floats, right: Floats) -> float:
        """Backward error of a solution, in largest components, over the size of the matrix without the gas."""
        return self.factor.residual(solution, right - self._gas_times(solution))

    def _gas_times(self, vector: Floats) -> Floats:
        parts = zip(self.resistance, self.gradients, strict=True)
        return np.asarray(sum(stiffness * np.vdot(gradient, vector) * gradient for stiffness, gradient in parts))


def coupled(factor: Factor, gradients: list[Floats], resistance: list[float]) -> Factor | None:
    """A factorised matrix with terms κ b bᵀ, κ > 0, added; None where it is singular.

    :param gradients: b of each, (n, 3), zero at held components.
    :param resistance: κ of each.
    """
    if not resistance:
        return factor
    softened = [factor.solve(gradient) for gradient in gradients]
    if not np.isfinite(softened).all():
        return None
    inner = np.diag(1.0 / np.array(resistance))
    inner += np.array([[np.vdot(a, b) for b in softened] for a in gradients])
    # Sylvester's law on the bordered matrix, whose inertia can be read both ways.
    negative = factor.negative + int((np.linalg.eigvalsh(inner) > 0.0).sum()) - len(resistance)
    return CoupledFactor(factor, gradients, resistance, softened, inner, negative)
