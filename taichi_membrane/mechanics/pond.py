"""A liquid of given volume V on one side of the surface: its level h follows the moving surface.

Over the wet part its volume is V(h, x) = -Σ ± (N·e) 1·M d, with M and the depths d of :mod:`.water`, and γ V = ∂W/∂h, so that its
weight has the potential γ h V - W(h, x), of which the level makes the most: it is concave in h, as ∂V/∂h is the plan area a that is
wet. To the tangent at a fixed level that adds κ g gᵀ with g = ∂f/∂h = γ ∂V/∂x and κ = 1/(γ a): as much liquid as there is gives
way to a deeper sag by a lower level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Water, sum_to_nodes
from taichi_membrane.mechanics.wet import depths, directed_areas, wet_matrices

# The level is found to this share of the volume, in at most so many steps: those of Newton, or halvings where these lead astray.
_CLOSE, _MOST = 1e-14, 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Pond:
    """A liquid of given volume.

    :param number: of its level among the values of all loads on the surface.
    :param one: what it wets; its weight per volume is ``weight``.
    :param volume: of the liquid.
    """

    number: int
    one: Water
    weight: float
    volume: float

    def level(self, displacement: Floats) -> float:
        """Height of its level above its floor; the lowest place's for none, infinite where nothing holds so much."""
        heights = -depths(self.one.mesh.points, self.one, 0.0, displacement)
        low, high = float(heights.min()), float(heights.max())
        if self.volume <= 0.0:
            return low
        # From where all is wet, beyond which the volume is linear, down: it is convex over a bowl.
        full, area = self._held(high, displacement)[0], 0.5 * float(self._plan(displacement).sum())
        if full < self.volume:
            if area <= 0.0:
                return float("inf")
            return high + (self.volume - full) / area
        level = high
        for _ in range(_MOST):
            held, area = self._held(level, displacement)
            beyond = held - self.volume
            if abs(beyond) <= _CLOSE * self.volume:
                break
            low, high = (low, level) if beyond > 0.0 else (level, high)
            aim = level - beyond / area if area > 0.0 else low
            following = aim if low < aim < high else 0.5 * (low + high)
            if following == level:
                break
            level = following
        return level

    def wet_area(self, level: float, displacement: Floats) -> float:
        """Plan area that is wet at a level."""
        return self._held(level, displacement)[1]

    def by_level(self, level: float, displacement: Floats) -> Floats:
        """(node_count, 3) ∂f/∂h, the change of its forces with the level."""
        one = self.one
        wet = wet_matrices(depths(one.mesh.points, one, level, displacement))
        share = one.weight[one.tri, None] * wet.sum(axis=2)
        corners = np.zeros((one.mesh.tri_count, 3, 3))
        corners[one.tri] = share[:, :, None] * directed_areas(one, displacement)[:, None, :]
        return sum_to_nodes(one.mesh, corners.reshape(-1, 3))

    def _plan(self, displacement: Floats) -> Floats:
        """Twice the plan area of its triangles, less than 0 of those that hang over."""
        return -(directed_areas(self.one, displacement) @ self.one.up) * self.one.weight[self.one.tri] / self.weight

    def _held(self, level: float, displacement: Floats) -> tuple[float, float]:
        """Volume over the wet part at a level, and its plan area."""
        one = self.one
        depth = depths(one.mesh.points, one, level, displacement)
        wet = wet_matrices(depth).sum(axis=2)
        plan = self._plan(displacement)
        return float(plan @ (wet * depth).sum(axis=1)), float(plan @ wet.sum(axis=1))
