"""The sections of a gmsh file and the numbers in them, as text or binary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.source import Source, shown

Ints = NDArray[np.int64]
_READ = ("2.2", "4.1")
_NODES = {
    1: 2,
    2: 3,
    3: 4,
    4: 4,
    5: 8,
    6: 6,
    7: 5,
    8: 3,
    9: 6,
    10: 9,
    11: 10,
    12: 27,
    13: 18,
    14: 14,
    15: 1,
    16: 8,
    17: 20,
}
_NODES |= {18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 26: 4, 27: 5, 28: 6}
_BINARY = (
    "Entities",
    "Nodes",
    "Elements",
    "PartitionedEntities",
    "Periodic",
    "NodeData",
    "ElementData",
    "ElementNodeData",
)


@dataclass(eq=False)
class Words:
    """Reads one section from its beginning. ``line`` is where it begins; 0 in a binary part, which has no lines."""

    source: Source
    name: str
    version: str
    binary: bool
    at: int
    line: int
    order: str = "<"
    words: list[str] | None = None
    next: int = 0

    def fault(self, message: str) -> Exception:
        """The error to raise for something wrong in this section."""
        return self.source.fault(f"${self.name}: {message}", self.line or None)

    def _text(self, count: int) -> list[str]:
        assert self.words is not None
        found = self.words[self.next : self.next + count]
        if len(found) < count:
            raise self.fault(f"the section ends after {len(self.words)} numbers, {count} more are announced")
        self.next += count
        return found

    def _bytes(self, kind: str, count: int) -> NDArray[np.generic]:
        kind = self.order + kind
        size = np.dtype(kind).itemsize * count
        data = self.source.data[self.at : self.at + size]
        if len(data) < size:
            raise self.fault(f"the file ends, {size} bytes are announced and {len(data)} are left")
        self.at += size
        return np.frombuffer(data, dtype=kind)

    def _whole(self, count: int, kind: str) -> Ints:
        if self.binary:
            return self._bytes(kind, count).astype(np.int64)
        words = self._text(count)
        try:
            return np.array(words, dtype=np.int64) if count else np.empty(0, dtype=np.int64)
        except (ValueError, OverflowError):
            bad = next((word for word in words if not re.fullmatch(r"[+-]?\d{1,18}", word)), words[0])
            raise self.fault(f"whole numbers are expected, got {shown(bad)}") from None

    def integers(self, count: int) -> Ints:
        """Whole numbers of 32 bits: tags of entities, dimensions, types."""
        return self._whole(count, "i4")

    def tags(self, count: int) -> Ints:
        """Whole numbers of 64 bits: nodes and elements."""
        return self._whole(count, "u8")

    def sizes(self, count: int) -> Ints:
        """Whole numbers of 64 bits that count something."""
        found = self._whole(count, "u8")
        if (found < 0).any():
            raise self.fault(f"a count is {found.min()}")
        return found

    def reals(self, count: int) -> NDArray[np.float64]:
        """Numbers."""
        if self.binary:
            return self._bytes("f8", count).astype(np.float64)
        words = self._text(count)
        try:
            return np.array(words, dtype=np.float64) if count else np.empty(0)
        except ValueError as error:
            raise self.fault(f"numbers are expected: {error}") from None

    def texts(self, count: int) -> list[str]:
        """Texts in quotation marks, of a section in text."""
        return [word.strip('"') for word in self._text(count)]

    def count(self, what: str) -> int:
        """A count that the file has room for. In text and in format 4.1 it is a number like others; names are always text."""
        if (self.binary and self.version == "2.2") or self.name == "PhysicalNames":
            word = self._line() if self.binary else self._text(1)[0]
            if not re.fullmatch(r"\d{1,18}", word):
                raise self.fault(f"the number of {what} is {shown(word)}")
            found = int(word)
        else:
            found = int(self.sizes(1)[0])
        if found > len(self.source.data):
            raise self.fault(f"{found} {what} are announced in a file of {len(self.source.data)} bytes")
        return found

    def _line(self) -> str:
        end = self.source.data.find(b"\n", self.at)
        end = len(self.source.data) if end < 0 else end
        text = self.source.data[self.at : end].decode("latin-1").strip()
        self.at = end + 1
        return text

    def named(self) -> tuple[int, int, str]:
        """Dimension, number and name of a physical group."""
        text = self._line() if self.binary else " ".join(self._text(3))
        match = re.fullmatch(r'(\d)\s+(-?\d{1,9})\s+"(.*)"', text)
        if match is None:
            raise self.fault(f'dimension, number and "name" are expected, got {shown(text)}')
        return (
            int(match[1]),
            int(match[2]),
            match[3].encode("latin-1", "replace").decode("utf-8", "replace") if self.binary else match[3],
        )

    def node_rows(self, count: int) -> tuple[Ints, NDArray[np.float64]]:
        """Numbers and positions of format 2.2."""
        if self.binary:
            rows = self._bytes_rows(count)
            return rows["label"].astype(np.int64), rows["at"].astype(np.float64)
        words = self._text(4 * count)
        try:
            labels = np.array(words[::4], dtype=np.int64) if count else np.empty(0, dtype=np.int64)
            flat = np.array([words[k::4] for k in (1, 2, 3)], dtype=np.float64).T if count else np.empty((0, 3))
        except (ValueError, OverflowError) as error:
            raise self.fault(f"a number and three coordinates are expected: {error}") from None
        return labels, flat

    def _bytes_rows(self, count: int) -> NDArray[np.void]:
        kind = np.dtype([("label", self.order + "i4"), ("at", self.order + "f8", (3,))])
        data = self.source.data[self.at : self.at + kind.itemsize * count]
        if len(data) < kind.itemsize * count:
            raise self.fault(f"the file ends, {count} nodes are announced and {len(data) // kind.itemsize} are there")
        self.at += len(data)
        return np.frombuffer(data, dtype=kind)

    def element_runs(self, total: int) -> Iterator[tuple[int, Ints, Ints, Ints]]:
        """Elements of format 2.2: type, numbers, physical tag (n, 1) and nodes of one run after another."""
        done = 0
        while done < total:
            if self.binary:
                number, count, tags = self.integers(3).tolist()
                width = 1 + tags + self._corners(number)
                if not 0 < count <= total - done or not 0 <= tags < 100_000:
                    raise self.fault(f"{count} elements with {tags} tags are announced, {total - done} are left")
                rows = self.integers(count * width).reshape(count, width)
            else:
                number, tags, found = self._text_run(total - done)
                rows = np.array(found, dtype=np.int64)
                count = len(rows)
            physical = rows[:, 1:2] if tags else np.zeros((count, 1), dtype=np.int64)
            yield number, rows[:, 0], physical, rows[:, 1 + tags :]
            done += count

    def _corners(self, number: int) -> int:
        if number not in _NODES:
            raise self.fault(
                f"elements of gmsh's type {number} are not read; triangles are type 2, quadrilaterals 3, lines 1, points 15"
            )
        return _NODES[number]

    def _text_run(self, most: int) -> tuple[int, int, list[Ints]]:
        """Type, number of tags, and rows (number, tags, nodes) of elements that have both alike."""
        found: list[Ints] = []
        kind: tuple[int, int] | None = None
        while len(found) < most:
            start = self.next
            label, number, tags = self.integers(3).tolist()
            if kind is not None and (number, tags) != kind:
                self.next = start
                break
            kind = (number, tags)
            if not 0 <= tags < 100_000:
                raise self.fault(f"element {label} announces {tags} tags")
            rest = self.integers(tags + self._corners(number))
            found.append(np.concatenate(([label], rest)))
        assert kind is not None
        return *kind, found

    def end(self) -> None:
        """Refuse what stands between the announced numbers and the section's end."""
        if not self.binary:
            assert self.words is not None
            if self.next != len(self.words):
                raise self.fault(f"{len(self.words) - self.next} numbers are left over at the section's end")


