"""Exact solutions of problems with rotational symmetry, from ordinary differential equations and shooting.

Stress resultants are those of a tension field: St Venant-Kirchhoff (second Piola-Kirchhoff resultants linear in Green's strain)
while both principal values are tensile, otherwise uniaxial. Lengths and resultants are made dimensionless by the radius and by E t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, optimize

Floats = NDArray[np.float64]
TOLERANCE = 1e-11  # of the integration; the shooting then fixes eight digits and more


@dataclass(frozen=True, kw_only=True)
class InflatedDisc:
    """A flat disc of unit radius after inflation, all relative to radius and E t.

    :param rise: height of the pole above the rim plane. :param rim: radius of the deformed rim. :param volume: under the disc.
    :param pole_resultant: second Piola-Kirchhoff resultant at the pole.
    :param radius: deformed radii (n,) and ``height`` (n,) of the meridian, from the pole to the rim.
    """

    rise: float
    rim: float
    volume: float
    pole_resultant: float
    radius: Floats
    height: Floats


def inflated_disc(load: float, nu: float, *, rim: Literal["held", "seam"]) -> InflatedDisc:
    """Flat disc under follower pressure ``load`` = p a/(E t), its rim held or, for the half of two seamed discs, free to slide.

    With R the radius at rest, r the deformed one and S₁, S₂ the resultants along and around: vertical equilibrium gives
    R S₁ λ₁ sin β = p r²/2, horizontal equilibrium (R S₁ λ₁ cos β)' = λ₂ S₂ - p r λ₁ sin β. The pole's stretch is shot at the rim.
    """
    start = 1e-6

    def meridian(pole: float) -> tuple[Floats, Floats]:
        tension = (pole**2 - 1.0) / (2.0 * (1.0 - nu))

        def slope(radius: float, state: Floats) -> list[float]:
            r, _, pull, _ = state
            lift = 0.5 * load * r * r
            force = np.hypot(pull, lift)
            along, hoop_stress = _stretch_along(force / radius, r / radius, nu)
            cosine, sine = pull / force, lift / force
            fall = along * sine
            return [along * cosine, -fall, r / radius * hoop_stress - load * r * fall, np.pi * r * r * fall]

        first = [pole * start, 0.0, tension * pole * start, 0.0]
        found = integrate.solve_ivp(slope, (start, 1.0), first, method="DOP853", rtol=TOLERANCE, atol=1e-14)
        return found.t, found.y

    def miss(pole: float) -> float:
        end = meridian(pole)[1][:, -1]
        return float(end[0] - 1.0 if rim == "held" else end[2])

    # From above: far below the answer the meridian curls up and the miss changes sign again.
    high = 2.0 * load ** (2.0 / 3.0)
    while miss(1.0 + 0.7 * high) > 0.0:
        high *= 0.7
    pole = optimize.brentq(miss, 1.0 + 0.7 * high, 1.0 + high, xtol=1e-15, rtol=1e-14)
    _, state = meridian(pole)
    radius, height, _, volume = state
    return InflatedDisc(
        rise=float(-height[-1]),
        rim=float(radius[-1]),
        volume=float(volume[-1]),
        pole_resultant=(pole**2 - 1.0) / (2.0 * (1.0 - nu)),
        radius=radius,
        height=height - height[-1],
    )


@dataclass(frozen=True, kw_only=True)
class PressedSphere:
    """A sphere of unit radius, blown up and pressed between plates, relative to radius and E t.

    :param force: of a plate. :param contact: radius of the contact. :param radius: at the equator. :param volume: inside.
    """

    force: float
    contact: float
    radius: float
    volume: float


def pressed_between(load: float, nu: float, gap: float) -> PressedSphere:
    """Sphere under pressure ``load`` = p R/(E t) between frictionless plates at a distance ``gap``; it has to stay taut.

    With S the arc from the pole at rest, r₀ = sin S, r the deformed radius and a that of the contact: vertical equilibrium gives
    r₀ S₁ λ₁ sin β = p (r² - a²)/2, where the slope β is zero in contact, horizontal equilibrium
    (r₀ S₁ λ₁ cos β)' = λ₂ S₂ - p r λ₁ sin β. The pole's stretch is shot at β = π/2 on the equator, the end of contact at the gap.
    """
    start = 1e-6

    def meridian(pole: float, end: float) -> Floats:
        tension = (pole**2 - 1.0) / (2.0 * (1.0 - nu))

        def along(first: float, last: float, state: Floats, inner: float | None) -> Floats:
            def slope(arc: float, state: Floats) -> list[float]:
                r, pull, _, _ = state
                rest, lift = np.sin(arc), 0.0 if inner is None else 0.5 * load * (r * r - inner * inner)
                force = float(np.hypot(pull, lift))
                stretch, hoop = _stretch_along(force / rest, r / rest, nu)
                fall = stretch * lift / force
                return [stretch * pull / force, r / rest * hoop - load * r * fall, fall, np.pi * r * r * fall]

            return integrate.solve_ivp(slope, (first, last), state, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]

        state = along(start, end, np.array([pole * start, tension * pole * start, 0.0, 0.0]), None)
        inner = float(state[0])
        return np.append(along(end, 0.5 * np.pi, state, inner), inner)

    pole = 0.5 * load * (1.0 - nu) + float(np.hypot(0.5 * load * (1.0 - nu), 1.0))  # of the free sphere

    def pressed(end: float) -> Floats:
        """With the root that is nearest to the pole's stretch that was found last: others are no spheres."""
        nonlocal pole
        reach, off = 1e-4, [meridian(pole, end)[1]] * 2
        while off[0] * off[1] > 0.0:
            reach *= 2.0
            off = [meridian(pole + sign * reach, end)[1] for sign in (-1.0, 1.0)]
        pole = float(optimize.brentq(lambda one: meridian(one, end)[1], pole - reach, pole + reach, xtol=1e-12))
        return meridian(pole, end)

    low, high = 0.0, 0.1
    while pressed(high)[2] > 0.5 * gap:
        low, high = high, high + 0.1
    end = float(optimize.brentq(lambda one: pressed(one)[2] - 0.5 * gap, max(low, 1e-3), high, xtol=1e-9))
    radius, _, _, volume, inner = pressed(end)
    return PressedSphere(
        force=float(np.pi * load * inner**2), contact=float(inner), radius=float(radius), volume=2.0 * float(volume)
    )


