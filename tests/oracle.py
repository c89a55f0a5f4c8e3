"""A second, plain NumPy derivation of the mechanics; it shares neither code nor formulas with the package.

Fabrics come as rows (E_warp, E_weft, ν, G), ν being the contraction in weft per extension in warp; strains as
(ε_warp, ε_weft, γ) and stresses as (σ_warp, σ_weft, τ). The point-wise laws are evaluated in extended precision where
the platform has it, so that a disagreement in the last digits of double precision is the engine's.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]  # double, or the platform's extended precision
Ints = NDArray[np.int32]

TAUT, WRINKLED, SLACK = 0, 1, 2


def compliance(moduli: Floats) -> Floats:
    """(n, 3, 3) compliances of (n, 4) fabrics."""
    e1, e2, nu, g = np.asarray(moduli, dtype=np.longdouble).T
    out = np.zeros((len(e1), 3, 3), dtype=np.longdouble)
    out[:, 0, 0], out[:, 1, 1], out[:, 2, 2] = 1 / e1, 1 / e2, 1 / g
    out[:, 0, 1] = out[:, 1, 0] = -nu / e1
    return out


def stiffness(moduli: Floats) -> Floats:
    """(n, 3, 3) plane-stress stiffnesses: the inverse of the compliances by cofactors."""
    s = compliance(moduli)
    out = np.zeros_like(s)
    determinant = s[:, 0, 0] * s[:, 1, 1] - s[:, 0, 1] ** 2
    out[:, 0, 0], out[:, 1, 1] = s[:, 1, 1] / determinant, s[:, 0, 0] / determinant
    out[:, 0, 1] = out[:, 1, 0] = -s[:, 0, 1] / determinant
    out[:, 2, 2] = 1 / s[:, 2, 2]
    return out


def apply(matrices: Floats, vectors: Floats) -> Floats:
    """Product of (n, 3, 3) matrices and (n, 3) vectors."""
    return np.einsum("nij,nj->ni", matrices, vectors)


def uniaxial(angle: Floats) -> Floats:
    """(n, 3) stress of unit tension along the angle from the warp."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * c, s * s, c * s], axis=-1)


def principal(tensor: Floats, *, strain: bool) -> tuple[Floats, Floats]:
    """Major and minor principal values of (n, 3) tensors; the third component of a strain is twice the tensor's."""
    shear = tensor[..., 2] * (0.5 if strain else 1.0)
    mean = (tensor[..., 0] + tensor[..., 1]) / 2
    radius = np.hypot((tensor[..., 0] - tensor[..., 1]) / 2, shear)
    return mean + radius, mean - radius


def compliance_norm(stress: Floats, moduli: Floats) -> Floats:
    """√(σ C⁻¹ σ), the norm in which the tension field is a projection."""
    return np.sqrt(np.einsum("ni,nij,nj->n", stress, compliance(moduli), stress))


def _rate(angle: Floats, strain: Floats, s: Floats) -> Floats:
    """A number of the sign of d/dα of e(α)²/(1/E(α)), for e > 0."""
    unit = uniaxial(angle)
    slope = np.stack([-np.sin(2 * angle), np.sin(2 * angle), np.cos(2 * angle)], axis=-1)
    e, e_slope = np.sum(strain * unit, -1), np.sum(strain * slope, -1)
    c, c_slope = np.einsum("ni,nij,nj->n", unit, s, unit), 2 * np.einsum("ni,nij,nj->n", unit, s, slope)
    return e_slope * c - e * c_slope / 2


