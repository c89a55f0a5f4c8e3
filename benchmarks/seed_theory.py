"""Closed forms for the seed paper's tubes and arch: Timoshenko, Comer-Levy, thin arch, hinge mechanism. Needs only NumPy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A closed tube as a cantilever, or as half of a beam on two supports.

    :param length: of the cantilever, or half span [length].
    :param stiffness: E t [force per length].
    :param strap: length next to the root over which a centre load is spread on this half; 0 for a load at a point.
    """

    radius: float
    length: float
    stiffness: float
    poisson: float
    pressure: float
    strap: float = 0.0

    def inflated(self) -> Tube:
        """The tube with its dimensions under pressure, and E t per inflated width and length.

        Resultants per unstressed width: hoop p r λ_hoop λ_axial, axial p r λ_hoop²/2; strains are engineering strains.
        """
        hoop = axial = 1.0
        for _ in range(100):  # contracts by p r/(E t), at most 0.02 here, each time
            along = 0.5 * self.pressure * self.radius * hoop**2 / self.stiffness
            across = self.pressure * self.radius * hoop * axial / self.stiffness
            hoop, axial = 1.0 + across - self.poisson * along, 1.0 + along - self.poisson * across
        return replace(
            self,
            radius=self.radius * hoop,
            length=self.length * axial,
            strap=self.strap * axial,
            stiffness=self.stiffness * axial / hoop,
        )

    @property
    def collapse_moment(self) -> float:
        """π p r³: the section's whole tension stands at one generator. Wrinkling starts at half of it."""
        return math.pi * self.pressure * self.radius**3

    @property
    def collapse_force(self) -> float:
        """Force at the free end (half the centre load) that exhausts the root section; its lever ends in mid-strap."""
        return self.collapse_moment / (self.length - 0.5 * self.strap)

    def curvature(self, share: Floats) -> Floats:
        """Curvature at M = ``share`` · π p r³, share below 1, after Comer and Levy (AIAA J. 1 (1963) 1652).

        With half the slack arc θ and d = sin θ + (π - θ) cos θ: share = (2π - 2θ + sin 2θ)/(4 d), κ = π p/(2 d E t).
        """
        slack = np.linspace(0.0, math.pi - 0.02, 40_001)
        d = np.sin(slack) + (math.pi - slack) * np.cos(slack)
        moment = (2.0 * (math.pi - slack) + np.sin(2.0 * slack)) / (4.0 * d)
        wrinkled = np.interp(share, moment, math.pi / (2.0 * d))
        return np.where(share <= 0.5, share, wrinkled) * self.pressure / self.stiffness

    def deflection(self, force: float) -> float:
        """Deflection of the end: ∫ κ x dx, and shear over p π r² + G t π r (Fichter 1966; shear coefficient 1/2)."""
        x = self.length * np.linspace(0.0, 1.0, 4001)
        inside = np.maximum(x - (self.length - self.strap), 0.0)
        moment = force * (x - (0.5 * inside**2 / self.strap if self.strap else 0.0))
        bending = np.trapezoid(self.curvature(moment / self.collapse_moment) * x, x)
        shear = self.pressure * math.pi * self.radius**2 + math.pi * self.radius * self.stiffness / (
            2.0 * (1.0 + self.poisson)
        )
        return float(bending) + force * (self.length - 0.5 * self.strap) / shear


TABLE1 = Tube(radius=150.0, length=1500.0, stiffness=400.0, poisson=0.1, pressure=0.0169)
CANTILEVER = Tube(radius=25.0, length=400.0, stiffness=400.0, poisson=0.1, pressure=0.035)
BEAM = replace(CANTILEVER, length=200.0, strap=25.0)
ARCH_RADIUS, ARCH_TUBE = 6.0, Tube(radius=0.4, length=6.0, stiffness=5e5, poisson=0.3, pressure=1e4)


def arch_first_wrinkle(feet: str) -> float:
    """Crown load at which M + H r/2 = π p r³/2 at the crown of a thin, inextensible semicircular arch with thrust H there.

    Pinned: H = P/π, M = P R (1/2 - 1/π). Fixed: H = P (4 - π)/(π² - 8), M = P R/π - H R (1 - 2/π) (energy theorem).
    """
    thrust = 1.0 / math.pi if feet == "pinned" else (4.0 - math.pi) / (math.pi**2 - 8.0)
    moment = ARCH_RADIUS * (0.5 - thrust if feet == "pinned" else 1.0 / math.pi - thrust * (1.0 - 2.0 / math.pi))
    return 0.5 * ARCH_TUBE.collapse_moment / (moment + 0.5 * thrust * ARCH_TUBE.radius)


def arch_mechanism(feet: str) -> float:
    """Crown load of the hinge mechanism: |M| = (π p r² - thrust) r at crown and haunches, and at the feet where fixed."""
    big, r = ARCH_RADIUS, ARCH_TUBE.radius
    tension = ARCH_TUBE.collapse_moment / r
    if feet == "fixed":  # thrusts P/2 at crown and foot, P/√2 at the haunch
        return 2.0 * tension * r / ((big + r) / math.sqrt(2.0) - 0.5 * (big - r))

    def excess(load: float) -> float:
        crown = (0.5 * load * big - tension * r) / (big - r)
        haunch = (0.5 * load * big + tension * r) / (big + r)
        return 0.25 * load**2 + crown**2 - haunch**2

    low, high = 2.0 * tension * r / big, 16.0 * tension * r / big
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return low


def flattening(stiffness: float) -> float:
    """Bending stiffness of the arch's tube over π r³ E t when the section may flatten, against the pressure alone.

    Von Kármán's radial displacement a cos 2θ of a ring of constant perimeter moves a fibre by a cos³θ in the plane of bending, so
    strains it by a cos³θ/R, and takes 3π a²/2 of the area. Least energy over a: 1 - 9 λ/(10 λ + 48), λ = E t r/(p R²).
    """
    ratio = stiffness * ARCH_TUBE.radius / (ARCH_TUBE.pressure * ARCH_RADIUS**2)
    return 1.0 - 9.0 * ratio / (10.0 * ratio + 48.0)


def arch_flexibility(stiffness: float, bending_share: float = 1.0) -> float:
    """Crown deflection per crown load before wrinkling, pinned feet, E t = ``stiffness``: unit-load theorem on the thin arch.

    Per unit load at the angle φ from the crown, with c = cos φ and s = sin φ: M = R (1 - s)/2 - R c/π, N = c/π + s/2,
    V = c/2 - s/π; stiffnesses π r³ E t times ``bending_share``, 2 π r E t and p π r² + G t π r.
    """
    angle = np.linspace(0.0, 0.5 * math.pi, 2001)
    c, s = np.cos(angle), np.sin(angle)
    r, big = ARCH_TUBE.radius, ARCH_RADIUS
    moment, thrust, shear = big * (0.5 * (1.0 - s) - c / math.pi), c / math.pi + 0.5 * s, 0.5 * c - s / math.pi
    wall = math.pi * r * stiffness / (2.0 * (1.0 + ARCH_TUBE.poisson))
    energy = (
        moment**2 / (math.pi * r**3 * stiffness * bending_share)
        + thrust**2 / (2.0 * math.pi * r * stiffness)
        + shear**2 / (ARCH_TUBE.pressure * math.pi * r**2 + wall)
    )
    return float(2.0 * big * np.trapezoid(energy, angle))
