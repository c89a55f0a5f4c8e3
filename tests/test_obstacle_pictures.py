"""Obstacles in pictures: their lines lie on them, and are faint behind the surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from taichi_membrane.pictures.obstacles import draw_obstacles
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh
from taichi_membrane.simulation.obstacle_lines import obstacle_lines


def test_obstacles_are_drawn_where_they_have_moved_to() -> None:
    """Lines of every kind lie on the surface of the obstacle at its place, near the structure only."""
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    kinds = {
        "plane": {"kind": "plane", "through": [0, 0, 0], "normal": [0, 0, 1]},
        "sphere": {"kind": "sphere", "centre": [0, 0, 0], "radius": 0.5},
        "cylinder": {"kind": "cylinder", "centre": [0, 0, 0], "axis": [0, 0, 1], "radius": 0.5},
        "drum": {"kind": "cylinder", "centre": [0, 0, 0], "axis": [0, 0, 1], "radius": 0.5, "length": 0.8},
        "box": {"kind": "box", "centre": [0, 0, 0], "size": [0.6, 0.8, 1.0]},
        "surface": {
            "kind": "surface", "points": corners, "triangles": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        },
    }  # fmt: skip
    on: dict[str, Callable[[Any], Any]] = {
        "plane": lambda p: p[:, 2],
        "sphere": lambda p: np.linalg.norm(p, axis=1) - 0.5,
        "cylinder": lambda p: np.hypot(p[:, 0], p[:, 1]) - 0.5,
        "drum": lambda p: np.hypot(p[:, 0], p[:, 1]) - 0.5,
        "box": lambda p: np.max(np.abs(p) / [0.3, 0.4, 0.5], axis=1) - 1.0,
        "surface": lambda p: np.minimum(p.min(axis=1), 1.0 - p.sum(axis=1)),
    }
    box = (np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0]))
    for name, one in kinds.items():
        scene = Scene.model_validate(
            {
                "name": "touch", "units": {"length": "m", "force": "N"}, "pressures": {},
                    "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 1, "along_y": 1},
                "fabric": {"E": 1.0, "nu": 0.0, "thickness": 1.0}, "stages": [{"name": "only"}],
                "obstacles": {"it": {**one, "direction": [0.5, 0, 0.25]}},
            }
        )  # fmt: skip
        lines = obstacle_lines(scene, build_mesh(scene), {"it": 2.0}, box)
        assert lines
        places = np.concatenate(lines)
        assert np.linalg.norm(places, axis=1).max() < 1.5 * 1.1 * np.sqrt(3.0)
        assert np.abs(on[name](places - np.array([1.0, 0.0, 0.5]))).max() < 1e-12
    assert not obstacle_lines(scene.model_copy(update={"obstacles": {}}), build_mesh(scene), {}, box)


def test_lines_of_obstacles_are_faint_where_the_surface_hides_them() -> None:
    """Before the surface, behind it, and beside it."""

    class Kept:
        def __init__(self) -> None:
            self.drawn: list[tuple[float, Any]] = []

        def lines(self, lines: Any, *, alpha: float, **_: Any) -> None:
            self.drawn += [(alpha, line) for line in lines]

    seen = np.full((40, 100), -1.0, np.float32)
    seen[:, 50:] = 0.5
    page = Kept()
    draw_obstacles(
        page,
        [np.array([[0.0, 20.0, 0.2], [99.0, 20.0, 0.2]]), np.array([[60.0, 5.0, 0.9], [90.0, 5.0, 0.9]])],
        seen,
        0.01,
    )  # type: ignore[arg-type]
    faint = [line for alpha, line in page.drawn if alpha < 0.3]
    clear = [line for alpha, line in page.drawn if alpha > 0.3]
    assert len(faint) == 1
    assert faint[0][:, 0].min() >= 48
    assert sorted(line[:, 0].max() for line in clear) == pytest.approx([48.0, 90.0], abs=4.0)
