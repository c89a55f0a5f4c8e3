"""Rhino models (.3dm): their meshes, layers and object names as groups; needs the package rhino3dm."""

from __future__ import annotations

from typing import Any

import numpy as np

from taichi_membrane.mesh.formats.raw import CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, listed


def read(source: Source) -> RawMesh:
    """Read the mesh objects of a Rhino model; corners at one place are one node.

    :raises InputError: no Rhino model, surfaces and solids that are no meshes, blocks.
    """
    import rhino3dm

    module: Any = rhino3dm  # its type stubs do not know what it takes
    model = module.File3dm.FromByteArray(source.data)
    if model is None:
        raise source.fault("this is no Rhino model, or one of a version that rhino3dm does not read")
    layers = {layer.Index: layer.FullPath or layer.Name for layer in model.Layers}
    points: list[list[float]] = []
    rows: list[tuple[CellKind, list[int]]] = []
    groups: dict[str, list[int]] = {}
    layer_names = set(layers.values())
    left_out: dict[str, int] = {}
    for item in model.Objects:
        geometry, attributes = item.Geometry, item.Attributes
        kind = str(geometry.ObjectType).rpartition(".")[2]
        if kind == "Mesh":
            first = len(rows)
            _add(geometry, points, rows)
            own = f"object_{attributes.Name}" if attributes.Name in layer_names else attributes.Name
            for name in (layers.get(attributes.LayerIndex, ""), own):
                if name:
                    groups.setdefault(name, []).extend(range(first, len(rows)))
        elif kind in ("Brep", "Extrusion", "Surface", "SubD", "InstanceReference"):
            raise source.fault(
                f"the model holds an object of kind {kind}: convert surfaces to meshes and explode blocks"
            )
        else:
            left_out[kind] = left_out.get(kind, 0) + 1
    raw = RawMesh(np.array(points, dtype=np.float64).reshape(-1, 3), welded=True)
    raw.add_rows(rows)
    for name, members in groups.items():
        raw.group_cells(name, members)
    unit = str(model.Settings.ModelUnitSystem).rpartition(".")[2]
    raw.notes.append(f"the model's unit is {unit}; its numbers are taken as they stand")
    if left_out:
        raw.notes.append(f"not carried over: {listed(f'{name} ({count})' for name, count in left_out.items())}")
    return raw


def _add(mesh: Any, points: list[list[float]], rows: list[tuple[CellKind, list[int]]]) -> None:
    first = len(points)
    points += [[vertex.X, vertex.Y, vertex.Z] for vertex in (mesh.Vertices[k] for k in range(len(mesh.Vertices)))]
    for number in range(mesh.Faces.Count):
        corners = list(mesh.Faces[number])
        if corners[3] == corners[2]:  # a triangle repeats its last corner
            rows.append(("triangle", [first + corner for corner in corners[:3]]))
        else:
            rows.append(("quad", [first + corner for corner in corners]))
