"""Sums of support forces on the groups of nodes that are held, anchors and springs among them."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import StepResult

# What is left of forces that cancel is round-off: a share of the sum of their sizes.
_ROUND_OFF = 1e-9
ALL = "all held nodes"


def support_forces(scene: Scene, mesh: Mesh, step: StepResult) -> dict[str, Floats]:
    """(3,) force of the supports on the structure of each held group, and of :data:`ALL` where there are several.

    A node of two groups counts in both, and once in all.
    """
    least = _ROUND_OFF * float(np.abs(step.reaction).sum())
    groups = list(dict.fromkeys(group for group, _ in scene.holding))
    sums = {group: step.reaction[mesh.node_groups[group]].sum(axis=0) for group in groups}
    if len(groups) > 1:
        sums[ALL] = step.reaction.sum(axis=0)
    return {group: np.where(np.abs(total) < least, 0.0, total) for group, total in sums.items()}
