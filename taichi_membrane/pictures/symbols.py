"""Supports and loads on the picture of a structure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.pictures.furniture import LOAD, SUPPORT, Page

Floats = NDArray[np.float64]

ARROW, SHORT_ARROW, MANY = 100.0, 62.0, 8  # pixels at 1600 x 1000; the length of an arrow, and of one among many
ARROWS_APART, SUPPORTS_APART = 30.0, 16.0  # pixels; of marks that stand closer only some are drawn


def draw_supports(page: Page, places: Floats, nearness: Floats, seen: NDArray[np.float32]) -> None:
    """A triangle under each supported node that is seen, a faint one where the surface hides it.

    :param places: (k, 2) pixels of the nodes. ``nearness`` (k,) theirs, ``seen`` (h, w) that of the surface in each pixel.
    """
    inside = ((places >= 0) & (places < (page.width, page.height))).all(axis=1)
    places, nearness = places[inside], nearness[inside]
    x, y = places.astype(int).T
    visible = nearness >= seen[y, x]
    for shown in (False, True):
        x, y = _thinned(places[visible == shown], SUPPORTS_APART * page.unit).T
        page.axes.plot(
            x, y + 5.0 * page.unit, "^", ms=page.points(13.0), mfc=SUPPORT if shown else "none",
            mec="white" if shown else SUPPORT, mew=page.points(0.9), alpha=1.0 if shown else 0.3, zorder=5 if shown else 4,
        )  # fmt: skip


def draw_loads(page: Page, arrows: Sequence[tuple[Floats, Floats, str]], surface: NDArray[np.bool_]) -> None:
    """Arrows of one length with their label; loads that share a label are drawn alike and named once.

    Either the tips or the tails stand at the loaded points, whichever hides less of the surface and of the text.

    :param arrows: origin (3,), direction (3,), label. ``surface`` (h, w): pixels that show the surface.
    """
    labels = dict.fromkeys(label for _, _, label in arrows)
    for label in labels:
        origins = np.array([origin for origin, _, name in arrows if name == label], dtype=np.float64)
        directions = np.array([direction for _, direction, name in arrows if name == label], dtype=np.float64)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        roots = page.camera.project(origins)[:, :2]
        kept = _thinned_numbers(roots, ARROWS_APART * page.unit)
        _draw_group(page, roots[kept], directions[kept], label, surface)


def _draw_group(page: Page, roots: Floats, directions: Floats, label: str, surface: NDArray[np.bool_]) -> None:
    many = len(roots) >= MANY
    seen = directions @ page.camera.axes.T
    end_on = np.hypot(seen[:, 0], seen[:, 1]) < 0.2
    shafts = seen[:, :2] * (1.0, -1.0) * ((SHORT_ARROW if many else ARROW) * page.unit)
    shafts[end_on] = 0.0
    outwards = sum(_cost(page, surface, root, root + shaft) for root, shaft in zip(roots, shafts, strict=True))
    inwards = sum(_cost(page, surface, root, root - shaft) for root, shaft in zip(roots, shafts, strict=True))
    tails, tips = (roots, roots + shafts) if outwards < inwards else (roots - shafts, roots)
    for tail, tip, along_sight, towards in zip(tails, tips, end_on, seen[:, 2] > 0, strict=True):
        if along_sight:
            page.arrow_end_on(tip, towards=bool(towards), colour=LOAD)
        else:
            page.arrow(tail, tip, colour=LOAD, width=2.4 if many else 3.4, head=12.0 if many else 16.0)
        page.keep_clear(tail, tip)
    if label:
        free, loaded = (tips, tails) if outwards < inwards else (tails, tips)
        page.label_beyond(list(zip(free, loaded, strict=True)), label, colour=LOAD)


def _cost(page: Page, surface: NDArray[np.bool_], root: Floats, free: Floats) -> float:
    """Part of an arrow that lies over the surface (0 to 1), plus one when it runs through text or off the page."""
    x, y = np.linspace(root, free, 24)[1:].T
    on_page = (x >= 0) & (x < page.width) & (y >= 0) & (y < page.height)
    covered = surface[y[on_page].astype(int), x[on_page].astype(int)].sum() / len(x)
    return float(covered) + float(not on_page.all() or page.hits_text(root, free))


def _thinned(points: Floats, apart: float) -> Floats:
    return points[_thinned_numbers(points, apart)]


def _thinned_numbers(points: Floats, apart: float) -> list[int]:
    """Numbers of some of the points (n, 2), no two nearer than ``apart``; the first ones win."""
    kept: list[int] = []
    for number, point in enumerate(points):
        if not kept or np.hypot(*(points[kept] - point).T).min() >= apart:
            kept.append(number)
    return kept
