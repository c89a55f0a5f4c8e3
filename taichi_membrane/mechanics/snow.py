"""Load per plan area, such as snow: along one direction g, s on each unit of area seen along it, of triangles that face it.

A triangle with the directed double area N = s₁ × s₂ has twice the plan area P = <-N·g>, zero where it has turned over; each of its
corners bears s/6 P g. P depends on moves across g while the force is along it, so that there is no potential, not even on a closed
surface:

    -∂f_m/∂x_n = s/6 g ⊗ w_n,  w_n = g × s_n,  s_n the side opposite corner n.

Kernels assemble the symmetric part s/12 (g ⊗ w_n + w_m ⊗ g); the skew one is :class:`.snow_skew.SnowSkew`, a part of what
:mod:`taichi_membrane.mechanics.rim` adds to the factor. The force has a kink where a triangle turns over.
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class Snow:
    """Load per plan area on each triangle."""

    def __init__(self, structure: Structure, fp, dtype) -> None:
        self.fp, self.dtype, self.used = fp, dtype, structure.features().snow
        if self.used:
            self.tri_snow = ti.field(fp, shape=room(structure.mesh.tri_count))
            self.snow_direction = ti.Vector.field(3, fp, shape=1)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits, where its triangles do."""
        return True

    def upload(self, structure: Structure) -> None:
        """Take over a structure's loads, with nothing lying there."""
        self.loads = structure.snow
        self.now: Floats | None = None
        if self.loads is not None:
            fill(self.snow_direction, self.loads.direction[None].astype(self.dtype))
            self.set(np.zeros(self.loads.share.shape[1]))

    def set(self, values: Floats) -> None:
        """Set each load's value (force per plan area)."""
        if self.loads is None or (self.now is not None and np.array_equal(values, self.now)):
            return
        self.now = np.array(values)
        fill(self.tri_snow, (self.loads.share @ self.now).astype(self.dtype))

    def values(self) -> Floats:
        """Present values."""
        return np.zeros(0) if self.now is None else self.now

    @ti.func
    def bound(self, t):
        """What to add to the size of a triangle's pressure in the bound of its sides' stiffness: 4 s gives s l/3 at each side."""
        return 4.0 * ti.abs(self.tri_snow[t])

    @ti.func
    def corner_force(self, t, side_1, side_2):
        """Force on each of the three corners of triangle ``t``."""
        down = self.snow_direction[0]
        plan = ti.max(-side_1.cross(side_2).dot(down), ti.cast(0.0, self.fp))
        return self.tri_snow[t] / 6.0 * plan * down

    @ti.func
    def stiffness(self, t, side_m, side_n, side_1, side_2):
        """Symmetric part of -∂f_m/∂x_n of triangle ``t``, for two corners, the same or not, and their opposite sides."""
        down = self.snow_direction[0]
        size = self.tri_snow[t] / 12.0
        if side_1.cross(side_2).dot(down) >= 0.0:
            size *= 0.0
        return size * (down.outer_product(down.cross(side_n)) + down.cross(side_m).outer_product(down))
