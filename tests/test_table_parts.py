"""Tables that are wider than the terminal, in several parts: nothing is lost, no head is broken, worst cases keep their names."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from taichi_membrane.commands.printing import parts, print_table
from taichi_membrane.output.tables import Column

TABLE = [
    Column("support", ["skirt_windward", "peg_1"]),
    *(Column(f"{axis} [kN]", ["1.6892", "-0.78837"]) for axis in ("largest", "x", "y", "z")),
    Column("in", ["wind_back", "storm"]),
    Column("least z [kN]", ["-3.6078", "-0.67032"]),
    Column("in", ["wind_back", "storm"]),
    Column("largest z [kN]", ["-1.2999", "-0.21518"]),
    Column("in", ["lights_and_wind", "soft"]),
]


@pytest.mark.parametrize("width", [50, 64, 80, 100, 133])
def test_a_wide_table_is_printed_in_parts_of_the_width(width: int) -> None:
    found = parts(TABLE, width)
    assert [one for part in found for one in part[1:]] == TABLE[1:]
    assert all(part[0] is TABLE[0] and part[1].header != "in" for part in found)
    assert (len(found) == 1) == (width == 133)
    console = Console(file=io.StringIO(), width=width)
    for part in found:
        print_table(console, part)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) == 3 * len(found)  # no cell and no head is broken
    assert max(map(len, lines)) <= width


def test_what_no_width_holds_is_not_lost() -> None:
    assert [len(part) for part in parts(TABLE, 5)] == [2, 2, 2, 3, 3, 3]
