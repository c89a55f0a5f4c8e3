"""VTK's old files, text and binary: unstructured grids and polygons, of versions 1 to 5.1."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown
from taichi_membrane.mesh.formats.vtk_cells import add_cells, name_groups

Ints = NDArray[np.int64]
_TYPES = {
    "bit": "bit", "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2", "unsigned_int": "u4", "int": "i4",
    "unsigned_long": "u8", "long": "i8", "float": "f4", "double": "f8", "vtkidtype": "i8", "vtktypeint64": "i8",
    "vtktypeuint8": "u1", "vtktypeint32": "i4", "vtktypeuint32": "u4", "signed_char": "i1",
}  # fmt: skip
_POLYDATA = {"VERTICES": 2, "LINES": 4, "POLYGONS": 7, "TRIANGLE_STRIPS": 6}
_TUPLES = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1, "EDGE_FLAGS": 1}


@dataclass(eq=False)
class _Cursor:
    """A place in the file; numbers are read as text or, in binary files, big-endian bytes."""

    source: Source
    binary: bool
    at: int

    def line(self) -> list[str] | None:
        """Words of the next line that holds any; None at the end of the file."""
        data = self.source.data
        while self.at < len(data):
            end = data.find(b"\n", self.at)
            end = len(data) if end < 0 else end
            words = data[self.at : end].decode("latin-1").split()
            self.at = end + 1
            if words:
                return words
        return None

    def fault(self, message: str) -> Exception:
        """The error to raise for something wrong here."""
        return self.source.fault(message, None if self.binary else self.source.data.count(b"\n", 0, self.at) or 1)

    def numbers(self, kind: str, count: int) -> NDArray[Any]:
        """The next numbers."""
        if self.binary:
            if kind == "bit":
                return np.unpackbits(np.frombuffer(self._bytes((count + 7) // 8), dtype="u1"))[:count]
            return np.frombuffer(self._bytes(np.dtype(kind).itemsize * count), dtype=f">{kind}")
        found: list[bytes] = []
        while len(found) < count:
            words = self.line()
            if words is None:
                raise self.fault(f"the file ends, {count} numbers are announced and {len(found)} are there")
            found += [word.encode("latin-1") for word in words]
        if len(found) > count:
            raise self.fault(f"{count} numbers are announced, and {len(found)} stand on these lines")
        try:
            return np.array(found, dtype="S").astype("i8" if kind == "bit" or kind[0] in "iu" else "f8")
        except (ValueError, OverflowError):
            raise self.fault(f"numbers are expected, got {shown(b' '.join(found[:6]).decode('latin-1'))}") from None

    def _bytes(self, size: int) -> bytes:
        data = self.source.data[self.at : self.at + size]
        if len(data) < size:
            raise self.source.fault(f"the file ends, {size} bytes are announced and {len(data)} are left")
        self.at += size
        return data

    def count(self, word: str) -> int:
        """A count that the file has room for."""
        if not re.fullmatch(r"\d{1,18}", word) or int(word) > 8 * len(self.source.data):
            raise self.fault(f"a count is {shown(word)} in a file of {len(self.source.data)} bytes")
        return int(word)

    def kind(self, word: str) -> str:
        """The type of numbers that a word names."""
        if word.lower() not in _TYPES:
            raise self.fault(f"{shown(word)} is no type of numbers; allowed: {', '.join(_TYPES)}")
        return _TYPES[word.lower()]


def read(source: Source) -> RawMesh:
    """Read an old VTK file.

    :raises InputError: structured data, cells that have no place in a mesh, counts that do not agree, damage.
    """
    head = re.match(
        rb"# vtk DataFile Version (\d+)\.(\d+)[^\n]*\n[^\n]*\n\s*(ASCII|BINARY)\s*?\n", source.data, re.IGNORECASE
    )
    if head is None:
        raise source.fault("'# vtk DataFile Version …', a title, and ASCII or BINARY are expected on three lines")
    cursor = _Cursor(source, head[3].upper() == b"BINARY", head.end())
    new = int(head[1]) >= 5
    data: dict[str, Any] = {"POINT_DATA": {}, "CELL_DATA": {}, "FIELD": {}}
    blocks: list[tuple[int | None, Ints, Ints]] = []
    points: NDArray[np.float64] | None = None
    types: Ints | None = None
    where, length = "FIELD", 0
    while (words := cursor.line()) is not None:
        word = words[0].upper()
        match word:
            case "DATASET":
                if words[1:2] and words[1].upper() not in ("UNSTRUCTURED_GRID", "POLYDATA"):
                    raise cursor.fault(f"{shown(words[1])} is not read: UNSTRUCTURED_GRID or POLYDATA is needed")
            case "POINTS" if len(words) == 3:
                points = (
                    cursor.numbers(cursor.kind(words[2]), 3 * cursor.count(words[1])).astype(np.float64).reshape(-1, 3)
                )
            case "CELLS" | "VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" if len(words) == 3:
                one, other = cursor.count(words[1]), cursor.count(words[2])
                blocks.append((_POLYDATA.get(word), *(_offsets if new else _counted)(cursor, one, other)))
            case "CELL_TYPES" if len(words) == 2:
                types = cursor.numbers("i4", cursor.count(words[1])).astype(np.int64)
            case "POINT_DATA" | "CELL_DATA" if len(words) == 2:
                where, length = word, cursor.count(words[1])
            case "METADATA":
                _skip_metadata(cursor)
            case _:
                _attribute(cursor, words, data[where], length)
    if points is None:
        raise source.fault("the file holds no POINTS")
    return _mesh(source, points, blocks, types, data)


def _counted(cursor: _Cursor, cells: int, size: int) -> tuple[Ints, Ints]:
    """Before version 5: each cell is the number of its corners and then these. Returns ends of the cells, and all corners."""
    flat = cursor.numbers("i4", size).astype(np.int64)
    if cells and size % cells == 0 and (flat[:: size // cells] == size // cells - 1).all():
        width = size // cells
        return np.arange(1, cells + 1) * (width - 1), flat.reshape(cells, width)[:, 1:].ravel()
    ends, kept, at = [], np.ones(size, dtype=bool), 0
    for _ in range(cells):
        if at >= size or not 0 <= flat[at] <= size - at - 1:
            raise cursor.fault(f"{several(cells, 'cell')} of {size} numbers in all are announced, and they do not fit")
        kept[at] = False
        ends.append(int(flat[at]))
        at += 1 + int(flat[at])
    if at != size:
        raise cursor.fault(f"{several(cells, 'cell')} of {size} numbers in all are announced, and they take {at}")
    return np.cumsum(np.array(ends, dtype=np.int64)), flat[kept]


def _offsets(cursor: _Cursor, offsets: int, size: int) -> tuple[Ints, Ints]:
    """From version 5 on: where the cells end, then all corners."""
    held = []
    for name, count in (("OFFSETS", offsets), ("CONNECTIVITY", size)):
        words = cursor.line() or []
        if len(words) != 2 or words[0].upper() != name:
            raise cursor.fault(f"{name} and a type are expected, got {shown(' '.join(words))}")
        held.append(cursor.numbers(cursor.kind(words[1]), count).astype(np.int64))
    if len(held[0]) and (held[0][0] != 0 or held[0][-1] != size or (np.diff(held[0]) < 0).any()):
        raise cursor.fault(f"the offsets do not run from 0 to {size}")
    return held[0][1:], held[1]


def _skip_metadata(cursor: _Cursor) -> None:
    """Lines until an empty one."""
    end = re.compile(rb"\n[ \t]*\r?\n").search(cursor.source.data, max(cursor.at - 1, 0))
    cursor.at = end.end() if end else len(cursor.source.data)


def _attribute(cursor: _Cursor, words: list[str], into: dict[str, Any], length: int) -> None:
    word = words[0].upper()
    if word == "SCALARS" and len(words) in (3, 4):
        width = cursor.count(words[3]) if len(words) == 4 else 1
        before = cursor.at
        table = cursor.line() or []
        if table[:1] != ["LOOKUP_TABLE"]:
            cursor.at = before  # its line may be missing
        _put(into, words[1], cursor.numbers(cursor.kind(words[2]), length * width), width)
    elif word in _TUPLES and len(words) == 3:
        _put(into, words[1], cursor.numbers(cursor.kind(words[2]), length * _TUPLES[word]), _TUPLES[word])
    elif word == "TEXTURE_COORDINATES" and len(words) == 4:
        width = cursor.count(words[2])
        _put(into, words[1], cursor.numbers(cursor.kind(words[3]), length * width), width)
    elif word == "COLOR_SCALARS" and len(words) == 3:
        width = cursor.count(words[2])
        _put(into, words[1], cursor.numbers("u1" if cursor.binary else "f4", length * width), width + (width == 1))
    elif word == "LOOKUP_TABLE" and len(words) == 3:
        cursor.numbers("u1" if cursor.binary else "f4", 4 * cursor.count(words[2]))
    elif word == "FIELD" and len(words) == 3:
        for _ in range(cursor.count(words[2])):
            head = cursor.line() or []
            while head and head[0].upper() == "METADATA":
                _skip_metadata(cursor)
                head = cursor.line() or []
            if len(head) != 4:
                raise cursor.fault(
                    f"name, width, length and type of an array are expected, got {shown(' '.join(head))}"
                )
            width, rows = cursor.count(head[1]), cursor.count(head[2])
            if head[3].lower() == "string":
                raise cursor.fault(f"the array {shown(head[0])} holds texts, which are not read")
            _put(into, head[0], cursor.numbers(cursor.kind(head[3]), width * rows), width)
    else:
        raise cursor.fault(f"{shown(' '.join(words))} is not understood here")


def _put(into: dict[str, Any], name: str, values: NDArray[Any], width: int) -> None:
    name = re.sub(r"%([0-9A-Fa-f]{2})", lambda m: chr(int(m[1], 16)), name)
    into[name] = (
        values if width == 1 else values.reshape(-1, width) if width and values.size % width == 0 else values[:, None]
    )


def _mesh(
    source: Source,
    points: NDArray[np.float64],
    blocks: list[tuple[int | None, Ints, Ints]],
    types: Ints | None,
    data: dict[str, dict[str, Any]],
) -> RawMesh:
    raw = RawMesh(points)
    origin, first = [np.empty(0, dtype=np.int64)], 0
    # VTK numbers the cells of polygon data by kind, whatever the order in the file.
    for number, ends, nodes in sorted(
        blocks, key=lambda block: list(_POLYDATA.values()).index(block[0]) if block[0] else 0
    ):
        count = len(ends)
        kinds = np.full(count, number) if number is not None else types
        if kinds is None or len(kinds) != count:
            raise source.fault(
                f"{several(count, 'cell')} and {several(0 if kinds is None else len(kinds), 'cell type')}"
            )
        starts = np.concatenate(([0], ends[:-1])) if count else ends
        origin.append(first + add_cells(source, raw, kinds, starts, ends, nodes))
        first += count
    for where, length in (("POINT_DATA", len(points)), ("CELL_DATA", first)):
        for name, values in data[where].items():
            if len(values) != length:
                raise source.fault(f"{where} {shown(name)} has {several(len(values), 'value')}, {length} are needed")
    name_groups(raw, np.concatenate(origin), data["CELL_DATA"], data["POINT_DATA"])
    return raw
