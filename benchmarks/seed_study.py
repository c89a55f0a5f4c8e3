"""closed forms draft"""
from __future__ import annotations
import math
from dataclasses import dataclass
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tube:
    radius: float
    length: float
    stiffness: float
    poisson: float
    pressure: float

    def inflated(self) -> Tube:
        """Closed tube after inflation"""
        hoop = axial = 1.0
        for _ in range(50):
            n_hoop = self.pressure * self.radius * hoop * axial / self.stiffness
            n_axial = 0.5 * self.pressure * self.radius * hoop * hoop / self.stiffness
            hoop, axial = 1.0 + n_hoop - self.poisson * n_axial, 1.0 + n_axial - self.poisson * n_hoop
        return Tube(radius=self.radius * hoop, length=self.length * axial, stiffness=self.stiffness * axial / hoop,
                    poisson=self.poisson, pressure=self.pressure)

    @property
    def collapse_moment(self) -> float:
        return math.pi * self.pressure * self.radius**3

    def curvature(self, share: Floats) -> Floats:
        """Comer-Levy curvature at moments M / collapse moment."""
        theta = np.linspace(0.0, math.pi - 0.02, 40001)
        rest = np.sin(theta) + (math.pi - theta) * np.cos(theta)
        moment = (2 * (math.pi - theta) + np.sin(2 * theta)) / (4 * rest)
        bent = np.interp(share, moment, math.pi / (2 * rest))
        return np.where(share <= 0.5, share, bent) * self.pressure / self.stiffness

    def deflection(self, force: float) -> float:
        """cantilever tip"""
        share = force * self.length / self.collapse_moment
        x = self.length * np.linspace(0.0, 1.0, 4001)
        bending = np.trapezoid(self.curvature(share * x / self.length) * x, x)
        wall = math.pi * self.radius * self.stiffness / (2 * (1 + self.poisson))
        return float(bending) + force * self.length / (self.pressure * math.pi * self.radius**2 + wall)
