"""Newton on the relaxed energy: tangent against forces, quadratic convergence, saddles left, agreement with relaxation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.preparation import FabricConstants, nodal_pressure
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

ISOTROPIC = {"e_warp": 100.0, "e_weft": 100.0, "poisson": 0.3, "shear": 100.0 / 2.6, "thickness": 0.1}
ORTHOTROPIC = {"e_warp": 100.0, "e_weft": 20.0, "poisson": 0.3, "shear": 5.0, "thickness": 0.1}


def structure(mesh: Mesh, fabric: FabricConstants, held: np.ndarray, frame: np.ndarray | None = None) -> Structure:
    """One fabric, one follower pressure on everything, no dead loads."""
    assert mesh.tri_warp is not None
    zeros = np.zeros(mesh.tri_count, dtype=np.int32)
    return Structure(
        mesh=mesh, fabrics=(fabric,), tri_fabric=zeros, tri_warp=mesh.tri_warp, node_held=held,
        tri_chamber=zeros, loads=False, node_frame=frame,
    )  # fmt: skip


@pytest.mark.parametrize("side_strain", ["engineering", "green"])
@pytest.mark.parametrize(
    "moduli", [ISOTROPIC, ORTHOTROPIC | {"prestress": (0.5, 0.2, 0.1)}], ids=["isotropic", "orthotropic"]
)
@pytest.mark.parametrize("slanted", [False, True])
def test_tangent_is_the_derivative_of_the_forces(moduli: dict[str, Any], side_strain: Any, slanted: bool) -> None:
    """Central differences of the out-of-balance forces, in a crumpled state that has taut, wrinkled and slack triangles."""
    mesh = shapes.sphere(radius=1.0, divisions=2)
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    held[3], held[5, 1] = True, True
    frame = None
    if slanted:
        random_axes = np.random.default_rng(1).normal(size=(mesh.node_count, 3, 3))
        frame = np.linalg.qr(random_axes)[0]
    system = System(structure(mesh, FabricConstants(**moduli, side_strain=side_strain), held, frame))
    system.set_surface_loads(np.array([0.7]))
    start = np.random.default_rng(0).normal(size=mesh.points.shape) * 0.05
    tangent = Tangent(system)
    system.set_displacement(start)
    assert min(np.bincount(system.element_state().state, minlength=3)) > 0
    free = ~held.ravel()
    matrix = tangent.matrix().toarray()[np.ix_(free, free)]
    step, differences = 1e-6, np.zeros_like(matrix)
    for column, (node, axis) in enumerate(np.argwhere(~held)):
        direction = np.zeros_like(start)
        direction[node, axis] = 1.0
        forces = []
        for sign in (1.0, -1.0):
            system.set_displacement(start + sign * step * system.from_frames(direction))
            forces.append(system.in_frames(system.out_of_balance())[~held])
        differences[:, column] = (forces[1] - forces[0]) / (2 * step)
    # Truncation O(step²) and cancellation eps/step are both near 1e-10 of the stiffness.
    assert np.abs(differences - matrix).max() < 1e-8 * np.abs(matrix).max()


def test_negative_pivots_count_negative_eigenvalues() -> None:
    """Sylvester's law of inertia on a small indefinite matrix."""
    mesh = shapes.sphere(radius=1.0, divisions=2)
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    held[3], held[5, 1], held[0, :2] = True, True, True
    system = System(structure(mesh, FabricConstants(**ISOTROPIC), held))
    tangent = Tangent(system)
    system.set_surface_loads(np.array([-20.0]))  # sucked hard: the sphere is unstable
    eigenvalues = np.linalg.eigvalsh(tangent.matrix().toarray())
    assert tangent.solver.factorise(tangent.assemble()) is None
    factor = tangent.solver.factorise(tangent.assemble(), indefinite=True)
    assert factor is not None
    assert factor.negative == (eigenvalues < 0.0).sum() > 0


