"""Shut chambers: the gas law, a sphere squeezed from outside against its closed form, and Newton's rank-one terms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

E, NU, THICKNESS, FIRST, SQUEEZE, AMBIENT = 100.0, 0.3, 0.1, 2.0, 1.5, 10.0


def sphere(divisions: int, exponent: float, **changes: Any) -> Scene:
    """A sphere of radius 1, inflated, then shut and squeezed by a dead pressure on its unstressed surface."""
    scene = {
        "name": "ball",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "sphere", "radius": 1.0, "divisions": divisions},
        "fabric": {"E": E, "nu": NU, "thickness": THICKNESS},
        "groups": {
            "on_x": {"where": "y = 0 within 1e-9 and z = 0 within 1e-9"},
            "on_y": {"where": "x = 0 within 1e-9 and z = 0 within 1e-9"},
            "on_z": {"where": "x = 0 within 1e-9 and y = 0 within 1e-9"},
        },
        "supports": [
            {"group": "on_x", "hold": "yz"}, {"group": "on_y", "hold": "xz"}, {"group": "on_z", "hold": "xy"},
        ],
        "pressures": {
            "gas": {"ambient": AMBIENT, "exponent": exponent},
            "outside": {"kind": "fixed"},
        },
        "stages": [
            {"name": "inflate", "pressure": {"gas": FIRST}},
            {"name": "squeeze", "pressure": {"outside": -SQUEEZE}, "closed": ["gas"]},
        ],
        "probes": {"radius": {"kind": "radius", "group": "all", "axis": "centre"}, "gas": {"kind": "factor", "of": "pressure.gas"}},
    }  # fmt: skip
    return Scene.model_validate(scene | changes)


def exact(exponent: float) -> tuple[float, float]:
    """Radius and pressure of the squeezed sphere: (p λ² - q) R = 2 t S λ, S = E (λ² - 1)/(2 (1 - ν)), p_abs λ^(3n) kept."""

    def load(stretch: float) -> float:
        return 2 * THICKNESS * E * (stretch**2 - 1) / (2 * (1 - NU)) * stretch

    first = brentq(lambda s: FIRST * s**2 - load(s), 1.0, 1.3)
    assert isinstance(first, float)

    def gas(stretch: float) -> float:
        return float((FIRST + AMBIENT) * (first / stretch) ** (3 * exponent) - AMBIENT)

    radius = brentq(lambda s: gas(s) * s**2 - SQUEEZE - load(s), 0.9, first)
    assert isinstance(radius, float)
    return radius, gas(radius)


def solved(divisions: int, exponent: float, kind: str = "newton") -> RunResult:
    result = run(sphere(divisions, exponent, solver={"kind": kind, "tolerance": 1e-9}))
    assert result.converged, result.steps[-1].reason
    return result


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_a_squeezed_ball_has_its_closed_form(exponent: float) -> None:
    """Radius and pressure; the errors fall with the square of the mesh size, to below 0.5 %. The gas law holds to round-off."""
    radius, pressure = exact(exponent)
    errors = []
    for divisions in (6, 12):
        result = solved(divisions, exponent)
        last, first = result.steps[-1], result.steps[0]
        errors.append([last.probes["radius"] / radius - 1.0, last.probes["gas"] / pressure - 1.0])
        kept = [(step.pressures["gas"] + AMBIENT) * step.volume**exponent for step in (first, last)]
        assert kept[1] == pytest.approx(kept[0], rel=1e-12)
        assert last.iterations <= 6
    coarse, fine = np.abs(errors)
    assert fine.max() < 5e-3
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)
    assert pressure > 1.1 * FIRST  # the gas was squeezed


def test_the_coupled_tangent_is_the_derivative_of_the_forces() -> None:
    """Solving with a direction's change of force gives the direction back; and the pivots count the coupled matrix's inertia."""
    scene = sphere(4, 1.4)
    work = Analysis(build_model(scene, build_mesh(scene)))
    *_, last = work.steps()
    newton, system = work.newton, work.system
    assert newton is not None
    factor = newton.factorised(indefinite=True)
    assert factor is not None
    rng = np.random.default_rng(0)
    position = system.displacement()
    for _ in range(3):
        direction = np.where(newton.free, rng.normal(size=position.shape), 0.0)
        forces = []
        for sign in (1.0, -1.0):
            system.set_displacement(position + sign * 1e-6 * direction)
            work.equilibrium.filling.contents.settle()  # type: ignore[union-attr]
            forces.append(newton.free_force())
        change = (forces[1] - forces[0]) / 2e-6
        assert factor.solve(change) == pytest.approx(direction, abs=1e-6)
    system.set_displacement(position)
    work.equilibrium.filling.contents.settle()  # type: ignore[union-attr]
    # A pressure so high that the ball would run away, were the gas not shut in.
    work.equilibrium.shut(scene.stages[0])
    system.set_surface_loads(np.array([120.0]))
    loose = newton.factorised(indefinite=True)
    work.equilibrium.shut(scene.stages[1])
    amount = last.volume * ((120.0 + AMBIENT) / AMBIENT) ** (1 / 1.4)
    work.equilibrium.press(
        LoadState.of(pressure={"gas": 120.0, "outside": 0.0}, amount={"gas": amount}, ambient={"gas": AMBIENT})
    )
    shut = newton.factorised(indefinite=True)
    assert loose is not None
    assert shut is not None
    gradient = newton.contents.volume_gradient(newton.contents.chambers[0])  # type: ignore[union-attr]
    b = np.where(newton.free, gradient, 0.0).ravel()
    resistance = 1.4 * (120.0 + AMBIENT) / last.volume
    matrix = newton.tangent.matrix().toarray()
    for found, whole in ((loose, matrix), (shut, matrix + resistance * np.outer(b, b))):
        assert found.negative == (np.linalg.eigvalsh(whole) < 0.0).sum()
    assert loose.negative > shut.negative
    assert newton.tangent.solver.factorise(newton.tangent.assemble()) is None


def test_relaxation_falls_back_on_newton_for_the_gas() -> None:
    """The hybrid agrees with Newton alone."""
    assert solved(6, 1.0, "hybrid").steps[-1].probes == pytest.approx(solved(6, 1.0).steps[-1].probes, rel=1e-9)


def test_energy_is_that_of_the_work_done() -> None:
    """The potential's change while it is squeezed equals the integral of -u over the dead pressure, by trapezoids."""
    stages = [
        {"name": "inflate", "pressure": {"gas": FIRST}},
        {"name": "squeeze", "steps": 16, "pressure": {"outside": -SQUEEZE}, "closed": ["gas"]},
    ]
    scene = sphere(4, 1.4, stages=stages, solver={"kind": "newton", "tolerance": 1e-10})
    model = build_model(scene, build_mesh(scene))
    result = run(scene)
    unit = model.unit_forces["pressure.outside"]
    # Along equilibria dΠ/dq is the partial derivative, -unit·u.
    sweep = [-float(np.vdot(unit, step.displacement)) for step in result.steps]
    loads = [step.pressures["outside"] for step in result.steps]
    inner = result.steps[1].energy
    last = result.steps[-1].energy
    assert inner is not None
    assert last is not None
    integral = float(np.trapezoid(sweep[1:], loads[1:]))
    assert last - inner == pytest.approx(integral, rel=1e-3)


