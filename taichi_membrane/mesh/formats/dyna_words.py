"""The keywords and cards of an LS-DYNA file: fields of fixed width or between commas, comments, included files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from taichi_membrane.mesh.formats.source import Includes, Source, shown


@dataclass(frozen=True, eq=False)
class Card:
    """One line of data. Fields stand between commas, or in columns: of twice the width, or more, in a file of long format."""

    text: str
    source: Source
    line: int
    long: bool

    def fields(self, widths: Sequence[int]) -> list[str]:
        """The fields, without blanks around them; those beyond the line's end are missing."""
        if "," in self.text:
            return [word.strip() for word in self.text.split(",")]
        text, found, at = self.text.expandtabs(8), [], 0
        if self.long:
            widths = [20] * len(widths)
        for width in widths:
            if not text[at:].strip():
                break
            found.append(text[at : at + width].strip())
            at += width
        return found

    def whole(self, fields: Sequence[str], number: int, what: str, default: int | None = None) -> int:
        """A field that holds a whole number."""
        word = fields[number] if number < len(fields) else ""
        if not word and default is not None:
            return default
        if word.startswith("&"):
            raise self.source.fault(f"{what} is the parameter {shown(word)}: write the number out", self.line)
        return self.source.whole(word.removesuffix(".0").removesuffix("."), self.line, what)

    def real(self, fields: Sequence[str], number: int) -> float:
        """A field that holds a coordinate; 0 where it is empty."""
        word = fields[number] if number < len(fields) else ""
        if word.startswith("&"):
            raise self.source.fault(f"a coordinate is the parameter {shown(word)}: write the number out", self.line)
        return self.source.real(word, self.line, "a coordinate") if word else 0.0


@dataclass(frozen=True, eq=False)
class Block:
    """A keyword in capitals without its star, and its cards."""

    name: str
    source: Source
    line: int
    cards: list[Card] = field(default_factory=list)


def blocks(source: Source) -> Iterator[Block]:
    """All keywords in order, those of included files at their places; *END ends the file.

    :raises InputError: data before the first keyword, included files that are not there.
    """
    yield from _blocks(source, Includes(source), [False])


def _blocks(source: Source, includes: Includes, long: list[bool]) -> Iterator[Block]:
    block: Block | None = None
    wide = False
    for line, whole in enumerate(source.lines, 1):
        text = whole.rstrip()
        if not text or text.startswith("$"):
            continue
        if not text.startswith("*"):
            if block is None:
                raise source.fault(f"data stand before the first keyword: {shown(text)}", line)
            block.cards.append(Card(text, source, line, wide))
            continue
        yield from _closed(block, includes, long)
        words = text[1:].upper().split()
        name = words[0] if words else ""
        if name.endswith("%"):
            raise source.fault(f"*{name}: fields of ten columns are not read: save in standard or long format", line)
        wide = (long[0] or name.endswith("+")) and not name.endswith("-")
        if name == "KEYWORD" and any("LONG" in word and ("=Y" in word or "=S" in word) for word in words[1:]):
            long[0] = "=Y" in "".join(words[1:])
        if name == "END":
            return
        block = Block(name.rstrip("+-"), source, line)
    yield from _closed(block, includes, long)


def _closed(block: Block | None, includes: Includes, long: list[bool]) -> Iterator[Block]:
    if block is None:
        return
    if block.name in ("INCLUDE_PATH", "INCLUDE_PATH_RELATIVE"):
        raise block.source.fault(f"*{block.name}: files are included from this file's folder only", block.line)
    if block.name != "INCLUDE":
        yield block
        return
    for card in block.cards:
        yield from _blocks(includes.enter(card.text.strip(), card.source, card.line), includes, long)
        includes.leave()
