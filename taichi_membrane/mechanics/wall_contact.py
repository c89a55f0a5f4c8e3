"""Contact of walls with each other, without friction: nodes on triangles, of both walls, by an augmented Lagrangian.

A node s touches a triangle's point of shares w, along a normal n: g = n · (x_s - Σ w_a x_a), and p = <λ - k g> pushes the node with
n and the corners with -w_a n, minus the gradient of <λ - k g>²/(2k); the tangent is k c cᵀ ⊗ n nᵀ, c = (1, -w). Pairs, shares and
normals stay while equilibrium is sought, and are brought up to date between solves (:mod:`taichi_membrane.solvers.walls`), until
they are those of the state. Forces of a pair cancel, and so do their moments where g = 0.

Nodes gather their pairs. What pairs couple beyond the elements' sides is added to the assembled blocks on the host.
"""

import numpy as np

from taichi_membrane.algebra.elimination import Elimination
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.preparation import Floats, Ints, gather_lists
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.wall_search import Found


@ti.data_oriented
class WallTerm:
    """Fields and device code of the contact of walls; a node term, see :mod:`taichi_membrane.mechanics.terms`."""

    def __init__(self, nodes: Nodes, structure: Structure) -> None:
        self.nodes, self.fp, self.dtype = nodes, nodes.fp, nodes.dtype
        count = room(structure.node_count)
        self.wall_node = ti.Vector.field(4, ti.i32, shape=2 * count)
        self.wall_share = ti.Vector.field(4, nodes.fp, shape=2 * count)  # c
        self.wall_normal = ti.Vector.field(3, nodes.fp, shape=2 * count)
        self.wall_value = ti.Vector.field(3, nodes.fp, shape=2 * count)  # gap where none has moved, k, λ
        if nodes.split_displacement:
            self.wall_base = ti.Vector.field(3, nodes.fp, shape=count)
            self.wall_base_rest = ti.Vector.field(3, nodes.fp, shape=count)
        self.wall_start = ti.field(ti.i32, shape=count + 1)
        self.wall_end = ti.field(ti.i32, shape=8 * count)  # four times a pair, and which of its nodes

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where its nodes do."""
        return structure.walls is not None and structure.node_count < self.wall_start.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure; nothing touches until :meth:`set` says so."""
        assert structure.walls is not None
        self.walls, self.structure = structure.walls, structure
        none = np.zeros(0, dtype=np.int64)
        empty = np.zeros(0)
        self.set(Found(none, none, none, np.zeros((0, 3)), np.zeros((0, 3)), empty, empty), empty, empty)

    def set(self, found: Found, stiffness: Floats, multiplier: Floats) -> None:
        """Set the pairs with k and λ of each."""
        self.found, self.stiffness, self.multiplier = found, stiffness, multiplier
        self.ends = np.column_stack([found.node, self.walls.corners[found.tri]])
        self.shares = np.column_stack([np.ones(len(found.node)), -found.share])
        points = self.structure.points
        if self.nodes.split_displacement:
            # Single precision counts from the present place, so that gaps keep their digits.
            points = points + self.nodes.displacement()
            self.wall_base.copy_from(self.nodes.node_displacement)
            self.wall_base_rest.copy_from(self.nodes.node_displacement_rest)
        rest = np.einsum("ij,ijk->ik", self.shares, points[self.ends])
        gap = np.einsum("ij,ij->i", rest, found.normal)
        start, ends = gather_lists(self.ends.ravel().astype(np.int32), self.structure.node_count)
        vectors = np.concatenate([self.shares, found.normal, np.column_stack([gap, stiffness, multiplier])], axis=1)
        # Arrays of nothing have no address: a row that nobody looks at stands for them.
        one_more = np.zeros((1, 4), dtype=np.int32)
        self._write(
            np.concatenate([self.ends.astype(np.int32), one_more]),
            np.concatenate([vectors, np.zeros((1, 10))]).astype(self.dtype),
            start.astype(np.int32),
            np.concatenate([ends.astype(np.int32), one_more[0]]),
            len(self.ends),
        )

    @ti.kernel
    def _write(self, node: Array, vectors: Array, start: Array, end: Array, count: int):
        for i in range(ti.max(start.shape[0], 4 * count)):
            if i < count:
                for c in ti.static(range(4)):
                    self.wall_node[i][c] = node[i, c]
                    self.wall_share[i][c] = vectors[i, c]
                for c in ti.static(range(3)):
                    self.wall_normal[i][c] = vectors[i, 4 + c]
                    self.wall_value[i][c] = vectors[i, 7 + c]
            if i < start.shape[0]:
                self.wall_start[i] = start[i]
            if i < 4 * count:
                self.wall_end[i] = end[i]

    # ---- on the device

    @ti.func
    def moved(self, i):
        """Displacement of node ``i``, in single precision since the pairs were set."""
        moved = self.nodes.node_displacement[i]
        if ti.static(self.nodes.split_displacement):
            moved = moved - self.wall_base[i] + (self.nodes.node_displacement_rest[i] - self.wall_base_rest[i])
        return moved

    @ti.func
    def push(self, e):
        """Contact force of pair ``e``."""
        ends, share, normal, value = self.wall_node[e], self.wall_share[e], self.wall_normal[e], self.wall_value[e]
        gap = value[0]
        for a in ti.static(range(4)):
            gap += share[a] * self.moved(ends[a]).dot(normal)
        return ti.max(value[2] - value[1] * gap, ti.cast(0.0, self.fp))

    @ti.func
    def force(self, i):
        """Contact forces on node ``i``."""
        force = ti.Vector.zero(self.fp, 3)
        for s in range(self.wall_start[i], self.wall_start[i + 1]):
            e = self.wall_end[s] // 4
            share = self.share_of(self.wall_end[s])
            force += share * self.push(e) * self.wall_normal[e]
        return force

    @ti.func
    def share_of(self, end):
        """c of one node of a pair."""
        shares = self.wall_share[end // 4]
        share = shares[0]
        for a in ti.static(range(1, 4)):
            if end % 4 == a:
                share = shares[a]
        return share

    @ti.func
    def energy(self, i):
        """The potential of its own pairs, zero where the push is the multiplier."""
        energy = ti.cast(0.0, self.fp)
        for s in range(self.wall_start[i], self.wall_start[i + 1]):
            if self.wall_end[s] % 4 == 0:
                value = self.wall_value[self.wall_end[s] // 4]
                push = self.push(self.wall_end[s] // 4)
                energy += 0.5 * (push * push - value[2] * value[2]) / ti.max(value[1], 1e-30)
        return energy

    @ti.func
    def bound(self, i):
        """Stiffness bound: c cᵀ is no more than |c| Σ |c|, and Σ |c| = 2."""
        bound = ti.cast(0.0, self.fp)
        for s in range(self.wall_start[i], self.wall_start[i + 1]):
            bound += 2.0 * self.wall_value[self.wall_end[s] // 4][1] * ti.abs(self.share_of(self.wall_end[s]))
        return bound

    @ti.func
    def block(self, i):
        """k c² n nᵀ of the pairs in contact."""
        block = ti.Matrix.zero(self.fp, 3, 3)
        for s in range(self.wall_start[i], self.wall_start[i + 1]):
            e = self.wall_end[s] // 4
            if self.push(e) > 0.0:
                share, normal = self.share_of(self.wall_end[s]), self.wall_normal[e]
                block += self.wall_value[e][1] * share * share * normal.outer_product(normal)
        return block

    @ti.kernel
    def _pushes(self, out: Array):
        for e in range(out.shape[0]):
            out[e] = self.push(e)

    # ---- on the host

    def pushes(self) -> Floats:
        """Contact force of each pair at the present displacements."""
        out = np.zeros(len(self.found.node), dtype=self.dtype)
        if len(out):
            self._pushes(out)
        return out.astype(np.float64)

    def spread(self, found: Found, push: Floats) -> Floats:
        """(node_count, 3) forces of some pairs."""
        forces = np.zeros((self.structure.node_count, 3))
        vectors = push[:, None] * found.normal
        np.add.at(forces, found.node, vectors)
        for a in range(3):
            np.add.at(forces, self.walls.corners[found.tri][:, a], -found.share[:, a, None] * vectors)
        return forces

    def forces(self) -> Floats:
        """(node_count, 3) contact forces at the present displacements."""
        return self.spread(self.found, self.pushes())

    def add_blocks(self, blocks: Floats, elimination: Elimination, keys: Ints) -> None:
        """Add what pairs in contact couple to assembled blocks, in the supports' axes, zero at held components.

        :param keys: of all edges, sorted: the lower node times the number of nodes, plus the other one.
        """
        active = np.flatnonzero(self.pushes() > 0.0)
        structure, count = self.structure, self.structure.node_count
        free = (~structure.node_held).astype(np.float64)
        axes = np.broadcast_to(np.eye(3), (count, 3, 3)) if structure.node_frame is None else structure.node_frame
        for a in range(4):
            for c in range(a):
                i, j = self.ends[active, a], self.ends[active, c]
                key = np.minimum(i, j) * count + np.maximum(i, j)
                edge = np.searchsorted(keys, key)
                row, column = elimination.edge_node[edge, 1], elimination.edge_node[edge, 0]
                size = self.stiffness[active] * self.shares[active, a] * self.shares[active, c]
                normal = self.found.normal[active]
                left = np.einsum("nij,nj->ni", axes[row], normal) * free[row]
                right = np.einsum("nij,nj->ni", axes[column], normal) * free[column]
                np.add.at(
                    blocks, elimination.edge_block[edge], size[:, None, None] * left[:, :, None] * right[:, None, :]
                )
