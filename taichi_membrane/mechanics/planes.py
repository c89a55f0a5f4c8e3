"""A rigid plane that nodes touch: g = n·x - n·a, without curvature."""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.contact import ContactTerm
from taichi_membrane.mechanics.nodes import Nodes, fill
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class PlaneTerm(ContactTerm):
    """Fields and device code of one plane."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        super().__init__(nodes, structure, number)
        self.plane_normal = ti.Vector.field(3, nodes.fp, shape=1)

    def settle(self, points: Floats, offset: Floats) -> Floats:
        """(node_count,) gaps at rest."""
        normal = self.obstacle.frame[2]
        fill(self.plane_normal, normal[None].astype(self.dtype))
        return np.asarray((points - (self.obstacle.centre + offset)) @ normal)

    @ti.func
    def distance(self, i):
        """Gap of node ``i``, its gradient and its second derivative."""
        normal = self.plane_normal[0]
        gap = self.node_contact[i][0] + self.displaced(i).dot(normal)
        return gap, normal, ti.Matrix.zero(self.fp, 3, 3)
