"""Taichi fields of one structure: allocation, upload, and what a run changes in them.

The mesh and everything that never changes is uploaded once. A feature the structure does not use owns no field.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.device import runtime
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import fabric
from taichi_membrane.mechanics.preparation import FabricConstants, Floats
from taichi_membrane.mechanics.structure import Features, Structure, variant_of

# Sums run over this many fixed blocks, each added in order: the same bits whatever thread takes which block.
_CPU_BLOCKS = 128
_GPU_BLOCK_LENGTH = 16
# On a GPU the many blocks are summed in so many groups at most, before these are.
GROUPS = 256
_BOUNDS = (
    "nodes", "triangles", "node_block_length", "tri_block_length", "node_blocks", "tri_blocks", "group_length", "groups",
)  # fmt: skip
# Share of the structure's size: 24 bits then hold displacements of up to 32 sizes, and what is left to the rest is below this.
_QUANTUM = 2.0**-19


_Array: Any = ti.types.ndarray()


class MembraneFields:
    """Fields of one structure; :class:`taichi_membrane.mechanics.membrane.Membrane` adds the kernels.

    Kernels know no sizes: loops end at ``bounds``. Another structure that fits may take this one's place (:meth:`upload`), which
    compiles nothing.
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
        self._allocate(structure)
        self.upload(structure)

    # ---- set-up

    def _allocate(self, structure: Structure) -> None:
        fp, features = self.fp, self.features
        nodes, triangles, fabrics = structure.mesh.node_count, structure.mesh.tri_count, len(structure.fabrics)
        self.bounds = ti.types.struct(**dict.fromkeys(_BOUNDS, ti.i32)).field(shape=())
        self.node_rest = ti.Vector.field(3, fp, shape=nodes)
        self.node_displacement = ti.Vector.field(3, fp, shape=nodes)
        if self.split_displacement:
            self.node_displacement_rest = ti.Vector.field(3, fp, shape=nodes)
            self.quantum = ti.field(fp, shape=())
        self.node_held = ti.Vector.field(3, ti.i32, shape=nodes)
        self.node_corner_start = ti.field(ti.i32, shape=nodes + 1)
        self.node_corner = ti.field(ti.i32, shape=3 * triangles)
        self.tri_node = ti.Vector.field(3, ti.i32, shape=triangles)
        self.tri_side_length = ti.Vector.field(3, fp, shape=triangles)
        self.tri_volume = ti.field(fp, shape=triangles)
        self.tri_strain_matrix = ti.Matrix.field(3, 3, fp, shape=triangles)
        self.tri_corner_force = ti.Vector.field(3, fp, shape=3 * triangles)
        block_count = _CPU_BLOCKS if self.on_cpu else -(-max(nodes, triangles) // _GPU_BLOCK_LENGTH)
        self.block_sum = ti.Vector.field(2, fp, shape=block_count)
        self.fabric_constants = fabric.fabric_record(fp).field(shape=fabrics)
        if features.several_fabrics:
            self.tri_fabric = ti.field(ti.i32, shape=triangles)
        if len(features.variants) > 1:
            self.fabric_variant = ti.field(ti.i32, shape=fabrics)
        if features.prestress:
            self.fabric_prestrain = ti.Vector.field(3, fp, shape=fabrics)
        if features.pressure != "none":
            self.chamber_pressure = ti.field(fp, shape=structure.chamber_count)
        if features.pressure == "by_chamber":
            self.tri_chamber = ti.field(ti.i32, shape=triangles)
        if features.slanted:
            self.node_frame = ti.Matrix.field(3, 3, fp, shape=nodes)
        if features.loads:
            self.node_load = ti.Vector.field(3, fp, shape=nodes)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits these fields and the kernels compiled for them: same features, no larger."""
        return (
            structure.features() == self.features
            and structure.mesh.node_count <= self.node_rest.shape[0]
            and structure.mesh.tri_count <= self.tri_node.shape[0]
            and len(structure.fabrics) <= self.fabric_constants.shape[0]
            and (self.features.pressure == "none" or structure.chamber_count <= self.chamber_pressure.shape[0])
        )

    def upload(self, structure: Structure) -> None:
        """Put a structure that :meth:`accepts` lets through in place of the present one, at rest."""
        self.structure, self.geometry = structure, structure.geometry
        self.node_count, self.tri_count = structure.mesh.node_count, structure.mesh.tri_count
        features, mesh, dtype = self.features, structure.mesh, self.dtype
        thickness = np.array([one.thickness for one in structure.fabrics])[structure.tri_fabric]
        # The structure's own middle is the origin: coordinates far away would cost single precision its digits.
        self.origin = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
        if features.slanted and structure.node_frame is not None:
            fill(self.node_frame, structure.node_frame.astype(dtype))
        start, corners = structure.node_corners
        constants = np.array([[one.record()[name] for name in fabric.CONSTANTS] for one in structure.fabrics])
        self._write(
            (mesh.points - self.origin).astype(dtype),
            structure.node_held.astype(np.int32),
            start,
            corners,
            mesh.triangles.astype(np.int32),
            self.geometry.side_length.astype(dtype),
            (self.geometry.area * thickness).astype(dtype),
            self.geometry.strain_matrix.astype(dtype),
            constants.astype(dtype),
            self._bounds(),
        )
        if features.several_fabrics:
            fill(self.tri_fabric, structure.tri_fabric.astype(np.int32))
        if len(features.variants) > 1:
            numbers = [_variant_number(features, one) for one in structure.fabrics]
            fill(self.fabric_variant, np.array(numbers, dtype=np.int32))
        if features.prestress:
            # A prestress is the elastic answer to a strain offset, so the wrinkling laws need not know of it.
            offsets = [one.compliance() @ np.array(one.prestress) for one in structure.fabrics]
            fill(self.fabric_prestrain, np.array(offsets, dtype=dtype))
        if features.pressure == "by_chamber":
            fill(self.tri_chamber, structure.tri_chamber.astype(np.int32))
        if self.split_displacement:
            self._set_quantum()
        self.set_displacement(np.zeros((self.node_count, 3)))

    @ti.kernel
    def _write(
        self, rest: _Array, held: _Array, corner_start: _Array, corners: _Array, triangles: _Array, side_length: _Array,
        volume: _Array, strain_matrix: _Array, constants: _Array, bounds: _Array,
    ):  # fmt: skip
        """All that every structure has, in one kernel: compiling one for each field took seconds."""
        for number in ti.static(range(len(_BOUNDS))):
            self.bounds.get_member_field(_BOUNDS[number])[None] = bounds[number]
        for k in range(constants.shape[0]):
            for number in ti.static(range(len(fabric.CONSTANTS))):
                self.fabric_constants.get_member_field(fabric.CONSTANTS[number])[k] = constants[k, number]
        for i in range(rest.shape[0]):
            for c in ti.static(range(3)):
                self.node_rest[i][c] = rest[i, c]
                self.node_held[i][c] = held[i, c]
        for i in range(corner_start.shape[0]):
            self.node_corner_start[i] = corner_start[i]
        for t in range(volume.shape[0]):
            self.tri_volume[t] = volume[t]
            for c in ti.static(range(3)):
                self.node_corner[3 * t + c] = corners[3 * t + c]
                self.tri_node[t][c] = triangles[t, c]
                self.tri_side_length[t][c] = side_length[t, c]
                for j in ti.static(range(3)):
                    self.tri_strain_matrix[t][c, j] = strain_matrix[t, c, j]

    def _bounds(self) -> NDArray[np.int32]:
        """Where loops end, in the order of ``_BOUNDS``. Sums run over fixed blocks, so that they do not depend on the number of
        threads."""
        if self.on_cpu:
            node_length, tri_length = -(-self.node_count // _CPU_BLOCKS), -(-self.tri_count // _CPU_BLOCKS)
        else:
            node_length = tri_length = _GPU_BLOCK_LENGTH
        node_blocks = -(-self.node_count // node_length)
        group_length = -(-node_blocks // GROUPS)
        self.tri_block_count = -(-self.tri_count // tri_length)
        counts = (self.node_count, self.tri_count, node_length, tri_length, node_blocks, self.tri_block_count)
        return np.array([*counts, group_length, -(-node_blocks // group_length)], dtype=np.int32)

    def _set_quantum(self) -> None:
        """The leading part of a displacement is a multiple of this power of two, so that no compiler can see through the split and
        undo it."""
        size = float(np.linalg.norm(np.ptp(self.structure.mesh.points, axis=0)))
        self.displacement_quantum = float(2.0 ** np.floor(np.log2(size * _QUANTUM)))
        self.quantum[None] = self.displacement_quantum

    # ---- what a run changes

    def set_displacement(self, displacement: Floats) -> None:
        """Set all nodal displacements, (node_count, 3) lengths."""
        leading = np.ascontiguousarray(displacement, dtype=self.dtype)
        if self.split_displacement:
            leading = (np.round(displacement / self.displacement_quantum) * self.displacement_quantum).astype(
                self.dtype
            )
        fill(self.node_displacement, leading)
        if self.split_displacement:
            fill(self.node_displacement_rest, (displacement - leading).astype(self.dtype))

    def in_frames(self, vectors: Floats) -> Floats:
        """Nodal vectors (node_count, 3) in the axes that supports refer to."""
        frame = self.structure.node_frame
        return vectors if frame is None else np.einsum("nij,nj->ni", frame, vectors)

    def from_frames(self, vectors: Floats) -> Floats:
        """Nodal vectors (node_count, 3) given in the supports' axes, in x, y, z."""
        frame = self.structure.node_frame
        return vectors if frame is None else np.einsum("nji,nj->ni", frame, vectors)

    def displacement(self) -> Floats:
        """Nodal displacements, (node_count, 3) lengths, in double precision."""
        leading = self.node_displacement.to_numpy()[: self.node_count].astype(np.float64)
        if self.split_displacement:
            leading += self.node_displacement_rest.to_numpy()[: self.node_count]
        return leading

    def scale_thickness(self, fabric_number: int, factor: float) -> None:
        """Give one fabric so many times its thickness; 1 restores it."""
        thickness = np.array([one.thickness for one in self.structure.fabrics])
        thickness[fabric_number] *= factor
        fill(self.tri_volume, (self.geometry.area * thickness[self.structure.tri_fabric]).astype(self.dtype))

    def set_pressures(self, pressures: Floats) -> None:
        """Set each chamber's pressure (force per area, positive along the triangles' normals)."""
        if self.features.pressure != "none":
            fill(self.chamber_pressure, np.asarray(pressures, dtype=self.dtype))

    def pressures(self) -> Floats:
        """(chamber_count,) present pressures."""
        if self.features.pressure == "none":
            return np.zeros(0)
        return self.chamber_pressure.to_numpy()[: self.structure.chamber_count]

    def set_loads(self, loads: Floats) -> None:
        """Set the dead nodal forces, (node_count, 3)."""
        if self.features.loads:
            fill(self.node_load, np.asarray(loads, dtype=self.dtype))

    def bytes_allocated(self) -> int:
        """Memory of this membrane's fields."""
        return sum(_field_bytes(one) for one in vars(self).values() if isinstance(one, ti.Field))

    def prestress_norm(self) -> float:
        """Size of the nodal forces that prestress balances, a scale for residuals where no load acts."""
        level = np.array([np.linalg.norm(one.prestress) * one.thickness for one in self.structure.fabrics])
        return float(np.sqrt((level[self.structure.tri_fabric] ** 2 * self.geometry.area).sum()))

    def swept_volumes(self, displacement: Floats) -> Floats:
        """(tri_count,) volume each triangle has swept since rest, in double precision (NumPy; once per load step)."""
        corners = self.structure.mesh.points[self.structure.mesh.triangles]
        moved = displacement[self.structure.mesh.triangles]
        rest_1, rest_2 = corners[:, 0] - corners[:, 2], corners[:, 1] - corners[:, 0]
        stretch_1, stretch_2 = moved[:, 0] - moved[:, 2], moved[:, 1] - moved[:, 0]
        linear = np.cross(rest_1, stretch_2) + np.cross(stretch_1, rest_2)
        area = np.cross(rest_1, rest_2) + 0.5 * linear + np.cross(stretch_1, stretch_2) / 3.0
        return np.asarray(0.5 * np.einsum("ij,ij->i", moved.mean(axis=1), area))


def fill(field: Any, values: NDArray[Any]) -> None:
    """Write values to the beginning of a field, and zeros to the rest of it."""
    if len(values) < field.shape[0]:
        rest = np.zeros((field.shape[0] - len(values), *values.shape[1:]), dtype=values.dtype)
        values = np.concatenate([values, rest])
    field.from_numpy(np.ascontiguousarray(values))


def _variant_number(features: Features, one: FabricConstants) -> int:
    """Number of a fabric's element code; an unused fabric may get any."""
    variant = variant_of(one)
    return features.variants.index(variant) if variant in features.variants else 0


def _field_bytes(one: Any) -> int:
    """Bytes of a field's values: a matrix field has n · m of them at each place, a record as many as it has members."""
    if isinstance(one, ti.StructField):
        return sum(_field_bytes(member) for member in one._members)
    width = np.dtype(ti.lang.util.to_numpy_type(one.dtype)).itemsize
    return int(np.prod(one.shape)) * width * (one.n * one.m if isinstance(one, ti.MatrixField) else 1)
