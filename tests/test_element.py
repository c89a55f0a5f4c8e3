"""The triangle and its pressure, through the engine's kernels, against the oracle, exact identities and energy differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracle
import pytest
from oracle import Floats, Ints

from taichi_membrane.device.runtime import Runtime
from taichi_membrane.mechanics.preparation import FabricConstants
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import SideStrain, WrinklingLaw

EPS = np.finfo(np.float64).eps


def orthotropic(
    moduli: Floats,
    law: WrinklingLaw,
    side_strain: SideStrain,
    *,
    thickness: float = 1.0,
    prestress: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> FabricConstants:
    """A fabric from (E_warp, E_weft, ν, G)."""
    a, b, nu, g = (float(x) for x in moduli)
    return FabricConstants(
        e_warp=a,
        e_weft=b,
        poisson=nu,
        shear=g,
        thickness=thickness,
        law=law,
        side_strain=side_strain,
        prestress=prestress,
    )


def moduli_of(fabric: FabricConstants) -> Floats:
    """The oracle's row of a fabric."""
    return np.array([fabric.e_warp, fabric.e_weft, fabric.poisson, fabric.shear])


@dataclass(frozen=True, kw_only=True)
class Body:
    """A part of a mesh: its nodes, its triangles (in numbers of the part's own nodes) and its fabric and chamber."""

    nodes: slice
    tris: slice
    points: Floats
    triangles: Ints
    warp: Floats
    fabric: FabricConstants
    chamber: int

    def strain(self, u: Floats) -> Floats:
        """Strain with the offset that stands for prestress, by the oracle."""
        corners, moved = self.points[self.triangles], (self.points + u)[self.triangles]
        moduli = np.tile(moduli_of(self.fabric), (len(corners), 1))
        strain = oracle.triangle_strain(corners, moved, self.warp, green=self.fabric.side_strain == "green")
        return strain + oracle.apply(oracle.compliance(moduli), np.tile(self.fabric.prestress, (len(corners), 1)))

    def stress_and_forces(self, u: Floats) -> tuple[Floats, Floats]:
        """Stress, and nodal forces without pressure, of displacements of the part's nodes, by the oracle."""
        fabric, green = self.fabric, self.fabric.side_strain == "green"
        corners, moved = self.points[self.triangles], (self.points + u)[self.triangles]
        moduli = np.tile(moduli_of(fabric), (len(corners), 1))
        stress = oracle.response(self.strain(u), moduli, fabric.law)
        corner_force = oracle.triangle_forces(corners, moved, self.warp, stress, fabric.thickness, green=green)
        force = np.zeros_like(self.points)
        np.add.at(force, self.triangles, corner_force)
        return stress, force


def joined(
    parts: list[tuple[Floats, Ints, Floats, FabricConstants, int]], *, loads: bool
) -> tuple[list[Body], Structure]:
    """One structure of separate parts (points, triangles, warp, fabric, chamber)."""
    bodies: list[Body] = []
    node = tri = 0
    for points, triangles, warp, fabric, chamber in parts:
        bodies.append(
            Body(
                nodes=slice(node, node + len(points)),
                tris=slice(tri, tri + len(triangles)),
                points=points,
                triangles=triangles,
                warp=warp,
                fabric=fabric,
                chamber=chamber,
            )
        )
        node, tri = node + len(points), tri + len(triangles)
    count = [len(body.triangles) for body in bodies]
    structure = Structure(
        mesh=Mesh.build(
            np.concatenate([body.points for body in bodies]),
            np.concatenate([body.triangles + body.nodes.start for body in bodies]),
        ),
        fabrics=tuple(body.fabric for body in bodies),
        tri_fabric=np.repeat(np.arange(len(bodies), dtype=np.int32), count),
        tri_warp=np.concatenate([body.warp for body in bodies]),
        node_held=np.zeros((node, 3), dtype=bool),
        tri_chamber=np.repeat(np.array([body.chamber for body in bodies], dtype=np.int32), count),
        loads=loads,
    )
    return bodies, structure


