"""A rigid plane that nodes touch without friction, by an augmented Lagrangian.

At a gap g = n·x - n·a a node is pushed with <λ - k g>, the derivative of <λ - k g>²/(2k). Where the multiplier λ is the contact
force, a node in contact has g = 0 exactly, whatever k is; k only decides how fast the multipliers are found
(:mod:`taichi_membrane.solvers.contact`).
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import Nodes, fill
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure

# A share of the normal that is left free by round-off alone.
_HELD = 1e-9


@ti.data_oriented
class PlaneTerm:
    """Fields and device code of one plane; a node term, see :mod:`taichi_membrane.mechanics.terms`."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        self.nodes, self.fp, self.dtype, self.number = nodes, nodes.fp, nodes.dtype, number
        self.plane_normal = ti.Vector.field(3, nodes.fp, shape=())
        self.node_contact = ti.Vector.field(3, nodes.fp, shape=structure.node_count)  # gap at rest, k, λ

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where its nodes do."""
        return structure.node_count <= self.node_contact.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's plane, without stiffness: it pushes once :meth:`set` has given one."""
        self.plane = structure.planes[self.number]
        self.plane_normal[None] = self.plane.normal.tolist()
        self.rest_gap = (structure.points - self.plane.through) @ self.plane.normal
        # A node that cannot move along the normal is held up by its support.
        normal = np.tile(self.plane.normal, (structure.node_count, 1))
        free = np.where(structure.node_held, 0.0, self.nodes.in_frames(normal))
        self.touching = np.zeros(structure.node_count, dtype=bool)
        self.touching[self.plane.nodes] = np.linalg.norm(free[self.plane.nodes], axis=1) > _HELD
        self.set(np.zeros(structure.node_count), np.zeros(structure.node_count))

    def set(self, stiffness: Floats, multiplier: Floats) -> None:
        """Set k and λ of each node, (node_count,); nodes that the plane does not hold get none."""
        self.stiffness, self.multiplier = stiffness * self.touching, multiplier * self.touching
        fill(self.node_contact, np.column_stack([self.rest_gap, self.stiffness, self.multiplier]).astype(self.dtype))

    def gap(self) -> Floats:
        """(node_count,) distance of each node from the plane at the present displacements, negative where it has passed it."""
        return self.rest_gap + self.nodes.displacement() @ self.plane.normal

    def push(self) -> Floats:
        """(node_count,) contact force on each node along the plane's normal."""
        return np.maximum(self.multiplier - self.stiffness * self.gap(), 0.0)

    @ti.func
    def pushed(self, i):
        """Contact force on node ``i``."""
        moved = self.nodes.node_displacement[i].dot(self.plane_normal[None])
        if ti.static(self.nodes.split_displacement):
            moved += self.nodes.node_displacement_rest[i].dot(self.plane_normal[None])
        contact = self.node_contact[i]
        return ti.max(contact[2] - contact[1] * (contact[0] + moved), ti.cast(0.0, self.fp))

    @ti.func
    def force(self, i):
        """Contact force on node ``i``, along the normal."""
        return self.pushed(i) * self.plane_normal[None]

    @ti.func
    def energy(self, i):
        """Its potential; zero where there is no stiffness."""
        stiffness = self.node_contact[i][1]
        return ti.select(stiffness > 0.0, 0.5 * self.pushed(i) ** 2 / ti.max(stiffness, 1e-30), ti.cast(0.0, self.fp))

    @ti.func
    def bound(self, i):
        """Stiffness bound: k, in contact or not."""
        return self.node_contact[i][1]

    @ti.func
    def block(self, i):
        """k n nᵀ in contact."""
        stiffness = ti.select(self.pushed(i) > 0.0, self.node_contact[i][1], ti.cast(0.0, self.fp))
        return stiffness * self.plane_normal[None].outer_product(self.plane_normal[None])
