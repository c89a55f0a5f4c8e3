"""Runs in which parts meet: gas behind a rigid plate, shrinkage with shut gas, anchored cables above a plane, and all at once."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from resume_cases import run_until
from rich.console import Console
from run_files import different, outcome, same
from scipy.optimize import brentq
from test_body_scenes import guyed
from test_members import hanging, rope
from test_page import content, decode

import taichi_membrane as tm
from taichi_membrane.commands.model_printing import print_model
from taichi_membrane.execution.run import run
from taichi_membrane.output.reader import read_run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")

AMBIENT, EXPONENT, RELIEF, LENGTH, ALONG, THICKNESS = 10.0, 1.4, 6.0, 2.0, 40.0, 0.1
AREA, AROUND = 6.0 * np.sin(np.pi / 6.0), 24.0 * np.sin(np.pi / 12.0)


def piston(amount: float, push: float, cure: float = 0.0, **changes: Any) -> Scene:
    """A tube that is stiff around, shut by a rigid plate that slides along it: filled, pushed, and shrunk along."""
    return Scene.model_validate(
        {
            "name": "piston",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": 1.0, "length": LENGTH, "around": 12, "along": 4, "pattern": "diagonal",
                     "cap_start": "flat", "cap_end": "flat"},
            "fabric": {"E_warp": ALONG, "E_weft": 1e7, "nu": 0.0, "G": 20.0, "thickness": THICKNESS, "law": "none"},
            "groups": {"bottom": {"where": "x < 1e-9"}},
            "supports": [{"group": "bottom", "hold": "xyz"}],
            "bodies": {"plate": {"group": "cap_end", "hold": "yz", "turn_hold": "xyz"}},
            "pressures": {"gas": {"ambient": AMBIENT, "exponent": EXPONENT, "relief": RELIEF}},
            "loads": {"push": {"kind": "body", "body": "plate", "force": [-1.0, 0.0, 0.0]}},
            "shrinkages": {"cure": {"warp": 0.2}},
            "stages": [
                {"name": "fill", "amount": amount},
                {"name": "push", "closed": ["gas"], "loads": {"push": push}, "shrinkages": {"cure": cure}, "steps": 2},
            ],
            "probes": {"out": {"kind": "displacement", "group": "plate", "component": "x"},
                       "plate": {"kind": "body", "body": "plate", "of": "displacement", "component": "x"}},
            "derivatives": ["out"],
            "solver": {"kind": "newton", "tolerance": 1e-10},
            **changes,
        }
    )  # fmt: skip


def stretch(amount: float, push: float, cure: float, relief: float = RELIEF) -> float:
    """Of the wall: p A = F + b N, p_abs = p_out (amount/(A L λ))ⁿ or the valve's, N = E t λ (λ² - (1 - s)²)/2."""

    def excess(ratio: float) -> float:
        gas = min(relief, AMBIENT * (amount / (AREA * LENGTH * ratio)) ** EXPONENT - AMBIENT)
        wall = ALONG * THICKNESS * ratio * (ratio**2 - (1.0 - 0.2 * cure) ** 2) / 2.0
        return float(gas * AREA - push - AROUND * wall)

    return float(brentq(excess, 0.3, 3.0, xtol=1e-14))


FILLED = 1.5 * AREA * LENGTH


@pytest.mark.parametrize(("push", "opens"), [(0.5, False), (20.0, True)])
def test_shut_gas_behind_a_rigid_plate_is_a_spring_until_its_valve_opens(push: float, opens: bool) -> None:
    """The plate's place and the pressure by a root in one unknown, to the hoops' stretch; then what is left fills the volume."""
    result = run(piston(FILLED, push))
    assert result.converged, result.steps[-1].reason
    last = result.steps[-1]
    assert last.stable
    assert bool(last.relieved) == opens
    ratio = stretch(FILLED, push, 0.0)
    assert 1.0 + last.probes["plate"] / LENGTH == pytest.approx(ratio, rel=1e-4)
    assert last.probes["plate"] == pytest.approx(last.probes["out"], rel=1e-12)
    gas = RELIEF if opens else AMBIENT * (FILLED / (AREA * LENGTH * ratio)) ** EXPONENT - AMBIENT
    assert last.pressures["gas"] == pytest.approx(gas, rel=1e-4)
    left = last.volume * ((last.pressures["gas"] + AMBIENT) / AMBIENT) ** (1.0 / EXPONENT)
    assert last.drivers["amount.gas"] == pytest.approx(left, rel=1e-9)
    assert (last.drivers["amount.gas"] < FILLED * (1.0 - 1e-9)) == opens


