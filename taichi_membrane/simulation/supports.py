"""A scene's supports and prescribed motions on the nodes of its mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import Floats, Ints, Springs
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Rotation, Scene, Translation
from taichi_membrane.simulation.groups import group_nodes

# A gap that is none, as a share of the structure's size.
_TOUCHING = 1e-6


@dataclass(frozen=True)
class PrescribedMotion:
    """A node group whose displacement components ``components`` (0, 1, 2) follow a motion; see :mod:`taichi_membrane.scene`."""

    motion: Translation | Rotation
    nodes: Ints
    components: tuple[int, ...]

    def displacement(self, points: Floats, factor: float) -> Floats:
        """(len(nodes), 3) displacement of the group's nodes from their unstressed positions at a factor."""
        if isinstance(self.motion, Translation):
            return np.broadcast_to(factor * np.array(self.motion.direction), (len(self.nodes), 3))
        axis = np.array(self.motion.axis) / np.linalg.norm(self.motion.axis)
        arms = points[self.nodes] - np.array(self.motion.through)
        turn = scipy.spatial.transform.Rotation.from_rotvec(factor * axis, degrees=True)
        return np.asarray(turn.apply(arms) - arms)


def held_components(scene: Scene, mesh: Mesh) -> tuple[NDArray[np.bool_], Floats | None]:
    """Held components of each node, and the axes they refer to: None while all supports are along x, y, z."""
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    normals: dict[int, list[Floats]] = {}
    for name in scene.anchors:
        held[group_nodes(mesh, name, f"anchors.{name}")] = True
    for number, support in enumerate(scene.supports, 1):
        nodes = group_nodes(mesh, support.group, f"supports[{number}].group")
        for component in support.hold or "":
            held[nodes, "xyz".index(component)] = True
        if support.normal is not None:
            direction = np.array(support.normal) / np.linalg.norm(support.normal)
            for node in nodes:
                normals.setdefault(int(node), []).append(direction)
    if not normals:
        return held, None
    frame = np.tile(np.eye(3), (mesh.node_count, 1, 1))
    for node, directions in normals.items():
        along_axes = list(np.eye(3)[held[node]])
        frame[node], held[node] = _spanned(np.array(directions + along_axes))
    return held, frame


def held_by_others(
    held: NDArray[np.bool_],
    frame: Floats | None,
    points: Floats,
    springs: Springs | None,
    obstacles: Sequence[Obstacle],
) -> tuple[NDArray[np.bool_], Floats | None]:
    """Held components and their axes as if springs to the ground were supports, and planes where nodes touch them at rest, which
    rigid motions are stopped by as well."""
    nodes: list[Ints] = [np.zeros(0, dtype=np.int32)]
    directions: list[Floats] = [np.zeros((0, 3))]
    if springs is not None:
        nodes.append(springs.nodes)
        directions.append(springs.direction)
    for plane in (one for one in obstacles if one.kind == "plane"):
        gap = (points[plane.nodes] - plane.centre) @ plane.frame[2]
        nodes.append(plane.nodes[gap <= _TOUCHING * np.ptp(points, axis=0).max()])
        directions.append(np.tile(plane.frame[2], (len(nodes[-1]), 1)))
        for along in plane.frame[:2] if plane.friction else ():
            nodes.append(nodes[-1])
            directions.append(np.tile(along, (len(nodes[-1]), 1)))
    found, ways = np.concatenate(nodes), np.concatenate(directions)
    if not found.size:
        return held, frame
    axes = np.tile(np.eye(3), (len(held), 1, 1)) if frame is None else frame.copy()
    held = held.copy()
    for node in np.unique(found):
        axes[node], held[node] = _spanned(np.array([*axes[node][held[node]], *ways[found == node]]))
    return held, axes


def _spanned(directions: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Three axes, the first of which span given directions, and which of them do."""
    # Right singular vectors: first a basis of all directions, then of what is left free.
    _, values, rows = np.linalg.svd(directions)
    return rows, np.arange(3) < int((values > 1e-9).sum())


def motions_of(scene: Scene, mesh: Mesh, held: NDArray[np.bool_], frame: Floats | None) -> dict[str, PrescribedMotion]:
    """The prescribed motions; their components are added to the held ones.

    :raises InputError: a component that a support or another motion already governs.
    """
    motions = {}
    for name, motion in scene.motions.items():
        if not isinstance(motion, Translation | Rotation):
            continue  # of bodies
        nodes = group_nodes(mesh, motion.group, f"motions.{name}.group")
        components = tuple("xyz".index(c) for c in motion.hold)
        if frame is not None and np.any(frame[nodes] != np.eye(3)):
            slanted = nodes[np.any(frame[nodes] != np.eye(3), axis=(1, 2))]
            raise InputError(f"motions.{name}: node {slanted[0]} has a slanted support; it cannot be moved too")
        chosen = np.ix_(nodes, np.array(components))
        taken = held[chosen]
        if taken.any():
            node, c = np.argwhere(taken)[0]
            raise InputError(
                f"motions.{name}: component {'xyz'[components[c]]} of node {nodes[node]} is already held by a support "
                "or moved by another motion"
            )
        held[chosen] = True
        motions[name] = PrescribedMotion(motion, nodes, components)
    return motions
