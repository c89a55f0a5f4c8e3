"""Loads per plan area: exact forces, their work and tangent, equilibrium on large motion, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import ISOTROPIC, closed_body
from scipy.optimize import brentq
from test_rim import modelled

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.solver_choice import chosen_solver
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

LINEAR = {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"}


def ball(**changes: Any) -> Scene:
    """A sphere held at its south pole under slanting snow, one half of it under more, with pressure inside."""
    down = [0.3, 0.2, -1.0]
    return Scene.model_validate(
        {
            "name": "ball",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "sphere", "radius": 1.0, "divisions": 3},
            "groups": {"foot": {"where": "z < -0.3"}, "half": {"where": "x > 0", "kind": "elements"}},
            "fabric": LINEAR,
            "supports": [{"group": "foot", "hold": "xyz"}],
            "loads": {
                "snow": {"kind": "snow", "direction": down},
                "drift": {"kind": "snow", "direction": down, "group": "half"},
            },
            "stages": [{"name": "fall", "pressure": 1.0, "loads": {"snow": 0.2, "drift": 0.3}}],
            "probes": {"z": {"kind": "displacement", "group": "north", "component": "z"}},
            "derivatives": ["z"],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def crumpled(scene: Scene, values: list[float], size: float = 0.03) -> tuple[Newton, Floats]:
    """Newton at a random state, and that state."""
    system = System(modelled(scene).structure)
    newton = Newton(system, Relaxation(system))
    u = size * np.random.default_rng(1).standard_normal(newton.free.shape) * newton.free
    system.set_surface_loads(np.array(values))
    system.set_displacement(u)
    return newton, u


def whole_tangent(newton: Newton, u: Floats) -> tuple[Floats, Floats]:
    """The tangent with its skew part, and central differences of the forces; over the free components."""
    skew = newton.skew()
    assert skew is not None
    identity = np.eye(u.size).reshape(-1, *u.shape)
    whole = newton.tangent.matrix().toarray() + np.array([skew.times(column).ravel() for column in identity]).T
    assert np.abs(whole - newton.tangent.matrix().toarray()).max() > 0.0
    free, step = np.flatnonzero(newton.free.ravel()), 1e-6
    differences = np.zeros_like(whole)
    for k in free:
        forces = []
        for sign in (1.0, -1.0):
            newton.system.set_displacement(u + sign * step * identity[k])
            forces.append(newton.free_force().ravel())
        differences[:, k] = (forces[1] - forces[0]) / (2 * step)
    newton.system.set_displacement(u)
    part = np.ix_(free, free)
    return whole[part], differences[part]


def assert_work(newton: Newton, u: Floats, size: float, rel: float, least: float, pieces: int = 400) -> None:
    """Energy and what goes beyond it fall by the work of the forces along a straight step, by quadrature."""
    loads = np.zeros_like(u)
    step = size * np.random.default_rng(3).standard_normal(u.shape) * newton.free
    # Composite: a kink where a triangle turns over spoils one interval alone.
    points, weights = np.polynomial.legendre.leggauss(4)
    work = 0.0
    for k in range(pieces):
        for point, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
            newton.system.set_displacement(u + (k + point) / pieces * step)
            work += weight / pieces * float(np.vdot(newton.free_force(), step))
    newton.system.set_displacement(u)
    before, skew = newton.system.potential_energy(loads)[0], newton.skew()
    assert skew is not None
    newton.system.set_displacement(u + step)
    lost = before - newton.system.potential_energy(loads)[0]
    assert lost - skew.work_beyond(u + step) == pytest.approx(work, rel=rel)
    assert abs(lost - work) > least * abs(work)
    assert skew.work_beyond(u) == 0.0


def test_the_force_is_the_load_times_the_plan_area_of_what_faces_it() -> None:
    """At rest and far from it; it lies along the direction, and what is turned away bears nothing."""
    scene = ball()
    model = modelled(scene)
    system = System(model.structure)
    mesh, down = model.structure.mesh, np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0])
    u = 0.3 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    for displacement in (np.zeros_like(u), u):
        system.set_displacement(displacement)
        system.set_surface_loads(np.zeros(3))
        before = system.out_of_balance()
        system.set_surface_loads(np.array([0.0, 0.2, 0.3]))
        force = system.out_of_balance() - before
        a, b, c = (mesh.points + displacement)[mesh.triangles].transpose(1, 0, 2)
        plan = np.maximum(-0.5 * np.cross(b - a, c - a) @ down, 0.0)
        share = 0.2 + 0.3 * (mesh.points[mesh.triangles].mean(axis=1)[:, 0] > 0.0)
        assert np.abs(force - np.outer(force @ down, down)).max() < 1e-13
        assert (force @ down).sum() == pytest.approx(float(share @ plan), rel=1e-12)
    at_rest = sum(model.surface.at_rest(name) * value for name, value in {"snow": 0.2, "drift": 0.3}.items())
    system.set_displacement(np.zeros_like(u))
    assert np.abs(system.out_of_balance() - at_rest).max() < 1e-13


def test_the_whole_tangent_is_the_derivative_of_the_forces() -> None:
    """A crumpled state by central differences to 1e-8 of the tangent, and 1e-6 of the snow's own part of it."""
    newton, u = crumpled(ball(), [1.0, 0.2, 0.3])
    whole, differences = whole_tangent(newton, u)
    assert np.abs(differences - whole).max() < 1e-8 * np.abs(whole).max()
    only, v = crumpled(ball(fabric=LINEAR | {"E": 1e-9}), [0.0, 0.2, 0.3])
    whole, differences = whole_tangent(only, v)
    assert np.abs(differences - whole).max() < 1e-6 * np.abs(whole).max()
    assert np.abs(whole - whole.T).max() > 0.3 * np.abs(whole).max()  # nowhere a potential