def best_direction(strain: Floats, moduli: Floats) -> tuple[Floats, Floats]:
    """Angle and energy of max over α of ½ E(α)⟨e(α)⟩²: a fine scan, then bisection of the derivative's sign."""
    strain = np.asarray(strain, dtype=np.longdouble)
    s = compliance(moduli)
    half = np.sort(np.concatenate([np.arctan(np.logspace(-7, 7, 421)), np.linspace(0.01, 1.56, 200)]))
    scan = np.concatenate([-half[::-1], [0.0], half, [np.pi / 2]])
    unit = uniaxial(scan)
    stretch = np.maximum(strain.astype(np.float64) @ unit.T, 0)
    along = np.einsum("ki,nij,kj->nk", unit, s.astype(np.float64), unit, optimize=True)
    k = np.argmax(stretch**2 / along, axis=1)
    scan = scan.astype(np.longdouble)
    period = np.longdouble(np.pi)
    low = np.where(k > 0, scan[k - 1], scan[-2] - period)
    high = np.where(k < len(scan) - 1, scan[(k + 1) % len(scan)], scan[0] + period)
    for _ in range(70):
        middle = (low + high) / 2
        rising = _rate(middle, strain, s) > 0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    angle = (low + high) / 2
    unit = uniaxial(angle)
    stretch = np.maximum(np.sum(strain * unit, -1), 0)
    return angle, stretch**2 / np.einsum("ni,nij,nj->n", unit, s, unit) / 2


def tension_field(strain: Floats, moduli: Floats) -> tuple[Floats, Floats, Ints]:
    """Stress, energy density and state of the tension field by brute force over directions."""
    strain = np.asarray(strain, dtype=np.longdouble)
    trial = apply(stiffness(moduli), strain)
    angle, energy = best_direction(strain, moduli)
    unit = uniaxial(angle)
    e = np.maximum(np.sum(strain * unit, -1), 0)
    stress = (e / np.einsum("ni,nij,nj->n", unit, compliance(moduli), unit))[:, None] * unit
    taut = principal(trial, strain=False)[1] >= 0
    slack = ~taut & (principal(strain, strain=True)[0] <= 0)
    stress = np.where(taut[:, None], trial, np.where(slack[:, None], 0, stress))
    energy = np.where(taut, np.sum(trial * strain, -1) / 2, np.where(slack, 0, energy))
    return stress, energy, np.where(taut, TAUT, np.where(slack, SLACK, WRINKLED)).astype(np.int32)


def clipped(strain: Floats, moduli: Floats) -> tuple[Floats, Ints]:
    """Stress and state of the law that sets negative principal stresses to zero, by an eigenvalue decomposition."""
    trial = apply(stiffness(moduli), np.asarray(strain, dtype=np.longdouble)).astype(np.float64)
    tensor = trial[:, [[0, 2], [2, 1]]]
    value, vector = np.linalg.eigh(tensor)
    kept = np.einsum("nik,nk,njk->nij", vector, np.maximum(value, 0), vector)
    state = np.array([SLACK, WRINKLED, TAUT], dtype=np.int32)[(value > 0).sum(axis=1)]
    return np.stack([kept[:, 0, 0], kept[:, 1, 1], kept[:, 0, 1]], axis=1), state


def response(strain: Floats, moduli: Floats, law: str) -> Floats:
    """Stress under a wrinkling law, in double precision."""
    if law == "none":
        return apply(stiffness(moduli), strain).astype(np.float64)
    return (clipped(strain, moduli) if law == "clip" else tension_field(strain, moduli))[0].astype(np.float64)


def random_moduli(rng: np.random.Generator, count: int) -> Floats:
    """(count, 4) fabrics: E_warp/E_weft from 1e-5 to 1e5, ν to ±95 % of its limit, G from 1e-6 to 10 times √(E_warp E_weft)."""
    ratio = 10 ** rng.uniform(-5, 5, count)
    scale = 10 ** rng.uniform(-2, 2, count)
    e1, e2 = scale * np.sqrt(ratio), scale / np.sqrt(ratio)
    return np.stack(
        [e1, e2, rng.uniform(-0.95, 0.95, count) * np.sqrt(ratio), scale * 10 ** rng.uniform(-6, 1, count)], 1
    )


