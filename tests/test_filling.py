"""Gas by its amount: a balloon past its largest pressure, joined chambers, relief valves, altitude, a piston, a squeezed tube."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import two_cells
from resume_cases import run_until
from scipy.optimize import brentq
from test_gas import AMBIENT, SQUEEZE, sphere

import taichi_membrane as tm
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.system import System
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import StepResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

E, NU, THICKNESS = 100.0, 0.3, 0.1
BALL = 4.0 / 3.0 * np.pi
VOLUME = {"V": {"kind": "volume", "pressure": "gas"}, "absolute": {"kind": "absolute_pressure", "pressure": "gas"}}
RADIUS = {"radius": {"kind": "radius", "group": "all", "axis": "centre"}}


def balloon_pressure(stretch: float) -> float:
    """Of a sphere of radius 1, linear by engineering strain: N = E t (λ - 1)/((1 - ν) λ), p = 2 N/λ; largest at λ = 2."""
    return 2.0 * E * THICKNESS * (stretch - 1.0) / ((1.0 - NU) * stretch**2)


def test_a_balloon_is_filled_through_its_largest_pressure() -> None:
    """By amount each state has its closed form, to second order, and is stable; by pressure there is a limit at λ = 2."""
    aims = np.linspace(1.5, 3.0, 4)
    amounts = [BALL * s**3 * (1.0 + balloon_pressure(s) / AMBIENT) for s in aims]
    assert balloon_pressure(aims[-1]) < balloon_pressure(2.0)
    errors = []
    for divisions in (4, 8):
        size = build_mesh(sphere(divisions, 1.0)).enclosed_volume() / BALL
        stages = [{"name": f"to_{k}", "amount": {"gas": size * amount}} for k, amount in enumerate(amounts)]
        fabric = {"E": E, "nu": NU, "thickness": THICKNESS, "law": "none", "side_strain": "engineering"}
        result = run(sphere(divisions, 1.0, stages=stages, fabric=fabric, solver={"kind": "newton", "tolerance": 1e-9}))
        assert result.converged, result.steps[-1].reason
        assert all(step.stable for step in result.steps)
        errors.append(
            [step.pressures["gas"] / balloon_pressure(s) - 1.0 for step, s in zip(result.steps, aims, strict=True)]
        )
    assert np.abs(errors[1]).max() < 0.02
    assert np.log2(np.array(errors[0]) / np.array(errors[1])) == pytest.approx(2.0, abs=0.25)
    stages = [{"name": "blow", "pressure": {"gas": 1.05 * balloon_pressure(2.0)}, "steps": 4}]
    blown = run(sphere(4, 1.0, stages=stages, fabric=fabric))
    assert blown.outcome == "collapse"


def box(stages: list[dict[str, Any]], **changes: Any) -> Scene:
    """The box of two cells with an inner wall, its floor held."""
    outside = {"ambient": AMBIENT, "exponent": 1.4}
    return Scene.model_validate(
        {
            "name": "box",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
            "supports": [{"group": "floor", "hold": "xyz"}],
            "pressures": {"a": {"group": ["a", "wall"], **outside}, "b": {"group": "b", "against": "wall", **outside}},
            "stages": stages,
            "probes": {name: {"kind": "volume", "pressure": name} for name in "ab"},
            "derivatives": ["a"],
            "solver": {"kind": "newton", "tolerance": 1e-12},
            **changes,
        }
    )


BLOW: dict[str, Any] = {"name": "blow", "pressure": {"a": 0.5, "b": 0.1}}


def joined(more: float = 1.0, outside: float = AMBIENT) -> tuple[StepResult, ...]:
    """Blown up unequally, then joined by a tube; then more gas is let into one cell, and the pressure outside changes."""
    tube = {"joined": [["a", "b"]]}
    stages = [
        BLOW,
        {"name": "join", "closed": ["a", "b"], **tube},
        {"name": "more", "amount": {"a": 1.2 * more}, "closed": ["b"], "ambient": outside, **tube},
    ]
    result = run(box(stages), mesh=two_cells(3))
    assert result.converged, result.steps[-1].reason
    return result.steps


def test_joined_chambers_have_one_pressure_and_keep_their_gas() -> None:
    """The wall, bulged before, falls back; supports balance; amounts are those of p_abs Vⁿ in each and their sum is kept."""
    before, after, more = joined()
    wall = np.argmin(np.linalg.norm(two_cells(3).points - [1.0, 2.0 / 3.0, 2.0 / 3.0], axis=1))
    assert before.displacement[wall, 0] > 0.02
    for step in (after, more):
        assert step.pressures["a"] == step.pressures["b"]
        assert abs(step.displacement[wall, 0]) < 0.3 * before.displacement[wall, 0]
        assert np.abs(step.reaction.sum(axis=0)).max() < 1e-11 * np.abs(step.reaction).sum()
        for name in "ab":
            own = step.probes[name] * ((step.pressures[name] + AMBIENT) / AMBIENT) ** (1 / 1.4)
            assert step.drivers[f"amount.{name}"] == pytest.approx(own, rel=1e-12)
    amounts = [sum(step.drivers[f"amount.{name}"] for name in "ab") for step in (before, after, more)]
    assert amounts[1] == pytest.approx(amounts[0], rel=1e-12)
    assert amounts[2] == pytest.approx(1.2 + after.drivers["amount.b"], rel=1e-12)
    assert after.pressures["a"] > before.pressures["b"]
    assert more.pressures["a"] > after.pressures["a"]


def test_derivatives_by_amount_and_by_what_is_outside_are_those_of_finite_differences() -> None:
    last = joined()[-1]
    for driver, given, change in (("amount.a", "more", 1.2), ("ambient.a", "outside", 1.0)):
        ends = [joined(**{given: (1.0 if given == "more" else AMBIENT) + sign * 1e-4})[-1] for sign in (1.0, -1.0)]
        difference = (ends[0].probes["a"] - ends[1].probes["a"]) / (2e-4 * change)
        assert abs(difference) > 1e-3
        assert last.derivatives["a"][driver] == pytest.approx(difference, rel=1e-6)
    assert last.derivatives["a"]["amount.b"] == last.derivatives["a"]["amount.a"]
    assert not {"pressure.a", "pressure.b"} & set(last.derivatives["a"])


@pytest.mark.parametrize("tube", [True, False])
def test_a_wall_is_unloaded_in_joined_chambers_and_bears_the_difference_of_separate_ones(tube: bool) -> None:
    """Its own tension, the forces without any pressure, is (p_a - p_b) times its area vectors."""
    mesh = two_cells(4)
    inside = np.flatnonzero((mesh.points[:, 0] == 1.0) & (np.abs(mesh.points[:, 1:] - 0.5).max(axis=1) < 0.4))
    stage = {"name": "fill", "amount": {"a": 1.1, "b": 1.05}, "joined": [["a", "b"]] if tube else []}
    scene = box([stage], fabric={"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"})
    step = run(scene, mesh=mesh).steps[-1]
    assert step.converged
    assert (step.pressures["a"] == step.pressures["b"]) == tube
    system = System(build_model(scene, mesh).structure)
    system.set_displacement(step.displacement)
    tension = system.out_of_balance()[inside]
    triangles = mesh.triangles[mesh.tri_groups["wall"]]
    corners = (mesh.points + step.displacement)[triangles]
    area = np.zeros_like(mesh.points)
    directed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6.0
    np.add.at(area, triangles, directed[:, None, :])
    push = (step.pressures["a"] - step.pressures["b"]) * area[inside]
    assert len(inside) == 9
    assert np.abs(tension + push).max() < 1e-11
    assert (np.abs(push).max() < 1e-15) == tube


RELIEF = 1.9


def relieved(**stage: Any) -> Scene:
    """A ball blown up to 1.5 and shut, squeezed until its valve, at 1.9, lets gas out, and let go."""
    stages = [
        {"name": "inflate", "pressure": {"gas": 1.5}},
        {"name": "squeeze", "pressure": {"outside": -SQUEEZE}, "closed": ["gas"], "steps": 3} | stage,
        {"name": "back", "pressure": {"outside": 0.0}, "closed": ["gas"], "steps": 2} | stage,
    ]
    gas = {"ambient": AMBIENT, "exponent": 1.4, "relief": RELIEF}
    return sphere(
        4, 1.4, stages=stages, pressures={"gas": gas, "outside": {"kind": "fixed"}}, probes=VOLUME | RADIUS,
        solver={"kind": "newton", "tolerance": 1e-10},
    )  # fmt: skip


def test_a_relief_valve_holds_the_pressure_and_what_it_let_out_is_gone() -> None:
    """While open the pressure is the valve's, and what is left fills the volume at it; let go, the rest follows p_abs Vⁿ."""
    steps = run(relieved()).steps
    assert all(step.converged and step.stable for step in steps)
    opened = [step for step in steps if step.relieved]
    assert [step.stage for step in opened] == ["squeeze"] * len(opened)
    assert 1 <= len(opened) < 3
    for step in opened:
        assert step.pressures["gas"] == RELIEF
        assert step.trace[-1].event == "relief"
        left = step.probes["V"] * ((RELIEF + AMBIENT) / AMBIENT) ** (1 / 1.4)
        assert step.drivers["amount.gas"] == pytest.approx(left, rel=1e-12)
    first, kept = steps[0], steps[3].drivers["amount.gas"]
    assert sum(step.relieved["gas"] for step in opened) == pytest.approx(first.drivers["amount.gas"] - kept, rel=1e-12)
    for step in steps[4:]:
        assert step.pressures["gas"] < RELIEF
        assert AMBIENT * (kept / step.probes["V"]) ** 1.4 - AMBIENT == pytest.approx(step.pressures["gas"], rel=1e-10)
    assert steps[-1].probes["V"] < first.probes["V"]
    # Without the valve, the ball comes back to where it was.
    data = relieved().model_dump(mode="json")
    data["pressures"]["gas"]["relief"] = None
    whole = run(Scene.model_validate(data)).steps
    assert whole[3].pressures["gas"] > RELIEF
    assert whole[-1].probes["V"] == pytest.approx(first.probes["V"], rel=1e-8)
    # A valve that opens late in the squeeze: fewer steps find the same, as the load only rises.
    once = run(Scene.model_validate(relieved().model_dump(mode="json") | {"stages": _steps(relieved(), 1)})).steps
    assert once[1].drivers["amount.gas"] == pytest.approx(kept, rel=1e-7)


