"""Mass of a scene's fabrics and cables at the nodes, on the unstressed shape."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, sum_to_nodes
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.fabrics import fabric_list, fabrics_of
from taichi_membrane.simulation.members import cable_elements


def nodal_mass(scene: Scene, mesh: Mesh) -> Floats:
    """(node_count,) a third of the mass of each triangle, and half that of each cable, at its nodes."""
    _, tri_fabric = fabrics_of(scene, mesh)
    per_area = np.array([fabric.surface_mass or 0.0 for _, fabric in fabric_list(scene)])
    of_fabric = per_area[tri_fabric] * mesh.tri_areas()
    mass = sum_to_nodes(mesh, np.repeat(of_fabric / 3.0, 3)[:, None])[:, 0]
    for name, cable in scene.cables.items():
        if cable.mass_per_length > 0.0:
            pairs, length = cable_elements(name, cable, mesh)
            ends = np.repeat(0.5 * cable.mass_per_length * length, 2)
            mass = mass + np.bincount(pairs.ravel(), weights=ends, minlength=mesh.node_count)
    return np.asarray(mass)