def manufactured(rng: np.random.Generator, moduli: Floats, state: int) -> tuple[Floats, Floats]:
    """(n, 3) random strains of one tension-field state with the stress each must have, by the optimality conditions.

    A stress σ ≥ 0 belongs to every strain C⁻¹ σ - f whose fold strain f ≥ 0 is orthogonal to σ: taut has none, slack
    has nothing else, wrinkled is tension along one direction and folds across it.
    """
    count = len(moduli)
    # Directions are drawn uniformly in the fabric's own scaled angle, or stiff fabrics would see only two directions.
    angle = np.arctan(np.tan(rng.uniform(-np.pi / 2, np.pi / 2, count)) * (moduli[:, 0] / moduli[:, 1]) ** 0.25)
    along, across = uniaxial(angle.astype(np.longdouble)), uniaxial(angle.astype(np.longdouble) + np.pi / 2)
    across[:, 2] *= 2  # as a strain
    one, other = 10 ** rng.uniform(-2, 2, (2, count, 1))
    if state == SLACK:
        mixed = uniaxial(rng.uniform(0, np.pi, count).astype(np.longdouble)) * [1, 1, 2]
        return (-one * across - other * mixed).astype(np.float64), np.zeros((count, 3))
    stress = along / compliance_norm(along, moduli)[:, None] * one
    if state == TAUT:
        second = uniaxial(rng.uniform(0, np.pi, count).astype(np.longdouble))
        stress = stress + second / compliance_norm(second, moduli)[:, None] * other
        return apply(compliance(moduli), stress).astype(np.float64), stress.astype(np.float64)
    energetic = np.sqrt(np.einsum("ni,nij,nj->n", across, stiffness(moduli), across))[:, None]
    strain = apply(compliance(moduli), stress) - other * across / energetic
    return strain.astype(np.float64), stress.astype(np.float64)


# ---- triangles


def side_vectors(corners: Floats) -> Floats:
    """(n, 3, 3) sides of (n, 3, 3) corners: side a lies opposite corner a and runs from corner a + 1 to corner a + 2."""
    return np.stack([corners[:, (a + 2) % 3] - corners[:, (a + 1) % 3] for a in range(3)], axis=1)


