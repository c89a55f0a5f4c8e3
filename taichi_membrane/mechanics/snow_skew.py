"""The skew part of the tangent of loads per plan area; :mod:`taichi_membrane.mechanics.snow` has what they are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Ints, sides_now
from taichi_membrane.mechanics.skew import Blocks
from taichi_membrane.mechanics.structure import Structure


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