def test_what_newton_lowers_is_minus_the_work_along_the_step() -> None:
    """On a closed surface, with triangles that turn over on the way; to 1e-7 of a quadrature of the forces."""
    newton, u = crumpled(ball(), [1.0, 0.2, 0.3])
    assert_work(newton, u, 0.05, 1e-9, 1e-5)
    only, u = crumpled(ball(fabric=LINEAR | {"E": 1e-9}), [0.0, 0.2, 0.3])
    assert_work(only, u, 0.8, 1e-7, 0.9, 2000)


def test_solves_are_exact() -> None:
    newton, u = crumpled(ball(), [1.0, 0.2, 0.3], 1e-3)
    factor, skew = newton.factorised(indefinite=True), newton.skew()
    assert factor is not None
    assert skew is not None
    matrix = newton.tangent.matrix()
    right = np.where(newton.free, np.random.default_rng(2).standard_normal(u.shape), 0.0)
    for transposed, x in ((False, factor.solve(right)), (True, factor.solve_transposed(right))):
        product = (matrix @ x.ravel()).reshape(x.shape) + skew.times(x, transposed=transposed)
        assert np.linalg.norm(product - right) < 1e-9 * np.linalg.norm(right)


def test_equilibrium_converges_quadratically_and_derivatives_are_exact() -> None:
    """No energy is told; relaxation finds the same state."""
    drop = [
        {"name": "fall", "pressure": 1.0, "loads": {"snow": value, "drift": 0.3}} for value in (0.2, 0.2002, 0.1998)
    ]
    step, more, less = (run(ball(stages=[stage])).steps[-1] for stage in drop)
    assert step.converged
    assert step.iterations <= 12
    assert step.energy is None
    difference = (more.probes["z"] - less.probes["z"]) / 4e-4
    assert step.derivatives["z"]["load.snow"] == pytest.approx(difference, rel=1e-6)
    relaxed = run(ball(derivatives=[], solver={"kind": "relaxation", "tolerance": 1e-9})).steps[-1]
    assert relaxed.converged
    assert np.abs(relaxed.displacement - step.displacement).max() < 1e-7


