"""Consistent tangent stiffness of a membrane, written by kernels straight into the blocks that are factorised.

K = ∂²Π/∂x²: material tangent of the wrinkling law, geometric stiffness of the natural forces, symmetric pressure stiffness. Each
triangle stores its six distinct 3×3 blocks; each block of the matrix then gathers its triangles' in fixed order.
"""

from typing import Any

import numpy as np
from scipy import sparse

from taichi_membrane.algebra.multifrontal import Multifrontal
from taichi_membrane.device import runtime
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element, fabric
from taichi_membrane.mechanics.membrane import Membrane
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure

# The distinct blocks of a triangle: the three diagonal ones, then side a's, which couples corners a+1 and a+2.
_BLOCKS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))

_Array: Any = ti.types.ndarray()


@ti.data_oriented
class Tangent:
    """Assembles a membrane's tangent stiffness at its present displacements; double precision only."""

    def __init__(self, membrane: Membrane) -> None:
        self.membrane = membrane
        nodes, triangles, edges = (
            membrane.node_rest.shape[0],
            membrane.tri_node.shape[0],
            len(membrane.structure.edge_parts),
        )
        self.edge_count = ti.field(ti.i32, shape=())
        self.tri_block = ti.Matrix.field(3, 3, membrane.fp, shape=6 * triangles)
        self.node_block = ti.field(ti.i32, shape=nodes)
        self.edge_block = ti.field(ti.i32, shape=edges)
        self.edge_node = ti.Vector.field(2, ti.i32, shape=edges)  # of the block's columns, of its rows
        self.edge_part = ti.Vector.field(2, ti.i32, shape=edges)
        self.upload()

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where it fits the membrane."""
        return len(structure.edge_parts) <= self.edge_part.shape[0]

    def upload(self) -> None:
        """Take over the structure that is now in the membrane's fields."""
        structure = self.membrane.structure
        self.elimination = structure.elimination
        self.solver = Multifrontal(self.elimination, runtime.current().threads)
        elimination = self.elimination
        self._write(elimination.node_block, elimination.edge_block, elimination.edge_node, structure.edge_parts)
        self.blocks = np.zeros((self.elimination.block_count, 3, 3))

    @ti.kernel
    def _write(
        self, node_block: _Array, edge_block: _Array, edge_node: _Array, edge_part: _Array,
    ):  # fmt: skip
        self.edge_count[None] = edge_block.shape[0]
        for i in range(node_block.shape[0]):
            self.node_block[i] = node_block[i]
        for e in range(edge_block.shape[0]):
            self.edge_block[e] = edge_block[e]
            for c in ti.static(range(2)):
                self.edge_node[e][c] = edge_node[e, c]
                self.edge_part[e][c] = edge_part[e, c]

    @ti.func
    def store_blocks(self, t, k, variant: ti.template()):
        """The six blocks of triangle ``t``."""
        rest, stretch = self.membrane.sides(t)
        strain, length, factor = self.membrane.strain_and_sides(t, k, rest, stretch, variant)
        constants = self.membrane.fabric_constants[k]
        stress, _, _ = fabric.response(strain, constants, variant.law, variant.orthotropic)
        matrix = self.membrane.tri_strain_matrix[t]
        volume = self.membrane.tri_volume[t]
        side_force = volume * (matrix.transpose() @ stress)
        material = fabric.tangent(strain, constants, variant.law, variant.orthotropic)
        natural = volume * (matrix.transpose() @ material @ matrix)
        pressure = self.membrane.pressure_on(t)
        sides = rest + stretch
        gradient = ti.Matrix.zero(self.membrane.fp, 3, 3)
        for a in ti.static(range(3)):
            for c in ti.static(range(3)):
                gradient[a, c] = factor[a] * sides[a, c]
        for number in ti.static(range(6)):
            first, second = ti.static(_BLOCKS[number][0], _BLOCKS[number][1])
            block = ti.Matrix.zero(self.membrane.fp, 3, 3)
            for a in ti.static(range(3)):
                if ti.static(_sign(a, first) != 0):
                    left = ti.static(float(_sign(a, first))) * gradient[a, :]
                    right = ti.Vector.zero(self.membrane.fp, 3)
                    for b in ti.static(range(3)):
                        if ti.static(_sign(b, second) != 0):
                            right += ti.static(float(_sign(b, second))) * natural[a, b] * gradient[b, :]
                    block += left.outer_product(right)
                    if ti.static(_sign(a, second) != 0):
                        both = ti.static(float(_sign(a, first) * _sign(a, second)))
                        block += both * element.side_curvature(
                            side_force[a], sides[a, :], length[a], factor[a], variant.green
                        )
            if ti.static(first != second and self.membrane.features.pressure != "none"):
                block += element.pressure_stiffness(pressure, sides[first, :], sides[second, :])
            self.tri_block[6 * t + number] = block

    @ti.kernel
    def _assemble(self, out: ti.types.ndarray()):
        ti.loop_config(block_dim=self.membrane.block_dim)
        for t in range(self.membrane.bounds[None].triangles):
            k = self.membrane.fabric_number(t)
            for number in ti.static(range(len(self.membrane.features.variants))):
                if self.membrane.has_variant(k, number):
                    self.store_blocks(t, k, self.membrane.features.variants[number])
        ti.loop_config(block_dim=self.membrane.block_dim)
        for i in range(self.membrane.bounds[None].nodes):
            block = ti.Matrix.zero(self.membrane.fp, 3, 3)
            for c in range(self.membrane.node_corner_start[i], self.membrane.node_corner_start[i + 1]):
                corner = self.membrane.node_corner[c]
                block += self.tri_block[6 * (corner // 3) + corner % 3]
            self.write_block(self.node_block[i], self.in_frames(block, i, i), i, i, out)
            for c in ti.static(range(3)):
                if self.membrane.node_held[i][c] == 1:
                    out[self.node_block[i], c, c] = 1.0
        ti.loop_config(block_dim=self.membrane.block_dim)
        for e in range(self.edge_count[None]):
            block = ti.Matrix.zero(self.membrane.fp, 3, 3)
            for p in ti.static(range(2)):
                part = self.edge_part[e][p]
                if part >= 0:
                    # The stored block couples the side's first corner (rows) to its second (columns).
                    t, a = part // 3, part % 3
                    stored = self.tri_block[6 * t + 3 + a]
                    if self.membrane.tri_node[t][(a + 1) % 3] == self.edge_node[e][0]:
                        stored = stored.transpose()
                    block += stored
            column, row = self.edge_node[e][0], self.edge_node[e][1]
            self.write_block(self.edge_block[e], self.in_frames(block, row, column), row, column, out)

    @ti.func
    def in_frames(self, block, i, j):
        """A block that couples nodes ``i`` (rows) and ``j`` (columns), in the axes their supports refer to."""
        result = block
        if ti.static(self.membrane.features.slanted):
            result = self.membrane.node_frame[i] @ block @ self.membrane.node_frame[j].transpose()
        return result

    @ti.func
    def write_block(self, number, block, row, column, out: ti.template()):
        """A block that couples nodes ``row`` and ``column``, with zeros at held components."""
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                free = (1 - self.membrane.node_held[row][i]) * (1 - self.membrane.node_held[column][j])
                out[number, i, j] = ti.select(free == 1, block[i, j], ti.cast(0.0, self.membrane.fp))

    def assemble(self) -> Floats:
        """Blocks of the lower triangle (block_count, 3, 3) at the present displacements and pressures, in the supports' axes; the
        same array each time. Held components have 1 on the diagonal and 0 beside it."""
        self._assemble(self.blocks)
        return self.blocks

    def matrix(self) -> sparse.csr_matrix:
        """The present tangent as a whole sparse matrix over 3 · node_count components, held ones as in :meth:`assemble`."""
        blocks, elimination = self.assemble(), self.elimination
        column, row = elimination.edge_node.T
        nodes = np.arange(self.membrane.node_count)
        below, diagonal = blocks[elimination.edge_block], blocks[elimination.node_block]
        data = np.concatenate([diagonal, below, below.transpose(0, 2, 1)])
        block_row, block_column = np.concatenate([nodes, row, column]), np.concatenate([nodes, column, row])
        i, j = np.meshgrid(np.arange(3), np.arange(3), indexing="ij")
        rows, columns = 3 * block_row[:, None, None] + i, 3 * block_column[:, None, None] + j
        size = 3 * self.membrane.node_count
        return sparse.csr_matrix((data.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))


def _sign(side: int, corner: int) -> int:
    """How side ``side``'s vector depends on a corner's position: +1 at its far end, -1 at its near end, 0 opposite."""
    return {2: 1, 1: -1, 0: 0}[(corner - side) % 3]
