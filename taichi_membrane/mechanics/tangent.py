"""Consistent tangent stiffness of a membrane, written by kernels straight into the blocks that are factorised.

Each element stores a 3×3 block for each of its ends and one for each pair of them; each block of the matrix then gathers its
elements' in fixed order, as many as there are.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.algebra.elimination import Elimination, eliminate
from taichi_membrane.algebra.protocol import DIRECT, Algebra
from taichi_membrane.device import runtime
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.bodies import ORDINARY
from taichi_membrane.mechanics.nodes import Array, room
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mechanics.reduction import Reduction
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.vectors import outer


@ti.data_oriented
class Tangent:
    """Assembles a system's tangent stiffness at its present displacements; double precision only."""

    def __init__(self, system: System, algebra: Algebra = DIRECT) -> None:
        self.system, self.algebra = system, algebra
        structure = system.structure
        nodes, slots = system.node_rest.shape[0], system.node_slot.shape[0]
        pairs = room(len(structure.pairs), 3 if structure.mesh.order == 1 else 15)
        edges = room(len(structure.edges), 2 if structure.mesh.order == 1 else 8)
        self.edge_count = ti.field(ti.i32, shape=())
        self.slot_block = ti.Matrix.field(3, 3, system.fp, shape=slots)
        self.pair_block = ti.Matrix.field(3, 3, system.fp, shape=pairs)
        self.node_block = ti.field(ti.i32, shape=nodes)
        self.edge_block = ti.field(ti.i32, shape=edges)
        self.edge_node = ti.Vector.field(2, ti.i32, shape=edges)  # of the block's columns, of its rows
        self.edge_start = ti.field(ti.i32, shape=edges + 1)
        self.edge_pair = ti.field(ti.i32, shape=pairs)  # a pair, or its complement where it is to be transposed
        self.upload()

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where it fits the system."""
        return len(structure.edges) < self.edge_start.shape[0] and len(structure.pairs) <= self.edge_pair.shape[0]

    def upload(self) -> None:
        """Take over the structure that is now in the system's fields."""
        structure = self.system.structure
        self._take(structure.elimination, np.arange(len(structure.edges)), structure.edge_pairs)
        self.couples: Ints = np.zeros((0, 2), dtype=np.int64)  # beyond the elements' own
        self.reduction = Reduction(structure, self.elimination) if structure.bodies else None

    def _take(self, elimination: Elimination, own: Ints, pairs: tuple[Ints, Ints]) -> None:
        """Write to the blocks of a symbolic factorisation.

        :param own: which of its edges elements have.
        """
        self.elimination, self.solver = elimination, self.algebra.solver(elimination, runtime.current().threads)
        self._write(elimination.node_block, elimination.edge_block[own], elimination.edge_node[own], *pairs)
        self.blocks = np.zeros((elimination.block_count, 3, 3))

    def couple(self, pairs: Ints) -> None:
        """Make room for what contact couples beside the elements: another symbolic factorisation.

        :param pairs: (k, 2) nodes, the lower number first.
        """
        structure = self.system.structure
        count, edges = structure.node_count, structure.edges.astype(np.int64)
        self.couples = pairs
        self._edge_keys = np.unique(np.concatenate([edges, pairs]) @ [count, 1])
        every = np.column_stack(np.divmod(self._edge_keys, count)).astype(np.int32)
        elimination = eliminate(structure.points, every)
        own = np.searchsorted(self._edge_keys, edges @ [count, 1])
        rows = elimination.edge_node[own, 1]
        self._take(elimination, own, preparation.pair_lists(structure.pairs, structure.edges, rows, count))

    def has(self, pairs: Ints) -> bool:
        """Whether there is room for what contact couples."""
        if not len(self.couples):
            return not len(pairs)
        keys = pairs @ np.array([self.system.structure.node_count, 1])
        return bool(np.isin(keys, self._edge_keys).all())

    @ti.kernel
    def _write(
        self, node_block: Array, edge_block: Array, edge_node: Array, edge_start: Array, edge_pair: Array,
    ):  # fmt: skip
        for i in range(ti.max(node_block.shape[0], edge_start.shape[0], edge_pair.shape[0])):
            if i == 0:
                self.edge_count[None] = edge_block.shape[0]
            if i < node_block.shape[0]:
                self.node_block[i] = node_block[i]
            if i < edge_block.shape[0]:
                self.edge_block[i] = edge_block[i]
                for c in ti.static(range(2)):
                    self.edge_node[i][c] = edge_node[i, c]
            if i < edge_start.shape[0]:
                self.edge_start[i] = edge_start[i]
            if i < edge_pair.shape[0]:
                self.edge_pair[i] = edge_pair[i]

    @ti.kernel
    def _assemble(self, out: ti.types.ndarray()):
        for term in ti.static(self.system.terms):
            ti.loop_config(block_dim=self.system.block_dim)
            for e in range(term.count()):
                term.store_blocks(e, self.slot_block, self.pair_block)
        ti.loop_config(block_dim=self.system.block_dim)
        for i in range(self.system.bounds[None].nodes):
            block = ti.Matrix.zero(self.system.fp, 3, 3)
            for s in range(self.system.node_slot_start[i], self.system.node_slot_start[i + 1]):
                block += self.slot_block[self.system.node_slot[s]]
            for term in ti.static(self.system.node_terms):
                block += term.block(i)
            for rigid in ti.static(self.system.rigid):
                if rigid.node_part[i] != ORDINARY:
                    block = ti.Matrix.zero(self.system.fp, 3, 3)  # theirs are added on the host
            self.write_block(self.node_block[i], self.in_frames(block, i, i), i, i, out)
            for c in ti.static(range(3)):
                if self.system.node_held[i][c] == 1:
                    out[self.node_block[i], c, c] = 1.0
        ti.loop_config(block_dim=self.system.block_dim)
        for e in range(self.edge_count[None]):
            block = ti.Matrix.zero(self.system.fp, 3, 3)
            for p in range(self.edge_start[e], self.edge_start[e + 1]):
                pair = self.edge_pair[p]
                if pair >= 0:
                    block += self.pair_block[pair]
                else:
                    block += self.pair_block[~pair].transpose()
            column, row = self.edge_node[e][0], self.edge_node[e][1]
            self.write_block(self.edge_block[e], self.in_frames(block, row, column), row, column, out)

    @ti.func
    def in_frames(self, block, i, j):
        """A block that couples nodes ``i`` (rows) and ``j`` (columns), in the axes their supports refer to."""
        result = block
        if ti.static(self.system.features.slanted):
            result = self.system.node_frame[i] @ block @ self.system.node_frame[j].transpose()
        return result

    @ti.func
    def write_block(self, number, block, row, column, out: ti.template()):
        """A block that couples nodes ``row`` and ``column``, with zeros at held components."""
        free = outer(1 - self.system.node_held[row], 1 - self.system.node_held[column])
        kept = ti.select(free == 1, block, ti.Matrix.zero(self.system.fp, 3, 3))
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                out[number, i, j] = kept[i, j]

    def assemble(self) -> Floats:
        """Blocks of the lower triangle (block_count, 3, 3) at the present displacements and pressures, of the freedoms; the same
        array each time. Held components have 1 on the diagonal and 0 beside it."""
        if len(self.couples):
            self.blocks[:] = 0.0
        self._assemble(self.blocks)
        if self.system.walls is not None and len(self.couples):
            self.system.walls.add_blocks(self.blocks, self.elimination, self._edge_keys)
        if self.reduction is not None:
            one = self.reduction
            of_slots, of_pairs = np.zeros((len(one.slots), 3, 3)), np.zeros((len(one.pairs), 3, 3))
            self._fetch(one.slots, one.pairs, of_slots, of_pairs)
            of_nodes = np.zeros((len(one.nodes), 3, 3))
            if self.system.node_terms:
                self._fetch_nodes(one.nodes, of_nodes)
            one.add(self.blocks, of_slots, of_pairs, of_nodes, self.system.displacement(), self.system.out_of_balance())
        return self.blocks

    @ti.kernel
    def _fetch(self, slots: Array, pairs: Array, of_slots: Array, of_pairs: Array):
        """Blocks of elements at bodies."""
        for s in range(slots.shape[0]):
            for i, j in ti.static(ti.ndrange(3, 3)):
                of_slots[s, i, j] = self.slot_block[slots[s]][i, j]
        for p in range(pairs.shape[0]):
            for i, j in ti.static(ti.ndrange(3, 3)):
                of_pairs[p, i, j] = self.pair_block[pairs[p]][i, j]

    @ti.kernel
    def _fetch_nodes(self, nodes: Array, of_nodes: Array):
        """Blocks of node terms at nodes of bodies."""
        for n in range(nodes.shape[0]):
            block = ti.Matrix.zero(self.system.fp, 3, 3)
            for term in ti.static(self.system.node_terms):
                block += term.block(nodes[n])
            for i, j in ti.static(ti.ndrange(3, 3)):
                of_nodes[n, i, j] = block[i, j]

    def loose(self, free: NDArray[np.bool_]) -> Floats | None:
        """(node_count, 3) a stiffness for free nodes that nothing in the assembled blocks holds, such as one amid slack triangles.

        Their rows are zero: they take no part in any force, and whatever stiffness they get, the rest stays as it is. A node that
        something holds in one direction and nothing in another, as in a flat sheet, is another matter: a load would move it. None
        where there is no loose node.
        """
        blocks, elimination = self.blocks, self.elimination
        loose = free.all(axis=1) & (np.abs(blocks[elimination.node_block]).max(axis=(1, 2)) == 0.0)
        if not loose.any():
            return None
        beside = np.abs(blocks[elimination.edge_block]).max(axis=(1, 2))
        column, row = elimination.edge_node.T
        loose[row[beside > 0.0]] = False  # pressure couples nodes whose own block is zero
        loose[column[beside > 0.0]] = False
        return np.where(loose[:, None], np.ones(3), 0.0)

    def hold(self, held: Floats) -> None:
        """Take freedoms out of the assembled blocks: their rows and columns become those of a stiffness by themselves.

        :param held: (node_count, 3, 3) projections on them, in the axes that supports refer to.
        """
        blocks, elimination = self.blocks, self.elimination
        left = np.eye(3) - held
        own = blocks[elimination.node_block]
        stiff = np.abs(own).max(axis=(1, 2), initial=0.0)
        blocks[elimination.node_block] = left @ own @ left + np.where(stiff > 0.0, stiff, 1.0)[:, None, None] * held
        touched = np.abs(held).max(axis=(1, 2)) > 0.0
        column, row = elimination.edge_node.T
        some = np.flatnonzero(touched[row] | touched[column])
        numbers = elimination.edge_block[some]
        blocks[numbers] = left[row[some]] @ blocks[numbers] @ left[column[some]]

    def matrix(self) -> scipy.sparse.csr_matrix:
        """The present tangent as a whole sparse matrix over 3 · node_count components, held ones as in :meth:`assemble`."""
        blocks, elimination = self.assemble(), self.elimination
        column, row = elimination.edge_node.T
        nodes = np.arange(self.system.node_count)
        below, diagonal = blocks[elimination.edge_block], blocks[elimination.node_block]
        data = np.concatenate([diagonal, below, below.transpose(0, 2, 1)])
        block_row, block_column = np.concatenate([nodes, row, column]), np.concatenate([nodes, column, row])
        i, j = np.meshgrid(np.arange(3), np.arange(3), indexing="ij")
        rows, columns = 3 * block_row[:, None, None] + i, 3 * block_column[:, None, None] + j
        size = 3 * self.system.node_count
        return scipy.sparse.csr_matrix((data.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
