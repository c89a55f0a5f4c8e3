"""The gallery: every shipped scene is on its page with its picture and checks, and one command writes it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taichi_membrane.commands import gallery as command
from taichi_membrane.commands.cli import app
from taichi_membrane.scene.file import load_scene, shipped_scenes

PAGE = Path(__file__).resolve().parent.parent / "docs" / "gallery.md"


def sections(page: Path) -> dict[str, str]:
    text = page.read_text(encoding="utf-8")
    return {part.split("\n", 1)[0]: part for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]}


def test_the_page_has_every_shipped_scene_with_its_pictures_and_checks() -> None:
    found = sections(PAGE)
    assert list(found) == sorted(shipped_scenes())
    for name, path in shipped_scenes().items():
        scene, text = load_scene(path), found[name]
        assert scene.title in text
        pictures = re.findall(r"!\[.*?\]\((.*?)\)", text)
        assert pictures[0] == f"gallery/{name}.png"
        for picture in pictures:
            assert (PAGE.parent / picture).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        rows = [line for line in text.split("\n") if line.startswith("| ")][2:]
        assert len(rows) == len(scene.checks)
        for row, check in zip(rows, scene.checks, strict=True):
            assert row.endswith(f"| {check.source} |".replace("\n", " "))
            assert "**" not in row, "no check failed when the page was written"


def test_one_command_writes_the_page_and_keeps_what_it_does_not_run(tmp_path: Path) -> None:
    runner = CliRunner()
    done = runner.invoke(app, ["gallery", "sphere", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    page = tmp_path / "gallery.md"
    before = sections(page)
    assert list(before) == ["sphere"]
    assert "p = E t/((1 - nu) R) (s - 1/s)" in before["sphere"]
    assert sorted(one.name for one in (tmp_path / "gallery").iterdir()) == ["sphere.png", "sphere_curve.png"]
    page.write_text(page.read_text(encoding="utf-8") + "\n## gone\n\nA scene of old.\n", encoding="utf-8")
    done = runner.invoke(app, ["gallery", "tube", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    after = sections(page)
    assert list(after) == ["sphere", "tube"]
    assert after["sphere"].rstrip() == before["sphere"].rstrip()


def test_a_scene_whose_check_fails_is_on_the_page_and_ends_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "sphere.toml"
    text = shipped_scenes()["sphere"].read_text(encoding="utf-8")
    path.write_text(text.replace("reference = 101.0", "reference = 102.0"), encoding="utf-8")
    monkeypatch.setattr("taichi_membrane.scene.file.shipped_scenes", lambda: {"sphere": path})
    done = CliRunner().invoke(app, ["gallery", "--out", str(tmp_path)])
    assert done.exit_code == 1, done.output
    rows = [line for line in sections(tmp_path / command.PAGE)["sphere"].split("\n") if "radius" in line]
    assert ["**" in row for row in rows] == [True, False]


def test_a_name_that_is_not_shipped_is_told(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["gallery", "spheer", "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert "gallery: 'spheer' is not a shipped scene; allowed: airbag, " in done.output
    assert not (tmp_path / "gallery.md").exists()
