"""Values of elements that a scene takes from the mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh


def element_values(mesh: Mesh, name: str, elements: Ints, key: str, components: Sequence[int]) -> Floats:
    """(len(elements),) or (len(elements), k) values of an array of the mesh's element data.

    :param components: how many it may have; 1 for an array without components.
    :raises InputError: no such array, another number of components, a value of these elements that is not finite.
    """
    if name not in mesh.tri_fields:
        known = (
            ", ".join(mesh.tri_fields) or "(none; arrays of whole numbers are groups, and those of nodes are not read)"
        )
        raise InputError(f"{key}: no element data {name!r} in this mesh; allowed: {known}")
    values = mesh.tri_fields[name]
    width = 1 if values.ndim == 1 else values.shape[1]
    if width not in components:
        wanted = " or ".join(map(str, components))
        raise InputError(f"{key}: {name!r} has {width} values for each element, {wanted} are needed")
    found = values[elements]
    bad = np.flatnonzero(~np.isfinite(found.reshape(len(found), -1)).all(axis=1))
    if bad.size:
        raise InputError(f"{key}: {name!r} is not finite in element {elements[bad[0]]} (and {bad.size - 1} others)")
    return found if width > 1 or values.ndim == 1 else found[:, 0]
