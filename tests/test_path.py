"""Arc length and collapse on a structure whose whole path is known: a shallow tent whose tip is pushed down and snaps through."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SIDES, RADIUS, RISE, E, THICKNESS = 6, 10.0, 1.0, 100.0, 0.1
# A triangle's base is held, so it only stretches along its slant height s: Green strain (z² - h²)/(2 s²), volume V. ν = 0.
INNER = RADIUS * np.cos(np.pi / SIDES)
SLANT = float(np.hypot(INNER, RISE))
VOLUME = SIDES * THICKNESS * RADIUS * np.sin(np.pi / SIDES) * SLANT
LIMIT = float(E * VOLUME * RISE**3 / (3 * np.sqrt(3) * SLANT**4))


def load_at(height: float) -> float:
    """Force that holds the tip at a height: -dW/dz of E V ε²/2."""
    return float(E * VOLUME * height * (RISE**2 - height**2) / (2 * SLANT**4))


def tent(stages: list[dict[str, Any]], rise: float = RISE, **changes: Any) -> RunResult:
    """Run the tent through some stages; unless told otherwise its tip moves up and down alone."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    rim = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0 * angle], axis=1)
    triangles = [[0, 1 + k, 1 + (k + 1) % SIDES] for k in range(SIDES)]
    mesh = Mesh.build(np.vstack([[0.0, 0.0, rise], rim]), triangles, {"tip": [0], "rim": range(1, 1 + SIDES)})
    scene = {
        "name": "tent",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "given"},
        "fabric": {"E": E, "nu": 0.0, "thickness": THICKNESS, "law": "none"},
        "supports": [{"group": "rim", "hold": "xyz"}, {"group": "tip", "hold": "xy"}],
        "loads": {"push": {"group": "tip", "direction": [0.0, 0.0, -1.0]}},
        "probes": {
            "sink": {"kind": "displacement", "group": "tip", "component": "z"},
            "push": {"kind": "factor", "of": "load.push"},
        },
        "stages": stages,
    }
    return run(Scene.model_validate(scene | changes), mesh=mesh)


def test_arc_length_follows_the_exact_path_through_both_limits() -> None:
    """Down to the far side and up again to the load: every point on the cubic, unstable between the limits and only there."""
    result = tent([{"name": "snap", "steps": 60, "control": "arc_length", "loads": {"push": 1.2 * LIMIT}}])
    assert result.outcome == "finished"
    heights = RISE + result.probe("sink")
    pushes = result.probe("push")
    for height, push in zip(heights, pushes, strict=True):
        assert push == pytest.approx(load_at(height), abs=1e-5 * LIMIT)
    assert np.all(np.diff(heights) < 0.0)  # onwards, never back
    assert heights[-1] < -RISE
    assert pushes[-1] >= 1.2 * LIMIT  # the stage ends beyond its load, not before it
    assert pushes.min() < -0.9 * LIMIT
    for height, step in zip(heights, result.steps, strict=True):
        assert step.negative_pivots == (1 if abs(height) < RISE / np.sqrt(3) else 0)


@pytest.mark.parametrize("kind", ["newton", "hybrid"])
def test_collapse_is_found_and_bracketed(kind: str) -> None:
    """Load control to 1.2 times the limit: the run says collapse, brackets the exact limit, and keeps a stable equilibrium."""
    result = tent([{"name": "push", "steps": 4, "loads": {"push": 1.2 * LIMIT}}], solver={"kind": kind})
    assert result.outcome == "collapse"
    assert not result.converged
    last = result.steps[-1]
    assert (last.converged, last.stage_step, last.negative_pivots) == (True, 4, 0)
    assert last.limit is not None
    lower, upper = last.limit["load.push"]
    assert lower <= LIMIT <= upper
    assert upper - lower < 1.1e-3 * 0.3 * LIMIT  # a thousandth of the load step, and its round-off
    assert lower <= last.loads["push"] <= upper
    own = last.loads["push"]  # the state's: residuals leave open where the limit is, not what the state bears
    assert load_at(RISE + last.probes["sink"]) == pytest.approx(own, abs=2e-6 * LIMIT)
    assert "collapse" in last.reason


