"""The camera against formulas; what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from picture_cases import (
    SIZE,
    camera_on,
    frame_of,
    sheet_mesh,
    sphere_mesh,
    tube_mesh,
)

from taichi_membrane.pictures import render
from taichi_membrane.pictures.camera import Projection
from taichi_membrane.pictures.render import fit_camera

pytestmark = pytest.mark.usefixtures("runtime_cpu")


@pytest.mark.parametrize(
    ("azimuth", "elevation", "axis", "expected"),
    [
        (0.0, 0.0, (1, 0, 0), (1, 0)), (0.0, 0.0, (0, 0, 1), (0, -1)), (90.0, 0.0, (0, 1, 0), (1, 0)),
        (90.0, 0.0, (0, 0, 1), (0, -1)), (0.0, 90.0, (1, 0, 0), (1, 0)), (0.0, 90.0, (0, 1, 0), (0, -1)),
        (180.0, 0.0, (1, 0, 0), (-1, 0)),
    ],
)  # fmt: skip
def test_azimuth_and_elevation_are_as_documented(
    azimuth: float, elevation: float, axis: tuple[int, ...], expected: tuple[int, ...]
) -> None:
    camera = camera_on(frame_of(*sphere_mesh(8)), azimuth, elevation)
    centre, tip = camera.project(np.array([camera.centre, camera.centre + axis]))
    assert (tip - centre)[:2] / camera.pixels_per_length == pytest.approx(expected, abs=1e-12)


def test_viewer_stands_on_the_negative_y_side_at_azimuth_zero() -> None:
    camera = camera_on(frame_of(*sphere_mesh(8)))
    near, far = camera.project(np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]))[:, 2]
    assert near < far


def test_seen_direction_is_the_derivative_of_the_projection() -> None:
    rng = np.random.default_rng(5)
    for projection in ("orthographic", "perspective"):
        camera = camera_on(frame_of(*sphere_mesh(8)), 30.0, 20.0, projection)  # type: ignore[arg-type]
        points, directions = rng.uniform(-0.5, 0.5, (20, 3)), rng.normal(size=(20, 3))
        change = camera.project(points + 1e-5 * directions) - camera.project(points - 1e-5 * directions)
        numeric = change[:, :2] / 2e-5 / camera.pixels_per_length
        assert camera.seen_direction(points, directions) == pytest.approx(numeric, abs=1e-8)  # second-order difference


@pytest.mark.parametrize("size", [(400, 250), (1600, 1000), (500, 900)])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_object_is_large_and_keeps_clear_of_the_furniture(projection: Projection, size: tuple[int, int]) -> None:
    for points in (sphere_mesh(24)[0], tube_mesh()[0], sheet_mesh(6)[0]):
        camera = fit_camera([points], azimuth=25.0, elevation=20.0, projection=projection, size=size)
        x, y, _ = camera.project(points).T
        unit = render.furniture_scale(size)
        assert x.min() > 40 * unit
        assert x.max() < size[0] - 40 * unit
        assert y.min() > 108 * unit
        assert y.max() < size[1] - 40 * unit
        right, top = x > size[0] - 415 * unit, y < 255 * unit
        assert not (right & top).any()  # the legend
        fills = max(np.ptp(x) / size[0], np.ptp(y) / (size[1] - 160 * unit))
        assert fills > 0.6  # a coarse bound: how large it can be depends on its outline


def test_one_camera_shows_all_point_sets() -> None:
    points = sphere_mesh(8)[0]
    both = fit_camera(iter([points, points + 4.0]), azimuth=0.0, elevation=0.0, projection="perspective", size=SIZE)
    pixels = both.project(np.concatenate((points, points + 4.0)))[:, :2]
    assert pixels.min() > 0
    assert (pixels.max(axis=0) < SIZE).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"projection": "fisheye"}, "perspective, orthographic"),
        ({"elevation": 91.0}, "elevation = 91.0"),
        ({"azimuth": np.nan}, "azimuth = nan"),
        ({"size": (20, 10)}, "size = 20 x 10"),
        ({"size": (90000, 900)}, "size = 90000 x 900"),
        ({"point_sets": []}, "no points"),
        ({"point_sets": [np.zeros((4, 3))]}, "one place"),
        ({"point_sets": [np.ones((4, 3)), np.array([[0, 0, 0], [0, np.inf, 0]])]}, "point set 1: node 1 is not finite"),
        ({"point_sets": [np.ones((4, 2))]}, r"shape \(n, 3\)"),
    ],
)
def test_impossible_camera_is_refused(changes: dict[str, object], message: str) -> None:
    view: dict[str, object] = {"azimuth": 0.0, "elevation": 0.0, "projection": "perspective", "size": SIZE}
    view["point_sets"] = [sphere_mesh(4)[0]]
    view |= changes
    with pytest.raises(ValueError, match=message):
        fit_camera(view.pop("point_sets"), **view)  # type: ignore[arg-type]


def test_point_behind_the_viewer_is_refused() -> None:
    camera = camera_on(frame_of(*sphere_mesh(8)), projection="perspective")
    with pytest.raises(ValueError, match="node 1 lies behind the viewer"):
        camera.project(np.array([[0.0, 0.0, 0.0], [0.0, -5.0, 0.0]]))
