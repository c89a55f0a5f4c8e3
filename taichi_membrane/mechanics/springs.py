"""Springs from nodes to the ground, along a direction that stays: a force -k u_d d on the node, u_d = u·d its displacement there.

One that bears tension only resists motion along d alone, one that bears compression only that against it.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.preparation import Floats, gather_lists
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class SpringTerm:
    """Fields and device code of a structure's springs; a node term, see :mod:`taichi_membrane.mechanics.terms`."""

    def __init__(self, nodes: Nodes, structure: Structure) -> None:
        assert structure.springs is not None  # else there is no such term
        self.nodes, self.fp, self.dtype = nodes, nodes.fp, nodes.dtype
        size = room(len(structure.springs.nodes))
        self.spring_start = ti.field(ti.i32, shape=room(structure.node_count) + 1)
        self.spring_direction = ti.Vector.field(3, nodes.fp, shape=size)
        self.spring_constants = ti.Vector.field(3, nodes.fp, shape=size)  # k, k where u_d > 0, k where u_d < 0

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure's springs fit these fields."""
        springs = structure.springs
        if springs is None:
            return False
        return (
            structure.node_count < self.spring_start.shape[0] and len(springs.nodes) <= self.spring_direction.shape[0]
        )

    def upload(self, structure: Structure) -> None:
        """Take over a structure's springs."""
        one = structure.springs
        assert one is not None
        start, order = gather_lists(one.nodes, structure.node_count)
        self.springs, self.node_count = one, structure.node_count
        constants = np.column_stack([one.stiffness, one.stiffness * (one.kind >= 0), one.stiffness * (one.kind <= 0)])
        self._write(start, one.direction[order].astype(self.dtype), constants[order].astype(self.dtype))

    @ti.kernel
    def _write(self, start: Array, direction: Array, constants: Array):
        for i in range(ti.max(start.shape[0], direction.shape[0])):
            if i < start.shape[0]:
                self.spring_start[i] = start[i]
            if i < direction.shape[0]:
                for c in ti.static(range(3)):
                    self.spring_direction[i][c] = direction[i, c]
                    self.spring_constants[i][c] = constants[i, c]

    @ti.func
    def moved(self, i, s):
        """How far node ``i`` has moved along spring ``s``."""
        along = self.nodes.node_displacement[i].dot(self.spring_direction[s])
        if ti.static(self.nodes.split_displacement):
            along += self.nodes.node_displacement_rest[i].dot(self.spring_direction[s])
        return along

    @ti.func
    def stiffness(self, s, moved):
        """Stiffness of spring ``s`` on the side that it has moved to."""
        return ti.select(moved >= 0.0, self.spring_constants[s][1], self.spring_constants[s][2])

    @ti.func
    def force(self, i):
        """Force of the springs of node ``i`` on it."""
        total = ti.Vector.zero(self.fp, 3)
        for s in range(self.spring_start[i], self.spring_start[i + 1]):
            moved = self.moved(i, s)
            total -= self.stiffness(s, moved) * moved * self.spring_direction[s]
        return total

    @ti.func
    def energy(self, i):
        """Energy stored in the springs of node ``i``."""
        total = ti.cast(0.0, self.fp)
        for s in range(self.spring_start[i], self.spring_start[i + 1]):
            moved = self.moved(i, s)
            total += 0.5 * self.stiffness(s, moved) * moved**2
        return total

    @ti.func
    def bound(self, i):
        """Stiffness bound: the sum of all, at work or not."""
        total = ti.cast(0.0, self.fp)
        for s in range(self.spring_start[i], self.spring_start[i + 1]):
            total += self.spring_constants[s][0]
        return total

    @ti.func
    def block(self, i):
        """k d dᵀ of those that resist."""
        total = ti.Matrix.zero(self.fp, 3, 3)
        for s in range(self.spring_start[i], self.spring_start[i + 1]):
            d = self.spring_direction[s]
            total += self.stiffness(s, self.moved(i, s)) * d.outer_product(d)
        return total

    def forces(self, displacement: Floats) -> Floats:
        """(node_count, 3) forces of the springs on the nodes at displacements of these."""
        one = self.springs
        moved = np.einsum("ij,ij->i", displacement[one.nodes], one.direction)
        works = np.where(moved >= 0.0, one.kind >= 0, one.kind <= 0)
        pull = -(one.stiffness * works * moved)[:, None] * one.direction
        columns = [np.bincount(one.nodes, weights=part, minlength=self.node_count) for part in pull.T]
        return np.stack(columns, axis=1)
