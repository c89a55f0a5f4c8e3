"""A scene's cables and planes on its mesh."""

from __future__ import annotations

import numpy as np

from taichi_membrane import mesh as meshes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Cables, Floats, Ints, Plane
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Cable, Scene
from taichi_membrane.simulation.groups import group_nodes


def with_member_nodes(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with the loose points that cables and rigid bodies use as nodes.

    :raises InputError: no such group of lines.
    """
    users = {f"cables.{name}": cable.lines for name, cable in scene.cables.items()}
    users |= {f"bodies.{name}": body.lines for name, body in scene.bodies.items()}
    for key, lines in users.items():
        if lines is not None:
            if lines not in mesh.line_groups:
                known = ", ".join(mesh.line_groups) or "(none)"
                raise InputError(f"{key}.lines: no group of lines {lines!r} in this mesh; allowed: {known}")
            mesh = meshes.with_line_nodes(mesh, lines)
    return mesh


def cables_of(scene: Scene, mesh: Mesh) -> Cables | None:
    """All cables of a scene, in its order; None where there are none.

    :raises InputError: unknown groups, a group that no edge lies in, two nodes at one place.
    """
    if not scene.cables:
        return None
    nodes, length, constants = [], [], []
    for name, cable in scene.cables.items():
        pairs, distance = cable_pairs(cable, mesh, f"cables.{name}")
        nodes.append(pairs)
        length.append(cable.unstressed * distance)
        constants.append(np.tile([cable.EA, cable.prestress, float(cable.kind == "bar")], (len(pairs), 1)))
    stiffness, prestress, bar = np.concatenate(constants).T
    return Cables(
        nodes=np.concatenate(nodes),
        length=np.concatenate(length),
        stiffness=stiffness,
        prestress=prestress,
        bar=bar > 0.0,
    )


def planes_of(scene: Scene, mesh: Mesh) -> tuple[Plane, ...]:
    """The planes of a scene.

    :raises InputError: unknown groups.
    """
    return tuple(
        Plane(
            normal=np.array(plane.normal) / np.linalg.norm(plane.normal),
            through=np.array(plane.through),
            nodes=group_nodes(mesh, plane.group, f"planes.{name}.group"),
        )
        for name, plane in scene.planes.items()
    )


def cable_pairs(cable: Cable, mesh: Mesh, key: str) -> tuple[Ints, Floats]:
    """(n, 2) nodes of a cable's elements, and their distances in the mesh.

    :raises InputError: unknown groups, a group that no edge lies in, two nodes at one place.
    """
    pairs = _pairs(cable, mesh, key)
    distance = np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1)
    short = np.flatnonzero(distance <= 0.0)
    if short.size:
        first, second = pairs[short[0]].tolist()
        raise InputError(f"{key}: nodes {first} and {second} lie at one place, {short.size} such pairs in all")
    return pairs, distance


def _pairs(cable: Cable, mesh: Mesh, key: str) -> Ints:
    """(n, 2) nodes of a cable's elements."""
    if cable.lines is not None:
        return np.asarray(mesh.lines[mesh.line_groups[cable.lines]])
    if cable.along is not None:
        member = np.zeros(mesh.node_count, dtype=bool)
        member[group_nodes(mesh, cable.along, f"{key}.along")] = True
        edges = mesh.edges()
        edges = edges[member[edges].all(axis=1)]
        if not len(edges):
            raise InputError(f"{key}.along: no mesh edge has both ends in this group of {member.sum()} nodes")
        return edges
    chain = []
    for name in cable.nodes or ():
        members = group_nodes(mesh, name, f"{key}.nodes")
        if len(members) != 1:
            raise InputError(f"{key}.nodes: group {name!r} holds {len(members)} nodes; each must hold one")
        chain.append(int(members[0]))
    return np.column_stack([chain[:-1], chain[1:]]).astype(np.int32)