def test_a_steep_tent_collapses_sideways() -> None:
    """Its tip free, a steep tent tips over before it snaps through: no stable path branches off, so that is the largest load.

    Nothing but symmetry holds the tip in the middle, and load control alone ends far on the other side.
    """
    rise = 60.0
    slant = float(np.hypot(INNER, rise))
    snap = E * VOLUME * slant / SLANT * rise**3 / (3 * np.sqrt(3) * slant**4)  # with the tip guided
    stages = [{"name": "push", "steps": 2, "loads": {"push": 1.2 * snap}}]
    result = tent(stages, rise, supports=[{"group": "rim", "hold": "xyz"}])
    assert result.outcome == "collapse"
    last = result.steps[-1]
    assert last.limit is not None
    lower, upper = last.limit["load.push"]
    assert 0.1 * snap < lower < upper < 0.97 * snap
    assert upper - lower < 1.1e-3 * 0.6 * snap
    assert last.negative_pivots == 0
    assert rise + last.probes["sink"] > rise / np.sqrt(3)  # above where the guided tip would snap


def test_a_stable_branch_is_followed() -> None:
    """Four prestressed triangles are pushed together: at 1 N, their prestress, the centre gives way, without collapse.

    The flat path loses its stability there while the load rises; the bulged one beside it is stable, and its stiffness shows that
    nothing was jumped over on the way to it.
    """
    scene = {
        "name": "sheet",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "panel", "width": 10.0, "height": 10.0, "along_x": 1, "along_y": 1, "pattern": "crossed"},
        "fabric": {"E": 1000.0, "nu": 0.0, "thickness": 0.1, "law": "none", "prestress": [1.0, 1.0, 0.0]},
        "supports": [{"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "yz"}],
        "loads": {"push": {"group": "x_max", "direction": [-1.0, 0.0, 0.0]}},
        "stages": [{"name": "pull", "loads": {"push": -1.0}}, {"name": "push", "steps": 2, "loads": {"push": 4.0}}],
        "probes": {"bulge": {"kind": "displacement", "group": "centre", "component": "z"}},
    }
    result = run(Scene.model_validate(scene))
    assert result.outcome == "finished"
    past = result.steps[1]
    assert {passage.event for passage in past.trace} <= {"unstable", "bisected", "load control"}
    assert abs(past.probes["bulge"]) > 0.1
    assert [step.negative_pivots for step in result.steps] == [0, 0, 0]


def test_a_stage_that_is_meant_to_collapse_finishes() -> None:
    """The next stage goes on from the limit; a check on the last step done sees the collapse load."""
    stages = [
        {"name": "push", "steps": 4, "loads": {"push": 1.2 * LIMIT}, "until": "collapse"},
        {"name": "release", "loads": {"push": 0.0}},
    ]
    check = {"probe": "push", "stage": "push", "reference": LIMIT, "tolerance": 1e-3, "source": "closed form"}
    result = tent(stages, checks=[check])
    assert result.outcome == "finished"
    assert result.passed
    assert result.checks[0].value == pytest.approx(LIMIT, rel=1e-3)
    assert result.steps[-1].probes["sink"] == pytest.approx(0.0, abs=1e-6)


def test_relaxation_does_not_claim_collapse() -> None:
    """Without a tangent there is no proof of a limit: the far state is found by its dynamics, and no stability verdict is given."""
    result = tent([{"name": "push", "steps": 4, "loads": {"push": 1.2 * LIMIT}}], solver={"kind": "relaxation"})
    assert result.outcome == "finished"
    assert RISE + result.steps[-1].probes["sink"] < -RISE
    assert {step.negative_pivots for step in result.steps} == {None}


def test_arc_length_needs_a_tangent() -> None:
    """Refused with relaxation, with the clipped law, and with motions that change."""
    stage = {"name": "snap", "steps": 3, "control": "arc_length", "loads": {"push": 1.0}}
    with pytest.raises(ValueError, match=r"stages\.snap\.control = 'arc_length' needs solver\.kind"):
        tent([stage], solver={"kind": "relaxation"})
    with pytest.raises(InputError, match="arc_length"):
        tent([stage], fabric={"E": E, "nu": 0.0, "thickness": THICKNESS, "law": "clip"})
