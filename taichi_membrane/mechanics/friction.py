"""Coulomb friction of nodes on a rigid obstacle, by an augmented Lagrangian beside that of their contact.

From where the last equilibrium left it on its obstacle, a node has moved by d. Across a normal n, with P = I - n nᵀ, it is held by

    t = s min(1, b/|s|),    s = P (λ - k d):

it sticks while |s| stays within the limit b, and slips beyond, with the force b along s. That is minus the gradient of |s|²/(2k),
or of b (|s| - b/2)/k where it slips; the second derivative is k P, or k b/|s| (P - s sᵀ/|s|²). Normal, multiplier λ and limit stay
as they are while equilibrium is sought, so that forces have a potential and a symmetric tangent; then they are brought up to date
(:mod:`taichi_membrane.solvers.contact`) until λ is the force, n the normal and b the coefficient times the push. There d is zero
where a node sticks and runs against t where it slips: Coulomb's law over the whole step, implicitly, whatever k is.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.contact import ContactTerm
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class FrictionTerm:
    """Fields and device code of the friction on one obstacle; a node term, see :mod:`taichi_membrane.mechanics.terms`.

    :param contact: of the same obstacle.

    ``anchor`` and ``carried``, (node_count, 3), are its history: displacements less that of the obstacle, and friction forces,
    at the last equilibrium.
    """

    def __init__(self, nodes: Nodes, structure: Structure, contact: ContactTerm) -> None:
        self.nodes, self.fp, self.dtype, self.contact = nodes, nodes.fp, nodes.dtype, contact
        count = room(structure.node_count)
        self.friction_normal = ti.Vector.field(3, nodes.fp, shape=count)
        self.friction_multiplier = ti.Vector.field(3, nodes.fp, shape=count)
        self.friction_limit = ti.Vector.field(2, nodes.fp, shape=count)  # k, b
        self.friction_anchor = ti.Vector.field(3, nodes.fp, shape=count)
        if nodes.split_displacement:
            self.friction_anchor_rest = ti.Vector.field(3, nodes.fp, shape=count)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where its nodes do."""
        return structure.node_count <= self.friction_limit.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure at rest, where nothing has been touched yet; the contact has done so before."""
        self.coefficient = structure.obstacles[self.contact.number].friction
        self.anchor, self.carried = np.zeros((structure.node_count, 3)), np.zeros((structure.node_count, 3))
        self.multiplier = self.carried
        self.let_go()

    # ---- what a solver sets

    @property
    def offset(self) -> Floats:
        """(3,) present displacement of the obstacle."""
        return np.asarray(self.contact.value * self.contact.obstacle.motion)

    def let_go(self) -> None:
        """No friction."""
        none = np.zeros(len(self.anchor))
        self._write(none, np.zeros_like(self.anchor), np.zeros_like(self.anchor), none)

    def begin(self, normal: Floats) -> None:
        """Start from the history, with stiffnesses and pushes as the contact now has them.

        :param normal: (node_count, 3).
        """
        self.set(normal, self.carried, self.contact.multiplier)

    def set(self, normal: Floats, force: Floats, push: Floats) -> None:
        """Set normals, as multipliers what of ``force`` (node_count, 3) is across them, and pushes (node_count,)."""
        self.multiplier = self._across(normal, force)
        self._write(self.contact.stiffness, normal, self.multiplier, self.coefficient * push * self.contact.held_up)

    def beyond(self, normal: Floats, force: Floats) -> Floats:
        """(node_count, 3) by how much the next multipliers differ from the present ones."""
        return self._across(normal, force) - self.multiplier

    def _across(self, normal: Floats, force: Floats) -> Floats:
        across = force - np.einsum("ni,ni->n", force, normal)[:, None] * normal
        return np.where(self.contact.held_up[:, None], across, 0.0)

    def _write(self, stiffness: Floats, normal: Floats, multiplier: Floats, limit: Floats) -> None:
        anchor = self.anchor + self.offset
        leading = anchor.astype(self.dtype)
        vectors = np.stack([normal, multiplier, leading, anchor - leading], axis=1)
        self._write_nodes(vectors.astype(self.dtype), np.column_stack([stiffness, limit]).astype(self.dtype))

    @ti.kernel
    def _write_nodes(self, vectors: Array, limit: Array):
        for i in range(limit.shape[0]):
            for c in ti.static(range(3)):
                self.friction_normal[i][c] = vectors[i, 0, c]
                self.friction_multiplier[i][c] = vectors[i, 1, c]
                self.friction_anchor[i][c] = vectors[i, 2, c]
                if ti.static(self.nodes.split_displacement):
                    self.friction_anchor_rest[i][c] = vectors[i, 3, c]
            for c in ti.static(range(2)):
                self.friction_limit[i][c] = limit[i, c]

    def keep(self, displacement: Floats, force: Floats) -> None:
        """Take over an equilibrium as history.

        :param force: (node_count, 3) friction forces.
        """
        self.anchor, self.carried = displacement - self.offset, force.copy()

    # ---- on the device

    @ti.func
    def trial(self, i):
        """s of node ``i``."""
        moved = self.nodes.node_displacement[i] - self.friction_anchor[i]
        if ti.static(self.nodes.split_displacement):
            moved += self.nodes.node_displacement_rest[i] - self.friction_anchor_rest[i]
        normal = self.friction_normal[i]
        trial = self.friction_multiplier[i] - self.friction_limit[i][0] * moved
        return trial - trial.dot(normal) * normal

    @ti.func
    def force(self, i):
        """Friction force on node ``i``."""
        trial, limit = self.trial(i), self.friction_limit[i][1]
        size = trial.norm()
        return ti.select(size <= limit, ti.cast(1.0, self.fp), limit / ti.max(size, 1e-30)) * trial

    @ti.func
    def energy(self, i):
        """Its potential; zero where there is no stiffness."""
        size, stiffness, limit = self.trial(i).norm(), self.friction_limit[i][0], self.friction_limit[i][1]
        work = ti.select(size <= limit, 0.5 * size * size, limit * (size - 0.5 * limit))
        return ti.select(stiffness > 0.0, work / ti.max(stiffness, 1e-30), ti.cast(0.0, self.fp))

    @ti.func
    def bound(self, i):
        """Stiffness bound: k, whether it sticks or not."""
        return self.friction_limit[i][0]

    @ti.func
    def block(self, i):
        """k P, or what is left of it across the force of a node that slips."""
        trial, normal = self.trial(i), self.friction_normal[i]
        stiffness, limit = self.friction_limit[i][0], self.friction_limit[i][1]
        across = ti.Matrix.identity(self.fp, 3) - normal.outer_product(normal)
        size = trial.norm()
        if size > limit:
            along = trial / size
            across = (across - along.outer_product(along)) * (limit / size)
        return stiffness * across

    @ti.kernel
    def write_forces(self, out: Array):
        """Friction forces on all nodes."""
        for i in range(self.nodes.bounds[None].nodes):
            force = self.force(i)
            for c in ti.static(range(3)):
                out[i, c] = force[c]

    def forces(self) -> Floats:
        """(node_count, 3) friction forces at the present displacements."""
        out = np.zeros(self.anchor.shape, dtype=self.dtype)
        self.write_forces(out)
        return out.astype(np.float64)