def test_derivatives_by_shrinkage_and_by_amount_of_shut_gas() -> None:
    """Against the closed form's, and against differences of runs: gas and fabric give way together."""
    given = {"amount": FILLED, "push": 0.5, "cure": 0.6}
    last = run(piston(**given)).steps[-1]
    assert last.converged
    steps = {"amount.gas": ("amount", 1e-4), "shrinkage.cure": ("cure", 1e-4), "load.push": ("push", 1e-4)}
    for driver, (key, step) in steps.items():
        ends = [given | {key: given[key] + sign * step} for sign in (1.0, -1.0)]
        exact = LENGTH * (stretch(**ends[0]) - stretch(**ends[1])) / (2.0 * step)
        assert last.derivatives["out"][driver] == pytest.approx(exact, rel=2e-4)
        more, less = (run(piston(**one)).steps[-1].probes["out"] for one in ends)
        assert last.derivatives["out"][driver] == pytest.approx((more - less) / (2.0 * step), rel=1e-6)


def test_a_sheet_on_anchored_cables_lies_on_a_plane() -> None:
    """Free nodes stay above it; an anchor below, in the plane's group as all nodes are, is not pushed; all forces balance."""
    corners = {"corner_00": (-1, -1), "corner_10": (3, -1), "corner_01": (-1, 3), "corner_11": (3, 3)}
    anchors = {f"peg{k}": [x, y, 1.0] for k, (x, y) in enumerate(corners.values())}
    guys = {
        f"guy{k}": {"nodes": [corner, f"peg{k}"], "parts": 2, "EA": 20.0, "mass_per_length": 0.1}
        for k, corner in enumerate(corners)
    }
    scene = Scene.model_validate(
        {
            "name": "low",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 2.0, "height": 2.0, "along_x": 4, "along_y": 4},
            "fabric": {"E": 50.0, "nu": 0.3, "thickness": 0.1, "mass_per_area": 1.0},
            "groups": {"middle": {"where": "x = 1 within 1e-9 and y = 1 within 1e-9"}},
            "anchors": {**anchors, "deep": [1.0, 1.0, -1.0]},
            "cables": {**guys, "down": {"nodes": ["middle", "deep"], "EA": 5.0, "prestress": 1.0}},
            "pressures": {},
            "planes": {"floor": {"through": [0.0, 0.0, -0.05], "normal": [0.0, 0.0, 1.0]}},
            "loads": {"weight": {"kind": "weight", "g": 1.0}},
            "stages": [{"name": "hang", "loads": {"weight": 1.0}}],
            "solver": {"kind": "newton", "tolerance": 1e-9},
        }
    )
    result = run(scene)
    step, mesh = result.steps[-1], result.mesh
    assert step.converged, step.reason
    height = (mesh.points + step.displacement)[:, 2]
    deep = mesh.node_groups["deep"][0]
    assert height[np.arange(len(height)) != deep].min() == pytest.approx(-0.05, abs=1e-9)
    weight = 4.0 + 0.1 * 4 * np.sqrt(3.0)
    assert step.contact_forces["floor"] > 0.1
    assert step.reaction[deep, 2] == pytest.approx(5.0 * 0.05 - 1.0, rel=1e-6)
    assert step.reaction[:, 2].sum() + step.contact_forces["floor"] == pytest.approx(weight, rel=1e-7)


def test_a_line_that_warp_and_a_cable_follow_is_read_back(tmp_path: Path) -> None:
    """And a mast of lines: model and steps of a run's files are those of the run."""
    fabric = {"E_warp": 4.0, "E_weft": 1.0, "nu": 0.1, "G": 1.0, "thickness": 1.0, "warp": {"along": "rope"}}
    for scene, mesh in ((rope(4, fabric=fabric), hanging(4)), guyed()):
        result = run(scene, mesh=mesh, out=tmp_path / scene.name, render=False)
        assert result.converged
        saved = read_run(tmp_path / scene.name)
        before, after = result.mesh, saved.mesh
        assert after.tri_fields.keys() == before.tri_fields.keys()
        assert list(after.node_groups) == list(before.node_groups)
        again = build_model(saved.scene, after).structure
        first = build_model(result.scene, before).structure
        assert np.array_equal(again.geometry.warp, first.geometry.warp)
        assert np.array_equal(again.cable_sides[0], first.cable_sides[0])
        for one, other in zip(again.bodies, first.bodies, strict=True):
            assert np.array_equal(one.nodes, other.nodes)
        assert all(same(one, other) for one, other in zip(saved.steps, result.steps, strict=True))


