"""PLY, text and binary of either byte order: vertices, faces, edges; whole numbers of faces as groups."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_TYPES |= {
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
}
_TYPES |= {"float32": "f4", "float64": "f8"}
_CORNERS = ("vertex_indices", "vertex_index")
_NO_GROUPS = re.compile(r"red|green|blue|alpha|[rgba]|flags|texnumber|(diffuse|ambient|specular|emissive)_.*|quality")
_KINDS: dict[int, CellKind] = {3: "triangle", 4: "quad"}


@dataclass(eq=False)
class _Property:
    name: str
    kind: str
    counted_by: str = ""  # type of the count, of a list


@dataclass(eq=False)
class _Element:
    name: str
    count: int
    line: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(eq=False)
class _Body:
    """Takes numbers from the data after the header."""

    source: Source
    order: str  # "" for text
    at: int
    line: int

    def columns(self, element: _Element) -> dict[str, Any]:
        """All values of an element: arrays of single values, arrays (n, k) or lists of arrays of lists."""
        return self._text(element) if not self.order else self._binary(element)

    def _text(self, element: _Element) -> dict[str, Any]:
        lines = self.source.lines
        held: dict[str, list[Any]] = {item.name: [] for item in element.properties}
        for done in range(element.count):
            while self.line < len(lines) and not lines[self.line].strip():
                self.line += 1
            if self.line >= len(lines):
                raise self.source.fault(
                    f"{element.count} times {element.name} are announced, {done} are there: cut off"
                )
            words, self.line = lines[self.line].split(), self.line + 1
            at = 0
            for item in element.properties:
                count = 1
                if item.counted_by:
                    count = self.source.whole(
                        words[at] if at < len(words) else "", self.line, f"the length of {item.name}"
                    )
                    at += 1
                values = words[at : at + count] if count >= 0 else []
                if len(values) < count or count < 0:
                    raise self.source.fault(f"{element.name}: {count} numbers of {item.name} are expected", self.line)
                at += count
                numbers = [self._number(word, item) for word in values]
                held[item.name].append(numbers if item.counted_by else numbers[0])
            if at != len(words):
                raise self.source.fault(
                    f"{element.name}: {several(len(words), 'number')}, {at} are expected", self.line
                )
        return {name: values if _is_list(element, name) else np.array(values) for name, values in held.items()}

    def _number(self, word: str, item: _Property) -> float | int:
        if item.kind[0] == "f":
            return self.source.real(word, self.line, item.name)
        return self.source.whole(word, self.line, item.name)

    def _binary(self, element: _Element) -> dict[str, Any]:
        """Rows of one width where all lists are as long as the first row's, row by row where they are not."""
        rows = self._alike(element)
        if rows is not None:
            return {item.name: rows[item.name] for item in element.properties}
        held: dict[str, list[Any]] = {item.name: [] for item in element.properties}
        for _ in range(element.count):
            for item in element.properties:
                count = int(self._take(item.counted_by, 1)[0]) if item.counted_by else 1
                values = self._take(item.kind, count)
                held[item.name].append(values if item.counted_by else values[0])
        return {name: values if _is_list(element, name) else np.array(values) for name, values in held.items()}

    def _alike(self, element: _Element) -> NDArray[np.void] | None:
        fields: list[Any] = []
        start = self.at
        for item in element.properties:
            if not item.counted_by:
                fields.append((item.name, self.order + item.kind))
                self._take(item.kind, 1 if element.count else 0)
                continue
            count = int(self._take(item.counted_by, 1)[0]) if element.count else 0
            self._take(item.kind, count)
            fields += [
                (f"count of {item.name}", self.order + item.counted_by),
                (item.name, self.order + item.kind, (count,)),
            ]
        self.at = start
        kind = np.dtype(fields)
        if kind.itemsize * element.count > len(self.source.data) - start:
            if any(item.counted_by for item in element.properties):
                return None
            raise self.source.fault(
                f"{element.count} times {element.name} are announced, and the file ends before: cut off"
            )
        rows = np.frombuffer(self.source.data, dtype=kind, count=element.count, offset=start)
        for item in element.properties:
            if item.counted_by and element.count and (rows[f"count of {item.name}"] != rows[item.name].shape[1]).any():
                return None
        self.at = start + kind.itemsize * element.count
        return rows

    def _take(self, kind: str, count: int) -> NDArray[Any]:
        size = np.dtype(kind).itemsize * count
        if count < 0 or self.at + size > len(self.source.data):
            raise self.source.fault(f"the file ends where {several(count, 'number')} more are announced: it is cut off")
        found = np.frombuffer(self.source.data, dtype=self.order + kind, count=count, offset=self.at)
        self.at += size
        return found


