"""Load cases: each is what its stage and it alone would give, to the last bit; verdicts, tables, files and the rest of them."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from resume_cases import run_until
from rich.console import Console
from run_files import different, outcome, same
from tents import Parts, height_at
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands import printing
from taichi_membrane.commands.cli import app
from taichi_membrane.execution.run import read_result
from taichi_membrane.page.document import page
from taichi_membrane.pictures.gallery import draw_envelope
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.cases import envelope, numbers, ranges
from taichi_membrane.simulation.results import RunResult

LENGTH, PRESSURE, AMBIENT = 300.0, 0.03, 0.1
PARTS: dict[str, Any] = {
    "name": "beam",
    "units": {"length": "mm", "force": "N"},
    "mesh": {"shape": "tube", "radius": 25, "length": LENGTH, "around": 8, "along": 8, "cap_end": "flat", "cap_start": "flat"},
    "fabric": {
        "stiffness_warp": 400, "stiffness_weft": 250, "nu": 0.1, "G_t": 15, "strength_warp": "20 kN/m", "strength_weft": 15.0,
        "safety": {"factor": 4.0, "source": "made up"},
    },
    "supports": [{"group": "start", "hold": "xyz"}],
    "anchors": {"peg": [150.0, 90.0, 0.0]},
    "cables": {"stay": {"nodes": ["waist", "peg"], "EA": 50.0, "length": 64.0}},
    "groups": {"waist": {"where": "x = 150 within 1e-6 and y > 24.9"}},
    "pressures": {"inside": {"ambient": AMBIENT}},
    "loads": {
        "tip": {"group": "end", "direction": [0, 0, -1]},
        "side": {"group": "end", "direction": [0, -1, 0]},
    },
    "probes": {
        "deflection": {"kind": "displacement", "group": "end", "component": "z"},
        "used": {"kind": "utilisation"},
    },
    "stages": [{"name": "inflate", "pressure": PRESSURE, "steps": 2}, {"name": "lean", "loads": {"side": 0.5}}],
    "checks": [
        {"probe": "used", "stage": "both", "at_most": 1.0, "source": "strength over safety"},
        {"probe": "deflection", "stage": "down", "at_least": -3.0, "source": "L/100"},
    ],
    "camera": {"size": [320, 240]},
}  # fmt: skip
CASES: list[dict[str, Any]] = [
    {"name": "down", "title": "a load at the end", "loads": {"tip": 2.0}, "steps": 2, "after": "inflate"},
    {"name": "storm", "loads": {"side": 2.0, "tip": 1.0}, "pressure": 0.04, "effect_factor": 1.5},
    {"name": "shut", "loads": {"tip": 2.0}, "closed": ["inside"]},
    {"name": "both", "combine": {"down": 1.5, "storm": 0.5}, "loads": {"side": 1.25}, "after": "inflate"},
]


def beam(**changes: Any) -> Scene:
    """A short air beam with stays, leaning in its second stage."""
    return Scene.model_validate(PARTS | {"cases": CASES} | changes)


@pytest.fixture(scope="module")
def run(runtime_cpu: Any, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The beam with its cases, and files."""
    return tm.run(beam(), out=tmp_path_factory.mktemp("cases") / "run", render=False)


