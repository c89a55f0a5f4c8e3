"""Plane-stress orthotropic fabric and the three laws for what it does instead of carrying compression.

Everything here is a pure Taichi function of values. Strain is (ε_warp, ε_weft, γ), stress is (σ_warp, σ_weft, τ), both in
the fabric's axes, γ the engineering shear strain.

Tension field (relaxed energy)
------------------------------
The stress is the projection of the trial stress C ε on the positive semi-definite stresses in the metric of the
compliance. It is the gradient of W(ε) = max over directions of ½ E(α)⟨e(α)⟩₊², where e(α) is the strain along α and 1/E(α)
the compliance along α. Three states: taut (C ε has no negative principal value), slack (no direction is stretched),
wrinkled otherwise, where the stress is uniaxial along the direction that attains the maximum.

That direction has a closed bracket and a unique root. Scale the warp direction by E_warp^¼ and the weft direction by E_weft^¼; in
the scaled double angle φ, with m = (a + b)/2, d = (a - b)/2, h = c/2 of the scaled strains (a, b, c),

    e = m + d cos φ + h sin φ,    compliance = 1 + η sin² φ,    η = (κ - 1)/2,  κ = (1/G - 2ν/E_warp) √(E_warp E_weft) / 2,

and stationarity of e²/compliance reads h cos φ - d (1 + η) sin φ - m η sin φ cos φ = 0. By reflection d, h ≥ 0 may be
assumed; divided by sin φ cos φ the left side falls monotonically over (0, π/2), so the root there is the only one. η = 0 is the
isotropic fabric, for which φ is the principal direction of the strain.
"""

from typing import Any

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.vectors import dot, outer
from taichi_membrane.names import SLACK, TAUT, WRINKLED

_MAX_ROOT_STEPS = 60  # bisection alone reaches double precision in 53


CONSTANTS = (
    "c11", "c12", "c22", "c33", "root_warp", "root_weft", "root_shear", "eta",
    "compliance_warp", "compliance_cross", "compliance_weft", "compliance_shear",
)  # fmt: skip


def fabric_record(fp: Any) -> Any:
    """The Taichi record of one fabric's constants in precision ``fp``; made from :class:`FabricConstants` of the model."""
    return ti.types.struct(**dict.fromkeys(CONSTANTS, fp))


@ti.func
def elastic_stress(strain, f):
    """C ε (eq. 8 of the seed paper)."""
    return ti.Vector(
        [
            f.c11 * strain[0] + f.c12 * strain[1],
            f.c12 * strain[0] + f.c22 * strain[1],
            f.c33 * strain[2],
        ]
    )


@ti.func
def principal_values(xx, yy, xy):
    """Major and minor principal value of the symmetric 2×2 tensor, without cancellation in the difference."""
    mean = (xx + yy) * 0.5
    radius = ti.sqrt(((xx - yy) * 0.5) ** 2 + xy * xy)
    return mean + radius, mean - radius


@ti.func
def wrinkle_direction_root(m, d, h, eta):
    """t = tan(φ/2) in [0, 1] with h cos φ - d(1+η) sin φ - m η sin φ cos φ = 0, for d, h ≥ 0 (see the module text).

    Newton from the root for m = 0, inside a bracket that every step tightens.
    """
    low = 0.0 * m
    high = low + 1.0
    g = d * (1.0 + eta)
    t = h / (ti.sqrt(h * h + g * g) + g)
    for _ in range(_MAX_ROOT_STEPS):
        square = t * t
        value = h * (1.0 - square * square) - 2.0 * t * (g * (1.0 + square) + m * eta * (1.0 - square))
        slope = -4.0 * h * square * t - 2.0 * (g * (1.0 + 3.0 * square) + m * eta * (1.0 - 3.0 * square))
        if value > 0.0:
            low = t
        else:
            high = t
        newton = t - value / slope
        following = newton
        if not (newton >= low and newton <= high):
            following = 0.5 * (low + high)
        if following == t or high <= low:
            break
        t = following
    return t


@ti.func
def wrinkle_direction(m, d, h, eta, orthotropic: ti.template()):
    """Cosine and sine of the scaled double angle φ of the tension in a wrinkled triangle."""
    radius = ti.sqrt(d * d + h * h)  # above zero: equal principal strains are either taut or slack
    cosine, sine = d / radius, h / radius
    if ti.static(orthotropic):
        t = wrinkle_direction_root(m, ti.abs(d), ti.abs(h), eta)
        scale = 1.0 / (1.0 + t * t)
        cosine = ti.select(d < 0.0, -1.0, 1.0) * (1.0 - t * t) * scale
        sine = ti.select(h < 0.0, -1.0, 1.0) * 2.0 * t * scale
    return cosine, sine


@ti.func
def wrinkled_stress(strain, f, orthotropic: ti.template()):
    """Uniaxial stress of the tension field and its energy density, for a strain known to be wrinkled."""
    a, b, c = f.root_warp * strain[0], f.root_weft * strain[1], f.root_shear * strain[2]
    m, d, h = 0.5 * (a + b), 0.5 * (a - b), 0.5 * c
    cosine, sine = wrinkle_direction(m, d, h, f.eta, orthotropic)
    compliance = 0.0 * m + 1.0
    if ti.static(orthotropic):
        compliance = 1.0 + f.eta * sine * sine
    stretch = m + d * cosine + h * sine
    tension = ti.max(stretch, 0.0) / compliance
    stress = tension * ti.Vector(
        [f.root_warp * 0.5 * (1.0 + cosine), f.root_weft * 0.5 * (1.0 - cosine), f.root_shear * 0.5 * sine]
    )
    return stress, 0.5 * tension * stretch


