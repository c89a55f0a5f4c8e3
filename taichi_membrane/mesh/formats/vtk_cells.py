"""What VTK's files, old and XML, have in common: cell types, and arrays of whole numbers that become groups."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import CORNERS, SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, several

Ints = NDArray[np.int64]
GROUP, LINES = "group:", "lines:"  # begin the names of 0/1 arrays that mark members; quoted as in URLs
WARP = "warp"
WIDEST = 9  # components of an array that is kept: those of a tensor
_KINDS: dict[int, CellKind] = {1: "vertex", 3: "line", 5: "triangle", 9: "quad", 21: "line3", 22: "triangle6"}
_MANY: dict[int, str] = {2: "vertex", 4: "line", 6: "strip", 7: "polygon", 8: "pixel"}
_SOLIDS = (10, 11, 12, 13, 14, 15, 16, 24, 25, 26, 27, 29, 32, 33, 41, 42)
_NUMBERING = frozenset(
    ("GlobalIds", "GlobalElementId", "GlobalNodeId", "vtkOriginalCellIds", "vtkOriginalPointIds", "vtkGhostType")
)


def add_cells(source: Source, raw: RawMesh, types: Ints, starts: Ints, ends: Ints, nodes: Ints) -> Ints:
    """Append cells in the order of the file.

    :param starts, ends: where the corners of each cell begin and end in ``nodes``.
    :returns: the file's cell that each cell comes from: a polyline is several lines.
    :raises InputError: solid and second-order cells, polygons, cells whose number of corners is not their type's.
    """
    count = ends - starts
    if (count < 0).any() or (starts < 0).any() or (ends > len(nodes)).any():
        raise source.fault(f"the cells reach beyond the {several(len(nodes), 'node number')} of the file")
    origin: list[Ints] = []
    edges = np.flatnonzero(np.diff(types)) + 1
    for begin, end in zip([0, *edges.tolist()], [*edges.tolist(), len(types)], strict=True):
        if begin == end:
            continue
        kind, rows = _block(source, int(types[begin]), begin, count[begin:end], starts[begin:end], nodes)
        for name, corners, cells in _runs(kind, rows, begin):
            raw.add_cells(name, corners)
            origin.append(cells)
    return np.concatenate(origin) if origin else np.empty(0, dtype=np.int64)


def _block(
    source: Source, number: int, first: int, count: Ints, starts: Ints, nodes: Ints
) -> tuple[str, list[Ints] | Ints]:
    """The corners of cells of one type, as an array where they have equal numbers of corners."""
    if number in _SOLIDS:
        raise source.fault(f"cell {first} is of VTK's type {number}: {SOLID}")
    if number not in _KINDS and number not in _MANY:
        raise source.fault(f"cell {first} is of VTK's type {number}: {SECOND_ORDER}")
    kind = _KINDS.get(number) or _MANY[number]
    if number in _KINDS:
        corners = CORNERS[_KINDS[number]]
        bad = np.flatnonzero(count != corners)
        if bad.size:
            raise source.fault(
                f"cell {first + bad[0]} is a {kind} with {several(int(count[bad[0]]), 'node')}, {corners} are needed"
            )
        return kind, nodes[starts[:, None] + np.arange(corners)]
    if kind == "strip":
        raise source.fault(f"cell {first} is a triangle strip: save triangles")
    odd = np.flatnonzero(~np.isin(count, (3, 4)))
    if kind == "polygon" and odd.size:
        told = several(int(count[odd[0]]), "corner")
        raise source.fault(f"cell {first + odd[0]} is a polygon of {told}, 3 or 4 are read: triangulate the mesh")
    if kind == "pixel" and (count != 4).any():
        raise source.fault(f"cell {first} is a pixel without four corners")
    return kind, [nodes[a : a + n] for a, n in zip(starts.tolist(), count.tolist(), strict=True)]


def _runs(kind: str, rows: list[Ints] | Ints, first: int) -> list[tuple[CellKind, Ints, Ints]]:
    """Cells as (kind, corners, cell of the file), in order."""
    if isinstance(rows, np.ndarray):
        return [(kind, rows, first + np.arange(len(rows)))]  # type: ignore[list-item]
    found: list[tuple[CellKind, Ints, Ints]] = []
    for number, corners in enumerate(rows, first):
        if kind == "vertex":
            new: tuple[CellKind, Ints] = ("vertex", corners[:, None])
        elif kind == "line":
            new = ("line", np.column_stack((corners[:-1], corners[1:])))
        elif kind == "pixel":
            new = ("quad", corners[[0, 1, 3, 2]][None])
        else:
            new = ("triangle" if len(corners) == 3 else "quad", corners[None])
        found.append((*new, np.full(len(new[1]), number)))
    return found


def name_groups(
    raw: RawMesh,
    origin: Ints,
    cell_data: Mapping[str, NDArray[np.generic]],
    point_data: Mapping[str, NDArray[np.generic]],
) -> None:
    """Whole numbers of cells as groups, our own marks as the groups they mark, other numbers as fields; what is not carried over.

    A mark is a 0/1 array whose name begins with ``group:``, as this program writes it; any other array of whole numbers gives a
    group for each value.
    """
    left_out = []
    ghosts = [values for name, values in cell_data.items() if name in ("vtkGhostType", "vtkGhostLevels")]
    ghost_count = sum(int((values != 0).sum()) for values in ghosts)
    if ghost_count:
        raw.notes.append(
            f"{several(ghost_count, 'cell')} of {len(origin)} marked as ghosts (vtkGhostType): read like others"
        )
    for name, values in cell_data.items():
        if name.startswith((GROUP, LINES)) and values.ndim == 1:
            own = unquote(name.partition(":")[2])
            if own != "all":
                raw.group_cells(own, np.flatnonzero(values[origin] != 0))
        elif name == WARP and values.shape[1:] == (3,) and values.dtype.kind == "f":
            raw.tri_warp = values[origin].astype(np.float64)
        elif name in _NUMBERING:
            continue
        elif values.ndim == 1 and values.dtype.kind in "iub":
            raw.group_by_value(name, values[origin].astype(np.int64), np.arange(len(origin)))
        elif values.dtype.kind in "iuf" and values.ndim <= 2 and 0 < values[:1].size <= WIDEST:
            raw.cell_fields[name] = values[origin].astype(np.float64)
        else:
            left_out.append(f"'{name}' of cells")
    for name, values in point_data.items():
        if name.startswith(GROUP) and values.ndim == 1:
            own = unquote(name.removeprefix(GROUP))
            if own not in ("all", "boundary"):
                raw.group_points(own, np.flatnonzero(values != 0))
        elif name not in _NUMBERING:
            left_out.append(f"'{name}' of points")
    if left_out:
        raw.notes.append(f"not carried over: {', '.join(left_out[:12])}" + (" …" if len(left_out) > 12 else ""))
