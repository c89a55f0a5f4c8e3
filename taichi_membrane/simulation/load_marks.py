"""Where pictures show a load: the nodes it acts at, and a direction."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import BodyLoad, Load, Scene, WaterLoad, WeightLoad
from taichi_membrane.simulation.surface_loads import surface_loads_of

# A resultant that is this share of the sum of the forces' sizes is round-off.
_NO_RESULTANT = 1e-9


def load_marks(scene: Scene, mesh: Mesh, name: str) -> tuple[Ints, Floats] | None:
    """Numbers of the nodes that a load acts at, and its direction, of any length.

    A load on the surface goes by its resultant on the unstressed shape, a liquid at its highest level; None where that is zero.
    """
    load = scene.loads[name]
    if isinstance(load, WeightLoad):
        return np.arange(mesh.node_count), np.array(load.direction)
    if isinstance(load, Load):
        if load.kind == "area":
            return np.unique(mesh.triangles[mesh.tri_groups[load.group]]), np.array(load.direction)
        return np.asarray(mesh.node_groups[load.group]), np.array(load.direction)
    if isinstance(load, BodyLoad):
        return (np.asarray(mesh.node_groups[load.body]), np.array(load.force)) if any(load.force) else None
    highest = max((stage.loads.get(name, 0.0) for stage in scene.ramps), key=abs) or 1.0
    force = surface_loads_of(scene, mesh, unused=True).at_rest(name, highest if isinstance(load, WaterLoad) else 1.0)
    size, total = np.linalg.norm(force, axis=1), force.sum(axis=0)
    if np.linalg.norm(total) <= _NO_RESULTANT * size.sum():
        return None
    return np.flatnonzero(size), total
