"""Load–deflection curves and other x–y plots, ready for print.

Colours are those of Okabe and Ito, told apart with any colour blindness; every series also has its own marker, so that the
plot can be read in grey. Curves are labelled at a free place in the axes, never on top of one another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import matplotlib
import matplotlib.patheffects as effects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.output.atomic import replacing

Style = Literal["computed", "reference"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P")
INK, GREY = "#16181d", "#6b717c"
FONT = {"title": 12.0, "label": 11.0, "tick": 9.5, "small": 9.0}  # points on a page 7 inches wide
SIZE, DPI = (7.0, 4.6), 200
MANY = 40  # points; with more, only some carry a marker


@dataclass(frozen=True, kw_only=True)
class Series:
    """One curve. ``x``, ``y`` (n,) in the order to be joined; "reference" is drawn in grey with hollow markers and dashes."""

    label: str
    x: NDArray[np.float64] | Sequence[float]
    y: NDArray[np.float64] | Sequence[float]
    style: Style = "computed"


@dataclass(frozen=True, kw_only=True)
class ReferenceLine:
    """A straight line across the plot at ``value`` of the ``axis``, e.g. a theoretical collapse load."""

    label: str
    axis: Literal["x", "y"]
    value: float


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A labelled point, e.g. the onset of wrinkling."""

    label: str
    x: float
    y: float


def draw_curve(
    path: Path,
    *,
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    title: str,
    lines: Sequence[ReferenceLine] = (),
    marks: Sequence[Mark] = (),
) -> None:
    """Draw curves with reference lines and marked points; the format follows the suffix: .png, .svg or .pdf. Atomic.

    :param x_label: with unit, e.g. ``tip deflection [m]``.
    :raises InputError: no series, series whose x and y differ in length or are empty or not finite, unknown style, axis or
        suffix, or a label that cannot be typeset.
    """
    _check(path, series, lines, marks)
    figure = Figure(figsize=SIZE, dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.07))
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _prepare(axes, x_label, y_label, title)
    computed = 0
    for one in series:
        _draw_series(axes, one, computed)
        computed += one.style == "computed"
    for line in lines:
        (axes.axhline if line.axis == "y" else axes.axvline)(
            line.value, color=GREY, lw=1.1, ls=(0, (6, 3, 1.2, 3)), zorder=1
        )
    for mark in marks:
        axes.plot(mark.x, mark.y, "o", ms=8.5, mfc="white", mec=INK, mew=1.4, zorder=6, clip_on=False)
    _limits(axes, series, lines, marks)
    try:
        _legend(figure, canvas, min(3, len(series)))
    except ValueError as error:  # mathtext between dollar signs
        raise InputError(f"{path}: a label or title cannot be typeset: {error}") from error
    figure.set_layout_engine("none")  # the axes stay where they are from here on
    _place_labels(axes, canvas, series, lines, marks)
    _save(figure, path)


def _check(path: Path, series: Sequence[Series], lines: Sequence[ReferenceLine], marks: Sequence[Mark]) -> None:
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{path}: the suffix must be .png, .svg or .pdf")
    if not series:
        raise InputError(f"{path}: a plot needs at least one series")
    for one in series:
        x, y = np.asarray(one.x, np.float64), np.asarray(one.y, np.float64)
        if x.ndim != 1 or x.shape != y.shape or not x.size:
            raise InputError(
                f"series {one.label!r}: x and y must be lists of one length > 0, not {x.shape} and {y.shape}"
            )
        bad = np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))
        if bad.size:
            raise InputError(f"series {one.label!r}: point {bad[0]} is not finite: ({x[bad[0]]}, {y[bad[0]]})")
        if one.style not in get_args(Style):
            raise InputError(f"series {one.label!r}: style = {one.style!r} is not one of {', '.join(get_args(Style))}")
    for line in lines:
        if line.axis not in ("x", "y"):
            raise InputError(f"line {line.label!r}: axis = {line.axis!r} is not one of x, y")
        if not np.isfinite(line.value):
            raise InputError(f"line {line.label!r}: value = {line.value} is not finite")
    for mark in marks:
        if not np.isfinite((mark.x, mark.y)).all():
            raise InputError(f"mark {mark.label!r}: ({mark.x}, {mark.y}) is not finite")


