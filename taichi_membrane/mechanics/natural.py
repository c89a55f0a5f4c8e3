"""What natural triangles of any number of nodes have in common: what the fabric does at each point where strain is sampled.

There the three sides, of a three-node triangle as they are, of others by the tangents of the surface (:mod:`six_node`), have
extensions δ, of which strain is ε = G δ, and answer with the natural forces T = V Gᵀ σ, V the volume that belongs to the point.
"""

from typing import Any

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element, fabric
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.features import Features
from taichi_membrane.mechanics.nodes import Array, Nodes, blocks_of, few, fill, room
from taichi_membrane.mechanics.preparation import FabricConstants
from taichi_membrane.mechanics.pressure import Pressure
from taichi_membrane.mechanics.strain_offset import StrainOffset
from taichi_membrane.mechanics.structure import Structure, variant_of
from taichi_membrane.mechanics.vectors import outer, product, times, transposed_product, transposed_times
from taichi_membrane.names import TAUT

_BOUNDS = ("count", "block_length", "blocks")


class NaturalTriangles:
    """Fields and device code that the triangles of a structure share, whatever their nodes; its element terms are made of it.

    Point ``p`` of triangle ``t`` has the number ``samples`` · t + p, with as many points in each.
    """

    # Vectors of the three sides at a point, at rest and what they have been stretched by: rows of two matrices.
    sample_sides: Any

    def __init__(self, nodes: Nodes, offset: StrainOffset, pressure: Pressure, structure: Structure) -> None:
        self.nodes, self.offset, self.pressure = nodes, offset, pressure
        self.features, self.fp, self.dtype = nodes.features, nodes.fp, nodes.dtype
        self.samples, self.ends = structure.samples, structure.mesh.cells.shape[1]
        fp, features, fabrics = self.fp, self.features, few(len(structure.fabrics))
        triangles = room(structure.mesh.tri_count)
        points = triangles * self.samples
        self.bounds = ti.types.struct(**dict.fromkeys(_BOUNDS, ti.i32)).field(shape=())
        self.tri_node = ti.Vector.field(self.ends, ti.i32, shape=triangles)
        self.tri_side_length = ti.Vector.field(3, fp, shape=points)
        self.tri_volume = ti.field(fp, shape=points)
        self.tri_strain_matrix = ti.Matrix.field(3, 3, fp, shape=points)
        self.fabric_constants = fabric.fabric_record(fp).field(shape=fabrics)
        if features.several_fabrics:
            self.tri_fabric = ti.field(ti.i32, shape=triangles)
        if len(features.variants) > 1:
            self.fabric_variant = ti.field(ti.i32, shape=fabrics)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits these fields."""
        return (
            structure.mesh.tri_count <= self.tri_node.shape[0]
            and len(structure.fabrics) <= self.fabric_constants.shape[0]
        )

    def upload(self, structure: Structure) -> None:
        """Take over a structure's triangles and fabrics."""
        self.structure, self.geometry, self.tri_count = structure, structure.geometry, structure.mesh.tri_count
        features, dtype = self.features, self.dtype
        constants = np.array([[one.record()[name] for name in fabric.CONSTANTS] for one in structure.fabrics])
        length, self.block_count = blocks_of(self.tri_count, self.nodes.on_cpu)
        self._write(
            structure.mesh.cells.astype(np.int32),
            self.geometry.side_length.astype(dtype),
            (self.geometry.area * structure.by_sample(structure.thickness)).astype(dtype),
            self.geometry.strain_matrix.astype(dtype),
            constants.astype(dtype),
            np.array([self.tri_count, length, self.block_count], dtype=np.int32),
        )
        if features.several_fabrics:
            fill(self.tri_fabric, structure.tri_fabric.astype(np.int32))
        if len(features.variants) > 1:
            numbers = [_variant_number(features, one) for one in structure.fabrics]
            fill(self.fabric_variant, np.array(numbers, dtype=np.int32))

    @ti.kernel
    def _write(
        self, cells: Array, side_length: Array, volume: Array, strain_matrix: Array, constants: Array, bounds: Array,
    ):  # fmt: skip
        for i in range(ti.max(constants.shape[0], volume.shape[0])):
            if i == 0:
                for number in ti.static(range(len(_BOUNDS))):
                    self.bounds.get_member_field(_BOUNDS[number])[None] = bounds[number]
            if i < constants.shape[0]:
                for number in ti.static(range(len(fabric.CONSTANTS))):
                    self.fabric_constants.get_member_field(fabric.CONSTANTS[number])[i] = constants[i, number]
            if i < cells.shape[0]:
                for c in ti.static(range(self.ends)):
                    self.tri_node[i][c] = cells[i, c]
            if i < volume.shape[0]:
                self.tri_volume[i] = volume[i]
                for c in ti.static(range(3)):
                    self.tri_side_length[i][c] = side_length[i, c]
                    for j in ti.static(range(3)):
                        self.tri_strain_matrix[i][c, j] = strain_matrix[i, c, j]

    def scale_thickness(self, fabric_number: int, factor: float) -> None:
        """Give one fabric so many times its thickness; 1 restores it."""
        one = self.structure
        scaled = one.by_sample(one.thickness * np.where(one.tri_fabric == fabric_number, factor, 1.0))
        fill(self.tri_volume, (self.geometry.area * scaled).astype(self.dtype))

    # ---- on the device

    @ti.func
    def count(self):
        """How many."""
        return self.bounds[None].count

    @ti.func
    def first(self, block):
        """First triangle of a block of the deterministic sums, or the number of triangles past the last one."""
        return ti.min(block * self.bounds[None].block_length, self.bounds[None].count)

    @ti.func
    def fabric_number(self, t):
        """Number of the triangle's fabric; the constant 0 when there is one fabric."""
        number = 0
        if ti.static(self.features.several_fabrics):
            number = self.tri_fabric[t]
        return number

    @ti.func
    def has_variant(self, k, number: ti.template()):
        """Whether fabric ``k`` needs element code ``number``; always so when there is only one."""
        result = True
        if ti.static(len(self.features.variants) > 1):
            result = self.fabric_variant[k] == number
        return result

    @ti.func
    def strain_and_sides(self, t, s, k, rest, stretch, variant: ti.template()):
        """Strain in fabric axes (eq. 7) with its offset, side lengths, force-density factors at point ``s`` of triangle ``t``."""
        rest_length = self.tri_side_length[s]
        extension, length, factor = 0.0 * rest_length, 0.0 * rest_length, 0.0 * rest_length
        for a in ti.static(range(3)):
            extension[a], length[a], factor[a] = element.side_extension(
                rest[a, :], stretch[a, :], rest_length[a], variant.green
            )
        strain = times(self.tri_strain_matrix[s], extension)
        if ti.static(self.offset.used):
            strain += self.offset.of(t, k)
        return strain, length, factor

    @ti.func
    def natural_forces(self, t, s, k, rest, stretch, variant: ti.template()):
        """Side forces T = V Gᵀ σ (eq. 12), present side lengths and force-density factors at point ``s`` of triangle ``t``."""
        strain, length, factor = self.strain_and_sides(t, s, k, rest, stretch, variant)
        stress, _energy, _state = fabric.response(strain, self.fabric_constants[k], variant.law, variant.orthotropic)
        return self.tri_volume[s] * transposed_times(self.tri_strain_matrix[s], stress), length, factor

    @ti.func
    def force_densities(self, t, s, k, rest, stretch):
        """Force over length of the three sides at point ``s`` of triangle ``t``, by the element code its fabric needs."""
        density = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                side_force, _length, factor = self.natural_forces(
                    t, s, k, rest, stretch, self.features.variants[number]
                )
                density = side_force * factor
        return density

    @ti.func
    def side_bounds(self, t, s, k, rest, stretch, pressure, variant: ti.template()):
        """Stiffness bounds of the three sides at point ``s`` of triangle ``t``; see :func:`element.side_stiffness_bound`."""
        f = self.fabric_constants[k]
        matrix = self.tri_strain_matrix[s]
        rest_length = self.tri_side_length[s]
        side_force, length, _factor = self.natural_forces(t, s, k, rest, stretch, variant)
        bound = 0.0 * rest_length
        for a in ti.static(range(3)):
            column = fabric.elastic_stress(ti.Vector([matrix[0, a], matrix[1, a], matrix[2, a]]), f)
            row_sum = self.tri_volume[s] * ti.abs(transposed_times(matrix, column)).sum()
            bound[a] = element.side_stiffness_bound(
                row_sum, side_force[a], length[a], rest_length[a], pressure, variant.green
            )
        return bound

    @ti.func
    def energy_density(self, t, s, k, rest, stretch):
        """Strain energy per volume at point ``s`` of triangle ``t``."""
        density = ti.cast(0.0, self.fp)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                density = self._energy_density(t, s, k, rest, stretch, self.features.variants[number])
        return density

    @ti.func
    def _energy_density(self, t, s, k, rest, stretch, variant: ti.template()):
        strain, _length, _factor = self.strain_and_sides(t, s, k, rest, stretch, variant)
        _stress, density, _state = fabric.response(strain, self.fabric_constants[k], variant.law, variant.orthotropic)
        return density

    @ti.func
    def side_stiffness(self, t, s, k, rest, stretch, variant: ti.template()):
        """At point ``s`` of triangle ``t``: natural stiffness, side forces, gradients of the extensions, lengths and factors."""
        strain, length, factor = self.strain_and_sides(t, s, k, rest, stretch, variant)
        constants = self.fabric_constants[k]
        stress, _energy, state = fabric.response(strain, constants, variant.law, variant.orthotropic)
        matrix = self.tri_strain_matrix[s]
        volume = self.tri_volume[s]
        side_force = volume * transposed_times(matrix, stress)
        material = fabric.tangent(strain, constants, state, variant.law, variant.orthotropic)
        natural = volume * product(transposed_product(matrix, material), matrix)
        sides = rest + stretch
        gradient = ti.Matrix.zero(self.fp, 3, 3)
        for a in ti.static(range(3)):
            for c in ti.static(range(3)):
                gradient[a, c] = factor[a] * sides[a, c]
        return natural, side_force, gradient, length, factor

    @ti.func
    def corner_parts(self, natural, side_force, gradient, sides, length, factor, variant: ti.template()):
        """What the blocks of the triangle that the sides at a point make have in common, as lists: the gradient of each side's
        extension, T ∂²δ/∂x² of each side, and of each side and corner how its force changes with the corner's place."""
        slope = [gradient[a, :] for a in ti.static(range(3))]
        curvature = [
            element.side_curvature(side_force[a], sides[a, :], length[a], factor[a], variant.green)
            for a in ti.static(range(3))
        ]
        change = [
            [
                natural[a, (c + 1) % 3] * slope[(c + 1) % 3] - natural[a, (c + 2) % 3] * slope[(c + 2) % 3]
                for c in ti.static(range(3))
            ]
            for a in ti.static(range(3))
        ]
        return slope, curvature, change

    @ti.func
    def corner_block(self, first: ti.template(), second: ti.template(), slope, curvature, change):
        """What couples corners ``first`` (rows) and ``second`` of the triangle whose parts are given."""
        block = ti.Matrix.zero(self.fp, 3, 3)
        for a in ti.static(range(3)):
            if ti.static(_sign(a, first) != 0):
                part = outer(slope[a], change[a][second])
                if ti.static(_sign(a, first) > 0):
                    block += part
                else:
                    block -= part
                if ti.static(_sign(a, first) * _sign(a, second) > 0):
                    block += curvature[a]
                if ti.static(_sign(a, first) * _sign(a, second) < 0):
                    block -= curvature[a]
        return block

    @ti.func
    def state_of(self, t, s, k, variant: ti.template()):
        """Strain, stress, state and the three scalars of :class:`ElementState` at point ``s`` of triangle ``t``."""
        f = self.fabric_constants[k]
        rest, stretch = self.sample_sides(t, s)
        strain, _length, _factor = self.strain_and_sides(t, s, k, rest, stretch, variant)
        stress, _energy, state = fabric.response(strain, f, variant.law, variant.orthotropic)
        trial = fabric.elastic_stress(strain, f)
        folds = fabric.fold_strain(strain, stress, f)
        fold_major, _fold_minor = fabric.principal_values(folds[0], folds[1], 0.5 * folds[2])
        _trial_major, trial_minor = fabric.principal_values(trial[0], trial[1], trial[2])
        strain_major, _strain_minor = fabric.principal_values(strain[0], strain[1], 0.5 * strain[2])
        if state == TAUT:
            fold_major *= 0.0
        modulus = ti.max(f.root_warp, f.root_weft) ** 2
        return strain, stress, state, ti.Vector([ti.max(fold_major, 0.0), trial_minor / modulus, strain_major])

    @ti.kernel
    def _state_kernel(
        self,
        strain_out: ti.types.ndarray(),
        stress_out: ti.types.ndarray(),
        state_out: ti.types.ndarray(),
        scalar_out: ti.types.ndarray(),
    ):
        ti.loop_config(block_dim=self.nodes.block_dim)
        for s in range(self.bounds[None].count * self.samples):
            t = s // self.samples
            k = self.fabric_number(t)
            for number in ti.static(range(len(self.features.variants))):
                if self.has_variant(k, number):
                    strain, stress, state, scalars = self.state_of(t, s, k, self.features.variants[number])
                    state_out[s] = state
                    for c in ti.static(range(3)):
                        strain_out[s, c] = strain[c]
                        stress_out[s, c] = stress[c]
                        scalar_out[s, c] = scalars[c]

    def element_state(self) -> ElementState:
        """Strain, stress and wrinkling state at every point of every triangle, at the present displacements."""
        points = self.tri_count * self.samples
        strain, stress = (np.zeros((points, 3), dtype=self.dtype) for _ in range(2))
        state = np.zeros(points, dtype=np.int32)
        scalars = np.zeros((points, 3), dtype=self.dtype)
        self._state_kernel(strain, stress, state, scalars)
        return ElementState(
            strain=strain.astype(np.float64),
            stress=stress.astype(np.float64),
            state=state.astype(np.int8),
            fold_strain=scalars[:, 0].astype(np.float64),
            taut_margin=scalars[:, 1].astype(np.float64),
            slack_margin=scalars[:, 2].astype(np.float64),
        )


def _variant_number(features: Features, one: FabricConstants) -> int:
    """Number of a fabric's element code; an unused fabric may get any."""
    variant = variant_of(one)
    return features.variants.index(variant) if variant in features.variants else 0


def _sign(side: int, corner: int) -> int:
    """How side ``side``'s vector depends on a corner's position: +1 at its far end, -1 at its near end, 0 opposite."""
    return {2: 1, 1: -1, 0: 0}[(corner - side) % 3]
