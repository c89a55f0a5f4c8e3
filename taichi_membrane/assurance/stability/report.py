"""The stability report: borders and entries in Markdown, all numbers as CSV, and one picture of the verdicts."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from taichi_membrane.assurance.stability.case import (
    CONVERGED,
    HONEST,
    STABLE_EIGENVALUE,
    WRONG,
    Border,
    Judged,
    Solver,
    Sweep,
    border,
)
from taichi_membrane.names import Precision
from taichi_membrane.output.atomic import replacing
from taichi_membrane.pictures.plots import FONT, GREY, INK

SWEEPS: tuple[tuple[Solver, Precision], ...] = (
    ("hybrid", "f64"),
    ("newton", "f64"),
    ("relaxation", "f64"),
    ("relaxation", "f32"),
)
DEFAULT = SWEEPS[0]
_COLOUR = {
    CONVERGED: "#c4e6d8",
    HONEST: "#e8a33d",
    WRONG: "#8c1d2f",
}  # ever darker: they differ in print without colours, too
_TEXT = {CONVERGED: INK, HONEST: INK, WRONG: "white"}
_NOT_RUN = "#f3f4f6"
_DPI = 130
_LONGEST_REASON = 160  # characters in a table; the CSV has all


@dataclass(frozen=True)
class SweepReport:
    """A case with its judged entries.

    :param levels: those of the set that was run.
    """

    case: Sweep
    levels: tuple[float, ...]
    judged: tuple[Judged, ...]

    def sweep(self, solver: str, precision: str) -> list[Judged]:
        """The entries of one solver and precision."""
        return [one for one in self.judged if (one.entry.solver, one.entry.precision) == (solver, precision)]

    def border(self, solver: str, precision: str) -> Border:
        """How far that sweep went well."""
        return border(self.levels, self.sweep(solver, precision))

    @property
    def wrong(self) -> list[Judged]:
        """Wrong entries that are not documented to be."""
        return [one for one in self.judged if one.verdict == WRONG and not one.known]

    @property
    def short(self) -> bool:
        """Whether the default solver gives way before the level it has to reach."""
        safe = self.border(*DEFAULT).safe
        return safe is None or self.levels.index(safe) < self.levels.index(self.case.required)


def write(reports: Sequence[SweepReport], directory: Path) -> list[Path]:
    """Write ``stability.md``, ``.csv`` and ``.png`` into the directory; returns their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = [directory / f"stability.{suffix}" for suffix in ("md", "csv", "png")]
    for path, text in zip(paths, (markdown(reports), comma_separated(reports)), strict=False):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    with replacing(paths[2]) as temporary:
        draw(reports, temporary)
    return paths


def border_text(found: Border) -> str:
    """A border in a few words."""
    if found.breaks is None:
        return f"{found.safe:g}, the end of the sweep"
    return f"{'nowhere' if found.safe is None else format(found.safe, 'g')}; gives way at {found.breaks:g}"


def markdown(reports: Sequence[SweepReport]) -> str:
    """The table of borders, then every case with its entries."""
    count = {word: sum(one.verdict == word for r in reports for one in r.judged) for word in (CONVERGED, HONEST, WRONG)}
    known = sum(one.known for r in reports for one in r.judged)
    eigenvalues = [one.entry.eigenvalue for r in reports for one in r.judged if one.entry.eigenvalue is not None]
    parts = [
        "# Stability",
        "",
        f"{sum(count.values())} entries: {count[CONVERGED]} converged and right, {count[HONEST]} honest failures, "
        f"{count[WRONG]} wrong ({known} of them documented).",
        "",
    ]
    if eigenvalues:
        parts += [
            f"Central differences are stable while no eigenvalue of M⁻¹K exceeds {STABLE_EIGENVALUE:g}. The largest in "
            f"any state of these runs (assembled tangent, fictitious masses) is {max(eigenvalues):.3f}.",
            "",
        ]
    heads = ["case", "parameter", *(f"{solver} {precision}: safe up to" for solver, precision in SWEEPS)]
    parts += _table(
        heads,
        [[r.case.name, r.case.parameter, *(border_text(r.border(*one)) for one in SWEEPS)] for r in reports],
    )
    for report in reports:
        parts += ["", *_section(report)]
    return "\n".join(parts) + "\n"


