"""Standing liquid on one side of the surface: pressure γ d along the moving normal, d = <h - z> the depth below its level h.

The depth is linear on a flat triangle. With the matrix M of the shape functions over its wet part, M_ab = 1/(2A) ∫ N_a N_b, exact
for a triangle that is wholly wet and for one that the level cuts (its wet part is the triangle at one corner, or all but that one),

    f_a = γ (M d)_a N,   N = s₁ × s₂ the doubled directed area,

which is the change of W = -γ/2 Σ (N·e) d·M d, e upwards: the flux of a field along e whose divergence is the pressure. So there
is a potential wherever the surface is closed, or its rim is held or moves in vertical planes that it lies in. The tangent is

    -∂f_a/∂x_b = γ (M_ab N ⊗ e - (M d)_a [s_b]×),

of which kernels assemble the symmetric part; what is left at a rim that moves is :class:`.wet.WaterSkew`, a part
of what :mod:`taichi_membrane.mechanics.rim` adds to the factor.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics import element
from taichi_membrane.mechanics.nodes import Nodes, fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class WaterTerm:
    """The levels, and the liquids at each triangle."""

    def __init__(self, nodes: Nodes, structure: Structure) -> None:
        self.nodes, self.fp, self.dtype = nodes, nodes.fp, nodes.dtype
        self.kinds = structure.features().water
        self.used = self.kinds > 0
        if self.used:
            self.tri_water = ti.Vector.field(
                self.kinds, nodes.fp, shape=room(structure.mesh.tri_count)
            )  # γ along the normal
            self.water_level = ti.Vector.field(4, nodes.fp, shape=self.kinds)  # upwards, and the height of the level

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits, where its triangles do."""
        return True

    def upload(self, structure: Structure) -> None:
        """Take over a structure's liquids, at level zero."""
        self.liquids = structure.water
        self.now: Floats | None = None
        if self.used:
            fill(self.tri_water, np.column_stack([one.weight for one in self.liquids]).astype(self.dtype))
            self.set(np.zeros(self.kinds))

    def set(self, values: Floats) -> None:
        """Set each level, above its floor."""
        if not self.used or (self.now is not None and np.array_equal(values, self.now)):
            return
        self.now = np.array(values)
        # Nodes are stored from the structure's middle.
        heights = [
            one.level(value) - one.up @ self.nodes.origin for one, value in zip(self.liquids, values, strict=True)
        ]
        planes = np.column_stack([np.array([one.up for one in self.liquids]), heights])
        fill(self.water_level, planes.astype(self.dtype))

    def values(self) -> Floats:
        """Present levels."""
        return np.zeros(0) if self.now is None else self.now

    @ti.func
    def depths(self, corners, k: ti.template()):
        """Depth of each corner of a triangle below level ``k``, negative above it."""
        level = self.water_level[k]
        up = ti.Vector([level[0], level[1], level[2]])
        depth = ti.Vector.zero(self.fp, 3)
        for c in ti.static(range(3)):
            place = self.nodes.node_rest[corners[c]] + self.nodes.node_displacement[corners[c]]
            if ti.static(self.nodes.split_displacement):
                place += self.nodes.node_displacement_rest[corners[c]]
            depth[c] = level[3] - up.dot(place)
        return depth, up

    @ti.func
    def bound(self, t, corners, longest):
        """What to add to the size of a triangle's pressure in the bound of its sides' stiffness: γ (d + 2 l)."""
        total = ti.cast(0.0, self.fp)
        for k in ti.static(range(self.kinds)):
            depth, _up = self.depths(corners, k)
            total += ti.abs(self.tri_water[t][k]) * (ti.max(depth.max(), ti.cast(0.0, self.fp)) + 2.0 * longest)
        return total

    @ti.func
    def corner_forces(self, t, corners, directed):
        """Force on each corner of triangle ``t``, as rows; ``directed`` is its doubled directed area."""
        force = ti.Matrix.zero(self.fp, 3, 3)
        for k in ti.static(range(self.kinds)):
            depth, _up = self.depths(corners, k)
            share = self.tri_water[t][k] * (wet_matrix(depth) @ depth)
            force += share.outer_product(directed)
        return force

    @ti.func
    def work(self, t, corners, directed):
        """W of triangle ``t``."""
        total = ti.cast(0.0, self.fp)
        for k in ti.static(range(self.kinds)):
            depth, up = self.depths(corners, k)
            total -= 0.5 * self.tri_water[t][k] * directed.dot(up) * depth.dot(wet_matrix(depth) @ depth)
        return total

    @ti.func
    def add_blocks(self, t, corners, sides, slot_block: ti.template(), pair_block: ti.template()):
        """Adds the symmetric part to the six blocks of triangle ``t``."""
        directed = sides[1, :].cross(sides[2, :])
        for k in ti.static(range(self.kinds)):
            depth, up = self.depths(corners, k)
            wet = wet_matrix(depth)
            share = wet @ depth
            both = directed.outer_product(up) + up.outer_product(directed)
            for number in ti.static(range(6)):
                first, second = ti.static(element.BLOCKS[number][0], element.BLOCKS[number][1])
                v = share[second] * sides[first, :] - share[first] * sides[second, :]
                cross = ti.Matrix([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
                block = 0.5 * self.tri_water[t][k] * (wet[first, second] * both + cross)
                if ti.static(number < 3):
                    slot_block[3 * t + number] += block
                else:
                    pair_block[3 * t + number - 3] += block


@ti.func
def wet_matrix(depth):
    """M of a triangle by the depths of its corners, negative ones dry."""
    whole = (ti.Matrix.identity(float, 3) + 1.0) / 24.0
    wet = 0.0 * whole
    count = 0
    for i in ti.static(range(3)):
        count += ti.cast(depth[i] > 0.0, ti.i32)
    if count == 3:
        wet = whole
    elif count > 0:
        lone = count == 1  # the one wet corner, or else the one dry
        for i in ti.static(range(3)):
            if (depth[i] > 0.0) == lone:
                j, k = ti.static((i + 1) % 3, (i + 2) % 3)
                a, b = depth[i] / (depth[i] - depth[j]), depth[i] / (depth[i] - depth[k])
                part = 0.0 * whole
                part[i, i] = (3.0 - a - b) ** 2 + 1.0 + (1.0 - a) ** 2 + (1.0 - b) ** 2
                part[j, j], part[k, k] = 2.0 * a**2, 2.0 * b**2
                part[j, k] = a * b
                part[k, j] = a * b
                part[i, j] = a * (4.0 - 2.0 * a - b)
                part[j, i] = part[i, j]
                part[i, k] = b * (4.0 - a - 2.0 * b)
                part[k, i] = part[i, k]
                part *= a * b / 24.0
                wet = ti.select(lone, part, whole - part)
    return wet
