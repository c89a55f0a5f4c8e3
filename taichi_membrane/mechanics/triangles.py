"""The natural triangles of one structure, with the pressure on them: forces, energy, blocks, mass bounds, strain and stress.

A term; see :mod:`taichi_membrane.mechanics.terms` for what that is. A feature the structure does not use compiles no branch here.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element, fabric
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.nodes import Array, Nodes, blocks_of, fill
from taichi_membrane.mechanics.preparation import FabricConstants, Floats
from taichi_membrane.mechanics.pressure import Pressure
from taichi_membrane.mechanics.snow import Snow
from taichi_membrane.mechanics.structure import Features, Structure, variant_of
from taichi_membrane.mechanics.water import WaterTerm
from taichi_membrane.names import TAUT

_BOUNDS = ("count", "block_length", "blocks")


@ti.data_oriented
class Triangles:
    """Fields and device code of a structure's triangles. Their slots are corners, 3 · triangle + corner; their pairs are sides."""

    def __init__(self, nodes: Nodes, pressure: Pressure, snow: Snow, water: WaterTerm, structure: Structure) -> None:
        self.nodes, self.pressure, self.snow, self.water = nodes, pressure, snow, water
        self.features, self.fp, self.dtype = nodes.features, nodes.fp, nodes.dtype
        fp, features, triangles, fabrics = self.fp, self.features, structure.mesh.tri_count, len(structure.fabrics)
        self.bounds = ti.types.struct(**dict.fromkeys(_BOUNDS, ti.i32)).field(shape=())
        self.tri_node = ti.Vector.field(3, ti.i32, shape=triangles)
        self.tri_side_length = ti.Vector.field(3, fp, shape=triangles)
        self.tri_volume = ti.field(fp, shape=triangles)
        self.tri_strain_matrix = ti.Matrix.field(3, 3, fp, shape=triangles)
        self.fabric_constants = fabric.fabric_record(fp).field(shape=fabrics)
        if features.several_fabrics:
            self.tri_fabric = ti.field(ti.i32, shape=triangles)
        if len(features.variants) > 1:
            self.fabric_variant = ti.field(ti.i32, shape=fabrics)
        if features.prestress:
            self.prestrain = ti.Vector.field(3, fp, shape=triangles if features.offset == "by_element" else fabrics)

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
        thickness = np.array([one.thickness for one in structure.fabrics])[structure.tri_fabric]
        constants = np.array([[one.record()[name] for name in fabric.CONSTANTS] for one in structure.fabrics])
        length, self.block_count = blocks_of(self.tri_count, self.nodes.on_cpu)
        self._write(
            structure.mesh.triangles.astype(np.int32),
            self.geometry.side_length.astype(dtype),
            (self.geometry.area * thickness).astype(dtype),
            self.geometry.strain_matrix.astype(dtype),
            constants.astype(dtype),
            np.array([self.tri_count, length, self.block_count], dtype=np.int32),
        )
        if features.several_fabrics:
            fill(self.tri_fabric, structure.tri_fabric.astype(np.int32))
        if len(features.variants) > 1:
            numbers = [_variant_number(features, one) for one in structure.fabrics]
            fill(self.fabric_variant, np.array(numbers, dtype=np.int32))
        if features.prestress:
            fill(self.prestrain, structure.prestrain.astype(dtype))

    @ti.kernel
    def _write(
        self, triangles: Array, side_length: Array, volume: Array, strain_matrix: Array, constants: Array, bounds: Array,
    ):  # fmt: skip
        for number in ti.static(range(len(_BOUNDS))):
            self.bounds.get_member_field(_BOUNDS[number])[None] = bounds[number]
        for k in range(constants.shape[0]):
            for number in ti.static(range(len(fabric.CONSTANTS))):
                self.fabric_constants.get_member_field(fabric.CONSTANTS[number])[k] = constants[k, number]
        for t in range(volume.shape[0]):
            self.tri_volume[t] = volume[t]
            for c in ti.static(range(3)):
                self.tri_node[t][c] = triangles[t, c]
                self.tri_side_length[t][c] = side_length[t, c]
                for j in ti.static(range(3)):
                    self.tri_strain_matrix[t][c, j] = strain_matrix[t, c, j]

    def scale_thickness(self, fabric_number: int, factor: float) -> None:
        """Give one fabric so many times its thickness; 1 restores it."""
        thickness = np.array([one.thickness for one in self.structure.fabrics])
        thickness[fabric_number] *= factor
        fill(self.tri_volume, (self.geometry.area * thickness[self.structure.tri_fabric]).astype(self.dtype))

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
    def sides(self, t):
        """Vectors of the three sides at rest, and the differences of their ends' displacements; rows of two matrices."""
        nodes = self.tri_node[t]
        x_0, x_1, x_2 = self.nodes.node_rest[nodes[0]], self.nodes.node_rest[nodes[1]], self.nodes.node_rest[nodes[2]]
        rest = ti.Matrix.rows([x_2 - x_1, x_0 - x_2, x_1 - x_0])
        stretch = ti.Matrix.rows(
            [
                self.nodes.displacement_difference(nodes[2], nodes[1]),
                self.nodes.displacement_difference(nodes[0], nodes[2]),
                self.nodes.displacement_difference(nodes[1], nodes[0]),
            ]
        )
        return rest, stretch

    @ti.func
    def strain_and_sides(self, t, k, rest, stretch, variant: ti.template()):
        """Strain in fabric axes (eq. 7) with the offset that stands for prestress, side lengths, force-density factors."""
        rest_length = self.tri_side_length[t]
        extension, length, factor = 0.0 * rest_length, 0.0 * rest_length, 0.0 * rest_length
        for a in ti.static(range(3)):
            extension[a], length[a], factor[a] = element.side_extension(
                rest[a, :], stretch[a, :], rest_length[a], variant.green
            )
        strain = self.tri_strain_matrix[t] @ extension
        if ti.static(self.features.prestress):
            strain += self.prestrain[t if ti.static(self.features.offset == "by_element") else k]
        return strain, length, factor

    @ti.func
    def natural_forces(self, t, k, rest, stretch, variant: ti.template()):
        """Side forces T = V Gᵀ σ (eq. 12), present side lengths and force-density factors of triangle ``t``."""
        strain, length, factor = self.strain_and_sides(t, k, rest, stretch, variant)
        stress, _, _ = fabric.response(strain, self.fabric_constants[k], variant.law, variant.orthotropic)
        return self.tri_volume[t] * (self.tri_strain_matrix[t].transpose() @ stress), length, factor

    @ti.func
    def force_densities(self, t, k, rest, stretch):
        """Force over length of the three sides of triangle ``t``, by the element code its fabric needs."""
        density = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                side_force, _, factor = self.natural_forces(t, k, rest, stretch, self.features.variants[number])
                density = side_force * factor
        return density

    @ti.func
    def has_variant(self, k, number: ti.template()):
        """Whether fabric ``k`` needs element code ``number``; always so when there is only one."""
        result = True
        if ti.static(len(self.features.variants) > 1):
            result = self.fabric_variant[k] == number
        return result

    @ti.func
    def store_forces(self, t):
        """Forces of triangle ``t`` on its corners: natural side forces and follower pressure, at the present place."""
        rest, stretch = self.sides(t)
        density = self.force_densities(t, self.fabric_number(t), rest, stretch)
        side_0, side_1, side_2 = rest[0, :] + stretch[0, :], rest[1, :] + stretch[1, :], rest[2, :] + stretch[2, :]
        pull_0, pull_1, pull_2 = density[0] * side_0, density[1] * side_1, density[2] * side_2
        force_0, force_1, force_2 = pull_2 - pull_1, pull_0 - pull_2, pull_1 - pull_0
        if ti.static(self.pressure.used):
            push = element.pressure_corner_force(self.pressure.on(t), side_1, side_2)
            force_0 += push
            force_1 += push
            force_2 += push
        if ti.static(self.snow.used):
            weight = self.snow.corner_force(t, side_1, side_2)
            force_0 += weight
            force_1 += weight
            force_2 += weight
        if ti.static(self.water.used):
            wet = self.water.corner_forces(t, self.tri_node[t], side_1.cross(side_2))
            force_0 += wet[0, :]
            force_1 += wet[1, :]
            force_2 += wet[2, :]
        self.nodes.slot_force[3 * t] = force_0
        self.nodes.slot_force[3 * t + 1] = force_1
        self.nodes.slot_force[3 * t + 2] = force_2

    @ti.func
    def side_bounds(self, t, k, variant: ti.template()):
        """Stiffness bounds of the three sides of triangle ``t``; see :func:`element.side_stiffness_bound`."""
        f = self.fabric_constants[k]
        matrix = self.tri_strain_matrix[t]
        rest_length = self.tri_side_length[t]
        rest, stretch = self.sides(t)
        side_force, length, _ = self.natural_forces(t, k, rest, stretch, variant)
        bound = 0.0 * rest_length
        pressure = self.pressure.on(t)
        if ti.static(self.snow.used):
            pressure = ti.abs(pressure) + self.snow.bound(t)
        if ti.static(self.water.used):
            pressure = ti.abs(pressure) + self.water.bound(t, self.tri_node[t], length.max())
        for a in ti.static(range(3)):
            column = fabric.elastic_stress(ti.Vector([matrix[0, a], matrix[1, a], matrix[2, a]]), f)
            row_sum = self.tri_volume[t] * ti.abs(matrix.transpose() @ column).sum()
            bound[a] = element.side_stiffness_bound(
                row_sum, side_force[a], length[a], rest_length[a], pressure, variant.green
            )
        return bound

    @ti.func
    def store_bounds(self, t):
        """Stiffness bounds of triangle ``t``'s sides at both ends of each, in the first component of the corner forces."""
        k = self.fabric_number(t)
        bound = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                bound = self.side_bounds(t, k, self.features.variants[number])
        for a in ti.static(range(3)):
            self.nodes.slot_force[3 * t + a] = ti.Vector([bound.sum() - bound[a], 0.0, 0.0])

    @ti.func
    def energy_density(self, t, k, variant: ti.template()):
        """Strain energy per volume of triangle ``t``."""
        rest, stretch = self.sides(t)
        strain, _, _ = self.strain_and_sides(t, k, rest, stretch, variant)
        _, density, _ = fabric.response(strain, self.fabric_constants[k], variant.law, variant.orthotropic)
        return density

    @ti.func
    def energy(self, t):
        """Strain energy, and pressure times swept volume, of triangle ``t``."""
        k = self.fabric_number(t)
        density = ti.cast(0.0, self.fp)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                density = self.energy_density(t, k, self.features.variants[number])
        work = ti.cast(0.0, self.fp)
        if ti.static(self.pressure.used):
            work = self.pressure.on(t) * self.swept_by(t)
        if ti.static(self.water.used):
            rest, stretch = self.sides(t)
            sides = rest + stretch
            work += self.water.work(t, self.tri_node[t], sides[1, :].cross(sides[2, :]))
        return ti.Vector([self.tri_volume[t] * density, work])

    @ti.func
    def swept_by(self, t):
        """Volume swept by a triangle since rest."""
        nodes = self.tri_node[t]
        rest, stretch = self.sides(t)
        moved = ti.static(self.nodes.node_displacement)
        total = moved[nodes[0]] + moved[nodes[1]] + moved[nodes[2]]
        return element.swept_volume(
            total / 3.0,
            rest[1, :],
            rest[2, :],
            stretch[1, :],
            stretch[2, :],
        )

    @ti.func
    def store_blocks(self, t, slot_block: ti.template(), pair_block: ti.template()):
        """Blocks of triangle ``t``: one for each corner, and one for each side, which couples corners a+1 (rows) and a+2."""
        k = self.fabric_number(t)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                self._blocks(t, k, self.features.variants[number], slot_block, pair_block)

    @ti.func
    def _blocks(self, t, k, variant: ti.template(), slot_block: ti.template(), pair_block: ti.template()):
        """The six blocks of triangle ``t``: K = ∂²Π/∂x², with the symmetric part of the pressure's."""
        rest, stretch = self.sides(t)
        strain, length, factor = self.strain_and_sides(t, k, rest, stretch, variant)
        constants = self.fabric_constants[k]
        stress, _, _ = fabric.response(strain, constants, variant.law, variant.orthotropic)
        matrix = self.tri_strain_matrix[t]
        volume = self.tri_volume[t]
        side_force = volume * (matrix.transpose() @ stress)
        material = fabric.tangent(strain, constants, variant.law, variant.orthotropic)
        natural = volume * (matrix.transpose() @ material @ matrix)
        pressure = self.pressure.on(t)
        sides = rest + stretch
        gradient = ti.Matrix.zero(self.fp, 3, 3)
        for a in ti.static(range(3)):
            for c in ti.static(range(3)):
                gradient[a, c] = factor[a] * sides[a, c]
        for number in ti.static(range(6)):
            first, second = ti.static(element.BLOCKS[number][0], element.BLOCKS[number][1])
            block = ti.Matrix.zero(self.fp, 3, 3)
            for a in ti.static(range(3)):
                if ti.static(_sign(a, first) != 0):
                    left = ti.static(float(_sign(a, first))) * gradient[a, :]
                    right = ti.Vector.zero(self.fp, 3)
                    for b in ti.static(range(3)):
                        if ti.static(_sign(b, second) != 0):
                            right += ti.static(float(_sign(b, second))) * natural[a, b] * gradient[b, :]
                    block += left.outer_product(right)
                    if ti.static(_sign(a, second) != 0):
                        both = ti.static(float(_sign(a, first) * _sign(a, second)))
                        block += both * element.side_curvature(
                            side_force[a], sides[a, :], length[a], factor[a], variant.green
                        )
            if ti.static(first != second and self.pressure.used):
                block += element.pressure_stiffness(pressure, sides[first, :], sides[second, :])
            if ti.static(self.snow.used):
                block += self.snow.stiffness(t, sides[first, :], sides[second, :], sides[1, :], sides[2, :])
            if ti.static(number < 3):
                slot_block[3 * t + number] = block
            else:
                pair_block[3 * t + number - 3] = block
        if ti.static(self.water.used):
            self.water.add_blocks(t, self.tri_node[t], sides, slot_block, pair_block)

    @ti.func
    def state_of(self, t, k, variant: ti.template()):
        """Strain, stress, state and the three scalars of :class:`ElementState` of triangle ``t``."""
        f = self.fabric_constants[k]
        rest, stretch = self.sides(t)
        strain, _, _ = self.strain_and_sides(t, k, rest, stretch, variant)
        stress, _, state = fabric.response(strain, f, variant.law, variant.orthotropic)
        trial = fabric.elastic_stress(strain, f)
        folds = fabric.fold_strain(strain, stress, f)
        fold_major, _ = fabric.principal_values(folds[0], folds[1], 0.5 * folds[2])
        _, trial_minor = fabric.principal_values(trial[0], trial[1], trial[2])
        strain_major, _ = fabric.principal_values(strain[0], strain[1], 0.5 * strain[2])
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
        for t in range(self.bounds[None].count):
            k = self.fabric_number(t)
            for number in ti.static(range(len(self.features.variants))):
                if self.has_variant(k, number):
                    strain, stress, state, scalars = self.state_of(t, k, self.features.variants[number])
                    state_out[t] = state
                    for c in ti.static(range(3)):
                        strain_out[t, c] = strain[c]
                        stress_out[t, c] = stress[c]
                        scalar_out[t, c] = scalars[c]

    def element_state(self) -> ElementState:
        """Strain, stress and wrinkling state of every triangle at the present displacements."""
        strain, stress = (np.zeros((self.tri_count, 3), dtype=self.dtype) for _ in range(2))
        state = np.zeros(self.tri_count, dtype=np.int32)
        scalars = np.zeros((self.tri_count, 3), dtype=self.dtype)
        self._state_kernel(strain, stress, state, scalars)
        return ElementState(
            strain=strain.astype(np.float64),
            stress=stress.astype(np.float64),
            state=state.astype(np.int8),
            fold_strain=scalars[:, 0].astype(np.float64),
            taut_margin=scalars[:, 1].astype(np.float64),
            slack_margin=scalars[:, 2].astype(np.float64),
        )


