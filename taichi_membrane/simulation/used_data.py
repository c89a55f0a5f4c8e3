"""Which element data of its mesh a run keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.check import frozen
from taichi_membrane.scene import ElementField, Scene, WarpSource, WindLoad
from taichi_membrane.simulation.groups import fabric_list
from taichi_membrane.simulation.warp import ALONG, along


def with_used_data(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with the element data that the scene uses, and no others, so that a run neither keeps nor writes them.

    Warp directions along a group of lines are among them: a run's files have no lines to go on from.
    """
    used = set(_named(scene))
    kept = {name: values for name, values in mesh.tri_fields.items() if name in used or name.startswith(ALONG)}
    unused = [name for name in mesh.tri_fields if name not in kept]
    for _, fabric in fabric_list(scene):
        line = fabric.warp.along if isinstance(fabric.warp, WarpSource) else None
        if line is not None and line in mesh.line_groups:
            kept[ALONG + line] = frozen(along(mesh, line, np.arange(mesh.tri_count), "warp.along"))
    if kept.keys() == mesh.tri_fields.keys():
        return mesh
    told = (f"element data not used by the scene: {', '.join(unused)}",) if unused else ()
    out = replace(mesh, tri_fields=kept, notes=(*mesh.notes, *told))
    out.__dict__["_edges"] = mesh.edge_table  # same triangles: no need to sort them again
    return out


def _named(scene: Scene) -> list[str]:
    """Names of all arrays that a scene takes values from."""
    found: list[str] = []
    for _, fabric in fabric_list(scene):
        for one in (fabric.thickness, fabric.given_prestress, fabric.warp):
            if isinstance(one, ElementField | WarpSource) and one.field is not None:
                found.append(one.field)
    found += [
        load.cp.field
        for load in scene.loads.values()
        if isinstance(load, WindLoad) and isinstance(load.cp, ElementField)
    ]
    return found