def _section(report: SweepReport) -> list[str]:
    """One case: what it is, and its entries."""
    case = report.case
    parts = [f"## {case.name}: {case.title}", "", case.setting]
    parts.append(f"Swept: {case.parameter}. Compared with: {case.source}; allowed: {case.bound:g}.")
    parts += [case.remark] if case.remark else []
    heads = [
        "solver",
        "level",
        "verdict",
        "iterations",
        "time",
        "residual",
        "error",
        "drift",
        "worst strain",
        "λ(M⁻¹K)",
        "remark",
    ]
    rows = []
    for solver, precision in SWEEPS:
        for one in report.sweep(solver, precision):
            entry = one.entry
            verdict = f"**{one.verdict}**" if one.verdict == WRONG else one.verdict
            rows.append(
                [
                    f"{solver} {precision}",
                    f"{entry.level:g}",
                    verdict + (" (documented)" if one.known else ""),
                    str(entry.iterations),
                    f"{entry.seconds:.2f} s",
                    _number(entry.residual),
                    _number(one.error),
                    _number(entry.values.get("drift")),
                    _number(entry.strain),
                    "-" if entry.eigenvalue is None else f"{entry.eigenvalue:.3f}",
                    _shortened(one.why),
                ]
            )
    return [*parts, "", *_table(heads, rows)]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [list(heads), ["---"] * len(heads), *(list(row) for row in rows)]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_REASON else text[: _LONGEST_REASON - 1] + "…"


def comma_separated(reports: Sequence[SweepReport]) -> str:
    """Every entry, one row each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            "theme", "case", "parameter", "level", "solver", "precision", "verdict", "documented", "iterations", "seconds",
            "residual", "tolerance", "error", "allowed", "drift", "worst_strain", "energy", "eigenvalue", "moved_by_newton",
            "values", "why",
        ]
    )  # fmt: skip
    for report in reports:
        for one in report.judged:
            e = one.entry
            values = "; ".join(f"{name} = {value:.10g}" for name, value in e.values.items())
            writer.writerow(
                [
                    report.case.theme, e.case, report.case.parameter, f"{e.level:g}", e.solver, e.precision, one.verdict, one.known,
                    e.iterations, f"{e.seconds:.3f}", _cell(e.residual), _cell(e.tolerance), _cell(one.error), report.case.bound,
                    _cell(e.values.get("drift")), _cell(e.strain), _cell(e.energy), _cell(e.eigenvalue), _cell(e.moved), values,
                    one.why,
                ]
            )  # fmt: skip
    return text.getvalue()


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def draw(reports: Sequence[SweepReport], path: Path) -> None:
    """One picture: a row per case, a panel per solver, a cell per level in the colour of its verdict."""
    widest = max(len(report.levels) for report in reports)
    figure = Figure(
        figsize=(2.4 + 0.42 * widest * len(SWEEPS), 1.3 + 0.27 * len(reports)),
        dpi=_DPI,
        layout="constrained",
        facecolor="white",
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(SWEEPS), sharey=True, squeeze=False)[0]
    for axes, (solver, precision) in zip(panels, SWEEPS, strict=True):
        _draw_panel(axes, reports, solver, precision, widest)
    panels[0].set_yticks(range(len(reports)), [_row_name(r.case) for r in reports])
    panels[0].set_ylim(len(reports) - 0.4, -0.6)
    handles: list[Artist] = [Patch(color=colour, label=word) for word, colour in _COLOUR.items()]
    handles += [
        Patch(color=_NOT_RUN, label="not run"),
        Line2D([], [], color=INK, lw=2.0, label="border of the safe region"),
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=FONT["small"],
        title="Each row from benign to extreme; numbers: values of the swept quantity", title_fontsize=FONT["small"],
    )  # fmt: skip
    figure.savefig(path, format="png")


def _draw_panel(axes: Axes, reports: Sequence[SweepReport], solver: str, precision: str, widest: int) -> None:
    axes.set_title(f"{solver}, {precision}", fontsize=FONT["label"], fontweight="bold", color=INK)
    axes.set_xlim(-0.05, widest + 0.05)
    axes.set_xticks([])
    axes.tick_params(length=0, labelsize=FONT["small"], labelcolor=INK)
    for side in axes.spines.values():
        side.set_visible(False)
    for row, report in enumerate(reports):
        verdicts = {one.entry.level: one.verdict for one in report.sweep(solver, precision)}
        for column, level in enumerate(report.levels):
            verdict = verdicts.get(level)
            colour = _NOT_RUN if verdict is None else _COLOUR[verdict]
            axes.add_patch(Rectangle((column + 0.03, row - 0.43), 0.94, 0.86, color=colour, lw=0))
            axes.text(
                column + 0.5, row, _short(level), ha="center", va="center", fontsize=6.0,
                color=GREY if verdict is None else _TEXT[verdict], fontweight="bold" if verdict == WRONG else "normal",
            )  # fmt: skip
        breaks = report.border(solver, precision).breaks
        if breaks is not None:
            edge = report.levels.index(breaks)
            axes.plot([edge, edge], [row - 0.5, row + 0.5], color=INK, lw=2.0, solid_capstyle="butt")


def _row_name(case: Sweep) -> str:
    """What a row of the picture is a sweep of."""
    return case.title if case.title == case.parameter else f"{case.title}: {case.parameter}"


def _short(level: float) -> str:
    """A level in few characters: 1e5 rather than 100000, 1e-4 rather than 0.0001."""
    text = f"{level:.4g}"
    exponent = f"{level:.0e}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
    return exponent if level >= 1e4 or 0.0 < level < 1e-3 or "e" in text else text
