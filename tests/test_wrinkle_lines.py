"""Wrinkle lines: where they run, how far apart, along what."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_cases import (
    Floats,
    camera_on,
    cantilever,
    image_of,
    shaded,
)

from taichi_membrane.pictures import raster
from taichi_membrane.pictures.render import Camera, Frame, Look
from taichi_membrane.pictures.wrinkle_lines import wrinkle_lines

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def _lines(frame: Frame, camera: Camera) -> tuple[list[Floats], raster.Pixels]:
    pixels = shaded(frame, camera)
    zone = np.where(pixels.code % raster.BACK_FACE == 1, pixels.code + 1, 0).astype(np.int32)
    zone[pixels.code < 0] = 0
    lines = wrinkle_lines(zone, pixels.direction, pixels.nearness, spacing=9.0, longest=80.0, clearance=2, jump=0.1)
    return lines, pixels


def test_lines_stay_in_the_wrinkled_zone_and_run_along_the_wrinkles() -> None:
    frame = cantilever()
    camera = camera_on(frame, 20.0, -35.0, "perspective", size=(800, 500))
    lines, pixels = _lines(frame, camera)
    assert len(lines) > 15
    for line in lines:
        x, y = line.astype(int).T
        assert (pixels.code[y, x] == 1).all()
    # Circumferential on the tube means: the position along the axis hardly changes along a line.
    depth = camera.project(frame.points)
    for line in lines:
        ends = [int(np.argmin(np.hypot(*(depth[:, :2] - end).T) + 30.0 * depth[:, 2])) for end in (line[0], line[-1])]
        assert abs(frame.reference[ends[0], 0] - frame.reference[ends[1], 0]) < 0.14  # nearest nodes: pitch 0.044, bent


def test_lines_keep_their_distance() -> None:
    lines, _ = _lines(cantilever(), camera_on(cantilever(), 20.0, -35.0, size=(800, 500)))
    for n, line in enumerate(lines):
        for other in lines[:n]:
            gap = np.hypot(*(line[:, None] - other[None]).transpose(2, 0, 1)).min()
            assert gap > 0.5 * 9.0 - 3.5  # half the spacing, less what a map of cells of 2 pixels loses


def test_lines_of_a_uniform_field_are_one_spacing_apart() -> None:
    zone = np.zeros((240, 300), np.int32)
    zone[20:220, 30:270] = 1
    direction = np.zeros((240, 300, 2), np.float32)
    direction[..., 0] = 1.0  # θ = 0
    lines = wrinkle_lines(
        zone, direction, np.zeros((240, 300), np.float32), spacing=20.0, longest=1000.0, clearance=3, jump=0.1
    )
    heights = np.sort([line[:, 1].mean() for line in lines])
    gaps = np.diff(heights)
    assert gaps.min() > 20.0 - 4.0  # cells of 2 pixels
    assert gaps.max() < 2.0 * 20.0  # and none is missing
    for line in lines:
        assert np.ptp(line[:, 1]) < 1e-9
        assert line[:, 0].min() == pytest.approx(33.0, abs=2.0)  # a step of 2 pixels
        assert line[:, 0].max() == pytest.approx(267.0, abs=2.0)


def test_direction_of_slack_elements_is_not_used() -> None:
    frame = cantilever()
    camera = camera_on(frame, 20.0, -35.0)
    wild = frame.wrinkle_direction.copy()
    wild[frame.state == 2] = (1.0, 0.0, 0.0)
    other = shaded(replace(frame, wrinkle_direction=wild), camera)
    assert (frame.state == 2).sum() > 50
    assert (other.direction == shaded(frame, camera).direction).all()


def test_drawn_glyphs_touch_only_wrinkled_pixels(tmp_path: Path) -> None:
    frame = cantilever()
    camera = camera_on(frame, 20.0, -35.0, size=(800, 500))
    with_lines = image_of(frame, tmp_path / "a.png", Look(size=(800, 500)), camera)
    without = image_of(frame, tmp_path / "b.png", Look(size=(800, 500), show_directions=False), camera)
    changed = (with_lines != without).any(axis=2)
    changed[:150, 550:] = False  # the legend's row
    assert changed.sum() > 500
    assert (shaded(frame, camera).code[changed] == 1).all()
