"""Mass of a scene's fabrics and cables at the nodes, on the unstressed shape."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, sum_to_nodes
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.quadratic import LUMPED, node_shares
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.fabrics import fabrics_of, thickness_of
from taichi_membrane.simulation.groups import fabric_list
from taichi_membrane.simulation.members import cable_elements


def nodal_mass(scene: Scene, mesh: Mesh, *, lumped: bool = True) -> Floats:
    """(node_count,) a third of the mass of each triangle, and half that of each cable, at its nodes.

    :param lumped: of six-node triangles in shares above zero, which modes need; else as a weight acts, nearly none at corners.
    """
    constants, tri_fabric = fabrics_of(scene, mesh)
    thickness = thickness_of(scene, mesh, tri_fabric)
    if thickness is None:
        thickness = np.array([one.thickness for one in constants])[tri_fabric]
    given = [(fabric.density, fabric.mass_per_area) for _, fabric in fabric_list(scene)]
    density, per_area = (np.array(one, dtype=np.float64)[tri_fabric] for one in zip(*given, strict=True))
    of_fabric = np.where(np.isnan(density), np.nan_to_num(per_area), density * thickness) * mesh.tri_areas()
    if mesh.order == 1:
        mass = sum_to_nodes(mesh, np.repeat(of_fabric / 3.0, 3)[:, None])[:, 0]
    else:
        shares = node_shares(mesh.points, mesh.cells)
        shares = LUMPED if lumped else shares / shares.sum(axis=1, keepdims=True)
        mass = sum_to_nodes(mesh, (of_fabric[:, None] * shares).reshape(-1, 1))[:, 0]
    for name, cable in scene.cables.items():
        if cable.mass_per_length > 0.0:
            pairs, length = cable_elements(name, cable, mesh)
            ends = np.repeat(0.5 * cable.mass_per_length * length, 2)
            mass = mass + np.bincount(pairs.ravel(), weights=ends, minlength=mesh.node_count)
    return np.asarray(mass)
