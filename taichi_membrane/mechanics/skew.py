"""Skew parts of a tangent: what forces without a potential add to the symmetric part that is factorised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
import scipy

from taichi_membrane.mechanics.body import parts_of
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mechanics.structure import Structure


class Blocks(NamedTuple):
    """3 × 3 blocks of a matrix, by the nodes of their rows and columns; those of one place add up."""

    rows: Ints
    columns: Ints
    values: Floats


class Part(Protocol):
    """One kind of forces without a potential, at a state."""

    @property
    def told(self) -> str:
        """Where they are, in words."""

    def blocks(self) -> Blocks:
        """Their part of Z, in x, y, z."""

    def work_beyond(self, displacement: Floats) -> float:
        """Minus the work that they do on the straight way to a displacement, less what the potential energy has of it."""


@dataclass(frozen=True, eq=False)
class Skew:
    """Skew part Z of the tangent at a state: the sum of its parts.

    :param base: (node_count, 3) displacements of the state.
    """

    structure: Structure
    parts: Sequence[Part]
    base: Floats

    @cached_property
    def _blocks(self) -> Blocks:
        found = Blocks(
            *(np.concatenate(arrays) for arrays in zip(*(part.blocks() for part in self.parts), strict=True))
        )
        return self._reduced(found) if self.structure.bodies else found

    def _reduced(self, found: Blocks) -> Blocks:
        """Blocks of the freedoms of rigid bodies in place of their nodes', Tᵀ Z T."""
        count = self.structure.node_count
        parts, maps = parts_of(self.structure.bodies, count), np.zeros((count, 2, 3, 3))
        maps[:, 0] = np.eye(3)
        for body in self.structure.bodies:
            maps[body.nodes] = body.map_at(self.base).reshape(-1, 3, 2, 3).transpose(0, 2, 1, 3)
        made = []
        for p in range(2):
            for q in range(2):
                rows, columns = parts[found.rows, p], parts[found.columns, q]
                used = (rows >= 0) & (columns >= 0)
                left, right = maps[found.rows[used], p], maps[found.columns[used], q]
                made.append((rows[used], columns[used], left.transpose(0, 2, 1) @ found.values[used] @ right))
        return Blocks(*(np.concatenate(arrays) for arrays in zip(*made, strict=True)))

    @cached_property
    def ends(self) -> Ints:
        """Nodes that it couples."""
        return np.unique(self._blocks.rows)

    @cached_property
    def matrix(self) -> scipy.sparse.csr_matrix:
        """Z over the components of ``ends``, in the supports' axes, zero at held ones."""
        structure, blocks = self.structure, self._blocks
        row, column = np.searchsorted(self.ends, blocks.rows), np.searchsorted(self.ends, blocks.columns)
        axes = np.broadcast_to(np.eye(3), (len(self.ends), 3, 3))
        if structure.node_frame is not None:
            axes = structure.node_frame[self.ends]
        axes = axes * ~structure.node_held[self.ends][:, :, None]
        values = axes[row] @ blocks.values @ axes[column].transpose(0, 2, 1)
        i, j = np.meshgrid(np.arange(3), np.arange(3), indexing="ij")
        places = ((3 * row[:, None, None] + i).ravel(), (3 * column[:, None, None] + j).ravel())
        size = 3 * len(self.ends)
        return scipy.sparse.csr_matrix((values.ravel(), places), shape=(size, size))

    def times(self, vector: Floats, *, transposed: bool = False) -> Floats:
        """Z, or Zᵀ = -Z, times a vector (node_count, 3)."""
        result = np.zeros_like(vector)
        product = (self.matrix @ vector[self.ends].ravel()).reshape(-1, 3)
        result[self.ends] = -product if transposed else product
        return result

    def work_beyond(self, displacement: Floats) -> float:
        """What the potential energy lacks of minus the work of all forces on the straight way to a displacement."""
        return sum(part.work_beyond(displacement) for part in self.parts)
