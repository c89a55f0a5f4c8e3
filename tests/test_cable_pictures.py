"""Cables on pictures: lines in the colour of their force, pale where the surface hides them, dashed where slack."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_cases import camera_on, frame_of, image_of, sheet_mesh

from taichi_membrane.pictures.cables import cable_bar
from taichi_membrane.pictures.colours import CABLE_RAMP
from taichi_membrane.pictures.render import Frame, Look

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SIZE = (800, 500)
LOOK = Look(show_loads=False, show_supports=False, show_directions=False, show_axes=False, size=SIZE)


def strung(height: float, forces: tuple[float, ...]) -> Frame:
    """A sheet seen from above and three cables along x, ``height`` above it."""
    points, triangles = sheet_mesh(8)
    rows = np.array([-0.6, 0.0, 0.6])
    ends = np.array([[[x, y, height] for x in (-0.9, 0.9)] for y in rows]).reshape(-1, 3)
    frame = frame_of(np.concatenate((points, ends)), triangles)
    cables = np.arange(6, dtype=np.int32).reshape(3, 2) + len(points)
    return replace(frame, cables=cables, cable_force=np.array(forces), cable_label="force of cables [N]")


def drawn(frame: Frame, path: Path) -> tuple[np.ndarray, list[np.ndarray]]:
    """The picture, and its colours along each cable."""
    camera = camera_on(frame, azimuth=-90.0, elevation=90.0, size=SIZE)
    image = image_of(frame, path, LOOK, camera)
    lines = []
    for ends in frame.points[frame.cables]:
        (x, y), (last, below) = np.rint(camera.project(ends)[:, :2]).astype(int)
        assert (y == below) != (x == last), "along a row or a column of pixels"
        along = (
            image[y, min(x, last) + 5 : max(x, last) - 5]
            if y == below
            else image[min(y, below) + 5 : max(y, below) - 5, x]
        )
        lines.append(along.astype(float))
    return image, lines


def test_cables_over_the_surface_have_the_colours_of_their_forces(tmp_path: Path) -> None:
    """The ends of the ramp at the least and the largest force; grey and broken where there is none."""
    _, (least, slack, largest) = drawn(strung(0.3, (1.0, 0.0, 5.0)), tmp_path / "over.png")
    assert np.median(least, axis=0) == pytest.approx(255 * CABLE_RAMP[0], abs=3)
    assert np.median(largest, axis=0) == pytest.approx(255 * CABLE_RAMP[-1], abs=3)
    grey = np.abs(slack - 0.45 * 255).max(axis=1) < 6
    assert 0.2 < grey.mean() < 0.8


def test_cables_under_the_surface_are_pale(tmp_path: Path) -> None:
    """Neither gone nor as those above it."""
    _, above = drawn(strung(0.3, (1.0, 2.0, 5.0)), tmp_path / "over.png")
    _, below = drawn(strung(-0.3, (1.0, 2.0, 5.0)), tmp_path / "under.png")
    for over, under in zip(above, below, strict=True):
        assert np.abs(np.median(over, axis=0) - np.median(under, axis=0)).max() > 40
        sheet = np.array([204.0, 219.0, 237.0])
        assert np.abs(np.median(under, axis=0) - sheet).max() > 15


def test_the_bar_of_forces_leaves_slack_ones_out() -> None:
    assert cable_bar(np.zeros(3), "force", None) is None
    bar = cable_bar(np.array([0.0, 2.0, 4.0]), "force", None)
    assert bar is not None
    assert (bar.low, bar.high) == (2.0, 4.0)
    one = cable_bar(np.array([0.0, 2.0]), "force", None)
    assert one is not None
    assert (one.low, one.high) == (1.0, 3.0)
    outside = cable_bar(np.array([1.0, 9.0]), "force", (2.0, 4.0))
    assert outside is not None
    assert outside.below
    assert outside.above


def test_frames_with_wrong_cables_are_refused(tmp_path: Path) -> None:
    frame = strung(0.3, (1.0, 0.0, 5.0))
    with pytest.raises(ValueError, match="cable_force must have the shape"):
        drawn(replace(frame, cable_force=np.ones(2)), tmp_path / "bad.png")
    with pytest.raises(ValueError, match="cables name nodes 0 to 999"):
        image_of(replace(frame, cables=np.array([[0, 999]])), tmp_path / "bad.png", LOOK, camera_on(frame, size=SIZE))
