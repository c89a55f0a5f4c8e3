"""Meshes refined for the error of a probe: against exact answers, and what is told where that is not reached."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_layers import cantilever
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.assurance.verification.shooting import inflated_disc
from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import read_result
from taichi_membrane.page.tables import all_tables
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.accuracy import Adaption
from taichi_membrane.simulation.judging import judged
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

INNER = 0.02


def disc(adapt: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Flat film under follower pressure."""
    mesh = {"shape": "disc", "radius": 1.0, "rings": 3, "adapt": {"probe": "rise", **adapt}}
    return {
        "name": "disc",
        "units": {"length": "m", "force": "N"},
        "mesh": mesh | changes.pop("mesh", {}),
        "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
        "supports": [{"group": "rim", "hold": "xyz"}],
        "stages": [{"name": "inflate", "pressure": 0.1}],
        "probes": {"rise": {"kind": "displacement", "group": "centre", "component": "z"}},
    } | changes


def funnel(order: int, tolerance: float, **mesh: Any) -> dict[str, Any]:
    """A film of even tension 1 whose small inner rim is pulled across it: z = F ln(R/r)/(2 π), steepest at that rim."""
    return {
        "name": "funnel",
        "units": {"length": "m", "force": "N"},
        "mesh": {
            "shape": "annulus", "inner": INNER, "outer": 1.0, "around": 12, "rings": 4, "order": order,
            "adapt": {"probe": "sag", "tolerance": tolerance, "max_rounds": 20}, **mesh,
        },
        "fabric": {"E": 1e-3, "nu": 0.0, "thickness": 1.0, "prestress": [1.0, 1.0, 0.0], "law": "none"},
        "supports": [{"group": "outer", "hold": "xyz"}, {"group": "inner", "hold": "xy"}],
        "loads": {"pull": {"group": "inner", "direction": [0, 0, 1], "spread": "edges"}},
        "stages": [{"name": "pull", "loads": {"pull": 1e-4}}],
        "probes": {"sag": {"kind": "displacement", "group": "inner", "component": "z"}},
    }  # fmt: skip


def toml(scene: dict[str, Any]) -> str:
    """Of a scene of texts, numbers, lists and tables within tables, on one line each."""

    def text(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{key} = {text(one)}" for key, one in value.items()) + "}"
        return "[" + ", ".join(map(text, value)) + "]" if isinstance(value, list) else json.dumps(value)

    return "\n".join(f"{key} = {text(value)}" for key, value in scene.items())


def run(scene: dict[str, Any], **options: Any) -> tuple[RunResult, Adaption]:
    result = tm.run(Scene.model_validate(scene), **options)
    assert result.adaption is not None
    return result, result.adaption


def test_a_film_by_shooting() -> None:
    """The error told, and the true one, are within the tolerance, and the run ends where its refinement did."""
    result, found = run(disc({"tolerance": 2e-3}))
    assert (found.verdict, found.told) == ("reached", "")
    assert found.surface == "the true surface of the shape"
    last, exact = found.rounds[-1], inflated_disc(0.1, 0.3, rim="held").rise
    assert last.error is not None
    assert abs(last.error) <= last.allowed == pytest.approx(2e-3 * last.value)
    assert abs(last.value - exact) < 2e-3 * exact
    assert 0.5 < last.error / (last.value - exact) < 2.0
    assert [one.tri_count for one in found.rounds] == sorted({one.tri_count for one in found.rounds})
    assert all(not one.meets for one in found.rounds[:-1])
    assert result.mesh.tri_count == last.tri_count
    assert result.steps[-1].probes["rise"] == pytest.approx(last.value, rel=1e-6)
    assert result.passed


@pytest.mark.parametrize(("order", "tolerance", "least"), [(1, 5e-3, 0.75), (2, 2e-4, 1.5)])
def test_a_steep_place_against_its_closed_form(order: int, tolerance: float, least: float) -> None:
    """Elements gather at the inner rim; the error falls with their number by nearly half the elements' order of 2 and 4, where even
    meshes cannot follow; and the estimate tells it."""
    _, found = run(funnel(order, tolerance))
    assert found.reached
    exact = 1e-4 * np.log(1.0 / INNER) / (2.0 * np.pi)
    errors = np.array([abs(one.value - exact) for one in found.rounds])
    counts = np.array([one.tri_count for one in found.rounds])
    assert errors[-1] < 1.1 * tolerance * exact
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > least
    last = found.rounds[-1]
    assert last.error is not None
    assert 0.6 < last.error / (last.value - exact) < 1.6


