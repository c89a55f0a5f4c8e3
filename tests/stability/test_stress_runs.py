"""The cheapest stress cases, run; what they found wrong once, and mended."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from taichi_membrane.assurance.stability import catalogue, structures
from taichi_membrane.assurance.stability.case import CONVERGED, HONEST, STABLE_EIGENVALUE, WRONG, Bench, Problem, judge
from taichi_membrane.assurance.stability.sweep import sweep
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.solvers import relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")


@pytest.fixture(scope="module")
def bench() -> Bench:
    """One bench, so that problems of one mesh share their kernels."""
    return Bench("f64")


def test_a_sphere_blown_up_a_thousandfold(bench: Bench) -> None:
    """Every solver, from p R/(E t) = 1 to 1e4 in one step; the largest load stiffness needs Newton's largest shift."""
    case = catalogue.CASES["burst"]()
    judged = judge(case, sweep(bench, "burst", ("newton", "hybrid", "relaxation"), full=False))
    assert len(judged) == 3 * len(case.levels)
    assert [one.why for one in judged if one.verdict != CONVERGED] == []
    eigenvalues = [one.entry.eigenvalue for one in judged]
    assert all(value is not None and 0.5 < value <= STABLE_EIGENVALUE for value in eigenvalues), eigenvalues


def test_newton_alone_steps_where_the_load_stiffness_outweighs_the_fabric(bench: Bench) -> None:
    """At p R/(E t) = 1000 the tangent at rest is definite only with a shift above 2 M (its lowest eigenvalue is -2.2 M)."""
    problem = catalogue.CASES["burst"]().problem(1e3)
    work = bench._taken(bench._model(problem, "newton"))
    work.system.set_surface_loads(np.array([1e3]))
    record = work.newton.solve(
        tolerance=1e-6, reference=1e3, loads=np.zeros((work.system.node_count, 3)), max_iterations=100
    )
    assert (record.converged, record.reason) == (True, "residual")


def test_a_flat_cushion_under_hardly_any_pressure(bench: Bench) -> None:
    """Newton's patience runs out twice before the hybrid's last turn, which must be as long as Newton's alone."""
    case = replace(catalogue.CASES["flat"](), levels=(1e-5,), required=1e-5)
    (one,) = judge(case, [bench.run(case, 1e-5, "hybrid")])
    assert (one.verdict, one.why) == (CONVERGED, "")
    assert one.entry.iterations > 60 + 500 + 60 + 3000  # both doses of relaxation, and more than Newton had before


