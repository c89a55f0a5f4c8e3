"""Device fields and code of a structure's rigid bodies: what relaxation needs of them.

Each gathers force and moment of its nodes; its freedoms have masses of their own, and its nodes follow it. From nodal masses m_i,
4 M ≥ K, and as a positive matrix is below twice its diagonal blocks, freedoms are stable with

    2 Σ m_i   and   (2 Σ m_i r_i² + ¼ Σ |f_i| |r_i|)/ρ²,

the last part for G, none of whose eigenvalues is above Σ |f_i| |r_i| (:mod:`body`). The latter is a scalar, so that no gyroscopic
force acts.
"""

from typing import TYPE_CHECKING

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import Array, fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure

if TYPE_CHECKING:
    from taichi_membrane.mechanics.system import System

# Of a node: in no body, or in one without carrying its freedoms.
ORDINARY, FOLLOWS = -1, -2


@ti.data_oriented
class RigidBodies:
    """Bodies of one structure; see the module text. Those of another structure have to be as many, with no more nodes."""

    def __init__(self, system: "System", structure: Structure) -> None:
        self.system, self.fp, self.dtype = system, system.fp, system.dtype
        count, members = len(structure.bodies), sum(len(body.nodes) for body in structure.bodies)
        self.node_part = ti.field(ti.i32, shape=room(structure.node_count))  # number of the freedoms that it carries
        self.body_start = ti.field(ti.i32, shape=count + 1)
        self.body_node = ti.field(ti.i32, shape=room(members))
        self.body_radius = ti.field(system.fp, shape=count)
        self.body_place = ti.Vector.field(3, system.fp, shape=count)
        self.body_moment = ti.Vector.field(3, system.fp, shape=count)
        self.body_pull = ti.field(system.fp, shape=count)  # Σ |f_i| |r_i|
        self.part_force = ti.Vector.field(3, system.fp, shape=2 * count)
        self.part_step = ti.Vector.field(3, system.fp, shape=2 * count)
        self.part_mass = ti.field(system.fp, shape=2 * count)
        self.count = count

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure's bodies fit these fields."""
        members = sum(len(body.nodes) for body in structure.bodies)
        return (
            len(structure.bodies) == self.count
            and members <= self.body_node.shape[0]
            and structure.node_count <= self.node_part.shape[0]
        )

    def upload(self, structure: Structure) -> None:
        """Take over a structure's bodies, without moments."""
        self.bodies = structure.bodies
        part = np.full(structure.node_count, ORDINARY, dtype=np.int32)
        for number, body in enumerate(self.bodies):
            part[body.nodes] = FOLLOWS
            part[list(body.carriers)] = 2 * number, 2 * number + 1
        self._write(
            part,
            np.concatenate([body.nodes for body in self.bodies]).astype(np.int32),
            np.cumsum([0, *(len(body.nodes) for body in self.bodies)]).astype(np.int32),
            np.array([body.radius for body in self.bodies], dtype=self.dtype),
        )
        self.set_moments(np.zeros((self.count, 3)))
        self.settle(np.zeros((structure.node_count, 3)))

    @ti.kernel
    def _write(self, part: Array, members: Array, start: Array, radius: Array):
        for i in range(part.shape[0]):
            self.node_part[i] = part[i]
            if i < members.shape[0]:
                self.body_node[i] = members[i]
            if i < start.shape[0]:
                self.body_start[i] = start[i]
            if i < radius.shape[0]:
                self.body_radius[i] = radius[i]

    def set_moments(self, moments: Floats) -> None:
        """Set the moments (count, 3) about fixed axes, each that of the only rotation that is free."""
        self.moments = np.array(moments, dtype=np.float64)
        fill(self.body_moment, moments.astype(self.dtype))

    def settle(self, displacement: Floats) -> None:
        """Take the centres from the nodes' displacements (node_count, 3)."""
        places = [body.pose(displacement)[0] - self.system.origin for body in self.system.structure.bodies]
        fill(self.body_place, np.array(places, dtype=self.dtype))

    def work(self, displacement: Floats) -> float:
        """Work of the moments since rest."""
        turns = [
            body.rotation(displacement) if np.any(m) else m for body, m in zip(self.bodies, self.moments, strict=True)
        ]
        return float(sum(turn @ moment for turn, moment in zip(turns, self.moments, strict=True)))

    # ---- on the device

    @ti.func
    def arm(self, b, i):
        """From the centre of body ``b`` to its node ``i``."""
        place = self.system.node_rest[i] - self.body_place[b] + self.system.node_displacement[i]
        if ti.static(self.system.split_displacement):
            place += self.system.node_displacement_rest[i]
        return place

    @ti.func
    def gather(self, b):
        """Force and moment of body ``b``."""
        force = ti.Vector.zero(self.fp, 3)
        moment = self.body_moment[b]
        pull = ti.cast(0.0, self.fp)
        for k in range(self.body_start[b], self.body_start[b + 1]):
            i = self.body_node[k]
            one, arm = self.system.gathered_force(i), self.arm(b, i)
            force += one
            moment += arm.cross(one)
            pull += one.norm() * arm.norm()
        self.part_force[2 * b] = force
        self.part_force[2 * b + 1] = moment / self.body_radius[b]
        self.body_pull[b] = pull

    @ti.func
    def gather_mass(self, b):
        """Fictitious masses of the freedoms of body ``b`` from the bounds in its nodes' slots, after its forces."""
        mass = ti.cast(0.0, self.fp)
        inertia = ti.cast(0.0, self.fp)
        for k in range(self.body_start[b], self.body_start[b + 1]):
            i = self.body_node[k]
            one, arm = self.system.gathered_mass(i), self.arm(b, i)
            mass += 2.0 * one
            inertia += 2.0 * one * arm.norm_sqr()
        self.part_mass[2 * b] = mass
        self.part_mass[2 * b + 1] = (inertia + 0.25 * self.body_pull[b]) / self.body_radius[b] ** 2

    @ti.func
    def note(self, i, step):
        """Note the step of the freedoms that node ``i`` carries for a body, if any."""
        if self.node_part[i] >= 0:
            self.part_step[self.node_part[i]] = step

    @ti.func
    def move(self, b):
        """Move the nodes of body ``b`` by the step of its freedoms."""
        step, turn = self.part_step[2 * b], self.part_step[2 * b + 1] / self.body_radius[b]
        angle = turn.norm()
        # (sin φ)/φ and (1 - cos φ)/φ², without cancellation.
        along, across = ti.cast(1.0, self.fp), ti.cast(0.5, self.fp)
        if angle > 0.0:
            half = ti.sin(0.5 * angle) / (0.5 * angle)
            along, across = ti.sin(angle) / angle, 0.5 * half * half
        for k in range(self.body_start[b], self.body_start[b + 1]):
            i = self.body_node[k]
            spun = turn.cross(self.arm(b, i))
            self.system.add_displacement(i, step + along * spun + across * turn.cross(spun))
        self.body_place[b] += step
