"""What the command line prints about a scene and about a run: tables that fit the width, and lists."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from taichi_membrane.commands.run_lines import balance_lines, cascade_lines, relief_lines, wall_lines
from taichi_membrane.output.case_tables import case_columns, failed_lines, range_columns, worst_reaction_columns
from taichi_membrane.output.tables import (
    Column,
    adaption_columns,
    adaption_line,
    check_columns,
    error_text,
    estimate_columns,
    estimate_notes,
    layer_lines,
    reference_text,
    stability_notes,
    step_columns,
    tolerance_text,
    with_unit,
)
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation import utilisation
from taichi_membrane.simulation.results import RunResult

_GAP = 2  # blanks between columns


def print_run(console: Console, result: RunResult) -> None:
    """Print the load steps, the checks, times and files of a run."""
    for label, lines in (("mended", result.mesh.mended), ("noted", result.mesh.notes)):
        for line in lines:
            print_wrapped(console, label, line)
    _print_steps(console, result)
    print_failed_steps(console, result)
    for line in relief_lines(result):
        print_wrapped(console, "relief", line)
    for line in balance_lines(result):
        print_wrapped(console, "balance", line)
    for stage, (step, used) in utilisation.by_stage(result).items():
        print_wrapped(
            console, "utilised", f"most in {stage}, load step {step.number}: {utilisation.words(used, result.scene)}"
        )
    for line in cascade_lines(result):
        print_wrapped(console, "cascade", line)
    for line in wall_lines(result):
        print_wrapped(console, "contact", line)
    for line in layer_lines(result.layers, result.scene.units.length):
        print_wrapped(console, "layer", line)
    if result.cases:
        _print_cases(console, result)
    _print_at_rest(console, result)
    _print_unknown(console, result)
    if result.checks:
        console.print()
        print_table(console, check_columns(result.scene, result.checks))
        print_failed_checks(console, result)
        held = sum(check.passed for check in result.checks)
        _print_plain(console, f"{held} of {len(result.checks)} checks hold")
    console.print()
    _print_estimate(console, result)
    _print_adaption(console, result)
    spent = ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in result.seconds.items())
    real = result.provenance
    threads = f", {real['threads']} threads" if real["threads"] else ""
    if real["solver_reason"]:
        print_wrapped(console, "solver", f"{real['solver']} alone: {real['solver_reason']}")
    print_wrapped(console, "time", f"{spent} ({real['arch']}, {real['precision']}{threads})")
    if result.directory is not None:
        print_files(console, result.directory, result.files)


def _print_estimate(console: Console, result: RunResult) -> None:
    """Error estimates, where they were asked for."""
    if result.estimate is None:
        return
    if any(step.probes for step in result.estimate.steps):
        _print_plain(console, f"errors estimated by the mesh cut in four ({result.estimate.tri_count} elements)")
        print_table(console, estimate_columns(result.scene, result.estimate))
    for note in estimate_notes(result.estimate, result.layers):
        print_wrapped(console, "errors", note)
    console.print()


def _print_adaption(console: Console, result: RunResult) -> None:
    """What the mesh was refined for, where it was."""
    if result.adaption is None:
        return
    if result.adaption.rounds:
        _print_plain(console, f"mesh refined for {result.adaption.probe}, errors estimated by each mesh cut in four")
        print_table(console, adaption_columns(result.scene, result.adaption))
    print_wrapped(console, "adapt", adaption_line(result.adaption))
    console.print()


def print_failed_adaption(console: Console, result: RunResult) -> None:
    """Print that a refined mesh does not meet its tolerance."""
    if result.adaption is not None and not result.adaption.reached:
        print_wrapped(console, "adapt", adaption_line(result.adaption))


def _print_at_rest(console: Console, result: RunResult) -> None:
    """Modes and derivatives at the last load step that has them."""
    with_modes = [step for step in result.steps if step.modes is not None]
    if with_modes and with_modes[-1].modes is not None:
        step, modes = with_modes[-1], with_modes[-1].modes
        what = (
            "frequencies [1/time]" if modes.kind == "vibration" else f"buckling at these shares of stage {step.stage}"
        )
        values = ", ".join(f"{value:.6g}" for value in modes.values) or "none"
        values += f" ({modes.missing})" if modes.missing else ""
        console.print()
        print_wrapped(console, f"{what}, at {step.stage} {step.stage_step}:", values)
    with_derivatives = [step for step in result.steps if step.derivatives]
    if with_derivatives:
        step = with_derivatives[-1]
        parameters = list(next(iter(step.derivatives.values())))
        console.print()
        columns = [Column(f"at {step.stage} {step.stage_step}, d/d…", list(step.derivatives))]
        columns += [Column(p, [f"{of[p]:.6g}" for of in step.derivatives.values()]) for p in parameters]
        print_table(console, columns)


def _print_unknown(console: Console, result: RunResult) -> None:
    """Why stability is not known of load steps, or not all of it, a line for each reason."""
    for which, why in stability_notes(result.steps):
        print_wrapped(console, "stability", f"{which}: {why}")


def print_failed_steps(console: Console, result: RunResult) -> None:
    """Print each load step that did not reach its load, and why: collapse, or no equilibrium found."""
    counts = {stage.name: stage.steps for stage in result.scene.ramps}
    for step in result.steps:
        where = f"load step {step.number} ({step.stage} {step.stage_step}/{counts[step.stage]})"
        if not step.converged:
            _print_plain(console, f"NOT CONVERGED: {where}: {step.reason}", style="bold red")
        elif step.limit is not None:
            _print_plain(console, f"COLLAPSE: {where}: {step.reason.removeprefix('collapse: ')}", style="bold yellow")
        elif step is result.stage_steps[-1] and result.outcome in ("no collapse", "steps used up"):
            _print_plain(console, f"{result.outcome.upper()}: {where}: {step.reason}", style="bold red")


def _print_cases(console: Console, result: RunResult) -> None:
    """Verdicts and numbers of the load cases, the worst case of each quantity, and support forces."""
    for columns in parts(fitting(case_columns(result), console.width), console.width):
        console.print()
        print_table(console, columns)
    print_failed_cases(console, result)
    for columns in (range_columns(result), *parts(worst_reaction_columns(result), console.width)):
        if columns[0].cells:
            console.print()
            print_table(console, columns)


def print_failed_cases(console: Console, result: RunResult) -> None:
    """Print each load case whose loads are not reached, and why."""
    for line in failed_lines(result):
        _print_plain(console, line, style="bold red")


def print_failed_checks(console: Console, result: RunResult) -> None:
    """Print each check that does not hold, with the source of its reference."""
    for check in result.checks:
        if not check.passed:
            where = f"{check.probe} at {check.stage} {check.step}"
            unit = probe_unit(result.scene, check.probe)
            found = (
                "not reached" if check.value is None else f"{with_unit(check.value, unit)} (error {error_text(check)})"
            )
            wanted = reference_text(result.scene, check)
            if check.reference is not None:
                wanted = f"reference {wanted} within {tolerance_text(check)}"
            _print_plain(console, f"CHECK FAILS: {where}: {found}, {wanted}: {check.source}", style="bold red")


def print_files(console: Console, directory: Path, files: Iterable[Path]) -> None:
    """Name the files that were written, numbered ones as a range."""
    print_wrapped(console, f"wrote {directory}:", ", ".join(ranges([path.name for path in files])))


def ranges(names: Sequence[str]) -> list[str]:
    """Join names that differ in their number alone: ``step_0000.vtu … step_0006.vtu``; the order is that of the first of each."""

    def pattern(name: str) -> str:
        return re.sub(r"\d+", "#", name)

    order = {kind: number for number, kind in reversed(list(enumerate(map(pattern, names))))}
    grouped = groupby(sorted(names, key=lambda name: order[pattern(name)]), key=pattern)
    members = [list(group) for _, group in grouped]
    return [group[0] if len(group) == 1 else f"{group[0]} … {group[-1]}" for group in members]


def _print_steps(console: Console, result: RunResult) -> None:
    """The columns every reader needs, and of the others as many as fit the width."""
    columns = step_columns(result.scene, result.steps)
    shown = fitting(columns, console.width)
    print_table(console, shown)
    if len(shown) < len(columns):
        place = "" if result.directory is None else " (in history.csv)"
        missing = ", ".join(column.header for column in columns if column not in shown)
        print_wrapped(console, "not shown:", f"{missing}{place}")


def fitting(columns: Sequence[Column], width: int) -> list[Column]:
    """The columns that fit ``width`` characters, in order: all of rank 0, the others by rank while there is room."""
    room = width + _GAP - sum(column.width + _GAP for column in columns if column.rank == 0)
    chosen = []
    for column in sorted((column for column in columns if column.rank > 0), key=lambda column: column.rank):
        if column.width + _GAP <= room:
            room -= column.width + _GAP
            chosen.append(column)
    return [column for column in columns if column.rank == 0 or column in chosen]


def parts(columns: Sequence[Column], width: int) -> list[list[Column]]:
    """A table that is wider than ``width`` characters as several, each with its first column; "in" stays beside its number."""
    first, *others = columns
    tables = [[first]]
    for column in others:
        held = tables[-1]
        wide = sum(one.width + _GAP for one in [*held, column]) - _GAP > width
        beside = column.header == "in"
        if not wide or len(held) == 1 + beside:
            held.append(column)
        elif beside:
            tables.append([first, held.pop(), column])
        else:
            tables.append([first, column])
    return tables


def print_table(console: Console, columns: Sequence[Column]) -> None:
    table = Table(box=None, padding=(0, _GAP, 0, 0), pad_edge=False, header_style="bold")
    for number, column in enumerate(columns):
        words = number < 2 or not any(cell[:1].isdigit() or cell[:1] in "+-" for cell in column.cells)
        table.add_column(Text(column.header), justify="left" if words else "right", overflow="fold")
    for row in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*(Text(cell, style="bold red" if cell in ("FAIL", "FAILED") else "") for cell in row))
    console.print(table)


def _print_plain(console: Console, line: str, style: str = "") -> None:
    console.print(Text(line, style=style), soft_wrap=True)


def print_wrapped(console: Console, label: str, text: str) -> None:
    """Fill lines up to the width, with a hanging indent; words are never broken."""
    indent = min(len(label) + 1, 12)
    lines = textwrap.wrap(
        f"{label} {text}", console.width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )
    _print_plain(console, "\n".join(lines))
