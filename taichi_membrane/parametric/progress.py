"""A bar that shows how a sweep gets on: on a terminal, in a notebook, or as lines where neither is there."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from taichi_membrane.parametric.rows import Row

if TYPE_CHECKING:
    from taichi_membrane.parametric.sweep import Told

_BETWEEN_LINES = 10.0  # s, where no line can be rewritten: as for a single run


@contextmanager
def told_by_bar(total: int, console: Console | None = None) -> Iterator[Told]:
    """What :func:`run_sweep` tells of each row; rows that stand apart get a line of their own."""
    console = console or Console(stderr=True, highlight=False)
    last_line = time.monotonic()
    if not (console.is_interactive or console.is_jupyter):

        def told_in_lines(row: Row, done: int, total: int, remaining: float) -> None:
            nonlocal last_line
            if row.apart or done == total or time.monotonic() - last_line >= _BETWEEN_LINES:
                last_line = time.monotonic()
                console.print(f"[{done}/{total}] {_words(row)}{_to_go(remaining)}", markup=False, soft_wrap=True)

        yield told_in_lines
        return
    columns = (
        TextColumn("runs"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, redirect_stdout=False, redirect_stderr=False) as progress:
        bar = progress.add_task("", total=total)

        def told(row: Row, done: int, total: int, remaining: float) -> None:
            progress.update(bar, completed=done, description=_to_go(remaining).removeprefix(", "))
            if row.apart:
                progress.console.print(_words(row), markup=False)

        yield told


def _words(row: Row) -> str:
    """A row in a line."""
    reason = f": {row.reason}" if row.reason else ""
    return f"run {row.trial.number} ({row.trial.label}): {row.apart.upper() + reason if row.apart else row.outcome}"


def _to_go(seconds: float) -> str:
    if seconds < 1.0:
        return ""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f", {hours}:{minutes:02d}:{rest:02d} to go"
