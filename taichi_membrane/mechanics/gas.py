"""Gas in shut chambers, which keeps p_abs Vⁿ, so that their pressure follows the volume.

Its amount is the volume A that it would have at a reference pressure: p_abs = p_ref (A/V)ⁿ. To the tangent each gas adds a dense
but rank-one term κ b bᵀ, κ = n p_abs/V, b = ∂V/∂x: it resists a change of volume. A relief valve holds the pressure at p_r where
the gas would have more, in volumes below A (p_ref/(p_r + p_out))^(1/n): there κ is zero, and an equilibrium leaves behind the
amount that fills the volume at p_r.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Ints

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
