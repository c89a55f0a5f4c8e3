"""Taichi fields of a structure's nodes: allocation, upload, what a run changes in them, and their place in space.

The mesh and everything that never changes is uploaded once. A feature the structure does not use owns no field.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.device import runtime
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import body
from taichi_membrane.mechanics.features import Features
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure

# Sums run over this many fixed blocks, each added in order: the same bits whatever thread takes which block.
_CPU_BLOCKS = 128
_GPU_BLOCK_LENGTH = 16
# On a GPU the many blocks are summed in so many groups at most, before these are.
GROUPS = 256
_BOUNDS = ("nodes", "node_block_length", "node_blocks", "group_length", "groups")
# Share of the structure's size: 24 bits then hold displacements of up to 32 sizes, and what is left to the rest is below this.
_QUANTUM = 2.0**-19
_LEAST_ROOM = 4096


Array: Any = ti.types.ndarray()


class Nodes:
    """Nodes of one structure; :class:`taichi_membrane.mechanics.system.System` adds the terms that act on them.

    Each node gathers *slots*: one for each end of each element at it, whatever the element. Kernels know no sizes: loops end at
    ``bounds``. Another structure that fits may take this one's place, which compiles nothing.
    """

    def __init__(self, structure: Structure) -> None:
        active = runtime.current()
        self.features: Features = structure.features()
        self.fp: Any = ti.f64 if active.precision == "f64" else ti.f32
        self.dtype: Any = np.float64 if active.precision == "f64" else np.float32
        self.on_cpu = active.on_cpu
        # What a thread takes at a time (on a GPU: threads of a block); left to itself Taichi makes it 32 where it does not know
        # the loop's end.
        self.block_dim = 512 if active.on_cpu else 128
        # Single precision resolves a displacement of 10 mm to 5e-7 mm; a stiff fabric answers that with forces that keep the
        # cantilever's residual above 1e-5 of its load. The part that is rounded off is kept beside it, so that differences of
        # displacements keep all their digits.
        self.split_displacement = active.precision == "f32"
        fp, nodes = self.fp, room(structure.node_count)
        slots = room(len(structure.slots), structure.mesh.cells.shape[1])
        self.bounds = ti.types.struct(**dict.fromkeys(_BOUNDS, ti.i32)).field(shape=())
        self.node_rest = ti.Vector.field(3, fp, shape=nodes)
        self.node_displacement = ti.Vector.field(3, fp, shape=nodes)
        if self.split_displacement:
            self.node_displacement_rest = ti.Vector.field(3, fp, shape=nodes)
            self.quantum = ti.field(fp, shape=())
        self.node_held = ti.Vector.field(3, ti.i32, shape=nodes)
        self.node_slot_start = ti.field(ti.i32, shape=nodes + 1)
        self.node_slot = ti.field(ti.i32, shape=slots)
        self.slot_force = ti.Vector.field(3, fp, shape=slots)
        largest = max(nodes, room(structure.mesh.tri_count))
        self.block_sum = ti.Vector.field(2, fp, shape=_CPU_BLOCKS if self.on_cpu else -(-largest // _GPU_BLOCK_LENGTH))
        if self.features.slanted:
            self.node_frame = ti.Matrix.field(3, 3, fp, shape=nodes)
        if self.features.loads:
            self.node_load = ti.Vector.field(3, fp, shape=nodes)
        # Displacements, in single precision what was rounded off of them, and loads.
        self.changing = (
            self.node_displacement,
            *([self.node_displacement_rest] if self.split_displacement else []),
            *([self.node_load] if self.features.loads else []),
        )

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits these fields and the kernels compiled for them: same features, no larger."""
        return (
            structure.features() == self.features
            and structure.node_count <= self.node_rest.shape[0]
            and len(structure.slots) <= self.node_slot.shape[0]
        )

    def upload(self, structure: Structure) -> None:
        """Put a structure that :meth:`accepts` lets through in place of the present one, at rest."""
        self.structure, self.node_count = structure, structure.node_count
        # The structure's own middle is the origin: coordinates far away would cost single precision its digits.
        self.origin = 0.5 * (structure.points.min(axis=0) + structure.points.max(axis=0))
        if self.features.slanted and structure.node_frame is not None:
            fill(self.node_frame, structure.node_frame.astype(self.dtype))
        # The leading part of a displacement is a multiple of this power of two, so that no compiler can see through the split and
        # undo it.
        size = float(np.linalg.norm(np.ptp(structure.points, axis=0)))
        self.displacement_quantum = float(2.0 ** np.floor(np.log2(size * _QUANTUM)))
        length, blocks = blocks_of(self.node_count, self.on_cpu)
        group_length = -(-blocks // GROUPS)
        self._write_nodes(
            (structure.points - self.origin).astype(self.dtype),
            structure.node_held.astype(np.int32),
            *structure.node_slots,
            np.array([self.node_count, length, blocks, group_length, -(-blocks // group_length)], dtype=np.int32),
            self.displacement_quantum,
        )
        self.set_displacement(np.zeros((self.node_count, 3)))
        self.loads = np.full((self.node_count, 3), np.nan)
        self.set_loads(np.zeros((self.node_count, 3)))

    @ti.kernel
    def _write_nodes(self, rest: Array, held: Array, slot_start: Array, slots: Array, bounds: Array, quantum: float):
        """All that every structure has, in one kernel and one loop: compiling one for each field took seconds."""
        for i in range(ti.max(slot_start.shape[0], slots.shape[0])):
            if i == 0:
                for number in ti.static(range(len(_BOUNDS))):
                    self.bounds.get_member_field(_BOUNDS[number])[None] = bounds[number]
                if ti.static(self.split_displacement):
                    self.quantum[None] = quantum
            if i < rest.shape[0]:
                for c in ti.static(range(3)):
                    self.node_rest[i][c] = rest[i, c]
                    self.node_held[i][c] = held[i, c]
            if i < slot_start.shape[0]:
                self.node_slot_start[i] = slot_start[i]
            if i < slots.shape[0]:
                self.node_slot[i] = slots[i]

    # ---- on the device

    @ti.func
    def displacement_difference(self, i, j):
        """Displacement of node ``i`` less that of node ``j``."""
        difference = self.node_displacement[i] - self.node_displacement[j]
        if ti.static(self.split_displacement):
            difference += self.node_displacement_rest[i] - self.node_displacement_rest[j]
        return difference

    @ti.func
    def add_displacement(self, i, increment):
        """Add to the displacement of node ``i``; what rounding drops from the leading part goes to the rest."""
        if ti.static(self.split_displacement):
            before = self.node_displacement[i]
            change = increment + self.node_displacement_rest[i]
            after = ti.round((before + change) / self.quantum[None]) * self.quantum[None]
            self.node_displacement[i] = after
            self.node_displacement_rest[i] = change + (before - after)
        else:
            self.node_displacement[i] += increment

    @ti.func
    def first_node(self, block):
        """First node of a block of the deterministic sums, or the number of nodes past the last one."""
        return ti.min(block * self.bounds[None].node_block_length, self.bounds[None].nodes)

    # ---- what a run changes

    def set_displacement(self, displacement: Floats) -> None:
        """Set all nodal displacements, (node_count, 3) lengths."""
        leading = np.ascontiguousarray(displacement, dtype=self.dtype)
        if self.split_displacement:
            leading = (np.round(displacement / self.displacement_quantum) * self.displacement_quantum).astype(
                self.dtype
            )
        self._put(leading, 0)
        if self.split_displacement:
            self._put((displacement - leading).astype(self.dtype), 1)

    def displacement(self) -> Floats:
        """Nodal displacements, (node_count, 3) lengths, in double precision."""
        leading = read(self.node_displacement, self.node_count)
        if self.split_displacement:
            leading += read(self.node_displacement_rest, self.node_count)
        return leading

    def retract(self, position: Floats, step: Floats) -> Floats:
        """(node_count, 3) displacements that a step in the freedoms leads to from ``position``.

        Steps are tangent vectors, in the axes that supports refer to, and this alone knows how they move a structure: nodes add
        them, rigid bodies turn (:mod:`body`).
        """
        if self.features.bodies:
            return body.retracted(self.structure.bodies, position, self._turned_back(step))
        return position + self.from_frames(step)

    def difference(self, before: Floats, after: Floats) -> Floats:
        """(node_count, 3) the step that leads from one place to another."""
        if self.features.bodies:
            return self._turned(body.difference(self.structure.bodies, before, after))
        return self.in_frames(after - before)

    def between(self, before: Floats, after: Floats, share: float) -> Floats:
        """(node_count, 3) displacements at a share of the step from one place to another."""
        if self.features.bodies:
            return self.retract(before, share * self.difference(before, after))
        return before + share * (after - before)

    def composed(self, first: Floats, then: Floats) -> Floats:
        """(node_count, 3) the one step that leads where a step and another one after it lead."""
        return body.composed(self.structure.bodies, first, then) if self.features.bodies else first + then

    def in_frames(self, vectors: Floats) -> Floats:
        """Nodal forces (node_count, 3) on the freedoms: in the axes that supports refer to, and of bodies as a whole."""
        if self.features.bodies:
            vectors = body.generalised(self.structure.bodies, self.displacement(), vectors)
        return self._turned(vectors)

    def from_frames(self, vectors: Floats) -> Floats:
        """Nodal displacements (node_count, 3) in x, y, z of those of the freedoms, to first order."""
        vectors = self._turned_back(vectors)
        return body.nodal(self.structure.bodies, self.displacement(), vectors) if self.features.bodies else vectors

    def spread(self, forces: Floats) -> Floats:
        """Nodal forces (node_count, 3) in x, y, z of those on the freedoms; of a body the least that come to them."""
        forces = self._turned_back(forces)
        return body.spread(self.structure.bodies, self.displacement(), forces) if self.features.bodies else forces

    def _turned(self, vectors: Floats) -> Floats:
        frame = self.structure.node_frame
        return vectors if frame is None else np.einsum("nij,nj->ni", frame, vectors)

    def _turned_back(self, vectors: Floats) -> Floats:
        frame = self.structure.node_frame
        return vectors if frame is None else np.einsum("nji,nj->ni", frame, vectors)

    def set_loads(self, loads: Floats) -> None:
        """Set the dead nodal forces, (node_count, 3)."""
        if self.features.loads and not np.array_equal(loads, self.loads):
            self.loads = np.array(loads, dtype=np.float64)
            self._put(self.loads.astype(self.dtype), len(self.changing) - 1)

    @ti.kernel
    def _put(self, values: Array, what: int):
        """Write one of the vectors that change in a run: one kernel for all of them."""
        ti.loop_config(block_dim=self.block_dim)
        for i in range(values.shape[0]):
            for c in ti.static(range(3)):
                for number in ti.static(range(len(self.changing))):
                    if what == number:
                        self.changing[number][i][c] = values[i, c]


def blocks_of(count: int, on_cpu: bool) -> tuple[int, int]:
    """Length and number of the blocks in which so many numbers are summed; they do not depend on the number of threads."""
    length = max(-(-count // _CPU_BLOCKS), 1) if on_cpu else _GPU_BLOCK_LENGTH
    return length, -(-count // length)


def few(count: int) -> int:
    """Places to allocate for so many of what structures have few of, such as fabrics: 16 at least."""
    return max(count, 16)


def room(count: int, each: int = 1) -> int:
    """Places to allocate for so many things: for those of 4096 triangles at least, and a sixteenth more at most.

    Kernels depend on the sizes of fields. So meshes of about one size share them, within a process and in Taichi's cache.

    :param each: how many there are to a triangle.
    """
    if count <= _LEAST_ROOM * each:
        return _LEAST_ROOM * each
    digits = count.bit_length() - 5
    return -(-count >> digits) << digits


def fill(field: Any, values: NDArray[Any]) -> None:
    """Write values to the beginning of a field, and zeros to the rest of it."""
    if len(field.shape) > 1:
        field.from_numpy(np.ascontiguousarray(values))
        return
    if not len(values):
        values = np.zeros((1, *values.shape[1:]), dtype=values.dtype)
    values = np.ascontiguousarray(values)
    if isinstance(field, ti.MatrixField):
        _fill_matrices(field, values.reshape(len(values), field.n, field.m))
    else:
        _fill_numbers(field, values)


@ti.kernel
def _fill_numbers(field: ti.template(), values: Array):
    ti.loop_config(block_dim=512)
    for i in range(field.shape[0]):
        field[i] = 0
        if i < values.shape[0]:
            field[i] = values[i]


@ti.kernel
def _fill_matrices(field: ti.template(), values: Array):
    ti.loop_config(block_dim=512)
    for i in range(field.shape[0]):
        one = field[i] * 0
        if i < values.shape[0]:
            for j in ti.static(range(field.n)):
                if ti.static(field.ndim == 1):
                    one[j] = values[i, j, 0]
                else:
                    for k in ti.static(range(field.m)):
                        one[j, k] = values[i, j, k]
        field[i] = one


def read(field: Any, count: int) -> Floats:
    """The first numbers of a field (count,), or the first of its vectors (count, n), in double precision."""
    numbers = ti.lang.util.to_numpy_type(field.dtype)
    if isinstance(field, ti.MatrixField):
        out = np.empty((count, field.n), dtype=numbers)
        _read_vectors(field, out)
    else:
        out = np.empty(count, dtype=numbers)
        _read_numbers(field, out)
    return out.astype(np.float64)


@ti.kernel
def _read_numbers(field: ti.template(), out: Array):
    ti.loop_config(block_dim=512)
    for i in range(out.shape[0]):
        out[i] = field[i]


@ti.kernel
def _read_vectors(field: ti.template(), out: Array):
    ti.loop_config(block_dim=512)
    for i in range(out.shape[0]):
        for c in ti.static(range(field.n)):
            out[i, c] = field[i][c]


def field_bytes(one: Any) -> int:
    """Bytes of a field's values: a matrix field has n · m of them at each place, a record as many as it has members."""
    if isinstance(one, ti.StructField):
        return sum(field_bytes(member) for member in one._members)
    width = np.dtype(ti.lang.util.to_numpy_type(one.dtype)).itemsize
    return int(np.prod(one.shape)) * width * (one.n * one.m if isinstance(one, ti.MatrixField) else 1)
