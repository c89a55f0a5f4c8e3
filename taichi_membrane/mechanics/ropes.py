"""Cables that slide over their inner nodes without friction, as over pulleys: one force all along.

With l = Σ l_k the length of all straight pieces, T = T₀ + EA (l - L)/L, and T ∂l/∂x pulls: at an inner node both pieces with the
same force. Its tangent is T times the curvature of the pieces plus EA/L b bᵀ, b = ∂l/∂x, which couples every two nodes; a cable
runs over few, so that these blocks are assembled like all others, and the sum is what is factorised.

A mass bound: as b = (b_a) with |b_a| ≤ w_a, w = 2 at inner nodes and 1 at ends, (b·x)² ≤ (Σ w) Σ w_a |x_a|², by Cauchy and
Schwarz. So K ≤ 2 diag(k) with k_a = w_a/2 (Σ w) EA/L + Σ T/l of the pieces at a; Σ w is twice the number of pieces. With one
piece this is the bound of a cable's, but for the sum in place of the larger of both.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class RopeTerm:
    """Fields and device code of a structure's sliding cables; an element term, see :mod:`taichi_membrane.mechanics.terms`.

    Each is one element, with a slot for each of its nodes and a pair for every two. They come after those of other cables.
    """

    def __init__(self, nodes: Nodes, structure: Structure) -> None:
        assert structure.ropes is not None  # else there is no such term
        self.nodes, self.fp, self.dtype = nodes, nodes.fp, nodes.dtype
        ropes = structure.ropes
        self.bounds = ti.types.struct(count=ti.i32, slot=ti.i32, pair=ti.i32).field(shape=())
        self.rope_node = ti.field(ti.i32, shape=room(len(ropes.chain)))
        self.rope_pull = ti.Vector.field(3, nodes.fp, shape=room(len(ropes.chain)))  # b
        self.rope_place = ti.Vector.field(
            4, ti.i32, shape=room(ropes.count)
        )  # first node, their number, first pair, closed
        # Length of the pieces at rest less L, L, T₀, EA.
        self.rope_constants = ti.Vector.field(4, nodes.fp, shape=room(ropes.count))

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure's sliding cables fit these fields."""
        ropes = structure.ropes
        if ropes is None:
            return False
        return ropes.count <= self.rope_place.shape[0] and len(ropes.chain) <= self.rope_node.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's sliding cables."""
        ropes = structure.ropes
        assert ropes is not None
        self.structure, self.ropes = structure, ropes
        others = 0 if structure.cables is None else len(structure.cables.nodes)
        slot, pair = structure.cable_start
        ends = structure.points[ropes.sides]
        first = np.concatenate([[0], np.cumsum(ropes.side_counts)])[:-1]
        rest = np.add.reduceat(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), first)
        place = np.column_stack([ropes.start[:-1], np.diff(ropes.start), ropes.pair_start[:-1], ropes.closed])
        constants = np.column_stack([rest - ropes.length, ropes.length, ropes.prestress, ropes.stiffness])
        bounds = np.array([ropes.count, slot + 2 * others, pair + others], dtype=np.int32)
        self._write(ropes.chain.astype(np.int32), place.astype(np.int32), constants.astype(self.dtype), bounds)

    @ti.kernel
    def _write(self, chain: Array, place: Array, constants: Array, bounds: Array):
        """All in one kernel; each number written from the host would be one."""
        for i in range(chain.shape[0]):
            self.rope_node[i] = chain[i]
            if i == 0:
                self.bounds[None].count = bounds[0]
                self.bounds[None].slot = bounds[1]
                self.bounds[None].pair = bounds[2]
            if i < place.shape[0]:
                for c in ti.static(range(4)):
                    self.rope_place[i][c] = place[i, c]
                    self.rope_constants[i][c] = constants[i, c]

    @ti.func
    def count(self):
        """How many."""
        return self.bounds[None].count

    @ti.func
    def piece(self, e, k):
        """Vector of the piece of cable ``e`` from its ``k``-th node to the next one, its length, and its growth since rest."""
        place = self.rope_place[e]
        i, j = self.rope_node[place[0] + k], self.rope_node[place[0] + (k + 1) % place[1]]
        rest = self.nodes.node_rest[j] - self.nodes.node_rest[i]
        stretch = self.nodes.displacement_difference(j, i)
        side = rest + stretch
        length = side.norm()
        return side, length, (2.0 * rest + stretch).dot(stretch) / (length + rest.norm())

    @ti.func
    def pieces(self, e):
        """How many pieces cable ``e`` has."""
        return self.rope_place[e][1] - 1 + self.rope_place[e][3]

    @ti.func
    def state(self, e):
        """Force and stiffness EA/L of cable ``e``; both zero where it is slack."""
        extension = self.rope_constants[e][0]
        for k in range(self.pieces(e)):
            _side, _length, growth = self.piece(e, k)
            extension += growth
        stiffness = self.rope_constants[e][3] / self.rope_constants[e][1]
        force = self.rope_constants[e][2] + stiffness * extension
        if force < 0.0:
            force *= 0.0
            stiffness *= 0.0
        return force, stiffness

    @ti.func
    def store_forces(self, e):
        """Forces of cable ``e`` on its nodes."""
        place = self.rope_place[e]
        force, _stiffness = self.state(e)
        first = self.bounds[None].slot + place[0]
        for k in range(place[1]):
            self.nodes.slot_force[first + k] = ti.Vector.zero(self.fp, 3)
        for k in range(self.pieces(e)):
            side, length, _growth = self.piece(e, k)
            pull = force / length * side
            self.add(self.nodes.slot_force, first + k, pull)
            self.add(self.nodes.slot_force, first + (k + 1) % place[1], -pull)

    @ti.func
    def add(self, field: ti.template(), number, value):
        """Add to a field where one thread alone writes: an atomic addition is more than is needed, and not on every back end."""
        field[number] = field[number] + value

    @ti.func
    def energy(self, e):
        """Stored energy T² L/(2 EA); no work."""
        force, _stiffness = self.state(e)
        stored = 0.5 * force**2 * self.rope_constants[e][1] / self.rope_constants[e][3]
        return ti.Vector([stored, ti.cast(0.0, self.fp)])

    @ti.func
    def store_bounds(self, e):
        """Stiffness bound of cable ``e`` at each of its nodes, see the module's text; a slack one counts as taut."""
        place = self.rope_place[e]
        force, _stiffness = self.state(e)
        first, pieces = self.bounds[None].slot + place[0], self.pieces(e)
        along = self.rope_constants[e][3] / self.rope_constants[e][1] * pieces
        for k in range(place[1]):
            self.nodes.slot_force[first + k] = ti.Vector.zero(self.fp, 3)
        for k in range(pieces):
            _side, length, _growth = self.piece(e, k)
            bound = ti.Vector([along + force / length, 0.0, 0.0])
            self.add(self.nodes.slot_force, first + k, bound)
            self.add(self.nodes.slot_force, first + (k + 1) % place[1], bound)

    @ti.func
    def store_blocks(self, e, slot_block: ti.template(), pair_block: ti.template()):
        """EA/L b_a b_cᵀ of every two nodes, and T/l (I - c cᵀ) of each piece."""
        place = self.rope_place[e]
        force, stiffness = self.state(e)
        number, slot = place[1], self.bounds[None].slot + place[0]
        for a in range(number):
            self.rope_pull[place[0] + a] = ti.Vector.zero(self.fp, 3)
        for k in range(self.pieces(e)):
            side, length, _growth = self.piece(e, k)
            self.add(self.rope_pull, place[0] + k, -side / length)
            self.add(self.rope_pull, place[0] + (k + 1) % number, side / length)
        pair = self.bounds[None].pair + place[2]
        for a in range(number):
            b_a = self.rope_pull[place[0] + a]
            slot_block[slot + a] = stiffness * b_a.outer_product(b_a)
            for c in range(a + 1, number):
                pair_block[pair] = stiffness * b_a.outer_product(self.rope_pull[place[0] + c])
                pair += 1
        for k in range(self.pieces(e)):
            side, length, _growth = self.piece(e, k)
            block = element.side_curvature(force, side, length, 1.0 / length, False)
            other = (k + 1) % number
            self.add(slot_block, slot + k, block)
            self.add(slot_block, slot + other, block)
            a, c = ti.min(k, other), ti.max(k, other)
            between = self.bounds[None].pair + place[2] + a * number - a * (a + 1) // 2 + c - a - 1
            self.add(pair_block, between, -block)

    @ti.kernel
    def _state_kernel(self, out: ti.types.ndarray()):
        for e in range(self.bounds[None].count):
            force, _stiffness = self.state(e)
            out[e] = force

    def forces(self) -> Floats:
        """Force of each straight piece at the present displacements: that of its cable."""
        out = np.zeros(self.ropes.count, dtype=self.dtype)
        self._state_kernel(out)
        return np.repeat(out.astype(np.float64), self.ropes.side_counts)
