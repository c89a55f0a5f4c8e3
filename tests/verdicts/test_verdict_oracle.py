"""What examines a state: residual, reactions, inertia and balance against states that are known, right and wrong; the tracer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from run_files import with_fields
from scipy import sparse

import taichi_membrane as tm
from taichi_membrane.assurance.verdicts import bench, catalogue, columns, fabrics, meshes, oracle, snaps, trace, tubes
from taichi_membrane.assurance.verdicts.building import in_balance
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case
from taichi_membrane.assurance.verdicts.judge import faults
from taichi_membrane.simulation import analysis
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_model
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def run(case: Case, **solver: float) -> RunResult:
    problem = case.problem(1)
    problem = replace(problem, scene={**problem.scene, "solver": solver})
    return tm.run(bench.scene_of(problem), mesh=problem.mesh, render=False)


def test_inertia_of_made_up_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dense and sparse agree, with badly scaled freedoms; zero eigenvalues are not negative."""
    rng = np.random.default_rng(1)
    vectors = np.linalg.qr(rng.standard_normal((40, 40)))[0]
    scale = 10.0 ** rng.uniform(-4.0, 4.0, 40)
    for negative in (0, 1, 7):
        values = np.concatenate((-rng.uniform(0.01, 1.0, negative), np.zeros(3), rng.uniform(0.01, 1.0, 37 - negative)))
        matrix = scale[:, None] * (vectors * values) @ vectors.T * scale
        matrix = sparse.csr_matrix(0.5 * (matrix + matrix.T))
        monkeypatch.setattr(oracle, "_DENSE", 100)
        assert oracle.negative_eigenvalues(matrix) == negative
        monkeypatch.setattr(oracle, "_DENSE", 0)
        assert oracle.negative_eigenvalues(matrix) == negative


def test_a_tent_pressed_flat_is_unstable() -> None:
    """Upright beyond h = r/√3 the only free direction is unstable; the hanging tent is stable again."""
    result = run(catalogue.CASES["tent_path_6_0.1_force_2"])
    model = build_model(result.scene, result.mesh)
    work = analysis.ready(model)
    for height, negative in ((0.99, 0), (0.59, 0), (0.56, 1), (-0.56, 1), (-0.59, 0)):
        displacement = np.zeros_like(result.mesh.points)
        displacement[0, 2] = 0.1 * (height - 1.0)
        state = oracle.examine(work, model, with_fields(result.steps[-1], displacement=displacement))
        assert state.negative == negative, height


def test_a_state_that_is_moved_is_out_of_balance_and_its_reactions_are_not_those_told() -> None:
    result = run(catalogue.CASES["strip_8_0.02_0.01"], tolerance=1e-10)
    model = build_model(result.scene, result.mesh)
    work = analysis.ready(model)
    last = result.steps[-1]
    good = oracle.examine(work, model, last)
    assert good.residual <= 1e-7
    assert good.reactions <= 1e-12
    moved = np.where(
        model.structure.node_held, 0.0, 1e-4 * np.random.default_rng(0).standard_normal(last.displacement.shape)
    )
    bad = oracle.examine(work, model, with_fields(last, displacement=last.displacement + moved))
    assert bad.residual > 1e-3
    assert bad.reactions > 1e-4
    lost = oracle.examine(work, model, with_fields(last, reaction=1.001 * last.reaction))
    assert lost.reactions == pytest.approx(1e-3, rel=1e-6)


def test_balance_of_a_strip_sees_a_reaction_that_is_a_thousandth_off() -> None:
    case = catalogue.CASES["strip_8_0.02_0.01"]
    result = run(case, tolerance=1e-10)
    last, mesh = result.steps[-1], result.mesh
    found = bench.finding(case, 1, case.problem(1), result, 0.0)
    assert faults(case, replace(found, states=tuple(replace(one, tolerance=1e-6) for one in found.states))) == ()
    wrong = last.reaction.copy()
    wrong[mesh.node_groups["x_max"]] *= 1.001
    turned = last.reaction.copy()
    turned[mesh.node_groups["x_max"], 0] *= -1.0
    assert in_balance(mesh, [with_fields(last, reaction=wrong)])["forces"] > 1e-4
    assert in_balance(mesh, [with_fields(last, reaction=turned)])["moments"] > 1e-2
    changed = replace(result, steps=(with_fields(last, reaction=wrong),))
    assert {one.kind for one in faults(case, bench.finding(case, 1, case.problem(1), changed, 0.0))} == {
        "out of balance",
        "wrong number",
    }


def test_gas_stiffens_the_tangent_as_differences_of_its_forces_say() -> None:
    problem = fabrics.shut_beam(4, 0.1, 1.4)
    result = tm.run(bench.scene_of(problem), mesh=problem.mesh, render=False)
    model = build_model(result.scene, result.mesh)
    work = analysis.ready(model)
    last = result.steps[-2]
    oracle.place(work, model, last)
    matrix = oracle.tangent(work, model, last)
    free = ~model.structure.node_held.ravel()
    way = np.where(~model.structure.node_held, np.random.default_rng(2).standard_normal(last.displacement.shape), 0.0)

    def volume(step: float) -> float:
        places = result.mesh.points + last.displacement + step * way
        corners = places[result.mesh.triangles] - places.mean(axis=0)
        return float(np.linalg.det(corners).sum() / 6.0)

    def force(step: float) -> np.ndarray:
        absolute = (last.pressures["inside"] + 0.1) * (volume(0.0) / volume(step)) ** 1.4
        pressed = with_fields(last, displacement=last.displacement + step * way)
        pressed = replace(pressed, drivers={**last.drivers, "pressure.inside": absolute - 0.1})
        oracle.place(work, model, pressed)
        return work.system.out_of_balance().ravel()[free]

    # So near that no element begins or ends to wrinkle in between: with 1e-6 some do.
    slope = -(force(1e-7) - force(-1e-7)) / 2e-7
    assert np.linalg.norm(matrix @ way.ravel()[free] - slope) < 1e-5 * np.linalg.norm(slope)


