"""Two-node elements in a straight line between their nodes: cables, which bear tension only, and bars.

The extension of the natural triangle's side alone, δ = l - L, with the force T = T₀ + EA δ/L on it. T pulls with T ∂δ/∂x;
tangent and mass bound are those of a side (:mod:`element`). l² - L² is formed from displacements, so that nothing cancels in
single precision.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class CableTerm:
    """Fields and device code of a structure's cables; an element term, see :mod:`taichi_membrane.mechanics.terms`.

    Its slots and pairs come after the triangles'.
    """

    def __init__(self, nodes: Nodes, structure: Structure) -> None:
        assert structure.cables is not None  # else there is no such term
        self.nodes, self.fp, self.dtype = nodes, nodes.fp, nodes.dtype
        size = room(len(structure.cables.nodes))
        self.bounds = ti.types.struct(count=ti.i32, first=ti.i32, pair=ti.i32).field(shape=())
        self.cable_node = ti.Vector.field(2, ti.i32, shape=size)
        # L, |rest|² - L², T₀, EA, and the share of a compression that is borne.
        self.cable_constants = ti.Vector.field(5, nodes.fp, shape=size)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure's cables fit these fields."""
        return structure.cables is not None and len(structure.cables.nodes) <= self.cable_node.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's cables."""
        one = structure.cables
        assert one is not None
        self.structure, self.cable_count = structure, len(one.nodes)
        first, pair = structure.cable_start
        rest = structure.points[one.nodes[:, 1]] - structure.points[one.nodes[:, 0]]
        excess = (rest**2).sum(axis=1) - one.length**2
        constants = np.column_stack([one.length, excess, one.prestress, one.stiffness, one.bar])
        self._write(one.nodes.astype(np.int32), constants.astype(self.dtype), self.cable_count, first, pair)

    @ti.kernel
    def _write(self, nodes: Array, constants: Array, count: int, first: int, pair: int):
        """All in one kernel; each number written from the host would be one."""
        for e in range(count):
            if e == 0:
                self.bounds[None].count = count
                self.bounds[None].first = first
                self.bounds[None].pair = pair
            for c in ti.static(range(2)):
                self.cable_node[e][c] = nodes[e, c]
            for c in ti.static(range(5)):
                self.cable_constants[e][c] = constants[e, c]

    @ti.func
    def count(self):
        """How many."""
        return self.bounds[None].count

    @ti.func
    def state(self, e):
        """Side vector, its length, force and stiffness EA/L of cable ``e``; both zero where it is slack."""
        i, j = self.cable_node[e][0], self.cable_node[e][1]
        unstressed, excess = self.cable_constants[e][0], self.cable_constants[e][1]
        rest = self.nodes.node_rest[j] - self.nodes.node_rest[i]
        stretch = self.nodes.displacement_difference(j, i)
        side = rest + stretch
        length = side.norm()
        extension = ((2.0 * rest + stretch).dot(stretch) + excess) / (length + unstressed)
        stiffness = self.cable_constants[e][3] / unstressed
        force = self.cable_constants[e][2] + stiffness * extension
        if force < 0.0:
            force *= self.cable_constants[e][4]
            stiffness *= self.cable_constants[e][4]
        return side, length, force, stiffness

    @ti.func
    def store_forces(self, e):
        """Forces of cable ``e`` on its ends."""
        side, length, force, _stiffness = self.state(e)
        pull = force / length * side
        slot = self.bounds[None].first + 2 * e
        self.nodes.slot_force[slot] = pull
        self.nodes.slot_force[slot + 1] = -pull

    @ti.func
    def energy(self, e):
        """Stored energy T² L/(2 EA), that of the prestress included, as a fabric's; no work."""
        _side, _length, force, _stiffness = self.state(e)
        stored = 0.5 * force**2 * self.cable_constants[e][0] / self.cable_constants[e][3]
        return ti.Vector([stored, ti.cast(0.0, self.fp)])

    @ti.func
    def store_bounds(self, e):
        """Stiffness bound of cable ``e`` at both ends: EA/L along it, T/l across; a slack one counts as taut."""
        _side, length, force, _stiffness = self.state(e)
        unstressed = self.cable_constants[e][0]
        bound = element.side_stiffness_bound(
            self.cable_constants[e][3] / unstressed, force, length, unstressed, 0.0, False
        )
        slot = self.bounds[None].first + 2 * e
        for end in ti.static(range(2)):
            self.nodes.slot_force[slot + end] = ti.Vector([bound, 0.0, 0.0])

    @ti.func
    def store_blocks(self, e, slot_block: ti.template(), pair_block: ti.template()):
        """EA/L c cᵀ + T/l (I - c cᵀ), c the direction."""
        side, length, force, stiffness = self.state(e)
        block = stiffness / length**2 * side.outer_product(side)
        block += element.side_curvature(force, side, length, 1.0 / length, False)
        first = self.bounds[None].first
        slot_block[first + 2 * e] = block
        slot_block[first + 2 * e + 1] = block
        pair_block[self.bounds[None].pair + e] = -block

    @ti.kernel
    def _state_kernel(self, out: ti.types.ndarray()):
        for e in range(self.bounds[None].count):
            _side, length, force, _stiffness = self.state(e)
            out[e, 0] = force
            out[e, 1] = length

    def forces(self) -> Floats:
        """(cable_count,) force of each cable at the present displacements, tension positive."""
        out = np.zeros((self.cable_count, 2), dtype=self.dtype)
        self._state_kernel(out)
        return out[:, 0].astype(np.float64)
