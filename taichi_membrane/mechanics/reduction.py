"""Pattern and blocks of a tangent in the freedoms of rigid bodies: Tᵀ K T + G, see :mod:`body`.

Blocks of elements that have no node in a body go where they went. The others, few, are brought here one by one, and each is
added wherever the freedoms that move its two ends meet; so are those of springs at nodes of bodies.
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.algebra.elimination import Elimination
from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.mechanics.body import parts_of
from taichi_membrane.mechanics.preparation import edge_keys
from taichi_membrane.mechanics.structure import Structure


class Reduction:
    """Adds to the blocks of one structure's tangent what elements and springs at bodies give."""

    def __init__(self, structure: Structure, elimination: Elimination) -> None:
        self.structure, self.elimination = structure, elimination
        self.parts = parts_of(structure.bodies, structure.node_count)
        in_body = self.parts[:, 1] >= 0
        self.nodes = np.flatnonzero(in_body).astype(np.int32)
        self.slots = np.flatnonzero(in_body[structure.slots]).astype(np.int32)
        self.pairs = np.flatnonzero(in_body[structure.pairs].any(axis=1)).astype(np.int32)
        self._some = _stiffness_of(structure)
        self._keys = edge_keys(structure.edges, structure.node_count)

    def add(
        self, out: Floats, of_slots: Floats, of_pairs: Floats, of_nodes: Floats, displacement: Floats, forces: Floats
    ) -> None:
        """Add to the lower triangle's blocks ``out`` those (n, 3, 3) of ``slots``, ``pairs`` and ``nodes``, and G.

        :param forces: (node_count, 3) out-of-balance nodal forces.
        """
        maps = self._maps(displacement)
        at = self.structure.slots[self.slots]
        self._spread(out, maps, at, at, of_slots, whole=False)
        self._spread(out, maps, self.nodes, self.nodes, of_nodes, whole=False)
        rows, columns = self.structure.pairs[self.pairs].T
        self._spread(out, maps, rows, columns, of_pairs, whole=True)
        for body in self.structure.bodies:
            spin = body.carriers[1]
            block = out[self.elimination.node_block[spin]]
            block += self._free(spin, spin, body.geometric(displacement, forces))
            if body.line is not None and not body.held[1].any():
                _leave_out(block, body.pose(displacement)[1] @ body.line, self._some)

    def _maps(self, displacement: Floats) -> Floats:
        """(node_count, 2, 3, 3) how each node moves with the freedoms of its two parts."""
        structure = self.structure
        maps = np.zeros((structure.node_count, 2, 3, 3))
        maps[:, 0] = np.eye(3) if structure.node_frame is None else structure.node_frame.transpose(0, 2, 1)
        for body in structure.bodies:
            maps[body.nodes] = body.map_at(displacement).reshape(-1, 3, 2, 3).transpose(0, 2, 1, 3)
        return maps

    def _spread(self, out: Floats, maps: Floats, rows: Ints, columns: Ints, blocks: Floats, *, whole: bool) -> None:
        """Add blocks that couple nodes where their freedoms meet.

        :param whole: whether each stands for its transpose as well; else it is of one node with itself.
        """
        elimination = self.elimination
        for p in range(2):
            for q in range(2):
                row, column = self.parts[rows, p], self.parts[columns, q]
                used = (row >= 0) & (column >= 0)
                if not whole and p > q:
                    continue  # the transpose of another
                row, column = row[used], column[used]
                left, right = maps[rows[used], p], maps[columns[used], q]
                values = self._free(row, column, left.transpose(0, 2, 1) @ blocks[used] @ right)
                same = row == column
                both = values[same] + values[same].transpose(0, 2, 1) if whole else values[same]
                np.add.at(out, elimination.node_block[row[same]], both)
                row, column, values = row[~same], column[~same], values[~same]
                edge = np.searchsorted(self._keys, edge_keys(np.column_stack([row, column]), self.structure.node_count))
                turned = elimination.edge_node[edge, 1] != row
                values = np.where(turned[:, None, None], values.transpose(0, 2, 1), values)
                np.add.at(out, elimination.edge_block[edge], values)

    def _free(self, row: Ints | int, column: Ints | int, values: Floats) -> Floats:
        """Blocks with zeros at held components."""
        free = ~self.structure.node_held
        return np.asarray(values * free[row][..., :, None] * free[column][..., None, :])


def _leave_out(block: Floats, axis: Floats, stiffness: float) -> None:
    """Give a spin's block some stiffness along a mast's axis, where it is alone: no node moves, no force acts, nothing couples."""
    across = np.eye(3) - np.outer(axis, axis)
    block[:] = across @ block @ across + stiffness * np.outer(axis, axis)


def _stiffness_of(structure: Structure) -> float:
    """Size of an element's stiffness; the same in all states, so that differences of tangents know nothing of it."""
    found = [fabric.thickness * max(fabric.e_warp, fabric.e_weft) for fabric in structure.fabrics]
    if structure.cables is not None:
        found.append(float((structure.cables.stiffness / structure.cables.length).max()))
    return max(found)
