"""A scene's fabrics and warp directions on the elements of its mesh."""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import FabricConstants, Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Scene
from taichi_membrane.simulation.groups import group_triangles


def fabric_list(scene: Scene) -> list[tuple[str, Fabric]]:
    """The scene's fabrics with the element group of each; the default fabric comes first, for all elements."""
    default = [("all", scene.fabric)] if scene.fabric is not None else []
    return [*default, *scene.fabrics.items()]


def fabrics_of(scene: Scene, mesh: Mesh) -> tuple[tuple[FabricConstants, ...], Ints]:
    """Constants of each fabric, and the number of the one that each element is of.

    :raises InputError: an element with no fabric, or with two beside the default one.
    """
    constants, number_of = [], np.full(mesh.tri_count, -1, dtype=np.int32)
    default_given = scene.fabric is not None
    for number, (group, fabric) in enumerate(fabric_list(scene)):
        elements = group_triangles(mesh, group, f"fabrics.{group}")
        taken = number_of[elements]
        clash = elements[taken > 0 if default_given else taken >= 0]
        if clash.size:
            raise InputError(
                f"fabrics.{group}: element {clash[0]} (and {clash.size - 1} others) already has a fabric from another group"
            )
        number_of[elements] = number
        constants.append(
            FabricConstants(
                e_warp=fabric.warp_modulus,
                e_weft=fabric.weft_modulus,
                poisson=fabric.nu,
                shear=fabric.shear_modulus,
                thickness=fabric.thickness,
                law=fabric.law,
                side_strain=fabric.side_strain,
                prestress=fabric.prestress,
            )
        )
    bare = np.flatnonzero(number_of < 0)
    if bare.size:
        raise InputError(
            f"fabrics: {bare.size} of {mesh.tri_count} elements have no fabric, the first is {bare[0]}; "
            "give [fabric] for all others, or a [fabrics.GROUP] for them"
        )
    return tuple(constants), number_of


def warp_directions(scene: Scene, mesh: Mesh, tri_fabric: Ints, fabrics: tuple[FabricConstants, ...]) -> Floats:
    """(tri_count, 3) warp direction of each element.

    :raises InputError: a fabric that needs a direction has none, or one that is normal to an element.
    """
    normals = mesh.tri_normals()
    corners = mesh.points[mesh.triangles]
    direction = corners[:, 1] - corners[:, 0]  # any direction will do where the fabric has none
    for number, (group, fabric) in enumerate(fabric_list(scene)):
        elements = np.flatnonzero(tri_fabric == number)
        directed = not fabrics[number].isotropic or any(fabric.prestress)
        if fabric.warp is not None:
            direction[elements] = fabric.warp
        elif mesh.tri_warp is not None:
            direction[elements] = mesh.tri_warp[elements]
        elif directed:
            raise InputError(f"fabrics.{group}: this mesh has no warp direction of its own; give warp = [x, y, z]")
        if directed:
            checked = preparation.project_on_elements(direction, normals, elements, f"fabrics.{group}.warp")
            direction[elements] = _turned(checked, normals[elements], np.deg2rad(fabric.warp_angle))
        else:
            direction[elements] = _any_tangent(direction[elements], corners[elements], normals[elements])
    return direction


def _any_tangent(direction: Floats, corners: Floats, normals: Floats) -> Floats:
    """Directions for an isotropic fabric, where only output depends on them: the first side where the asked one is normal."""
    along = direction - np.einsum("ij,ij->i", direction, normals)[:, None] * normals
    poor = np.linalg.norm(along, axis=1) <= 1e-6 * np.linalg.norm(direction, axis=1)
    along[poor] = (corners[:, 1] - corners[:, 0])[poor]
    return along


def _turned(direction: Floats, normals: Floats, angle: float) -> Floats:
    """Tangent vectors turned by ``angle`` about the normals, counter-clockwise seen from the positive side."""
    return np.cos(angle) * direction + np.sin(angle) * np.cross(normals, direction)
