"""Pictures of a sweep: scatter matrix, band of curves, tornado. Runs that stand apart are drawn apart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.curve import quantity_label
from taichi_membrane.parametric.rows import Row, SweepTable, numeric_inputs
from taichi_membrane.parametric.statistics import CONFIDENCE, Importance, importance
from taichi_membrane.parametric.summary import counts, named
from taichi_membrane.pictures.plots import COLOURS, DPI, FONT, GREY, INK, rule

_MOST_INPUTS, _MOST_QUANTITIES = 6, 6  # panels a side that can still be read on a page
_PANEL = 2.1  # inches
_APART = COLOURS[1]
_BAND = (0.05, 0.95)
_FEWEST_FOR_BAND = 20  # curves; with fewer, 5 % of them is none


def draw_sweep(table: SweepTable, directory: Path) -> list[Path]:
    """Draw what there is to draw; returns the files.

    :raises InputError: one cannot be written.
    """
    drawn = []
    inputs = [key for key in numeric_inputs(table) if len({row.trial.settings[key] for row in table.rows}) > 1]
    shown = [q for q in table.quantities if sum(value is not None for value in table.values(q)) > 1]
    if inputs and shown:
        drawn.append(_draw_scatter(table, inputs[:_MOST_INPUTS], shown[:_MOST_QUANTITIES], directory / "scatter.png"))
    if sum(row.curve is not None for row in table.rows) > 1:
        drawn.append(_draw_curves(table, directory / "curves.png"))
    if matters := [one for one in importance(table) if one.quantity in shown[:_MOST_QUANTITIES]]:
        drawn.append(_draw_tornado(table, matters, directory / "tornado.png"))
    return drawn


def _figure(width: float, height: float, table: SweepTable, title: str) -> Figure:
    figure = Figure(figsize=(width, height), dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08))
    FigureCanvasAgg(figure)
    figure.suptitle(
        f"{table.plan.scene.title or table.plan.scene.name}: {title}",
        fontsize=FONT["title"],
        fontweight="bold",
        color=INK,
        x=0.01,
        ha="left",
    )
    return figure


def _saved(figure: Figure, path: Path) -> Path:
    with replacing(path) as temporary, matplotlib.rc_context({"svg.hashsalt": "taichi-membrane"}):
        figure.savefig(temporary, format=path.suffix[1:], dpi=DPI, metadata={"Software": None})
    return path


def _prepared(axes: Axes, ticks: int = 4) -> None:
    rule(axes, size=FONT["tick"] - 1.0, length=3.0)
    axes.xaxis.set_major_locator(MaxNLocator(ticks, prune="both"))
    axes.yaxis.set_major_locator(MaxNLocator(ticks + 1))


def _draw_scatter(table: SweepTable, inputs: Sequence[str], shown: Sequence[str], path: Path) -> Path:
    """A panel for each setting and quantity; what stands apart is a cross on the lower edge, as it has no value to be placed at."""
    figure = _figure(max(_PANEL * len(inputs) + 1.1, 7.0), _PANEL * len(shown) + 1.2, table, "scatter")
    panels = figure.subplots(len(shown), len(inputs), squeeze=False, sharex="col", sharey="row")
    settings = {key: np.array([float(row.trial.settings[key]) for row in table.rows]) for key in inputs}
    any_apart = False
    for line, quantity in zip(panels, shown, strict=True):
        values = np.array(table.values(quantity), float)
        apart = ~np.isfinite(values)
        any_apart |= bool(apart.any())
        for axes, key in zip(line, inputs, strict=True):
            _prepared(axes, 3)
            axes.plot(
                settings[key][~apart],
                values[~apart],
                "o",
                ms=3.4,
                mfc=COLOURS[0],
                mec="white",
                mew=0.35,
                alpha=0.85,
                zorder=3,
            )
            edge = axes.get_xaxis_transform()
            axes.plot(
                settings[key][apart],
                np.full(apart.sum(), 0.03),
                "x",
                ms=4.5,
                mew=1.1,
                color=_APART,
                transform=edge,
                zorder=4,
            )
            axes.margins(x=0.07, y=0.12)
        line[0].set_ylabel(named(table, quantity), fontsize=FONT["small"], color=INK)
    for axes, key in zip(panels[-1], inputs, strict=True):
        axes.set_xlabel(key, fontsize=FONT["small"], color=INK)
    words = counts(table) + (" Crosses at the lower edge: no value that counts." if any_apart else "")
    figure.supxlabel(words, fontsize=FONT["small"], color=GREY, x=0.01, ha="left")
    figure.align_ylabels()
    return _saved(figure, path)


def _draw_curves(table: SweepTable, path: Path) -> Path:
    """All curves; where there are enough, the band between quantiles of y at equal x, as far as all of its curves reach."""
    scene = table.plan.scene
    curve = scene.curve
    assert curve is not None
    figure = _figure(7.0, 4.9, table, "all runs")
    axes = figure.subplots()
    _prepared(axes, 7)
    kept = [row for row in table.rows if row.curve is not None]
    fine, apart = [row for row in kept if not row.apart], [row for row in kept if row.apart]
    for row in fine:
        axes.plot(*_curve(row), "-", color=COLOURS[0], lw=0.7, alpha=max(0.12, min(0.8, 12.0 / len(fine))), zorder=3)
    for row in apart:
        axes.plot(*_curve(row), "--", color=_APART, lw=0.9, alpha=0.7, zorder=4)
    if len(fine) >= _FEWEST_FOR_BAND and (band := _band([_curve(row) for row in fine])) is not None:
        x, low, middle, high = band
        axes.fill_between(
            x,
            low,
            high,
            color=COLOURS[0],
            alpha=0.22,
            lw=0.0,
            zorder=2,
            label=f"{_BAND[0]:.0%} to {_BAND[1]:.0%} at equal x",
        )
        axes.plot(x, middle, "-", color=INK, lw=1.6, zorder=5, label="median at equal x")
    axes.plot([], [], "-", color=COLOURS[0], lw=0.9, label=f"{len(fine)} runs that count")
    if apart:
        axes.plot(
            [],
            [],
            "--",
            color=_APART,
            lw=0.9,
            label=f"{len(apart)} runs apart: {', '.join(dict.fromkeys(r.apart for r in apart))}",
        )
    axes.set_xlabel(curve.x_label or quantity_label(scene, curve.x), fontsize=FONT["label"], color=INK)
    axes.set_ylabel(curve.y_label or quantity_label(scene, curve.y), fontsize=FONT["label"], color=INK)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=FONT["small"])
    return _saved(figure, path)


def _curve(row: Row) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = np.array(row.curve, float)
    return x, y


def _band(curves: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> tuple[NDArray[np.float64], ...] | None:
    """x, lower end, median and upper end of the band; None where some curve turns back, so that it has no one y at an x."""
    if not all(len(x) > 1 and (np.diff(x) > 0.0).all() for x, _ in curves):
        return None
    low, high = max(x[0] for x, _ in curves), min(x[-1] for x, _ in curves)
    if not low < high:
        return None
    at = np.linspace(low, high, 200)
    spread = np.quantile([np.interp(at, x, y) for x, y in curves], (_BAND[0], 0.5, _BAND[1]), axis=0)
    return at, *spread


def _draw_tornado(table: SweepTable, found: Sequence[Importance], path: Path) -> Path:
    """A panel for each quantity, the setting that matters most on top; whiskers are confidence intervals."""
    by_quantity = {q: [one for one in found if one.quantity == q] for q in dict.fromkeys(one.quantity for one in found)}
    kinds = list(dict.fromkeys(one.kind for one in found))
    rows = max(len({one.key for one in of}) for of in by_quantity.values())
    columns = min(2, len(by_quantity))
    lines = -(-len(by_quantity) // columns)
    figure = _figure(
        max(4.3 * columns + 0.4, 6.5),
        (0.34 * rows * len(kinds) + 1.0) * lines + 0.9,
        table,
        f"what matters (whiskers: {CONFIDENCE:.0%} confidence)",
    )
    panels = figure.subplots(lines, columns, squeeze=False)
    for axes in panels.flat[len(by_quantity) :]:
        axes.set_axis_off()
    for axes, (quantity, of) in zip(panels.flat, by_quantity.items(), strict=False):
        _draw_bars(axes, of, kinds)
        axes.set_title(
            f"{named(table, quantity)}, {of[0].counted} of {of[0].asked}", fontsize=FONT["small"], color=INK, loc="left"
        )
    handles, names = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False, fontsize=FONT["small"])
    return _saved(figure, path)


def _draw_bars(axes: Axes, of: Sequence[Importance], kinds: Sequence[str]) -> None:
    _prepared(axes, 5)
    keys = sorted(
        dict.fromkeys(one.key for one in of), key=lambda k: abs(next(o.value for o in of[::-1] if o.key == k))
    )
    height = 0.78 / len(kinds)
    for number, kind in enumerate(kinds):
        bars = {one.key: one for one in of if one.kind == kind}
        at = np.arange(len(keys)) + (0.5 * (len(kinds) - 1) - number) * height
        values = np.array([bars[key].value for key in keys])
        ends = np.array([(bars[key].low, bars[key].high) for key in keys]).T
        reach = np.abs(np.stack((values - np.minimum(ends[0], values), np.maximum(ends[1], values) - values)))
        axes.barh(at, values, 0.9 * height, color=COLOURS[(0, 4)[number % 2]], label=kind, zorder=3)
        axes.errorbar(values, at, xerr=reach, fmt="none", ecolor=INK, elinewidth=1.0, capsize=2.5, zorder=4)
    axes.axvline(0.0, color=INK, lw=0.8, zorder=5)
    axes.set_yticks(np.arange(len(keys)), keys)
    axes.grid(visible=False, axis="y")
    low, high = (
        (-1.0, 1.0) if kinds[0] == "rank correlation" else (min(axes.get_xlim()[0], 0.0), max(axes.get_xlim()[1], 1.0))
    )
    axes.set_xlim(low - 0.05, high + 0.05)
    axes.set_xticks(np.arange(np.ceil(2.0 * low), 2.0 * high + 0.1) / 2.0)
