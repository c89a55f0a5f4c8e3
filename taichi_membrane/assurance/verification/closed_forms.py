"""Closed forms of structural mechanics that the cases are compared with.

Resultants are forces per width. "SVK" is St Venant-Kirchhoff: second Piola-Kirchhoff resultants linear in Green's strain.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, optimize, special


def sphere_stretch(pressure: float, radius: float, stiffness: float, nu: float) -> float:
    """Stretch of an inflated SVK sphere, ``stiffness`` = E t: p R = E t (λ - 1/λ)/(1 - ν), from S = p r/2 with r = λ R."""
    half = 0.5 * pressure * radius * (1.0 - nu) / stiffness
    return half + math.hypot(half, 1.0)


def balloon_pressure(stretch: float, nu: float) -> float:
    """Pressure over E t/R of a sphere that is linear by engineering strain: N = E t (λ - 1)/((1 - ν) λ) and p = 2 N/(R λ)."""
    return 2.0 * (stretch - 1.0) / ((1.0 - nu) * stretch**2)


def strip_pond(weight: float, volume: float) -> tuple[float, float]:
    """Level above the ends, and sag of the middle, of a taut strip of span 1 and tension 1 under a volume of liquid per width.

    T d'' = -γ d of the depth d, k² = γ/T. Up to k = π it is wet all over, as if walls stood at its ends: d = h cos(k x)/cos(k/2)
    from the middle, V = 2 h tan(k/2)/k. Beyond, the pond is π/k wide, d = D cos(k x), V = 2 D/k, and the strip straight beside it.
    """
    k = math.sqrt(weight)
    if k < math.pi:
        level = 0.5 * volume * k / math.tan(0.5 * k)
        return level, level / math.cos(0.5 * k) - level
    level = -0.25 * volume * k**2 * (1.0 - math.pi / k)
    return level, 0.5 * volume * k - level


def filled_tube(head: float) -> tuple[float, float, float]:
    """Height, tension and contact width of a weightless inextensible tube of perimeter 1 on a plane, full of a liquid, γ = 1.

    With y the depth below the level and θ the slope from the crown, T dθ/ds = γ y: y² = y₀² + 2 T (1 - cos θ)/γ. At the ground
    θ = π and y₁ = y₀ + H, so that T = γ H (2 y₀ + H)/4; half the contact width closes the section, x(π) = b/2.

    :param head: y₀/H, of the level above the crown.
    """
    tension = 0.25 * (2.0 * head + 1.0)  # at a height of 1

    def arc(angle: float) -> float:
        return tension / math.sqrt(head**2 + 2.0 * tension * (1.0 - math.cos(angle)))

    side = integrate.quad(arc, 0.0, math.pi)[0]
    width = 2.0 * integrate.quad(lambda angle: arc(angle) * math.cos(angle), 0.0, math.pi)[0]
    perimeter = 2.0 * side + width
    return 1.0 / perimeter, tension / perimeter**2, width / perimeter


def cylinder_stretches(pressure: float, radius: float, stiffness: float, nu: float) -> tuple[float, float]:
    """Hoop and axial stretch of an inflated SVK cylinder with closed ends: S_t = p R λ_x, λ_x S_x = p R λ_t²/2.

    These are N_t = p r and N_x = p r/2 of the deformed cylinder, written per width at rest.
    """

    def miss(stretch: NDArray[np.float64], /) -> list[float]:
        hoop, axial = stretch
        hoop_strain, axial_strain = 0.5 * (hoop**2 - 1.0), 0.5 * (axial**2 - 1.0)
        stiff = stiffness / (1.0 - nu**2)
        return [
            stiff * (hoop_strain + nu * axial_strain) / (pressure * radius) - axial,
            axial * stiff * (axial_strain + nu * hoop_strain) / (pressure * radius) - 0.5 * hoop**2,
        ]

    hoop, axial = optimize.fsolve(miss, (1.0, 1.0), xtol=1e-13)
    return float(hoop), float(axial)


def hencky_series(nu: float, terms: int = 60) -> list[float]:
    """Coefficients b₀, b₂, … of Hencky's series for a uniformly loaded disc with its rim held (Hencky 1915).

    With x = ρ², N = ¼ Q^⅔ y(x) and y = Σ b₂ₙ xⁿ, equilibrium and compatibility read y² (x y'' + 2 y') = -2, which gives one
    coefficient after the other from b₀; that one follows from the rim that does not move: Σ (2n + 1 - ν) b₂ₙ = 0.
    """

    def series(first: float) -> list[float]:
        b, square = [first], []
        for n in range(terms - 1):
            square.append(sum(b[i] * b[n - i] for i in range(n + 1)))
            known = sum(square[n - k] * (k + 1) * (k + 2) * b[k + 1] for k in range(n))
            b.append(((-2.0 if n == 0 else 0.0) - known) / (first**2 * (n + 1) * (n + 2)))
        return b

    def rim(first: float) -> float:
        return sum((2 * n + 1 - nu) * b for n, b in enumerate(series(first)))

    return series(optimize.brentq(rim, 1.55, 2.5, xtol=1e-14))


def hencky_disc(load: float, nu: float) -> tuple[float, float]:
    """Rise of the centre over the radius, and resultant there over E t, of Hencky's disc at Q = q a/(E t).

    The rise integrates N w' = -Q ρ/2, that is w = Q^⅓ ∫₀¹ 2 ρ/y(ρ²) dρ = Q^⅓ ∫₀¹ dx/y(x).
    """
    b = hencky_series(nu)
    x, weight = np.polynomial.legendre.leggauss(40)
    rise = float((0.5 * weight / np.polynomial.polynomial.polyval(0.5 * (x + 1.0), b)).sum())
    return load ** (1.0 / 3.0) * rise, 0.25 * load ** (2.0 / 3.0) * b[0]


def mylar_balloon() -> tuple[float, float, float]:
    """Equatorial radius, half thickness and volume of two inextensible discs of unit radius, seamed and inflated.

    No hoop stress: sin φ = (x/r)² along the meridian, whose length 1 gives r = 4 √(2π)/Γ(¼)²; half thickness π r²/4, volume
    2π r²/3 (Paulsen 1994; Mladenov and Oprea 2003).
    """
    equator = 4.0 * math.sqrt(2.0 * math.pi) / math.gamma(0.25) ** 2
    return equator, 0.25 * math.pi * equator**2, 2.0 * math.pi / 3.0 * equator**2


def wrinkled_strip(curvature: float, middle_strain: float, prestress: float, stiffness: float) -> tuple[float, float]:
    """Axial force and moment of a strip of unit height with equal prestress both ways, bent and stretched (Stein, Hedgepeth 1961).

    With E t = ``stiffness`` the axial resultant is N = N₀ + E t (ε + κ (y - ½)) where that is positive, and zero in the
    wrinkled band below, at y < b; strains count from the prestressed state.
    """
    lower = prestress + stiffness * (middle_strain - 0.5 * curvature)
    if lower >= 0.0:
        return prestress + stiffness * middle_strain, stiffness * curvature / 12.0
    band = -lower / (stiffness * curvature)
    force = 0.5 * stiffness * curvature * (1.0 - band) ** 2
    return force, force * (1.0 / 6.0 + band / 3.0)


def shrink_fit(inner: float, nu: float) -> tuple[float, float]:
    """Stress over E e of a disc that shrinks by e inside a ring of unit outer radius, free outside; draw of the seam over e a.

    The disc is under equal tension σ: its seam moves in by e - (1 - ν) σ/E of its radius. The ring, pulled inwards by σ (Lamé's
    thick ring), moves by σ/E ((1 + a²)/(1 - a²) + ν). Both are one: σ/(E e) = (1 - a²)/2.
    """
    stress = 0.5 * (1.0 - inner**2)
    return stress, stress * ((1.0 + inner**2) / (1.0 - inner**2) + nu)


def shrink_wrinkled(inner: float) -> tuple[float, float]:
    """The same of a ring that is held at its outer rim and wrinkles, with ν = 0.

    The tension is radial alone, σ a/r, so that the seam moves in by σ a ln(1/a)/E: σ/(E e) = 1/(1 + ln(1/a)). The hoop strain is
    less than zero everywhere inside the rim, so that all of the ring is wrinkled.
    """
    stress = 1.0 / (1.0 - math.log(inner))
    return stress, 1.0 - stress


def off_axis_strain(
    axial: float, hoop: float, *, warp: float, weft: float, nu: float, shear: float, angle: float
) -> tuple[float, float, float]:
    """Axial, hoop and shear strain of an orthotropic tube wall, warp turned by ``angle`` radians from the axis towards the hoop.

    The resultants are turned into the fabric's axes, the compliance applied, and the strains turned back; linear. ``warp``,
    ``weft`` and ``shear`` are moduli times thickness.
    """
    c, s = math.cos(angle), math.sin(angle)
    first, second, shear_force = axial * c * c + hoop * s * s, axial * s * s + hoop * c * c, (hoop - axial) * s * c
    e1, e2, gamma = first / warp - nu * second / warp, second / weft - nu * first / warp, shear_force / shear
    return (
        e1 * c * c + e2 * s * s - gamma * s * c,
        e1 * s * s + e2 * c * c + gamma * s * c,
        2.0 * (e1 - e2) * s * c + gamma * (c * c - s * s),
    )


def inflated_cantilever(
    load: float, *, length: float, radius: float, stiffness: float, nu: float, pressure: float
) -> float:
    """Tip deflection of an inflated tube before it wrinkles (Fichter 1966; Le van and Wielgosz 2005).

    v = F L³/(3 (E + P/S) I) + F L/(P + k G S) with P = p π r², S = 2π r t, I = π r³ t, k = 1/2; all of the inflated tube.
    """
    push = math.pi * pressure * radius**2
    bending = math.pi * radius**3 * (stiffness + 0.5 * pressure * radius)
    shear = 0.5 * stiffness / (2.0 * (1.0 + nu)) * 2.0 * math.pi * radius
    return load * length**3 / (3.0 * bending) + load * length / (push + shear)


def inflated_slope(load: float, *, length: float, radius: float, stiffness: float, nu: float, pressure: float) -> float:
    """Rotation of the end section of the same tube, F L²/(2 (E + P/S) I); shear and ν have no part in it."""
    del nu
    return load * length**2 / (2.0 * math.pi * radius**3 * (stiffness + 0.5 * pressure * radius))


def catenoid_neck(ratio: float) -> float:
    """Neck radius c of the stable catenoid between two rings of unit radius at z = ±``ratio``: 1 = c cosh(ratio/c)."""
    # The stable one is the wider: c above that of the tangent from the origin to the hyperbolic cosine.
    tangent = float(optimize.brentq(lambda x: x * math.tanh(x) - 1.0, 1.0, 1.5))
    return float(optimize.brentq(lambda c: c * math.cosh(ratio / c) - 1.0, ratio / tangent, 1.0, xtol=1e-14))


def scherk_area(half: float) -> float:
    """Area of Scherk's surface z = ln(cos x/cos y) over |x|, |y| ≤ ``half``: the integral of √(1 + tan² x + tan² y)."""
    x, weight = np.polynomial.legendre.leggauss(40)
    square = np.tan(half * x) ** 2
    return float(half**2 * weight @ np.sqrt(1.0 + square[:, None] + square[None, :]) @ weight)


def tetrahedral_film_area() -> float:
    """Area of the minimal surface in the skew quadrilateral with corners (±1, ±1, z = x y), a patch of Schwarz' D surface.

    4 K(√3/2)/K(1/2), with complete elliptic integrals of the first kind and their modulus (Schwarz 1890).
    """
    return float(4.0 * special.ellipk(0.75) / special.ellipk(0.25))


def elastic_catenary(span: float, length: float, stiffness: float, weight: float) -> tuple[float, float]:
    """Horizontal force H and sag of a cable of unstressed ``length`` and whole ``weight`` between level ends (Irvine 1981).

    span = H L/EA + 2 H L/W asinh(W/2H); sag = W L/8EA + H L/W (√(1 + (W/2H)²) - 1).
    """

    def miss(force: float) -> float:
        return force * length * (1.0 / stiffness + 2.0 / weight * math.asinh(0.5 * weight / force)) - span

    force = float(optimize.brentq(miss, 1e-6 * weight, 1e6 * weight, xtol=1e-14 * weight, rtol=1e-14))
    slope = math.hypot(1.0, 0.5 * weight / force) - 1.0
    return force, weight * length / (8.0 * stiffness) + force * length / weight * slope