def _steps(scene: Scene, count: int) -> list[dict[str, Any]]:
    return [stage.model_dump(mode="json") | {"steps": count} for stage in scene.stages]


@pytest.mark.parametrize("control", ["load", "arc_length"])
def test_a_run_goes_on_with_what_a_valve_has_let_out(control: str, tmp_path: Path) -> None:
    """Stopped after each step; and by arc length it ends as under load control."""
    steps = 12 if control == "arc_length" else 3
    scene = relieved(control=control, steps=steps)
    whole = tm.run(scene, out=tmp_path / "whole", render=False)
    assert whole.converged, whole.steps[-1].reason
    there = run(relieved()).steps[-1]
    assert whole.steps[-1].probes["V"] == pytest.approx(there.probes["V"], rel=1e-6)

    opened = next(step.number for step in whole.steps if step.relieved)
    for last in (opened, opened + 1):
        folder = tmp_path / f"cut_{last}"
        run_until(last, scene, out=folder, render=False)
        again = tm.resume(folder, render=False)
        for one, other in zip(again.steps, whole.steps, strict=True):
            assert np.array_equal(one.displacement, other.displacement)
            assert one.drivers == other.drivers
            assert (one.relieved, one.state.let_out) == (other.relieved, other.state.let_out)


def test_a_shut_ball_swells_where_there_is_less_outside() -> None:
    """Gas of p_abs λ³ kept: (p_abs - p_out) λ² R = 2 t S λ, S = E (λ² - 1)/(2 (1 - ν)); one that is open stays as it is."""

    def excess(stretch: float) -> float:
        return (AMBIENT / stretch**3 - 4.0) * stretch - 2 * THICKNESS * E * (stretch**2 - 1) / (2 * (1 - NU))

    exact = brentq(excess, 1.0, 2.0)
    stages = [{"name": "rise", "ambient": 4.0, "closed": ["gas"]}]
    errors = []
    for divisions in (4, 8):
        result = run(sphere(divisions, 1.0, stages=stages, probes=VOLUME | RADIUS))
        last = result.steps[-1]
        assert last.converged
        assert last.probes["absolute"] == pytest.approx(last.pressures["gas"] + 4.0, rel=1e-14)
        errors.append(last.probes["radius"] / exact - 1.0)
    assert abs(errors[1]) < 3e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    open_valve = run(
        sphere(4, 1.0, stages=[{"name": "rise", "ambient": 4.0, "pressure": {"gas": 0.0, "outside": 0.0}}])
    )
    assert np.abs(open_valve.steps[-1].displacement).max() == 0.0


