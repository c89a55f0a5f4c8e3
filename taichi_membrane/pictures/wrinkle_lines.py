"""Evenly spaced lines along the wrinkles, traced in the finished picture.

Tracing visible pixels instead of surface triangles settles three things at once: hidden lines cannot appear, lines end at
the border of the wrinkled zone to the pixel, and their spacing does not depend on the mesh (Jobard and Lefer 1997).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Line = NDArray[np.float64]

STEP = 2.0  # pixels between points of a line
CELL = 2  # pixels per cell of the map of what is taken


def wrinkle_lines(
    zone: NDArray[np.int32],
    direction: NDArray[np.float32],
    nearness: NDArray[np.float32],
    *,
    spacing: float,
    longest: float,
    clearance: int,
    jump: float,
) -> list[Line]:
    """Polylines (k, 2) of pixel positions x, y.

    :param zone: (h, w) label of the visible piece of wrinkled surface each pixel shows, 0 where there is none.
    :param direction: (h, w, 2) cos 2θ, sin 2θ of the wrinkle direction on the screen (y downwards), any length.
    :param nearness: (h, w); a line ends where it changes by more than ``jump`` in one step (another part of the surface).
    :param spacing: pixels between lines. ``longest``: pixels after which a line ends; one shorter than ``spacing`` is left
        out. ``clearance``: pixels kept free at the border of the zone, at least half the width the lines are drawn with.
    """
    inner = _shrink(zone, clearance)
    seeds = _seeds(inner, 0.5 * spacing)
    if not len(seeds):
        return []
    steps = int(0.5 * longest / STEP)
    forward = _trace(seeds, inner, direction, nearness, 1.0, steps, jump)
    backward = _trace(seeds, inner, direction, nearness, -1.0, steps, jump)
    return _choose(forward, backward, zone.shape, spacing)


def _shrink(zone: NDArray[np.int32], clearance: int) -> NDArray[np.int32]:
    """The zone without the pixels nearer than ``clearance`` to any other label."""
    width = 2 * clearance + 1
    low = ndimage.minimum_filter(zone, width, mode="constant")
    high = ndimage.maximum_filter(zone, width, mode="constant")
    return np.where(low == high, zone, 0)


def _seeds(zone: NDArray[np.int32], pitch: float) -> NDArray[np.float64]:
    """Pixels of the zone on a triangular lattice fixed to the page: the pattern holds still from frame to frame."""
    rows = np.arange(0.5 * pitch, zone.shape[0], pitch * np.sqrt(0.75))
    columns = np.arange(0.25 * pitch, zone.shape[1] - 0.5 * pitch, pitch)
    x = columns[None, :] + 0.5 * pitch * (np.arange(len(rows)) % 2)[:, None]
    y = np.broadcast_to(rows[:, None], x.shape)
    inside = zone[y.astype(int), x.astype(int)] != 0
    return np.column_stack((x[inside], y[inside]))


def _heading(
    direction: NDArray[np.float32], at: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unit direction at pixels, of the two senses the one that goes on ``along``; zero where there is none."""
    double = direction[at[:, 1].astype(int), at[:, 0].astype(int)].astype(np.float64)
    angle = 0.5 * np.arctan2(double[:, 1], double[:, 0])
    heading = np.column_stack((np.cos(angle), np.sin(angle))) * (np.abs(double).max(axis=1) > 0)[:, None]
    return np.asarray(heading * np.where((heading * along).sum(axis=1) < 0, -1.0, 1.0)[:, None])


def _trace(
    seeds: NDArray[np.float64],
    zone: NDArray[np.int32],
    direction: NDArray[np.float32],
    nearness: NDArray[np.float32],
    sense: float,
    steps: int,
    jump: float,
) -> NDArray[np.float64]:
    """All lines at once, (steps + 1, n, 2), midpoint rule; NaN after a line's end."""
    limit = np.array(zone.shape[::-1]) - 1e-6
    path = np.full((steps + 1, len(seeds), 2), np.nan)
    path[0] = seeds
    alive = np.arange(len(seeds))
    at = seeds
    heading = sense * _heading(direction, at, np.tile((1.0, 0.0), (len(at), 1)))
    label, near = _at(zone, at), _at(nearness, at)
    for k in range(1, steps + 1):
        middle = (at + 0.5 * STEP * heading).clip(0.0, limit)
        turned = _heading(direction, middle, heading)
        moved = (at + STEP * turned).clip(0.0, limit)
        now = _at(nearness, moved)
        straight = (turned * heading).sum(axis=1) > 0.5  # a sharper bend in two pixels is noise, not a wrinkle
        goes_on = (_at(zone, moved) == label) & (np.abs(now - near) < jump) & straight
        alive, at, heading, label, near = alive[goes_on], moved[goes_on], turned[goes_on], label[goes_on], now[goes_on]
        if not len(alive):
            break
        path[k, alive] = at
    return path


def _at(field: NDArray[np.int32] | NDArray[np.float32], at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(field[at[:, 1].astype(int), at[:, 0].astype(int)])


def _choose(
    forward: NDArray[np.float64], backward: NDArray[np.float64], shape: tuple[int, ...], spacing: float
) -> list[Line]:
    """Seed by seed, keep lines that start a full spacing from the others and cut them where they come within half of it."""
    taken = np.zeros((2, shape[0] // CELL + 1, shape[1] // CELL + 1), bool)  # [0] for seeds, [1] for lines
    discs = [_disc(spacing / CELL), _disc(0.5 * spacing / CELL)]
    lines = []
    for n in range(forward.shape[1]):
        x, y = (forward[0, n] // CELL).astype(int)
        if taken[0, y, x]:
            continue
        ahead, back = (_free_part(path[:, n], taken[1]) for path in (forward, backward))
        line = np.concatenate((back[:0:-1], ahead))
        if (len(line) - 1) * STEP < spacing:
            continue
        lines.append(line)
        cells = (line[::2] // CELL).astype(int)
        for layer, disc in enumerate(discs):
            i = cells[:, None, 0] + disc[None, :, 0]
            j = cells[:, None, 1] + disc[None, :, 1]
            taken[layer, j.clip(0, taken.shape[1] - 1), i.clip(0, taken.shape[2] - 1)] = True
    return lines


def _free_part(path: NDArray[np.float64], taken: NDArray[np.bool_]) -> NDArray[np.float64]:
    ends = np.flatnonzero(np.isnan(path[:, 0]))
    path = path[: ends[0]] if ends.size else path
    cells = (path // CELL).astype(int)
    blocked = np.flatnonzero(taken[cells[:, 1], cells[:, 0]])
    return path[: blocked[0]] if blocked.size else path


def _disc(radius: float) -> NDArray[np.int64]:
    reach = np.arange(-int(radius), int(radius) + 1)
    i, j = np.meshgrid(reach, reach)
    inside = i**2 + j**2 <= radius**2
    return np.column_stack((i[inside], j[inside]))
