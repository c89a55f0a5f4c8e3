"""Wavefront OBJ: faces of three and four corners, lines, points; groups, objects and materials."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from taichi_membrane.mesh.formats.raw import CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown

_FREE_FORM = frozenset(
    ("vp", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end", "con", "bzp",
     "bsp", "cdc", "cdp", "res", "call", "csh")
)  # fmt: skip
_IGNORED = frozenset(
    ("vn", "vt", "s", "mtllib", "maplib", "usemap", "lod", "shadow_obj", "trace_obj", "mg", "bevel", "c_interp", "d_interp",
     "ctech", "stech")
)  # fmt: skip
_COMMENT = re.compile(r"(^|\s)#.*")  # inside a word the sign belongs to it: names such as Material#2
_KINDS: dict[int, CellKind] = {3: "triangle", 4: "quad"}
_PREFIX = {"g": "group", "o": "object", "usemtl": "material"}


@dataclass(eq=False)
class _Reader:
    source: Source
    points: list[list[float]] = field(default_factory=list)
    rows: list[tuple[CellKind, Sequence[int]]] = field(default_factory=list)
    row_lines: list[int] = field(default_factory=list)
    current: dict[str, list[str]] = field(default_factory=dict)
    members: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    coloured: int = 0

    def take(self, words: list[str], line: int) -> None:
        """Act on one statement."""
        source = self.source
        match words[0]:
            case "v":
                self._vertex(words[1:], line)
            case "f" | "fo":
                nodes = [self._node(word, line) for word in words[1:]]
                if len(nodes) not in _KINDS:
                    raise source.fault(
                        f"a face has {several(len(nodes), 'corner')}, 3 or 4 are read: triangulate the mesh", line
                    )
                self._cell(_KINDS[len(nodes)], nodes, line)
            case "l":
                nodes = [self._node(word, line) for word in words[1:]]
                if len(nodes) < 2:
                    raise source.fault("a line needs two points", line)
                for pair in itertools.pairwise(nodes):
                    self._cell("line", pair, line)
            case "p":
                for word in words[1:]:
                    self._cell("vertex", [self._node(word, line)], line)
            case "g":
                self.current["g"] = words[1:]
            case "o" | "usemtl" as key:
                self.current[key] = [" ".join(words[1:])] if len(words) > 1 else []
            case word if word in _FREE_FORM:
                raise source.fault(
                    f"{word}: curves, surfaces and commands are not read: save a mesh of triangles", line
                )
            case word if word not in _IGNORED:
                raise source.fault(f"{shown(word)} is no statement of an OBJ file", line)

    def _vertex(self, words: list[str], line: int) -> None:
        numbers = [self.source.real(word, line, "a coordinate") for word in words]
        if len(numbers) not in (3, 4, 6, 7):
            raise self.source.fault(
                f"a vertex has {several(len(numbers), 'number')}; 3, or 3 and a colour are expected", line
            )
        if len(numbers) == 4 and numbers[3] != 1.0:
            raise self.source.fault(f"a vertex has the weight {numbers[3]:g}: rational points are not read", line)
        self.coloured += len(numbers) > 4
        self.points.append(numbers[:3])

    def _node(self, word: str, line: int) -> int:
        """A corner such as 7, 7/1/3 or -1; counted from 1, or back from the last vertex so far."""
        number = self.source.whole(word.partition("/")[0], line, "a vertex number")
        if number == 0 or -number > len(self.points):
            raise self.source.fault(
                f"vertex {number}: numbers run from 1, or back from -1 to -{len(self.points)}", line
            )
        return number - 1 if number > 0 else len(self.points) + number

    def _cell(self, kind: CellKind, nodes: Sequence[int], line: int) -> None:
        for key, names in self.current.items():
            for name in names:
                self.members.setdefault((key, name), []).append(len(self.rows))
        self.rows.append((kind, nodes))
        self.row_lines.append(line)

    def finish(self) -> RawMesh:
        """All that was read; a name that groups, objects or materials share with different members gets their kind before it."""
        raw = RawMesh(np.array(self.points, dtype=np.float64).reshape(-1, 3))
        for (_, nodes), line in zip(self.rows, self.row_lines, strict=True):
            if max(nodes) >= len(self.points):
                told = f"vertex {max(nodes) + 1} is used, and the file has {several(len(self.points), 'vertex', 'vertices')}"
                raise self.source.fault(told, line)
        raw.add_rows(self.rows)
        raw.cell_name = lambda cell: f"{self.rows[cell][0]} {cell} (line {self.row_lines[cell]})"
        for (key, name), members in self.members.items():
            others = {k: held for (k, n), held in self.members.items() if n == name and k != key}
            unique = all(held == members for held in others.values())
            if unique and any(k in others for k in _before(key)):
                continue  # the same set under the same name
            raw.group_cells(name if unique else f"{_PREFIX[key]}_{name}", members)
        if self.coloured:
            raw.notes.append(f"not carried over: the colour of {several(self.coloured, 'vertex', 'vertices')}")
        return raw


def _before(key: str) -> list[str]:
    return list(_PREFIX)[: list(_PREFIX).index(key)]


def read(source: Source) -> RawMesh:
    """Read an OBJ file.

    :raises InputError: faces of more than four corners, free-form geometry, vertices that there are not.
    """
    reader = _Reader(source)
    number, lines = 0, source.lines
    while number < len(lines):
        line, text = number + 1, _COMMENT.sub("", lines[number])
        while text.rstrip().endswith("\\") and line + 1 <= len(lines) and number + 1 < len(lines):
            number += 1
            text = text.rstrip()[:-1] + " " + _COMMENT.sub("", lines[number])
        number += 1
        words = re.split(r"\s+", text.strip())
        if words[0]:
            reader.take(words, line)
    return reader.finish()
