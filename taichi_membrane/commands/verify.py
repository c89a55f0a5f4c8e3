"""The ``verify`` command: runs the cases with a known answer and writes how near they come."""

from __future__ import annotations

from pathlib import Path

import typer

from taichi_membrane.assurance.verification import catalogue, report
from taichi_membrane.assurance.verification.benchmark import BenchmarkResult, run_benchmark
from taichi_membrane.commands.common import CHECK_FAILS, made_folder


def verify(full: bool, out: Path, only: list[str]) -> int:
    """Run the verification cases, print each quantity as it is found, and write table, CSV and plots into ``out``.

    :param full: also the finer meshes.
    :param only: names of cases; all when empty.
    :return: exit code: 0, or 1 when a case misses its bound or its rate, or finds no equilibrium.
    :raises InputError: a name that no case has; a folder that cannot be made.
    """
    names = catalogue.chosen(only)
    made_folder(out)
    results = []
    for number, name in enumerate(names, 1):
        typer.echo(f"[{number}/{len(names)}] {name} ...", err=True)
        results.append(run_benchmark(catalogue.CASES[name](), full=full))
        _print(results[-1])
    for path in report.write(results, out):
        typer.echo(f"wrote {path}", err=True)
    failed = [result.case.name for result in results if not result.passed]
    typer.echo(
        f"{len(results) - len(failed)} of {len(results)} cases passed"
        + (f"; failed: {', '.join(failed)}" if failed else "")
    )
    return CHECK_FAILS if failed else 0


def _print(result: BenchmarkResult) -> None:
    typer.echo(f"{result.case.title} ({sum(result.seconds):.0f} s)")
    for one in result.quantities:
        _, name, ours, reference, error, allowed, order, *_ = report.line(result, one)
        verdict = "" if one.passed else "  FAILS"
        typer.echo(
            f"  {name:<36} {ours:>12}  ref. {reference:>12}  {error:>10} of {allowed:<6}  order {order}{verdict}"
        )
    if result.failure:
        typer.echo(f"  FAILS: {result.failure}")
