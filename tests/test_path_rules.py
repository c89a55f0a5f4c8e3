"""What is told along a way and at the end of a path: load displacement, bounds of a limit, slack."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tents import (
    RADIUS,
    SIDES,
    borne,
    loads,
    tent,
)
from test_policy import beam

from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation import load_step
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.way import Rest, Way
from taichi_membrane.solvers import path as path_module
from taichi_membrane.solvers.path import Path, PathEnd, PathPoint

if TYPE_CHECKING:
    from taichi_membrane.mechanics.preparation import Floats

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# ---- the load displacement


def ways(before: LoadState, after: LoadState, **scene: Any) -> Way:
    """The way between two load states of a short tube, whose one end slides in a slanted plane."""
    whole = {
        "name": "tube",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 10.0, "length": 20.0, "around": 6, "along": 2},
        "fabric": {"E": 100.0, "nu": 0.0, "thickness": 1.0},
        "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "normal": [0.6, 0.8, 0.0]}],
        "stages": [{"name": "stage", "pressure": 0.3}],
    }
    taken = Scene.model_validate(whole | scene)
    model = build_model(taken, build_mesh(taken, None))
    model.structure.prepare(matrix=True)
    found = Equilibrium(model)
    assert found.newton is not None
    return found.way(before, after)


def test_a_pressure_works_on_the_volume() -> None:
    """From any shape to any other its load displacement is its change times the volume swept: exactly, as volume is cubic."""
    way = ways(LoadState({"pressure.inside": 0.1}), LoadState({"pressure.inside": 0.3}))
    membrane, random = way.system, np.random.default_rng(1)
    rests = []
    for share in (0.0, 1.0):
        moved = membrane.in_frames(random.normal(size=(membrane.node_count, 3)))
        moved[membrane.structure.node_held] = 0.0
        position = membrane.retract(np.zeros_like(moved), moved)
        membrane.set_displacement(position)
        rests.append(Rest(share=share, position=position, force=way.force(share), stiffness=1.0, negative=0))
    first, last = rests
    swept = [float(membrane.swept_volumes(one.position).sum()) for one in rests]
    assert way._load_displacement(first, last) == pytest.approx(0.2 * (swept[1] - swept[0]), rel=1e-9)
    np.testing.assert_array_equal(membrane.displacement(), last.position)
    assert membrane.surface_loads() == pytest.approx(0.3)


def test_a_turning_motion_acts_by_where_it_is() -> None:
    """Half a turn on the way of a whole one the end moves the other way; what it moves is left where it was."""
    motions = {"turn": {"kind": "rotation", "group": "end", "axis": [0, 0, 1], "through": [0, 0, 0]}}
    supports = [{"group": "start", "hold": "xyz"}]
    ends = [LoadState({"pressure.inside": 0.0, "motion.turn": angle}) for angle in (0.0, 360.0)]
    way = ways(*ends, motions=motions, supports=supports)
    way.press(0.25)
    before = way.system.displacement()
    force = way.force(0.25)
    np.testing.assert_array_equal(way.system.displacement(), before)

    def free(share: float) -> Floats:
        way.press(share)
        return way.newton.free_force()

    step = 1e-4
    slow = (free(0.25 + step) - free(0.25 - step)) / (2.0 * step)
    assert np.linalg.norm(force - slow) < 1e-3 * np.linalg.norm(slow)
    assert np.linalg.norm(slow) > 0.0


# ---- ends of a path


def test_at_a_limit_the_pressure_is_that_of_the_last_stable_state() -> None:
    """Its reactions balance the wind that is told, not one that was tried beyond it."""
    parts = tent()
    parts.scene["pressures"] = {"wind": {"kind": "fixed"}}
    parts.scene["probes"]["rim"] = {"kind": "reaction", "group": "held", "component": "z"}
    area = 0.5 * SIDES * RADIUS**2 * float(np.sin(2.0 * np.pi / SIDES))
    result = parts.run({"pressure": -1.2 * 3.0 / area})
    assert result.outcome == "collapse"
    last = result.steps[-1]
    assert last.limit is not None
    assert -3.0 / area == pytest.approx(last.limit["pressure.wind"][0], rel=1e-3)
    assert abs(last.probes["rim"]) == pytest.approx(abs(last.pressures["wind"]) * area, rel=1e-5)


@pytest.mark.parametrize("change", [{"rim": 1.0}, {}], ids=["held nodes", "no change"])
def test_a_load_that_moves_nothing_is_carried(change: dict[str, float]) -> None:
    """Along a path as by load control: there is no direction to go in, and no number comes of dividing by none."""
    parts = tent()
    parts.scene["loads"]["rim"] = {"group": "held", "direction": [0.0, 0.0, -1.0]}
    with np.errstate(all="raise"):
        result = parts.run({"loads": change, "control": "arc_length", "steps": 3})
    assert result.outcome == "finished"
    last = result.steps[-1]
    assert (last.stage_step, last.loads["rim"], last.negative_pivots) == (1, change.get("rim", 0.0), 0)
    assert not last.displacement.any()
    assert on_curve(0.0, 0.0, np.inf).slope() == np.inf  # the load rises, and nothing moves


def on_curve(at: float, load: float, slope: float, step: float = 0.0) -> PathPoint:
    """A point of a path of one displacement."""
    return PathPoint(
        position=np.array([[at]]), factor=load, tangent=np.array([[1.0 / slope]]), negative=int(slope < 0.0),
        advance=np.array([[step]]), iterations=0, residual=0.0,
    )  # fmt: skip


def test_a_limit_is_not_told_below_the_largest_load() -> None:
    """λ = s² (3 - 2 s) first curves upwards and has its maximum, 1, at s = 1: nowhere do bounds from two points cut it off."""
    bounds = []
    for first in np.linspace(0.05, 0.95, 91):
        for last in np.linspace(1.005, 1.2, 40):
            step = last - first
            (a, up), (b, down) = ((s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)) for s in (first, last))
            slack = abs(0.5 * (up + down) * step - (b - a))
            points = on_curve(first, a, up), on_curve(last, b, down, step)
            bounds.append(path_module._upper_bound(*points, slack, at_floor=False) or 0.0)
    assert min(bounds) >= 1.0
    tangents = on_curve(0.2, 0.104, 0.96), on_curve(1.01, 0.999698, -0.0606, 0.81)
    assert path_module._upper_bound(*tangents, 0.0, at_floor=False) is None  # they meet below the second point


def test_a_fall_to_another_branch_is_a_limit_once_it_is_looked_at_closely() -> None:
    """λ = s up to 1, where it drops to a branch that rises as well: two points tell a limit between them only at the floor."""
    before, after = on_curve(0.95, 0.95, 1.0), on_curve(1.05, 0.5, 0.1, 0.1)
    assert path_module._upper_bound(before, after, 0.0, at_floor=False) is None
    assert path_module._upper_bound(before, after, 0.0, at_floor=True) == pytest.approx(1.05)


def test_from_a_stable_point_beside_a_bifurcation_the_load_goes_on_to_rise() -> None:
    """A step across led to a branch along which it points back: walked on that way the load would fall, as beyond a limit."""
    along, back = on_curve(0.5, 0.5, 2.0, 0.1), on_curve(0.5, 0.5, 2.0, -0.1)
    assert along.rising() is along
    assert back.slope() < 0.0
    assert back.rising().slope() > 0.0
    assert np.array_equal(back.rising().advance, along.advance)


def test_a_wrinkling_tube_is_followed_in_growing_steps() -> None:
    """Where a step took few iterations the next one is longer: otherwise a collapse would cost thousands."""
    result = run(beam(0.03, 18.0, 1))
    assert result.outcome == "finished"
    assert sum(step.iterations for step in result.steps) < 1000


def test_a_path_is_told_how_far_its_tangents_and_its_secant_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two points of a tent's path both are known: 1.2 λ = borne(1 - w), where the tip is at -w."""
    seen: list[tuple[float, float]] = []

    def follow(path: Path, start: PathPoint, target: float, *, see: Any, **more: Any) -> PathEnd:
        point, _ = path.step(start, start.length_for(0.5))
        assert point is not None
        seen.append((float(-point.position[0, 2]), see(start, point).slack))
        return PathEnd("lost", start, None, iterations=0)

    monkeypatch.setattr(load_step, "follow", follow)
    tent().run(loads(tent=1.2), solver={"max_cuts": 0})
    ((sink, slack),) = seen
    tangents = 0.5 * 1.5 * np.sqrt(3.0) * (2.0 + 3.0 * (1.0 - sink) ** 2 - 1.0) / 1.2
    assert slack == pytest.approx(abs(tangents * sink - borne(1.0 - sink) / 1.2), rel=1e-3)


@pytest.mark.parametrize("times", [50.0, 2000.0])
def test_a_limit_far_below_the_aim_is_found(times: float) -> None:
    """Of an aim thousands of times too high the limit is a small share, at which nearly nothing acts, by the aim's measure."""
    result = tent().run(loads(tent=times))
    assert result.outcome == "collapse"
    limit = result.steps[-1].limit
    assert limit is not None
    lower, upper = limit["load.tent"]
    assert lower <= 1.0 + 1e-5
    assert upper >= 1.0
    assert upper - lower <= 2e-3 * times
