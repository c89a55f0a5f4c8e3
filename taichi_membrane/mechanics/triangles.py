"""The three-node natural triangles of one structure, with the loads on them: forces, energy, blocks, mass bounds.

A term; see :mod:`taichi_membrane.mechanics.terms` for what that is. A feature the structure does not use compiles no branch here.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element
from taichi_membrane.mechanics.natural import NaturalTriangles
from taichi_membrane.mechanics.nodes import Nodes
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.pressure import Pressure
from taichi_membrane.mechanics.snow import Snow
from taichi_membrane.mechanics.strain_offset import StrainOffset
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.water import WaterTerm
from taichi_membrane.mesh import quadratic


@ti.data_oriented
class Triangles(NaturalTriangles):
    """Fields and device code of a structure's triangles. Their slots are corners, 3 · triangle + corner; their pairs are sides."""

    def __init__(
        self, nodes: Nodes, offset: StrainOffset, pressure: Pressure, snow: Snow, water: WaterTerm, structure: Structure
    ) -> None:
        super().__init__(nodes, offset, pressure, structure)
        self.snow, self.water = snow, water

    # ---- on the device

    @ti.func
    def sample_sides(self, t, s):
        """Vectors of the three sides at rest, and the differences of their ends' displacements; rows of two matrices."""
        return self.sides(t)

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
    def store_forces(self, t):
        """Forces of triangle ``t`` on its corners: natural side forces and follower pressure, at the present place."""
        rest, stretch = self.sides(t)
        density = self.force_densities(t, t, self.fabric_number(t), rest, stretch)
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
    def store_bounds(self, t):
        """Stiffness bounds of triangle ``t``'s sides at both ends of each, in the first component of the corner forces."""
        k = self.fabric_number(t)
        rest, stretch = self.sides(t)
        pressure = self.pressure.on(t)
        if ti.static(self.snow.used):
            pressure = ti.abs(pressure) + self.snow.bound(t)
        if ti.static(self.water.used):
            longest = ti.cast(0.0, self.fp)
            for a in ti.static(range(3)):
                longest = ti.max(longest, (rest[a, :] + stretch[a, :]).norm())
            pressure = ti.abs(pressure) + self.water.bound(t, self.tri_node[t], longest)
        bound = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(self.features.variants))):
            if self.has_variant(k, number):
                bound = self.side_bounds(t, t, k, rest, stretch, pressure, self.features.variants[number])
        for a in ti.static(range(3)):
            self.nodes.slot_force[3 * t + a] = ti.Vector([bound.sum() - bound[a], 0.0, 0.0])

    @ti.func
    def energy(self, t):
        """Strain energy, and pressure times swept volume, of triangle ``t``."""
        rest, stretch = self.sides(t)
        density = self.energy_density(t, t, self.fabric_number(t), rest, stretch)
        work = ti.cast(0.0, self.fp)
        if ti.static(self.pressure.used):
            work = self.pressure.on(t) * self.swept_by(t, rest, stretch)
        if ti.static(self.water.used):
            sides = rest + stretch
            work += self.water.work(t, self.tri_node[t], sides[1, :].cross(sides[2, :]))
        return ti.Vector([self.tri_volume[t] * density, work])

    @ti.func
    def swept_by(self, t, rest, stretch):
        """Volume swept by a triangle since rest, whose sides are given."""
        nodes = self.tri_node[t]
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
        natural, side_force, gradient, length, factor = self.side_stiffness(t, t, k, rest, stretch, variant)
        pressure = self.pressure.on(t)
        sides = rest + stretch
        slope, curvature, change = self.corner_parts(natural, side_force, gradient, sides, length, factor, variant)
        for number in ti.static(range(6)):
            first, second = ti.static(element.BLOCKS[number][0], element.BLOCKS[number][1])
            block = self.corner_block(first, second, slope, curvature, change)
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


def swept_volumes(structure: Structure, displacement: Floats) -> Floats:
    """(tri_count,) volume each triangle has swept since rest, in double precision (NumPy; once per load step)."""
    if structure.mesh.order == 2:
        return quadratic.swept_volumes(structure.mesh.points, displacement, structure.mesh.cells)
    corners = structure.mesh.points[structure.mesh.triangles]
    moved = displacement[structure.mesh.triangles]
    rest_1, rest_2 = corners[:, 0] - corners[:, 2], corners[:, 1] - corners[:, 0]
    stretch_1, stretch_2 = moved[:, 0] - moved[:, 2], moved[:, 1] - moved[:, 0]
    linear = np.cross(rest_1, stretch_2) + np.cross(stretch_1, rest_2)
    area = np.cross(rest_1, rest_2) + 0.5 * linear + np.cross(stretch_1, stretch_2) / 3.0
    return np.asarray(0.5 * np.einsum("ij,ij->i", moved.mean(axis=1), area))
