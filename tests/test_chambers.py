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
from taichi_membrane.commands.printing import print_model, relief_lines
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


def squeezed_tube(gap: float, around: int) -> Mesh:
    """A tube of perimeter 2 π, short, its cross-section a stadium of this height between z = ±gap/2, with ends of one node more.

    What is inextensible and cannot bend has no shape of its own: a stadium is a cylinder.
    """
    flat = np.pi * (2.0 - gap) / 2.0
    way = np.arange(around) * 2.0 * np.pi / around
    half = np.pi * gap / 2.0
    points = np.zeros((around, 2))
    for k, s in enumerate(way):
        side, rest = divmod(s, np.pi)
        turn = 1.0 if side == 0.0 else -1.0
        if rest <= half:
            angle = 2.0 * rest / gap
            points[k] = turn * (0.5 * flat + 0.5 * gap * np.sin(angle)), -turn * 0.5 * gap * np.cos(angle)
        else:
            points[k] = turn * (0.5 * flat - (rest - half)), turn * 0.5 * gap
    width = 0.2
    nodes = [np.column_stack([np.full(around, x), points]) for x in (0.0, width)]
    ends = [[0.0, 0.0, 0.0], [width, 0.0, 0.0]]
    triangles, n = [], around
    for k in range(n):
        m = (k + 1) % n
        triangles += [(k, m, n + k), (m, n + m, n + k)]
    wall = len(triangles)
    triangles += [((k + 1) % n, k, 2 * n) for k in range(n)] + [(n + k, n + (k + 1) % n, 2 * n + 1) for k in range(n)]
    mesh = np.array(triangles)
    places = np.concatenate([*nodes, ends])
    corners = places[mesh]
    volume = np.linalg.det(corners).sum()
    mesh = mesh if volume > 0.0 else mesh[:, ::-1]
    held = {"middles": np.array([2 * n, 2 * n + 1]), "axis": np.flatnonzero(np.abs(places[:, 1]) < 1e-9)}
    return Mesh.build(places, mesh, held, {"wall": np.arange(wall), "ends": np.arange(wall, len(mesh))})


@pytest.mark.parametrize(
    ("gap", "pressure", "force"),
    [(1.9, 1.027569, 0.161410), (1.5, 1.733333, 1.361357), (1.0, 4.666667, 7.330383), (0.5, 15.142857, 35.679517)],
)
def test_a_shut_tube_between_plates(gap: float, pressure: float, force: float) -> None:
    """Gas that makes 1 in the free tube, outside 10: p and F/length = p b of the inextensible tube, T = p h/2; within 0.4 %."""
    amount = np.pi * 0.2 * 1.1
    normal = [0.0, 0.0, 1.0]
    scene = Scene.model_validate(
        {
            "name": "plates",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabrics": {
                "wall": {"E": 1e6, "nu": 0.0, "thickness": 1.0, "law": "none"},
                "ends": {"E": 1e-6, "nu": 0.0, "thickness": 1.0, "law": "none"},
            },
            "planes": {
                "floor": {"through": [0.0, 0.0, -0.5 * gap], "normal": normal},
                "top": {"through": [0.0, 0.0, 0.5 * gap], "normal": [0.0, 0.0, -1.0]},
            },
            "supports": [{"group": "all", "hold": "x"}, {"group": "middles", "hold": "yz"}, {"group": "axis", "hold": "y"}],
            "pressures": {"gas": {"ambient": 10.0}},
            "stages": [{"name": "blow", "pressure": 1.0}, {"name": "fill", "amount": amount}],
        }
    )  # fmt: skip
    result = run(scene, mesh=squeezed_tube(gap, 160))
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    assert step.pressures["gas"] == pytest.approx(pressure, rel=4e-3)
    for push in step.contact_forces.values():
        assert push / 0.2 == pytest.approx(force, rel=4e-3)
    tension = np.median(step.elements.major_resultant[: 2 * 160])
    assert tension == pytest.approx(step.pressures["gas"] * gap / 2.0, rel=5e-3)
