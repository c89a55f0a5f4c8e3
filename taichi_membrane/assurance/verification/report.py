"""The verification report: a table in Markdown, all numbers as CSV, and a page of plots."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from taichi_membrane.assurance.verification.benchmark import BenchmarkResult, QuantityResult
from taichi_membrane.output.atomic import replacing
from taichi_membrane.pictures.plots import COLOURS, FONT, GREY, INK, MARKERS

COLUMNS = 3
PANEL = (4.6, 3.7)  # inches
DPI = 150
LEAST_ERROR = 1e-8  # a smaller one is drawn here: the axis is logarithmic


def write(results: Sequence[BenchmarkResult], directory: Path) -> list[Path]:
    """Write ``verification.md``, ``.csv`` and ``.png`` into the directory; returns their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = [directory / f"verification.{suffix}" for suffix in ("md", "csv", "png")]
    for path, text in zip(paths, (markdown(results), comma_separated(results)), strict=False):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    with replacing(paths[2]) as temporary:
        draw(results, temporary)
    return paths


def line(result: BenchmarkResult, one: QuantityResult) -> list[str]:
    """One row of the table: the finest mesh's value against its reference."""
    expected = one.quantity.order
    slope = "-" if one.slope is None else f"{one.slope:.2f}"
    return [
        result.case.name,
        one.quantity.name,
        f"{one.values[-1]:.6g}",
        f"{one.quantity.reference:.6g}",
        f"{100 * one.errors[-1]:+.3f} %",
        f"{100 * one.quantity.bound:g} %",
        "none" if expected is None else f"{slope} ({expected:g})",
        one.quantity.source,
        f"{sum(result.seconds):.0f} s",
        "yes" if one.passed else "**no**",
    ]


def markdown(results: Sequence[BenchmarkResult]) -> str:
    """The table with the settings of the cases, and where each theory ends."""
    heads = [
        "case",
        "quantity",
        "ours",
        "reference",
        "error",
        "allowed",
        "order (expected)",
        "source",
        "time",
        "passed",
    ]
    rows = [heads, ["---"] * len(heads)]
    rows += [
        [cell.replace("|", "\\|") for cell in line(result, one)] for result in results for one in result.quantities
    ]
    parts = ["# Verification\n", *("| " + " | ".join(row) + " |" for row in rows), ""]
    parts.append(
        "Ours: finest mesh. Error: relative to the reference. Order: slope of error against mesh size over all meshes. "
        "Time: all meshes of the case, compilation included.\n"
    )
    for result in results:
        case = result.case
        meshes = ", ".join(map(str, result.sizes))
        parts.append(f"**{case.name}** — {case.title}. {case.setting} Meshes: {meshes} {case.size_label}.")
        parts += [f"*{one.quantity.name}*: {one.quantity.remark}" for one in result.quantities if one.quantity.remark]
        if result.failure:
            parts.append(f"FAILED: {result.failure}")
        parts.append("")
    return "\n".join(parts)


def comma_separated(results: Sequence[BenchmarkResult]) -> str:
    """Every mesh of every quantity, one row each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["case", "quantity", "size", "ours", "reference", "relative_error", "source", "seconds", "passed"])
    for result in results:
        for one in result.quantities:
            for size, value, error, seconds in zip(one.sizes, one.values, one.errors, result.seconds, strict=True):
                writer.writerow(
                    [
                        result.case.name,
                        one.quantity.name,
                        size,
                        f"{value:.10g}",
                        f"{one.quantity.reference:.10g}",
                        f"{error:.4e}",
                        one.quantity.source,
                        f"{seconds:.2f}",
                        one.passed,
                    ]
                )
    return text.getvalue()


def draw(results: Sequence[BenchmarkResult], path: Path) -> None:
    """A page of plots: for each case the error against mesh size and, where it has one, its curve over the exact one."""
    panels = [(result, kind) for result in results for kind in ("error", "curve") if _has(result, kind)]
    rows = max(1, math.ceil(len(panels) / COLUMNS))
    figure = Figure(figsize=(COLUMNS * PANEL[0], rows * PANEL[1]), dpi=DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    for number, (result, kind) in enumerate(panels):
        axes = figure.add_subplot(rows, COLUMNS, number + 1)
        axes.set_title(result.case.title, fontsize=FONT["label"], fontweight="bold", loc="left", color=INK)
        axes.tick_params(labelsize=FONT["small"], direction="in", color=INK, labelcolor=INK, top=True, right=True)
        axes.grid(color="#dfe2e7", lw=0.6)
        axes.set_axisbelow(True)
        (_draw_errors if kind == "error" else _draw_points)(axes, result)
        axes.legend(
            fontsize=0.85 * FONT["small"],
            frameon=False,
            loc="lower left" if kind == "error" else "best",
            handlelength=2.5,
        )
    figure.savefig(path, format="png")


def _has(result: BenchmarkResult, kind: str) -> bool:
    return bool(result.quantities) and (
        kind == "error" or (result.case.curve is not None and result.points is not None)
    )


def _draw_errors(axes: Axes, result: BenchmarkResult) -> None:
    """Errors on double logarithmic axes, each with its slope, and a line of slope 2 to compare with."""
    sizes = np.array(result.sizes, dtype=float)
    highest, lowest = 0.0, 1.0
    for number, one in enumerate(result.quantities):
        error = np.maximum(np.abs(one.errors), LEAST_ERROR)
        highest, lowest = max(highest, float(error[0])), min(lowest, float(error.min()))
        slope = "" if one.slope is None or one.quantity.order is None else f", slope {one.slope:.2f}"
        axes.loglog(
            sizes,
            error,
            marker=MARKERS[number % len(MARKERS)],
            color=COLOURS[number % len(COLOURS)],
            mfc="white" if number >= len(COLOURS) else None,  # a second round of the colours
            ms=5.0,
            lw=1.3,
            label=one.quantity.name + slope,
        )
    axes.loglog(sizes, 1.5 * highest * (sizes / sizes[0]) ** -2, "--", color=GREY, lw=1.0, label="slope 2")
    # Errors fall from the upper left: the lower left corner, with some room made, is the legend's.
    axes.set_ylim(bottom=lowest * 0.65 ** len(result.quantities))
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.minorticks_off()
    axes.set_xlabel(result.case.size_label, fontsize=FONT["small"], color=INK)
    axes.set_ylabel("relative error", fontsize=FONT["small"], color=INK)


def _draw_points(axes: Axes, result: BenchmarkResult) -> None:
    """The finest mesh's points over the exact curve."""
    curve, points = result.case.curve, result.points
    assert curve is not None
    assert points is not None
    axes.plot(curve.x, curve.y, "-", color=GREY, lw=1.6, label=curve.exact)
    axes.plot(
        *points,
        "o",
        color=COLOURS[0],
        ms=4.0,
        mfc="white",
        mew=1.2,
        label=f"{result.sizes[-1]} {result.case.size_label}",
    )
    axes.set_xlabel(curve.x_label, fontsize=FONT["small"], color=INK)
    axes.set_ylabel(curve.y_label, fontsize=FONT["small"], color=INK)