def _is_list(element: _Element, name: str) -> bool:
    return any(item.name == name and item.counted_by for item in element.properties)


def read(source: Source) -> RawMesh:
    """Read a PLY file.

    :raises InputError: triangle strips, polygons, counts that do not agree, damage.
    """
    elements, body = _header(source)
    found = {element.name: body.columns(element) for element in elements}
    if not body.order and any(text.strip() for text in source.lines[body.line :]):
        raise source.fault("more lines follow than are announced", body.line + 1)
    if body.order and body.at != len(source.data):
        raise source.fault(f"{len(source.data) - body.at} bytes follow that are not announced")
    counts = {element.name: element.count for element in elements}
    if counts.get("tristrips"):
        raise source.fault("triangle strips are not read: save faces")
    vertex = found.get("vertex", {})
    if not all(axis in vertex for axis in "xyz"):
        raise source.fault(f"vertices with x, y and z are needed, got {', '.join(vertex) or 'none'}")
    raw = RawMesh(np.column_stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"]).reshape(-1, 3))
    _faces(source, raw, found.get("face", {}), counts.get("face", 0))
    if counts.get("edge"):
        ends = [np.asarray(found["edge"].get(name, [])) for name in ("vertex1", "vertex2")]
        if len(ends[0]) != counts["edge"] or len(ends[1]) != counts["edge"]:
            raise source.fault("edges need vertex1 and vertex2")
        raw.add_cells("line", np.column_stack(ends))
    left_out = [name for name, count in counts.items() if name not in ("vertex", "face", "edge") and count]
    left_out += [f"'{name}' of vertices" for name in vertex if name not in ("x", "y", "z") and counts["vertex"]]
    if left_out:
        raw.notes.append(f"not carried over: {', '.join(left_out)}")
    return raw


def _faces(source: Source, raw: RawMesh, face: dict[str, Any], count: int) -> None:
    if not count:
        return
    name = next((name for name in _CORNERS if name in face), None)
    if name is None:
        raise source.fault(f"faces need a list vertex_indices, got {', '.join(face) or 'nothing'}")
    corners = face[name]
    if isinstance(corners, np.ndarray) and corners.ndim == 2 and corners.shape[1] in _KINDS:
        raw.add_cells(_KINDS[corners.shape[1]], corners)
    else:
        bad = next((k for k, nodes in enumerate(corners) if len(nodes) not in _KINDS), None)
        if bad is not None:
            raise source.fault(
                f"face {bad} has {several(len(corners[bad]), 'corner')}, 3 or 4 are read: triangulate the mesh"
            )
        raw.add_rows((_KINDS[len(nodes)], [int(node) for node in nodes]) for nodes in corners)
    left_out = []
    for key, values in face.items():
        if key == name:
            continue
        one_each = isinstance(values, np.ndarray) and values.ndim == 1
        if one_each and values.dtype.kind in "iu" and not _NO_GROUPS.fullmatch(key):
            raw.group_by_value(key, values, np.arange(count))
        else:
            left_out.append(f"'{key}' of faces")
    if left_out:
        raw.notes.append(f"not carried over: {', '.join(left_out)}")


def _header(source: Source) -> tuple[list[_Element], _Body]:
    end = re.search(rb"(\r\n|\n|\r)[ \t]*end_header[ \t]*(\r\n|\n|\r|$)", source.data)
    if source.data[:3] != b"ply" or end is None:
        raise source.fault("a PLY file begins with 'ply' and its header ends with 'end_header'")
    elements: list[_Element] = []
    order: str | None = None
    lines = re.split(r"\r\n|\n|\r", source.data[: end.start()].decode("latin-1"))
    for line, text in enumerate(lines[1:], 2):
        match text.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in ("ascii", "binary_little_endian", "binary_big_endian"):
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[name]
            case ["element", name, count]:
                number = source.whole(count, line, f"the number of {name}")
                if not 0 <= number <= len(source.data):
                    told = f"{number} times {name} are announced in a file of {len(source.data)} bytes"
                    raise source.fault(told, line)
                if any(element.name == name for element in elements):
                    raise source.fault(f"the element {name} is announced twice", line)
                elements.append(_Element(name, number, line))
            case ["property", "list", counted_by, kind, name] if elements and counted_by in _TYPES and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[counted_by]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case _:
                raise source.fault(f"this line of the header is not understood: {shown(text)}", line)
    for element in elements:
        names = [item.name for item in element.properties]
        if not names or len(set(names)) < len(names):
            raise source.fault(f"the element {element.name} has no property, or one twice", element.line)
    if order is None:
        raise source.fault("the header names no format: ascii, binary_little_endian or binary_big_endian 1.0")
    return elements, _Body(source, order, end.end(), len(lines) + 1)
