"""Writes meshes in formats that are read back the same: .vtu, .inp, .msh, .stl."""

from __future__ import annotations

import base64
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh.formats.vtk_cells import GROUP, WARP

if TYPE_CHECKING:
    from taichi_membrane.mesh.surface import Mesh

_GIVEN = ("all", "boundary")  # groups that every mesh gets when it is built
_VTK = {"i1": "Int8", "u1": "UInt8", "i8": "Int64", "f8": "Float64"}


def write(mesh: Mesh, path: Path) -> None:
    """Write a mesh as the file's extension says.

    :raises InputError: another extension, something the format cannot say, or a file that cannot be written.
    """
    writers: dict[str, Callable[[Mesh, Path], bytes]] = {".vtu": _vtu, ".inp": _inp, ".msh": _msh, ".stl": _stl}
    if path.suffix.lower() not in writers:
        raise InputError(
            f"{path}: the file extension '{path.suffix}' is not one that is written; allowed: {', '.join(writers)}"
        )
    if mesh.order == 2:
        raise InputError(f"{path}: meshes of six-node triangles cannot be written")
    content = writers[path.suffix.lower()](mesh, path)
    partial = path.with_name(f"{path.name}.partial")
    try:
        partial.write_bytes(content)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"{path}: the mesh cannot be written: {error.strerror or error}") from None


def _all_points(mesh: Mesh) -> NDArray[np.float64]:
    return np.concatenate((mesh.points, mesh.loose_points))


def _node_groups(mesh: Mesh, *, derived: bool = False) -> dict[str, NDArray[np.int32]]:
    """Groups of nodes that reading would not make by itself; nodes of triangles and loose points together.

    :param derived: also those that a group of triangles or lines of the same name would give.
    """
    found: dict[str, NDArray[np.int32]] = {}
    for name in dict.fromkeys([*mesh.node_groups, *mesh.loose_groups]):
        parts = [groups[name] for groups in (mesh.node_groups, mesh.loose_groups) if name in groups]
        members = np.unique(np.concatenate(parts))
        if name in _GIVEN and name not in mesh.loose_groups and np.array_equal(members, _given(mesh, name)):
            continue
        if derived or not np.array_equal(members, _nodes_of(mesh, name)):
            found[name] = members
    return found


def _given(mesh: Mesh, name: str) -> NDArray[np.int32]:
    return np.arange(mesh.node_count, dtype=np.int32) if name == "all" else np.unique(mesh.boundary_edges())


def _nodes_of(mesh: Mesh, name: str) -> NDArray[np.int32]:
    """Nodes of the lines of a name, else of the triangles: what reading takes as its node group."""
    lines = mesh.lines[mesh.line_groups[name]] if name in mesh.line_groups else np.empty((0, 2), dtype=np.int32)
    triangles = mesh.triangles[mesh.tri_groups[name]] if name in mesh.tri_groups else np.empty((0, 3), dtype=np.int32)
    return np.unique(lines if lines.size else triangles)


def _tri_groups(mesh: Mesh) -> dict[str, NDArray[np.int32]]:
    return {name: members for name, members in mesh.tri_groups.items() if name != "all"}


def _printable(path: Path, names: Iterable[str], forbidden: str) -> None:
    """Refuse names that the format cannot hold."""
    for name in names:
        bad = next((c for c in name if c in forbidden or not c.isprintable()), None)
        if bad is not None or name != name.strip():
            what = "begins or ends with a blank" if bad is None else f"holds {bad!r}"
            raise InputError(f"{path}: the group name {name!r} {what}, which '{path.suffix}' cannot say; .vtu can")


def _no_fields(mesh: Mesh, path: Path) -> None:
    """Refuse what differs from element to element, but for groups."""
    held = ["the warp directions of the elements"] if mesh.tri_warp is not None else []
    held += [f"the element data {', '.join(map(repr, mesh.tri_fields))}"] if mesh.tri_fields else []
    if held:
        raise InputError(f"{path}: '{path.suffix}' cannot say {' and '.join(held)}; .vtu can")


def _vtu(mesh: Mesh, path: Path) -> bytes:
    """Binary, uncompressed, every group a 0/1 array; lines follow the triangles."""
    triangles, lines = len(mesh.triangles), len(mesh.lines)
    cells = triangles + lines
    ends = np.concatenate((3 * np.arange(1, triangles + 1), 3 * triangles + 2 * np.arange(1, lines + 1)))
    marks: dict[str, NDArray[Any]] = {}
    names = dict.fromkeys([*_tri_groups(mesh), *mesh.line_groups])
    for name in names:
        mark = np.zeros(cells, dtype=np.int8)
        mark[mesh.tri_groups.get(name, [])] = 1
        mark[triangles + np.asarray(mesh.line_groups.get(name, []), dtype=np.int64)] = 1
        marks[GROUP + quote(name)] = mark
    if mesh.tri_warp is not None:
        marks[WARP] = np.concatenate((mesh.tri_warp, np.zeros((lines, 3))))
    for name, values in mesh.tri_fields.items():
        marks[name] = np.concatenate((values, np.zeros((lines, *values.shape[1:]))))
    points = _all_points(mesh)
    node_marks: dict[str, NDArray[Any]] = {}
    for name, members in _node_groups(mesh, derived=True).items():
        node_marks[GROUP + quote(name)] = np.isin(np.arange(len(points)), members).astype(np.int8)
    connectivity = np.concatenate((mesh.triangles.ravel(), mesh.lines.ravel())).astype(np.int64)
    types = np.concatenate((np.full(triangles, 5), np.full(lines, 3))).astype(np.uint8)
    text = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(points)}" NumberOfCells="{cells}">',
        *("<Points>", _array("Points", points), "</Points>"),
        *("<Cells>", _array("connectivity", connectivity), _array("offsets", ends.astype(np.int64))),
        *(_array("types", types), "</Cells>"),
        *("<PointData>", *(_array(name, mark) for name, mark in node_marks.items()), "</PointData>"),
        *("<CellData>", *(_array(name, mark) for name, mark in marks.items()), "</CellData>"),
        "</Piece></UnstructuredGrid></VTKFile>",
    ]
    return "\n".join(text).encode() + b"\n"


