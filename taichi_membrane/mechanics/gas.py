"""Closed chambers: the gas in them keeps p_abs Vⁿ, so that their pressure follows the volume.

To the tangent each chamber adds a dense but rank-one term κ b bᵀ, κ = n p_abs/V, b = ∂V/∂x: the gas resists a change of volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.coupled import RankOne
from taichi_membrane.mechanics.preparation import Floats, Ints, volume_gradient
from taichi_membrane.mechanics.system import System


@dataclass(frozen=True, kw_only=True)
class ShutChamber:
    """A chamber whose valve is shut.

    :param number: number of its pressure among the system's.
    :param triangles: numbers of the triangles that enclose it; ``sign`` (k,) 1 where their normals point out of it, else -1.
    :param rest_volume: volume they enclose at rest.
    :param ambient: absolute pressure outside.
    :param exponent: n; 1 for constant temperature.
    :param volume: volume when the valve was shut, ``pressure`` the pressure above ambient then.
    """

    number: int
    triangles: Ints
    sign: Ints
    rest_volume: float
    ambient: float
    exponent: float
    volume: float
    pressure: float

    def pressure_at(self, volume: float) -> float:
        """Pressure above ambient; infinite where nothing is left of the volume."""
        if volume <= 0.0:
            return float("inf")
        return (self.pressure + self.ambient) * (self.volume / volume) ** self.exponent - self.ambient

    def resistance(self, volume: float) -> float:
        """-dp/dV."""
        return self.exponent * (self.pressure_at(volume) + self.ambient) / volume

    def work(self, volume: float) -> float:
        """Work that the gas and the ambient pressure have done since the valve was shut, ∫ p dV."""
        if volume <= 0.0:
            return float("-inf")
        n, absolute, ratio = self.exponent, self.pressure + self.ambient, volume / self.volume
        done = np.log(ratio) if n == 1.0 else (ratio ** (1.0 - n) - 1.0) / (1.0 - n)
        return float(absolute * self.volume * done - self.ambient * (volume - self.volume))


class Gas:
    """The closed chambers of a system."""

    def __init__(self, system: System, chambers: tuple[ShutChamber, ...]) -> None:
        self.system = system
        self.chambers = chambers

    def settle(self) -> None:
        """Set the pressures that belong to the system's present volumes."""
        pressures = self.system.surface_loads()
        for chamber, volume in zip(self.chambers, self._volumes(), strict=True):
            pressures[chamber.number] = chamber.pressure_at(volume)
        self.system.set_surface_loads(pressures)

    def energy(self) -> float:
        """What the potential energy lacks that takes the present pressures for constant ones."""
        pressures, total = self.system.surface_loads(), 0.0
        for chamber, volume in zip(self.chambers, self._volumes(), strict=True):
            total += pressures[chamber.number] * (volume - chamber.rest_volume) - chamber.work(volume)
        return total

    def rank_one(self) -> list[RankOne]:
        """What each chamber adds to the tangent at constant pressures."""
        pairs = zip(self.chambers, self._volumes(), strict=True)
        return [RankOne(chamber.resistance(volume), self._gradient(chamber)) for chamber, volume in pairs]

    def _volumes(self) -> list[float]:
        swept = self.system.swept_volumes(self.system.displacement())
        return [chamber.rest_volume + float(chamber.sign @ swept[chamber.triangles]) for chamber in self.chambers]

    def _gradient(self, chamber: ShutChamber) -> Floats:
        """(node_count, 3) ∂V/∂x in the supports' axes."""
        mesh = self.system.structure.mesh
        places = mesh.points + self.system.displacement()
        return self.system.in_frames(volume_gradient(places, mesh.triangles[chamber.triangles], chamber.sign))
