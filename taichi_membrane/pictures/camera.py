"""Where the picture is taken from: projection of points to pixels, and a camera that fits a whole run.

The z axis is up. Azimuth and elevation say where the viewer stands, in degrees. At azimuth 0 and elevation 0 the viewer
stands on the negative y side: x runs to the right and z upwards in the picture (the front view of technical drawing).
A positive azimuth walks the viewer counter-clockwise about z as seen from above (right-handed; at 90 the viewer stands on
the positive x side); a positive elevation lifts the viewer. Elevation 90 is the plan view, x to the right and y upwards.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError

Projection = Literal["perspective", "orthographic"]

SMALLEST_SIZE, LARGEST_SIZE = (240, 160), (8192, 8192)  # below: text becomes unreadable; above: gigabytes of buffers
VIEWER_DISTANCE = 4.0  # bounding radii from the centre; a field of view of 29°, near to that of a short telephoto lens
NEAREST_DEPTH = 0.05  # bounding radii; anything nearer to the viewer cannot be drawn sensibly
SUPPORT_ANGLES = np.radians(np.arange(0, 360, 5))  # directions in which the outline's extent is measured

# Pixels that furniture needs at 1600 x 1000: margin of the page, then width and height of the four corner boxes.
PAGE_MARGIN, TOP_MARGIN = 44.0, 112.0  # above: two lines of title, however long
CORNER_BOXES = {"title": (700.0, 120.0), "legend": (420.0, 260.0), "axes": (200.0, 190.0), "scale": (360.0, 120.0)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A fitted camera; lengths are normalised by the bounding sphere of everything it has to show.

    ``centre`` (3,) and ``radius`` are that sphere, in the length unit of the points. The rows of ``axes`` (3, 3) are the
    picture's right, its up and the direction towards the viewer. The centre appears at ``principal`` (x, y) in pixels,
    where a length of one radius measures ``pixels_per_radius``. ``size`` is width and height in pixels.
    """

    centre: NDArray[np.float64]
    radius: float
    axes: NDArray[np.float64]
    projection: Projection
    principal: tuple[float, float]
    pixels_per_radius: float
    size: tuple[int, int]

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels x (to the right), y (downwards, 0 at the top edge) and depth in radii from the viewer, as (n, 3).

        :param points: (n, 3), same length unit as the fitted points.
        :raises ValueError: a point that is not finite, or behind the viewer; the message names the node.
        """
        view = _view(points, self.centre, self.radius, self.axes)
        depth = VIEWER_DISTANCE - view[:, 2]
        scale = np.full(len(view), self.pixels_per_radius)
        if self.projection == "perspective":
            behind = np.flatnonzero(depth < NEAREST_DEPTH)
            if behind.size:
                raise ValueError(f"node {behind[0]} lies behind the viewer; fit the camera to every point set it shows")
            scale *= VIEWER_DISTANCE / depth
        x, y = self.principal
        return np.column_stack((x + scale * view[:, 0], y - scale * view[:, 1], depth))

    def seen_direction(self, points: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions at points as seen in the picture: x, y (downwards) per unit of ``directions``, (n, 2); 1 is full length."""
        x, y, z = self.axes @ ((points - self.centre) / self.radius).T
        right, up, towards = self.axes @ directions.T
        if self.projection == "orthographic":
            return np.stack((right, -up), axis=1)
        depth = VIEWER_DISTANCE - z
        return (
            np.stack((right + x * towards / depth, -up - y * towards / depth), axis=1)
            * (VIEWER_DISTANCE / depth)[:, None]
        )

    @property
    def pixels_per_length(self) -> float:
        """Pixels per unit of length at the depth of the centre (everywhere when orthographic)."""
        return self.pixels_per_radius / self.radius


def furniture_scale(size: tuple[int, int]) -> float:
    """Size of text and furniture relative to a picture of 1600 x 1000; small pictures get relatively larger text."""
    return float(min(size[0] / 1600.0, size[1] / 1000.0) ** 0.85)


def fit_camera(
    point_sets: Iterable[NDArray[np.float64]],
    *,
    azimuth: float,
    elevation: float,
    projection: Projection,
    size: tuple[int, int],
) -> Camera:
    """One camera for all frames of a run: the largest view in which every point keeps clear of title, legend, axes, scale.

    :param point_sets: arrays (n, 3) of node positions, e.g. of every load step and of the undeformed shape.
    :param azimuth: degrees, see the module.
    :param elevation: degrees, -90 to 90.
    :param size: width and height of the picture in pixels.
    :raises InputError: unknown projection, angle or size out of range.
    :raises ValueError: no points, a point that is not finite (named by set and node), or all points in one place.
    """
    _check_view(azimuth, elevation, projection, size)
    sets = [_checked(points, f"point set {number}: ") for number, points in enumerate(point_sets)]
    if not sum(map(len, sets)):
        raise ValueError("a camera cannot be fitted to no points")
    low, high = (
        np.min([p.min(axis=0) for p in sets if len(p)], axis=0),
        np.max([p.max(axis=0) for p in sets if len(p)], axis=0),
    )
    centre = 0.5 * (low + high)
    radius = float(np.sqrt(max(((p - centre) ** 2).sum(axis=1).max() for p in sets if len(p))))
    if not radius > 1e-12 * float(np.abs(centre).max()):
        raise ValueError(f"all points lie in one place, {centre.tolist()}; there is nothing to fit a camera to")
    axes = _axes(azimuth, elevation)
    flat = [_flat(_view(p, centre, radius, axes), projection) for p in sets if len(p)]
    scale, principal = _largest_view(flat, size)
    return Camera(
        centre=centre,
        radius=radius,
        axes=axes,
        projection=projection,
        principal=principal,
        pixels_per_radius=scale,
        size=size,
    )


