"""Solutions that know what they leave: good ones as they were, poor ones mended, bad ones refused and the reason told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy
from scipy.sparse.linalg import ArpackNoConvergence
from test_gas import sphere
from test_multifrontal import MESHES, random_system, truss
from test_path import LIMIT, tent
from test_rim import crumpled, sail, tube
from told import assert_told

from taichi_membrane.algebra import multifrontal
from taichi_membrane.algebra.krylov import gmres
from taichi_membrane.algebra.multifrontal import Factor, Multifrontal
from taichi_membrane.algebra.refinement import GOOD, SINGULAR
from taichi_membrane.arrays import Floats
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics import rim
from taichi_membrane.mechanics.coupled import CoupledFactor
from taichi_membrane.mechanics.rim import SkewFactor
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

RNG = np.random.default_rng(7)


def spoil(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Let every substitution be off by a share of its solution, differently each time, and no factor be taken for sure."""
    exact = Factor.substituted
    rng = np.random.default_rng(0)

    def off(self: Factor, right: Floats) -> Floats:
        solution = exact(self, right)
        return solution * (1.0 + share * rng.uniform(-1.0, 1.0, solution.shape))

    monkeypatch.setattr(multifrontal.Factor, "substituted", off)
    monkeypatch.setattr(multifrontal.Factor, "sure", False)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("definite", [True, False])