@ti.func
def tension_field(strain, f, orthotropic: ti.template()):
    """Stress, energy density and state of the tension field."""
    stress = elastic_stress(strain, f)
    energy = 0.5 * dot(stress, strain)
    state = TAUT
    taut = stress[0] + stress[1] >= 0.0 and stress[0] * stress[1] >= stress[2] * stress[2]
    if not taut:
        half_sum, half_difference = 0.5 * (strain[0] + strain[1]), 0.5 * (strain[0] - strain[1])
        major = half_sum + ti.sqrt(half_difference**2 + 0.25 * strain[2] ** 2)
        if major <= 0.0:
            stress = 0.0 * stress
            energy = 0.0 * energy
            state = SLACK
        else:
            stress, energy = wrinkled_stress(strain, f, orthotropic)
            state = WRINKLED
    return stress, energy, state


@ti.func
def clipped(strain, f):
    """Stress, energy density and state of the seed paper's law: negative principal stresses are removed.

    It is not the gradient of any energy; the number returned as energy is half of stress times strain and is not conserved.
    """
    stress = elastic_stress(strain, f)
    major, minor = principal_values(stress[0], stress[1], stress[2])
    state = TAUT
    if major <= 0.0:
        stress = 0.0 * stress
        state = SLACK
    elif minor < 0.0:
        # σ₁ n⊗n with n⊗n = (σ - σ₂ I)/(σ₁ - σ₂)
        share = major / (major - minor)
        stress = share * ti.Vector([stress[0] - minor, stress[1] - minor, stress[2]])
        state = WRINKLED
    return stress, 0.5 * dot(stress, strain), state


@ti.func
def response(strain, f, law: ti.template(), orthotropic: ti.template()):
    """Stress, energy density and state under the given wrinkling law (a compile-time choice)."""
    stress = elastic_stress(strain, f)
    energy = 0.5 * dot(stress, strain)
    state = TAUT
    if ti.static(law == "tension_field"):
        stress, energy, state = tension_field(strain, f, orthotropic)
    elif ti.static(law == "clip"):
        stress, energy, state = clipped(strain, f)
    return stress, energy, state


@ti.func
def fold_strain(strain, stress, f):
    """Strain stored in folds, C⁻¹ σ - ε, a positive semi-definite tensor (xx, yy, engineering shear)."""
    return ti.Vector(
        [
            f.compliance_warp * stress[0] + f.compliance_cross * stress[1] - strain[0],
            f.compliance_cross * stress[0] + f.compliance_weft * stress[1] - strain[1],
            f.compliance_shear * stress[2] - strain[2],
        ]
    )


@ti.func
def wrinkled_tangent(strain, f, orthotropic: ti.template()):
    """Consistent tangent ∂σ/∂ε (3×3, symmetric, positive semi-definite) of a wrinkled tension field.

    With W = max over φ of ½ n²/c (n the scaled strain along φ, c its compliance), ∂σ/∂ε = W_εε - W_εφ⊗W_εφ / W_φφ, where
    W_φφ < 0 at the maximum.
    """
    a, b, g = f.root_warp * strain[0], f.root_weft * strain[1], f.root_shear * strain[2]
    m, d, h = 0.5 * (a + b), 0.5 * (a - b), 0.5 * g
    cosine, sine = wrinkle_direction(m, d, h, f.eta, orthotropic)
    compliance, relative_slope, relative_curvature = 0.0 * m + 1.0, 0.0 * m, 0.0 * m
    if ti.static(orthotropic):
        compliance = 1.0 + f.eta * sine * sine
        relative_slope = 2.0 * f.eta * sine * cosine / compliance
        relative_curvature = 2.0 * f.eta * (cosine * cosine - sine * sine) / compliance
    stretch = m + d * cosine + h * sine
    along = ti.Vector(
        [f.root_warp * 0.5 * (1.0 + cosine), f.root_weft * 0.5 * (1.0 - cosine), f.root_shear * 0.5 * sine]
    )
    turning = ti.Vector([-0.5 * f.root_warp * sine, 0.5 * f.root_weft * sine, 0.5 * f.root_shear * cosine])
    mixed = turning - 0.5 * relative_slope * along
    # W_φφ over n²/c; the stretch n is positive in the wrinkled state.
    bending = 0.25 * relative_slope**2 - (stretch - m) / stretch - 0.5 * relative_curvature
    return (outer(along, along) - outer(mixed, mixed) / bending) / compliance


@ti.func
def elastic_tangent(f):
    """C as a 3×3 matrix."""
    return ti.Matrix([[f.c11, f.c12, 0.0], [f.c12, f.c22, 0.0], [0.0, 0.0, f.c33]])


@ti.func
def tangent(strain, f, state, law: ti.template(), orthotropic: ti.template()):
    """Consistent tangent ∂σ/∂ε under the linear law or the tension field (the clipped law has no symmetric one).

    ``state`` is what :func:`response` says of the strain.
    """
    result = elastic_tangent(f)
    if ti.static(law == "tension_field"):
        if state == WRINKLED:
            result = wrinkled_tangent(strain, f, orthotropic)
        elif state == SLACK:
            result = 0.0 * result
    return result
