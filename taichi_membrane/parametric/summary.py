"""What a sweep found, for people: ``sweep.md``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from taichi_membrane.output.atomic import replacing
from taichi_membrane.parametric.rows import SweepTable
from taichi_membrane.parametric.statistics import CONFIDENCE, Importance, Quantile, apart_counts, importance, quantiles

_LISTED = 50  # rows that stand apart, in full; all of them are in sweep.csv


def write_summary(table: SweepTable, directory: Path) -> Path:
    """Write ``sweep.md``.

    :raises InputError: it cannot be written.
    """
    path = directory / "sweep.md"
    with replacing(path) as temporary:
        temporary.write_text(summary(table), encoding="utf-8", newline="\n")
    return path


def summary(table: SweepTable) -> str:
    """Counts, runs that stand apart, quantiles and importance, as Markdown."""
    parts = [f"# Sweep of {table.plan.scene.name}", counts(table)]
    if table.apart:
        rows = [f"- run {row.trial.number} (`{row.trial.label}`): {row.apart}" for row in table.apart[:_LISTED]]
        rows = [line + (f": {row.reason}" if row.reason else "") for line, row in zip(rows, table.apart, strict=False)]
        more = len(table.apart) - len(rows)
        rows += [f"- and {more} more, in sweep.csv"] if more else []
        parts += ["## Runs that stand apart", "No number below counts them.", "\n".join(rows)]
    if found := quantiles(table):
        ends = f"In brackets the {CONFIDENCE:.0%} confidence interval from order statistics; … where too few runs bound that side."
        parts += ["## Quantiles", ends, _quantile_table(table, found)]
    if matters := importance(table):
        parts += ["## What matters", _importance_words(matters), _importance_table(table, matters)]
    return "\n\n".join(parts) + "\n"


def counts(table: SweepTable) -> str:
    """How many runs were asked for, are there, count, and stand apart for which reason."""
    asked, there, apart = len(table.plan.trials), len(table.rows), len(table.apart)
    words = f"{asked} runs asked, {there} there, {there - apart} count"
    reasons = ", ".join(f"{count} {reason}" for reason, count in apart_counts(table.rows).items())
    return f"{words}; {apart} stand apart: {reasons}." if apart else f"{words}."


def named(table: SweepTable, quantity: str) -> str:
    """A quantity with its unit."""
    unit = table.unit(quantity)
    return f"{quantity.replace('_', ' ')} [{unit}]" if unit else quantity.replace("_", " ")


def _quantile_table(table: SweepTable, found: Sequence[Quantile]) -> str:
    shares = list(dict.fromkeys(one.share for one in found))
    head = ["quantity", *(f"{share:.0%}" for share in shares), "runs"]
    lines = [head, ["---", *["--:"] * (len(shares) + 1)]]
    for quantity in dict.fromkeys(one.quantity for one in found):
        of = [one for one in found if one.quantity == quantity]
        cells = [f"{one.value:.5g} ({_end(one.low)} to {_end(one.high)})" for one in of]
        missing = of[0].counted < of[0].asked
        lines.append(
            [named(table, quantity), *cells, f"{'**' * missing}{of[0].counted} of {of[0].asked}{'**' * missing}"]
        )
    return _table(lines)


def _importance_words(found: Sequence[Importance]) -> str:
    if found[0].kind == "rank correlation":
        return (
            "Spearman's rank correlation: what goes up with a setting, and how surely. It sees neither curves that turn nor "
            "interactions; `--design importance` draws the points for first-order and total indices."
        )
    return (
        f"Sobol' indices from {found[0].counted} of {found[0].asked} base points, {CONFIDENCE:.0%} intervals by bootstrap: the "
        "share of the variance that a setting brings alone (first order), and with its interactions (total)."
    )


def _importance_table(table: SweepTable, found: Sequence[Importance]) -> str:
    kinds = list(dict.fromkeys(one.kind for one in found))
    lines = [["quantity", "setting", *kinds, "from"], ["---", "---", *["--:"] * (len(kinds) + 1)]]
    for quantity, key in dict.fromkeys((one.quantity, one.key) for one in found):
        of = [one for one in found if (one.quantity, one.key) == (quantity, key)]
        cells = [f"{one.value:+.3f} ({one.low:+.3f} to {one.high:+.3f})" for one in of]
        lines.append([named(table, quantity), f"`{key}`", *cells, f"{of[0].counted} of {of[0].asked}"])
    return _table(lines)


def _table(lines: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _end(value: float | None) -> str:
    return "…" if value is None else f"{value:.5g}"