PRESTRESS = (0.05, 0.02, 0.01)
KINDS: list[tuple[WrinklingLaw, SideStrain, tuple[float, float, float]]] = [
    ("tension_field", "engineering", PRESTRESS),
    ("tension_field", "green", (0.0, 0.0, 0.0)),
    ("none", "engineering", (0.0, 0.0, 0.0)),
    ("none", "green", PRESTRESS),
    ("clip", "engineering", (0.0, 0.0, 0.0)),
    ("clip", "green", PRESTRESS),
]
PRESSURES = np.array([0.3, -0.2])


@dataclass(frozen=True, kw_only=True)
class Zoo:
    """Seven irregular closed bodies: every law with both side strains on random fabrics, one isotropic; two chambers."""

    bodies: list[Body]
    system: System
    loads: Floats

    def forces(self, u: Floats, pressures: Floats, loads: Floats) -> Floats:
        """Out-of-balance forces of the engine."""
        self.system.set_displacement(u)
        self.system.set_surface_loads(pressures)
        self.system.set_loads(loads)
        return self.system.out_of_balance()


@pytest.fixture(scope="module")
def zoo(runtime_cpu: Runtime) -> Zoo:
    """Made once: its kernels hold seven kinds of element code."""
    rng = np.random.default_rng(7)
    base, triangles = oracle.icosahedron()
    moduli = oracle.random_moduli(rng, len(KINDS))
    moduli[:, [0, 1, 3]] /= np.sqrt(moduli[:, :1] * moduli[:, 1:2])
    fabrics = [
        orthotropic(row, law, side, thickness=rng.uniform(0.5, 2), prestress=prestress)
        for row, (law, side, prestress) in zip(moduli, KINDS, strict=True)
    ]
    fabrics.append(orthotropic(np.array([1.0, 1.0, 0.3, 1 / 2.6]), "tension_field", "engineering"))
    parts = []
    for number, fabric in enumerate(fabrics):
        points = base * rng.uniform(0.6, 1.6, 3) + rng.uniform(-0.15, 0.15, base.shape) + [4.0 * number, 0, 0]
        parts.append((points, triangles, rng.normal(size=(20, 3)), fabric, number % 3 - 1))
    bodies, structure = joined(parts, loads=True)
    return Zoo(bodies=bodies, system=System(structure), loads=rng.normal(size=structure.mesh.points.shape))


def random_state(zoo: Zoo, seed: int, size: float = 0.2) -> Floats:
    """Random displacements; at the default size all three wrinkling states occur."""
    return np.random.default_rng(seed).normal(size=zoo.loads.shape) * size


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_forces_and_stresses_equal_the_oracle(zoo: Zoo, seed: int) -> None:
    """Strains by solving the 3 × 3 systems or from deformation gradients, stresses by brute force, p ∂V/∂x, dead loads."""
    u = random_state(zoo, seed)
    got = zoo.forces(u, PRESSURES, zoo.loads)
    state = zoo.system.element_state()
    assert set(state.state) == {0, 1, 2}
    for body in zoo.bodies:
        stress, expected = body.stress_and_forces(u[body.nodes])
        if body.chamber >= 0:
            present = body.points + u[body.nodes]
            expected = expected + PRESSURES[body.chamber] * oracle.volume_gradient(present, body.triangles)
        expected = expected + zoo.loads[body.nodes]
        # Strains of order 1 with coordinates up to 25 and moduli ratios up to 1e5: a few hundred roundings of the
        # stiffest modulus. A wrong term is of order 1.
        stiffest = 10 * max(moduli_of(body.fabric)[[0, 1, 3]])
        assert np.max(np.abs(state.stress[body.tris] - stress)) < 1e3 * EPS * stiffest
        assert np.max(np.abs(got[body.nodes] - expected)) < 1e3 * EPS * (stiffest + 1)


