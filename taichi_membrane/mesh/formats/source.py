"""A file as bytes, lines and numbers; every fault names the file, the line and what was found there."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError

_LARGEST = 2**63 - 1  # node numbers are held in 64 bits
_LONGEST_SHOWN = 60  # characters of a bad value that are repeated in a message
_MOST_INCLUDED, _DEEPEST = 1000, 20  # files that one file may bring in, and how deep they may stand in each other
# The exponent as Fortran writes it (1.5D3) and as NASTRAN does, without its letter (1.5-3).
_FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[dD]([+-]?\d+)|([+-]\d+))")
_PLAIN = re.compile(r"[+-]?\d+")


@dataclass(frozen=True, eq=False)
class Source:
    """One file's content.

    :param shown: how messages name the file: as the user wrote it, included files by their own paths.
    """

    path: Path
    data: bytes
    shown: str

    @classmethod
    def of(cls, path: Path, shown: str | None = None) -> Source:
        """Read a file."""
        return cls(path, path.read_bytes(), shown or str(path))

    @cached_property
    def text(self) -> str:
        """The content as text: UTF-8, else Latin-1, in which any byte is a letter; UTF-16 where its mark says so.

        :raises InputError: UTF-16 that is damaged.
        """
        if self.data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            try:
                return self.data.decode("utf-16")
            except UnicodeDecodeError as error:
                raise self.fault(f"the file begins as UTF-16 text and is none: {error.reason}") from None
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return self.data.removeprefix(codecs.BOM_UTF8).decode("latin-1")

    @cached_property
    def lines(self) -> list[str]:
        """The text's lines without their ends; ends are those of Unix, Windows and old Macs."""
        return re.split(r"\r\n|\n|\r", self.text)

    def fault(self, message: str, line: int | None = None) -> InputError:
        """The error to raise for something wrong in this file, at a line counted from 1 where one is known."""
        return InputError(f"{self.shown}: {'' if line is None else f'line {line}: '}{message}")

    def real(self, word: str, line: int, what: str) -> float:
        """A number, with the exponents of C, Fortran and NASTRAN; it may be infinite, which the checks of a mesh refuse.

        :raises InputError: it is none.
        """
        word = word.strip()
        try:
            if "_" not in word:
                return float(word)
        except ValueError:
            match = _FORTRAN.fullmatch(word)
            if match:
                return float(f"{match[1]}e{match[2] or match[3]}")
        raise self.fault(f"{what} must be a number, got {shown(word)}", line)

    def whole(self, word: str, line: int, what: str) -> int:
        """A whole number of at most 64 bits.

        :raises InputError: it is none.
        """
        word = word.strip()
        if not _PLAIN.fullmatch(word) or len(word) > 25 or abs(int(word)) > _LARGEST:
            raise self.fault(f"{what} must be a whole number, got {shown(word)}", line)
        return int(word)


def shown(word: str) -> str:
    """A word of the file as messages repeat it: quoted and short."""
    return repr(word if len(word) <= _LONGEST_SHOWN else f"{word[:_LONGEST_SHOWN]}…")


def several(count: int, name: str, plural: str = "") -> str:
    """A number of things in words: ``1 node``, ``2 nodes``."""
    return f"{count} {name if count == 1 else plural or name + 's'}"


def listed(words: Iterable[object], most: int = 8) -> str:
    """Things in a row, the first few of many."""
    held = [str(word) for word in words]
    return ", ".join(held[:most]) + (f" and {len(held) - most} more" if len(held) > most else "")


class Includes:
    """The files that a file brings in: from its own folder and below, never in a ring, and not too many."""

    def __init__(self, first: Source) -> None:
        self._folder = first.path.resolve().parent
        self._open = [first.path.resolve()]
        self._count = 0

    def enter(self, name: str, source: Source, line: int) -> Source:
        """The content of an included file, which stays open until :meth:`leave`.

        :raises InputError: no name, a file outside the folder, one that is missing or includes itself, too many.
        """
        name = name.strip().strip("\"'").strip()
        if not name or "\0" in name:
            raise source.fault("an include names no file", line)
        path = (self._folder / name.replace("\\", "/")).resolve()
        if not path.is_relative_to(self._folder):
            raise source.fault(
                f"the included file {shown(name)} lies outside this file's folder; copy it beside it", line
            )
        if path in self._open:
            raise source.fault(f"the included file {shown(name)} includes itself", line)
        if not path.is_file():
            raise source.fault(f"there is no included file {shown(name)} in this file's folder", line)
        self._count += 1
        if self._count > _MOST_INCLUDED or len(self._open) > _DEEPEST:
            raise source.fault(
                f"more than {_MOST_INCLUDED} files are included, or more than {_DEEPEST} in each other", line
            )
        self._open.append(path)
        return Source.of(path)

    def leave(self) -> None:
        """Close the file that was entered last."""
        self._open.pop()


class Numbering:
    """Where the things with given numbers stand: the numbers of a file run as they like."""

    def __init__(self, labels: NDArray[np.int64]) -> None:
        self._order = np.argsort(labels, kind="stable")
        self._sorted = labels[self._order]

    def repeated(self) -> tuple[int, int] | None:
        """Places of the first two things with one number; None where all differ."""
        same = np.flatnonzero(self._sorted[1:] == self._sorted[:-1])
        return (int(self._order[same[0]]), int(self._order[same[0] + 1])) if same.size else None

    def find(self, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
        """Places of the wanted numbers, in any shape; -1 for those that nothing has."""
        if not self._sorted.size:
            return np.full(wanted.shape, -1, dtype=np.int64)
        at = np.searchsorted(self._sorted, wanted)
        at = np.minimum(at, self._sorted.size - 1)
        return np.where(self._sorted[at] == wanted, self._order[at], -1)

    def between(self, first: int, last: int, step: int) -> NDArray[np.int64]:
        """Places of the numbers first, first + step, … up to last that there are."""
        inside = (self._sorted >= first) & (self._sorted <= last)
        inside &= (self._sorted - first) % step == 0
        return self._order[inside]
