"""Good files of every text format, damaged line by line: never a failure without a cause, never another number of elements."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from bad_input import PROFILE, assert_one_message
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import CASES, Case, Read

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import read_mesh


def in_blocks(begins: str, line: str) -> Callable[[str], int]:
    """Counts lines of a pattern after each line that ``begins`` matches, up to the next keyword."""

    def count(text: str) -> int:
        inside, found = False, 0
        for own in text.splitlines():
            if own.startswith(("*", "Begin", "End")) and not own.startswith("**"):
                inside = re.match(begins, own, re.IGNORECASE) is not None
            elif inside and re.match(line, own):
                found += 1
        return found

    return count


def number_after(pattern: str) -> Callable[[str], int]:
    """The number that the file announces."""
    return lambda text: sum(int(match) for match in re.findall(pattern, text, re.MULTILINE))


def lines_like(pattern: str) -> Callable[[str], int]:
    """How many lines match."""
    return lambda text: len(re.findall(pattern, text, re.MULTILINE))


# A second, naive way to count the triangles of a file, for each format.
COUNTS: dict[str, Callable[[str], int]] = {
    ".inp": in_blocks(r"\*ELEMENT\s*,.*TYPE\s*=\s*(S3|M3D3)", r"\s*[^\s*]"),
    ".bdf": lambda text: lines_like(r"^CTRIA3")(re.split(r"^BEGIN BULK$", text, maxsplit=1, flags=re.MULTILINE)[-1]),
    ".msh": lines_like(r"^\s*\d+ 2 2 -?\d+ -?\d+ \d+ \d+ \d+$"),
    ".stl": lines_like(r"^\s*(endfacet|ENDFACET)\b"),
    ".obj": lines_like(r"^\s*f\s"),
    ".ply": number_after(r"^element face (\d+)"),
    ".off": lambda text: int((re.search(r"^(?:\w*OFF )?\s*\d+\s+(\d+)(?:\s+0)?\s*$", text, re.MULTILINE) or "00")[1]),
    ".vtk": number_after(r"^(?:CELLS|POLYGONS) (\d+) \d+$"),
    ".vtu": number_after(r'NumberOfCells="(\d+)"'),
    ".mesh": number_after(r"^Triangles\s+(\d+)"),
    ".mdpa": in_blocks(r"Begin Elements.*3D3N", r"\s*\d"),
    ".k": in_blocks(r"\*ELEMENT_SHELL$", r"[^$\s]|\s+\d"),
    ".dxf": lines_like(r"^3DFACE$"),
}


def is_base(case: Case) -> bool:
    """A case of triangles alone, in text, that the naive count understands."""
    return (
        isinstance(case.verdict, Read)
        and isinstance(case.content, str)
        and not case.others
        and case.format != "any"
        and COUNTS[Path(case.name).suffix](case.content) == case.verdict.triangles
    )


BASES = [case for case in CASES if is_base(case)]
_JUNK = [
    "",
    "rubbish",
    "*",
    "-1",
    "1 2 3",
    "1, 2, 3",
    "0",
    "nan nan nan",
    "9" * 30,
    "\x00",
    "é" * 9,
    "$End",
    "end",
    "*END",
    "1e999",
]


def test_every_text_format_has_a_base() -> None:
    assert {Path(case.name).suffix for case in BASES} == set(COUNTS)


@pytest.mark.parametrize("suffix", sorted(COUNTS))
@settings(PROFILE, max_examples=120)
@given(data=st.data())
def test_a_file_damaged_line_by_line_is_refused_or_has_its_elements(
    tmp_path: Path, suffix: str, data: st.DataObject
) -> None:
    case = data.draw(st.sampled_from([case for case in BASES if Path(case.name).suffix == suffix]), label="case")
    assert isinstance(case.content, str)
    lines = case.content.splitlines()
    for fault in data.draw(
        st.lists(st.sampled_from(["drop", "double", "swap", "junk", "cut", "word", "letter"]), min_size=1, max_size=3)
    ):
        at = data.draw(st.integers(0, max(len(lines) - 1, 0)))
        other = data.draw(st.integers(0, max(len(lines) - 1, 0)))
        if fault == "junk" or not lines:
            lines.insert(at, data.draw(st.sampled_from(_JUNK)))
        elif fault == "drop":
            del lines[at]
        elif fault == "double":
            lines.insert(other, lines[at])
        elif fault == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        elif fault == "cut":
            lines[at] = lines[at][: data.draw(st.integers(0, len(lines[at])))]
        elif fault == "word":
            words = re.split(r"(\W+)", lines[at])
            words[data.draw(st.integers(0, len(words) - 1))] = data.draw(
                st.sampled_from([*_JUNK, "5", "77", "0.5", "-3", " "])
            )
            lines[at] = "".join(words)
        else:
            place = data.draw(st.integers(0, len(lines[at])))
            lines[at] = lines[at][:place] + data.draw(st.sampled_from('0 9,-*.$#aE\t"')) + lines[at][place + 1 :]
    text = "\n".join(lines) + "\n"
    path = tmp_path / case.name
    path.write_text(text, encoding="utf-8")
    try:
        mesh = read_mesh(path)
    except InputError as error:
        message = str(error)
    else:
        told = [note for note in mesh.notes if not note.startswith("left out")]
        assert mesh.tri_count == COUNTS[suffix](text) or told, text
        return
    assert_one_message(message, f"{path}: ")
    assert "the file may be damaged" not in message, "a reader failed where it should have said why"
