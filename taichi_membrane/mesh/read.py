"""Reads points, triangles and named groups from a mesh file with meshio."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import bounds
from taichi_membrane.errors import InputError, kind_of_path

# Reading a file may take this many bytes, and this many for each of its own: numbers as text become Python objects on the
# way, and vtu files hold compressed data. A header that claims more than the file can hold meets the bound.
_ROOM, _GROWTH = 1_000_000_000, 100
# Some readers of meshio (Fluent, Tecplot, WKT, PLY without the end of its header) never end on a damaged file; text takes about
# 1 s per megabyte.
_PATIENCE, _SECONDS_PER_BYTE = 30.0, 1e-5

# Dimension of the cells that are read; the triangles become elements, the others only name nodes.
_DIMENSION = {"vertex": 0, "line": 1, "triangle": 2}


@dataclass(frozen=True, eq=False)
class MeshParts:
    """What a file holds, before validation; nodes that no triangle uses are already dropped."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    node_groups: dict[str, NDArray[np.int64]]
    tri_groups: dict[str, NDArray[np.int64]]


def read_parts(path: Path) -> MeshParts:
    """Read a mesh file; see :func:`taichi_membrane.mesh.read_mesh`."""
    raw = _read_quietly(path)
    blocks = [(block.type, np.asarray(block.data)) for block in raw.cells]
    _refuse_other_cells(path, blocks)
    for kind, data in blocks:
        if kind == "triangle" and (data.ndim != 2 or data.shape[1] != 3):
            raise InputError(
                f"{path}: damaged: triangles of shape {data.shape}, but three node numbers each are expected"
            )
    triangles = _joined(data for kind, data in blocks if kind == "triangle").reshape(-1, 3)
    if not len(triangles):
        held = ", ".join(f"{len(data)} {kind}" for kind, data in blocks if len(data))
        raise InputError(f"{path}: the file holds no triangles" + (f", only {held} cells" if held else " and no cells"))
    points = np.asarray(raw.points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack((points, np.zeros(len(points))))
    if triangles.min() < 0 or triangles.max() >= len(points):
        bad = triangles.min() if triangles.min() < 0 else triangles.max()
        raise InputError(f"{path}: a triangle uses node {bad}, but node numbers run from 0 to {len(points) - 1}")
    tri_groups, node_groups = _groups(path, raw, blocks)
    used = np.unique(triangles)
    new_number = np.full(len(points), -1, dtype=np.int64)
    new_number[used] = np.arange(len(used))
    kept = {name: _renumbered(path, name, nodes, new_number) for name, nodes in node_groups.items()}
    triangles = new_number[triangles]
    for name, members in tri_groups.items():
        kept.setdefault(name, np.unique(triangles[members]))
    return MeshParts(points[used], triangles, kept, tri_groups)


def _read_quietly(path: Path) -> Any:
    import meshio  # here, not above: it takes a quarter of a second that most runs do not need

    kind = kind_of_path(path)
    if kind != "file":
        fault = "there is no such mesh file" if kind == "missing" else f"a mesh file is needed, this is a {kind}"
        raise InputError(f"{path}: {fault}")
    known = meshio.extension_to_filetypes
    if not any("".join(path.suffixes[-n:]).lower() in known for n in (1, 2)):
        raise InputError(
            f"{path}: the file extension '{path.suffix}' is unknown, meshio reads {', '.join(sorted(known))}"
        )
    size = path.stat().st_size
    seconds = _PATIENCE + _SECONDS_PER_BYTE * size
    short = bounds.shortage(size)
    if short is not None:
        raise InputError(f"{path}: a mesh file of {size} bytes {short}")
    said = io.StringIO()
    try:
        # meshio prints its complaints and may end the process with SystemExit.
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            bounds.at_most(_ROOM + _GROWTH * size),
            bounds.at_most_seconds(seconds),
        ):
            warnings.simplefilter("ignore")  # what is odd and matters is found below
            return meshio.read(path)
    except bounds.TooLong:
        raise InputError(
            f"{path}: the mesh cannot be read: its {size} bytes took more than {seconds:.3g} s; "
            "some readers never end on a damaged file"
        ) from None
    except MemoryError:
        raise InputError(
            f"{path}: the mesh cannot be read: its {size} bytes claim more than {(_ROOM + _GROWTH * size) / 1e9:.3g} GB of data"
        ) from None
    except (Exception, SystemExit) as error:
        told = f"{type(error).__name__}: {error}" if isinstance(error, Exception) else ""
        reason = " ".join(f"{said.getvalue()} {told}".split())
        raise InputError(f"{path}: the mesh cannot be read: {reason}") from None