def test_a_piston_on_shut_gas_is_a_spring() -> None:
    """A tube that is stiff around, pulled out: F = p A - b N with p_abs (A (L + δ))ⁿ kept, to the hoops' stretch of 1e-5.

    Its fabric bears N = E t λ (λ² - 1)/2 along, over the perimeter b.
    """
    ambient, first, n, travel, length, along = 10.0, 5.0, 1.4, 0.5, 2.0, 40.0
    scene = Scene.model_validate(
        {
            "name": "piston",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": 1.0, "length": length, "around": 12, "along": 4, "pattern": "diagonal",
                     "cap_start": "flat", "cap_end": "flat"},
            "fabric": {"E_warp": along, "E_weft": 1e7, "nu": 0.0, "G": 20.0, "thickness": 0.1, "law": "none"},
            "groups": {"bottom": {"where": "x < 1e-9"}, "top": {"where": "x > 1.999999"}},
            "supports": [{"group": "bottom", "hold": "xyz"}, {"group": "top", "hold": "yz"}],
            "pressures": {"gas": {"ambient": ambient, "exponent": n}},
            "motions": {"push": {"kind": "translation", "group": "top", "direction": [1.0, 0.0, 0.0], "hold": "x"}},
            "stages": [
                {"name": "inflate", "pressure": first},
                {"name": "push", "closed": ["gas"], "motions": {"push": travel}, "steps": 2},
            ],
            "probes": {"F": {"kind": "reaction", "group": "top", "component": "x"}},
            "solver": {"kind": "newton", "tolerance": 1e-9},
        }
    )  # fmt: skip
    result = run(scene)
    assert result.converged, result.steps[-1].reason
    area, around = 6.0 * np.sin(np.pi / 6.0), 24.0 * np.sin(np.pi / 12.0)
    for step in result.steps:
        way = step.drivers["motion.push"]
        stretch = 1.0 + way / length
        exact = ((first + ambient) / stretch**n - ambient) * area - around * 0.1 * along * stretch * (
            stretch**2 - 1.0
        ) / 2.0
        assert step.probes["F"] == pytest.approx(-exact, rel=1e-4)


def test_a_scene_without_shut_chambers_has_no_contents() -> None:
    """Nor drivers of amounts and of the pressure outside, though it names that pressure."""
    scene = sphere(4, 1.0, stages=[{"name": "inflate", "pressure": {"gas": 1.0}}])
    work = Analysis(build_model(scene, build_mesh(scene)))
    *_, last = work.steps()
    assert work.equilibrium.filling.contents is None
    assert set(last.drivers) == {"pressure.gas", "pressure.outside"}
