"""STL, text with any number of solids and binary; corners at exactly one place are one node."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown

_HEADER, _FACET = 84, 50  # bytes
_WORDS = {"solid", "facet", "outer", "vertex", "endloop", "endfacet", "endsolid"}
# Cosine between a facet's stored normal and the one of its corners below which they contradict each other.
_OPPOSED = -0.5


def read(source: Source) -> RawMesh:
    """Read an STL file; each solid is a group of elements.

    :raises InputError: a count that does not fit the file's size, damaged text.
    """
    data = source.data
    count = int.from_bytes(data[80:84], "little") if len(data) >= _HEADER else -1
    if count >= 0 and len(data) == _HEADER + _FACET * count:
        return _binary(source, count)
    if data.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid" and b"\0" not in data[: 2 * _HEADER]:
        return _text(source)
    if len(data) < _HEADER:
        raise source.fault(
            f"an STL file begins with 'solid' or a header of {_HEADER} bytes, this has {len(data)} bytes"
        )
    raise source.fault(
        f"{several(count, 'facet')} are announced, which takes {_HEADER + _FACET * count} bytes, and the file has {len(data)}"
    )


def _binary(source: Source, count: int) -> RawMesh:
    facets = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    held = np.frombuffer(source.data, dtype=facets, offset=_HEADER, count=count)
    raw = _soup(held["corners"].reshape(-1, 3).astype(np.float64), held["normal"].astype(np.float64))
    colours = int((held["colour"] != 0).sum())
    if colours:
        raw.notes.append(f"not carried over: the attribute (such as a colour) of {several(colours, 'facet')}")
    return raw


def _soup(points: NDArray[np.float64], normals: NDArray[np.float64]) -> RawMesh:
    """Triangles of corners that are nodes of their own until they are welded."""
    raw = RawMesh(points, welded=True)
    raw.add_cells("triangle", np.arange(len(points)).reshape(-1, 3))
    corners = points.reshape(-1, 3, 3)
    with np.errstate(all="ignore"):  # coordinates that are no numbers are refused later
        vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(vector, axis=1) * np.linalg.norm(normals, axis=1)
        opposed = int(((vector * normals).sum(axis=1) < _OPPOSED * length).sum())
    if opposed:
        raw.notes.append(
            f"the stored normal of {opposed} of {several(len(corners), 'facet')} contradicts their corners, which count"
        )
    return raw


def _text(source: Source) -> RawMesh:
    """Solids, each of facets of one loop of three vertices."""
    points: list[tuple[float, float, float]] = []
    normals: list[tuple[float, float, float]] = []
    solids: list[tuple[str, int]] = []
    facet_lines: list[int] = []
    state = "outside"  # then solid, facet, loop
    first = 0
    for line, text in enumerate(source.lines, 1):
        words = text.split()
        if not words:
            continue
        word = words[0].lower()
        if word not in _WORDS:
            raise source.fault(
                f"solid, facet, outer loop, vertex and their ends are expected, got {shown(text.strip())}", line
            )
        expected = {"solid": "outside", "facet": "solid", "outer": "facet", "vertex": "loop", "endloop": "loop"}
        expected |= {"endfacet": "facet", "endsolid": "solid"}
        if state != expected[word]:
            raise source.fault(f"{shown(text.strip())} does not belong here, in {_inside(state)}", line)
        match word:
            case "solid":
                state = "solid"
                solids.append((" ".join(text.split(None, 1)[1:]).strip(), len(points) // 3))
            case "facet":
                state, first = "facet", len(points)
                facet_lines.append(line)
                normals.append(_normal(words[2:]))
            case "outer":
                if len(points) > first:
                    raise source.fault("the facet has a second loop", line)
                state = "loop"
            case "vertex":
                points.append(_three(source, words[1:], line))
            case "endloop":
                state = "facet"
                if len(points) - first != 3:
                    raise source.fault(f"the facet has {len(points) - first} vertices, 3 are needed", line)
            case "endfacet":
                state = "solid"
                if len(points) == first:
                    raise source.fault("the facet has no loop", line)
            case "endsolid":
                state = "outside"
    if state != "outside":
        raise source.fault(f"the file ends in the middle of {_inside(state)}: it is cut off")
    raw = _soup(np.array(points, dtype=np.float64).reshape(-1, 3), np.array(normals, dtype=np.float64).reshape(-1, 3))
    raw.cell_name = lambda cell: f"facet {cell} (line {facet_lines[cell]})"
    _name_solids(raw, solids, len(points) // 3)
    return raw


def _inside(state: str) -> str:
    return {"outside": "no solid", "solid": "a solid", "facet": "a facet", "loop": "a loop"}[state]


def _normal(words: list[str]) -> tuple[float, float, float]:
    """A stored normal, which is compared and no more: zero where it is none, such as the "-nan(ind)" of facets without area."""
    try:
        x, y, z = map(float, words)
    except ValueError:
        return 0.0, 0.0, 0.0
    return x, y, z


def _three(source: Source, words: list[str], line: int) -> tuple[float, float, float]:
    if len(words) != 3:
        raise source.fault(f"three numbers are expected, got {shown(' '.join(words))}", line)
    x, y, z = (source.real(word, line, "a coordinate") for word in words)
    return x, y, z


def _name_solids(raw: RawMesh, solids: list[tuple[str, int]], total: int) -> None:
    """A group for each solid: of its name, with a number where several have it, or of its number where it has none."""
    ends = [begin for _, begin in solids[1:]] + [total]
    taken: set[str] = set()
    for number, ((name, begin), end) in enumerate(zip(solids, ends, strict=True), 1):
        own = name or f"solid_{number}"
        unique, repeat = own, 1
        while unique in taken:
            repeat += 1
            unique = f"{own}_{repeat}"
        taken.add(unique)
        if len(solids) > 1 or name:
            raw.group_cells(unique, np.arange(begin, end))
