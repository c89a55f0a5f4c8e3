"""Rigid bodies: a map of freedoms, against differences along it and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies import ORTHOTROPIC, closed_body
from numpy.typing import NDArray

from taichi_membrane.mechanics.body import Body
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

PLATE, MAST = np.array([0, 1, 5, 7]), np.array([3, 9])
STEP = 1e-6
Floats = NDArray[np.float64]


def with_bodies(held: tuple[Any, Any] = (False, False), **parts: Any) -> Structure:
    """The body of random shape with a rigid part of four nodes about a centre off them, and a mast of two."""
    points = closed_body().mesh.points
    node_held = np.zeros((12, 3), dtype=bool)
    bodies = []
    for nodes, centre in ((PLATE, np.array([0.3, 0.1, -0.2])), (MAST, points[MAST[0]])):
        holds = np.array([[held[0]] * 3, [held[1]] * 3]) if nodes is PLATE else np.zeros((2, 3), dtype=bool)
        node_held[nodes] = True
        node_held[nodes[:2]] = holds
        bodies.append(Body(nodes=nodes, points=points[nodes], centre=centre, held=holds))
    return closed_body(ORTHOTROPIC, **{"node_held": node_held, "bodies": tuple(bodies), "loads": True, **parts})


def moved(system: System, size: float, seed: int = 0) -> Floats:
    """Random displacements in which both bodies have turned by more than a radian."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=(12, 3)) * size
    for body in system.structure.bodies:
        turn = rng.normal(size=3)
        step[body.carriers[1]] = body.radius * 1.7 * turn / np.linalg.norm(turn)
    step[~carrying(system.structure)] = 0.0
    return system.retract(np.zeros((12, 3)), step)


def carrying(structure: Structure) -> NDArray[np.bool_]:
    """Nodes that carry freedoms."""
    carries = ~structure.node_in_body
    for body in structure.bodies:
        carries[list(body.carriers)] = True
    return carries


@pytest.fixture(scope="module")
def system(runtime_cpu: Any) -> System:
    made = System(with_bodies())
    made.set_surface_loads(np.array([0.3]))
    return made


def check_differences(system: System, loads: Floats) -> None:
    """Generalised forces are those of the energy, and the tangent theirs; central differences along steps, bodies turned."""
    u, size = system.displacement(), 3 * system.node_count
    system.set_loads(loads)
    force, matrix = system.balance().ravel(), Tangent(system).matrix().toarray()
    free = (~system.structure.node_held).ravel()
    assert np.abs(matrix - matrix.T).max() < 1e-14 * np.abs(matrix).max()
    slope, differences = np.zeros(size), np.zeros((size, size))
    for k in np.flatnonzero(free):
        energies, forces = [], []
        for sign in (1.0, -1.0):
            trial = system.retract(u, sign * STEP * np.eye(size)[k].reshape(-1, 3))
            system.set_displacement(trial)
            energies.append(system.potential_energy(loads)[0])
            forces.append(system.balance().ravel())
        slope[k] = (energies[0] - energies[1]) / (2 * STEP)
        differences[:, k] = (forces[1] - forces[0]) / (2 * STEP)
    system.set_displacement(u)
    assert np.abs(slope + force)[free].max() < 1e-7 * np.abs(force).max()
    # What is left of the differences is half the moment on each body: spins do not commute.
    for body in system.structure.bodies:
        spin = slice(3 * body.carriers[1], 3 * body.carriers[1] + 3)
        x, y, z = 0.5 * force[spin] / body.radius
        differences[spin, spin] -= np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    mast = system.structure.bodies[1]
    axis, place = np.zeros(size), 3 * mast.carriers[1]
    axis[place : place + 3] = np.diff((system.structure.points + u)[MAST], axis=0)[0]
    axis /= np.linalg.norm(axis)
    assert axis @ matrix @ axis > 0.0  # where nothing acts there is some stiffness
    across = np.eye(size) - np.outer(axis, axis)
    error = (across @ (differences - matrix) @ across)[np.ix_(free, free)]
    assert np.abs(error).max() < 1e-7 * np.abs(matrix[np.ix_(free, free)]).max()