def whole() -> Scene:
    """A shut tube with a rigid plate, held by an anchored guy and a rope that slides over the plate, on a spring; it shrinks along
    until a valve opens, and grows back."""
    return Scene.model_validate(
        {
            "name": "whole",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": 1.0, "length": 3.0, "around": 8, "along": 4, "cap_start": "flat",
                     "cap_end": "flat"},
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0, "warp": {"around": [1, 0, 0], "through": [0, 0, 0]}},
            "groups": {
                "above": {"where": "x > 2.999 and z > 0.99"},
                "beside": {"where": "x > 2.999 and y > 0.99"},
                "below": {"where": "x > 2.999 and z < -0.99"},
            },
            "supports": [{"group": "start", "hold": "xyz"}],
            "bodies": {"plate": {"group": "cap_end"}},
            "anchors": {"pole": [4.0, 0.0, 3.0], "peg": [4.0, 3.0, 0.0], "ring": [4.0, 2.0, 2.0]},
            "cables": {
                "rope": {"nodes": ["pole", "beside", "peg"], "EA": 0.1, "prestress": 0.002, "sliding": True},
                "guy": {"nodes": ["above", "ring"], "parts": 2, "EA": 0.2, "prestress": 0.003},
            },
            "springs": {"pad": {"group": "below", "stiffness": [0.0, 0.0, 0.02]}},
            "pressures": {"inside": {"ambient": 0.1, "exponent": 1.4, "relief": 0.011}},
            "loads": {"push": {"kind": "body", "body": "plate", "force": [0, 0, -1], "moment": [0.0, 0.5, 0.0]}},
            "shrinkages": {"cure": {"weft": 0.1}},
            "stages": [
                {"name": "inflate", "pressure": 0.01},
                {"name": "cure", "closed": ["inside"], "loads": {"push": 1e-3}, "shrinkages": {"cure": 1.0}, "steps": 2},
                {"name": "back", "closed": ["inside"], "shrinkages": {"cure": 0.2}},
            ],
            "probes": {
                "tip": {"kind": "displacement", "group": "plate", "component": "z"},
                "pull": {"kind": "cable", "cable": "rope"},
                "pad": {"kind": "reaction", "group": "below", "component": "z"},
            },
            "derivatives": ["tip"],
            "camera": {"size": [320, 240], "field": "free_strain"},
            "solver": {"tolerance": 1e-9},
        }
    )  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, runtime_cpu: Any) -> Path:
    """The folder of the whole run, with pictures."""
    directory = tmp_path_factory.mktemp("whole") / "run"
    result = tm.run(whole(), out=directory)
    assert result.converged, result.steps[-1].reason
    return directory


def test_a_run_of_all_of_them_goes_on_to_the_last_bit(finished: Path, tmp_path: Path) -> None:
    """Stopped before and after the valve opened; files, pictures included, are those of the run that was not stopped."""
    steps = read_run(finished).steps
    assert [bool(step.relieved) for step in steps] == [False, True, True, False]
    assert all(step.stable for step in steps)
    for last in (0, 2):
        folder = tmp_path / f"cut_{last}"
        run_until(last, whole(), out=folder)
        resumed = tm.resume(folder)
        for one, other in zip(resumed.steps, steps, strict=True):
            assert same(replace(one, seconds=0.0), replace(other, seconds=0.0))
        assert different(outcome(folder), outcome(finished)) == []


def test_check_tells_of_anchors_springs_and_shrinkage() -> None:
    said = io.StringIO()
    scene = whole()
    print_model(Console(file=said, width=200), build_model(scene, build_mesh(scene)), [], [])
    for line in (
        "anchor      pole: at [4.0, 0.0, 3.0]",
        "spring      pad: [0.0, 0.0, 0.02] in x, y, z [N/m], at each node of below",
        "shrinkage   cure: of all, by 0 in warp and 0.1 in weft",
        "body        plate: cap_end",
    ):
        assert line in said.getvalue()


def test_forces_of_all_of_them_balance(finished: Path) -> None:
    """Supports, anchors and the spring bear what the load gives; gas in a shut surface pushes nowhere."""
    for step in read_run(finished).steps:
        push = step.drivers["load.push"]
        assert step.reaction.sum(axis=0) == pytest.approx([0.0, 0.0, push], abs=1e-7)
        assert step.cable_forces.shape == (4,)
        assert step.cable_forces.min() > 0.0
        assert step.probes["pull"] == step.cable_forces[2] == step.cable_forces[3]


def test_their_page_and_pictures_show_them(finished: Path) -> None:
    """The page holds cables and stress-free strain; the picture's cables have colours that its fabric has not."""
    saved = read_run(finished)
    result = tm.RunResult(
        scene=saved.scene, mesh=saved.mesh, steps=saved.steps, checks=(), seconds={}, provenance=saved.provenance
    )
    head, block = content(result)
    assert len(decode(block, head["cables"]["nodes"])) == 8
    assert np.allclose(decode(block, head["steps"][-1]["cable_force"]), saved.steps[-1].cable_forces, rtol=1e-6)
    assert "free_strain" in str(head["fields"])
    for number in range(len(saved.steps)):
        assert Image.open(finished / f"step_{number:04d}.png").size == (320, 240)