def test_poor_solutions_are_mended_and_bad_ones_refused(
    name: str, definite: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The factor of a random matrix: good as it is, off by 1e-5, and worthless; its product is the dense one."""
    elimination, blocks, full = random_system(MESHES[name], 1)
    shift = 50.0 if definite else 0.0
    full = full + shift * np.eye(len(full))
    factor = Multifrontal(elimination).factorise(
        blocks, np.full((MESHES[name].node_count, 3), shift), indefinite=not definite
    )
    assert factor is not None
    right = RNG.standard_normal((MESHES[name].node_count, 3))
    assert factor.times(right).ravel() == pytest.approx(full @ right.ravel(), rel=1e-13, abs=1e-12)
    assert np.array_equal(factor.solve(right), factor.substituted(right))
    assert not factor.solve(np.zeros_like(right)).any()
    condition = np.linalg.cond(full)

    def left(solution: Floats) -> float:
        return float(np.linalg.norm(full @ solution.ravel() - right.ravel()) / np.linalg.norm(right))

    spoil(monkeypatch, 1e-2 / condition)
    found = left(factor.solve(right))
    assert found <= max(GOOD, 1e-2 * left(factor.substituted(right)))
    monkeypatch.undo()
    spoil(monkeypatch, 1e3)
    assert np.isnan(factor.solve(right)).all()
    assert np.isnan(factor.solve_transposed(right, 1e-9)).all()


@pytest.mark.parametrize("name", ["tube", "disc", "two bodies"])
def test_what_pivots_are_sure_of_is_so(name: str) -> None:
    """A truss held less and less, down to round-off: where nothing is proved all is good, and not far beyond that it is not."""
    right = RNG.standard_normal((MESHES[name].node_count, 3))
    lefts = {True: [0.0], False: [0.0]}
    for shift in 10.0 ** -np.arange(15):
        elimination, blocks = truss(MESHES[name], shift, [])
        factor = Multifrontal(elimination).factorise(blocks)
        if factor is None:
            break
        left = right - factor.times(factor.substituted(right))
        lefts[factor.sure].append(float(np.linalg.norm(left) / np.linalg.norm(right)))
    assert max(lefts[True]) <= GOOD
    assert max(lefts[True]) > 1e-4 * GOOD
    assert max(lefts[False]) > GOOD
    indefinite = Multifrontal(elimination).factorise(truss(MESHES[name], 1e-6, [0, 5, 9])[1], indefinite=True)
    assert indefinite is not None
    assert not indefinite.sure


def test_a_refined_solution_is_better_than_the_substitution(monkeypatch: pytest.MonkeyPatch) -> None:
    """Off by 1e-4 in each component: 1e-8 after one step, squared; within is kept to."""
    elimination, blocks, full = random_system(MESHES["disc"], 2)
    count = MESHES["disc"].node_count
    factor = Multifrontal(elimination).factorise(blocks, np.full((count, 3), 50.0))
    assert factor is not None
    full = full + 50.0 * np.eye(len(full))
    right = RNG.standard_normal((count, 3))
    spoil(monkeypatch, 1e-4)

    def left(solution: Floats) -> float:
        return float(np.linalg.norm(full @ solution.ravel() - right.ravel()) / np.linalg.norm(right))

    assert left(factor.substituted(right)) > 1e-5
    assert left(factor.solve(right)) < 1e-7
    monkeypatch.undo()
    spoil(monkeypatch, 3e-2)
    assert GOOD < left(factor.solve(right)) < 1e-2
    assert np.isnan(factor.solve(right, GOOD)).all()


def test_solutions_with_gas_and_with_a_free_rim_are_proved_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each against its own whole matrix, and refused where its parts are spoiled."""
    newton, u = crumpled(sail(0.5), [0.5])
    skewed = newton.factorised(indefinite=True)
    scene = sphere(4, 1.4)
    work = Analysis(build_model(scene, build_mesh(scene)))
    list(work.steps())
    assert work.newton is not None
    shut = work.newton.factorised(indefinite=True)
    assert isinstance(skewed, SkewFactor)
    assert isinstance(shut, CoupledFactor)
    for factor, free in ((skewed, newton.free), (shut, work.newton.free)):
        right = np.where(free, RNG.standard_normal(free.shape), 0.0)
        solution = factor.solve(right)
        assert np.linalg.norm(factor.times(solution) - right) < 1e-9 * np.linalg.norm(right)
        assert np.isfinite(factor.solve_transposed(right)).all()
    spoil(monkeypatch, 1e3)
    for factor, free in ((skewed, newton.free), (shut, work.newton.free)):
        right = np.where(free, RNG.standard_normal(free.shape), 0.0)
        assert np.isnan(factor.solve(right)).all()
        assert np.isnan(factor.solve_transposed(right)).all()
    assert u.shape == newton.free.shape


def test_newton_tells_that_its_solutions_were_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """No step is taken with them, and the last equilibrium is kept."""
    spoil(monkeypatch, 1e3)
    result = tent([{"name": "push", "loads": {"push": 0.5 * LIMIT}}], solver={"kind": "newton", "max_cuts": 0})
    last = result.steps[-1]
    assert not last.converged
    assert f"no descent; {SINGULAR}" in last.reason
    assert not last.displacement.any()
    assert_told(result)


def test_derivatives_by_a_solution_that_is_not_good_are_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equilibrium does not need such solutions, derivatives do: off by 3e-2, mended to 1e-3."""
    scene = Scene.model_validate(tube(cap=0.6).model_dump())
    spoil(monkeypatch, 3e-2)
    result = run(scene)
    assert result.converged
    last = result.steps[-1]
    assert last.derivatives == {}
    assert last.unknown["derivatives"] == f"{SINGULAR} (more than 1e-06 of the gradient of z is left)"
    assert_told(result)


def drum(count: int = 4, cells: int = 6, **changes: Any) -> RunResult:
    """Modes of a square membrane under prestress."""
    fabric = {"E": 1e3, "nu": 0.3, "thickness": 0.01, "prestress": [2.0, 2.0, 0.0], "density": 3.0, "warp": [1, 0, 0]}
    scene = {
        "name": "drum",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": cells, "along_y": cells},
        "fabric": fabric,
        "supports": [{"group": "boundary", "hold": "xyz"}],
        "pressures": {},
        "stages": [{"name": "rest"}],
        "modes": {"kind": "vibration", "count": count},
        **changes,
    }
    return run(Scene.model_validate(scene))


def test_modes_by_refused_solutions_are_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """They say why; the state stands."""
    spoil(monkeypatch, 1e3)
    result = drum()
    last = result.steps[-1]
    assert (last.converged, last.modes, last.unknown["modes"]) == (True, None, SINGULAR)
    assert_told(result)


def test_modes_that_did_not_converge_are_told_as_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that did are kept: the run neither fails nor drops the others silently. All well, nothing is missing."""
    whole = drum().steps[-1].modes
    assert whole is not None
    assert (len(whole.values), whole.missing) == (4, "")
    lanczos = scipy.sparse.linalg.eigsh

    def two(*given: Any, **how: Any) -> Any:
        values, vectors = lanczos(*given, **how)
        order = np.argsort(values)[:2]
        raise ArpackNoConvergence("no convergence", values[order], vectors[:, order])

    monkeypatch.setattr(scipy.sparse.linalg, "eigsh", two)
    result = drum()
    found = result.steps[-1].modes
    assert result.converged
    assert found is not None
    assert found.values == whole.values[:2]
    assert found.missing == "2 of 4 modes converged"
    assert_told(result)


def test_modes_that_there_are_not_are_told_as_missing() -> None:
    """More than there are freedoms; buckling ahead of none; and none about an unstable state, which has no definite tangent."""
    few = drum(count=40, cells=3).steps[-1].modes  # four nodes inside
    assert few is not None
    assert (len(few.values), few.missing) == (12, "12 of 40 modes: there are no more degrees of freedom")
    buckling = {"kind": "buckling", "count": 1}
    lifted = tent([{"name": "lift", "loads": {"push": -0.5 * LIMIT}}], modes=buckling).steps[-1].modes
    assert lifted is not None
    assert (lifted.values, lifted.missing) == ((), "0 of the 1 found are ahead of the present load")
    stage = {"name": "push", "steps": 20, "control": "arc_length", "until": "steps", "loads": {"push": 1.2 * LIMIT}}
    followed = tent([stage], modes=buckling)
    assert_told(followed)
    unstable = [step for step in followed.steps if step.stable is False]
    assert unstable
    assert {step.unknown["modes"] for step in unstable} == {"buckling is that of a stable state"}


def test_gmres_tells_when_its_products_are_used_up() -> None:
    """And what it left; with enough of them it is exact."""
    matrix = np.eye(20) + RNG.standard_normal((20, 20))
    right = RNG.standard_normal(20)
    short = gmres(lambda x: matrix @ x, right, tolerance=1e-11, most=5)
    assert (short.enough, short.products) == (False, 5)
    assert short.left == pytest.approx(np.linalg.norm(matrix @ short.solution - right) / np.linalg.norm(right))
    assert short.left > 1e-3
    full = gmres(lambda x: matrix @ x, right, tolerance=1e-11, most=40)
    assert full.enough
    assert np.linalg.norm(matrix @ full.solution - right) < 1e-10 * np.linalg.norm(right)
    assert gmres(lambda x: x, np.zeros(3), tolerance=1e-11, most=1).enough
    none = gmres(lambda x: 0.0 * x, np.ones(3), tolerance=1e-11, most=3)
    assert not none.solution.any()
    assert none.left == 1.0


def test_newton_takes_no_step_that_gmres_did_not_finish(monkeypatch: pytest.MonkeyPatch) -> None:
    """One product is too few for the sail: its solutions are refused, and the run says by what; 400 are enough."""
    newton, _ = crumpled(sail(5.0), [5.0])
    factor = newton.factorised(indefinite=True)
    assert isinstance(factor, SkewFactor)
    right = np.where(newton.free, RNG.standard_normal(newton.free.shape), 0.0)
    assert np.isfinite(factor.solve(right)).all()
    monkeypatch.setattr(rim, "_MOST", 1)
    for solve in (factor.solve, factor.solve_transposed):
        assert np.isnan(solve(right)).all()
        assert "GMRES over the free rim left" in factor.refusal
        assert factor.refusal.endswith("after 1 products")
    monkeypatch.setattr(rim, "_MOST", 400)
    assert np.isfinite(factor.solve(right)).all()
    assert factor.refusal == SINGULAR


def test_eigenvalues_near_zero_that_were_not_found_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a tangent without a potential: how many of those looked for there are."""
    newton, _ = crumpled(sail(0.5), [0.5])
    factor = newton.factorised(indefinite=True)
    assert isinstance(factor, SkewFactor)
    assert factor.factor.negative > 0
    arnoldi = scipy.sparse.linalg.eigs

    def three(*given: Any, **how: Any) -> Any:
        values = arnoldi(*given, **how)
        values = values[(np.abs(values.imag) > 0.0) | (values.real > 0.0)][:3]
        raise ArpackNoConvergence("no convergence", values, np.zeros((0, 0)))

    monkeypatch.setattr(scipy.sparse.linalg, "eigs", three)
    assert factor.negative == 0
    assert "nearest zero, of which 3 were found: none is real and negative" in factor.doubt
