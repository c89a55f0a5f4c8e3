"""Consistent tangent stiffness of a membrane, written by kernels straight into the values of a fixed sparse pattern.

K = ∂²Π/∂x²: material tangent of the wrinkling law, geometric stiffness of the natural forces, symmetric pressure stiffness. Each
triangle stores its six distinct 3×3 blocks; each stored block of the matrix then gathers its one or two triangles in fixed order.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray
from scipy import sparse

from taichi_membrane.engine import element, fabric
from taichi_membrane.engine.membrane import Membrane

# The distinct blocks of a triangle: the three diagonal ones, then side a's, which couples corners a+1 and a+2.
_BLOCKS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """Sparsity of the lower triangle over free degrees of freedom, in compressed sparse columns.

    :param size: number of free degrees of freedom.
    :param column_start: (size + 1,) start of each column's entries; ``row`` their row numbers, the diagonal first.
    :param node_dof: (node_count, 3) number of each free displacement component, -1 where held.
    """

    size: int
    column_start: NDArray[np.int32]
    row: NDArray[np.int32]
    node_dof: NDArray[np.int32]


def lower_pattern(mesh_edges: NDArray[np.int32], node_held: NDArray[np.bool_]) -> tuple[Pattern, NDArray[np.int32]]:
    """Pattern of the lower triangle, and where each block's nine entries go.

    Blocks are numbered nodes first, then edges (lower node, higher node). The second result is (block_count, 9): the place of entry
    3·i + j of the block in the values, i in the higher node's and j in the lower node's components; -1 where it is not stored.
    """
    node_count = len(node_held)
    node_dof = np.full((node_count, 3), -1, dtype=np.int32)
    free = ~node_held
    size = int(free.sum())
    node_dof[free] = np.arange(size, dtype=np.int32)
    nodes = np.arange(node_count, dtype=np.int32)
    column_node = np.concatenate([nodes, mesh_edges[:, 0]])
    row_node = np.concatenate([nodes, mesh_edges[:, 1]])
    row = np.repeat(node_dof[row_node], 3, axis=1)
    column = np.tile(node_dof[column_node], (1, 3))
    stored = (row >= 0) & (column >= 0) & (row >= column)
    number = np.arange(row.size, dtype=np.int64).reshape(row.shape)
    # scipy sorts the entries by columns in linear time; carried along as values, their numbers tell where each one went.
    coordinates = sparse.coo_matrix((number[stored] + 1, (row[stored], column[stored])), shape=(size, size))
    matrix = coordinates.tocsc()
    matrix.sort_indices()
    slot = np.full(row.size, -1, dtype=np.int32)
    slot[matrix.data - 1] = np.arange(matrix.nnz, dtype=np.int32)
    pattern = Pattern(
        size=size,
        column_start=matrix.indptr.astype(np.int32),
        row=matrix.indices.astype(np.int32),
        node_dof=node_dof,
    )
    return pattern, slot.reshape(row.shape)


@ti.data_oriented
class Tangent:
    """Assembles a membrane's tangent stiffness at its present displacements; double precision only."""

    def __init__(self, membrane: Membrane) -> None:
        self.membrane = membrane
        mesh = membrane.structure.mesh
        edges = mesh.edges()
        self.pattern, slot = lower_pattern(edges, membrane.structure.node_held)
        self.edge_count = len(edges)
        self.tri_block = ti.Matrix.field(3, 3, membrane.fp, shape=6 * membrane.tri_count)
        self.block_slot = ti.Vector.field(9, ti.i32, shape=membrane.node_count + self.edge_count)
        self.block_slot.from_numpy(slot)
        self.edge_part = ti.Vector.field(2, ti.i32, shape=self.edge_count)
        self.edge_part.from_numpy(_edge_parts(mesh.triangles, edges))
        self.edge_node = ti.Vector.field(2, ti.i32, shape=self.edge_count)  # lower number first
        self.edge_node.from_numpy(np.ascontiguousarray(edges))
        self.values = np.zeros(len(self.pattern.row))

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
    def _assemble(self, values: ti.types.ndarray()):
        for t in range(self.membrane.tri_count):
            k = self.membrane.fabric_number(t)
            for number in ti.static(range(len(self.membrane.features.variants))):
                if self.membrane.has_variant(k, number):
                    self.store_blocks(t, k, self.membrane.features.variants[number])
        for i in range(self.membrane.node_count):
            block = ti.Matrix.zero(self.membrane.fp, 3, 3)
            for c in range(self.membrane.node_corner_start[i], self.membrane.node_corner_start[i + 1]):
                corner = self.membrane.node_corner[c]
                block += self.tri_block[6 * (corner // 3) + corner % 3]
            self.write_block(i, self.in_frames(block, i, i), values)
        for e in range(self.edge_count):
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
            block = self.in_frames(block, self.edge_node[e][1], self.edge_node[e][0])
            self.write_block(self.membrane.node_count + e, block, values)

    @ti.func
    def in_frames(self, block, i, j):
        """A block that couples nodes ``i`` (rows) and ``j`` (columns), in the axes their supports refer to."""
        result = block
        if ti.static(self.membrane.features.slanted):
            result = self.membrane.node_frame[i] @ block @ self.membrane.node_frame[j].transpose()
        return result

    @ti.func
    def write_block(self, number, block, values: ti.template()):
        """Entries of a block to their places in the matrix's values."""
        slot = self.block_slot[number]
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                if slot[3 * i + j] >= 0:
                    values[slot[3 * i + j]] = block[i, j]

    def assemble(self) -> NDArray[np.float64]:
        """Values of the lower triangle at the present displacements, pressures and loads; the same array each time."""
        self._assemble(self.values)
        return self.values


def _sign(side: int, corner: int) -> int:
    """How side ``side``'s vector depends on a corner's position: +1 at its far end, -1 at its near end, 0 opposite."""
    return {2: 1, 1: -1, 0: 0}[(corner - side) % 3]


def _edge_parts(triangles: NDArray[np.int32], edges: NDArray[np.int32]) -> NDArray[np.int32]:
    """(edge_count, 2) the one or two triangle sides on each edge, a side being 3·triangle + side; -1 for none."""
    near, far = np.roll(triangles, -1, axis=1).ravel(), np.roll(triangles, -2, axis=1).ravel()
    low, high = np.minimum(near, far).astype(np.int64), np.maximum(near, far)
    count = int(triangles.max()) + 1
    number = np.searchsorted(edges[:, 0].astype(np.int64) * count + edges[:, 1], low * count + high)
    order = np.argsort(number, kind="stable").astype(np.int32)
    parts = np.full((len(edges), 2), -1, dtype=np.int32)
    ordered = number[order]
    first = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    parts[ordered[first], 0] = order[first]
    parts[ordered[~first], 1] = order[~first]
    return parts