def test_what_cannot_be_shut_is_refused() -> None:
    """Without ambient pressure, set in the same stage, with relaxation, or with a hole."""
    squeeze = {"name": "squeeze", "closed": ["gas"]}
    start = {"name": "inflate", "pressure": {"gas": 1.0}}
    for changes, words in (
        ({"pressures": {"gas": {}}}, "needs ambient"),
        ({"stages": [start, squeeze | {"pressure": {"gas": 2.0}}]}, "cannot be shut and set"),
        ({"stages": [start, squeeze], "solver": {"kind": "relaxation"}}, "needs solver.kind"),
        ({"stages": [start, squeeze | {"closed": ["air"]}]}, "'air' is not a pressure"),
    ):
        with pytest.raises(ValueError, match=words):
            sphere(4, 1.0, **changes)
    holed = {"mesh": {"shape": "disc", "radius": 1.0, "rings": 3}, "groups": {}, "probes": {}}
    held = {"supports": [{"group": "rim", "hold": "xyz"}], "pressures": {"gas": {"ambient": 1.0}}}
    scene = sphere(4, 1.0, **holed, **held, stages=[start, squeeze])
    with pytest.raises(InputError, match="must have no hole, but its 54 elements have 18 free edges"):
        build_model(scene, build_mesh(scene))
