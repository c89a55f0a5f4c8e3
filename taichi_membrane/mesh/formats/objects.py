"""Meshes of other libraries: meshio, trimesh and pyvista objects, told by what they have; none of them is imported here."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh.formats.raw import CORNERS, SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import listed, shown
from taichi_membrane.mesh.formats.vtk_cells import name_groups

_SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")
_DIMENSION = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "line3": 1, "triangle6": 2}
# Arrays of meshio that hold what a format calls group, reference or family; gmsh's other numbers are its geometry's.
_PHYSICAL = "gmsh:physical"
_SHORT = {
    "medit:ref": "ref",
    "su2:tag": "tag",
    "flac3d:group": "group",
    "avsucd:material": "material",
    "nastran:ref": "pid",
    "netgen:index": "index",
}


def from_object(thing: Any, where: str) -> RawMesh:
    """The content of a mesh object of meshio, trimesh or pyvista.

    :raises InputError: it is none of them, or holds cells that have no place in a mesh of triangles.
    """
    if hasattr(thing, "cells") and hasattr(thing, "points") and hasattr(thing, "cell_sets"):
        return from_meshio(thing, where)
    if hasattr(thing, "vertices") and hasattr(thing, "faces"):
        return _from_trimesh(thing, where)
    if hasattr(thing, "cast_to_unstructured_grid") and hasattr(thing, "points"):
        return _from_pyvista(thing, where)
    raise InputError(
        f"{where}: {type(thing).__module__}.{type(thing).__name__} is no mesh of meshio, trimesh or pyvista"
    )


def from_meshio(mesh: Any, where: str) -> RawMesh:
    """Points, cells, point sets, cell sets, and arrays of whole numbers of a ``meshio.Mesh``."""
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack((points, np.zeros(len(points))))
    raw = RawMesh(points)
    numbers: list[NDArray[np.int64]] = []
    for block in mesh.cells:
        kind, data = block.type, np.asarray(block.data)
        if kind not in CORNERS:
            if not len(data):
                numbers.append(np.empty(0, dtype=np.int64))
                continue
            reason = SOLID if kind.startswith(_SOLIDS) else SECOND_ORDER
            raise InputError(f"{where}: the file holds {len(data)} {kind} cells: {reason}")
        if data.ndim != 2 or data.shape[1] != CORNERS[kind]:
            raise InputError(
                f"{where}: damaged: {kind} cells of shape {data.shape}, {CORNERS[kind]} node numbers each are expected"
            )
        numbers.append(np.array(raw.add_cells(kind, data), dtype=np.int64))
    for name, members in mesh.point_sets.items():
        raw.group_points(name, _within(members, len(points), f"{where}: node group '{name}'"))
    for name, sets in mesh.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        held = [
            own[_within(s, len(own), f"{where}: group '{name}'")]
            for own, s in zip(numbers, sets, strict=False)
            if s is not None
        ]
        raw.group_cells(name, np.concatenate([np.empty(0, dtype=np.int64), *held]))
    _tagged(raw, mesh, numbers)
    return raw


def _within(members: Any, count: int, what: str) -> NDArray[np.int64]:
    array = np.asarray(members, dtype=np.int64).ravel()
    if array.size and (array.min() < 0 or array.max() >= count):
        raise InputError(
            f"{what} holds {array.min() if array.min() < 0 else array.max()}, numbers run from 0 to {count - 1}"
        )
    return array


def _tagged(raw: RawMesh, mesh: Any, numbers: list[NDArray[np.int64]]) -> None:
    """Cell arrays as groups. Names of physical groups and of MED's families stand beside the arrays."""
    kinds = [block.type for block in mesh.cells]
    named = {(int(np.ravel(v)[0]), int(np.ravel(v)[1])): k for k, v in mesh.field_data.items() if np.size(v) == 2}
    families: dict[int, list[str]] = getattr(mesh, "cell_tags", {})
    cells: dict[str, list[NDArray[Any]]] = {}
    for name, arrays in mesh.cell_data.items():
        values = [np.asarray(array) for array in arrays]
        if name == _PHYSICAL:
            for kind, own, tags in zip(kinds, numbers, values, strict=True):
                for tag in np.unique(tags[tags != 0]).tolist():
                    raw.group_cells(named.get((tag, _DIMENSION[kind]), f"physical_{tag}"), own[tags == tag])
        elif name == "cell_tags" and families:
            for label in sorted({label for labels in families.values() for label in labels}):
                holding = [number for number, labels in families.items() if label in labels]
                for dimension in range(3):  # groups of edges and of faces may share a name
                    held = [
                        own[np.isin(tags, holding)]
                        for kind, own, tags in zip(kinds, numbers, values, strict=True)
                        if _DIMENSION[kind] == dimension
                    ]
                    if any(len(part) for part in held):
                        raw.group_cells(label, np.concatenate(held))
        elif not name.startswith("gmsh:"):
            cells[_SHORT.get(name, name)] = values
    points = {name: np.asarray(values) for name, values in mesh.point_data.items()}
    point_families: dict[int, list[str]] = getattr(mesh, "point_tags", {})
    if "point_tags" in points and point_families:
        tags = points.pop("point_tags")
        for label in sorted({label for labels in point_families.values() for label in labels}):
            raw.group_points(
                label, np.flatnonzero(np.isin(tags, [n for n, labels in point_families.items() if label in labels]))
            )
    order = np.concatenate([np.empty(0, dtype=np.int64), *numbers])
    joined_data = {name: np.concatenate(values) for name, values in cells.items() if len({v.ndim for v in values}) == 1}
    lost = [name for name in cells if name not in joined_data]
    if lost:
        raw.notes.append(f"not carried over: {listed(lost)}")
    points = {name: values for name, values in points.items() if not name.startswith("gmsh:") and name != "point_tags"}
    name_groups(
        raw,
        order,
        {name: values[np.argsort(order)] for name, values in joined_data.items() if len(values) == len(order)},
        points,
    )


