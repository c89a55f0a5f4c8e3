"""What may be a chamber: several surfaces of one gas, holes and what is inside out; mistakes in stages; a tube between plates."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from test_gas import AMBIENT, sphere

from taichi_membrane import shapes
from taichi_membrane.assurance.verification.filled import TUBE_LENGTH, plates_scene, squeezed_tube
from taichi_membrane.commands.model_printing import print_model
from taichi_membrane.commands.printing import relief_lines
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SMALL = 0.6


def two_balls(*, turned: bool = False, holed: bool = False, apart: float = 3.0) -> Mesh:
    """Spheres of radius 1 and 0.6 side by side, the second inside out or with a hole; held in what leaves them free to swell."""
    big, small = shapes.sphere(radius=1.0, divisions=6), shapes.sphere(radius=SMALL, divisions=6)
    count, inner = big.node_count, small.triangles[1:] if holed else small.triangles
    points = np.concatenate([big.points, small.points + np.array([apart, 0.0, 0.0])])
    triangles = np.concatenate([big.triangles, (inner[:, ::-1] if turned else inner) + count])
    centre = np.where(np.arange(len(points)) < count, 0.0, apart)
    held = {}
    for name, axes in (("x", (1, 2)), ("y", (0, 2)), ("z", (0, 1))):
        at = points - np.column_stack([centre, 0.0 * centre, 0.0 * centre])
        held[f"on_{name}"] = np.flatnonzero(np.abs(at[:, axes]).max(axis=1) < 1e-9)
    first = np.arange(big.tri_count)
    return Mesh.build(points, triangles, held, {"big": first, "small": np.arange(big.tri_count, len(triangles))})


def balls(pressures: dict[str, Any], **changes: Any) -> Scene:
    scene = {
        "mesh": {"shape": "given"},
        "groups": {},
        "pressures": pressures,
        "stages": [{"name": "fill", "amount": {"gas": 6.5}}],
        "probes": {"big": {"kind": "radius", "group": "on_x", "axis": "centre"}},
    }
    return sphere(4, 1.0, **(scene | changes))


def test_one_gas_fills_several_surfaces() -> None:
    """Two balls joined for good: one pressure, the volume both have, and for each ball its own closed form at that pressure."""
    result = run(
        balls({"gas": {"ambient": AMBIENT}}, probes={"V": {"kind": "volume", "pressure": "gas"}}), mesh=two_balls()
    )
    step = result.steps[-1]
    assert step.converged
    assert (step.pressures["gas"] + AMBIENT) * step.probes["V"] == pytest.approx(6.5 * AMBIENT, rel=1e-12)
    mesh = two_balls()
    for group, radius in (("big", 1.0), ("small", SMALL)):
        nodes = np.unique(mesh.triangles[mesh.tri_groups[group]])
        arms = (mesh.points + step.displacement)[nodes]
        stretch = np.linalg.norm(arms - arms.mean(axis=0), axis=1).mean() / radius
        exact = 100.0 * 0.1 * (stretch - 1.0 / stretch) / (0.7 * radius)  # p R = E t (λ - 1/λ)/(1 - ν)
        assert step.pressures["gas"] == pytest.approx(exact, rel=0.03)


def test_check_tells_what_each_chamber_is() -> None:
    scene = balls({"gas": {"ambient": AMBIENT}})
    model = build_model(scene, two_balls())
    said = io.StringIO()
    print_model(Console(file=said, width=200), model, [], [])
    volume = two_balls().enclosed_volume()
    line = rf"chamber +gas: 2 surfaces, closed, volume {volume:.6g} m³, area [\d.]+ m², behind {two_balls().tri_count} elements"
    assert re.search(line, said.getvalue()), said.getvalue()


def test_a_shell_between_two_surfaces_is_no_chamber_inside_out() -> None:
    """The inner one has the gas before it; alike whether its normals or its place among the groups say so."""
    volumes = []
    for turned, surfaces in ((False, {"group": "big", "against": "small"}), (True, {"group": "all"})):
        model = build_model(
            balls({"gas": {"ambient": AMBIENT, **surfaces}}, probes={}), two_balls(turned=turned, apart=0.0)
        )
        volumes.append(model.chambers[0].volume(model.structure.mesh.points))
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-14)
    assert volumes[0] == pytest.approx(4.0 / 3.0 * np.pi * (1.0 - SMALL**3), rel=0.05)


def test_each_surface_of_a_chamber_is_looked_at() -> None:
    """The gas before a ball that stands beside the other one, and not in it; a hole in the second one."""
    beside = {"gas": {"ambient": AMBIENT, "group": "big", "against": "small"}}
    told = r"pressures\.gas: the one with element 288 \(in small\) of its surfaces is inside out: its volume is -"
    with pytest.raises(InputError, match=told):
        build_model(balls(beside), two_balls())
    told = r"no hole, but of its 2 surfaces the one with element 288 \(in small\) has a hole: its 287 elements have 3 free edges"
    with pytest.raises(InputError, match=told):
        build_model(balls({"gas": {"ambient": AMBIENT}}), two_balls(holed=True))


START = {"name": "inflate", "pressure": {"gas": 1.0}}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"pressures": {"gas": {"relief": 1.0}}}, r"pressures\.gas\.relief is for shut chambers: it needs ambient"),
        (
            {"pressures": {"gas": {}}, "stages": [{"name": "s", "amount": 1.0}]},
            r"stages\.s\.amount: pressures\.gas needs ambient",
        ),
        (
            {"stages": [{"name": "s", "amount": {"air": 1.0}}]},
            r"stages\.s\.amount: 'air' is not a pressure .*: gas, outside",
        ),
        (
            {"stages": [{"name": "s", "amount": {"outside": 1.0}}]},
            r"stages\.s\.amount: pressures\.outside needs ambient",
        ),
        ({"stages": [{"name": "s", "amount": 1.0}]}, r"stages\.s\.amount is one number, but there are 2 pressures"),
        ({"stages": [{"name": "s", "amount": {"gas": 0.0}}]}, r"amount"),
        ({"stages": [{"name": "s", "amount": {"gas": 1.0}, "closed": ["gas"]}]}, r"shuts the valve of 'gas' already"),
        (
            {"stages": [START | {"amount": {"gas": 1.0}}]},
            r"stages\.inflate\.amount: pressure 'gas' cannot be shut and set",
        ),
        (
            {"stages": [{"name": "s", "ambient": {"outside": 1.0}}]},
            r"stages\.s\.ambient: pressures\.outside needs ambient",
        ),
        (
            {"pressures": {"gas": {}}, "stages": [{"name": "s", "ambient": 1.0}]},
            r"stages\.s\.ambient: no pressure .*has ambient",
        ),
        ({"stages": [{"name": "s", "ambient": -1.0}]}, r"ambient"),
        (
            {"pressures": {"gas": {"ambient": 1.0, "relief": 0.5}, "outside": {"kind": "fixed"}}},
            r"stages\.inflate\.pressure: 2, but pressures\.gas\.relief opens at 0\.5",
        ),
        (
            {"stages": [{"name": "s", "amount": {"gas": 1.0}}], "solver": {"kind": "relaxation"}},
            r"stages\.s\.amount: a shut chamber needs solver\.kind 'hybrid' or 'newton'",
        ),
        (
            {"stages": [START, {"name": "s", "joined": [["gas", "air"]]}]},
            r"joined: 'gas' is not a pressure that the stage shuts",
        ),
        ({"stages": [START, {"name": "s", "joined": [["gas"]]}]}, r"joined"),
        (
            {"probes": {"p": {"kind": "absolute_pressure", "pressure": "outside"}}},
            r"probes\.p\.pressure: 'outside' is not a follower pressure with ambient .*allowed: gas",
        ),
    ],
)
def test_mistakes_in_stages_are_named(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        sphere(4, 1.0, **changes)


def test_what_is_not_alike_is_not_joined() -> None:
    gases = {"a": {"group": "big", "ambient": 1.0}, "b": {"group": "small", "ambient": 1.0, "exponent": 1.4}}
    stage = {"name": "s", "closed": ["a", "b"], "joined": [["a", "b"]]}
    with pytest.raises(ValueError, match=r"one gas fills 'a' and 'b', but their exponent is 1\.0 and 1\.4"):
        balls(gases, stages=[stage], probes={})
    with pytest.raises(ValueError, match=r"stages\.s\.joined: 'b' stands in it twice"):
        balls(
            gases | {"b": {"group": "small", "ambient": 1.0}},
            stages=[stage | {"joined": [["a", "b"], ["b", "a"]]}],
            probes={},
        )


def test_a_flat_chamber_is_not_shut_before_it_has_a_volume() -> None:
    cushion = {
        "mesh": {"shape": "cushion", "width": 1.0, "height": 1.0, "along_x": 4, "along_y": 4},
        "groups": {}, "probes": {}, "pressures": {"gas": {"ambient": 1.0}},
        "supports": [{"group": "all", "hold": "xy"}, {"group": "corners", "hold": "z"}],
    }  # fmt: skip
    fill = {"name": "fill", "amount": 1.0}
    scene = sphere(4, 1.0, **cushion, stages=[fill])
    mesh = build_mesh(scene)
    with pytest.raises(
        InputError, match=r"stages\.fill: it shuts the valve of 'gas', whose chamber is flat \(volume 0\)"
    ):
        build_model(scene, mesh)


def test_a_run_tells_where_a_relief_valve_opened() -> None:
    gas = {"ambient": AMBIENT, "relief": 2.1}
    result = run(sphere(4, 1.0, pressures={"gas": gas, "outside": {"kind": "fixed"}}))
    assert len(relief_lines(result)) == 1
    assert re.match(
        r"of gas opened at load step 1, at 2\.1 Pa: let out 0\.\d+ m³ of gas at 10 Pa", relief_lines(result)[0]
    )


@pytest.mark.parametrize(
    ("gap", "pressure", "force"),
    [(1.9, 1.027569, 0.161410), (1.5, 1.733333, 1.361357), (1.0, 4.666667, 7.330383), (0.5, 15.142857, 35.679517)],
)
def test_a_shut_tube_between_plates(gap: float, pressure: float, force: float) -> None:
    """Gas that makes 1 in the free tube, outside 10: p and F/length = p b of the inextensible tube, T = p h/2; within 0.4 %."""
    content = {"name": "plates", "units": {"length": "m", "force": "N"}, **plates_scene(gap, 1.0, 10.0)}
    scene = Scene.model_validate(content)
    result = run(scene, mesh=squeezed_tube(gap, 160))
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    assert step.pressures["gas"] == pytest.approx(pressure, rel=4e-3)
    for push in step.contact_forces.values():
        assert push / TUBE_LENGTH == pytest.approx(force, rel=4e-3)
    tension = np.median(step.elements.major_resultant[: 2 * 160])
    assert tension == pytest.approx(step.pressures["gas"] * gap / 2.0, rel=5e-3)
