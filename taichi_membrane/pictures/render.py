"""A picture of one load step: deformed membrane with its wrinkle field or a scalar, and all a reader needs to read it.

The states are not drawn triangle by triangle: the margins that decide them are averaged to the nodes, interpolated, and
compared with zero sample by sample, so that borders are as smooth as the solution. Needs a started runtime.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import contourpy
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from taichi_membrane.names import SLACK, TAUT, WRINKLED
from taichi_membrane.output.atomic import replacing
from taichi_membrane.pictures import raster
from taichi_membrane.pictures.animation import write_animation
from taichi_membrane.pictures.cables import cable_bar, draw_cables
from taichi_membrane.pictures.camera import VIEWER_DISTANCE, Camera, Projection, fit_camera, furniture_scale
from taichi_membrane.pictures.colours import PALETTE, RAMP
from taichi_membrane.pictures.furniture import INK, OBSTACLE, OUTLINE, SLACK_CABLE, SUPPORT, ColourBar, Page
from taichi_membrane.pictures.obstacles import draw_obstacles
from taichi_membrane.pictures.symbols import draw_loads, draw_supports
from taichi_membrane.pictures.wrinkle_lines import wrinkle_lines

__all__ = ["Camera", "Frame", "Look", "draw_frame", "fit_camera", "undeformed_outline", "write_animation"]

Floats = NDArray[np.float64]

_ON_SURFACE = 0.02  # bounding radii by which what lies on the surface may seem to lie in it
RIM_CORRECTIONS = 4  # each cuts the error at a rim to less than half; 4 leave a tenth of a cell
DARKEST = {"state": 0.52, "scalar": 0.80}  # brightness of what is turned from the light; less, where colour is a number


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """Everything one picture shows; n nodes, m triangles.

    ``points``, ``reference`` (n, 3): deformed and undeformed positions; ``triangles`` (m, 3). ``state`` (m,): 0 taut,
    1 wrinkled, 2 slack; the legend's percentages are shares of the undeformed area. ``taut_margin``, ``slack_margin`` (m,):
    negative where not taut, where slack; continuous across the border. ``wrinkle_direction`` (m, 3): along the wrinkles,
    deformed configuration; not used where slack. ``scalar``: (m,) per triangle (averaged to the nodes) or (n,) per node.
    ``cables`` (k, 2): nodes of their straight pieces; ``cable_force`` (k,) zero where slack.
    ``arrows``: origin (3,), direction (3,), label of each load. ``supports`` (k,): supported nodes.
    ``obstacles``: polylines (k, 3) of what the structure touches.
    """

    points: Floats
    reference: Floats
    triangles: NDArray[np.int32]
    state: NDArray[np.int8]
    taut_margin: Floats
    slack_margin: Floats
    wrinkle_direction: Floats
    scalar: Floats | None = None
    scalar_label: str = ""
    cables: NDArray[np.int32] | tuple[int, ...] = ()
    cable_force: Floats | tuple[float, ...] = ()
    cable_label: str = ""
    title: str = ""
    subtitle: str = ""
    length_unit: str = "m"
    arrows: tuple[tuple[Floats, Floats, str], ...] = ()
    supports: NDArray[np.int32] | tuple[int, ...] = ()
    obstacles: tuple[Floats, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a run is shown: ``azimuth``, ``elevation`` in degrees (see ``camera``), ``size`` in pixels.

    ``scalar_range`` and ``cable_range`` fix the colour ranges for all frames of a run; None takes those of the frame.
    """

    field: Literal["state", "scalar"] = "state"
    azimuth: float = 25.0
    elevation: float = 20.0
    projection: Projection = "perspective"
    size: tuple[int, int] = (1600, 1000)
    show_outline: bool = False
    show_loads: bool = True
    show_supports: bool = True
    show_directions: bool = True
    show_axes: bool = True
    scalar_range: tuple[float, float] | None = None
    cable_range: tuple[float, float] | None = None