@pytest.fixture(scope="module")
def tents(runtime_cpu: Any, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A tent that snaps at 1 N, of which all is known, with a case beyond that."""
    scene, mesh = tent()
    return tm.run(scene, mesh=mesh, out=tmp_path_factory.mktemp("tents") / "run", render=False)


def tent(*cases: str, **changes: Any) -> tuple[Scene, tm.Mesh]:
    """The scene with the named cases, all without names, and its mesh."""
    parts = Parts().tent("tent", 1.0, 1.0)
    given = [
        {"name": "low", "loads": {"tent": 0.5}},
        {"name": "beyond", "loads": {"tent": 2.0}, "steps": 2},
        {"name": "high", "loads": {"tent": 0.9}, "steps": 2},
    ]
    asked = [one for one in given if not cases or one["name"] in cases]
    scene = parts.scene | {"stages": [{"name": "first", "loads": {"tent": 0.3}}], "cases": asked} | changes
    mesh = tm.Mesh.build(np.vstack(parts.points), np.vstack(parts.triangles), parts.groups, parts.elements)
    return Scene.model_validate(scene), mesh


def test_each_case_has_its_verdict(tents: RunResult) -> None:
    low, beyond, high = tents.cases.values()
    assert [case.verdict for case in (low, beyond, high)] == ["reached", "collapse", "reached"]
    assert tents.outcome == "finished"
    assert not tents.converged
    for case, load in ((low, 0.5), (high, 0.9)):
        assert case.end is not None
        assert case.end.probes["tent"] == pytest.approx(height_at(load) - 1.0, rel=1e-4)
    assert beyond.end is None
    assert numbers(tents, beyond) == {}
    found = re.fullmatch(r"the largest stable load has load.tent between (\S+) and (\S+)", beyond.reason)
    assert found is not None
    assert float(found[1]) == pytest.approx(1.0, rel=2e-3)
    assert [step.stage for step in tents.steps] == ["first", "low", "beyond", "high", "high"]
    assert [step.stage for step in tents.stage_steps] == ["first"]


def test_cases_do_not_know_of_one_another(tents: RunResult) -> None:
    """What stands after a collapse is what it is without it, to the last bit."""
    scene, mesh = tent("high")
    alone = tm.run(scene, mesh=mesh)
    for one, two in zip(alone.cases["high"].steps, tents.cases["high"].steps, strict=True):
        assert same(dict(one.fields), dict(two.fields))
        assert (one.probes, one.trace, one.iterations) == (two.probes, two.trace, two.iterations)


def test_a_collapse_is_a_reason_everywhere_and_never_a_number(tents: RunResult) -> None:
    assert tents.directory is not None
    rows = list(csv.DictReader((tents.directory / "cases.csv").open()))
    assert [row["verdict"] for row in rows] == ["reached", "collapse", "reached"]
    assert rows[1]["tent [mm]"] == ""
    assert rows[1]["reason"] == tents.cases["beyond"].reason
    summary = json.loads((tents.directory / "summary.json").read_text("utf-8"))
    assert (summary["converged"], summary["outcome"], summary["complete"]) == (False, "finished", True)
    assert (summary["cases"][1]["numbers"], summary["cases"][1]["reactions"]) == ({}, None)
    assert summary["case_ranges"]["tent"]["least_case"] == "high"
    assert summary["envelope_cases"] == ["low", "high"]
    said = io.StringIO()
    printing.print_run(Console(file=said, width=200), tents)
    assert re.search(r"beyond +first +COLLAPSE +- +-", said.getvalue())
    assert "COLLAPSE: case beyond: the largest stable load has load.tent between" in said.getvalue()
    assert "2 of 3 load cases are reached" in page(tents)


def test_the_exit_code_is_that_of_the_worst_case(tents: RunResult, tmp_path: Path) -> None:
    assert tents.directory is not None
    folder = Path(shutil.copytree(tents.directory, tmp_path / "run"))
    ended = CliRunner().invoke(app, ["run", "--resume", str(folder), "--quiet"])
    assert ended.exit_code == 4
    assert "COLLAPSE: case beyond: the largest stable load" in ended.output


def test_a_run_stopped_in_a_case_goes_on_and_does_none_again(tents: RunResult, tmp_path: Path) -> None:
    assert tents.directory is not None
    for last in (1, 3):  # after the first case; amid the two load steps of the last one
        scene, mesh = tent()
        folder = tmp_path / str(last)
        run_until(last, scene, mesh=mesh, out=folder, render=False)
        stopped = read_result(folder).cases["high"]
        assert stopped.verdict == "interrupted"
        assert stopped.end is None
        kept = (folder / "step_0001.vtu").stat().st_mtime_ns
        went_on = tm.resume(folder)
        assert (folder / "step_0001.vtu").stat().st_mtime_ns == kept
        assert [case.verdict for case in went_on.cases.values()] == ["reached", "collapse", "reached"]
        assert different(outcome(tents.directory), outcome(folder)) == []


def test_a_case_whose_stage_is_not_reached_is_not_started() -> None:
    stages = [{"name": "first", "loads": {"tent": 0.3}}, {"name": "over", "loads": {"tent": 2.0}}]
    cases = [{"name": "late", "loads": {"tent": 0.1}}, {"name": "early", "loads": {"tent": 0.1}, "after": "first"}]
    scene, mesh = tent(stages=stages, cases=cases)
    result = tm.run(scene, mesh=mesh)
    assert result.outcome == "collapse"
    assert [case.verdict for case in result.cases.values()] == ["not started", "reached"]
    assert result.cases["late"].reason == "stage over, from whose end it starts, did not come to it"


def test_verdicts_of_steps_that_are_no_result(tents: RunResult) -> None:
    """A state that is unstable, or no equilibrium, has no numbers either."""
    low = tents.cases["low"].steps[0]
    for change, verdict, reason in (
        ({"negative_pivots": 2}, "unstable", "its state is unstable (2 negative eigenvalues of the tangent)"),
        ({"converged": False, "reason": "no equilibrium"}, "not converged", "no equilibrium"),
    ):
        steps = [replace(low, **change) if step is low else step for step in tents.steps]
        changed = replace(tents, steps=tuple(steps))
        assert (changed.cases["low"].verdict, changed.cases["low"].reason) == (verdict, reason)
        assert numbers(changed, changed.cases["low"]) == {}
        assert {one.least_case for one in ranges(changed)} == {"high"}


@pytest.mark.parametrize("name", ["down", "storm", "shut", "both"])
def test_a_case_is_what_its_stage_and_it_alone_would_give(run: RunResult, name: str) -> None:
    """To the last bit, and so whatever other cases there are, and in which order, collapsed ones included."""
    ramp, before = run.scene.ramp(name), run.scene.before(run.scene.ramp(name))
    keys = ("name", "steps", "loads", "pressure", "closed", "effect_factor")
    alone = {key: getattr(ramp, key) for key in keys if getattr(ramp, key) not in (None, [], {})}
    stages = [stage.model_dump(exclude_unset=True) for stage in before]
    other = tm.run(Scene.model_validate(PARTS | {"stages": [*stages, alone], "checks": []}))
    assert other.converged
    mine = [step for step in other.steps if step.stage == name]
    for one, two in zip(mine, run.cases[name].steps, strict=True):
        assert same(dict(one.fields), dict(two.fields))
        assert one.probes == two.probes
        assert (one.negative_pivots, one.volume, one.energy) == (two.negative_pivots, two.volume, two.energy)
        assert all(two.drivers[driver] == value for driver, value in one.drivers.items())


def test_a_case_starts_from_a_shut_valve_as_a_stage_does() -> None:
    """The gas of the chamber is part of what it starts from."""
    kept = {"name": "kept", "closed": ["inside"], "loads": {"tip": 1.0}, "steps": 2}
    more = {"name": "more", "closed": ["inside"], "loads": {"tip": 2.0}}
    stages = [*PARTS["stages"], kept]
    first = {"name": "first", "loads": {"tip": 3.0}}
    branched = tm.run(beam(stages=stages, cases=[first, more], checks=[])).cases["more"].steps[0]
    straight = tm.run(Scene.model_validate(PARTS | {"stages": [*stages, more], "checks": []})).steps[-1]
    assert branched.pressures["inside"] > PRESSURE
    assert same(dict(branched.fields), dict(straight.fields))
    assert branched.probes == straight.probes


def test_a_combination_has_the_sums_of_its_cases_times_their_factors(run: RunResult) -> None:
    both = run.cases["both"].end
    assert both is not None
    # 1.5 of the tip's 2 N and half of the storm's 1 N; the side load as it says itself; the storm's pressure as it is.
    assert both.loads == {"tip": pytest.approx(3.5), "side": 1.25}
    assert both.pressures["inside"] == 0.04
    shut = run.cases["shut"].end
    assert shut is not None
    assert shut.pressures["inside"] != PRESSURE  # it follows the volume
    assert shut.pressures["inside"] == pytest.approx(PRESSURE, rel=0.05)


def test_numbers_are_those_of_the_end_and_forces_balance(run: RunResult) -> None:
    for name in ("down", "storm", "both"):
        case = run.cases[name]
        held, end = numbers(run, case), case.end
        assert end is not None
        assert held["deflection"].value == end.probes["deflection"]
        used = np.nanmax(end.elements.utilisation)
        assert held["largest utilisation"].value == used == held["used"].value
        assert held["largest utilisation"].place == f"element {int(np.argmax(end.elements.utilisation))}"
        # Supports and the anchor bear the loads and what the pressure has without a part of the surface: nothing, it is closed.
        total = [held[f"reaction of all held nodes, {axis}"].value for axis in "xyz"]
        assert total == pytest.approx([0.0, end.loads["side"], end.loads["tip"]], abs=1e-5)
        assert held["force of stay"].value == end.cable_forces[0]
        pull = [held[f"reaction of peg, {axis}"].value for axis in "xyz"]
        assert np.linalg.norm(pull) == pytest.approx(end.cable_forces[0], rel=1e-9)
        assert held["reaction of peg, size"].value == pytest.approx(end.cable_forces[0], rel=1e-9)


def test_checks_of_cases_are_judged_at_their_ends(run: RunResult) -> None:
    assert run.converged
    assert [case.after for case in run.cases.values()] == ["inflate", "lean", "lean", "inflate"]
    assert run.cases["down"].title == "a load at the end"
    used, deflection = run.checks
    assert (used.value, deflection.value) == tuple(
        run.cases[name].steps[-1].probes[probe] for name, probe in (("both", "used"), ("down", "deflection"))
    )


def test_ranges_and_envelopes_are_extremes_over_the_ends(run: RunResult) -> None:
    ends = {name: case.end for name, case in run.cases.items() if case.end is not None}
    found = {one.quantity: one for one in ranges(run)}
    deflections = {name: end.probes["deflection"] for name, end in ends.items()}
    worst = found["deflection"]
    assert (worst.least.value, worst.least_case) == min((value, name) for name, value in deflections.items())
    assert (found["pressure.inside"].largest.value, found["pressure.inside"].largest_case) == (0.04, "storm")
    over = envelope(run)
    assert over is not None
    assert over.cases == tuple(ends)
    for name in ("utilisation", "major_resultant", "warp_resultant", "weft_resultant"):
        for element in range(run.mesh.tri_count):
            assert over.values[name][element] == max(end.fields[name][element] for end in ends.values())
    shear = np.max([np.abs(end.fields["shear_resultant"]) for end in ends.values()], axis=0)
    assert np.array_equal(over.values["shear_resultant"], shear)
    leading = [list(ends.values())[case].elements.utilisation[k] for k, case in enumerate(over.governing)]
    assert leading == over.values["utilisation"].tolist()
    assert over.slack.tolist() == [any(end.elements.state[k] == 2 for end in ends.values()) for k in range(len(shear))]


def test_files_hold_cases_their_numbers_and_the_envelope(run: RunResult) -> None:
    folder = run.directory
    assert folder is not None
    rows = list(csv.DictReader((folder / "cases.csv").open()))
    assert [row["verdict"] for row in rows] == 4 * ["reached"]
    assert (
        float(rows[1]["reaction of peg, size [N]"]) == numbers(run, run.cases["storm"])["reaction of peg, size"].value
    )
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    assert [case["name"] for case in summary["cases"]] == ["down", "storm", "shut", "both"]
    assert summary["cases"][1]["numbers"]["used"] == {
        "value": numbers(run, run.cases["storm"])["used"].value,
        "unit": "",
    }
    assert summary["case_ranges"]["used"]["largest_case"] == "storm"
    assert summary["envelope_cases"] == ["down", "storm", "shut", "both"]
    assert {"cases.csv", "envelope.vtu"} <= set(summary["files"])
    held = meshio.read(folder / "envelope.vtu")
    over = envelope(run)
    assert over is not None
    assert np.array_equal(held.cell_data["utilisation"][0], over.values["utilisation"])
    assert np.array_equal(held.cell_data["governing_case"][0], over.governing)
    again = read_result(folder)
    assert {name: case.verdict for name, case in again.cases.items()} == {n: c.verdict for n, c in run.cases.items()}
    assert numbers(again, again.cases["both"]) == numbers(run, run.cases["both"])
    assert again.checks == run.checks


def test_the_envelope_is_drawn_on_the_shape_that_cases_start_from(run: RunResult, tmp_path: Path) -> None:
    assert draw_envelope(run, run.scene.camera, tmp_path / "envelope.png")
    drawn = np.asarray(Image.open(tmp_path / "envelope.png").convert("RGB")).astype(int)
    assert drawn.shape == (240, 320, 3)
    assert (np.ptp(drawn, axis=2) > 60).mean() > 0.02  # coloured, not grey
    nobody = replace(run, steps=run.stage_steps)
    assert not draw_envelope(nobody, run.scene.camera, tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_terminal_and_page_tell_them(run: RunResult) -> None:
    said = io.StringIO()
    printing.print_run(Console(file=said, width=200), run)
    text = said.getvalue()
    assert re.search(r"used +\S+ +\S+ +\S+ +storm", text)
    assert re.search(r"peg +\S+ +-?\d\S* +-?\d\S* +-?\d\S* +\w+", text)
    shown = page(run)
    assert "4 of 4 load cases are reached" in shown
    for caption in ("Load cases", "Worst cases", "Largest support forces", "Support forces of load cases"):
        assert f"<caption>{caption}</caption>" in shown


def test_without_cases_are_the_stages_alone() -> None:
    alone = beam(curve={"x": "deflection", "y": "load.tip", "stage": "down"}).without_cases()
    assert (alone.cases, alone.checks, alone.curve) == ([], [], None)
    assert Scene.model_validate(alone.model_dump()) == alone
    assert beam().ramps[-1].key == "cases.both"


@pytest.mark.parametrize(
    ("cases", "told"),
    [
        ([{"name": "lean"}], "cases.lean: another stage or case has the name already"),
        ([{"name": "a"}, {"name": "a"}], "cases.a: another stage or case has the name already"),
        ([{"name": "a", "after": "b"}], "cases.a.after: 'b' is not a stage of this scene; allowed: inflate, lean"),
        ([{"name": "a", "loads": {"tap": 1.0}}], "cases.a.loads: 'tap' is not a load of this scene; allowed: tip, side"),
        ([{"name": "a", "loads": {"tip": "1 mm"}}], "cases.a.loads.tip: '1 mm' is a length, but load 'tip' takes a force"),
        ([{"name": "a", "closed": ["out"]}], "cases.a.closed"),
        ([{"name": "a", "combine": {"b": 1.0}}], "cases.a.combine: 'b' is not a case that could be combined; allowed: (none)"),
        (
            [{"name": "a"}, {"name": "b", "combine": {"a": 1.0}}, {"name": "c", "combine": {"b": 1.0}}],
            "cases.c.combine: 'b' is not a case that could be combined; allowed: a",
        ),
        (
            [{"name": "a", "pressure": 0.02}, {"name": "b", "pressure": 0.03}, {"name": "c", "combine": {"a": 1.0, "b": 1.0}}],
            "cases.c.combine: pressure is 0.02 in 'a' and 0.03 in 'b'; give the one that is meant: pressure = ...",
        ),
        ([{"name": "a", "until": "collapse"}], "until"),
    ],
)  # fmt: skip
def test_cases_that_are_none_are_refused(cases: list[dict[str, Any]], told: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(told)):
        beam(cases=cases, checks=[])


def test_check_lists_them() -> None:
    from taichi_membrane.commands.model_printing import print_model
    from taichi_membrane.execution.run import summarise

    said = io.StringIO()
    print_model(Console(file=said, width=200), *summarise(beam()))
    assert re.search(r"case +down: 2 steps, load tip to 2 N, after inflate", said.getvalue())
    assert re.search(
        r"both: 1 step, pressure inside to 0.04 MPa, load tip to 3.5 N, load side to 1.25 N, after", said.getvalue()
    )


def test_errors_of_cases_are_estimated_as_those_of_stages() -> None:
    """Each from the end of its stage on the finer mesh too, the gas that it shuts in among it."""
    cases = [{"name": "side", "loads": {"side": 1.0}}, {"name": "shut", "loads": {"tip": 2.0}, "closed": ["inside"]}]
    # Finer and softer, as cut in four a stiff tube of eight sides would be another one.
    parts = {
        "mesh": PARTS["mesh"] | {"around": 24},
        "fabric": PARTS["fabric"] | {"stiffness_warp": 80, "stiffness_weft": 50},
    }
    branched = tm.run(beam(cases=cases, checks=[], **parts), estimate="all").estimate
    asked = PARTS | parts | {"stages": [*PARTS["stages"], cases[1]], "checks": []}
    straight = tm.run(Scene.model_validate(asked), estimate="all")
    assert branched is not None
    assert straight.estimate is not None
    assert [step.stage for step in branched.steps] == ["inflate", "inflate", "lean", "side", "shut"]
    one, other = branched.steps[-1], straight.estimate.steps[-1]
    assert not one.unknown
    for name, probe in one.probes.items():
        assert probe.value == other.probes[name].value
        assert probe.fine == pytest.approx(other.probes[name].fine, rel=1e-6)