def test_margins_and_fold_strains_equal_the_oracle(zoo: Zoo) -> None:
    """Distance from the borders of the states, and the strain stored in folds: zero where taut."""
    u = random_state(zoo, 1)
    zoo.forces(u, PRESSURES, zoo.loads)
    state = zoo.system.element_state()
    for body in zoo.bodies:
        strain, (stress, _) = body.strain(u[body.nodes]), body.stress_and_forces(u[body.nodes])
        row = moduli_of(body.fabric)
        moduli = np.tile(row, (len(strain), 1))
        trial = oracle.apply(oracle.stiffness(moduli), strain)
        folds = oracle.apply(oracle.compliance(moduli), stress) - strain
        fold_major = np.where(state.state[body.tris] == 0, 0, oracle.principal(folds, strain=True)[0])
        # Prestress on a soft shear modulus makes large strains. Folds are a difference of strains, and the same modulus
        # multiplies the stress's round-off.
        noise = 1e3 * EPS * max(1.0, float(np.max(np.abs(strain))))
        softest = float(max(row[:2]) / min(row[[0, 1, 3]]))
        assert state.strain[body.tris] == pytest.approx(strain.astype(np.float64), abs=noise)
        assert state.fold_strain[body.tris] == pytest.approx(fold_major.astype(np.float64), abs=noise * softest)
        margin = oracle.principal(trial, strain=False)[1] / max(row[:2])
        assert state.taut_margin[body.tris] == pytest.approx(margin.astype(np.float64), abs=10 * noise)
        major = oracle.principal(strain, strain=True)[0].astype(np.float64)
        assert state.slack_margin[body.tris] == pytest.approx(major, abs=noise)


