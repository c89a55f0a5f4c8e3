"""Scenes begun from others: the same but for name and checks, each key explained, nothing overwritten."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.scene import Scene, schema
from taichi_membrane.scene.file import shipped_scenes
from taichi_membrane.scene.template import written_like


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_scene_written_like_another_is_it_but_for_name_and_checks(name: str) -> None:
    text = shipped_scenes()[name].read_text(encoding="utf-8")
    made = written_like("mine", name, text)
    old, new = tm.load_scene(name), Scene.model_validate(tomllib.loads(made))
    assert (new.name, new.checks) == ("mine", [])
    same = {"name": "mine", "checks": []}
    assert new == old.model_copy(update=same)
    assert all(line in made.splitlines() for line in text.split("[[checks]]")[0].splitlines() if line.startswith("#"))


def test_every_key_is_explained_once_above_it() -> None:
    text = shipped_scenes()["tent"].read_text(encoding="utf-8")
    lines = written_like("mine", "tent", text).splitlines()
    scene = tm.load_scene("tent")
    meaning = schema.meanings(type(scene.fabrics["skin"]))["mass_per_area"].replace("``", "")
    explained = [k for k, line in enumerate(lines) if line == f"# {meaning}"]
    assert len(explained) == 1
    assert lines[explained[0] + 1] == "mass_per_area = 1.05"
    keys = [k for k, line in enumerate(lines) if line.startswith("mass_per_area")]
    assert len(keys) == 2
    assert lines.index("# [[checks]]") == 1 + next(k for k, line in enumerate(lines) if line.endswith("One looks so:"))
    assert "[[checks]]" not in lines


def test_values_of_several_lines_stay_whole() -> None:
    text = shipped_scenes()["sphere"].read_text(encoding="utf-8")
    strange = "b = 3\n[no.header]\n"
    made = tomllib.loads(written_like("mine", "a", text.replace("A thin sphere", strange)))
    assert strange in made["description"]
    assert made["name"] == "mine"


def test_the_command_writes_file_and_mesh_and_overwrites_nothing(tmp_path: Path) -> None:
    runner = CliRunner()
    done = runner.invoke(app, ["new", "mine", "--like", "disc", "--out", str(tmp_path / "there")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "there/meshes/disc.msh").read_bytes() == (
        shipped_scenes()["disc"].parent / "meshes/disc.msh"
    ).read_bytes()
    assert tm.load_scene(tmp_path / "there/mine.toml").name == "mine"
    before = (tmp_path / "there/mine.toml").read_bytes()
    again = runner.invoke(app, ["new", "mine", "--like", "tent", "--out", str(tmp_path / "there")])
    assert again.exit_code == 2
    assert "not overwritten" in again.output
    other = runner.invoke(app, ["new", "other", "--like", "disc", "--out", str(tmp_path / "there")])
    assert other.exit_code == 2
    assert "disc.msh" in other.output
    assert not (tmp_path / "there/other.toml").exists()
    assert (tmp_path / "there/mine.toml").read_bytes() == before


@pytest.mark.parametrize(
    ("name", "like", "told"), [("9a", "tent", "'9a' is no name"), ("a", "tnt", "did you mean 'tent'")]
)
def test_what_is_wrong_is_told(name: str, like: str, told: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["new", name, "--like", like, "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert told in done.output
    assert not list(tmp_path.iterdir())
