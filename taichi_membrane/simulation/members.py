"""A scene's cables and springs on its mesh."""

from __future__ import annotations

import numpy as np

from taichi_membrane import mesh as meshes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Cables, Floats, Ints, Ropes, Springs
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
            _check_lines(lines, mesh, f"{key}.lines")
            mesh = meshes.with_line_nodes(mesh, lines)
    return mesh


def with_cable_nodes(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with a node for each anchor and joint, and those that divide cables, in straight lines; in groups of their names.

    :raises InputError: unknown groups, or a name that is taken.
    """
    for table, points in (("anchors", scene.anchors), ("joints", scene.joints)):
        for name, place in points.items():
            mesh = _with_nodes(mesh, np.array([place]), name, f"{table}.{name}")
    for name, cable in scene.cables.items():
        if cable.parts > 1:
            chain = _chain(cable, mesh, f"cables.{name}")
            share = (np.arange(1, cable.parts) / cable.parts)[:, None]
            ends = zip(mesh.points[chain[:-1]], mesh.points[chain[1:]], strict=True)
            between = [first + share * (last - first) for first, last in ends]
            mesh = _with_nodes(mesh, np.concatenate(between), name, f"cables.{name}.parts")
    return mesh


def cables_of(scene: Scene, mesh: Mesh) -> Cables | None:
    """All cables of a scene whose elements have forces of their own, in its order; None where there are none.

    :raises InputError: unknown groups, a group that no edge lies in, two nodes at one place.
    """
    nodes, length, constants = [], [], []
    for name, cable in scene.cables.items():
        if not cable.sliding:
            pairs, unstressed = cable_elements(name, cable, mesh)
            nodes.append(pairs)
            length.append(unstressed)
            constants.append(np.tile([cable.EA, cable.prestress, float(cable.kind == "bar")], (len(pairs), 1)))
    if not nodes:
        return None
    stiffness, prestress, bar = np.concatenate(constants).T
    return Cables(
        nodes=np.concatenate(nodes),
        length=np.concatenate(length),
        stiffness=stiffness,
        prestress=prestress,
        bar=bar > 0.0,
    )


def ropes_of(scene: Scene, mesh: Mesh) -> Ropes | None:
    """All sliding cables of a scene, in its order; None where there are none.

    :raises InputError: unknown groups, one node twice or two nodes at one place.
    """
    chains, closed, constants = [], [], []
    for name, cable in scene.cables.items():
        if cable.sliding:
            chain = _chain(cable, mesh, f"cables.{name}")
            closed.append(bool(chain[0] == chain[-1]))
            chains.append(chain[:-1] if closed[-1] else chain)
            if len(np.unique(chains[-1])) < len(chains[-1]):
                raise InputError(
                    f"cables.{name}.nodes: two of its groups hold one node; a sliding cable passes each once"
                )
            unstressed = float(cable_elements(name, cable, mesh)[1].sum())
            constants.append([unstressed, cable.EA, cable.prestress])
    if not chains:
        return None
    length, stiffness, prestress = np.array(constants).T
    return Ropes(
        chain=np.concatenate(chains).astype(np.int32),
        start=np.concatenate([[0], np.cumsum([len(one) for one in chains])]),
        closed=np.array(closed),
        length=length,
        stiffness=stiffness,
        prestress=prestress,
    )


def line_elements(scene: Scene, mesh: Mesh) -> tuple[Ints, Ints]:
    """(n, 2) nodes of all straight pieces of cables, in the scene's order but those that slide last, and the number of each's cable
    in the scene."""
    order = sorted(enumerate(scene.cables.items()), key=lambda item: item[1][1].sliding)
    nodes: list[Ints] = [np.zeros((0, 2), dtype=np.int32)]
    owner: list[Ints] = [np.zeros(0, dtype=np.int32)]
    for number, (name, cable) in order:
        nodes.append(_pairs(name, cable, mesh))
        owner.append(np.full(len(nodes[-1]), number, dtype=np.int32))
    return np.concatenate(nodes), np.concatenate(owner)


def springs_of(scene: Scene, mesh: Mesh) -> Springs | None:
    """All springs of a scene; None where there are none.

    :raises InputError: unknown groups.
    """
    nodes, stiffness, direction, kind = [], [], [], []
    for name, spring in scene.springs.items():
        members = group_nodes(mesh, spring.group, f"springs.{name}.group")
        given = spring.stiffness
        ways = (
            [(k, axis) for k, axis in zip(given, np.eye(3), strict=True) if k > 0.0]
            if isinstance(given, tuple)
            else [(given, np.array(spring.direction) / np.linalg.norm(np.array(spring.direction)))]
        )
        for k, axis in ways:
            nodes.append(members)
            stiffness.append(np.full(len(members), k))
            direction.append(np.tile(axis, (len(members), 1)))
            kind.append(np.full(len(members), {"both": 0, "tension": 1, "compression": -1}[spring.kind]))
    if not nodes:
        return None
    return Springs(
        nodes=np.concatenate(nodes),
        stiffness=np.concatenate(stiffness),
        direction=np.concatenate(direction),
        kind=np.concatenate(kind),
    )


def cable_elements(name: str, cable: Cable, mesh: Mesh) -> tuple[Ints, Floats]:
    """(n, 2) nodes of a cable's elements, and their unstressed lengths.

    :raises InputError: unknown groups, a group that no edge lies in, two nodes at one place.
    """
    pairs = _pairs(name, cable, mesh)
    distance = np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1)
    short = np.flatnonzero(distance <= 0.0)
    if short.size:
        first, second = pairs[short[0]].tolist()
        raise InputError(f"cables.{name}: nodes {first} and {second} lie at one place, {short.size} such pairs in all")
    if cable.force is not None:
        return pairs, distance / (1.0 + cable.force / cable.EA)
    if cable.force_density is not None:
        return pairs, distance / (1.0 + cable.force_density * distance / cable.EA)
    ratio = (cable.unstressed or 1.0) if cable.length is None else cable.length / distance.sum()
    return pairs, ratio * distance


def _pairs(name: str, cable: Cable, mesh: Mesh) -> Ints:
    """(n, 2) nodes of a cable's elements."""
    key = f"cables.{name}"
    if cable.lines is not None:
        _check_lines(cable.lines, mesh, f"{key}.lines")
        return np.asarray(mesh.lines[mesh.line_groups[cable.lines]])
    if cable.along is not None:
        member = np.zeros(mesh.node_count, dtype=bool)
        member[group_nodes(mesh, cable.along, f"{key}.along")] = True
        edges = mesh.edges()
        edges = edges[member[edges].all(axis=1)]
        if not len(edges):
            raise InputError(f"{key}.along: no mesh edge has both ends in this group of {member.sum()} nodes")
        return edges
    chain = _chain(cable, mesh, key)
    if cable.parts > 1:
        between = group_nodes(mesh, name, f"{key}.parts").reshape(len(chain) - 1, cable.parts - 1)
        chain = np.append(np.column_stack([chain[:-1], between]).ravel(), chain[-1])
    return np.column_stack([chain[:-1], chain[1:]]).astype(np.int32)


def _chain(cable: Cable, mesh: Mesh, key: str) -> Ints:
    """Node of each of the groups that a cable runs from one to the next."""
    chain = []
    for name in cable.nodes or ():
        members = group_nodes(mesh, name, f"{key}.nodes")
        if len(members) != 1:
            raise InputError(f"{key}.nodes: group {name!r} holds {len(members)} nodes; each must hold one")
        chain.append(int(members[0]))
    return np.array(chain, dtype=np.int32)


def _check_lines(group: str, mesh: Mesh, key: str) -> None:
    """Refuse a group of lines that there is not."""
    if group not in mesh.line_groups:
        known = ", ".join(mesh.line_groups) or "(none)"
        raise InputError(f"{key}: no group of lines {group!r} in this mesh; allowed: {known}")


def _with_nodes(mesh: Mesh, points: Floats, name: str, key: str) -> Mesh:
    """The mesh with more nodes, in a group of a name that is free."""
    if name in mesh.node_groups:
        raise InputError(
            f"{key}: its nodes are to be group {name!r}, and the mesh has a node group of that name, with "
            f"{len(mesh.node_groups[name])} members; choose another name"
        )
    return meshes.with_added_nodes(mesh, points, {name: np.arange(len(points)) + mesh.node_count})
