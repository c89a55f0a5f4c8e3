"""The cards of a NASTRAN bulk data file: small, large and free fields, continuations, included files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from taichi_membrane.mesh.formats.source import Includes, Source, shown

_REPLICATES = re.compile(r"=+|=?\(.*\)|\*\(.*\)")  # fields that repeat or count on from the card before


@dataclass(frozen=True, eq=False)
class Card:
    """One card: its name in capitals, and the fields after it, without blanks around them."""

    name: str
    fields: list[str]
    source: Source
    line: int

    def word(self, number: int) -> str:
        """A field, counted from 1 as the manual does without the name; empty where the card ends before."""
        return self.fields[number - 1] if number <= len(self.fields) else ""

    def whole(self, number: int, what: str, default: int | None = None) -> int:
        """A field that holds a whole number."""
        word = self.word(number)
        if not word and default is not None:
            return default
        return self.source.whole(word, self.line, f"{self.name}: {what}")

    def real(self, number: int, what: str, default: float | None = None) -> float:
        """A field that holds a number; exponents need no letter."""
        word = self.word(number)
        if not word and default is not None:
            return default
        return self.source.real(word, self.line, f"{self.name}: {what}")


def control_sets(source: Source) -> tuple[int, int]:
    """Number of SET commands before BEGIN BULK, and the line of the first of them."""
    lines = [text.partition("$")[0].upper() for text in source.lines[: _begin(source)]]
    found = [line for line, text in enumerate(lines, 1) if re.match(r"\s*SET\s+\d+\s*=", text)]
    return len(found), found[0] if found else 0


def cards(source: Source) -> Iterator[Card]:
    """All cards of the bulk data in order, those of included files at their places; ENDDATA ends the file.

    :raises InputError: continuations that follow nothing, fields that repeat others, damaged lines.
    """
    fields: list[str] = []
    name, mark, at = "", "", (source, 0)
    for text, source_of_line, line in _bulk(source, Includes(source)):
        head, cells, tail = _fields(text)
        if head and head[0] not in "+*":
            if name:
                yield Card(name, _stripped(fields), *at)
            name, fields, at = head.rstrip("*").strip().upper(), cells, (source_of_line, line)
        elif not name:
            raise source_of_line.fault(f"a continuation stands before the first card: {shown(text.strip())}", line)
        else:
            given = head.lstrip("+*").strip()
            if given != mark:
                raise source_of_line.fault(
                    f"the continuation {shown(head)} does not follow its card: the line before ends with {shown(mark)}",
                    line,
                )
            fields += cells
        mark = tail.lstrip("+*").strip()
        repeated = next((cell for cell in cells if _REPLICATES.fullmatch(cell)), None)
        if repeated is not None or name.startswith("="):
            told = (
                f"fields that repeat or count on, such as {shown(repeated or name)}, are not read: write the cards out"
            )
            raise source_of_line.fault(told, line)
    if name:
        yield Card(name, _stripped(fields), *at)


def _stripped(fields: list[str]) -> list[str]:
    while fields and not fields[-1]:
        fields = fields[:-1]
    return fields


def _fields(text: str) -> tuple[str, list[str], str]:
    """First field, data fields, and the mark of the continuation at the end of a line."""
    if "," in text:
        cells = [cell.strip() for cell in text.split(",")]
        head, cells = cells[0], cells[1:]
        count = 4 if head.endswith("*") or head.startswith("*") else 8
        tail = cells[count] if len(cells) == count + 1 else ""
        # Longer lines are written by programs that take the number of fields as free.
        kept = cells[:count] if len(cells) <= count + 1 else cells
        return head, kept + [""] * (count - len(kept)), tail
    line = text.expandtabs(8)
    head = line[:8].strip()
    width, count = (16, 4) if head.startswith("*") or head.endswith("*") else (8, 8)
    cells = [line[8 + width * k : 8 + width * (k + 1)].strip() for k in range(count)]
    return head, cells, line[72:80].strip()


def _bulk(source: Source, includes: Includes, top: bool = True) -> Iterator[tuple[str, Source, int]]:
    """The lines of the bulk data without comments."""
    lines = source.lines
    number = _begin(source) if top else 0
    while number < len(lines):
        text, line = lines[number].partition("$")[0].rstrip(), number + 1
        number += 1
        words = text.split(None, 1)
        if not words:
            continue
        first = words[0].upper()
        if first == "ENDDATA" or first.startswith("ENDDATA,"):
            return
        if first == "BEGIN":
            told = "a second BEGIN BULK (superelements or auxiliary models) is not read: save one model"
            raise source.fault(told, line)
        if first == "INCLUDE":
            name = words[1] if len(words) > 1 else ""
            while name[:1] in ("'", '"') and name.count(name[0]) == 1 and number < len(lines):
                name += lines[number].strip()  # a long name goes on
                number += 1
            yield from _bulk(includes.enter(name, source, line), includes, top=False)
            includes.leave()
            continue
        yield text, source, line


def _begin(source: Source) -> int:
    """Where the bulk data begin: after BEGIN BULK, at the top of a file that has neither it nor executive control."""
    for number, text in enumerate(source.lines):
        words = text.partition("$")[0].upper().replace(",", " ").split()
        if words[:1] == ["BEGIN"]:
            if words[1:2] not in ([], ["BULK"]):
                raise source.fault(f"{shown(text.strip())} is not read: save one model of bulk data", number + 1)
            return number + 1
    control = next((n for n, text in enumerate(source.lines) if text.strip().upper() == "CEND"), None)
    if control is not None:
        raise source.fault("executive control ends here and no BEGIN BULK follows", control + 1)
    return 0