def draw_frame(
    frame: Frame, *, look: Look, camera: Camera, path: Path, outline: Sequence[Floats] | None = None
) -> None:
    """Draw one picture and write it as PNG, atomically.

    :param camera: fitted to all frames of the run; it also sets projection and size.
    :param outline: of the undeformed shape, by :func:`undeformed_outline`; found here when None.
    :raises ValueError: arrays whose shapes do not fit, node numbers out of range, values that are not finite.
    """
    _check(frame, look)
    target = raster.raster_of_size(*camera.size)
    screen = camera.project(frame.points)
    scale = _DepthScale.of(screen, camera)
    if outline is None:
        outline = undeformed_outline(frame, look=look, camera=camera)
    bar, level = _scalar_levels(frame, look)
    shares = _area_shares(frame)
    surface = _surface(frame, camera, scale.samples(screen), level)
    target.cover(surface.screen, surface.triangles)
    pixels = target.shade(surface, _paint(look, shares, scale, camera))
    page = Page(pixels.colour, camera)
    page.title(frame.title, frame.subtitle)
    below = page.state_legend(shares, PALETTE) if bar is None else page.colour_bar(bar)
    forces = (
        cable_bar(np.asarray(frame.cable_force), frame.cable_label, look.cable_range) if len(frame.cables) else None
    )
    below = below if forces is None else page.colour_bar(forces, below)
    page.line_legend(below, _legend_rows(page, frame, look, shares))
    page.scale_bar(frame.length_unit)
    if look.show_axes:
        page.axis_triad()
    _draw_over_surface(page, frame, look, pixels, scale, screen, outline, forces)
    _write_png(page.pixels(), path)


@dataclass(frozen=True, kw_only=True)
class _DepthScale:
    """Nearness on the screen, 0 at the farthest node and 1 at the nearest: linear in pixels in both projections."""

    low: float
    span: float
    perspective: bool

    @classmethod
    def of(cls, screen: Floats, camera: Camera) -> _DepthScale:
        perspective = camera.projection == "perspective"
        near = 1.0 / screen[:, 2] if perspective else -screen[:, 2]
        least = 1e-3 / (VIEWER_DISTANCE**2 if perspective else 1.0)  # a sheet seen face on has no depth of its own
        span = max(float(np.ptp(near)), least)
        return cls(low=float(near.min()), span=span, perspective=perspective)

    @property
    def radii(self) -> float:
        """Depth of the whole range in bounding radii, at the distance of the centre."""
        return self.span * (VIEWER_DISTANCE**2 if self.perspective else 1.0)

    def nearness(self, depth: Floats) -> Floats:
        return np.asarray(((1.0 / depth if self.perspective else -depth) - self.low) / self.span)

    def samples(self, screen: Floats) -> NDArray[np.float32]:
        """Vertices as the raster wants them; two samples per pixel and direction."""
        weight = 1.0 / screen[:, 2] if self.perspective else np.ones(len(screen))
        columns = (2.0 * screen[:, 0], 2.0 * screen[:, 1], self.nearness(screen[:, 2]), weight)
        return np.column_stack(columns).astype(np.float32)


