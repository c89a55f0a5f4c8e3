"""Follower pressure on triangles: what each chamber's pressure is, which chambers lie on either side of a triangle, and wind.

A triangle's pressure is p_behind - p_ahead, behind being the side that its normal points away from, and what winds add. It is a
load on the triangles and has no loop of its own: the triangles' loop has the sides at hand.
Where it has a potential, and where not: :mod:`taichi_membrane.mechanics.rim`.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import few, fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class Pressure:
    """The chambers' pressures, the chambers at each triangle, and the winds on it."""

    def __init__(self, structure: Structure, fp, dtype) -> None:
        self.fp, self.dtype = fp, dtype
        self.kind, self.windy = structure.features().pressure, structure.features().wind
        self.used = self.kind != "none" or self.windy
        if self.kind != "none":
            self.chamber_pressure = ti.field(fp, shape=few(structure.chamber_count))
        if self.kind == "by_chamber":
            self.tri_chamber = ti.field(ti.i32, shape=room(structure.mesh.tri_count))
        if self.kind == "by_side":
            self.tri_sides = ti.Vector.field(2, ti.i32, shape=room(structure.mesh.tri_count))  # behind, ahead

        if self.windy:
            self.tri_wind = ti.field(fp, shape=room(structure.mesh.tri_count))

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where it fits the nodes and triangles."""
        return self.kind == "none" or structure.chamber_count <= self.chamber_pressure.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's chambers."""
        self.chamber_count, self.wind = structure.chamber_count, structure.wind
        self.now: Floats | None = None
        self.set(np.zeros(structure.pressure_count))
        if self.kind == "by_chamber":
            fill(self.tri_chamber, structure.tri_chamber.astype(np.int32))
        if self.kind == "by_side":
            assert structure.tri_ahead is not None  # what makes it by_side
            fill(self.tri_sides, np.column_stack([structure.tri_chamber, structure.tri_ahead]).astype(np.int32))

    @ti.func
    def on(self, t):
        """Pressure on triangle ``t``, positive along its normal."""
        pressure = ti.cast(0.0, self.fp)
        if ti.static(self.kind == "uniform"):
            pressure = self.chamber_pressure[0]
        if ti.static(self.kind == "by_chamber"):
            chamber = self.tri_chamber[t]
            if chamber >= 0:
                pressure = self.chamber_pressure[chamber]
        if ti.static(self.kind == "by_side"):
            behind, ahead = self.tri_sides[t][0], self.tri_sides[t][1]
            if behind >= 0:
                pressure = self.chamber_pressure[behind]
            if ahead >= 0:
                pressure -= self.chamber_pressure[ahead]
        if ti.static(self.windy):
            pressure += self.tri_wind[t]
        return pressure

    def set(self, values: Floats) -> None:
        """Set each chamber's pressure (force per area) and, after them, each wind's value."""
        if self.now is not None and np.array_equal(values, self.now):
            return
        self.now = np.array(values)
        if self.kind != "none":
            fill(self.chamber_pressure, self.now[: self.chamber_count].astype(self.dtype))
        if self.wind is not None:
            fill(self.tri_wind, (self.wind @ self.now[self.chamber_count :]).astype(self.dtype))

    def values(self) -> Floats:
        """(pressure_count,) present pressures, and values of winds."""
        assert self.now is not None  # since upload
        return self.now.copy()
