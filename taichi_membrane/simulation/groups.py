"""Looking up the groups that a scene names, and the fabrics of element groups."""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Pressure, Scene


def fabric_list(scene: Scene) -> list[tuple[str, Fabric]]:
    """The scene's fabrics with the element group of each; the default fabric comes first, for all elements."""
    default = [("all", scene.fabric)] if scene.fabric is not None else []
    return [*default, *scene.fabrics.items()]


def group_nodes(mesh: Mesh, name: str, key: str) -> Ints:
    """Node numbers of a named group.

    :raises InputError: no such group; the message lists those that exist.
    """
    if name not in mesh.node_groups and name in mesh.loose_groups:
        raise InputError(f"{key}: node group {name!r} holds only points that no element uses; choose nodes of the mesh")
    if name not in mesh.node_groups:
        raise InputError(f"{key}: no node group {name!r} in this mesh; allowed: {', '.join(mesh.node_groups)}")
    return np.asarray(mesh.node_groups[name])


def group_triangles(mesh: Mesh, name: str, key: str) -> Ints:
    """Element numbers of a named group.

    :raises InputError: no such group; the message lists those that exist.
    """
    if name not in mesh.tri_groups:
        raise InputError(f"{key}: no element group {name!r} in this mesh; allowed: {', '.join(mesh.tri_groups)}")
    return np.asarray(mesh.tri_groups[name])


def pressed_triangles(mesh: Mesh, pressure: Pressure, key: str) -> tuple[Ints, Ints]:
    """Numbers of the triangles along whose normals a pressure acts, and of those against whose normals.

    :raises InputError: no such group.
    """
    found = []
    for names, entry in ((pressure.group, "group"), (pressure.against, "against")):
        listed = [names] if isinstance(names, str) else names
        members = [group_triangles(mesh, name, f"{key}.{entry}") for name in listed]
        found.append(np.unique(np.concatenate([np.empty(0, dtype=np.int32), *members])))
    return found[0], found[1]


def groups_at(mesh: Mesh, element: int) -> str:
    """Names of the element groups that an element belongs to, the one of all left out where there are others."""
    names = [name for name, members in mesh.tri_groups.items() if element in members]
    return "in " + (", ".join(name for name in names if name != "all") or "all")
