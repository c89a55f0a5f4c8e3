"""Thousands of damaged scenes: each is refused with one message, or makes a model whose every number is finite."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_input import GOOD, PROFILE, assert_one_message, damaged_scenes, scene_toml
from hypothesis import given, settings

from taichi_membrane.errors import InputError
from taichi_membrane.scene.file import load_scene, resolve_scene
from taichi_membrane.shapes import arguments
from taichi_membrane.simulation import probes
from taichi_membrane.simulation.model import Model, build_mesh, build_model

OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the mesh file of the good scenes; shapes are kept small, so that a large one that is right costs nothing."""
    (tmp_path / "square.obj").write_text(OBJ)
    monkeypatch.setattr(arguments, "MOST_TRIANGLES", 3000)
    return tmp_path


def modelled(path: Path) -> Model:
    """What a run does before it starts Taichi; any warning is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = load_scene(path)
        model = build_model(scene, build_mesh(scene, path.parent))
        probes.validate(model)
    return model


def assert_finite(model: Model) -> None:
    structure = model.structure
    arrays: dict[str, Any] = {"warp": structure.tri_warp, **model.unit_forces}
    if structure.node_frame is not None:
        arrays["frame"] = structure.node_frame
    for number, fabric in enumerate(structure.fabrics):
        arrays[f"stiffness {number}"] = fabric.stiffness()
        arrays[f"record {number}"] = list(fabric.record().values())
    for name, motion in model.motions.items():
        arrays[f"motion {name}"] = motion.displacement(structure.mesh.points, 1.0)
    for name, array in arrays.items():
        assert np.isfinite(array).all(), name


@pytest.mark.parametrize("number", range(len(GOOD)))
def test_the_scenes_that_are_damaged_below_are_good(folder: Path, number: int) -> None:
    path = folder / "scene.toml"
    path.write_text(scene_toml(GOOD[number]), encoding="utf-8")
    assert_finite(modelled(path))


@settings(PROFILE, max_examples=1500)
@given(scene=damaged_scenes())
def test_a_damaged_scene_is_refused_with_one_message_or_is_good(folder: Path, scene: dict[str, Any]) -> None:
    path = folder / "scene.toml"
    path.write_text(scene_toml(scene), encoding="utf-8")
    try:
        model = modelled(path)
    except InputError as error:
        assert_one_message(" ".join(str(error).split()), "")
    else:
        assert_finite(model)
    assert {item.name for item in folder.iterdir()} == {"scene.toml", "square.obj"}


def changed(folder: Path, number: int, *changes: str) -> Path:
    """A good scene's file, with texts put after it."""
    path = folder / "scene.toml"
    path.write_text(scene_toml(GOOD[number]) + "\n".join(changes), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = " + "9" * 5000, "not valid TOML: Exceeds the limit"),
        ("description = 0x" + "f" * 5000, "description: must be a text, not a whole number of 20000 bits"),
        ("a." * 50000 + "a = 1", "line 7 has a key of more than 40 parts: tables are nested too deeply for a scene"),
        ("[" + "'a' . " * 50000 + "a]", "line 7 has a key of more than 40 parts"),
        ("x = " + "[" * 100000, "lists or tables are nested too deeply for a scene"),
        ("x = " + "{ a = " * 100000, "lists or tables are nested too deeply for a scene"),
        ("".join(f"k{i} = 1\n" for i in range(60000)), "k0: unknown key; allowed: name, title, "),
        ("[[loads]]\n" * 50000, "loads: must be a table, not a list"),
        ("".join(f"[loads.l{i}]\ngroup='all'\ndirection=[1,0,0]\n" for i in range(1001)), "loads: 1001 items, but at most 1000"),
        ("title = 'a\x1b[2Jb'", "not valid TOML"),
        ('title = "a\\u001b[2Jb"', "title: the text holds a character that cannot be printed, U+001B"),
        ("title = '" + "a" * 500_000 + "'", "title: 'aaaaa"),
        ("camera.size = [8192, 8192]", "camera.size: 8192 × 8192 = 67108864 pixels, at most 35389440 are allowed"),
        ("solver.max_iterations = 10_000_000_000", "solver.max_iterations: 10000000000 must be at most 1e+09"),
        ("loads.a = { group = 'all', direction = [1e-40, 0, 0] }", "loads.a.direction: a direction needs a length above zero"),
        ("probes.a = { kind = 'moment', group = 'all', axis = [0, 0, 0], through = [0, 0, 0] }", "probes.a.axis: a direction"),
        ("groups.a = { where = '" + "x < 1 and " * 500 + "' }", "groups.a.where: 'x < 1 and x < 1"),
        ("groups.a = { where = 'x > 1e99 and z = 0 within 1' }", "groups.a.where: no node meets "),
    ],
)  # fmt: skip
def test_a_bomb_is_refused_at_once(folder: Path, text: str, expected: str) -> None:
    path = changed(folder, 4, text)
    with pytest.raises(InputError) as caught:
        modelled(path)
    assert_one_message(str(caught.value), f"{path}: {expected}" if "no node meets" not in expected else expected)


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("fabric", {"E": 1e31, "nu": 0.3, "thickness": 1.0}, "fabric.E: 1e+31 must be at most 1e+30"),
        ("fabric", {"E": 1e-31, "nu": 0.3, "thickness": 1.0}, "fabric.E: 1e-31 must be at least 1e-30"),
        ("fabric", {"E": 1.0, "nu": -1e31, "thickness": 1.0}, "fabric.nu: -1e+31 must be at least -1e+30"),
        ("fabric", {"E": 1.0, "nu": 0.3, "thickness": 10**400}, "fabric.thickness: "),
        ("supports", [{"group": "", "hold": "x"}], "supports[1].group: '' is too short; 1 characters at least"),
        ("supports", [{"group": "g" * 300, "hold": "x"}], "supports[1].group: 'ggg"),
        ("supports", [{"group": "all", "normal": [0.0, 1e-200, 0.0]}], "supports[1].normal: a direction needs a length"),
        ("name", "../../outside", "name: '../../outside' does not match the pattern"),
        ("name", "a\n", "name: 'a\\n' does not match the pattern"),
        ("groups", {"../x": {"where": "x > 0"}}, "groups.../x: '../x' does not match the pattern"),
        ("mesh", {"shape": "file", "path": "p" * 1001}, "mesh.path: 'ppp"),
        ("mesh", {"shape": "sphere", "radius": 1.0, "divisions": 10**9}, "mesh.divisions: 1000000000 must be at most 3000"),
    ],
)  # fmt: skip
def test_a_value_out_of_bounds_is_refused_with_its_key(folder: Path, key: str, value: Any, expected: str) -> None:
    path = folder / "scene.toml"
    path.write_text(scene_toml({**GOOD[4], key: value}), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        modelled(path)
    assert_one_message(str(caught.value), f"{path}: {expected}")


@pytest.mark.parametrize(
    ("mesh_path", "expected"),
    [
        ("/etc/passwd", "/etc/passwd: the file extension '' is unknown"),
        ("../nowhere.msh", "there is no such mesh file"),
        ("square.obj/x.obj", "there is no such mesh file"),
        ("a" * 900 + ".obj", "not a path that can be followed: File name too long"),
        ("a\x00b.obj", "not a path that can be followed: embedded null"),
        ("pipe.obj", "a mesh file is needed, this is a device"),
        ("loop.obj", "not a path that can be followed: Too many levels of symbolic links"),
        ("zero.obj", "a mesh file is needed, this is a device"),
    ],
)
def test_a_mesh_path_that_leads_nowhere_is_refused(folder: Path, mesh_path: str, expected: str) -> None:
    os.mkfifo(folder / "pipe.obj")
    (folder / "loop.obj").symlink_to("loop.obj")
    (folder / "zero.obj").symlink_to("/dev/zero")
    path = folder / "scene.toml"
    path.write_text(scene_toml({**GOOD[-1], "mesh": {"shape": "file", "path": mesh_path}}), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        modelled(path)
    assert expected in str(caught.value)
    assert_one_message(str(caught.value), str(folder) if mesh_path[0] != "/" else mesh_path)


@pytest.mark.parametrize("text", ["a" * 5000, "a\x00b", "/dev/null", "/dev/zero", "a" * 200 + "/b"])
def test_a_scene_name_that_is_no_file_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scene(resolve_scene(text))
    assert_one_message(str(caught.value), text.replace("\x00", "\\x00")[:1000])