def test_layers_are_resolved_before_anything_is_reached() -> None:
    """Tip at 0.3 of collapse 1.43855 mm by three codes; without its layers the estimate alone would do on the first mesh."""
    stages = [{"name": "inflate", "pressure": 0.035}, {"name": "load", "loads": {"tip": 1.288545}}]
    scene = cantilever(stages=stages).model_dump(exclude_none=True)
    scene["mesh"] |= {"around": 8, "along": 10, "adapt": {"probe": "tip", "tolerance": 0.01}}
    scene["mesh"].pop("grade", None)
    _, found = run(scene)
    assert found.reached
    assert found.rounds[0].meets
    assert found.rounds[0].layers
    assert not found.rounds[-1].layers
    assert found.rounds[-1].value == pytest.approx(-1.43855, rel=3e-3)
    assert abs(found.rounds[-1].value + 1.43855) < 0.4 * abs(found.rounds[0].value + 1.43855)
    scene["mesh"]["adapt"]["max_rounds"] = 2
    result, found = run(scene)
    assert found.verdict == "layers not resolved"
    assert "2 rounds, and the mesh does not resolve the layers of start held" in found.told
    assert not result.passed


def test_what_is_used_up_is_told(tmp_path: Path) -> None:
    result, found = run(disc({"tolerance": 1e-4, "max_rounds": 2}), out=tmp_path / "run", render=False)
    assert (found.verdict, found.told) == ("rounds used up", "2 rounds")
    assert len(found.rounds) == 2
    assert result.converged
    assert not result.passed
    saved = read_result(tmp_path / "run")
    assert saved.adaption == found
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["adaption"]["reached"] is False
    table = next(one for one in all_tables(result) if one.identity == "refined")
    assert len(table.rows) == 2
    assert "NOT REACHED for rise: rounds used up: 2 rounds" in table.note
    _, found = run(disc({"absolute": 1e-5, "max_elements": 200}))
    assert found.verdict == "elements used up"
    assert "elements would be needed, 200 are allowed" in found.told
    assert all(one.tri_count <= 200 for one in found.rounds)


def test_a_run_that_does_not_come_to_its_end_is_not_refined() -> None:
    result, found = run(disc({"tolerance": 0.01}, solver={"kind": "newton", "max_iterations": 2, "max_cuts": 0}))
    assert result.outcome == "not converged"
    assert found.verdict == "not run to its end"
    assert "on the first mesh: no equilibrium found" in found.told
    assert found.rounds == ()


def test_another_state_is_no_success() -> None:
    result, found = run(disc({"tolerance": 2e-2}))
    off = replace(found.rounds[-1], value=1.05 * found.rounds[-1].value)
    told = judged(replace(found, rounds=(*found.rounds[:-1], off)), result)
    assert told is not None
    assert told.verdict == "another state"
    told = judged(found, replace(result, outcome="not converged"))
    assert told is not None
    assert told.verdict == "not run to its end"
    assert judged(found, result) == found


def test_gas_in_a_shut_chamber_goes_with_the_meshes() -> None:
    """An arm's pressure when its valve is shut and the gas outside thins: p_abs V is kept on each mesh."""
    scene = disc(
        {"tolerance": 8e-3},
        mesh={"shape": "tube", "radius": 1.0, "length": 3.0, "around": 8, "along": 3, "cap_start": "flat"},
        supports=[{"group": "start", "hold": "xyz"}],
        pressures={"inside": {"ambient": 0.2}},
        stages=[
            {"name": "fill", "pressure": 0.02},
            {"name": "rise", "closed": ["inside"], "ambient": {"inside": 0.15}},
        ],
        probes={"rise": {"kind": "volume"}, "absolute": {"kind": "absolute_pressure", "pressure": "inside"}},
    )
    del scene["mesh"]["rings"]
    result, found = run(scene)
    assert len(found.rounds) > 1
    assert found.reached
    first, last = result.steps
    gas = [step.probes["absolute"] * step.volume for step in (first, last)]
    assert gas[1] == pytest.approx(gas[0], rel=1e-6)
    assert last.probes["rise"] == pytest.approx(found.rounds[-1].value, rel=1e-5)


