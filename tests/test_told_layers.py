"""Boundary layers beside held, loaded, kinked and joining lines: their lengths, the size of elements there, and what is told."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taichi_membrane as tm
from taichi_membrane import shapes
from taichi_membrane.execution.run import read_result
from taichi_membrane.mesh import Mesh
from taichi_membrane.output.tables import UNRESOLVED, layer_lines
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.accuracy import Layer
from taichi_membrane.simulation.model import build_mesh, build_model, with_scene_groups
from taichi_membrane.simulation.told_layers import told_layers

# r √(p r/(2 E t)) of what follows, with the modulus around the tube.
LENGTH = 25.0 * np.sqrt(0.035 * 25.0 / 2.0 / (1000.0 * 0.1))


def tube(**changes: Any) -> Scene:
    scene = {
        "name": "tube",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 25, "length": 100, "around": 16, "along": 10},
        "fabric": {"E_warp": 4000, "E_weft": 1000, "G": 300, "nu": 0.1, "thickness": 0.1},
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": [0, 0, -1]}},
        "stages": [{"name": "inflate", "pressure": 0.035}, {"name": "load", "loads": {"tip": 0.5}}],
        "probes": {"tip": {"kind": "displacement", "group": "end", "component": "z"}},
    }
    return Scene.model_validate({**scene, **changes})


def foreseen(scene: Scene, mesh: Mesh | None = None) -> tuple[Layer, ...]:
    """The layers as ``check`` tells them."""
    return told_layers(build_model(scene, build_mesh(scene) if mesh is None else with_scene_groups(scene, mesh)))


def causes(layers: tuple[Layer, ...]) -> list[tuple[str, ...]]:
    return [one.causes for one in layers]


def test_lengths_and_sizes_beside_rings_of_a_tube() -> None:
    start, end = foreseen(tube())
    assert start.causes == ("start held",)
    assert end.causes == ("loaded by tip", "joins cap_end")
    assert [side.side for side in end.sides] == ["wall", "cap_end"]
    wall = start.sides[0]
    assert wall.length == pytest.approx(LENGTH, rel=1e-3)
    assert wall.size == pytest.approx(np.hypot(10.0, 25.0 * (1.0 - np.cos(np.pi / 16.0))), rel=1e-6)
    assert wall.ratio == pytest.approx(wall.size / LENGTH, rel=1e-3)
    assert (wall.resolved, start.resolved) == (False, False)
    text = layer_lines((start, end), "mm")
    assert text[0] == f"start held: wall h = 10 mm, l = 1.65 mm, h/l = 6.1. WARNING: {UNRESOLVED}"


def test_graded_rings_are_resolved_and_so_is_said() -> None:
    mesh = {"shape": "tube", "radius": 25, "length": 100, "around": 16, "along": 10, "pattern": "diagonal"}
    layers = foreseen(tube(mesh=mesh | {"grade": "auto"}))
    assert [side.resolved for one in layers for side in one.sides] == [True, True, True]
    assert layers[0].sides[0].ratio == pytest.approx(0.5, rel=0.1)
    assert not any("WARNING" in line for line in layer_lines(layers, "mm"))


def test_a_mesh_without_a_shape_is_told_the_same() -> None:
    """Corners and groups alone, as from a file."""
    made = shapes.tube(radius=25.0, length=100.0, around=16, along=10)
    groups = {name: made.node_groups[name] for name in ("start", "end")}
    bare = Mesh.build(made.points, made.triangles, groups, None, made.tri_warp)
    scene = tube(mesh={"shape": "given"})
    start, end = foreseen(scene, bare)
    assert (start.causes, end.causes) == (("start held",), ("loaded by tip",))
    assert start.sides[0].length == pytest.approx(LENGTH, rel=1e-3)
    assert [side.side for side in end.sides] == ["all, -x", "all, +x"]


def test_what_acts_along_the_wall_disturbs_nothing() -> None:
    """A ring held along the tube, a plane of symmetry, and a pull along the tube."""
    scene = tube(
        mesh={
            "shape": "tube", "radius": 25, "length": 100, "around": 16, "along": 10, "cap_end": "none", "pattern": "diagonal",
        },
        supports=[{"group": "start", "hold": "x"}, {"group": "sides", "hold": "y"}, {"group": "keel", "hold": "z"}],
        groups={"sides": {"where": "y = 0 within 1e-6"}, "keel": {"where": "z = 0 within 1e-6 and x > 99 and y < 0"}},
        loads={"tip": {"group": "end", "direction": [1, 0, 0]}},
    )  # fmt: skip
    assert foreseen(scene) == ()


@pytest.mark.parametrize("order", [1, 2])
def test_a_flat_cap_is_a_kink_and_a_round_one_is_not(order: int) -> None:
    mesh = {"shape": "tube", "radius": 25, "length": 100, "around": 16, "along": 8, "order": order}
    assert causes(foreseen(tube(loads={}, stages=[{"name": "inflate", "pressure": 0.035}], mesh=mesh))) == [
        ("start held",), ("joins cap_end",),
    ]  # fmt: skip
    flat = foreseen(tube(loads={}, stages=[{"name": "inflate", "pressure": 0.035}], mesh=mesh | {"cap_end": "flat"}))
    assert causes(flat) == [("start held",), ("joins cap_end", "kinked")]
    wall, cap = flat[1].sides
    assert wall.length == pytest.approx(LENGTH, rel=0.02)
    assert (cap.length, cap.resolved) == (None, None)
    assert "not curved along the line, at rest" in cap.unknown


def test_fabrics_and_walls_that_meet() -> None:
    stiff = {"E_warp": 8000, "E_weft": 2000, "G": 300, "nu": 0.1, "thickness": 0.1}
    layers = foreseen(tube(fabrics={"cap_end": stiff}, loads={}, stages=[{"name": "inflate", "pressure": 0.035}]))
    assert layers[1].causes == ("joins cap_end", "fabrics meet")
    of_cap = layers[1].sides[1].length
    assert of_cap == pytest.approx(LENGTH / np.sqrt(2.0), rel=0.02)
    # A wall across a tube, from ring to ring.
    ring = shapes.tube(radius=25.0, length=100.0, around=12, along=4, cap_end="none", pattern="diagonal")
    middle = len(ring.points)
    rim = 2 * 12 + np.arange(12)
    wall = np.column_stack([rim, np.roll(rim, -1), np.full(12, middle)])
    mesh = Mesh.build(
        np.vstack([ring.points, [[50.0, 0.0, 0.0]]]), np.vstack([ring.triangles, wall]), {"start": np.arange(12)},
        {"wall": 96 + np.arange(12)},
    )  # fmt: skip
    scene = tube(
        mesh={"shape": "given"}, fabric={"E": 1000, "nu": 0.1, "thickness": 0.1}, loads={},
        pressures={"inside": {"group": "tube"}}, groups={"tube": {"kind": "elements", "where": "x < 45"}},
        stages=[{"name": "inflate", "pressure": 0.035}], probes={},
    )  # fmt: skip
    found = {one.causes: one for one in foreseen(scene, mesh)}
    assert len(found["walls meet",].sides) == 3


@pytest.mark.usefixtures("runtime_cpu")
def test_a_run_tells_layers_by_its_state_and_the_wall_decays_as_told(tmp_path: Path) -> None:
    """w = w₀ (1 - exp(-x/l)) beside a held ring."""
    mesh = {
        "shape": "tube", "radius": 25, "length": 100, "around": 16, "along": 5, "order": 2, "pattern": "alternating",
        "grade": {"start": 0.4},
    }  # fmt: skip
    fabric = {"E": 1000, "nu": 0.1, "thickness": 0.1}
    result = tm.run(
        tube(mesh=mesh, fabric=fabric, loads={}, stages=[{"name": "inflate", "pressure": 0.035}]),
        out=tmp_path,
        render=False,
    )
    assert result.converged
    told = result.layers[0].sides[0].length
    assert told is not None
    assert told == pytest.approx(LENGTH, rel=0.02)
    assert told != pytest.approx(LENGTH, rel=1e-4)  # the resultant is that of the blown-up tube
    points, moved = result.mesh.points, result.mesh.points + result.steps[-1].displacement
    radial = np.hypot(moved[:, 1], moved[:, 2]) - np.hypot(points[:, 1], points[:, 2])
    rings = np.unique(np.round(points[:, 0], 6))
    mean = np.array([radial[np.abs(points[:, 0] - x) < 1e-5].mean() for x in rings])
    far, near = mean[(rings > 30.0) & (rings < 60.0)].mean(), rings < 3.0 * told
    assert near.sum() >= 10
    assert 1.0 - mean[near] / far == pytest.approx(np.exp(-rings[near] / told), abs=0.008)  # measured 0.006
    assert read_result(tmp_path).layers == result.layers


def test_check_tells_layers_without_taichi(tmp_path: Path) -> None:
    path = tmp_path / "tube.toml"
    path.write_text(
        'name = "tube"\nunits = { length = "mm", force = "N" }\n'
        'mesh = { shape = "tube", radius = 25, length = 100, around = 16, along = 10 }\n'
        "fabric = { E = 1000, nu = 0.1, thickness = 0.1 }\n"
        'supports = [{ group = "start", hold = "xyz" }]\nstages = [{ name = "inflate", pressure = 0.035 }]\n'
    )
    words = (
        "import sys; from taichi_membrane.commands.cli import app; app(['check', sys.argv[1]], standalone_mode=False); "
        "assert 'taichi' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", words, str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stdout.split())
    assert "layers start held: wall h = 10 mm, l = 1.65 mm, h/l = 6.1." in told
    assert f"WARNING: {UNRESOLVED}" in told