def fabric_axes(corners: Floats, direction: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit warp, weft and normal of each triangle, and nothing else; the warp is the direction's projection."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    weft = np.cross(normal, direction)
    weft /= np.linalg.norm(weft, axis=1)[:, None]
    return np.cross(weft, normal), weft, normal


def side_strain_rows(corners: Floats, direction: Floats) -> Floats:
    """(n, 3, 3) rows [cos²θ, sin²θ, sinθ cosθ] that give the sides' direct strains from (ε_warp, ε_weft, γ)."""
    warp, weft, _ = fabric_axes(corners, direction)
    sides = side_vectors(corners)
    theta = np.arctan2(np.einsum("naj,nj->na", sides, weft), np.einsum("naj,nj->na", sides, warp))
    return np.stack([np.cos(theta) ** 2, np.sin(theta) ** 2, np.sin(theta) * np.cos(theta)], axis=-1)


def triangle_strain(corners: Floats, moved: Floats, direction: Floats, *, green: bool) -> Floats:
    """(n, 3) strain in fabric axes: from the side strains δ/L by solving, or Green's from the deformation gradient."""
    if green:
        gradient, _ = deformation_gradient(corners, moved, direction)
        e = 0.5 * (np.einsum("nki,nkj->nij", gradient, gradient) - np.eye(2))
        return np.stack([e[:, 0, 0], e[:, 1, 1], 2 * e[:, 0, 1]], axis=1)
    rest, now = (np.linalg.norm(side_vectors(x), axis=2) for x in (corners, moved))
    return np.linalg.solve(side_strain_rows(corners, direction), ((now - rest) / rest)[..., None])[..., 0]


def deformation_gradient(corners: Floats, moved: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """(n, 3, 2) deformation gradients from fabric axes to space, and (n, 3, 2) shape-function gradients."""
    warp, weft, _ = fabric_axes(corners, direction)
    axes = np.stack([warp, weft], axis=-1)
    rest = np.einsum("naj,njk->nka", corners[:, 1:] - corners[:, :1], axes)
    inverse = np.linalg.inv(rest)
    shape = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    return np.einsum("naj,nak->njk", moved, shape), shape


def triangle_forces(
    corners: Floats, moved: Floats, direction: Floats, stress: Floats, thickness: float, *, green: bool
) -> Floats:
    """(n, 3, 3) forces on the corners that a stress in fabric axes exerts: minus its virtual work per corner displacement."""
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = 0.5 * np.linalg.norm(doubled, axis=1) * thickness
    if green:
        gradient, shape = deformation_gradient(corners, moved, direction)
        tensor = stress[:, [[0, 2], [2, 1]]]
        return -volume[:, None, None] * np.einsum("njk,nkl,nal->naj", gradient, tensor, shape)
    rest = np.linalg.norm(side_vectors(corners), axis=2)
    now = side_vectors(moved)
    rows = side_strain_rows(corners, direction)
    tension = volume[:, None] * np.linalg.solve(np.swapaxes(rows, 1, 2), stress[..., None])[..., 0] / rest
    pull = (tension / np.linalg.norm(now, axis=2))[..., None] * now
    return np.stack([pull[:, (a + 2) % 3] - pull[:, (a + 1) % 3] for a in range(3)], axis=1)


def enclosed_volume(points: Floats, triangles: Ints) -> float:
    """Volume inside a closed surface, by the divergence theorem."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def volume_gradient(points: Floats, triangles: Ints) -> Floats:
    """∂Volume/∂x by central differences, which have no truncation error: the volume is linear in each coordinate."""
    out = np.zeros_like(points)
    for i, c in np.ndindex(*points.shape):
        for step in (1.0, -1.0):
            moved = points.copy()
            moved[i, c] += step
            out[i, c] += step * enclosed_volume(moved, triangles) / 2
    return out


# ---- small meshes


def icosahedron() -> tuple[Floats, Ints]:
    """A closed body of 12 nodes and 20 triangles with outward normals, circumradius 1."""
    golden = (1 + np.sqrt(5)) / 2
    base = np.array([(0, y, z) for y in (-1, 1) for z in (-golden, golden)])
    points = np.concatenate([np.roll(base, k, axis=1) for k in range(3)])
    near = np.isclose(np.linalg.norm(points[:, None] - points[None], axis=2), 2)
    faces = [f for f in combinations(range(12), 3) if all(near[i, j] for i, j in combinations(f, 2))]
    outward = [f if np.linalg.det(points[list(f)]) > 0 else (f[0], f[2], f[1]) for f in faces]
    return points / np.linalg.norm(points[0]), np.array(outward, dtype=np.int32)


def irregular_patch(rng: np.random.Generator, cells: int = 4) -> tuple[Floats, Ints, Ints]:
    """A flat irregular patch in the plane z = 0 with mixed diagonals: points, triangles, numbers of the inner nodes."""
    grid = np.stack(np.meshgrid(np.arange(cells + 1.0), np.arange(cells + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
    inner = np.flatnonzero(((grid > 0) & (grid < cells)).all(axis=1)).astype(np.int32)
    points = np.zeros((len(grid), 3))
    points[:, :2] = grid + rng.uniform(-0.25, 0.25, grid.shape)
    triangles = []
    for i, j in np.ndindex(cells, cells):
        a, b = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
        if rng.random() < 0.5:
            triangles += [(a, b, b + 1), (a, b + 1, a + 1)]
        else:
            triangles += [(a, b, a + 1), (b, b + 1, a + 1)]
    return points, np.array(triangles, dtype=np.int32), inner


def rotation(rng: np.random.Generator) -> Floats:
    """A random proper rotation matrix."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)