def sections(source: Source) -> Iterator[tuple[str, Words]]:
    """All sections in order. The reader of a section moves on to its end.

    :raises InputError: no gmsh file, another version, a section without an end.
    """
    data, at = source.data, 0
    version, binary, order = "", False, "<"
    while True:
        match = re.compile(rb"\s*\$(\w+)[ \t]*\r?\n").match(data, at)
        if match is None:
            rest = data[at : at + 100].decode("latin-1").strip()
            if rest or not version:
                raise source.fault(f"a section such as $Nodes is expected at byte {at}, got {shown(rest)}")
            return
        name = match[1].decode("ascii", "replace")
        at = match.end()
        line = 0 if binary else data.count(b"\n", 0, at)
        if name == "MeshFormat":
            version, binary, order, at = _format(source, at)
        elif not version and name != "Comments":
            raise source.fault(f"$MeshFormat is expected first, got ${name}", line)
        whole = binary and name in _BINARY
        words = Words(source, name, version, binary, at, line, order)
        closing = re.compile(rb"\s*\$End" + name.encode() + rb"\b[^\n]*\n?")
        if name == "MeshFormat":
            yield name, words
        elif not whole or name not in ("Entities", "Nodes", "Elements"):
            found = re.compile(rb"\$End" + name.encode() + rb"\b").search(data, at)
            if found is None:
                raise source.fault(f"${name} has no $End{name}: the file is cut off", line or None)
            text = data[at : found.start()].decode("utf-8", "replace")
            words.words = _split(text) if not binary else None
            yield name, words
            at = found.start()
        else:
            yield name, words
            at = words.at
        done = closing.match(data, at)
        if done is None:
            raise source.fault(f"$End{name} is expected at byte {at}: the file is damaged or cut off", line or None)
        at = done.end()


def _split(text: str) -> list[str]:
    return re.findall(r'"[^"\n]*"|\S+', text)


def _format(source: Source, at: int) -> tuple[str, bool, str, int]:
    end = source.data.find(b"\n", at)
    words = source.data[at : end if end >= 0 else len(source.data)].split()
    if len(words) != 3 or end < 0:
        raise source.fault("$MeshFormat needs version, 0 for text or 1 for binary, and the size of a number", 2)
    version = words[0].decode("ascii", "replace")
    version = "2.2" if version in ("2", "2.0", "2.1", "2.2") else version
    if version not in _READ:
        raise source.fault(f"format {shown(version)} is not read; save as version 4.1 or 2.2 (gmsh -format msh41)", 2)
    if words[2] != b"8" or words[1] not in (b"0", b"1"):
        raise source.fault(f"$MeshFormat {b' '.join(words).decode('latin-1')}: 0 or 1 and then 8 are expected", 2)
    binary, order, at = words[1] == b"1", "<", end + 1
    if binary:
        one = source.data[at : at + 4]
        order = ">" if one == b"\0\0\0\1" else "<"
        if one not in (b"\0\0\0\1", b"\1\0\0\0"):
            raise source.fault("the binary file does not begin with the number one")
        at += 4
    return version, binary, order, at
