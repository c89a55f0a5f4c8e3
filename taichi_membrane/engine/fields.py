"""Taichi fields of one structure: allocation, upload, and what a run changes in them.

The mesh and everything that never changes is uploaded once. A feature the structure does not use owns no field.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import taichi as ti

from taichi_membrane.engine import fabric, preparation, runtime
from taichi_membrane.engine.preparation import FabricConstants, Floats
from taichi_membrane.engine.structure import Features, Structure, variant_of

# Sums run over this many fixed blocks, each added in order: the same bits whatever thread takes which block.
_CPU_BLOCKS = 128
_GPU_BLOCK_LENGTH = 16
# Share of the structure's size: 24 bits then hold displacements of up to 32 sizes, and what is left to the rest is below this.
_QUANTUM = 2.0**-19


class MembraneFields:
    """Fields of one structure; :class:`taichi_membrane.engine.membrane.Membrane` adds the kernels."""

    def __init__(self, structure: Structure) -> None:
        active = runtime.current()
        self.structure = structure
        self.features: Features = structure.features()
        self.fp: Any = ti.f64 if active.precision == "f64" else ti.f32
        self.dtype: Any = np.float64 if active.precision == "f64" else np.float32
        # Single precision resolves a displacement of 10 mm to 5e-7 mm; a stiff fabric answers that with forces that keep the
        # cantilever's residual above 1e-5 of its load. The part that is rounded off is kept beside it, so that differences of
        # displacements keep all their digits.
        self.split_displacement = active.precision == "f32"
        # The leading part is a multiple of this power of two, so that no compiler can see through the split and undo it.
        size = float(np.linalg.norm(np.ptp(structure.mesh.points, axis=0)))
        self.displacement_quantum = _quantum(size)
        self.geometry = structure.geometry
        self.node_count, self.tri_count = structure.mesh.node_count, structure.mesh.tri_count
        if active.on_cpu:
            self.node_block_length = -(-self.node_count // _CPU_BLOCKS)
            self.tri_block_length = -(-self.tri_count // _CPU_BLOCKS)
        else:
            self.node_block_length = self.tri_block_length = _GPU_BLOCK_LENGTH
        self.node_block_count = -(-self.node_count // self.node_block_length)
        self.tri_block_count = -(-self.tri_count // self.tri_block_length)
        self._allocate()
        self._upload()

    # ---- set-up

    def _allocate(self) -> None:
        fp, features = self.fp, self.features
        self.node_rest = ti.Vector.field(3, fp, shape=self.node_count)
        self.node_displacement = ti.Vector.field(3, fp, shape=self.node_count)
        if self.split_displacement:
            self.node_displacement_rest = ti.Vector.field(3, fp, shape=self.node_count)
        self.node_held = ti.Vector.field(3, ti.i32, shape=self.node_count)
        self.node_corner_start = ti.field(ti.i32, shape=self.node_count + 1)
        self.node_corner = ti.field(ti.i32, shape=3 * self.tri_count)
        self.tri_node = ti.Vector.field(3, ti.i32, shape=self.tri_count)
        self.tri_side_length = ti.Vector.field(3, fp, shape=self.tri_count)
        self.tri_volume = ti.field(fp, shape=self.tri_count)
        self.tri_strain_matrix = ti.Matrix.field(3, 3, fp, shape=self.tri_count)
        self.tri_corner_force = ti.Vector.field(3, fp, shape=3 * self.tri_count)
        self.block_sum = ti.Vector.field(2, fp, shape=max(self.node_block_count, self.tri_block_count))
        self.fabric_constants = fabric.fabric_record(fp).field(shape=len(self.structure.fabrics))
        if features.several_fabrics:
            self.tri_fabric = ti.field(ti.i32, shape=self.tri_count)
        if len(features.variants) > 1:
            self.fabric_variant = ti.field(ti.i32, shape=len(self.structure.fabrics))
        if features.prestress:
            self.fabric_prestrain = ti.Vector.field(3, fp, shape=len(self.structure.fabrics))
        if features.pressure != "none":
            self.chamber_count = int(self.structure.tri_chamber.max()) + 1
            self.chamber_pressure = ti.field(fp, shape=self.chamber_count)
        if features.pressure == "by_chamber":
            self.tri_chamber = ti.field(ti.i32, shape=self.tri_count)
        if features.slanted:
            self.node_frame = ti.Matrix.field(3, 3, fp, shape=self.node_count)
        if features.loads:
            self.node_load = ti.Vector.field(3, fp, shape=self.node_count)

    def _upload(self) -> None:
        structure, features, mesh, dtype = self.structure, self.features, self.structure.mesh, self.dtype
        thickness = np.array([one.thickness for one in structure.fabrics])[structure.tri_fabric]
        # The structure's own middle is the origin: coordinates far away would cost single precision its digits.
        self.origin = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
        self.node_rest.from_numpy((mesh.points - self.origin).astype(dtype))
        self.node_held.from_numpy(structure.node_held.astype(np.int32))
        if features.slanted and structure.node_frame is not None:
            self.node_frame.from_numpy(structure.node_frame.astype(dtype))
        start, corners = structure.node_corners
        self.node_corner_start.from_numpy(start)
        self.node_corner.from_numpy(corners)
        self.tri_node.from_numpy(np.ascontiguousarray(mesh.triangles))
        self.tri_side_length.from_numpy(self.geometry.side_length.astype(dtype))
        self.tri_volume.from_numpy((self.geometry.area * thickness).astype(dtype))
        self.tri_strain_matrix.from_numpy(self.geometry.strain_matrix.astype(dtype))
        columns = preparation.fabric_record_columns(structure.fabrics)
        self.fabric_constants.from_numpy({name: column.astype(dtype) for name, column in columns.items()})
        if features.several_fabrics:
            self.tri_fabric.from_numpy(structure.tri_fabric.astype(np.int32))
        if len(features.variants) > 1:
            numbers = [_variant_number(features, one) for one in structure.fabrics]
            self.fabric_variant.from_numpy(np.array(numbers, dtype=np.int32))
        if features.prestress:
            # A prestress is the elastic answer to a strain offset, so the wrinkling laws need not know of it.
            offsets = [one.compliance() @ np.array(one.prestress) for one in structure.fabrics]
            self.fabric_prestrain.from_numpy(np.array(offsets, dtype=dtype))
        if features.pressure == "by_chamber":
            self.tri_chamber.from_numpy(structure.tri_chamber.astype(np.int32))

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits these fields and the kernels compiled for them.

        Same triangles, supports, features and (single precision) size; moduli, thickness, prestress and positions may differ.
        """
        ours = self.structure
        size = float(np.linalg.norm(np.ptp(structure.mesh.points, axis=0)))
        return (
            np.array_equal(structure.mesh.triangles, ours.mesh.triangles)
            and np.array_equal(structure.node_held, ours.node_held)
            and structure.features() == self.features
            and len(structure.fabrics) == len(ours.fabrics)
            and structure.tri_chamber.max() == ours.tri_chamber.max()
            and (not self.split_displacement or self.displacement_quantum == _quantum(size))
        )

    def upload(self, structure: Structure) -> None:
        """Put another structure that :meth:`accepts` lets through in place of the present one, at rest; compiles nothing."""
        self.structure = structure
        self.geometry = structure.geometry
        self._upload()
        self.set_displacement(np.zeros((self.node_count, 3)))

    # ---- what a run changes

    def set_displacement(self, displacement: Floats) -> None:
        """Set all nodal displacements, (node_count, 3) lengths."""
        leading = np.ascontiguousarray(displacement, dtype=self.dtype)
        if self.split_displacement:
            leading = (np.round(displacement / self.displacement_quantum) * self.displacement_quantum).astype(
                self.dtype
            )
        self.node_displacement.from_numpy(leading)
        if self.split_displacement:
            self.node_displacement_rest.from_numpy((displacement - leading).astype(self.dtype))

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
        leading = self.node_displacement.to_numpy().astype(np.float64)
        return leading + self.node_displacement_rest.to_numpy() if self.split_displacement else leading

    def scale_thickness(self, fabric_number: int, factor: float) -> None:
        """Give one fabric so many times its thickness; 1 restores it."""
        thickness = np.array([one.thickness for one in self.structure.fabrics])
        thickness[fabric_number] *= factor
        self.tri_volume.from_numpy((self.geometry.area * thickness[self.structure.tri_fabric]).astype(self.dtype))

    def set_pressures(self, pressures: Floats) -> None:
        """Set each chamber's pressure (force per area, positive along the triangles' normals)."""
        if self.features.pressure != "none":
            self.chamber_pressure.from_numpy(np.asarray(pressures, dtype=self.dtype))

    def pressures(self) -> Floats:
        """(chamber_count,) present pressures."""
        return np.zeros(0) if self.features.pressure == "none" else self.chamber_pressure.to_numpy()

    def set_loads(self, loads: Floats) -> None:
        """Set the dead nodal forces, (node_count, 3)."""
        if self.features.loads:
            self.node_load.from_numpy(np.ascontiguousarray(loads, dtype=self.dtype))

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


def _quantum(size: float) -> float:
    """Power of two that the leading part of displacements in single precision is a multiple of."""
    return float(2.0 ** np.floor(np.log2(size * _QUANTUM)))


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
