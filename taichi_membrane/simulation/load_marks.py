"""Where pictures show a load: the nodes it acts at, and a direction."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Load, Scene


def load_marks(scene: Scene, mesh: Mesh, name: str) -> tuple[Ints, Floats]:
    """Numbers of the nodes that a load acts at, and its direction, of any length."""
    load = scene.loads[name]
    if not isinstance(load, Load):
        return np.arange(mesh.node_count), np.array(load.direction)
    if load.kind == "area":
        return np.unique(mesh.triangles[mesh.tri_groups[load.group]]), np.array(load.direction)
    return np.asarray(mesh.node_groups[load.group]), np.array(load.direction)
