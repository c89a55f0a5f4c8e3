"""Warp directions of the elements: by a vector, the shape's own, element data, along a line, or around an axis."""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import FabricConstants, Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Scene, WarpSource
from taichi_membrane.simulation.element_data import element_values
from taichi_membrane.simulation.groups import fabric_list

# A distance from an axis of this share of the mesh's size has no direction around it.
_NO_RADIUS = 1e-9
# Begins the name of the element data that keep the directions along a group of lines, in the mesh of a run.
ALONG = "along:"
# Distances of elements to pieces of a line that are held at a time.
_MOST_HELD = 2_000_000


def warp_directions(scene: Scene, mesh: Mesh, tri_fabric: Ints, fabrics: tuple[FabricConstants, ...]) -> Floats:
    """(tri_count, 3) warp direction of each element.

    :raises InputError: a fabric that needs a direction has none, or one that is normal to an element.
    """
    normals = mesh.tri_normals()
    corners = mesh.points[mesh.triangles]
    direction = corners[:, 1] - corners[:, 0]  # any direction will do where the fabric has none
    for number, (group, fabric) in enumerate(fabric_list(scene)):
        elements = np.flatnonzero(tri_fabric == number)
        key = f"fabrics.{group}.warp"
        directed = not fabrics[number].isotropic or fabric.prestressed or _grows_apart(scene, fabric)
        directed = directed or fabric.strength_warp is not None
        if fabric.warp is not None:
            direction[elements] = _asked(fabric.warp, mesh, elements, key)
        elif mesh.tri_warp is not None:
            direction[elements] = mesh.tri_warp[elements]
        elif directed:
            raise InputError(f"fabrics.{group}: this mesh has no warp direction of its own; give warp = [x, y, z]")
        if directed:
            checked = preparation.project_on_elements(direction, normals, elements, key)
            direction[elements] = _turned(checked, normals[elements], np.deg2rad(fabric.warp_angle))
        else:
            direction[elements] = _any_tangent(direction[elements], corners[elements], normals[elements])
    return direction


def least_angle(scene: Scene, mesh: Mesh, tri_fabric: Ints, number: int) -> tuple[float, int] | None:
    """Smallest angle between a fabric's asked warp and an element's normal [degrees], and that element; None if none is asked."""
    group, fabric = fabric_list(scene)[number]
    elements = np.flatnonzero(tri_fabric == number)
    if fabric.warp is None or not elements.size:
        return None
    asked = _asked(fabric.warp, mesh, elements, f"fabrics.{group}.warp")
    normal = mesh.tri_normals()[elements]
    across = np.linalg.norm(np.cross(asked, normal), axis=1)
    angle = np.degrees(np.arctan2(across, np.abs(np.einsum("ij,ij->i", asked, normal))))
    return float(angle.min()), int(elements[angle.argmin()])


def _grows_apart(scene: Scene, fabric: Fabric) -> bool:
    """Whether warp and weft may differ in their stress-free strain."""
    return any(one.warp != one.weft for one in scene.shrinkages.values()) or (
        bool(scene.temperatures) and fabric.expansion[0] != fabric.expansion[1]
    )


def _asked(warp: tuple[float, float, float] | WarpSource, mesh: Mesh, elements: Ints, key: str) -> Floats:
    """(len(elements), 3) directions as they are asked for, not projected."""
    if not isinstance(warp, WarpSource):
        return np.tile(np.array(warp, dtype=np.float64), (len(elements), 1))
    if warp.field is not None:
        found = element_values(mesh, warp.field, elements, f"{key}.field", (3,))
        lost = np.flatnonzero(~found.any(axis=1))
        if lost.size:
            raise InputError(
                f"{key}.field: {warp.field!r} is zero, no direction, in element {elements[lost[0]]} (and {lost.size - 1} others)"
            )
        return found
    if warp.along is not None:
        return along(mesh, warp.along, elements, f"{key}.along")
    centres = mesh.points[mesh.triangles[elements]].mean(axis=1)
    axis = np.array(warp.around) / np.linalg.norm(np.array(warp.around))
    around = np.cross(axis, centres - np.array(warp.through or (0.0, 0.0, 0.0)))
    lost = np.flatnonzero(np.linalg.norm(around, axis=1) <= _NO_RADIUS * np.linalg.norm(np.ptp(mesh.points, axis=0)))
    if lost.size:
        raise InputError(f"{key}.around: element {elements[lost[0]]} (and {lost.size - 1} others) lies on the axis")
    return around


def along(mesh: Mesh, name: str, elements: Ints, key: str) -> Floats:
    """(len(elements), 3) direction of the piece of a line that is nearest to each element's middle; of several, the first's.

    :raises InputError: no such group of lines or nodes, or one without length.
    """
    if name not in mesh.line_groups and ALONG + name in mesh.tri_fields:
        return mesh.tri_fields[ALONG + name][elements]
    places = mesh.points[mesh.triangles[elements]].mean(axis=1)
    start, end = _pieces(mesh, name, key)
    vector = end - start
    squared = np.einsum("ij,ij->i", vector, vector)
    found = np.empty(len(places), dtype=np.int64)
    step = max(1, _MOST_HELD // len(start))
    for first in range(0, len(places), step):
        off = places[first : first + step, None] - start
        share = np.clip(np.einsum("pij,ij->pi", off, vector) / squared, 0.0, 1.0)
        off -= share[:, :, None] * vector
        found[first : first + step] = np.einsum("pij,pij->pi", off, off).argmin(axis=1)
    return vector[found]


def _pieces(mesh: Mesh, name: str, key: str) -> tuple[Floats, Floats]:
    """Ends of the pieces of a line: a group of line elements, else the mesh edges with both ends in a node group."""
    points = np.concatenate((mesh.points, mesh.loose_points))
    if name in mesh.line_groups:
        pairs = mesh.lines[mesh.line_groups[name]]
    elif name in mesh.node_groups:
        member = np.zeros(mesh.node_count, dtype=bool)
        member[mesh.node_groups[name]] = True
        pairs = mesh.edges()
        pairs = pairs[member[pairs].all(axis=1)]
        if not len(pairs):
            raise InputError(f"{key}: no mesh edge has both ends in {name!r}, of {member.sum()} nodes")
    else:
        known = ", ".join(dict.fromkeys([*mesh.line_groups, *mesh.node_groups]))
        raise InputError(f"{key}: no group of lines or nodes {name!r} in this mesh; allowed: {known}")
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]
    long = (start != end).any(axis=1)
    if not long.any():
        raise InputError(f"{key}: the line {name!r} has no length")
    return start[long], end[long]


def _any_tangent(direction: Floats, corners: Floats, normals: Floats) -> Floats:
    """Directions for an isotropic fabric, where only output depends on them: the first side where the asked one is normal."""
    along = direction - np.einsum("ij,ij->i", direction, normals)[:, None] * normals
    poor = np.linalg.norm(along, axis=1) <= 1e-6 * np.linalg.norm(direction, axis=1)
    along[poor] = (corners[:, 1] - corners[:, 0])[poor]
    return along


def _turned(direction: Floats, normals: Floats, angle: float) -> Floats:
    """Tangent vectors turned by ``angle`` about the normals, counter-clockwise seen from the positive side."""
    return np.cos(angle) * direction + np.sin(angle) * np.cross(normals, direction)
