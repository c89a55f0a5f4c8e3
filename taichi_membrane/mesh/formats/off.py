"""OFF in its spellings: with normals, colours and texture, counts on the first line or the next, with or without the word."""

from __future__ import annotations

import re

import numpy as np

from taichi_membrane.mesh.formats.raw import CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown

_HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF", re.IGNORECASE)
_KINDS: dict[int, CellKind] = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}


def read(source: Source) -> RawMesh:
    """Read an OFF file.

    :raises InputError: other dimensions, binary, polygons, counts that do not agree.
    """
    rows = [(text.partition("#")[0].split(), line) for line, text in enumerate(source.lines, 1)]
    rows = [(words, line) for words, line in rows if words]
    if not rows:
        raise source.fault("the file is empty")
    words, line = rows[0]
    at, extra = 0, 0
    match = _HEADER.fullmatch(words[0])
    if match:
        if match[4] or match[5] or "n" in words[0]:
            raise source.fault(f"{words[0]}: points of other than three dimensions are not read", line)
        if "BINARY" in (word.upper() for word in words[1:]):
            raise source.fault("binary OFF is not read: save it as text", line)
        extra = 3 * bool(match[3]) + 2 * bool(match[1])
        words = words[1:]
        if not words:
            at = 1
            words, line = rows[1] if len(rows) > 1 else ([], line)
    elif not words[0].isdigit():
        raise source.fault(f"OFF, COFF, NOFF, STOFF or two counts are expected, got {shown(words[0])}", line)
    if len(words) not in (2, 3):
        raise source.fault(f"the numbers of vertices, faces and edges are expected, got {shown(' '.join(words))}", line)
    counts = [source.whole(word, line, "a count") for word in words]
    body = rows[at + 1 :]
    if min(counts) < 0 or len(body) != counts[0] + counts[1]:
        raise source.fault(
            f"{several(counts[0], 'vertex', 'vertices')} and {several(counts[1], 'face')} are announced, and "
            f"{several(len(body), 'line')} follow",
            line,
        )
    return _mesh(source, body[: counts[0]], body[counts[0] :], extra, bool(match and match[2]))


def _mesh(
    source: Source,
    vertices: list[tuple[list[str], int]],
    faces: list[tuple[list[str], int]],
    extra: int,
    coloured: bool,
) -> RawMesh:
    points = []
    for words, line in vertices:
        most = 3 + extra + (4 if coloured else 0)
        if not 3 + extra <= len(words) <= most:
            told = f"{3 + extra}" if most == 3 + extra else f"{3 + extra} to {most}"
            raise source.fault(f"a vertex has {several(len(words), 'number')}, {told} are expected", line)
        points.append([source.real(word, line, "a coordinate") for word in words[:3]])
    raw = RawMesh(np.array(points, dtype=np.float64).reshape(-1, 3))
    rows, colours = [], 0
    for words, line in faces:
        count = source.whole(words[0], line, "the number of corners")
        if count not in _KINDS:
            raise source.fault(f"a face has {several(count, 'corner')}, 3 or 4 are read: triangulate the mesh", line)
        if len(words) - 1 - count not in (0, 1, 3, 4):
            raise source.fault(f"a face of {count} corners has {several(len(words) - 1, 'number')} and no colour", line)
        nodes = [source.whole(word, line, "a vertex number") for word in words[1 : 1 + count]]
        if min(nodes) < 0 or max(nodes) >= len(points):
            raise source.fault(
                f"a face uses vertex {max(nodes) if min(nodes) >= 0 else min(nodes)} of {len(points)}, from 0", line
            )
        colours += len(words) - 1 > count
        rows.append((_KINDS[count], nodes))
    raw.add_rows(rows)
    raw.cell_name = lambda cell: f"face {cell} (line {faces[cell][1]})"
    few = sum(len(nodes) < 3 for _, nodes in rows)
    if few:
        raw.notes.append(f"{several(few, 'face')} of one or two corners are points or lines, no triangles")
    if extra or any(len(words) > 3 for words, _ in vertices):
        raw.notes.append("not carried over: normals, colours or texture of the vertices")
    if colours:
        raw.notes.append(f"not carried over: the colour of {several(colours, 'face')}")
    return raw