def _prepare(axes: Axes, x_label: str, y_label: str, title: str) -> None:
    axes.set_title(title, fontsize=FONT["title"], fontweight="bold", loc="left", color=INK, pad=10.0, wrap=True)
    axes.set_xlabel(x_label, fontsize=FONT["label"], color=INK)
    axes.set_ylabel(y_label, fontsize=FONT["label"], color=INK)
    rule(axes)


def rule(axes: Axes, *, size: float = FONT["tick"], length: float = 4.0) -> None:
    """Ticks inwards on all sides, with a grid behind the data.

    :param size: of the numbers [points].
    :param length: of the ticks [points].
    """
    axes.tick_params(labelsize=size, direction="in", length=length, color=INK, labelcolor=INK, top=True, right=True)
    axes.ticklabel_format(scilimits=(-3, 5), useMathText=True)
    axes.grid(color="#dfe2e7", lw=0.6)
    axes.set_axisbelow(True)


def _draw_series(axes: Axes, one: Series, number: int) -> None:
    x, y = np.asarray(one.x, np.float64), np.asarray(one.y, np.float64)
    every = max(1, len(x) // (MANY // 2)) if len(x) > MANY else 1
    if one.style == "reference":
        axes.plot(
            x,
            y,
            "--d",
            color=GREY,
            lw=1.3,
            ms=5.0,
            mfc="white",
            mew=1.1,
            markevery=every,
            label=one.label,
            zorder=3,
            clip_on=False,
        )
        return
    colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
    axes.plot(
        x,
        y,
        "-",
        color=colour,
        marker=marker,
        lw=1.8,
        ms=4.5,
        markevery=every,
        label=one.label,
        zorder=4,
        clip_on=False,
    )


def _legend(figure: Figure, canvas: FigureCanvasAgg, columns: int) -> None:
    """Names of the curves below the axes, in as many columns as fit the page; lays the figure out."""
    for count in range(columns, 0, -1):
        legend = figure.legend(loc="outside lower center", ncols=count, frameon=False, fontsize=FONT["small"])
        canvas.draw()
        if count == 1 or legend.get_window_extent().width < 0.96 * SIZE[0] * DPI:
            return
        legend.remove()


def _limits(axes: Axes, series: Sequence[Series], lines: Sequence[ReferenceLine], marks: Sequence[Mark]) -> None:
    """Room around all that is drawn, with the origin in the corner where the data start there."""
    for axis, values in (
        ("x", [np.asarray(s.x, np.float64) for s in series] + [[m.x for m in marks]]),
        ("y", [np.asarray(s.y, np.float64) for s in series] + [[m.y for m in marks]]),
    ):
        every = np.concatenate([*values, [line.value for line in lines if line.axis == axis]])
        low, high = float(every.min()), float(every.max())
        if 0.0 < low < 0.25 * high:
            low = 0.0
        if 0.25 * low < high < 0.0:
            high = 0.0
        room = 0.07 * (high - low) or 0.1 * abs(low) or 1.0
        limits = (
            low - (room if low != 0.0 or high == 0.0 else 0.0),
            high + (room if high != 0.0 or low == 0.0 else 0.0),
        )
        (axes.set_xlim if axis == "x" else axes.set_ylim)(limits)


def _place_labels(
    axes: Axes, canvas: FigureCanvasAgg, series: Sequence[Series], lines: Sequence[ReferenceLine], marks: Sequence[Mark]
) -> None:
    """Labels of lines and marks, each where it hides least of the curves and none of the other labels."""
    curves = [_dense(axes, np.asarray(one.x, np.float64), np.asarray(one.y, np.float64)) for one in series]
    dots = [axes.transData.transform((mark.x, mark.y))[None] for mark in marks]
    ink = np.concatenate(curves + dots)
    taken: list[Bbox] = []
    box = axes.get_window_extent()
    gap = 4.0 * DPI / 72.0
    for line in lines:
        text = _text(axes, line.label, GREY, rotation=0.0 if line.axis == "y" else 90.0)
        width, height = _extent(text, canvas)
        x, y = axes.transData.transform((line.value, line.value))
        if line.axis == "y":
            spots = [
                (left, y + side * (0.5 * height + gap))
                for side in (1, -1)
                for left in _steps(box.x0, box.x1, width, gap)
            ]
        else:
            spots = [
                (x + side * (0.5 * width + gap), low) for side in (-1, 1) for low in _steps(box.y0, box.y1, height, gap)
            ]
        _put(text, spots, (width, height), ink, taken, box)
    for mark, dot in zip(marks, dots, strict=True):
        text = _text(axes, mark.label, INK)
        width, height = _extent(text, canvas)
        spots = []
        for reach in (2.2, 4.5, 9.0, 16.0):
            for across, along in ((1, -1), (-1, 1), (1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)):
                shift = np.array((across * (0.5 * width + reach * gap), along * (0.5 * height + reach * gap)))
                spots.append(tuple(dot[0] + shift))
        _put(text, spots, (width, height), ink, taken, box)
        _leader(axes, text, dot[0], (width, height))


def _dense(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points along a curve in pixels, a few pixels apart."""
    corners = axes.transData.transform(np.column_stack((x, y)))
    if len(corners) == 1:
        return np.asarray(corners)
    at = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    even = np.linspace(0.0, at[-1], int(min(at[-1] / 4.0, 20_000)) + 2)
    return np.column_stack([np.interp(even, at, column) for column in corners.T])


def _text(axes: Axes, words: str, colour: str, rotation: float = 0.0) -> Text:
    text = axes.text(
        0.0, 0.0, words, transform=None, ha="center", va="center", rotation=rotation, fontsize=FONT["small"],
        color=colour, zorder=8, clip_on=False,
    )  # fmt: skip
    text.set_path_effects([effects.withStroke(linewidth=3.0, foreground="white")])
    return text


def _extent(text: Text, canvas: FigureCanvasAgg) -> tuple[float, float]:
    try:
        extent = text.get_window_extent(canvas.get_renderer())
    except ValueError as error:  # mathtext between dollar signs
        raise InputError(f"{text.get_text()!r} cannot be typeset: {error}") from error
    return float(extent.width), float(extent.height)


def _steps(low: float, high: float, length: float, gap: float) -> list[float]:
    """Centres of a label along a line, from its far end to its near end."""
    first, last = low + 0.5 * length + 2.0 * gap, high - 0.5 * length - 2.0 * gap
    return [float(value) for value in np.linspace(last, first, 9)] if last > first else [0.5 * (low + high)]


def _put(
    text: Text, spots: Sequence[tuple[float, ...]], size: tuple[float, float], ink: NDArray[np.float64],
    taken: list[Bbox], frame: Bbox,
) -> None:  # fmt: skip
    """Move the text to the spot that costs least: outside the axes or on other text is worst, on curves is bad."""
    half = 0.5 * np.array(size) + 3.0

    def cost(spot: tuple[float, ...]) -> float:
        low, high = np.array(spot) - half, np.array(spot) + half
        outside = low[0] < frame.x0 or low[1] < frame.y0 or high[0] > frame.x1 or high[1] > frame.y1
        hits = sum(Bbox((low, high)).overlaps(other) for other in taken)
        hidden = int(((ink > low) & (ink < high)).all(axis=1).sum())
        return 1e6 * float(outside) + 1e5 * hits + hidden

    best = np.array(min(spots, key=cost))  # the first of equals
    text.set_position((float(best[0]), float(best[1])))
    taken.append(Bbox((best - half, best + half)))


def _leader(axes: Axes, text: Text, dot: NDArray[np.float64], size: tuple[float, float]) -> None:
    """A thin line from a mark to its label, where they are not side by side."""
    half = 0.5 * np.array(size)
    centre = np.array(text.get_position())
    nearest = np.clip(dot, centre - half, centre + half)
    away = nearest - dot
    length = float(np.hypot(*away))
    start = dot + away * min(1.0, 5.0 * DPI / 72.0 / max(length, 1e-9))
    if length > 9.0 * DPI / 72.0:
        axes.plot(*np.array((start, nearest)).T, transform=None, color=INK, lw=0.7, zorder=7)


def _save(figure: Figure, path: Path) -> None:
    undated: dict[str, dict[str, str | None]] = {
        "svg": {"Date": None},
        "pdf": {"CreationDate": None},
        "png": {"Software": None},
    }
    kind = path.suffix[1:]
    # Without a salt of our own the identifiers in an SVG are random.
    with replacing(path) as temporary, matplotlib.rc_context({"svg.hashsalt": "taichi-membrane"}):
        figure.savefig(temporary, format=kind, dpi=DPI, metadata=undated[kind])
