"""What the command line shows: tables that fit, names as ranges, progress with and without a terminal."""

from __future__ import annotations

import io

import pytest
from rich.console import Console
from run_files import SCENE

from taichi_membrane.commands import printing
from taichi_membrane.commands.progress import ProgressView
from taichi_membrane.output import tables


def column(header: str, width: int, rank: int) -> tables.Column:
    return tables.Column(header, ["x" * width], rank)


def test_columns_are_left_out_by_rank_until_the_rest_fits() -> None:
    columns = [column("a", 10, 0), column("b", 10, 2), column("c", 10, 1), column("d", 30, 1), column("e", 10, 0)]

    def shown(width: int) -> str:
        return "".join(item.header for item in printing.fitting(columns, width))

    assert shown(22) == "ae"  # 10 + 2 + 10
    assert shown(33) == "ae"
    assert shown(34) == "ace"
    assert shown(46) == "abce"
    assert shown(78) == "abcde"  # 70 characters and 4 gaps


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a.csv"], ["a.csv"]),
        (["s_0.vtu", "s_1.vtu", "s_2.vtu"], ["s_0.vtu … s_2.vtu"]),
        (["x", "s_0.vtu", "s_0.png", "s_1.vtu", "s_1.png", "y"], ["x", "s_0.vtu … s_1.vtu", "s_0.png … s_1.png", "y"]),
        ([], []),
    ],
)
def test_numbered_names_are_shown_as_ranges(names: list[str], expected: list[str]) -> None:
    assert printing.ranges(names) == expected


def test_a_terminal_shows_one_line_that_is_rewritten() -> None:
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, force_interactive=True, width=80, markup=False)
    with ProgressView(SCENE, console) as view:
        view.phase("compiling kernels")
        view.progress("load", 2, 3, 123, 4.5e-3, 6.0)
    text = shown.getvalue()
    assert "load 2/3: 123 iterations, residual 4.5e-03, 6.0 s (load step 1 of 3)" in text
    assert text.endswith("\x1b[2K")  # nothing stays: the last thing written erases the line


def test_a_long_solve_without_a_terminal_says_so_from_time_to_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("taichi_membrane.commands.progress.time.monotonic", lambda: now[0])
    shown = io.StringIO()
    view = ProgressView(SCENE, Console(file=shown, width=80))
    for now[0] in range(0, 26):
        view.progress("load", 1, 3, 100 * int(now[0]), 1e-3, now[0])
    assert [line.split()[2] for line in shown.getvalue().splitlines()] == ["1000", "2000"]


def test_round_off_beside_large_values_is_shown_as_0() -> None:
    assert tables.number_column("tip", "mm", [-1.9e-17, 1.5, -2.0]).cells == ["0", "1.5", "-2"]
    assert tables.number_column("tip", "", [-1.9e-17]).cells == ["-1.9e-17"]
