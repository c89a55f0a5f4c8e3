"""Contact of nodes with a rigid obstacle, across it, by an augmented Lagrangian; what all kinds of obstacles share.

What acts along it is friction (:mod:`friction`), where there is any.

At a gap g(x), the signed distance of a node from the obstacle, it is pushed with p = <λ - k g> along the normal n = ∇g: minus the
gradient of <λ - k g>²/(2k), whose second derivative is k n nᵀ - p H where there is contact, H = ∇n the curvature of the distance.
Where the multiplier λ is the contact force, a node in contact has g = 0 exactly, whatever k is; k only decides how fast the
multipliers are found (:mod:`taichi_membrane.solvers.contact`).

Each kind of obstacle (:mod:`planes`, :mod:`obstacles`, :mod:`surface_contact`) says what g, n and H are.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import Nodes, fill, room
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class ContactTerm(ABC):
    """Fields and device code that all obstacles have; a node term, see :mod:`taichi_membrane.mechanics.terms`."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        self.nodes, self.fp, self.dtype, self.number = nodes, nodes.fp, nodes.dtype, number
        self.node_contact = ti.Vector.field(3, nodes.fp, shape=room(structure.node_count))  # gap at rest, k, λ

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where its nodes do."""
        return structure.node_count <= self.node_contact.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's obstacle, without stiffness: it pushes once :meth:`set` has given one."""
        self.obstacle: Obstacle = structure.obstacles[self.number]
        self.held_up = np.zeros(structure.node_count, dtype=bool)
        self.held_up[self.obstacle.nodes] = True
        # A node that is held altogether is held up by its support.
        self.held_up &= ~structure.node_held.all(axis=1)
        self.points = structure.points
        self.stiffness = self.multiplier = np.zeros(structure.node_count)
        self.place(0.0)

    def place(self, value: float) -> None:
        """Move the obstacle to a value of its motion."""
        self.value = value
        self.rest_gap = self.settle(self.points, value * self.obstacle.motion)
        self.set(self.stiffness, self.multiplier)

    @abstractmethod
    def settle(self, points: Floats, offset: Floats) -> Floats:
        """(node_count,) gaps at rest of an obstacle moved by ``offset``, as far as its kind uses them."""

    def set(self, stiffness: Floats, multiplier: Floats) -> None:
        """Set k and λ of each node, (node_count,); nodes that the obstacle does not hold up get none."""
        self.stiffness, self.multiplier = stiffness * self.held_up, multiplier * self.held_up
        fill(self.node_contact, np.column_stack([self.rest_gap, self.stiffness, self.multiplier]).astype(self.dtype))

    @ti.func
    def displaced(self, i):
        """Displacement of node ``i``."""
        moved = self.nodes.node_displacement[i]
        if ti.static(self.nodes.split_displacement):
            moved += self.nodes.node_displacement_rest[i]
        return moved

    @ti.func
    def push(self, i, gap):
        """Contact force on node ``i`` at a gap."""
        contact = self.node_contact[i]
        return ti.max(contact[2] - contact[1] * gap, ti.cast(0.0, self.fp))

    @ti.func
    def force(self, i):
        """Contact force on node ``i``, along the normal."""
        gap, normal, _curvature = self.distance(i)
        return self.push(i, gap) * normal

    @ti.func
    def energy(self, i):
        """Its potential, zero where the push is the multiplier or there is no stiffness."""
        gap, _normal, _curvature = self.distance(i)
        stiffness = self.node_contact[i][1]
        work = 0.5 * (self.push(i, gap) ** 2 - self.node_contact[i][2] ** 2)
        return ti.select(stiffness > 0.0, work / ti.max(stiffness, 1e-30), ti.cast(0.0, self.fp))

    @ti.func
    def bound(self, i):
        """Stiffness bound: k, in contact or not, and what the curvature adds where the obstacle is hollow."""
        gap, _normal, curvature = self.distance(i)
        return self.node_contact[i][1] + self.push(i, gap) * ti.max(-curvature.trace(), ti.cast(0.0, self.fp))

    @ti.func
    def block(self, i):
        """k n nᵀ - p H in contact."""
        gap, normal, curvature = self.distance(i)
        push = self.push(i, gap)
        stiffness = ti.select(push > 0.0, self.node_contact[i][1], ti.cast(0.0, self.fp))
        return stiffness * normal.outer_product(normal) - push * curvature