def _check(frame: Frame, look: Look) -> None:
    n, m = len(frame.points), len(frame.triangles)
    if m == 0 or frame.triangles.shape != (m, 3):
        raise ValueError(f"triangles must have the shape (m, 3) with m > 0, not {frame.triangles.shape}")
    if frame.triangles.min() < 0 or frame.triangles.max() >= n:
        raise ValueError(
            f"triangles name nodes {frame.triangles.min()} to {frame.triangles.max()}, but there are {n} points"
        )
    wanted = {"points": (n, 3), "reference": (n, 3), "state": (m,), "taut_margin": (m,), "slack_margin": (m,),
              "wrinkle_direction": (m, 3)}  # fmt: skip
    for name, shape in wanted.items():
        _check_array(name, getattr(frame, name), shape, "node" if shape[0] == n and shape != (m,) else "element")
    if not np.isin(frame.state, (TAUT, WRINKLED, SLACK)).all():
        bad = np.flatnonzero(~np.isin(frame.state, (TAUT, WRINKLED, SLACK)))[0]
        raise ValueError(f"state of element {bad} is {frame.state[bad]}; allowed are 0 taut, 1 wrinkled, 2 slack")
    cables = np.asarray(frame.cables, dtype=np.int64)
    if cables.size and not (cables.min() >= 0 and cables.max() < n):
        raise ValueError(f"cables name nodes {cables.min()} to {cables.max()}, but there are {n} points")
    if len(cables) or len(frame.cable_force):
        _check_array("cable_force", np.asarray(frame.cable_force), (len(cables),), "cable")
    supports = np.asarray(frame.supports, dtype=np.int64)
    if supports.size and not (supports.min() >= 0 and supports.max() < n):
        raise ValueError(f"supports name nodes {supports.min()} to {supports.max()}, but there are {n} points")
    for number, (origin, direction, _) in enumerate(frame.arrows):
        if not (np.isfinite(origin).all() and np.isfinite(direction).all() and np.any(direction)):
            raise ValueError(f"arrow {number} needs a finite origin and a direction that is not zero")
    if look.field == "scalar":
        if frame.scalar is None:
            raise ValueError("field = 'scalar', but the frame has no scalar")
        per_element = len(frame.scalar) == m
        _check_array("scalar", frame.scalar, (m if per_element else n,), "element" if per_element else "node")
        if look.scalar_range is not None and not look.scalar_range[0] < look.scalar_range[1]:
            raise ValueError(f"scalar_range = {look.scalar_range} must be (low, high) with low < high")


def _check_array(name: str, values: NDArray[Any], shape: tuple[int, ...], owner: str) -> None:
    if np.shape(values) != shape:
        raise ValueError(f"{name} must have the shape {shape}, not {np.shape(values)}")
    bad = np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(axis=1))
    if bad.size:
        raise ValueError(f"{name} of {owner} {bad[0]} is not finite: {np.asarray(values)[bad[0]]} ({bad.size} in all)")


def _area_shares(frame: Frame) -> tuple[float, float, float]:
    area = np.linalg.norm(_area_vectors(frame.reference, frame.triangles), axis=0)
    by_state = np.bincount(frame.state, weights=area, minlength=3) / area.sum()
    return float(by_state[TAUT]), float(by_state[WRINKLED]), float(by_state[SLACK])


def _area_vectors(points: Floats, triangles: NDArray[np.int32]) -> Floats:
    """Directed areas, (3, m): component by component, several times faster than ``np.cross`` on rows."""
    corners = np.ascontiguousarray(points.T)[:, triangles.T]
    (ux, uy, uz), (vx, vy, vz) = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * np.stack((uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx))