def _refuse_other_cells(path: Path, blocks: list[tuple[str, NDArray[Any]]]) -> None:
    counts: dict[str, int] = {}
    for kind, data in blocks:
        if kind not in _DIMENSION and len(data):
            counts[kind] = counts.get(kind, 0) + len(data)
    if counts:
        held = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        raise InputError(
            f"{path}: the file holds {held} cells; a membrane needs plain triangles (lines and vertices may name nodes)"
        )


def _groups(
    path: Path, raw: Any, blocks: list[tuple[str, NDArray[Any]]]
) -> tuple[dict[str, NDArray[np.int64]], dict[str, NDArray[np.int64]]]:
    """Collect the named groups of triangles (element numbers) and of nodes (numbers as in the file)."""
    elements: dict[str, list[NDArray[Any]]] = {}
    nodes: dict[str, list[NDArray[Any]]] = {name: [np.asarray(held)] for name, held in raw.point_sets.items()}
    offset = 0
    for index, (kind, data) in enumerate(blocks):
        for name, members in _named_members(raw, index, kind):
            if not len(members):
                continue
            if members.min() < 0 or members.max() >= len(data):
                raise InputError(f"{path}: group '{name}' holds a {kind} beyond the {len(data)} of its block")
            if kind == "triangle":
                elements.setdefault(name, []).append(members + offset)
            else:
                nodes.setdefault(name, []).append(data[members].ravel())
        offset += len(data) if kind == "triangle" else 0
    return (
        {name: np.unique(_joined(held)) for name, held in elements.items()},
        {name: np.unique(_joined(held)) for name, held in nodes.items() if sum(map(len, held))},
    )


def _named_members(raw: Any, index: int, kind: str) -> Iterable[tuple[str, NDArray[np.int64]]]:
    """Yield name and member cells of one cell block: cell sets, then gmsh physical groups given as cell data."""
    for name, members in raw.cell_sets.items():
        if not name.startswith("gmsh:") and members[index] is not None:
            yield name, np.asarray(members[index], dtype=np.int64).ravel()
    physical = raw.cell_data.get("gmsh:physical")
    if physical is None:
        return
    for name, data in raw.field_data.items():
        pair = np.ravel(data)  # gmsh: number and dimension of the physical group; other formats keep other data here
        if pair.size == 2 and pair[1] == _DIMENSION[kind]:
            yield name, np.flatnonzero(np.asarray(physical[index]) == pair[0])


def _renumbered(path: Path, name: str, nodes: NDArray[np.int64], new_number: NDArray[np.int64]) -> NDArray[np.int64]:
    if nodes.min() < 0 or nodes.max() >= len(new_number):
        bad = nodes.min() if nodes.min() < 0 else nodes.max()
        raise InputError(f"{path}: node group '{name}' holds {bad}, but node numbers run to {len(new_number) - 1}")
    kept = new_number[nodes]
    if (kept < 0).all():
        raise InputError(f"{path}: node group '{name}' holds only nodes that no triangle uses ({len(nodes)} of them)")
    return kept[kept >= 0]


def _joined(arrays: Iterable[NDArray[Any]]) -> NDArray[np.int64]:
    held = list(arrays)
    return np.concatenate(held).astype(np.int64) if held else np.empty(0, dtype=np.int64)
