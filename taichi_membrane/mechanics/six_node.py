"""The six-node natural triangles of one structure, with the pressure on them: forces, energy, blocks, mass bounds.

On the surface x = Σ N_i x_i (:mod:`taichi_membrane.mesh.quadratic`) the tangents x_ξ, x_η at a point span a triangle with the sides

    s₀ = x_η - x_ξ,   s₁ = -x_η,   s₂ = x_ξ,

the directions of the three sides of the flat triangle of coordinates. What the natural triangle is to its sides, the point is to
these: side strains, G, natural forces T, energy V W(ε). Forces F_c on the corners of the triangle at the point become those on
nodes, and its blocks K_cd those between nodes, by the derivatives E_i1 = N_i,ξ and E_i2 = N_i,η, sides being linear in places:

    f_i = Σ E_ic F_c,   K_ij = Σ E_ic K_cd E_jd,   c, d = 1, 2.

So forces are the gradient of Σ V W, whatever the points: three, exact for what is linear on a flat one, or six.

Pressure acts on the quadratic surface itself: f_i = p ∫ N_i x_ξ × x_η, an integrand of degree 4, is summed exactly by six points,
and is p times the gradient of the volume. The symmetric part of its tangent couples nodes by [v]×,

    v_ij = p/2 ∫ (N_i N_j,ξ - N_j N_i,ξ) x_η - (N_i N_j,η - N_j N_i,η) x_ξ.

Mass bound: with k_a the bound of side a's stiffness at a point (:func:`element.side_stiffness_bound`), the quadratic form is at
most Σ k_a |Σ_i B_ai u_i|², B_ai = ∂s_a/∂x_i, and by Cauchy-Schwarz at most Σ k_a S_a Σ_i |B_ai| |u_i|² with S_a = Σ_i |B_ai|.
So slots get ½ Σ k_a S_a |B_ai|, which is k_a for the ends of a three-node triangle's side. That of the pressure's part is
at most Σ_i |u_i|² Σ_j |v_ij|, and slots get half the sum, with |x_η| and |x_ξ| taken out of the integrals.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.natural import NaturalTriangles
from taichi_membrane.mechanics.nodes import Nodes, fill
from taichi_membrane.mechanics.pressure import Pressure
from taichi_membrane.mechanics.strain_offset import StrainOffset
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh.quadratic import RULES

# Nodes of the rows and columns of each block: those of one node, then pairs in the order of :attr:`.Structure.pairs`.
_BLOCKS = (*((i, i) for i in range(6)), *((i, j) for i in range(6) for j in range(i + 1, 6)))
_BLOCK_COUNT = 21


@ti.data_oriented
class SixNodeTriangles(NaturalTriangles):
    """Fields and device code of a structure's six-node triangles: 6 slots, corners first, and 15 pairs each."""

    def __init__(self, nodes: Nodes, offset: StrainOffset, pressure: Pressure, structure: Structure) -> None:
        super().__init__(nodes, offset, pressure, structure)
        fp = self.fp
        self.sample_slope = ti.Vector.field(2, fp, shape=(self.samples, 6))  # E_i
        self.block_node = ti.Vector.field(2, ti.i32, shape=_BLOCK_COUNT)
        if self.pressure.used:
            self.surface_slope = ti.Vector.field(2, fp, shape=(6, 6))
            self.surface_shape = ti.field(fp, shape=(6, 6))  # N_i
            self.surface_weight = ti.field(fp, shape=6)
            # Σ_j |N_i N_j,ξ - N_j N_i,ξ|, and along η.
            self.surface_reach = ti.Vector.field(2, fp, shape=(6, 6))
        self._fill_rules()

    def _fill_rules(self) -> None:
        """Write what depends on the rules alone."""
        fill(self.sample_slope, RULES[self.samples].slopes.astype(self.dtype))
        fill(self.block_node, np.array(_BLOCKS, dtype=np.int32))
        if self.pressure.used:
            surface = RULES[6]
            turning = np.einsum("ki,kjc->kijc", surface.shapes, surface.slopes)
            turning = turning - turning.transpose(0, 2, 1, 3)
            fill(self.surface_slope, surface.slopes.astype(self.dtype))
            fill(self.surface_shape, surface.shapes.astype(self.dtype))
            fill(self.surface_weight, surface.weights.astype(self.dtype))
            fill(self.surface_reach, np.abs(turning).sum(axis=2).astype(self.dtype))

    # ---- on the device

    @ti.func
    def places(self, t):
        """Places of the six nodes of triangle ``t`` at rest, and their displacements, each less those of its first; as rows."""
        nodes = self.tri_node[t]
        rest, moved = ti.Matrix.zero(self.fp, 6, 3), ti.Matrix.zero(self.fp, 6, 3)
        for i in ti.static(range(1, 6)):
            arm = self.nodes.node_rest[nodes[i]] - self.nodes.node_rest[nodes[0]]
            step = self.nodes.displacement_difference(nodes[i], nodes[0])
            for c in ti.static(range(3)):
                rest[i, c] = arm[c]
                moved[i, c] = step[c]
        return rest, moved

    @ti.func
    def along(self, rows, slopes: ti.template(), p):
        """Derivatives along ξ and η, at point ``p`` of a rule, of what the nodes have as rows."""
        by_xi, by_eta = ti.Vector.zero(self.fp, 3), ti.Vector.zero(self.fp, 3)
        for i in ti.static(range(1, 6)):  # the first row is zero
            slope = slopes[p, i]
            by_xi += slope[0] * rows[i, :]
            by_eta += slope[1] * rows[i, :]
        return by_xi, by_eta

    @ti.func
    def sides_at(self, rows, p):
        """Sides of the triangle at point ``p`` of what the nodes have as rows, or what these have been stretched by."""
        by_xi, by_eta = self.along(rows, self.sample_slope, p)
        return ti.Matrix.rows([by_eta - by_xi, -by_eta, by_xi])

    @ti.func
    def sample_sides(self, t, s):
        """Sides at rest, and what they have been stretched by, at point ``s`` of triangle ``t``."""
        rest, moved = self.places(t)
        p = s - t * self.samples
        return self.sides_at(rest, p), self.sides_at(moved, p)

    @ti.func
    def store_forces(self, t):
        """Forces of triangle ``t`` on its nodes: natural side forces and follower pressure, at the present place."""
        rest, moved = self.places(t)
        k = self.fabric_number(t)
        force = ti.Matrix.zero(self.fp, 6, 3)
        for p in range(self.samples):
            at_rest, stretch = self.sides_at(rest, p), self.sides_at(moved, p)
            density = self.force_densities(t, t * self.samples + p, k, at_rest, stretch)
            pull_0 = density[0] * (at_rest[0, :] + stretch[0, :])
            pull_1 = density[1] * (at_rest[1, :] + stretch[1, :])
            pull_2 = density[2] * (at_rest[2, :] + stretch[2, :])
            force_1, force_2 = pull_0 - pull_2, pull_1 - pull_0
            for i in ti.static(range(6)):
                slope = self.sample_slope[p, i]
                for c in ti.static(range(3)):
                    force[i, c] += slope[0] * force_1[c] + slope[1] * force_2[c]
        if ti.static(self.pressure.used):
            pressure = self.pressure.on(t)
            place = rest + moved
            for q in range(6):
                by_xi, by_eta = self.along(place, self.surface_slope, q)
                push = 0.5 * pressure * self.surface_weight[q] * by_xi.cross(by_eta)
                for i in ti.static(range(6)):
                    for c in ti.static(range(3)):
                        force[i, c] += self.surface_shape[q, i] * push[c]
        for i in ti.static(range(6)):
            self.nodes.slot_force[6 * t + i] = force[i, :]

    @ti.func
    def store_bounds(self, t):
        """Stiffness bounds of triangle ``t`` at its nodes, in the first component of their forces."""
        rest, moved = self.places(t)
        k = self.fabric_number(t)
        bound = ti.Vector.zero(self.fp, 6)
        for p in range(self.samples):
            at_rest, stretch = self.sides_at(rest, p), self.sides_at(moved, p)
            of_sides = ti.Vector.zero(self.fp, 3)
            for number in ti.static(range(len(self.features.variants))):
                if self.has_variant(k, number):
                    of_sides = self.side_bounds(
                        t, t * self.samples + p, k, at_rest, stretch, 0.0, self.features.variants[number]
                    )
            reach = ti.Vector.zero(self.fp, 3)
            for i in ti.static(range(6)):
                reach += self.side_slopes(p, i)
            for i in ti.static(range(6)):
                bound[i] += 0.5 * (of_sides * reach).dot(self.side_slopes(p, i))
        if ti.static(self.pressure.used):
            size = 0.125 * ti.abs(self.pressure.on(t))
            place = rest + moved
            for q in range(6):
                by_xi, by_eta = self.along(place, self.surface_slope, q)
                for i in ti.static(range(6)):
                    turning = self.surface_reach[q, i]
                    longest = turning[0] * by_eta.norm() + turning[1] * by_xi.norm()
                    bound[i] += size * self.surface_weight[q] * longest
        for i in ti.static(range(6)):
            self.nodes.slot_force[6 * t + i] = ti.Vector([bound[i], 0.0, 0.0])

    @ti.func
    def side_slopes(self, p, i):
        """|B_ai| of the three sides."""
        slope = self.sample_slope[p, i]
        return ti.abs(ti.Vector([slope[1] - slope[0], slope[1], slope[0]]))

    @ti.func
    def energy(self, t):
        """Strain energy, and pressure times swept volume, of triangle ``t``."""
        rest, moved = self.places(t)
        k = self.fabric_number(t)
        stored, work = ti.cast(0.0, self.fp), ti.cast(0.0, self.fp)
        for p in range(self.samples):
            s = t * self.samples + p
            density = self.energy_density(t, s, k, self.sides_at(rest, p), self.sides_at(moved, p))
            stored += self.tri_volume[s] * density
        if ti.static(self.pressure.used):
            work = self.pressure.on(t) * self.swept_by(t, rest, moved)
        return ti.Vector([stored, work])

    @ti.func
    def swept_by(self, t, rest, moved):
        """Volume swept by a triangle since rest, on a straight way."""
        first = self.nodes.node_displacement[self.tri_node[t][0]]
        volume = ti.cast(0.0, self.fp)
        for q in range(6):
            rest_xi, rest_eta = self.along(rest, self.surface_slope, q)
            moved_xi, moved_eta = self.along(moved, self.surface_slope, q)
            displacement = first
            for i in ti.static(range(1, 6)):
                displacement += self.surface_shape[q, i] * moved[i, :]
            mean = rest_xi.cross(rest_eta) + moved_xi.cross(moved_eta) / 3.0
            mean += 0.5 * (rest_xi.cross(moved_eta) + moved_xi.cross(rest_eta))
            volume += 0.5 * self.surface_weight[q] * displacement.dot(mean)
        return volume

    @ti.func
    def store_blocks(self, t, slot_block: ti.template(), pair_block: ti.template()):
        """Blocks of triangle ``t``: one for each node, and one for each two, the lower one's rows."""
        k = self.fabric_number(t)
        rest, moved = self.places(t)
        for n in range(6):
            slot_block[6 * t + n] = ti.Matrix.zero(self.fp, 3, 3)
        for n in range(15):
            pair_block[15 * t + n] = ti.Matrix.zero(self.fp, 3, 3)
        for p in range(self.samples):
            at_rest, stretch = self.sides_at(rest, p), self.sides_at(moved, p)
            for number in ti.static(range(len(self.features.variants))):
                if self.has_variant(k, number):
                    self._point_blocks(
                        t, k, p, at_rest, stretch, self.features.variants[number], slot_block, pair_block
                    )
        if ti.static(self.pressure.used):
            place = rest + moved
            pressure = self.pressure.on(t)
            for q in range(6):
                by_xi, by_eta = self.along(place, self.surface_slope, q)
                self._pressure_blocks(t, q, pressure, by_xi, by_eta, pair_block)

    @ti.func
    def _point_blocks(
        self, t, k, p, at_rest, stretch, variant: ti.template(), slot_block: ti.template(), pair_block: ti.template()
    ):
        """Add what point ``p`` couples."""
        s = t * self.samples + p
        natural, side_force, gradient, length, factor = self.side_stiffness(t, s, k, at_rest, stretch, variant)
        sides = at_rest + stretch
        slope, curvature, change = self.corner_parts(natural, side_force, gradient, sides, length, factor, variant)
        own_1 = self.corner_block(1, 1, slope, curvature, change)
        own_2 = self.corner_block(2, 2, slope, curvature, change)
        both = self.corner_block(1, 2, slope, curvature, change)
        turned = both.transpose()
        for n in range(_BLOCK_COUNT):
            nodes = self.block_node[n]
            left, right = self.sample_slope[p, nodes[0]], self.sample_slope[p, nodes[1]]
            block = left[0] * right[0] * own_1 + left[1] * right[1] * own_2
            block += left[0] * right[1] * both + left[1] * right[0] * turned
            if n < 6:
                slot_block[6 * t + n] += block
            else:
                pair_block[15 * t + n - 6] += block

    @ti.func
    def _pressure_blocks(self, t, q, pressure, by_xi, by_eta, pair_block: ti.template()):
        """Add the symmetric part of the pressure's tangent at point ``q``."""
        scale = 0.25 * pressure * self.surface_weight[q]
        for n in range(6, _BLOCK_COUNT):
            i, j = self.block_node[n][0], self.block_node[n][1]
            one, other = self.surface_shape[q, i], self.surface_shape[q, j]
            turning = one * self.surface_slope[q, j] - other * self.surface_slope[q, i]
            v = scale * (turning[0] * by_eta - turning[1] * by_xi)
            pair_block[15 * t + n - 6] += ti.Matrix([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
