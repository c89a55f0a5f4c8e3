"""Obstacles on the picture of a structure: grey lines, pale where the surface hides them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.pictures.furniture import OBSTACLE, Page

Floats = NDArray[np.float64]

WIDTH = 1.4  # pixels at 1600 x 1000
STEP = 4.0  # pixels between places of a line that are compared with the surface


def draw_obstacles(page: Page, lines: Sequence[Floats], seen: NDArray[np.float32], lift: float) -> None:
    """Draw polylines.

    :param lines: (k, 3) x, y in pixels and nearness. ``seen`` (h, w): nearness of the surface in each pixel, negative where there
        is none.
    :param lift: nearness by which a line may lie under the surface and still be drawn as on it.
    """
    shown: list[Floats] = []
    hidden: list[Floats] = []
    for line in lines:
        places = _finer(line)
        x, y = places[:, :2].astype(int).T
        on_page = (x >= 0) & (y >= 0) & (x < seen.shape[1]) & (y < seen.shape[0])
        free = np.ones(len(places), dtype=bool)
        free[on_page] = places[on_page, 2] + lift >= seen[y[on_page], x[on_page]]
        cuts = np.flatnonzero(np.diff(free.astype(np.int8))) + 1
        for piece, is_free in zip(np.split(places, cuts), free[np.concatenate([[0], cuts])], strict=True):
            (shown if is_free else hidden).append(piece[:, :2])
    if hidden:
        page.lines(hidden, colours=OBSTACLE, width=WIDTH, alpha=0.16, zorder=1.5)
    if shown:
        page.lines(shown, colours=OBSTACLE, width=WIDTH, alpha=0.5, zorder=1.6)


def _finer(line: Floats) -> Floats:
    """The line with places no further apart than :data:`STEP`."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    places = np.linspace(0.0, length[-1], max(2, int(length[-1] / STEP) + 1))
    return np.column_stack([np.interp(places, length, column) for column in line.T])
