"""The command ``stress --set verdicts``: whether what runs say of themselves is true."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from taichi_membrane.assurance.verdicts import catalogue, report
from taichi_membrane.assurance.verdicts.case import Case, Finding
from taichi_membrane.assurance.verdicts.sweep import run_all
from taichi_membrane.commands.common import CHECK_FAILS, made_folder


def verdicts(full: bool, out: Path, only: Sequence[str], jobs: int) -> int:
    """Run the verdict cases, print the counts, and write page, CSV and picture into ``out``.

    :param full: all cases.
    :param only: names of cases or families; the whole set when empty.
    :return: exit code: 0, or 1 where a run says what is not true.
    :raises InputError: a name that neither a case nor a family has; a folder that cannot be made.
    """
    cases = catalogue.chosen(only, "full" if full else "default")
    made_folder(out)

    def told(case: Case, findings: Sequence[Finding]) -> None:
        one = report.judged(case, findings)
        bad = sum(bool(run) for run in one.wrong)
        typer.echo(
            f"{case.name}: {len(findings)} runs, {bad} wrong, {sum(run.seconds for run in findings):.1f} s", err=True
        )

    found = run_all(cases, jobs=jobs, told=told)
    reports = [report.judged(case, found[case.name]) for case in cases]
    arguments = " ".join([*(["--full"] if full else []), *(f"--only {name}" for name in only)])
    for path in report.write(reports, out, arguments):
        typer.echo(f"wrote {path}", err=True)
    heads, *_, last = report.summary(reports)
    typer.echo("; ".join(f"{head} {cell}" for head, cell in zip(heads[1:], last[1:], strict=True)))
    return CHECK_FAILS if any(run for one in reports for run in one.wrong) else 0
