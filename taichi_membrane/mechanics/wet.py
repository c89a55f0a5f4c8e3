"""What the host knows of standing liquids (:mod:`.water`): forces at a place, and the skew part of the tangent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Water, sides_now
from taichi_membrane.mechanics.skew import Blocks
from taichi_membrane.mechanics.structure import Structure

# Skew parts of neighbours that cancel to this share of the largest block are round-off.
_CANCELLED = 1e-12
# Directions closer than this are one, as in :mod:`rim`.
_IN_PLANE = 1e-9
# Points of a quadrature along a step. The force is smooth but for jumps of its third derivative where the level meets a corner.
_POINTS = 24


def wet_matrices(depth: Floats) -> Floats:
    """(n, 3, 3) M of triangles by the depths (n, 3) of their corners; what :func:`.water.wet_matrix` does, in NumPy."""
    whole = (np.eye(3) + 1.0) / 24.0
    wet_corner = depth > 0.0
    count = wet_corner.sum(axis=1)
    result = np.where((count == 3)[:, None, None], whole, 0.0)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for lone, chosen in ((True, count == 1), (False, count == 2)):
            here = np.flatnonzero(chosen & (wet_corner[:, i] == lone))
            d = depth[here]
            a, b = d[:, i] / (d[:, i] - d[:, j]), d[:, i] / (d[:, i] - d[:, k])
            one, zero = np.ones_like(a), np.zeros_like(a)
            shapes = np.empty((len(here), 3, 3))  # of each corner, at the corners of the part
            shapes[:, i] = np.column_stack([one, 1.0 - a, 1.0 - b])
            shapes[:, j], shapes[:, k] = np.column_stack([zero, a, zero]), np.column_stack([zero, zero, b])
            sums = shapes.sum(axis=2)
            part = sums[:, :, None] * sums[:, None, :] + shapes @ shapes.transpose(0, 2, 1)
            part *= (a * b / 24.0)[:, None, None]
            result[here] = part if lone else whole - part
    return result


def corner_forces(structure_points: Floats, one: Water, level: float, displacement: Floats) -> Floats:
    """(k, 3, 3) force of a liquid on each corner of its triangles."""
    depth, directed = depths(structure_points, one, level, displacement), directed_areas(one, displacement)
    share = one.weight[one.tri, None] * np.einsum("tab,tb->ta", wet_matrices(depth), depth)
    return share[:, :, None] * directed[:, None, :]


def depths(points: Floats, one: Water, level: float, displacement: Floats) -> Floats:
    """(k, 3) depth of the corners of a liquid's triangles."""
    return one.level(level) - ((points + displacement) @ one.up)[one.mesh.triangles[one.tri]]


def directed_areas(one: Water, displacement: Floats) -> Floats:
    """(k, 3) doubled directed areas of a liquid's triangles."""
    sides = sides_now(one.mesh, displacement, one.tri)
    return np.cross(sides[:, 1], sides[:, 2])


def rim_moves(structure: Structure, one: Water) -> bool:
    """Whether the rim of a liquid's surface moves but in vertical planes that it lies in, so that there is no potential."""
    mesh, table = structure.mesh, structure.mesh.edge_table
    along = np.where(mesh.triangles < np.roll(mesh.triangles, -1, axis=1), 1, -1).ravel()[table.half_edges]
    weight = one.weight[table.half_edges // 3]
    nodes = table.nodes[np.add.reduceat(weight * along, table.start) != 0.0]
    if not len(nodes):
        return False
    frames = np.broadcast_to(np.eye(3), (*nodes.shape, 3, 3))
    if structure.node_frame is not None:
        frames = structure.node_frame[nodes]
    ways = (np.where(structure.node_fixed[nodes], 0.0, 1.0)[..., None] * frames).reshape(len(nodes), 6, 3)
    edge = mesh.points[nodes[:, 1]] - mesh.points[nodes[:, 0]]
    edge /= np.linalg.norm(edge, axis=1, keepdims=True)
    span = np.concatenate([ways, edge[:, None]], axis=1)
    flat = span - (span @ one.up)[..., None] * one.up
    moving = np.abs(ways).max(axis=(1, 2)) > 0.0
    return bool((moving & (np.linalg.matrix_rank(flat, tol=_IN_PLANE) > 1)).any())


@dataclass(frozen=True, eq=False)
class WaterSkew:
    """Skew part of the tangent of one liquid at a state.

    :param value: height of its level above its floor.
    :param base: (node_count, 3) displacements of the state.
    """

    structure: Structure
    one: Water
    value: float
    base: Floats

    @property
    def told(self) -> str:
        """Where it is, in words."""
        return f"the rim of a liquid's {len(self.one.tri)} elements, which moves"

    def blocks(self) -> Blocks:
        """γ/2 (M_ab (N ⊗ e - e ⊗ N) - (M d)_a [s_b]× - (M d)_b [s_a]×), summed over triangles, of which the rim's are left."""
        one = self.one
        depth, directed = depths(self.structure.points, one, self.value, self.base), directed_areas(one, self.base)
        wet = wet_matrices(depth)
        share, weight = np.einsum("tab,tb->ta", wet, depth), 0.5 * one.weight[one.tri]
        turned = directed[:, :, None] * one.up - one.up[:, None] * directed[:, None, :]
        cross = _cross_matrices(sides_now(one.mesh, self.base, one.tri))
        nodes, count = one.mesh.triangles[one.tri].astype(np.int64), self.structure.node_count
        keys, values = [], []
        for a in range(3):
            for b in range(3):
                block = wet[:, a, b, None, None] * turned
                block = block - share[:, a, None, None] * cross[:, b] - share[:, b, None, None] * cross[:, a]
                keys.append(nodes[:, a] * count + nodes[:, b])
                values.append(weight[:, None, None] * block)
        places, number = np.unique(np.concatenate(keys), return_inverse=True)
        total = np.zeros((len(places), 3, 3))
        np.add.at(total, number.ravel(), np.concatenate(values))
        size, largest = np.abs(total).max(axis=(1, 2)), max(float(np.abs(block).max(initial=0.0)) for block in values)
        left = np.flatnonzero(size > _CANCELLED * largest)
        return Blocks(places[left] // count, places[left] % count, total[left])

    def work_beyond(self, displacement: Floats) -> float:
        """Minus the work along the straight way from ``base``, and the change of W, which the potential energy has."""
        step = (displacement - self.base)[self.one.mesh.triangles[self.one.tri]]
        done = 0.0
        for point, weight in zip(*np.polynomial.legendre.leggauss(_POINTS), strict=True):
            place = self.base + 0.5 * (point + 1.0) * (displacement - self.base)
            done += (
                0.5 * weight * float(np.vdot(corner_forces(self.structure.points, self.one, self.value, place), step))
            )
        return self._flux(displacement) - self._flux(self.base) - done

    def _flux(self, displacement: Floats) -> float:
        """W at a displacement."""
        depth, directed = (
            depths(self.structure.points, self.one, self.value, displacement),
            directed_areas(self.one, displacement),
        )
        square = np.einsum("ta,tab,tb->t", depth, wet_matrices(depth), depth)
        return -0.5 * float((self.one.weight[self.one.tri] * (directed @ self.one.up)) @ square)


def _cross_matrices(vectors: Floats) -> Floats:
    """(..., 3, 3) [v]× of vectors (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)
