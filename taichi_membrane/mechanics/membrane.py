"""Taichi kernels of one structure: corner forces, nodal sums, energy, strain, stress and wrinkling state.

A :class:`Membrane` is built once per run; displacements, pressures and loads are set by methods. A feature the structure does not
use compiles no branch here.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element, fabric
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.fields import MembraneFields
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.names import TAUT


@ti.data_oriented
class Membrane(MembraneFields):
    """Fields and kernels of one structure; see the module text."""

    # ---- one triangle

    @ti.func
    def fabric_number(self, t):
        """Number of the triangle's fabric; the constant 0 when there is one fabric."""
        number = 0
        if ti.static(self.features.several_fabrics):
            number = self.tri_fabric[t]
        return number

    @ti.func
    def pressure_on(self, t):
        """Pressure on a triangle."""
        pressure = ti.cast(0.0, self.fp)
        if ti.static(self.features.pressure == "uniform"):
            pressure = self.chamber_pressure[0]
        if ti.static(self.features.pressure == "by_chamber"):
            chamber = self.tri_chamber[t]
            if chamber >= 0:
                pressure = self.chamber_pressure[chamber]
        return pressure

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
    def sides(self, t):
        """Vectors of the three sides at rest, and the differences of their ends' displacements; rows of two matrices."""
        nodes = self.tri_node[t]
        x_0, x_1, x_2 = self.node_rest[nodes[0]], self.node_rest[nodes[1]], self.node_rest[nodes[2]]
        rest = ti.Matrix.rows([x_2 - x_1, x_0 - x_2, x_1 - x_0])
        stretch = ti.Matrix.rows(
            [
                self.displacement_difference(nodes[2], nodes[1]),
                self.displacement_difference(nodes[0], nodes[2]),
                self.displacement_difference(nodes[1], nodes[0]),
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
            strain += self.fabric_prestrain[k]
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
    def store_corner_forces(self, t):
        """Forces of triangle ``t`` on its corners: natural side forces and follower pressure, at the present place."""
        rest, stretch = self.sides(t)
        density = self.force_densities(t, self.fabric_number(t), rest, stretch)
        side_0, side_1, side_2 = rest[0, :] + stretch[0, :], rest[1, :] + stretch[1, :], rest[2, :] + stretch[2, :]
        pull_0, pull_1, pull_2 = density[0] * side_0, density[1] * side_1, density[2] * side_2
        force_0, force_1, force_2 = pull_2 - pull_1, pull_0 - pull_2, pull_1 - pull_0
        if ti.static(self.features.pressure != "none"):
            push = element.pressure_corner_force(self.pressure_on(t), side_1, side_2)
            force_0 += push
            force_1 += push
            force_2 += push
        self.tri_corner_force[3 * t] = force_0
        self.tri_corner_force[3 * t + 1] = force_1
        self.tri_corner_force[3 * t + 2] = force_2

    @ti.func
    def gathered_force(self, i):
        """Out-of-balance force at node ``i``: the sum of its corner forces and its dead load."""
        force = ti.Vector.zero(self.fp, 3)
        for c in range(self.node_corner_start[i], self.node_corner_start[i + 1]):
            force += self.tri_corner_force[self.node_corner[c]]
        if ti.static(self.features.loads):
            force += self.node_load[i]
        return force

    @ti.func
    def first_node(self, block):
        """First node of a block of the deterministic sums, or the number of nodes past the last one."""
        return ti.min(block * self.bounds[None].node_block_length, self.bounds[None].nodes)

    @ti.func
    def first_triangle(self, block):
        """First triangle of a block of the deterministic sums, or the number of triangles past the last one."""
        return ti.min(block * self.bounds[None].tri_block_length, self.bounds[None].triangles)

    @ti.func
    def side_bounds(self, t, k, variant: ti.template()):
        """Stiffness bounds of the three sides of triangle ``t``; see :func:`element.side_stiffness_bound`."""
        f = self.fabric_constants[k]
        matrix = self.tri_strain_matrix[t]
        rest_length = self.tri_side_length[t]
        rest, stretch = self.sides(t)
        side_force, length, _ = self.natural_forces(t, k, rest, stretch, variant)
        bound = 0.0 * rest_length
        for a in ti.static(range(3)):
            column = fabric.elastic_stress(ti.Vector([matrix[0, a], matrix[1, a], matrix[2, a]]), f)
            row_sum = self.tri_volume[t] * ti.abs(matrix.transpose() @ column).sum()
            bound[a] = element.side_stiffness_bound(
                row_sum, side_force[a], length[a], rest_length[a], self.pressure_on(t), variant.green
            )
        return bound

    @ti.func
    def store_corner_stiffness(self, t):
        """Stiffness bounds of triangle ``t``'s sides at both ends of each, in the first component of the corner forces."""
        k = self.fabric_number(t)
        bound = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                bound = self.side_bounds(t, k, self.features.variants[number])
        for a in ti.static(range(3)):
            self.tri_corner_force[3 * t + a] = ti.Vector([bound.sum() - bound[a], 0.0, 0.0])

    # ---- kernels

    @ti.kernel
    def _forces_kernel(self, out: ti.types.ndarray()):
        ti.loop_config(block_dim=self.block_dim)
        for t in range(self.bounds[None].triangles):
            self.store_corner_forces(t)
        ti.loop_config(block_dim=self.block_dim)
        for i in range(self.bounds[None].nodes):
            force = self.gathered_force(i)
            for c in ti.static(range(3)):
                out[i, c] = force[c]

    def out_of_balance(self) -> Floats:
        """(node_count, 3) out-of-balance forces, minus the gradient of the potential; at held nodes, minus the reactions."""
        out = np.zeros((self.node_count, 3), dtype=self.dtype)
        self._forces_kernel(out)
        return out.astype(np.float64)

    @ti.func
    def energy_density(self, t, k, variant: ti.template()):
        """Strain energy per volume of triangle ``t``."""
        rest, stretch = self.sides(t)
        strain, _, _ = self.strain_and_sides(t, k, rest, stretch, variant)
        _, density, _ = fabric.response(strain, self.fabric_constants[k], variant.law, variant.orthotropic)
        return density

    @ti.func
    def triangle_potential(self, t):
        """Strain energy, and pressure times swept volume, of triangle ``t``."""
        k = self.fabric_number(t)
        density = ti.cast(0.0, self.fp)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                density = self.energy_density(t, k, self.features.variants[number])
        work = ti.cast(0.0, self.fp)
        if ti.static(self.features.pressure != "none"):
            work = self.pressure_on(t) * self.swept_by(t)
        return ti.Vector([self.tri_volume[t] * density, work])

    @ti.func
    def swept_by(self, t):
        """Volume swept by a triangle since rest."""
        nodes = self.tri_node[t]
        rest, stretch = self.sides(t)
        total = self.node_displacement[nodes[0]] + self.node_displacement[nodes[1]] + self.node_displacement[nodes[2]]
        return element.swept_volume(
            total / 3.0,
            rest[1, :],
            rest[2, :],
            stretch[1, :],
            stretch[2, :],
        )

    @ti.kernel
    def _potential_kernel(self):
        for block in range(self.bounds[None].tri_blocks):
            total = ti.Vector.zero(self.fp, 2)
            for t in range(self.first_triangle(block), self.first_triangle(block + 1)):
                total += self.triangle_potential(t)
            self.block_sum[block] = total

    def potential_energy(self, loads: Floats) -> tuple[float, float]:
        """Total potential (strain energy less work of pressure and dead loads) and strain energy, force times length."""
        self._potential_kernel()
        strain, pressure = self.block_sum.to_numpy()[: self.tri_block_count].astype(np.float64).sum(axis=0)
        return float(strain - pressure - np.vdot(loads, self.displacement())), float(strain)

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
        ti.loop_config(block_dim=self.block_dim)
        for t in range(self.bounds[None].triangles):
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