def _checked(points: NDArray[np.float64], prefix: str = "") -> NDArray[np.float64]:
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{prefix}points must have the shape (n, 3), not {points.shape}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise ValueError(f"{prefix}node {bad[0]} is not finite: {points[bad[0]].tolist()} ({bad.size} such nodes)")
    return points


def _check_view(azimuth: float, elevation: float, projection: str, size: tuple[int, int]) -> None:
    if projection not in get_args(Projection):
        raise InputError(f"projection = {projection!r} is not one of {', '.join(get_args(Projection))}")
    if not np.isfinite(azimuth):
        raise InputError(f"azimuth = {azimuth} must be a finite number of degrees")
    if not -90.0 <= elevation <= 90.0:
        raise InputError(f"elevation = {elevation} must lie between -90 and 90 degrees")
    if not all(low <= n <= high for n, low, high in zip(size, SMALLEST_SIZE, LARGEST_SIZE, strict=True)):
        low_high = f"{SMALLEST_SIZE[0]} x {SMALLEST_SIZE[1]} and {LARGEST_SIZE[0]} x {LARGEST_SIZE[1]}"
        raise InputError(f"size = {size[0]} x {size[1]} pixels must lie between {low_high}")


def _axes(azimuth: float, elevation: float) -> NDArray[np.float64]:
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    right = np.array([np.cos(a), np.sin(a), 0.0])
    return np.stack((right, np.cross(towards, right), towards))


def _view(
    points: NDArray[np.float64], centre: NDArray[np.float64], radius: float, axes: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.asarray((_checked(points) - centre) / radius @ axes.T)


def _flat(view: NDArray[np.float64], projection: Projection) -> NDArray[np.float64]:
    """Picture coordinates (x right, y down) in radii at the depth of the centre."""
    flat = view[:, :2] * (1.0, -1.0)
    return flat * (VIEWER_DISTANCE / (VIEWER_DISTANCE - view[:, 2:])) if projection == "perspective" else flat


def _largest_view(flat: list[NDArray[np.float64]], size: tuple[int, int]) -> tuple[float, tuple[float, float]]:
    """Scale (pixels per radius) and principal point of the largest view whose convex outline avoids the furniture.

    A convex outline avoids a box in the corner of the page exactly if some straight line through the box's inner corner
    separates them. For a given position and a given slope of that line the largest scale is a quotient of the line's
    distance and the outline's extent, so that positions on a grid can be compared in closed form.
    """
    normals = np.column_stack((np.cos(SUPPORT_ANGLES), np.sin(SUPPORT_ANGLES)))
    inside = np.mean([p.mean(axis=0) for p in flat], axis=0)  # a mean of points lies inside their convex outline
    extent = np.max([((p - inside) @ normals.T).max(axis=0) for p in flat], axis=0).clip(1e-9)
    quarter = len(normals) // 4
    middle = 0.5 * np.array([extent[0] - extent[2 * quarter], extent[quarter] - extent[3 * quarter]])

    width, height = size
    unit = furniture_scale(size)
    margin, top = PAGE_MARGIN * unit, TOP_MARGIN * unit
    x, y = np.meshgrid(np.linspace(margin, width - margin, 81), np.linspace(top, height - margin, 81))
    spots = np.stack((x, y), axis=-1)  # trial places of the point ``inside``
    sides = (
        (0, width - margin, 1.0),
        (quarter, height - margin, 1.0),
        (2 * quarter, margin, -1.0),
        (3 * quarter, top, -1.0),
    )
    scale = np.min([sign * (limit - (y if k % (2 * quarter) else x)) / extent[k] for k, limit, sign in sides], axis=0)
    first = {"title": 2 * quarter, "legend": 3 * quarter, "axes": quarter, "scale": 0}
    for name, (box_width, box_height) in CORNER_BOXES.items():
        at_left, at_top = name in ("title", "axes"), name in ("title", "legend")
        corner = np.array(
            (
                box_width * unit if at_left else width - box_width * unit,
                box_height * unit if at_top else height - box_height * unit,
            )
        )
        k = (first[name] + np.arange(quarter + 1)) % len(normals)
        scale = np.minimum(scale, (((corner - spots) @ normals[k].T) / extent[k]).max(axis=-1))
    off_centre = np.abs(spots + scale[..., None] * middle - 0.5 * np.array(size)).max(axis=-1) / max(size)
    best = np.unravel_index(np.argmax(scale * (1.0 - 0.25 * off_centre)), scale.shape)  # centred, when it costs little
    principal = spots[best] - scale[best] * inside
    return float(scale[best]), (float(principal[0]), float(principal[1]))
