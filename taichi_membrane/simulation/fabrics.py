"""A scene's fabrics on the elements of its mesh."""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import FabricConstants, Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import ElementField, Scene
from taichi_membrane.scene.base import LARGEST, SMALLEST
from taichi_membrane.simulation.element_data import element_values
from taichi_membrane.simulation.groups import fabric_list, group_triangles


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
                thickness=1.0 if isinstance(fabric.given_thickness, ElementField) else fabric.given_thickness,
                law=fabric.law,
                side_strain=fabric.side_strain,
                prestress=(0.0, 0.0, 0.0)
                if isinstance(fabric.given_prestress, ElementField)
                else fabric.given_prestress,
            )
        )
    bare = np.flatnonzero(number_of < 0)
    if bare.size:
        raise InputError(
            f"fabrics: {bare.size} of {mesh.tri_count} elements have no fabric, the first is {bare[0]}; "
            "give [fabric] for all others, or a [fabrics.GROUP] for them"
        )
    return tuple(constants), number_of


def thickness_of(scene: Scene, mesh: Mesh, tri_fabric: Ints) -> Floats | None:
    """(tri_count,) thickness of each element; None where it is one number for each fabric.

    :raises InputError: element data that are missing, or not above zero.
    """
    fabrics = fabric_list(scene)
    if not any(isinstance(fabric.given_thickness, ElementField) for _, fabric in fabrics):
        return None
    found = np.empty(mesh.tri_count)
    for number, (group, fabric) in enumerate(fabrics):
        elements, key = np.flatnonzero(tri_fabric == number), f"fabrics.{group}.thickness.field"
        if not isinstance(fabric.given_thickness, ElementField):
            found[elements] = fabric.given_thickness
            continue
        values = element_values(mesh, fabric.given_thickness.field, elements, key, (1,)) * fabric.given_thickness.scale
        bad = np.flatnonzero(~(values >= SMALLEST) | (values > LARGEST))
        if bad.size:
            raise InputError(
                f"{key}: the thickness of element {elements[bad[0]]} (and {bad.size - 1} others) is {values[bad[0]]:g}; "
                "it must be above 0"
            )
        found[elements] = values
    return found


def prestress_of(scene: Scene, mesh: Mesh, tri_fabric: Ints) -> Floats | None:
    """(tri_count, 3) prestress of each element in fabric axes; None where it is one for each fabric.

    :raises InputError: element data that are missing.
    """
    fabrics = fabric_list(scene)
    if not any(isinstance(fabric.given_prestress, ElementField) for _, fabric in fabrics):
        return None
    found = np.zeros((mesh.tri_count, 3))
    for number, (group, fabric) in enumerate(fabrics):
        elements = np.flatnonzero(tri_fabric == number)
        if isinstance(fabric.given_prestress, ElementField):
            key = f"fabrics.{group}.{fabric.prestress_key}.field"
            values = (
                element_values(mesh, fabric.given_prestress.field, elements, key, (2, 3)) * fabric.given_prestress.scale
            )
            found[elements, : values.shape[1]] = values
        else:
            found[elements] = fabric.given_prestress
    return found
