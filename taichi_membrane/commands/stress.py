"""The command ``stress``: how far the program can be pushed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from taichi_membrane.assurance.stability import catalogue, report
from taichi_membrane.assurance.stability.case import CONVERGED, Entry, judge
from taichi_membrane.assurance.stability.sweep import run_all
from taichi_membrane.commands.common import CHECK_FAILS, made_folder


def stress(full: bool, out: Path, only: list[str], jobs: int) -> int:
    """Run the stress cases, print the border of each sweep, and write table, CSV and picture into ``out``.

    :param full: more levels, all of them by every solver, with the program's own limits.
    :param only: names of cases; all when empty.
    :return: exit code: 0, or 1 when an entry is wrong and not documented to be, or the default solver falls short.
    :raises InputError: a name that no case has; a folder that cannot be made.
    """
    names = catalogue.chosen(only)
    made_folder(out)

    def told(name: str, lane: str, entries: Sequence[Entry]) -> None:
        seconds = sum(one.seconds for one in entries)
        typer.echo(f"{name}, {lane}: {len(entries)} entries, {seconds:.1f} s of solving", err=True)

    found = run_all(names, full=full, jobs=jobs, told=told)
    reports = []
    for name in names:
        case = catalogue.CASES[name]()
        judged = judge(case, found[name])
        reports.append(report.SweepReport(case, case.swept(full=full), tuple(judged)))
        _print(reports[-1])
    for path in report.write(reports, out):
        typer.echo(f"wrote {path}", err=True)
    return _summary(reports)


def _print(one: report.SweepReport) -> None:
    typer.echo(f"{one.case.title} ({one.case.parameter})")
    for solver, precision in report.SWEEPS:
        typer.echo(f"  {solver:<10} {precision}  safe up to {report.border_text(one.border(solver, precision))}")
    for bad in one.wrong:
        typer.echo(f"  WRONG: {bad.entry.solver} {bad.entry.precision} at {bad.entry.level:g}: {bad.why}")
    if one.short:
        typer.echo(f"  FALLS SHORT: the default solver has to be safe up to {one.case.required:g}")


def _summary(reports: Sequence[report.SweepReport]) -> int:
    entries = [one for r in reports for one in r.judged]
    wrong, short = sum(len(r.wrong) for r in reports), [r.case.name for r in reports if r.short]
    known = sum(one.known for one in entries)
    right = sum(one.verdict == CONVERGED for one in entries)
    typer.echo(
        f"{len(entries)} entries: {right} converged and right, {len(entries) - right - wrong - known} honest failures, "
        f"{known} wrong and documented, {wrong} wrong"
        + (f"; the default solver falls short in {', '.join(short)}" if short else "")
    )
    return CHECK_FAILS if wrong or short else 0
