"""Load steps carried over from coarse meshes to fine ones: the same results, and ordinary steps where that leads nowhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from test_adapt import disc

import taichi_membrane as tm
from taichi_membrane.commands.run_lines import cascade_lines
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import read_result
from taichi_membrane.scene import Scene

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def beam(around: int, load: float, **changes: Any) -> Scene:
    return Scene.model_validate(
        {
            "name": "beam",
            "units": {"length": "mm", "force": "N"},
            "mesh": {"shape": "tube", "radius": 25.0, "length": 300.0, "around": around, "along": around},
            "fabric": {"E": 4000.0, "nu": 0.1, "thickness": 0.1},
            "supports": [{"group": "start", "hold": "xyz"}],
            "loads": {"tip": {"group": "end", "direction": [0, 0, -1], "spread": "edges"}},
            "stages": [{"name": "inflate", "pressure": 0.035}, {"name": "load", "steps": 3, "loads": {"tip": load}}],
            "probes": {"tip": {"kind": "displacement", "group": "end", "component": "z"}},
        }
        | changes
    )


@pytest.mark.parametrize("times", [1, 2])
def test_the_same_states_as_step_by_step(times: int, tmp_path: Path) -> None:
    """To the solver's tolerance, on the same mesh; each coarse mesh is told with what it took."""
    scene = beam(8 if times == 2 else 12, 4.6)
    found = tm.run(scene, cascade=times, out=tmp_path / "run", render=False)
    assert found.converged
    told = found.cascade
    assert told is not None
    assert told.elements == tuple(told.elements[0] * 4**k for k in range(times + 1))
    assert found.mesh.tri_count == told.elements[-1]
    assert (told.carried, told.reason) == (4, "")
    assert len(told.iterations) == len(told.seconds) == times + 1
    assert told.iterations[-1] == sum(step.iterations for step in found.steps)
    assert [[one.event for one in step.trace] for step in found.steps] == [["carried over"]] * 4
    assert [step.stable for step in found.steps] == [True] * 4
    direct = tm.run(Scene.model_validate({**scene.model_dump(), "mesh": {"shape": "given"}}), mesh=found.mesh)
    for step, other in zip(found.steps, direct.steps, strict=True):
        assert step.probes["tip"] == pytest.approx(other.probes["tip"], rel=1e-4, abs=1e-6)
        assert step.number == other.number
    saved = read_result(tmp_path / "run")
    assert saved.cascade == told
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["settings"]["cascade"] == times
    assert "4 of 4 load steps carried over" in cascade_lines(found)[0]
    assert direct.cascade is None
    assert cascade_lines(direct) == []


def test_collapse_is_found_on_the_finest_mesh() -> None:
    """What the coarse mesh does not reach is solved as any other run does, and said to be."""
    scene = beam(12, 8.0)
    found = tm.run(scene, cascade=1)
    assert found.outcome == "collapse"
    assert found.cascade is not None
    carried = found.cascade.carried
    assert 1 <= carried < len(found.steps)
    assert all(step.trace[0].event == "carried over" for step in found.steps[:carried])
    assert all(one.event != "carried over" for step in found.steps[carried:] for one in step.trace)
    assert any("FELL BACK" in line for line in cascade_lines(found))
    direct = tm.run(Scene.model_validate({**scene.model_dump(), "mesh": {"shape": "given"}}), mesh=found.mesh)
    assert direct.steps[-1].limit is not None
    assert found.steps[-1].limit is not None
    assert found.steps[-1].limit["load.tip"] == pytest.approx(direct.steps[-1].limit["load.tip"], rel=2e-3)


def test_a_state_that_is_lost_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a mesh so coarse that its state is far from the finer one's: the run falls back, and ends as without a cascade."""
    scene = disc({"tolerance": 0.1}, mesh={"rings": 1, "sectors": 3})
    del scene["mesh"]["adapt"]
    monkeypatch.setattr("taichi_membrane.simulation.estimating._FAR", 0.01)
    found = tm.run(Scene.model_validate(scene), cascade=2)
    assert found.converged
    assert found.cascade is not None
    assert found.cascade.carried == 0
    assert "% of the displacements away" in found.cascade.reason
    assert any(
        "FELL BACK for 1 load steps, solved on the finest mesh alone: inflate 1" in one for one in cascade_lines(found)
    )
    direct = tm.run(Scene.model_validate({**scene, "mesh": {"shape": "given"}}), mesh=found.mesh)
    assert found.steps[-1].probes["rise"] == pytest.approx(direct.steps[-1].probes["rise"], rel=1e-6)


def test_a_cascade_that_was_stopped_goes_on_by_load_steps(tmp_path: Path) -> None:
    scene = beam(8, 4.0)

    class Stop:
        def __getattr__(self, name: str) -> Any:
            return lambda *_: None

        def step_done(self, step: Any) -> None:
            if step.number == 1:
                raise KeyboardInterrupt

    whole = tm.run(scene, cascade=1)
    with pytest.raises(KeyboardInterrupt):
        tm.run(scene, cascade=1, out=tmp_path / "run", render=False, observer=Stop())  # type: ignore[arg-type]
    found = tm.resume(tmp_path / "run")
    assert found.converged
    assert len(found.steps) == 4
    assert found.steps[-1].probes["tip"] == pytest.approx(whole.steps[-1].probes["tip"], rel=1e-4)


@pytest.mark.parametrize(
    ("scene", "count", "told"),
    [
        (Scene.model_validate(disc({"tolerance": 0.1})), 1, "cascade: of a mesh that is refined for a probe"),
        (beam(8, 1.0), -1, "cascade = -1 must not be below 0"),
        (
            beam(8, 1.0, stages=[{"name": "a", "pressure": 0.035, "control": "arc_length", "steps": 5}]), 1,
            "cascade: of a stage by arc length (stages.a.control)",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(scene: Scene, count: int, told: str) -> None:
    with pytest.raises(InputError) as error:
        tm.run(scene, cascade=count)
    assert told in str(error.value)
