"""Follower pressure without a potential: the exact unsymmetric tangent, the work that Newton lowers, adjoints, and where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.rim import SkewFactor
from taichi_membrane.mechanics.system import System
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import Model, build_mesh, build_model
from taichi_membrane.simulation.solver_choice import chosen_solver, without_potential
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def tube(*, wall: float = 0.6, cap: float = 1.2, tip: float = 0.3, **changes: Any) -> Scene:
    """A tube with one pressure on its wall and another on its cap."""
    return Scene.model_validate(
        {
            "name": "tube",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": 1.0, "length": 4.0, "around": 10, "along": 8, "cap_end": "hemisphere"},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
            "supports": [{"group": "start", "hold": "xyz"}],
            "pressures": {"wall": {"group": "wall"}, "cap": {"group": "cap_end"}},
            "loads": {"tip": {"group": "end", "direction": [0.0, 0.0, -1.0]}},
            "stages": [{"name": "load", "pressure": {"wall": wall, "cap": cap}, "loads": {"tip": tip}}],
            "probes": {"z": {"kind": "displacement", "group": "end", "component": "z"}},
            "derivatives": ["z"],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def sail(pressure: float, *, symmetric: bool = False, divisions: int = 4, **changes: Any) -> Scene:
    """A prestressed sheet held on three sides; the fourth is free, or slides in a plane of symmetry."""
    held = [{"group": group, "hold": "xyz"} for group in ("x_min", "x_max", "y_min")]
    return Scene.model_validate(
        {
            "name": "sail",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": divisions, "along_y": divisions},
            "fabric": {
                "E": 1000.0,
                "nu": 0.3,
                "thickness": 0.01,
                "prestress": [10.0, 10.0, 0.0],
                "warp": [1, 0, 0],
                "law": "none",
            },
            "supports": [*held, {"group": "y_max", "hold": "y"}] if symmetric else held,
            "stages": [{"name": "blow", "pressure": pressure}],
            "probes": {axis: {"kind": "displacement", "group": "y_max", "component": axis} for axis in "yz"},
            "derivatives": ["y", "z"],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def modelled(scene: Scene) -> Model:
    """The model of a scene."""
    return build_model(scene, build_mesh(scene))


def crumpled(scene: Scene, pressures: list[float]) -> tuple[Newton, Floats]:
    """Newton at a random state, and that state."""
    model = modelled(scene)
    system = System(model.structure)
    newton = Newton(system, Relaxation(system))
    u = 0.03 * np.random.default_rng(1).standard_normal(newton.free.shape) * newton.free
    system.set_surface_loads(np.array(pressures))
    system.set_displacement(u)
    return newton, u


def test_the_whole_tangent_is_the_derivative_of_the_forces_and_its_solves_are_exact() -> None:
    """A free rim, a crumpled state: central differences to 1e-8, where the symmetric part alone is off; solves of K and of Kᵀ."""
    newton, u = crumpled(sail(0.5), [0.5])
    skew = newton.skew()
    assert skew is not None
    whole = symmetric = newton.tangent.matrix().toarray()
    identity = np.eye(u.size).reshape(-1, *u.shape)
    whole = symmetric + np.array([skew.times(column).ravel() for column in identity]).T
    free, step = newton.free.ravel(), 1e-6
    differences = np.zeros_like(whole)
    for k in np.flatnonzero(free):
        forces = []
        for sign in (1.0, -1.0):
            newton.system.set_displacement(u + sign * step * identity[k])
            forces.append(newton.free_force().ravel())
        differences[:, k] = (forces[1] - forces[0]) / (2 * step)
    part = np.ix_(free, free)
    scale = 0.5 / 4  # the pressure's own stiffness: p times the length of a side
    assert np.abs(differences - whole)[part].max() < 1e-8 * np.abs(whole).max()
    assert np.abs(differences - symmetric)[part].max() > 0.05 * scale
    newton.system.set_displacement(u)
    factor = newton.factorised(indefinite=True)
    assert isinstance(factor, SkewFactor)
    right = np.where(newton.free, np.random.default_rng(2).standard_normal(u.shape), 0.0)
    for matrix, solution in ((whole, factor.solve(right)), (whole.T, factor.solve_transposed(right))):
        assert np.linalg.norm(matrix @ solution.ravel() - right.ravel()) < 1e-9 * np.linalg.norm(right)
    assert factor.residual(factor.solve(right), right) < 1e-13
    eigenvalues = np.linalg.eigvals(whole[part])
    real = np.abs(eigenvalues.imag) < 1e-9 * np.abs(eigenvalues)
    assert factor.negative == (real & (eigenvalues.real < 0.0)).sum()


@pytest.mark.parametrize("name", ["tube", "sail"])
def test_the_merit_is_minus_the_work_along_the_step(name: str) -> None:
    """Against a quadrature of the forces along the straight way; the energy difference alone is off."""
    scene, pressures = (tube(), [0.6, 1.2]) if name == "tube" else (sail(0.5), [0.5])
    linear = {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"}
    newton, u = crumpled(Scene.model_validate({**scene.model_dump(), "fabric": linear}), pressures)
    loads = np.zeros_like(u)
    step = 0.05 * np.random.default_rng(3).standard_normal(u.shape) * newton.free
    points, weights = np.polynomial.legendre.leggauss(12)
    work = 0.0
    for point, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
        newton.system.set_displacement(u + point * step)
        work += weight * float(np.vdot(newton.free_force(), step))
    newton.system.set_displacement(u)
    before, skew = newton.system.potential_energy(loads)[0], newton.skew()
    assert skew is not None
    newton.system.set_displacement(u + step)
    lost = before - newton.system.potential_energy(loads)[0]
    assert lost - skew.work_beyond(u + step) == pytest.approx(work, rel=1e-9)
    assert abs(lost - work) > 1e-5 * abs(work)
    assert skew.work_beyond(u) == 0.0


def test_two_pressures_side_by_side_converge_and_their_derivatives_are_exact() -> None:
    """A load step that took 734 iterations, with derivatives off by 4 to 6 %; with equal pressures there is a potential again."""
    step = run(tube()).steps[-1]
    assert step.converged
    assert step.iterations <= 20
    assert step.energy is None
    assert step.negative_pivots == 0
    for parameter, more, less in (
        ("load.tip", tube(tip=0.3003), tube(tip=0.2997)),
        ("pressure.cap", tube(cap=1.2003), tube(cap=1.1997)),
    ):
        difference = (run(more).steps[-1].probes["z"] - run(less).steps[-1].probes["z"]) / 6e-4
        assert step.derivatives["z"][parameter] == pytest.approx(difference, rel=1e-6)
    equal = run(tube(cap=0.6)).steps[-1]
    assert equal.converged
    assert equal.energy is not None


@pytest.mark.parametrize("pressure", [0.02, 0.5, 5.0])
def test_a_free_rim_converges_quadratically_and_its_derivatives_are_exact(pressure: float) -> None:
    """Derivatives were off by 1 to 5 %, and Newton found no descent."""
    step = run(sail(pressure)).steps[-1]
    assert step.converged
    assert step.iterations <= 12
    more, less = (run(sail(pressure * (1.0 + share))).steps[-1] for share in (1e-4, -1e-4))
    for probe in "yz":
        difference = (more.probes[probe] - less.probes[probe]) / (2e-4 * pressure)
        assert step.derivatives[probe]["pressure.inside"] == pytest.approx(difference, rel=1e-6)


def test_the_path_is_followed_where_there_is_no_potential() -> None:
    """By arc length to the same state as under load control."""
    stage = {"name": "blow", "pressure": 0.5, "control": "arc_length", "steps": 20}
    followed = run(sail(0.5, stages=[stage], derivatives=[]))
    assert followed.converged
    last = followed.steps[-1]
    # The path ends beyond the load; the state under load control there is the same.
    there = run(sail(last.pressures["inside"], derivatives=[])).steps[-1]
    assert np.abs(last.displacement - there.displacement).max() < 1e-8


def test_what_has_a_potential_is_found_from_the_mesh() -> None:
    """Closed and held rims, planes of symmetry and fixed pressure have one; free rims and jumps have none, and no modes."""
    assert without_potential(modelled(tube(wall=0.6, cap=0.6))) == ""
    assert without_potential(modelled(sail(0.5, symmetric=True))) == ""
    assert without_potential(modelled(sail(0.5, pressures={"inside": {"kind": "fixed"}}))) == ""
    assert without_potential(modelled(sail(0.5))).startswith("stage blow, 4 edges, the first from (")
    assert without_potential(modelled(tube())).startswith("stage load, 10 edges")
    shaking = sail(0.5, modes={"kind": "buckling"})
    with pytest.raises(InputError, match=r"modes.kind = 'buckling' needs a symmetric tangent.*4 edges"):
        chosen_solver(modelled(shaking))
