"""The picture of a study: error against time, against mesh size and, where it was varied, against the solver's tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogFormatterSciNotation, LogLocator, NullFormatter, NullLocator

from taichi_membrane.output.atomic import replacing
from taichi_membrane.pictures.plots import COLOURS, DPI, FONT, GREY, INK
from taichi_membrane.study.analyse import Convergence, Row, Study
from taichi_membrane.study.tables import title

_COLOUR = {"hybrid": COLOURS[0], "newton": COLOURS[1], "relaxation": COLOURS[2]}
_MARKER = {"f64": "o", "f32": "s"}
Dashes = str | tuple[float, tuple[float, ...]]
_DASHES: tuple[Dashes, ...] = (
    "-",
    (0, (5, 2)),
    (0, (1, 1.5)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (5, 1.5, 1, 1.5, 1, 1.5)),
)  # tightest first
_FRONT = "#c9ccd3"
_PANEL = (3.9, 3.3)  # inches
_MARGIN = 0.15  # decades around the data


def draw_study(study: Study, path: Path) -> None:
    """Draw a row of panels per probe and sequence; the format follows the suffix. Atomic.

    Colour tells the solver, marker the precision, dashes the tolerance; lines join meshes. A run without an error is not drawn.

    :raises InputError: the file cannot be written.
    """
    tolerances = sorted({tolerance for run in study.runs if (tolerance := run.case.scene.solver.tolerance) is not None})
    columns = 3 if len(tolerances) > 1 else 2
    count = len(study.convergences)
    figure = Figure(
        figsize=(_PANEL[0] * columns, _PANEL[1] * count + 0.7),
        dpi=DPI,
        layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1),
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(count, columns, squeeze=False)
    for item, row_panels in zip(study.convergences, panels, strict=True):
        rows = [row for row in study.rows if (row.probe, row.run.case.sequence) == (item.probe, item.sequence)]
        _draw_cost(row_panels[0], item, rows, study, tolerances)
        _draw_meshes(row_panels[1], item)
        if columns == 3:
            _draw_iteration(row_panels[2], rows)
    figure.legend(
        handles=_legend(study, tolerances),
        loc="outside lower center",
        ncols=2 * columns,
        frameon=False,
        fontsize=FONT["small"],
    )
    with replacing(path) as temporary:
        figure.savefig(
            temporary, format=path.suffix[1:], metadata={"Software": None} if path.suffix == ".png" else None
        )


def _draw_cost(axes: Axes, item: Convergence, rows: Sequence[Row], study: Study, tolerances: Sequence[float]) -> None:
    heading = title(item, study.plan.unit(item.probe))
    _prepare(axes, heading, "set-up + solve time [s]", "relative error")
    shown = [row for row in rows if row.error]
    front = sorted((row.run.cost, row.error) for row in shown if row.pareto and row.error is not None)
    if front:
        axes.plot(*zip(*front, strict=True), "-", color=_FRONT, lw=6.0, solid_capstyle="round", zorder=1)
    for group in _grouped(shown, lambda row: row.run.case.method):
        group.sort(key=lambda row: row.run.case.tri_count)
        tolerance = group[0].run.case.scene.solver.tolerance
        dashes = _DASHES[tolerances.index(tolerance) % len(_DASHES)] if tolerance is not None else "-"
        _draw_line(axes, [(row.run.cost, row.error or math.nan) for row in group], *_look(group[0]), dashes=dashes)
    _log_axis(axes, "x", [row.run.cost for row in shown], plain=True)
    _log_axis(axes, "y", [row.error for row in shown])


def _draw_meshes(axes: Axes, item: Convergence) -> None:
    order = "mesh" if item.observed_order is None else f"mesh, observed order {item.observed_order:.2f}"
    _prepare(axes, order, "mesh size, 1/√triangles", "relative discretisation error")
    points = [(point.run.case.size, point.error) for point in item.meshes if point.error]
    axes.plot([size for size, _ in points], [error for _, error in points], "-D", color=INK, lw=1.6, ms=5.0, zorder=4)
    if len(points) > 1:
        # Slopes to compare with, through the coarsest mesh's point.
        (size, error), (smallest, _) = points[0], points[-1]
        for slope, dashes in ((1, (0, (1, 2))), (2, (0, (6, 3)))):
            ends = [size, smallest], [error, error * (smallest / size) ** slope]
            axes.plot(*ends, color=GREY, lw=1.1, ls=dashes, zorder=2)
    _log_axis(axes, "x", [size for size, _ in points], plain=True)
    _log_axis(axes, "y", [error for _, error in points])


def _draw_iteration(axes: Axes, rows: Sequence[Row]) -> None:
    """Lines join tolerances here; each is one mesh."""
    _prepare(axes, "iteration", "tolerance of the solver", "relative iteration error")
    shown = [row for row in rows if row.iteration_error]
    for group in _grouped(shown, lambda row: (row.run.case.mesh, *_look(row))):
        points = sorted((_tolerance(row), row.iteration_error or math.nan) for row in group)
        _draw_line(axes, points, *_look(group[0]), dashes="-")
    _log_axis(axes, "x", map(_tolerance, shown))
    _log_axis(axes, "y", [row.iteration_error for row in shown])


def _grouped(rows: Iterable[Row], key: Callable[[Row], object]) -> list[list[Row]]:
    groups: dict[object, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return list(groups.values())


def _draw_line(axes: Axes, points: Sequence[tuple[float, float]], solver: str, precision: str, dashes: Dashes) -> None:
    axes.plot(
        [x for x, _ in points],
        [y for _, y in points],
        ls=dashes,
        lw=1.4,
        color=_COLOUR[solver],
        marker=_MARKER[precision],
        mfc="white" if precision == "f32" else _COLOUR[solver],
        # Solvers that end at the same point stay visible, the smaller on the larger.
        ms={"hybrid": 7.5, "relaxation": 6.0, "newton": 4.5}[solver],
        zorder={"hybrid": 4, "relaxation": 5, "newton": 6}[solver],
    )


def _look(row: Row) -> tuple[str, str]:
    return row.run.case.scene.solver.kind, row.run.case.settings["precision"]


def _tolerance(row: Row) -> float:
    return row.run.case.scene.solver.tolerance or math.nan


def _legend(study: Study, tolerances: Sequence[float]) -> list[Line2D]:
    cases = [run.case for run in study.runs]
    solvers = [solver for solver in _COLOUR if any(case.scene.solver.kind == solver for case in cases)]
    precisions = [name for name in _MARKER if any(case.settings["precision"] == name for case in cases)]
    handles = [Line2D([], [], color=_COLOUR[solver], lw=2.5, label=solver) for solver in solvers]
    handles += [
        Line2D([], [], color=INK, ls="", marker=_MARKER[name], mfc="white" if name == "f32" else INK, label=name)
        for name in precisions
    ]
    if len(tolerances) > 1:
        handles += [
            Line2D([], [], color=INK, lw=1.4, ls=_DASHES[number % len(_DASHES)], label=f"tolerance {value:.0e}")
            for number, value in enumerate(tolerances)
        ]
    handles.append(Line2D([], [], color=_FRONT, lw=6.0, label="Pareto front"))
    handles.append(Line2D([], [], color=INK, marker="D", lw=1.6, label="most exact run on each mesh"))
    handles.append(Line2D([], [], color=GREY, lw=1.1, ls=(0, (1, 2)), label="order 1"))
    handles.append(Line2D([], [], color=GREY, lw=1.1, ls=(0, (6, 3)), label="order 2"))
    return handles


def _prepare(axes: Axes, heading: str, x_label: str, y_label: str) -> None:
    axes.set_title(heading, fontsize=FONT["label"], fontweight="bold", loc="left", color=INK)
    axes.set_xlabel(x_label, fontsize=FONT["label"], color=INK)
    axes.set_ylabel(y_label, fontsize=FONT["label"], color=INK)
    axes.tick_params(
        which="both", labelsize=FONT["tick"], direction="in", color=INK, labelcolor=INK, top=True, right=True
    )
    axes.grid(color="#dfe2e7", lw=0.6)
    axes.set_axisbelow(True)


def _log_axis(axes: Axes, name: Literal["x", "y"], values: Iterable[float | None], *, plain: bool = False) -> None:
    """A logarithmic axis with labels at whole decades, or at 1, 2, 5 where the data span less than that needs.

    :param plain: write 0.02 rather than 2 × 10⁻².
    """
    logs = [math.log10(value) for value in values if value]
    if not logs:
        (axes.set_xticks if name == "x" else axes.set_yticks)([])
        axes.text(
            0.5, 0.5, "no error to show", transform=axes.transAxes, ha="center", color=GREY, fontsize=FONT["small"]
        )
        return
    room = max(_MARGIN, 0.5 * (0.8 - (max(logs) - min(logs))))
    low, high = min(logs) - room, max(logs) + room
    axis = axes.xaxis if name == "x" else axes.yaxis
    (axes.set_xscale if name == "x" else axes.set_yscale)("log")
    (axes.set_xlim if name == "x" else axes.set_ylim)(10**low, 10**high)
    subs = (1.0, 2.0, 5.0) if high - low < 1.7 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=9))
    powers = LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(math.inf, math.inf))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}") if plain else powers)
    axis.set_minor_locator(NullLocator() if len(subs) > 1 else LogLocator(subs=(2.0, 5.0), numticks=9))
    axis.set_minor_formatter(NullFormatter())