def _from_trimesh(mesh: Any, where: str) -> RawMesh:
    raw = RawMesh(np.asarray(mesh.vertices, dtype=np.float64))
    faces = np.asarray(mesh.faces)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"{where}: faces of shape {faces.shape}, three vertices each are expected")
    raw.add_cells("triangle", faces)
    attributes = {str(name): np.asarray(values) for name, values in getattr(mesh, "face_attributes", {}).items()}
    kept = {name: values for name, values in attributes.items() if len(values) == len(faces)}
    name_groups(raw, np.arange(len(faces)), kept, {})
    return raw


def _from_pyvista(mesh: Any, where: str) -> RawMesh:
    grid = mesh.cast_to_unstructured_grid()
    raw = RawMesh(np.asarray(grid.points, dtype=np.float64))
    kinds: dict[int, CellKind] = {1: "vertex", 3: "line", 5: "triangle", 9: "quad"}
    types, flat = np.asarray(grid.celltypes), np.asarray(grid.cells)
    starts, at = np.asarray(grid.offset, dtype=np.int64), 0
    rows = []
    for number, (kind, begin, end) in enumerate(
        zip(types.tolist(), starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    ):
        nodes = flat[begin + number + 1 : end + number + 1].tolist()
        at += len(nodes)
        if kind not in kinds and not (kind == 7 and len(nodes) in (3, 4)):
            reason = SOLID if kind in (10, 11, 12, 13, 14) else SECOND_ORDER
            raise InputError(f"{where}: cell {number} is of VTK's type {shown(str(kind))}: {reason}")
        rows.append((kinds.get(kind) or ("triangle" if len(nodes) == 3 else "quad"), nodes))
    raw.add_rows(rows)
    cell_data = {name: np.asarray(grid.cell_data[name]) for name in grid.cell_data}
    point_data = {name: np.asarray(grid.point_data[name]) for name in grid.point_data}
    name_groups(raw, np.arange(len(rows)), cell_data, point_data)
    return raw