def _stretch_along(pull: float, around: float, nu: float) -> tuple[float, float]:
    """Stretch λ₁ with λ₁ S₁ = ``pull`` at hoop stretch ``around``, and the hoop resultant S₂ (zero where wrinkled); E t = 1."""
    hoop = 0.5 * (around**2 - 1.0)
    wrinkled = _cubic_root(0.5, -0.5, pull)
    if hoop + nu * 0.5 * (wrinkled**2 - 1.0) <= 0.0:
        return wrinkled, 0.0
    stiff = 1.0 / (1.0 - nu**2)
    along = _cubic_root(0.5 * stiff, stiff * (nu * hoop - 0.5), pull)
    return along, stiff * (hoop + nu * 0.5 * (along**2 - 1.0))


def _cubic_root(cubic: float, linear: float, value: float) -> float:
    """The root above 1/2 of cubic x³ + linear x = value, by Newton from above."""
    x = max(2.0, (2.0 * value / cubic) ** (1.0 / 3.0) + 1.0)
    for _ in range(100):
        step = (cubic * x**3 + linear * x - value) / (3.0 * cubic * x**2 + linear)
        x -= step
        if abs(step) < 1e-15 * x:
            break
    return x


def turned_hub(angles: Sequence[float], outer: float, nu: float) -> list[float]:
    """Torque over 2π N₀ a² on the hub of an annulus with prestress N₀ both ways and a fixed rim (radius ``outer``), small strains.

    Lengths over the hub's radius a, resultants over N₀, strains and ``angles``, which rise, over N₀/(E t). Moment equilibrium gives
    N_rt = m/r², radial equilibrium (r N_r)' = N_t. Where taut, N_t = ν N_r + e_t; where that makes N_r N_t < N_rt², the stress is
    uniaxial, N_t = N_rt²/N_r, and the strain across the rays follows from e_t. Both displacements of the rim are shot to zero
    (the problem of Stein and Hedgepeth 1961, with a rim at a finite distance).
    """
    rest = 1.0 - nu  # the strain of the prestress

    def local(r: float, u: float, radial: float, shear: float) -> tuple[float, float, float]:
        """Radial strain, shear strain and hoop resultant."""
        around = rest + u / r
        hoop = nu * radial + around
        if radial * hoop >= shear**2:
            return radial - nu * hoop - rest, 2.0 * (1.0 + nu) * shear, hoop
        hoop = shear**2 / radial
        along = radial + hoop
        cosine2, sine2 = radial / along, hoop / along
        across = (around - along * sine2) / cosine2
        return along * cosine2 + across * sine2 - rest, 2.0 * (along - across) * shear / along, hoop

    def slope(r: float, state: Floats, m: float) -> list[float]:
        u, pull, _ = state
        radial, gamma, hoop = local(r, u, pull / r, m / r**2)
        return [radial, hoop, gamma / r]

    def miss(unknown: Floats, angle: float) -> list[float]:
        pull, m = unknown
        found = integrate.solve_ivp(
            slope, (1.0, outer), [0.0, pull, -angle], args=(m,), method="DOP853", rtol=1e-9, atol=1e-11, max_step=0.2
        )
        return [float(found.y[0, -1]), float(found.y[2, -1])]

    torques = []
    solution = np.array([1.0, 1.0])
    for angle in angles:
        solution = optimize.fsolve(miss, solution, args=(angle,), xtol=1e-10)
        torques.append(float(solution[1]))
    return torques