def band(pieces: int) -> Scene:
    """A flat strip 10 long of stiffness 300 per width, snow 2 per plan area between its held ends."""
    return Scene.model_validate(
        {
            "name": "band",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 10.0, "height": 0.5, "along_x": pieces, "along_y": 1},
            "fabric": {"E": 300.0, "nu": 0.0, "thickness": 1.0, "law": "none", "side_strain": "engineering"},
            "supports": [
                {"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}, {"group": "all", "hold": "y"},
            ],
            "loads": {"snow": {"kind": "snow"}},
            "stages": [{"name": "fall", "loads": {"snow": 2.0}}],
            "solver": {"tolerance": 1e-10},
        }
    )  # fmt: skip


def test_a_strip_under_snow_hangs_in_a_parabola() -> None:
    """Load per plan length makes z = s x (L - x)/(2 H) whatever the stretch; H by the elastic length, T = EA (l - L)/L.

    dx/dS = (1 + T/EA) H/T at the unstressed place S, so L = ∫ dx √(1 + z'²)/(1 + T/EA), T = H √(1 + z'²). Second order; 0.03 %.
    """
    load, stiffness, length = 2.0, 300.0, 10.0
    x, weight = np.polynomial.legendre.leggauss(60)
    x, weight = 0.5 * length * (x + 1.0), 0.5 * length * weight

    def missing(h: float) -> float:
        arc = np.hypot(1.0, load * (0.5 * length - x) / h)
        return float(weight @ (arc / (1.0 + h * arc / stiffness))) - length

    h = brentq(missing, 1.0, 1e3, xtol=1e-13)
    errors = []
    for pieces in (16, 32, 64):
        result = run(band(pieces))
        assert result.converged, result.steps[-1].reason
        step = result.steps[-1]
        pull = abs(step.reaction[result.mesh.node_groups["x_min"], 0].sum()) / 0.5
        errors.append([abs(pull / h - 1.0), abs(-step.displacement[:, 2].min() / (load * length**2 / (8.0 * h)) - 1.0)])
        assert step.reaction[:, 2].sum() == pytest.approx(load * length * 0.5, rel=1e-8)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert max(errors[-1]) < 3e-4


def test_where_nothing_lies_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """No field and no branch without such a load, nor with one that no stage uses; both with it."""

    def names(structure: Any) -> set[str]:
        return {name for name, _ in System(structure).fields()} & {"tri_snow", "snow_direction", "tri_wind"}

    plain = closed_body(ISOTROPIC)
    assert names(plain) == set()
    assert names(modelled(ball(stages=[{"name": "fall", "pressure": 1.0}])).structure) == set()
    snowy = modelled(ball()).structure
    assert names(snowy) == {"tri_snow", "snow_direction"}
    assert "snow (load per plan area)" in snowy.features().describe()[0]
    assert "snow (load per plan area)" in plain.features().describe()[1]


def test_bad_snow_is_named(tmp_path: Path) -> None:
    two = {"a": {"kind": "snow"}, "b": {"kind": "snow", "direction": [0, 1, -1]}}
    with pytest.raises(
        ValueError, match=r"loads\.b\.direction = \[0\.0, 1\.0, -1\.0\], but loads\.a\.direction = \[0\.0, 0"
    ):
        ball(loads=two, stages=[{"name": "fall"}])
    ball(loads={"a": {"kind": "snow"}, "b": {"kind": "snow", "direction": [0, 0, -3]}}, stages=[{"name": "fall"}])
    lost = ball(loads={"a": {"kind": "snow", "group": ["half", "roof"]}}, stages=[{"name": "fall"}])
    with pytest.raises(InputError, match=r"loads\.a\.group: no element group 'roof' in this mesh; allowed: all, half"):
        build_model(lost, build_mesh(lost))
    modes = ball(derivatives=[], modes={"kind": "buckling"})
    with pytest.raises(
        InputError, match=r"'buckling' needs a symmetric.*stage fall, a load per plan area on \d+ elements"
    ):
        chosen_solver(modelled(modes))