def swept_volumes(structure: Structure, displacement: Floats) -> Floats:
    """(tri_count,) volume each triangle has swept since rest, in double precision (NumPy; once per load step)."""
    corners = structure.mesh.points[structure.mesh.triangles]
    moved = displacement[structure.mesh.triangles]
    rest_1, rest_2 = corners[:, 0] - corners[:, 2], corners[:, 1] - corners[:, 0]
    stretch_1, stretch_2 = moved[:, 0] - moved[:, 2], moved[:, 1] - moved[:, 0]
    linear = np.cross(rest_1, stretch_2) + np.cross(stretch_1, rest_2)
    area = np.cross(rest_1, rest_2) + 0.5 * linear + np.cross(stretch_1, stretch_2) / 3.0
    return np.asarray(0.5 * np.einsum("ij,ij->i", moved.mean(axis=1), area))


def _variant_number(features: Features, one: FabricConstants) -> int:
    """Number of a fabric's element code; an unused fabric may get any."""
    variant = variant_of(one)
    return features.variants.index(variant) if variant in features.variants else 0


def _sign(side: int, corner: int) -> int:
    """How side ``side``'s vector depends on a corner's position: +1 at its far end, -1 at its near end, 0 opposite."""
    return {2: 1, 1: -1, 0: 0}[(corner - side) % 3]
