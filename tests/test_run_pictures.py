"""Pictures of runs: displacements drawn larger, and curves in several formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.pictures import gallery
from taichi_membrane.pictures.render import Frame
from taichi_membrane.scene import Camera, Scene
from taichi_membrane.simulation.results import RunResult

BALL = {
    "name": "ball",
    "units": {"length": "mm", "force": "N"},
    "mesh": {"shape": "sphere", "radius": 100.0, "divisions": 3},
    "fabric": {"E": 10.0, "nu": 0.3, "thickness": 1.0},
    "supports": [{"group": "south", "hold": "xyz"}, {"group": "north", "hold": "xy"}, {"group": "x_plus", "hold": "y"}],
    "stages": [{"name": "inflate", "steps": 2, "pressure": 0.002}],
    "probes": {"radius": {"kind": "radius", "group": "equator", "axis": "z"}},
    "curve": {"x": "radius", "y": "pressure", "formats": ["svg", "pdf"]},
    "camera": {"size": [320, 240]},
}


@pytest.fixture(scope="module")
def ball() -> RunResult:
    return tm.run(Scene.model_validate(BALL), render=False)


def shown(monkeypatch: pytest.MonkeyPatch, result: RunResult, tmp_path: Path, **camera: Any) -> list[tuple[Frame, Any]]:
    """The frames of a run, with the view that each is drawn with."""
    frames: list[tuple[Frame, Any]] = []
    monkeypatch.setattr(
        gallery, "draw_frame", lambda frame, *, look, camera, path, outline=None: frames.append((frame, camera))
    )
    monkeypatch.setattr(gallery, "write_animation", lambda *_: None)
    list(gallery.draw_run(result, tmp_path, Camera(size=(320, 240), **camera)))
    return frames


@pytest.mark.usefixtures("runtime_cpu")
def test_displacements_are_drawn_larger_and_the_picture_says_so(
    ball: RunResult, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    plain = shown(monkeypatch, ball, tmp_path)
    larger = shown(monkeypatch, ball, tmp_path, magnify=40.0)
    for (before, _), (after, view), step in zip(plain, larger, ball.steps, strict=True):
        assert np.array_equal(before.points, ball.mesh.points + step.displacement)
        assert np.allclose(after.points - ball.mesh.points, 40.0 * step.displacement, rtol=1e-12, atol=1e-12)
        assert np.array_equal(after.reference, ball.mesh.points)
        assert "×" not in before.subtitle
        assert after.subtitle == f"{before.subtitle}, displacements × 40"
        pixels = view.project(after.points)[:, :2]
        assert (pixels > 0.0).all()
        assert (pixels < view.size).all()
    assert np.abs(larger[-1][0].points).max() > 1.2 * np.abs(plain[-1][0].points).max()


@pytest.mark.usefixtures("runtime_cpu")
def test_a_curve_is_written_in_the_formats_asked_for(ball: RunResult, tmp_path: Path) -> None:
    assert ball.scene.curve is not None
    files = {path.name for path in gallery.draw_run(ball, tmp_path, ball.scene.camera)}
    assert {"curve.svg", "curve.pdf"} <= files
    assert not (tmp_path / "curve.png").exists()
    assert (tmp_path / "curve.pdf").read_bytes().startswith(b"%PDF")
    assert "<svg" in (tmp_path / "curve.svg").read_text(encoding="utf-8")
    assert Scene.model_validate(BALL | {"curve": {"x": "radius", "y": "pressure"}}).curve.formats == ["png"]  # type: ignore[union-attr]


@pytest.mark.usefixtures("runtime_cpu")
def test_pictures_go_into_a_folder_of_their_own_that_was_not_there(tmp_path: Path) -> None:
    run, larger = tmp_path / "run", tmp_path / "larger"
    tm.run(Scene.model_validate(BALL), render=True, out=run)
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    arguments = ["render", str(run), "--magnify", "40", "--out", str(larger)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before
    assert (larger / "step_0001.png").read_bytes() != before["step_0001.png"]
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 2
    assert again.stderr == f"error: {larger}: there is such a file or folder; pictures of its own need a new one\n"
