"""The keywords and cards of an LS-DYNA file: fields of fixed width or between commas, comments, included files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from taichi_membrane.mesh.formats.source import Includes, Source, shown


@dataclass(frozen=True, eq=False)
class Card:
    """One line of data. Fields stand between commas, or in columns: of 20 in long format, of 10 in place of 8 in format I10."""

    text: str
    source: Source
    line: int
    layout: str

    def fields(self, widths: Sequence[int]) -> list[str]:
        """The fields, without blanks around them; those beyond the line's end are missing."""
        if "," in self.text:
            return [word.strip() for word in self.text.split(",")]
        text, found, at = self.text.expandtabs(8), [], 0
        if self.layout == "long":
            widths = [20] * len(widths)
        elif self.layout == "i10":
            widths = [max(width, 10) for width in widths]
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
    yield from _blocks(source, Includes(source), ["standard"])


# Keywords whose cards may be blank: a title without words, or a card on which every field has its default.
_BLANK_CARDS = ("PART", "SET_", "ELEMENT_SHELL_", "ELEMENT_BEAM_")
_LAYOUTS = {"+": "long", "-": "standard", "%": "i10"}


def _blocks(source: Source, includes: Includes, layout: list[str]) -> Iterator[Block]:
    """:param layout: that of the file, which stands on its keyword line and holds for included files too."""
    block: Block | None = None
    own = "standard"
    for line, whole in enumerate(source.lines, 1):
        text = whole.rstrip()
        if text.startswith("$") or (not text and (block is None or not block.name.startswith(_BLANK_CARDS))):
            continue
        if not text.startswith("*"):
            if block is None:
                raise source.fault(f"data stand before the first keyword: {shown(text)}", line)
            block.cards.append(Card(text, source, line, own))
            continue
        yield from _closed(block, includes, layout)
        words = text[1:].upper().split()
        name = words[0] if words else ""
        marks = [word for word in (name[-1:], *words[1:2]) if word in _LAYOUTS]  # "*NODE+", or with a blank between
        own = _LAYOUTS[marks[0]] if marks else layout[0]
        options = "".join(words[1:])
        if name == "KEYWORD" and ("LONG=" in options or "I10=" in options):
            layout[0] = "long" if "LONG=Y" in options else "i10" if "I10=Y" in options else "standard"
        if name == "END":
            return
        block = Block(name.rstrip("+-%"), source, line)
    yield from _closed(block, includes, layout)


def _closed(block: Block | None, includes: Includes, layout: list[str]) -> Iterator[Block]:
    if block is None:
        return
    while block.cards and not block.cards[-1].text and not block.name.startswith("ELEMENT_"):
        block.cards.pop()
    if block.name in ("INCLUDE_PATH", "INCLUDE_PATH_RELATIVE"):
        raise block.source.fault(f"*{block.name}: files are included from this file's folder only", block.line)
    if block.name != "INCLUDE":
        yield block
        return
    for card in block.cards:
        yield from _blocks(includes.enter(card.text.strip(), card.source, card.line), includes, layout)
        includes.leave()
