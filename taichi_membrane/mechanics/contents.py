"""What fills chambers and sags of a system in a given amount: pressures and levels that follow the displacements."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.coupled import RankOne
from taichi_membrane.mechanics.gas import ShutChamber
from taichi_membrane.mechanics.pond import Pond
from taichi_membrane.mechanics.preparation import Floats, volume_gradient
from taichi_membrane.mechanics.system import System


class Contents:
    """Gases in shut chambers, and liquids of given volume."""

    def __init__(self, system: System, chambers: tuple[ShutChamber, ...], ponds: tuple[Pond, ...] = ()) -> None:
        self.system = system
        self.chambers = chambers
        self.ponds = ponds

    def settle(self) -> None:
        """Set the pressures and levels that belong to the system's present displacements."""
        values = self.system.surface_loads()
        for chamber, volume in zip(self.chambers, self.volumes(), strict=True):
            values[list(chamber.numbers)] = chamber.pressure_at(volume)
        if self.ponds:
            displacement = self.system.displacement()
            for pond in self.ponds:
                values[pond.number] = pond.level(displacement)
        self.system.set_surface_loads(values)

    def energy(self) -> tuple[float, float]:
        """What the potential energy lacks that takes the present pressures and levels for constant ones.

        And the size of the terms that it is the difference of, whose rounding it has.
        """
        values, total, size = self.system.surface_loads(), 0.0, 0.0
        for chamber, volume in zip(self.chambers, self.volumes(), strict=True):
            pressure = values[chamber.numbers[0]]
            total += pressure * (volume - chamber.rest_volume) - chamber.work(volume)
            size += (abs(pressure) + chamber.ambient) * (volume + chamber.rest_volume)
        for pond in self.ponds:
            held = pond.weight * values[pond.number] * pond.volume
            total, size = total + held, size + abs(held)
        return total, size

    def rank_one(self) -> list[RankOne]:
        """What they add to the tangent at constant pressures and levels."""
        displacement, values, terms = self.system.displacement(), self.system.surface_loads(), []
        for chamber, volume in zip(self.chambers, self.volumes(), strict=True):
            if chamber.resistance(volume) > 0.0:
                terms.append(RankOne(chamber.resistance(volume), self.volume_gradient(chamber)))
        for pond in self.ponds:
            area = pond.wet_area(values[pond.number], displacement)
            if pond.volume > 0.0 and area > 0.0:
                terms.append(RankOne(1.0 / (pond.weight * area), self.level_gradient(pond)))
        return terms

    def key(self) -> Floats:
        """What the tangent depends on beside displacements, pressures and levels."""
        amounts = [number for one in self.chambers for number in (one.amount, one.ambient)]
        return np.array([*amounts, *(pond.volume for pond in self.ponds)])

    def volumes(self) -> list[float]:
        """Present volume of each gas."""
        if not self.chambers:
            return []
        swept = self.system.swept_volumes(self.system.displacement())
        return [chamber.rest_volume + float(chamber.sign @ swept[chamber.triangles]) for chamber in self.chambers]

    def volume_gradient(self, chamber: ShutChamber) -> Floats:
        """(node_count, 3) ∂V/∂x in the supports' axes."""
        mesh = self.system.structure.mesh
        places = mesh.points + self.system.displacement()
        return self.system.in_frames(volume_gradient(places, mesh.cells[chamber.triangles], chamber.sign))

    def level_gradient(self, pond: Pond) -> Floats:
        """(node_count, 3) ∂f/∂h in the supports' axes."""
        level = float(self.system.surface_loads()[pond.number])
        return self.system.in_frames(pond.by_level(level, self.system.displacement()))
