"""The natural constant-strain triangle: three side extensions, three side forces.

Corners are 0, 1, 2 counter-clockwise; side *a* lies opposite corner *a* and runs from corner a+1 to corner a+2. Pure Taichi
functions of values; equation numbers are those of the seed paper.
"""

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.vectors import dot, norm, outer

# The distinct blocks of a triangle: the three diagonal ones, then side a's, which couples corners a+1 and a+2.
BLOCKS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


@ti.func
def side_extension(rest, stretch, rest_length, green: ti.template()):
    """Extension δ of a side, its present length l, and ∂l/∂(l·δ): the factor that turns a natural force into force density.

    ``rest`` is the side's vector at rest, ``stretch`` the difference of its end displacements. l² - L² is formed from
    displacements, so that nothing cancels in single precision: δ = (l² - L²)/(l + L), or Green's δ = (l² - L²)/(2 L).
    The engineering extension of a finite strain is no tensor: in one uniform deformation triangles of different shape differ in
    strain by a share of the order of the strain itself. Green's passes the patch test exactly.
    A natural force T pulls with T ∂δ/∂x: T/l per length of the side vector for the engineering extension, T/L for Green's.
    """
    length = norm(rest + stretch)
    growth = dot(2.0 * rest + stretch, stretch)
    extension, density_factor = growth, length
    if ti.static(green):
        density_factor = 1.0 / rest_length
        extension = 0.5 * growth * density_factor
    else:
        reciprocal = 1.0 / (length * (length + rest_length))  # one division serves both
        extension = growth * length * reciprocal
        density_factor = (length + rest_length) * reciprocal
    return extension, length, density_factor


@ti.func
def pressure_corner_force(pressure, side_1, side_2):
    """Follower pressure on each of the three corners, p/6 · (s₁ × s₂): a third of p times the directed area.

    ``side_1`` and ``side_2`` are two consecutive sides. Summed over a surface it is exactly p ∂Volume/∂x.
    """
    return pressure / 6.0 * side_1.cross(side_2)


@ti.func
def swept_volume(mean_displacement, rest_1, rest_2, stretch_1, stretch_2):
    """Volume a triangle sweeps as it moves in a straight line from rest to its present place.

    Flux of the mean displacement through the directed area, integrated over the motion; exact for a flat triangle. Unlike
    the cone to an origin it is right for open surfaces whose rim is held or slides in a plane of symmetry, and does not
    cancel for small displacements.
    """
    constant = rest_1.cross(rest_2)
    linear = rest_1.cross(stretch_2) + stretch_1.cross(rest_2)
    quadratic = stretch_1.cross(stretch_2)
    return dot(mean_displacement, constant + 0.5 * linear + quadratic / 3.0) * 0.5


@ti.func
def side_stiffness_bound(row_sum, side_force, length, rest_length, pressure, green: ti.template()):
    """Upper bound k of a side's stiffness such that fictitious masses M ≥ ½ δt² Σ k at each node are stable.

    ``row_sum`` is Σ_b |k_ab| of the natural stiffness V Gᵀ C G (Gershgorin on the side-to-side coupling the seed leaves
    out). Along the side the stiffness is at most that; across it, force over length. Both projectors are complementary for the
    engineering extension, so the larger one bounds both; Green's extension adds them and scales the first by (l/L)². The term
    p l/12 bounds the pressure's stiffness on a closed surface. The tension field's stiffness never exceeds the elastic one; the
    clipped law's can, so for that one the bound is an observation (it held on every body tried), not a proof.
    """
    bound = ti.max(row_sum, ti.abs(side_force) / length)
    if ti.static(green):
        bound = row_sum * (length / rest_length) ** 2 + ti.abs(side_force) / rest_length
    return bound + ti.abs(pressure) * length / 12.0


@ti.func
def side_curvature(side_force, side, length, factor, green: ti.template()):
    """T ∂²δ/∂x² of a side (eq. 11): T/l (I - c cᵀ) for the engineering extension, T/L I for Green's."""
    stiffness = ti.Matrix.identity(float, 3)
    if ti.static(not green):
        stiffness -= outer(side, side) / length**2
    return side_force * factor * stiffness


@ti.func
def pressure_stiffness(pressure, side_m, side_n):
    """Symmetric part of -∂f_m/∂x_n of follower pressure, -p/12 [s_n - s_m]×, for two corners m ≠ n and their opposite sides.

    The triangle's own -p/6 [s_n]× is not symmetric; summed over a closed surface, or one whose rim is held, the skew parts cancel.
    """
    v = (side_m - side_n) * (pressure / 12.0)
    return ti.Matrix([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