def _array(name: str, values: NDArray[Any]) -> str:
    data = np.ascontiguousarray(values)
    data = data.astype(data.dtype.newbyteorder("<"))
    head = np.array([data.nbytes], dtype="<u8").tobytes()
    width = f' NumberOfComponents="{data.shape[1]}"' if data.ndim == 2 else ""
    kind = _VTK[f"{data.dtype.kind}{data.dtype.itemsize}"]
    encoded = base64.b64encode(head + data.tobytes()).decode()
    from xml.sax.saxutils import quoteattr  # here, not above: it brings the network's modules with it

    return f'<DataArray type="{kind}" Name={quoteattr(name)}{width} format="binary">{encoded}</DataArray>'


def _inp(mesh: Mesh, path: Path) -> bytes:
    """Abaqus: nodes and elements from 1, triangles before lines, sets of both."""
    _no_fields(mesh, path)
    elements = dict.fromkeys([*_tri_groups(mesh), *mesh.line_groups])
    nodes = _node_groups(mesh)
    for names in (nodes, elements):
        _printable(path, names, '",')
        folded: dict[str, str] = {}
        for name in names:
            if folded.setdefault(name.upper(), name) != name:
                told = f"the groups {folded[name.upper()]!r} and {name!r} differ in capitals alone"
                raise InputError(f"{path}: {told}, which '{path.suffix}' cannot say; .vtu can")
    text = ["*NODE"]
    text += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in enumerate(_all_points(mesh).tolist(), 1)]
    text += ["*ELEMENT, TYPE=M3D3"]
    text += [f"{n}, {a}, {b}, {c}" for n, (a, b, c) in enumerate((mesh.triangles + 1).tolist(), 1)]
    if len(mesh.lines):
        first = mesh.tri_count + 1
        text += [
            "*ELEMENT, TYPE=T3D2",
            *(f"{n}, {a}, {b}" for n, (a, b) in enumerate((mesh.lines + 1).tolist(), first)),
        ]
    for name, members in nodes.items():
        text += [f'*NSET, NSET="{name}"', *_rows(members + 1)]
    for name in elements:
        lines = mesh.line_groups.get(name, np.empty(0, dtype=np.int32))
        members = np.concatenate((mesh.tri_groups.get(name, np.empty(0, dtype=np.int32)), lines + mesh.tri_count))
        text += [f'*ELSET, ELSET="{name}"', *_rows(members + 1)]
    return ("\n".join(text) + "\n").encode()


def _rows(numbers: NDArray[Any]) -> list[str]:
    held = [str(number) for number in numbers.tolist()]
    return [", ".join(held[at : at + 16]) for at in range(0, len(held), 16)]


def _msh(mesh: Mesh, path: Path) -> bytes:
    """Gmsh 2.2 in text: an element of several groups stands once for each, as gmsh writes it; points name loose nodes."""
    _no_fields(mesh, path)
    kinds: list[tuple[int, int, NDArray[np.int32], Mapping[str, NDArray[np.int32]]]] = [
        (2, 2, mesh.triangles, _tri_groups(mesh)),
        (1, 1, mesh.lines, mesh.line_groups),
        (0, 15, np.arange(len(_all_points(mesh)), dtype=np.int32)[:, None], _node_groups(mesh)),
    ]
    names, rows, number = [], [], 0
    for dimension, kind, corners, groups in kinds:
        _printable(path, groups, '"')
        tags: list[list[int]] = [[] for _ in range(len(corners))]
        for tag, (name, members) in enumerate(groups.items(), 1):
            names.append(f'{dimension} {tag} "{name}"')
            for member in members.tolist():
                tags[member].append(tag)
        for nodes, own in zip((corners + 1).tolist(), tags, strict=True):
            for tag in own or ([0] if dimension else []):
                number += 1
                rows.append(f"{number} {kind} 2 {tag} 1 {' '.join(map(str, nodes))}")
    points = [f"{n} {x!r} {y!r} {z!r}" for n, (x, y, z) in enumerate(_all_points(mesh).tolist(), 1)]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    text += ["$Nodes", str(len(points)), *points, "$EndNodes", "$Elements", str(len(rows)), *rows, "$EndElements"]
    return ("\n".join(text) + "\n").encode()


def _stl(mesh: Mesh, path: Path) -> bytes:
    """Binary, in single precision: for bare surfaces, whose coordinates lose their last digits."""
    held = [*_node_groups(mesh, derived=True), *_tri_groups(mesh), *mesh.line_groups]
    _no_fields(mesh, path)
    if held or len(mesh.lines):
        raise InputError(
            f"{path}: '.stl' cannot say groups and lines ({', '.join(dict.fromkeys(held)) or 'lines'}); .vtu, .inp and .msh can"
        )
    facets = np.zeros(mesh.tri_count, dtype=[("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    facets["normal"] = mesh.tri_normals()
    facets["corners"] = mesh.points[mesh.triangles]
    return b"triangle mesh".ljust(80) + np.array([mesh.tri_count], dtype="<u4").tobytes() + facets.tobytes()