def test_convergence_is_quadratic() -> None:
    """Each of the last residuals is bounded by a constant times the square of the one before."""
    mesh = shapes.tube(radius=25.0, length=100.0, around=16, along=16)
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    held[mesh.node_groups["start"]] = True
    system = System(
        structure(mesh, FabricConstants(e_warp=4000, e_weft=4000, poisson=0.1, shear=4000 / 2.2, thickness=0.1), held)
    )
    system.set_surface_loads(np.array([0.35]))
    residuals: list[float] = []
    record = Newton(system, Relaxation(system)).solve(
        tolerance=1e-12,
        reference=float(np.linalg.norm(nodal_pressure(mesh, np.full(mesh.tri_count, 0.35)))),
        loads=np.zeros_like(mesh.points),
        max_iterations=20,
        report=lambda progress: residuals.append(progress.residual),
    )
    assert record.converged
    assert record.iterations <= 8
    late = [r for r in residuals if r < 1e-2]
    assert len(late) >= 3
    for before, after in pairwise(late):
        assert after < 10.0 * before**2 or after < 1e-12, residuals  # measured constants are below 1


CANTILEVER = {
    "name": "test",
    "units": {"length": "mm", "force": "N"},
    "mesh": {"shape": "tube", "radius": 25.0, "length": 200.0, "around": 12, "along": 20},
    "fabric": {"E": 4000.0, "nu": 0.1, "thickness": 0.1},
    "supports": [{"group": "start", "hold": "xyz"}],
    "loads": {"tip": {"group": "end", "direction": [0.0, 0.0, -1.0]}},
    "stages": [{"name": "inflate", "pressure": 0.035}, {"name": "load", "steps": 2, "loads": {"tip": 6.5}}],
    "probes": {"tip": {"kind": "displacement", "group": "end", "component": "z"}},
}


def test_newton_and_relaxation_find_the_same_state() -> None:
    """Tip deflection through wrinkling (0.76 of collapse), both at a residual of 1e-8, to 6 digits."""
    tips, methods = [], []
    for kind in ("newton", "relaxation", "hybrid"):
        result = run(Scene.model_validate(CANTILEVER | {"solver": {"kind": kind, "tolerance": 1e-8}}))
        assert result.converged
        tips.append(result.steps[-1].probes["tip"])
        methods.append(result.steps[-1].solver)
    assert methods[1] == "relaxation"
    assert "relaxation" not in methods[0] + methods[2]  # a step Newton handles costs none
    assert result.steps[-1].elements.count()["wrinkled"] > 0
    assert tips[0] == pytest.approx(tips[1], rel=1e-6)
    assert tips[2] == tips[0]


@pytest.mark.parametrize("kind", ["newton", "hybrid"])
def test_an_unstable_equilibrium_is_left(kind: str) -> None:
    """A strut of membrane pushed exactly along its axis stays straight by symmetry; the lower, buckled state has to be found.

    A flat strip compressed along its length by its held ends: without wrinkling (law "none") the flat state is an
    equilibrium, but not a stable one.
    """
    scene = {
        "name": "test",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "panel", "width": 10.0, "height": 10.0, "along_x": 6, "along_y": 6},
        "fabric": {"E": 1000.0, "nu": 0.0, "thickness": 0.1, "law": "none"},
        "supports": [{"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "yz"}],
        "motions": {"push": {"kind": "translation", "group": "x_max", "direction": [-1.0, 0.0, 0.0], "hold": "x"}},
        "stages": [{"name": "push", "motions": {"push": 0.5}}],
        "probes": {"reaction": {"kind": "reaction", "group": "x_max", "component": "x"}},
    }
    result = run(Scene.model_validate(scene | {"solver": {"kind": kind}}))
    assert result.converged
    flat_energy = 0.5 * 1000.0 * 0.05**2 * 10.0 * 10.0 * 0.1  # ½ E ε² volume, small strain
    assert result.steps[-1].energy is not None
    assert result.steps[-1].energy < 0.2 * flat_energy
    assert np.abs(result.steps[-1].displacement[:, 2]).max() > 0.1


def test_newton_alone_refuses_what_it_cannot_do() -> None:
    """The clipped law is not the gradient of an energy."""
    fabric = CANTILEVER["fabric"] | {"law": "clip"}  # type: ignore[operator]
    scene = Scene.model_validate(CANTILEVER | {"fabric": fabric, "solver": {"kind": "newton"}})
    with pytest.raises(InputError, match="clip"):
        run(scene)


def test_hybrid_relaxes_alone_with_the_clipped_law() -> None:
    """The fallback is recorded, not hidden."""
    fabric = CANTILEVER["fabric"] | {"law": "clip"}  # type: ignore[operator]
    result = run(Scene.model_validate(CANTILEVER | {"fabric": fabric, "stages": CANTILEVER["stages"][:1]}))  # type: ignore[index]
    assert result.converged
    assert result.steps[0].solver == "relaxation"
    assert result.steps[0].energy is None
