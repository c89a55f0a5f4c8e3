"""MEDIT's text meshes: vertices, edges, triangles, quadrilaterals, and their references as groups."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown

_CELLS: dict[str, tuple[CellKind, int]] = {
    "edges": ("line", 2),
    "triangles": ("triangle", 3),
    "quadrilaterals": ("quad", 4),
}
_SOLIDS = {"tetrahedra": 4, "hexahedra": 8, "hexaedra": 8, "prisms": 6, "pyramids": 5}
_SECOND_ORDER = {"trianglesp2": 6, "edgesp2": 3, "quadrilateralsq2": 9, "tetrahedrap2": 10}
# Other keywords that a count follows, and how many numbers each of their items has; d stands for the dimension.
_OTHER = {
    "corners": "1", "requiredvertices": "1", "ridges": "1", "requirededges": "1", "requiredtriangles": "1", "normals": "d",
    "tangents": "d", "normalatvertices": "2", "tangentatvertices": "2", "normalattrianglevertices": "3", "tangentatedges": "3",
    "subdomainfromgeom": "4", "subdomainfrommesh": "4", "requiredquadrilaterals": "1", "geometry": "", "angleofcornerbound": "",
}  # fmt: skip
_SKIPPED = {"tangentatedges", "subdomainfromgeom", "subdomainfrommesh", "geometry", "angleofcornerbound"}


class _Words:
    """The file's words with their lines."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.words = list(_words(source))
        self.at = 0

    @property
    def line(self) -> int:
        return self.words[min(self.at, len(self.words) - 1)][1]

    def whole(self, what: str) -> int:
        if self.at >= len(self.words):
            raise self.source.fault(f"the file ends where {what} is expected")
        word, line = self.words[self.at]
        self.at += 1
        return self.source.whole(word, line, what)

    def table(self, count: int, width: int, what: str) -> NDArray[np.float64]:
        """Rows of numbers."""
        if not 0 <= count <= len(self.words):
            raise self.source.fault(f"{count} {what} are announced in a file of {len(self.words)} words", self.line)
        held = self.words[self.at : self.at + count * width]
        if len(held) < count * width:
            raise self.source.fault(f"the file ends, {count} {what} are announced and {len(held) // width} are there")
        self.at += count * width
        numbers = [self.source.real(word, line, f"a number of {what}") for word, line in held]
        return np.array(numbers, dtype=np.float64).reshape(count, width)

    def numbers(self, count: int, width: int, what: str) -> NDArray[np.int64]:
        """Rows of whole numbers."""
        first = self.at
        rows = self.table(count, width, what)
        bad = np.flatnonzero((rows != np.floor(rows)).ravel() | (np.abs(rows.ravel()) > 2**53))
        if bad.size:
            word, line = self.words[first + int(bad[0])]
            raise self.source.fault(f"a number of {what} must be a whole number, got {shown(word)}", line)
        return rows.astype(np.int64)


def _words(source: Source) -> Iterator[tuple[str, int]]:
    for line, text in enumerate(source.lines, 1):
        for word in text.partition("#")[0].split():
            yield word, line


def read(source: Source) -> RawMesh:
    """Read a MEDIT text mesh; references other than 0 become groups ``ref_3``, by kind.

    :raises InputError: solids, second-order cells, unknown keywords, counts that do not agree.
    """
    words = _Words(source)
    if not words.words or not words.words[0][0].lower().startswith("meshversionformatted"):
        first = words.words[0][0] if words.words else ""
        raise source.fault(
            f"MeshVersionFormatted is expected first, got {shown(first)}; other .mesh files are not read"
        )
    words.at = 1 if words.words[0][0].lower() == "meshversionformatted" else 0
    if words.at == 1:
        words.whole("the version")
    else:
        words.at = 1
    dimension = 3
    raw = RawMesh(np.empty((0, 3)))
    references: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    left_out = []
    while words.at < len(words.words):
        word, line = words.words[words.at]
        words.at += 1
        key = word.lower()
        if key == "end":
            break
        if key == "dimension":
            dimension = words.whole("the dimension")
            if dimension not in (2, 3):
                raise source.fault(f"the dimension is {dimension}, 2 or 3 are read", line)
            continue
        if key == "vertices":
            rows = words.table(words.whole("the number of vertices"), dimension + 1, "vertices")
            raw.points = np.column_stack((rows[:, :dimension], np.zeros((len(rows), 3 - dimension))))
            references = rows[:, -1].astype(np.int64)
        elif key in _CELLS:
            kind, corners = _CELLS[key]
            numbers = words.numbers(words.whole(f"the number of {word}"), corners + 1, word)
            cells = np.array(raw.add_cells(kind, numbers[:, :-1] - 1), dtype=np.int64)
            raw.group_by_value("ref", numbers[:, -1], cells, skip=0)
        elif key in _SOLIDS or key in _SECOND_ORDER:
            width = {**_SOLIDS, **_SECOND_ORDER}[key] + 1
            if len(words.table(words.whole(f"the number of {word}"), width, word)):
                raise source.fault(f"{word}: {SOLID if key in _SOLIDS else SECOND_ORDER}", line)
        elif key in _OTHER and key not in _SKIPPED:
            width = dimension if _OTHER[key] == "d" else int(_OTHER[key])
            count = len(words.table(words.whole(f"the number of {word}"), width, word))
            left_out += [f"{word} ({count}, line {line})"] if count else []
        else:
            raise source.fault(f"the keyword {shown(word)} is not one that is read", line)
    for value in np.unique(references[references != 0]).tolist():
        raw.group_points(f"ref_{value}", np.flatnonzero(references == value))
    _check_numbers(source, raw)
    if left_out:
        raw.notes.append(f"not carried over: {', '.join(left_out)}")
    if re.search(r"\bEnd\b", source.text, re.IGNORECASE) is None:
        raw.notes.append("the file has no End; all that was announced is there")
    return raw


def _check_numbers(source: Source, raw: RawMesh) -> None:
    for block in raw.cells:
        if block.nodes.size and (block.nodes.min() < 0 or block.nodes.max() >= len(raw.points)):
            bad = block.nodes.min() if block.nodes.min() < 0 else block.nodes.max()
            told = f"a {block.kind} uses vertex {bad + 1}; the file has {several(len(raw.points), 'vertex', 'vertices')}, from 1"
            raise source.fault(told)