def test_shared_kernels_change_no_bit(bench: Bench) -> None:
    """A structure put into compiled kernels, after another one was solved there, gives what a run of its own gives."""

    def ball(size: float, modulus: float) -> Problem:
        data = structures.ball(0.1, fabric={"E": modulus, "nu": 0.3, "thickness": 0.5})
        return Problem(scene=data, mesh=structures.ball_mesh(size, divisions=6), measure=volume)

    def volume(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
        return {"volume": steps[-1].volume}

    case = replace(catalogue.CASES["burst"](), problem=lambda level: ball(level, level))
    bench.run(case, 1.0, "newton")
    compiled = list(bench._compiled)
    shared = bench.run(case, 3.0, "newton")
    assert bench._compiled == compiled
    own = case.problem(3.0)
    data = {"name": "case", "units": {"length": "m", "force": "N"}, **own.scene, "solver": {"kind": "newton"}}
    alone = run(Scene.model_validate(data), mesh=own.mesh)
    assert shared.values == {"volume": alone.steps[-1].volume}
    assert shared.energy == alone.steps[-1].energy
    assert shared.iterations == sum(step.iterations for step in alone.steps)


def test_a_step_that_fails_names_the_worst_nodes_and_element(bench: Bench) -> None:
    """Relaxation with a few iterations: an honest failure, the start kept, nodes and element of the mesh in the reason."""
    inflating = catalogue.CASES["burst"]().problem(1.0)
    problem = replace(inflating, scene={**inflating.scene, "solver": {"max_iterations": 20}})
    case = replace(catalogue.CASES["burst"](), problem=lambda _: problem)
    (one,) = judge(case, [bench.run(case, 1.0, "relaxation")])
    assert one.verdict == HONEST
    assert one.entry.kept
    found = re.search(
        r"iteration limit, 1 halvings.*nodes (\d+), (\d+), (\d+); largest strain: (\S+) in element (\d+); the last",
        one.why,
    )
    assert found, one.why
    assert problem.mesh is not None
    assert len(set(found.groups()[:3])) == 3
    assert all(int(node) < problem.mesh.node_count for node in found.groups()[:3])
    assert int(found[5]) < problem.mesh.tri_count
    assert float(found[4]) > 0.01  # that of the failed try, not of the state kept


def test_forces_whose_squares_vanish_are_not_taken_for_equilibrium(bench: Bench) -> None:
    """Single precision squares 1e-23 to zero: a structure of nanometres. Here the same in double precision: forces of 1e-170."""
    extensions = []
    for unit in (1.0, 1e-170):
        problem = Problem(scene=structures.ball(0.5), mesh=structures.ball_mesh(divisions=6), measure=lambda *_: {})
        model = bench._model(problem, "relaxation")
        (fabric,) = model.structure.fabrics
        # A scene admits no such moduli, but the engine has no scale of its own.
        soft = replace(fabric, e_warp=unit, e_weft=unit, shear=unit / 2.6)
        work = bench._taken(replace(model, structure=replace(model.structure, fabrics=(soft,))))
        work.system.set_surface_loads(np.array([0.5 * unit]))
        record = work.relaxation.solve(tolerance=1e-6, reference=unit, max_iterations=2000)
        assert record.converged
        extensions.append(work.system.displacement())
    assert np.abs(extensions[0]).max() > 0.1
    np.testing.assert_allclose(extensions[1], extensions[0], atol=1e-12)


def test_a_path_that_is_not_concave_bounds_no_collapse(bench: Bench) -> None:
    """Just below collapse, where tangents of the path once met below both points and gave an upper bound under the lower one."""
    case = catalogue.CASES["collapse"]()
    entry = bench.run(case, 1.0485, "hybrid")
    (one,) = judge(case, [entry])
    assert (one.verdict, one.why) == (CONVERGED, "")
    assert entry.moved is not None
    assert entry.moved < 1e-3


def test_a_jump_beyond_a_limit_is_told_as_collapse(bench: Bench) -> None:
    """Past the largest moment, where Newton reaches the fallen beam without meeting an indefinite tangent on its way."""
    case = catalogue.CASES["moment"]()
    entry = bench.run(case, 0.9, "hybrid")
    (one,) = judge(case, [entry])
    assert one.verdict == HONEST
    found = re.search(r"load\.pull between (\S+) and (\S+),", one.why)
    assert found, one.why
    # Small steps follow the path to 0.86700.
    assert 0.86700 * (1.0 - 1e-3) < float(found[1]) < float(found[2]) < 0.86700 * (1.0 + 1e-3)


def test_relaxation_takes_no_small_residual_for_equilibrium(bench: Bench) -> None:
    """A sheet that hardly changes its area: a residual of 1e-6 of the load leaves strains as large as those that it strains by.

    At 1 - ν = 1e-8 the residual is that small after 100 iterations, when nothing is seen of the slow modes yet.
    """
    case = catalogue.CASES["poisson"]()

    def problem(level: float) -> Problem:
        data = case.problem(level)
        return replace(data, scene={**data.scene, "solver": {"max_iterations": 2000, "max_cuts": 0}})

    short = replace(case, problem=problem)
    for one in judge(short, [bench.run(short, level, "relaxation") for level in (1e-6, 1e-8)]):
        assert one.verdict == HONEST, one.why
        assert re.search(r"displacements may be \S+ % from equilibrium, though the residual is small", one.why)


def test_relaxation_goes_on_from_a_state_that_the_energy_refuses_as_if_it_had_not_been_asked(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = catalogue.CASES["burst"]().problem(1.0)
    work = bench._taken(bench._model(problem, "relaxation"))
    work.system.set_surface_loads(np.array([1.0]))
    shares = [4.0 * relaxation._SETTLED_SHARE, 0.0]  # half the residual is asked for, which then is good enough
    refused: list[float] = []

    def once(*_: object) -> float:
        refused.append(float(work.relaxation.control[None].residual))
        return shares.pop(0)

    monkeypatch.setattr(work.relaxation, "_unsettled", once)
    twice = work.relaxation.solve(tolerance=1e-6, reference=1.0, max_iterations=2000)
    found = work.system.displacement()
    monkeypatch.undo()
    work.system.set_displacement(np.zeros_like(found))
    at_once = work.relaxation.solve(tolerance=0.5 * refused[0], reference=1.0, max_iterations=2000)
    assert (twice.converged, at_once.converged, len(refused)) == (True, True, 2)
    assert twice.iterations == at_once.iterations + 1  # one was looked at twice
    assert np.array_equal(work.system.displacement(), found)


def test_the_collapse_that_the_default_solver_tells_holds_the_largest_stable_load(bench: Bench) -> None:
    case = catalogue.CASES["collapse"]()
    entry = bench.run(case, 1.06, "hybrid")
    assert [(one.name, one.target, one.known) for one in entry.brackets] == [("load.tip", 1.06, 1.049836)]
    (one,) = judge(case, [entry])
    assert (one.verdict, one.why[:9]) == (HONEST, "collapse:")
    shifted = [replace(entry.brackets[0], known=known) for known in (1.048, 1.051)]
    assert {judge(case, [replace(entry, brackets=(other,))])[0].verdict for other in shifted} == {WRONG}


def test_a_tent_up_to_its_exact_limit_and_beyond(bench: Bench) -> None:
    """At 0.999 of it every solver finds the exact height; beyond, the far side, or a bracket that holds the limit."""
    case = catalogue.CASES["snap"]()
    found = [bench.run(case, level, solver) for level in (0.999, 1.01) for solver in ("hybrid", "relaxation")]
    assert [one.verdict for one in judge(case, found)] == [CONVERGED, CONVERGED, HONEST, CONVERGED]
    (bracket,) = found[2].brackets
    assert bracket.lower < bracket.known == 1.0 < bracket.upper < 1.001


@pytest.mark.parametrize("solver", ["newton", "hybrid"])
def test_a_crumpled_start_foretells_nothing(bench: Bench, solver: str) -> None:
    """A dome blown up from folds that carry nothing: no tangent tells where it goes, and no path begins there."""
    case = catalogue.CASES["inverted"]()
    levels = (0.0, 0.25, 0.5, 0.75)
    judged = judge(case, [bench.run(case, level, solver) for level in levels])
    assert [(one.entry.level, one.why) for one in judged if one.verdict != CONVERGED] == []