def check_masses(system: System) -> None:
    """4 M - K is positive definite over the freedoms."""
    masses = np.repeat(4.0 * Relaxation(system).masses(), 3)
    free = (~system.structure.node_held).ravel()
    matrix = Tangent(system).matrix().toarray()
    assert np.linalg.eigvalsh((np.diag(masses) - matrix)[np.ix_(free, free)]).min() > 0.0


def test_generalised_forces_come_from_the_energy_and_the_tangent_from_them(system: System) -> None:
    """Bodies turned by 1.7 radians; forces of an anisotropic fabric, pressure and dead loads."""
    system.set_displacement(moved(system, 0.05))
    check_differences(system, np.random.default_rng(1).normal(size=(12, 3)) * 0.1)


def test_masses_bound_the_stiffness(system: System) -> None:
    """In several states."""
    for seed in range(4):
        system.set_displacement(moved(system, 0.2, seed))
        check_masses(system)


def test_steps_come_back_and_compose_and_keep_bodies_rigid(system: System) -> None:
    rng = np.random.default_rng(3)
    u = moved(system, 0.1, 5)
    steps = rng.normal(size=(2, 12, 3)) * 0.5
    steps[:, ~carrying(system.structure)] = 0.0
    mast = system.structure.bodies[1]
    there = system.retract(u, steps[0])
    back = system.difference(u, there)
    assert np.abs(system.retract(u, back) - there).max() < 1e-14
    plain = np.setdiff1d(np.arange(12), mast.carriers[1])  # of a mast's spin the part along it does not count
    assert np.abs(back - steps[0])[plain].max() < 1e-14
    further = system.retract(there, steps[1])
    assert np.abs(system.retract(u, system.composed(*steps)) - further).max() < 1e-14
    for body in system.structure.bodies:
        rest, now = body.points, (system.structure.points + further)[body.nodes]
        distances = [np.linalg.norm(x[:, None] - x[None], axis=2) for x in (rest, now)]
        assert np.abs(distances[0] - distances[1]).max() < 1e-14


def test_spread_forces_come_to_the_wrench(system: System) -> None:
    system.set_displacement(moved(system, 0.1))
    wrench = np.random.default_rng(0).normal(size=(12, 3))
    wrench[~carrying(system.structure)] = 0.0
    mast = system.structure.bodies[1]
    axis = np.diff((system.structure.points + system.displacement())[MAST], axis=0)[0]
    spin = wrench[mast.carriers[1]]
    spin -= (spin @ axis) / (axis @ axis) * axis  # none about the mast
    assert np.abs(system.in_frames(system.spread(wrench)) - wrench).max() < 1e-13


def test_the_energy_does_not_depend_on_the_way(system: System) -> None:
    """A plate turned about several axes, over several ways, and back: to round-off."""
    system.set_loads(np.zeros((12, 3)))
    spin = system.structure.bodies[0].carriers[1]
    start, position = moved(system, 0.05), moved(system, 0.05)
    system.set_displacement(start)
    energy = system.potential_energy(np.zeros((12, 3)))[0]
    turns = np.random.default_rng(2).normal(size=(6, 3))
    for turn in (*turns, *-turns[::-1]):
        step = np.zeros((12, 3))
        step[spin] = turn
        position = system.retract(position, step)
    system.set_displacement(position)
    assert np.abs(position - start).max() < 1e-14
    assert system.potential_energy(np.zeros((12, 3)))[0] == pytest.approx(energy, rel=1e-12)


def balanced(solver: str, **held: Any) -> Floats:
    """Equilibrium of the loaded body with its plate clamped."""
    system = System(with_bodies(**held))
    system.set_surface_loads(np.array([0.02]))
    loads = np.random.default_rng(4).normal(size=(12, 3)) * 0.01
    system.set_loads(loads)
    relaxation = Relaxation(system)
    if solver == "newton":
        record = Newton(system, relaxation).solve(tolerance=1e-12, reference=1.0, loads=loads, max_iterations=60)
    else:
        record = relaxation.solve(tolerance=1e-10, reference=1.0, max_iterations=200_000)
    assert record.converged, record.reason
    return system.displacement()


def test_relaxation_agrees_with_newton() -> None:
    """A clamped plate, a mast that turns freely amid the fabric."""
    newton, relaxed = (balanced(solver, held=(True, True)) for solver in ("newton", "relaxation"))
    assert np.abs(newton).max() > 0.01
    assert np.abs(newton - relaxed).max() < 1e-7 * np.abs(newton).max()