def _unit(vectors: Floats) -> Floats:
    """Columns (3, m) scaled to length one; zero stays zero."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0).clip(1e-30))


def _surface(frame: Frame, camera: Camera, screen: NDArray[np.float32], level: Floats | None) -> raster.Surface:
    """Arrays for the raster; nodal fields are area-weighted means of the values of the elements around."""
    count = len(frame.points)
    triangles = np.ascontiguousarray(frame.triangles, np.int32)
    vectors = camera.axes @ _area_vectors((frame.points - camera.centre) / camera.radius, triangles)
    area = np.linalg.norm(vectors, axis=0)
    weight = area + 1e-12 * area.max() + 1e-30  # a collapsed element still has a say where all are collapsed
    corners = triangles.ravel()

    def node_sum(values: Floats, corners: NDArray[np.int32] = corners) -> Floats:
        return np.bincount(corners, weights=np.repeat(values, 3), minlength=count).astype(np.float64, copy=False)

    total = node_sum(weight).clip(1e-300)
    following = (np.roll(triangles, -1, axis=1) - np.roll(triangles, 1, axis=1)).ravel()
    rim = np.bincount(corners, weights=following, minlength=count) != 0  # the node numbers around an inner node cancel
    beside = np.flatnonzero(rim[triangles].any(axis=1))

    def node_mean(values: Floats) -> Floats:
        """Mean; a node of a rim has elements on one side only and is corrected by what the elements there still miss."""
        mean = node_sum(weight * values) / total
        for _ in range(RIM_CORRECTIONS if beside.size else 0):
            missing = weight[beside] * (values[beside] - mean[triangles[beside]].mean(axis=1))
            mean[rim] += (node_sum(missing, triangles[beside].ravel()) / total)[rim]
        return mean

    node = np.zeros((count, 8), np.float32)
    for column, margin in ((raster.TAUT_MARGIN, frame.taut_margin), (raster.SLACK_MARGIN, frame.slack_margin)):
        mean = node_mean(margin)
        node[:, column] = mean / (np.abs(mean).max() or 1.0)  # whatever its unit, within single precision
    if level is not None:
        node[:, raster.SCALAR] = node_mean(level) if len(level) == len(triangles) else level
    node[:, raster.NORMAL : raster.NORMAL + 3] = _unit(np.stack([node_sum(part) for part in vectors])).T
    cos_2, sin_2 = _screen_direction(frame, camera)
    node[:, raster.COS_2], node[:, raster.SIN_2] = (node_sum(weight * part) / total for part in (cos_2, sin_2))
    face_normal = np.ascontiguousarray(_unit(vectors).T, np.float32)
    return raster.Surface(screen=screen, triangles=triangles, node=node, face_normal=face_normal)


def _screen_direction(frame: Frame, camera: Camera) -> Floats:
    """Wrinkle direction as seen: cos 2θ, sin 2θ times its squared projected length (2, m), in and beside the wrinkled zone.

    Doubling the angle makes a direction and its opposite the same, so that the values can be averaged.
    """
    near = np.zeros(len(frame.points), bool)
    near[frame.triangles[frame.state == WRINKLED]] = True
    used = np.flatnonzero(near[frame.triangles].any(axis=1) & (frame.state != SLACK))
    a, b, c = (frame.points[frame.triangles[used, k]] for k in range(3))
    x, y = camera.seen_direction((a + b + c) / 3.0, _unit(frame.wrinkle_direction[used].T).T).T
    doubled = np.zeros((2, len(frame.triangles)))
    doubled[:, used] = x * x - y * y, 2.0 * x * y
    return doubled


def _scalar_levels(frame: Frame, look: Look) -> tuple[ColourBar | None, Floats | None]:
    """The colour bar and the scalar scaled to it, 0 to 1."""
    if look.field != "scalar" or frame.scalar is None:
        return None, None
    scalar = np.asarray(frame.scalar, dtype=np.float64)
    low, high = look.scalar_range or (float(scalar.min()), float(scalar.max()))
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        half = 0.5 * abs(low) or 0.5  # a constant is shown in the middle of the range
        low, high = low - half, high + half
    hair = 1e-9 * (high - low)
    below, above = bool(scalar.min() < low - hair), bool(scalar.max() > high + hair)
    bar = ColourBar(label=frame.scalar_label, low=low, high=high, ramp=RAMP, below=below, above=above)
    return bar, (scalar - low) / (high - low)


def _paint(look: Look, shares: tuple[float, float, float], scale: _DepthScale, camera: Camera) -> raster.Paint:
    return raster.Paint(
        palette=PALETTE,
        ramp=RAMP,
        shown=(shares[TAUT] > 0.0, shares[WRINKLED] > 0.0, shares[SLACK] > 0.0),
        by_scalar=look.field == "scalar",
        border=look.field == "state" or look.show_directions,
        darkest=DARKEST[look.field],
        line=max(1, round(2.0 * furniture_scale(camera.size))),
        radii_per_nearness=scale.radii,
        samples_per_radius=2.0 * camera.pixels_per_radius,
    )


def undeformed_outline(frame: Frame, *, look: Look, camera: Camera) -> list[Floats]:
    """Contours of the undeformed shape as seen, polylines (k, 2) in pixels; none where they are not shown.

    They are the same in all frames of a run, and take as long to find as the surface that a frame shows.
    """
    if not look.show_outline:
        return []
    target = raster.raster_of_size(*camera.size)
    screen = camera.project(frame.reference)
    samples = _DepthScale.of(screen, camera).samples(screen)
    count = target.cover(samples, np.ascontiguousarray(frame.triangles, np.int32))
    padded = np.pad(count, 1).astype(np.float32)
    lines = contourpy.contour_generator(z=padded).lines(2.0)
    return [np.asarray(line) - 0.5 for line in lines if len(line) > 8]


def _draw_over_surface(
    page: Page, frame: Frame, look: Look, pixels: raster.Pixels, scale: _DepthScale, screen: Floats, outline: Sequence[Floats],
    forces: ColourBar | None,
) -> None:  # fmt: skip
    if outline:
        page.dashed(outline, colour=OUTLINE)
    if look.show_directions:
        state = pixels.code % raster.BACK_FACE
        zone = np.where((pixels.code >= 0) & (state == WRINKLED), pixels.code + 1, 0).astype(np.int32)
        lines = wrinkle_lines(
            zone, pixels.direction, pixels.nearness, spacing=18.0 * page.unit, longest=160.0 * page.unit,
            clearance=max(2, round(3 * page.unit)), jump=raster.LEAP / scale.radii,
        )  # fmt: skip
        dark = [_brightness(pixels.colour, line) < 85.0 for line in lines]
        page.lines(lines, colours=["white" if d else INK for d in dark], width=1.8, capstyle="butt")
    if frame.obstacles:
        seen = [page.camera.project(line) for line in frame.obstacles]
        nets = [np.column_stack([one[:, :2], scale.nearness(one[:, 2])]) for one in seen]
        draw_obstacles(page, nets, pixels.nearness, _ON_SURFACE / scale.radii)
    if len(frame.cables):
        ends = np.asarray(frame.cables, dtype=np.int64)
        places = np.dstack([screen[ends][..., :2], scale.nearness(screen[ends][..., 2])])
        draw_cables(page, places, np.asarray(frame.cable_force), forces, pixels.nearness, _ON_SURFACE / scale.radii)
    if look.show_supports and len(frame.supports):
        nodes = screen[np.asarray(frame.supports, dtype=np.int64)]
        nearness = scale.nearness(nodes[:, 2]) + _ON_SURFACE / scale.radii  # the mark stands on the surface, not in it
        draw_supports(page, nodes[:, :2], nearness, pixels.nearness)
    if look.show_loads:
        draw_loads(page, frame.arrows, pixels.nearness >= 0)


def _brightness(colour: NDArray[np.uint8], line: Floats) -> float:
    """Mean luma (0..255) under a polyline."""
    x, y = line.astype(int).T
    return float((colour[y, x] @ np.array((0.30, 0.59, 0.11))).mean())


def _legend_rows(
    page: Page, frame: Frame, look: Look, shares: tuple[float, float, float]
) -> list[tuple[str, dict[str, object]]]:
    rows: list[tuple[str, dict[str, object]]] = []
    if look.show_directions and shares[WRINKLED] > 0.0:
        rows.append(("wrinkle direction", {"color": INK, "lw": page.points(1.8)}))
        if look.field == "scalar":
            rows.append(("border of the wrinkled zone", {"color": INK, "lw": page.points(1.8), "alpha": 0.55}))
    if len(frame.cables) and not np.all(frame.cable_force):
        rows.append(("slack cable", {"color": SLACK_CABLE, "lw": page.points(3.6), "dashes": (2.0, 1.6)}))
    if frame.obstacles:
        rows.append(("obstacle", {"color": OBSTACLE, "lw": page.points(1.4)}))
    if look.show_outline:
        rows.append(("undeformed outline", {"color": OUTLINE, "lw": page.points(1.8), "dashes": (5.0, 3.0)}))
    if look.show_supports and len(frame.supports):
        rows.append(("support", {"marker": "^", "color": SUPPORT, "ms": page.points(12.0), "mec": "white"}))
    return rows


def _write_png(pixels: NDArray[np.uint8], path: Path) -> None:
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=4)