def test_a_column_beyond_its_buckling_load_is_called_unstable_whoever_says_otherwise() -> None:
    """Its straight state at 1.1 times the buckling load, passed off as a result."""
    case = catalogue.CASES["column_1000_12"]
    problem = columns.column(columns.column_mesh(1000.0, 12), 1, 5.0)
    below = tm.run(bench.scene_of(problem), mesh=problem.mesh, render=False)
    tracer = trace.Tracer(case)
    point = tracer._correct(below.steps[-1].displacement, 0.99, None)
    assert point is not None
    drivers = {**below.steps[-1].drivers, "load.tip": 0.99 * 60.0}
    step = replace(with_fields(below.steps[-1], displacement=point.position), drivers=drivers, negative_pivots=0)
    changed = replace(below, steps=(below.steps[0], step))
    found = bench.finding(replace(case, truth=UNKNOWN), 1, problem, changed, 0.0)
    assert found.states[-1].negative == point.negative > 0
    assert "unstable success" in {one.kind for one in faults(case, found)}


def test_the_tracer_finds_the_closed_form_of_tents_and_the_buckling_load_of_a_column() -> None:
    for name in ("tent_6_0.1_force_2", "tent_5_0.3_force_1.5", "tent_6_0.1_follower_2"):
        case = catalogue.CASES[name]
        tracer = trace.Tracer(case)
        found = trace.entry(case, tracer.limit(), tracer)
        assert (found["kind"], found["name"], found["branching"]) == ("limit", case.truth.name, False)
        assert found["lower"] <= case.truth.lower <= found["upper"]
        assert abs(found["upper"] - found["lower"]) <= 2e-4 * abs(case.truth.lower)
    problem = columns.column(columns.column_mesh(1000.0, 12), 1, 1.0)
    scene = {**problem.scene, "modes": {"kind": "buckling", "count": 1, "stage": "load"}}
    result = tm.run(bench.scene_of(replace(problem, scene=scene)), mesh=problem.mesh, render=False)
    modes = result.steps[-1].modes
    assert modes is not None
    tracer = trace.Tracer(catalogue.CASES["column_1000_12"])
    found = trace.entry(catalogue.CASES["column_1000_12"], tracer.limit(), tracer)
    assert found["branching"]
    assert modes.values[0] == pytest.approx(found["lower"], rel=0.02)  # linearised at 2 % of the load


def test_a_stored_truth_is_found_again() -> None:
    case = catalogue.CASES["dome_pressed"]
    tracer = trace.Tracer(case)
    found = trace.entry(case, tracer.limit(), tracer)
    truth = case.truth
    assert math.isinf(truth.lower)  # branching: a stable branch may carry more
    assert found["upper"] == pytest.approx(truth.upper, rel=2e-4)
    assert found["nodes"] == 127


def test_needles_and_scatter() -> None:
    mesh = tubes.tube_mesh(27.0)
    needle = meshes.with_needle(mesh)
    assert (needle.node_count, needle.tri_count) == (mesh.node_count + 1, mesh.tri_count + 2)
    assert needle.tri_areas().sum() == pytest.approx(mesh.tri_areas().sum(), rel=1e-6)
    edges = np.linalg.norm(np.diff(needle.points[needle.edges()], axis=1)[:, 0], axis=1)
    assert edges.min() < 2e-3 * np.median(edges)
    assert {name: len(members) for name, members in needle.tri_groups.items() if name != "all"}.keys() == {
        name for name in mesh.tri_groups if name != "all"
    }
    one, again, other = (meshes.scattered(mesh, 0.1, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.points, again.points)
    assert not np.array_equal(one.points, other.points)
    for name in ("start", "end"):
        assert np.array_equal(one.points[one.node_groups[name]], mesh.points[mesh.node_groups[name]])


def test_tents_of_other_loads_have_the_same_tip_force() -> None:
    """What the closed form of pressures and area loads rests on: the nodal force at the tip, at rest and pressed down."""
    for kind in ("follower", "fixed", "area"):
        problem = snaps.tent(6, 0.1, kind, share=1.0, steps=1)
        single = snaps.tent(6, 0.1, "force", share=1.0, steps=1)
        forces = []
        for one in (problem, single):
            model = build_model(bench.scene_of(one), one.mesh)
            work = analysis.ready(model)
            for depth in (0.0, 0.07):
                displacement = np.zeros((7, 3))
                displacement[0, 2] = -depth
                work.system.set_displacement(displacement)
                size = {name: one.scene["stages"][0].get("pressure", 0.0) for name in model.scene.pressures}
                state = LoadState.of(pressure=size, load=dict.fromkeys(model.scene.loads, 1.0))
                work.system.set_surface_loads(model.surface_values(state))
                work.system.set_loads(model.nodal_loads(state))
                forces.append(work.system.out_of_balance()[0, 2])
        assert forces[:2] == pytest.approx(forces[2:], rel=1e-9)