@pytest.mark.parametrize("seed", [1, 2])
def test_forces_are_minus_the_gradient_of_the_potential(zoo: Zoo, seed: int) -> None:
    """Fourth-order differences at every degree of freedom, in all three states, with prestress, pressures and loads.

    The clipped law is left out: it is no gradient.
    """
    u = random_state(zoo, seed)
    got = zoo.forces(u, PRESSURES, zoo.loads)
    state = zoo.system.element_state().state
    step, checked, skipped = 1e-5, 0, 0
    for body in zoo.bodies:
        if body.fabric.law == "clip":
            continue
        scale = np.max(np.abs(got[body.nodes]))
        for i, c in np.ndindex(len(body.points), 3):
            node = body.nodes.start + i
            energy, crossed = {}, False
            for k in (-2, -1, 1, 2):
                moved = u.copy()
                moved[node, c] += k * step
                zoo.system.set_displacement(moved)
                energy[k] = zoo.system.potential_energy(zoo.loads)[0]
                if k % 2 == 0:
                    crossed |= not np.array_equal(zoo.system.element_state().state, state)
            slope = (energy[-2] - 8 * energy[-1] + 8 * energy[1] - energy[2]) / (12 * step)
            if crossed:  # the second derivative jumps within the step, so differences are no better than the step
                skipped += 1
                continue
            checked += 1
            assert abs(slope + got[node, c]) < 1e-7 * scale, (node, c)
    assert checked > 20 * (skipped + 1)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_moved_and_turned_structure_feels_turned_forces(zoo: Zoo, seed: int) -> None:
    """Forces follow a large rotation and a shift of 100; energies do not change."""
    rng = np.random.default_rng(seed)
    turn, shift = oracle.rotation(rng), rng.normal(size=3) * 100
    points = zoo.system.structure.mesh.points
    u = random_state(zoo, seed)
    before = zoo.forces(u, PRESSURES, 0 * zoo.loads)
    strain_energy = zoo.system.potential_energy(0 * zoo.loads)[1]
    after = zoo.forces((points + u) @ turn.T + shift - points, PRESSURES, 0 * zoo.loads)
    # Displacements of 100 to 200 round at 100 eps; that error in a strain of order 1 times the stiffest modulus.
    scale = 1e3 * EPS * max(np.max(moduli_of(body.fabric)[[0, 1, 3]]) for body in zoo.bodies) * 10
    assert np.max(np.abs(after - before @ turn.T)) < scale
    assert zoo.system.potential_energy(0 * zoo.loads)[1] == pytest.approx(strain_energy, rel=1e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_rigid_motion_exerts_no_force(zoo: Zoo, seed: int) -> None:
    """A rotation by any angle and a shift of 100, without prestress: nothing but the rounding of displacements."""
    rng = np.random.default_rng(seed)
    points = zoo.system.structure.mesh.points
    u = points @ oracle.rotation(rng).T + rng.normal(size=3) * 100 - points
    got = zoo.forces(u, 0 * PRESSURES, 0 * zoo.loads)
    for body in zoo.bodies:
        if not any(body.fabric.prestress):
            # Strain 200 eps per side of length 1, times the stiffness 1/(1 - ν²E/E) ≤ 10, six triangles per node.
            bound = 200 * EPS * 10 * 6 * np.max(moduli_of(body.fabric)[[0, 1, 3]])
            assert np.max(np.abs(got[body.nodes])) < bound


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pressure_on_closed_bodies(zoo: Zoo, seed: int) -> None:
    """Forces sum to nothing, have no moment, and are p ∂V/∂x; the volume swept is V - V₀ and the work is p (V - V₀)."""
    u = random_state(zoo, seed)
    still = zoo.forces(u, 0 * PRESSURES, 0 * zoo.loads)
    push = zoo.forces(u, PRESSURES, 0 * zoo.loads) - still
    total, strain_energy = zoo.system.potential_energy(0 * zoo.loads)
    swept = zoo.system.swept_volumes(u)
    present = zoo.system.structure.mesh.points + u
    work = 0.0
    # The difference of two out-of-balance forces rounds like the larger of them; coordinates reach 25.
    noise = 100 * EPS * (1 + np.max(np.abs(still)))
    for body in zoo.bodies:
        x = present[body.nodes]
        pressure = PRESSURES[body.chamber] if body.chamber >= 0 else 0.0
        assert np.max(np.abs(push[body.nodes].sum(axis=0))) < noise
        assert np.max(np.abs(np.cross(x, push[body.nodes]).sum(axis=0))) < 25 * noise
        expected = pressure * oracle.volume_gradient(x, body.triangles)
        assert np.max(np.abs(push[body.nodes] - expected)) < noise
        growth = oracle.enclosed_volume(x, body.triangles) - oracle.enclosed_volume(body.points, body.triangles)
        assert abs(growth) > 0.01
        assert swept[body.tris].sum() == pytest.approx(growth, abs=1e3 * EPS * 25)  # the oracle's cones reach to x = 25
        work += pressure * growth
    assert strain_energy - total == pytest.approx(work, abs=1e3 * EPS * (abs(strain_energy) + 25))


@pytest.fixture(scope="module")
def patches(runtime_cpu: Runtime) -> tuple[list[Body], System]:
    """Flat irregular patches, one for each law with each side strain, with one warp direction each."""
    rng = np.random.default_rng(11)
    moduli = oracle.random_moduli(rng, len(KINDS))
    moduli[:, [0, 1, 3]] /= np.sqrt(moduli[:, :1] * moduli[:, 1:2])
    parts = []
    for number, (row, (law, side, _)) in enumerate(zip(moduli, KINDS, strict=True)):
        points, triangles, _ = oracle.irregular_patch(np.random.default_rng(12))
        warp = np.tile(rng.normal(size=3), (len(triangles), 1))
        parts.append((points + np.array([0, 0, 10.0 * number]), triangles, warp, orthotropic(row, law, side), -1))
    bodies, structure = joined(parts, loads=False)
    return bodies, System(structure)


def affine(patches: tuple[list[Body], System], gradient: Floats) -> tuple[Floats, Floats, Floats]:
    """Displacements, stresses and forces of the map that takes (x, y) to gradient · (x, y), in every patch."""
    _, system = patches
    points = system.structure.mesh.points
    u = points[:, :2] @ gradient.T - points
    system.set_displacement(u)
    return u, system.element_state().stress, system.out_of_balance()


STRETCHES = {
    "both ways": [[1.3, 0.1], [0.1, 1.2]],
    "one way": [[1.3, 0.2], [0.2, 0.6]],
    "shortened": [[0.7, 0.05], [0.05, 0.8]],
}


@pytest.mark.parametrize("name", STRETCHES)
def test_patch_test_of_green_strain_is_exact(patches: tuple[list[Body], System], name: str) -> None:
    """A large affine map with a rotation out of the plane: one stress everywhere, no force at inner nodes."""
    turn = oracle.rotation(np.random.default_rng(13))[:, :2]
    u, stress, force = affine(patches, turn @ np.array(STRETCHES[name]))
    inner = oracle.irregular_patch(np.random.default_rng(12))[2]
    for body in patches[0]:
        if body.fabric.side_strain == "green":
            expected = body.stress_and_forces(u[body.nodes])[0].mean(axis=0)
            # Heights up to 50 round at 50 eps in sides of length 1; strains are of order 1.
            bound = 1e3 * EPS * 10 * np.max(moduli_of(body.fabric)[[0, 1, 3]])
            assert np.max(np.abs(stress[body.tris] - expected)) < bound
            assert np.max(np.abs(force[body.nodes][inner])) < bound


def test_patch_test_of_engineering_strain_is_exact_in_the_limit_of_small_strain(
    patches: tuple[list[Body], System],
) -> None:
    """Side strains of a finite affine map are no tensor: the stress scatters by the strain, relatively, at first order.

    They are one when all directions stretch alike, and then the test is passed at any stretch.
    """
    turn = oracle.rotation(np.random.default_rng(13))[:, :2]
    strain = np.array([[1.0, 0.2], [0.2, 0.5]])
    engineering = [body for body in patches[0] if body.fabric.side_strain == "engineering"]
    inner = oracle.irregular_patch(np.random.default_rng(12))[2]
    scatter = []
    for size in (1e-2, 1e-3, 1e-4):
        _, stress, force = affine(patches, turn @ (np.eye(2) + size * strain))
        scatter.append(
            [
                max(np.ptp(stress[body.tris], axis=0).max(), np.abs(force[body.nodes][inner]).max())
                / np.abs(stress[body.tris]).max()
                for body in engineering
            ]
        )
    orders = np.log10(np.array(scatter[:-1]) / np.array(scatter[1:]))
    assert np.all(np.abs(orders - 1) < 0.05), orders  # the next order adds 1e-2 of it
    _, stress, force = affine(patches, turn * 1.5)
    for body in engineering:
        bound = 1e3 * EPS * 10 * np.max(moduli_of(body.fabric)[[0, 1, 3]])
        assert np.ptp(stress[body.tris], axis=0).max() < bound
        assert np.abs(force[body.nodes][inner]).max() < bound


def test_open_surface_that_slides_in_a_plane_of_symmetry(runtime_cpu: Runtime) -> None:
    """Half a cushion on z = 0: with the rim free in the plane, the force on free components is minus the gradient."""
    rng = np.random.default_rng(14)
    points, triangles, inner = oracle.irregular_patch(rng)
    points[inner, 2] = rng.uniform(0.2, 1.0, len(inner))
    held = np.zeros(points.shape, dtype=bool)
    held[np.setdiff1d(np.arange(len(points)), inner), 2] = True
    fabric = orthotropic(np.array([1.0, 1.0, 0.3, 1 / 2.6]), "none", "green")
    _, structure = joined([(points, triangles, np.tile(np.eye(3)[0], (len(triangles), 1)), fabric, 0)], loads=False)
    system = System(structure)
    system.set_surface_loads(np.array([0.5]))
    u = np.where(held, 0.0, rng.normal(size=points.shape) * 0.2)
    system.set_displacement(u)
    got = system.out_of_balance()
    none, step = np.zeros_like(u), 1e-3  # the energy is a polynomial: fourth-order differences err by step⁴
    for i, c in np.argwhere(~held):
        energy = {}
        for k in (-2, -1, 1, 2):
            moved = u.copy()
            moved[i, c] += k * step
            system.set_displacement(moved)
            energy[k] = system.potential_energy(none)[0]
        slope = (energy[-2] - 8 * energy[-1] + 8 * energy[1] - energy[2]) / (12 * step)
        assert slope == pytest.approx(-got[i, c], abs=1e-9)
