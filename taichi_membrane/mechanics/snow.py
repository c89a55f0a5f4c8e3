"""Load per plan area, such as snow: along one direction g, s on each unit of area seen along it, of triangles that face it.

A triangle with the directed double area N = s₁ × s₂ has twice the plan area P = <-N·g>, zero where it has turned over; each of its
corners bears s/6 P g. P depends on moves across g while the force is along it, so that there is no potential, not even on a closed
surface:

    -∂f_m/∂x_n = s/6 g ⊗ w_n,  w_n = g × s_n,  s_n the side opposite corner n.

Kernels assemble the symmetric part s/12 (g ⊗ w_n + w_m ⊗ g); the skew one is :class:`SnowSkew`, a part of what
:mod:`taichi_membrane.mechanics.rim` adds to the factor. The force has a kink where a triangle turns over.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import fill
from taichi_membrane.mechanics.preparation import Floats, Ints, sides_now
from taichi_membrane.mechanics.skew import Blocks
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class Snow:
    """Load per plan area on each triangle."""

    def __init__(self, structure: Structure, fp, dtype) -> None:
        self.fp, self.dtype, self.used = fp, dtype, structure.features().snow
        if self.used:
            self.tri_snow = ti.field(fp, shape=structure.mesh.tri_count)
            self.snow_direction = ti.Vector.field(3, fp, shape=())

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits, where its triangles do."""
        return True

    def upload(self, structure: Structure) -> None:
        """Take over a structure's loads, with nothing lying there."""
        self.loads = structure.snow
        if self.loads is not None:
            self.snow_direction[None] = self.loads.direction.tolist()
            self.set(np.zeros(self.loads.share.shape[1]))

    def set(self, values: Floats) -> None:
        """Set each load's value (force per plan area)."""
        if self.loads is not None:
            self.now = np.array(values)
            fill(self.tri_snow, (self.loads.share @ self.now).astype(self.dtype))

    def values(self) -> Floats:
        """Present values."""
        return np.zeros(0) if self.loads is None else self.now

    @ti.func
    def bound(self, t):
        """What to add to the size of a triangle's pressure in the bound of its sides' stiffness: 4 s gives s l/3 at each side."""
        return 4.0 * ti.abs(self.tri_snow[t])

    @ti.func
    def corner_force(self, t, side_1, side_2):
        """Force on each of the three corners of triangle ``t``."""
        down = self.snow_direction[None]
        plan = ti.max(-side_1.cross(side_2).dot(down), ti.cast(0.0, self.fp))
        return self.tri_snow[t] / 6.0 * plan * down

    @ti.func
    def stiffness(self, t, side_m, side_n, side_1, side_2):
        """Symmetric part of -∂f_m/∂x_n of triangle ``t``, for two corners, the same or not, and their opposite sides."""
        down = self.snow_direction[None]
        size = self.tri_snow[t] / 12.0
        if side_1.cross(side_2).dot(down) >= 0.0:
            size *= 0.0
        return size * (down.outer_product(down.cross(side_n)) + down.cross(side_m).outer_product(down))


@dataclass(frozen=True, eq=False)
class SnowSkew:
    """Skew part of the tangent of loads per plan area at a state.

    :param tri: numbers of the triangles with a load, ``load`` (k,) its size on each.
    :param base: (node_count, 3) displacements of the state.
    """

    structure: Structure
    tri: Ints
    load: Floats
    base: Floats

    @classmethod
    def at(cls, structure: Structure, values: Floats, displacement: Floats) -> SnowSkew | None:
        """That of the loads' values; None where nothing lies anywhere."""
        if structure.snow is None:
            return None
        load = structure.snow.share @ values
        tri = np.flatnonzero(load)
        return cls(structure, tri, load[tri], displacement) if len(tri) else None

    @property
    def told(self) -> str:
        """Where it is, in words."""
        return f"a load per plan area on {len(self.tri)} elements"

    @property
    def down(self) -> Floats:
        """Unit vector g."""
        assert self.structure.snow is not None
        return self.structure.snow.direction

    def plan(self, displacement: Floats) -> Floats:
        """(k,) twice the plan area of each triangle, negative where it has turned over."""
        sides = sides_now(self.structure.mesh, displacement, self.tri)
        return np.asarray(-np.cross(sides[:, 1], sides[:, 2]) @ self.down)

    def blocks(self) -> Blocks:
        """s/12 (g ⊗ w_n - w_m ⊗ g) for each two corners m, n of the triangles that face the load."""
        nodes, down = self.structure.mesh.triangles[self.tri], self.down
        across = np.cross(down, sides_now(self.structure.mesh, self.base, self.tri))
        size = np.where(self.plan(self.base) > 0.0, self.load / 12.0, 0.0)
        rows, columns, blocks = [], [], []
        for m in range(3):
            for n in range(3):
                rows.append(nodes[:, m])
                columns.append(nodes[:, n])
                one = down[:, None] * across[:, n, None, :] - across[:, m, :, None] * down
                blocks.append(size[:, None, None] * one)
        return Blocks(np.concatenate(rows), np.concatenate(columns), np.concatenate(blocks))

    def work_beyond(self, displacement: Floats) -> float:
        """Minus the work of the loads along the straight way from ``base``: s/6 Σ d·g ∫ <P> dτ, P quadratic in τ."""
        step = (displacement - self.base) @ self.down
        moved = step[self.structure.mesh.triangles[self.tri]].sum(axis=1)
        first, last = self.plan(self.base), self.plan(displacement)
        middle = self.plan(0.5 * (self.base + displacement))
        return -float((self.load / 6.0 * moved) @ _positive_part(first, middle, last))


def _positive_part(first: Floats, middle: Floats, last: Floats) -> Floats:
    """∫₀¹ <q> dτ of quadratics by their values at 0, ½ and 1; exact, whatever their zeros."""
    a, b, c = 2.0 * (first - 2.0 * middle + last), -3.0 * first + 4.0 * middle - last, first
    root = np.sqrt(np.maximum(b**2 - 4.0 * a * c, 0.0))
    # The larger of the two zeros in size first, the other by their product, so that none loses its digits.
    large = -0.5 * (b + np.where(b < 0.0, -root, root))
    with np.errstate(divide="ignore", invalid="ignore"):
        zeros = np.stack([large / a, c / large])
    zeros = np.clip(np.nan_to_num(zeros, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    ends = np.concatenate([np.zeros_like(zeros[:1]), np.sort(zeros, axis=0), np.ones_like(zeros[:1])])

    def below(t: Floats) -> Floats:
        return np.asarray(t * (c + t * (b / 2.0 + t * a / 3.0)))

    total = np.zeros_like(first)
    for left, right in pairwise(ends):
        total += np.maximum(below(right) - below(left), 0.0)
    return total
