"""Cables on the picture of a structure: lines coloured by their force, pale where the surface hides them, dashed where slack."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.pictures.colours import CABLE_RAMP
from taichi_membrane.pictures.furniture import INK, SLACK_CABLE, ColourBar, Page

Floats = NDArray[np.float64]

STEP = 3.0  # pixels between places of a line that are compared with the surface
WIDTH, EDGE = 3.6, 1.6  # pixels at 1600 x 1000: of a line, and of its dark edge on both sides together


def cable_bar(force: Floats, label: str, span: tuple[float, float] | None) -> ColourBar | None:
    """The colour bar of forces; None where all are slack.

    :param span: least and largest value; those of the forces that are not zero without it.
    """
    taut = force[force != 0.0]
    if span is None and not taut.size:
        return None
    low, high = span or (float(taut.min()), float(taut.max()))
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        half = 0.5 * abs(low) or 0.5  # one force is shown in the middle of the range
        low, high = low - half, high + half
    below, above = (bool((taut < low).any()), bool((taut > high).any()))
    return ColourBar(label=label, low=low, high=high, ramp=CABLE_RAMP, below=below, above=above)


def draw_cables(
    page: Page, ends: Floats, force: Floats, bar: ColourBar | None, seen: NDArray[np.float32], lift: float
) -> None:
    """Draw straight pieces of cables.

    :param ends: (k, 2, 3) x, y in pixels and nearness of both ends of each. ``force`` (k,), zero where it is slack.
    :param seen: (h, w) nearness of the surface in each pixel, negative where there is none.
    :param lift: nearness by which a line may lie under the surface and still be drawn as on it.
    """
    colours = np.tile(np.array(SLACK_CABLE), (len(ends), 1))
    if bar is not None:
        level = np.clip((force - bar.low) / (bar.high - bar.low), 0.0, 1.0)
        taut = force != 0.0
        colours[taut] = CABLE_RAMP[np.rint(level[taut] * (len(CABLE_RAMP) - 1)).astype(int)]
    for visible in (False, True):
        for slack in (True, False):
            lines, owner = [], []
            for number in np.flatnonzero((force == 0.0) == slack):
                parts = _parts(ends[number], seen, lift, visible=visible)
                lines += parts
                owner += [number] * len(parts)
            if not lines:
                continue
            dashes = {"linestyles": [(0, (2.0, 1.6))]} if slack else {}
            if visible and not slack:
                page.lines(lines, colours=INK, width=WIDTH + EDGE, zorder=3)
            look = {"zorder": 4} if visible else {"alpha": 0.35, "zorder": 2}
            page.lines(
                lines, colours=colours[owner], width=WIDTH if visible else 0.6 * WIDTH, capstyle="butt" if slack else "round",
                **look, **dashes,
            )  # fmt: skip


def _parts(ends: Floats, seen: NDArray[np.float32], lift: float, *, visible: bool) -> list[Floats]:
    """The parts (k, 2) of a straight line that are seen, or those that are not."""
    count = max(2, int(np.hypot(*(ends[1, :2] - ends[0, :2])) / STEP) + 1)
    places = ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0])
    x, y = places[:, :2].astype(int).T
    on_page = (x >= 0) & (y >= 0) & (x < seen.shape[1]) & (y < seen.shape[0])
    free = np.ones(count, dtype=bool)
    free[on_page] = places[on_page, 2] + lift >= seen[y[on_page], x[on_page]]
    chosen = np.concatenate(([False], free == visible, [False])).astype(np.int8)
    begins, stops = np.flatnonzero(np.diff(chosen) == 1), np.flatnonzero(np.diff(chosen) == -1)
    reach = 0 if visible else 1  # what is hidden is drawn first, and up to what is seen
    ranges = zip(begins.tolist(), stops.tolist(), strict=True)
    return [places[max(a - reach, 0) : b + reach, :2] for a, b in ranges if b - a > 1]
