"""Frames to draw, and what the tests of pictures share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from taichi_membrane.pictures import raster, render
from taichi_membrane.pictures.camera import Projection
from taichi_membrane.pictures.render import Camera, Frame, Look, draw_frame, fit_camera

SIZE = (400, 250)  # small: most of the time goes into pixels
Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def grid(rows: int, columns: int, *, wrap: bool) -> Ints:
    """Two triangles per cell of a grid of nodes with ``columns`` nodes (wrapped) or ``columns + 1`` nodes a row."""
    width = columns if wrap else columns + 1
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    a, b = i * width + j, (i + 1) * width + j
    c, d = (i + 1) * width + (j + 1) % width, i * width + (j + 1) % width
    return np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)


def sphere_mesh(n: int = 48, radius: float = 1.0) -> tuple[Floats, Ints]:
    """Latitudes and longitudes, outward normals; the poles are rings of coincident nodes."""
    polar, turn = np.linspace(0.0, np.pi, n + 1), np.arange(2 * n) * np.pi / n
    ring = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    points = np.concatenate(
        (np.sin(polar)[:, None, None] * ring, np.tile(np.cos(polar)[:, None, None], (2 * n, 1))), axis=2
    )
    return radius * points.reshape(-1, 3), grid(n, 2 * n, wrap=True)


def sheet_mesh(n: int, *, height: float = 0.0) -> tuple[Floats, Ints]:
    """Square from -1 to 1 in a plane z = height, normal +z."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, n + 1), np.linspace(-1.0, 1.0, n + 1), indexing="ij")
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, height))), grid(n, n, wrap=False)


def tube_mesh(along: int = 60, around: int = 48) -> tuple[Floats, Ints]:
    """Open tube along x, length 4, radius 0.5, outward normals."""
    turn = np.arange(around) * 2.0 * np.pi / around
    x = np.repeat(np.linspace(0.0, 4.0, along + 1), around)
    ring = np.tile(0.5 * np.column_stack((np.sin(turn), np.cos(turn))), (along + 1, 1))
    return np.column_stack((x, ring)), np.ascontiguousarray(grid(along, around, wrap=True))


def frame_of(points: Floats, triangles: Ints, **changes: object) -> Frame:
    m = len(triangles)
    plain = Frame(
        points=points, reference=points, triangles=triangles, state=np.zeros(m, np.int8), taut_margin=np.ones(m),
        slack_margin=np.ones(m), wrinkle_direction=np.tile((1.0, 0.0, 0.0), (m, 1)),
    )  # fmt: skip
    return replace(plain, **changes)  # type: ignore[arg-type]


def frame_with_states(points: Floats, triangles: Ints, taut: Floats, slack: Floats, **changes: object) -> Frame:
    state = np.where(slack < 0, 2, np.where(taut < 0, 1, 0)).astype(np.int8)
    return frame_of(points, triangles, state=state, taut_margin=taut, slack_margin=slack, **changes)


def cantilever() -> Frame:
    """The made-up case of the gallery: a tube with a wrinkled zone at the root's underside and a slack patch in it."""
    points, triangles = tube_mesh(along=90)
    x, y, z = points[triangles].mean(axis=1).T
    turn = np.arctan2(y, -z)
    taut, slack = 0.35 + 0.45 * x - np.cos(turn), 0.3 + 1.1 * x - 0.75 * np.cos(turn)
    bent = points - np.column_stack((0 * points[:, 0], 0 * points[:, 0], 0.04 * points[:, 0] ** 2))
    hoop = np.column_stack((0 * x, np.cos(turn), np.sin(turn)))
    return frame_with_states(bent, triangles, taut, slack, reference=points, wrinkle_direction=hoop)


def camera_on(
    frame: Frame, azimuth: float = 0.0, elevation: float = 0.0, projection: Projection = "orthographic", size=SIZE
) -> Camera:  # type: ignore[no-untyped-def]
    return fit_camera([frame.points], azimuth=azimuth, elevation=elevation, projection=projection, size=size)


def coverage(frame: Frame, camera: Camera) -> Floats:
    """Share of each pixel the surface covers."""
    screen = camera.project(frame.points)
    samples = render._DepthScale.of(screen, camera).samples(screen)
    return raster.raster_of_size(*camera.size).cover(samples, frame.triangles) / 4.0


def shaded(frame: Frame, camera: Camera, look: Look | None = None) -> raster.Pixels:
    look = look or Look()
    screen = camera.project(frame.points)
    scale = render._DepthScale.of(screen, camera)
    surface = render._surface(frame, camera, scale.samples(screen), render._scalar_levels(frame, look)[1])
    target = raster.raster_of_size(*camera.size)
    target.cover(surface.screen, surface.triangles)
    return target.shade(surface, render._paint(look, render._area_shares(frame), scale, camera))


def image_of(frame: Frame, path: Path, look: Look, camera: Camera) -> NDArray[np.uint8]:
    draw_frame(frame, look=look, camera=camera, path=path)
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