@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_object_is_refined_on_its_own_surface(order: int) -> None:
    """With a cable along its edges and fields per element."""
    from taichi_membrane import shapes

    mesh = shapes.panel(width=3.0, height=2.0, along_x=12, along_y=8, order=order)
    mesh = replace(mesh, tri_fields={"t": np.where(np.arange(mesh.tri_count) < 96, 1.0, 2.0)})
    scene = {
        "name": "sail",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "given", "order": order, "adapt": {"probe": "tip", "tolerance": 2e-3, "max_rounds": 4}},
        "fabric": {
            "E": 100.0, "nu": 0.2, "thickness": {"field": "t"}, "prestress": [1.0, 1.0, 0.0],
            "law": "none",
        },
        "supports": [{"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}],
        "cables": {"edge": {"along": "y_max", "EA": 10.0}},
        "loads": {"up": {"group": "y_max", "direction": [0, 0, 1], "spread": "edges"}},
        "stages": [{"name": "up", "loads": {"up": 0.5}}],
        "probes": {"tip": {"kind": "displacement", "group": "y_max", "component": "z"}},
    }  # fmt: skip
    result = tm.run(Scene.model_validate(scene), mesh=mesh)
    found = result.adaption
    assert found is not None
    assert found.surface == f"the mesh's own {'flat' if order == 1 else 'six-node'} elements"
    assert len(found.rounds) > 1
    here, before = result.mesh, mesh.tri_areas()[:96].sum()
    assert here.tri_areas()[here.tri_fields["t"] == 1.0].sum() == pytest.approx(before, rel=1e-12)
    on_edge = np.abs(here.points[:, 1] - 2.0) < 1e-12
    assert len(result.steps[-1].cable_forces) == on_edge.sum() - 1
    assert np.vdot(result.steps[-1].reaction[:, 2], np.ones(here.node_count)) == pytest.approx(-0.5, rel=1e-5)
    exact = result.steps[-1].probes["tip"]
    assert exact == pytest.approx(found.rounds[-1].value, rel=1e-5)


def test_scenes_without_it_say_and_compile_nothing_of_it(tmp_path: Path) -> None:
    scene = disc({"tolerance": 2e-3})
    with_it, _ = run(scene)
    del scene["mesh"]["adapt"]
    plain = tm.run(Scene.model_validate(scene), out=tmp_path / "run", render=False)
    assert plain.adaption is None
    assert "adapt" not in plain.seconds
    assert "adaption" not in json.loads((tmp_path / "run" / "summary.json").read_text())
    assert plain.provenance["compiled_in"] == with_it.provenance["compiled_in"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mesh": {"adapt": {"probe": "rise"}}}, "one of tolerance and absolute is needed"),
        ({"mesh": {"adapt": {"probe": "rise", "tolerance": 0.1, "absolute": 1.0}}}, "one of tolerance and absolute"),
        ({"mesh": {"adapt": {"probe": "fall", "tolerance": 0.1}}}, "mesh.adapt.probe = 'fall' is not a probe; allowed: rise"),
        ({"probes": {"rise": {"kind": "reaction", "group": "rim", "component": "z"}}}, "of kind 'reaction'; allowed: displacement"),
        ({"solver": {"kind": "relaxation"}}, "mesh.adapt needs the tangent"),
        ({"stages": [{"name": "a", "pressure": 0.1, "control": "arc_length", "steps": 9}]}, "stage by arc length"),
        ({"probes": {"rise": {"kind": "displacement", "group": "all", "component": "z"}}}, "are those of a surface"),
        (
            {"loads": {"down": {"group": "all", "direction": [0, 0, -1]}}, "stages": [{"name": "a", "loads": {"down": 1.0}}]},
            "loads.down is spread in equal shares over nodes of 'all'",
        ),
        (
            {"planes": {"floor": {"through": [0, 0, -1], "normal": [0, 0, 1], "group": "all", "friction": 0.3}}},
            "mesh.adapt: with friction (floor.friction) is not implemented",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(changes: dict[str, Any], told: str) -> None:
    scene = disc({"tolerance": 0.1}, **changes)
    with pytest.raises(Exception, match=r"mesh|probe|loads|tolerance") as error:
        tm.run(Scene.model_validate(scene))
    assert told in str(error.value)


def test_the_command_line_says_it(tmp_path: Path) -> None:
    """A table, the verdict, and exit code 1 where a tolerance is missed."""
    path = tmp_path / "disc.toml"
    for rounds, code, told in ((1, 1, "NOT REACHED for rise: rounds used up: 1 rounds"), (9, 0, "adapt reached")):
        path.write_text(toml(disc({"tolerance": 5e-3, "max_rounds": rounds})))
        done = CliRunner().invoke(app, ["run", str(path), "--no-render", "--out", str(tmp_path / str(rounds))])
        assert done.exit_code == code, done.output
        assert told in " ".join(done.output.split())
    done = CliRunner().invoke(app, ["check", str(path)])
    assert "until the estimated error of rise at the end of inflate is below 0.5 %" in " ".join(done.output.split())


def test_relaxation_alone_has_no_tangent() -> None:
    scene = disc({"tolerance": 0.1})
    scene["fabric"]["law"] = "clip"
    with pytest.raises(InputError, match="needs a tangent, which relaxation has none of"):
        run(scene)
