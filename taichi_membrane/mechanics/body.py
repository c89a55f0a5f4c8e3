"""Rigid bodies: groups of nodes that move as one, by a map of freedoms.

A node of a body with centre X and rotation R is at x_i = X + R a_i, a_i its arm at rest. Virtual displacements are those of the
centre and a spin, δx_i = δX + δω × r_i with the present arm r_i = R a_i, so that with T the matrix of that map

    generalised forces   Σ f_i  and  Σ r_i × f_i,   that is Tᵀ f,
    tangent              Tᵀ K T + G.

A step (d, θ) leads to X + d and exp([θ]×) R. Along that way x_i'' = θ × (θ × r_i), and the energy, whose gradient is -f, has
the second derivative θ·G θ beside θ·Tᵀ K T θ:

    G = Σ (f_i·r_i) I - sym(f_i ⊗ r_i).

That is the symmetric part, everywhere, of the change of the generalised force along steps. The rest, ±½ [Σ r_i × f_i]×, is
what spins do not commute by: it vanishes with the free moment, at equilibrium. Where a rotation is held its moment stays; one
held alone of three would leave the rest without a potential (and is no constraint on places), so that none, two or three are.

No node is added: the body's first two nodes carry its freedoms in all vectors by nodes, displacement of the centre at the first
and spin at the second, times the radius of gyration ρ of the nodes, so that all are lengths and forces. Nothing is free at its
other nodes. The pose is that of the nodes' places, which alone are kept.

Nodes on a line, a mast, have no rotation about it: their least rotation counts, and the spin along the line carries nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats, Ints

# Nodes nearer to a line than this share of their size lie on it.
ON_LINE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """A rigid body.

    :param nodes: (k,) its nodes, two or more; the first two carry its freedoms.
    :param points: (k, 3) their unstressed places.
    :param centre: (3,) unstressed place of its centre; on the line of nodes that lie on one.
    :param held: (2, 3) True where a displacement of the centre, and a rotation, is held or prescribed.
    """

    nodes: Ints
    points: Floats
    centre: Floats
    held: NDArray[np.bool_]

    @cached_property
    def arms(self) -> Floats:
        """(k, 3) from the centre to the nodes at rest."""
        return self.points - self.centre

    @cached_property
    def _middle(self) -> Floats:
        return np.asarray(self.points.mean(axis=0))

    @cached_property
    def radius(self) -> float:
        """Radius of gyration ρ of the nodes about the centre."""
        return float(np.sqrt((self.arms**2).sum(axis=1).mean()))

    @cached_property
    def line(self) -> Floats | None:
        """(3,) direction of the line that the nodes lie on; None where they do not."""
        _, values, rows = np.linalg.svd(self.points - self._middle, full_matrices=False)
        return np.asarray(rows[0]) if len(values) < 2 or values[1] <= ON_LINE * values[0] else None

    @property
    def carriers(self) -> tuple[int, int]:
        """Nodes whose places in vectors hold the displacement of the centre and the spin."""
        return int(self.nodes[0]), int(self.nodes[1])

    def pose(self, displacement: Floats) -> tuple[Floats, Floats]:
        """Place of the centre (3,) and rotation (3, 3) that carry the nodes nearest to where they are, by least squares.

        :param displacement: (node_count, 3) of all nodes.
        """
        moved = displacement[self.nodes]
        shift = moved.mean(axis=0)
        before = self.points - self._middle
        after = before + moved - shift
        if self.line is not None:
            turn = least_turn(self.line, (before @ self.line) @ after)
        else:
            left, _, right = np.linalg.svd(after.T @ before)
            turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        arm = self.centre - self._middle
        return self.centre + shift + turn @ arm - arm, turn

    def displaced(self, centre: Floats, turn: Floats) -> Floats:
        """(k, 3) displacement of the nodes in a pose."""
        return np.asarray((centre - self.centre) + self.arms @ (turn - np.eye(3)).T)

    def present_arms(self, displacement: Floats) -> Floats:
        """(k, 3) from the present centre to the nodes."""
        return np.asarray(self.arms @ self.pose(displacement)[1].T)

    def rotation(self, displacement: Floats) -> Floats:
        """(3,) rotation vector of the present pose, radians, of a length up to π."""
        return np.asarray(scipy.spatial.transform.Rotation.from_matrix(self.pose(displacement)[1]).as_rotvec())

    def map_at(self, displacement: Floats) -> Floats:
        """(k, 3, 6) T at the nodes: their displacement for that of the centre and for the spin times ρ."""
        return np.concatenate(
            [
                np.broadcast_to(np.eye(3), (len(self.nodes), 3, 3)),
                -cross_matrices(self.present_arms(displacement)) / self.radius,
            ],
            axis=2,
        )

    def geometric(self, displacement: Floats, forces: Floats) -> Floats:
        """(3, 3) G over ρ², at nodal forces (node_count, 3)."""
        moments = forces[self.nodes].T @ self.present_arms(displacement)
        return np.asarray(np.trace(moments) * np.eye(3) - 0.5 * (moments + moments.T)) / self.radius**2


def cross_matrices(vectors: Floats) -> Floats:
    """(n, 3, 3) [v]× of vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def least_turn(before: Floats, after: Floats) -> Floats:
    """(3, 3) the least rotation that carries one direction to another; about any axis across them where they are opposite."""
    axis = np.cross(before, after)
    sine, cosine = float(np.linalg.norm(axis)), float(before @ after)
    if sine == 0.0:
        if cosine >= 0.0:
            return np.eye(3)
        across = np.cross(before, np.eye(3)[np.abs(before).argmin()])
        return np.asarray(
            scipy.spatial.transform.Rotation.from_rotvec(np.pi * across / np.linalg.norm(across)).as_matrix()
        )
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(np.arctan2(sine, cosine) / sine * axis).as_matrix())


def turned(vector: Floats) -> Floats:
    """(3, 3) exp([v]×)."""
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix())


# ---- all bodies of a structure, on vectors by nodes


def generalised(bodies: Sequence[Body], displacement: Floats, forces: Floats) -> Floats:
    """(node_count, 3) Tᵀ f of nodal forces."""
    result = forces.copy()
    for body in bodies:
        here = forces[body.nodes]
        result[body.nodes] = 0.0
        first, second = body.carriers
        result[first] = here.sum(axis=0)
        result[second] = np.cross(body.present_arms(displacement), here).sum(axis=0) / body.radius
    return result


def nodal(bodies: Sequence[Body], displacement: Floats, freedoms: Floats) -> Floats:
    """(node_count, 3) T s: nodal displacements, to first order, of freedoms."""
    result = freedoms.copy()
    for body in bodies:
        result[body.nodes] = body.map_at(displacement) @ freedoms[list(body.carriers)].ravel()
    return result


def spread(bodies: Sequence[Body], displacement: Floats, wrenches: Floats) -> Floats:
    """(node_count, 3) the least nodal forces that have given generalised forces."""
    result = wrenches.copy()
    for body in bodies:
        matrix = body.map_at(displacement).reshape(-1, 6)
        wrench = wrenches[list(body.carriers)].ravel()
        result[body.nodes] = np.linalg.lstsq(matrix.T, wrench, rcond=ON_LINE)[0].reshape(-1, 3)
    return result


def retracted(bodies: Sequence[Body], displacement: Floats, step: Floats) -> Floats:
    """(node_count, 3) displacements that a step in the freedoms leads to."""
    result = displacement + step
    for body in bodies:
        centre, turn = body.pose(displacement)
        first, second = body.carriers
        result[body.nodes] = body.displaced(centre + step[first], turned(step[second] / body.radius) @ turn)
    return result


def difference(bodies: Sequence[Body], before: Floats, after: Floats) -> Floats:
    """(node_count, 3) the step that leads from one place to another, of rotations below a half turn."""
    result = after - before
    for body in bodies:
        (from_centre, from_turn), (to_centre, to_turn) = body.pose(before), body.pose(after)
        turn = to_turn @ from_turn.T
        if body.line is not None:
            turn = least_turn(from_turn @ body.line, to_turn @ body.line)
        result[body.nodes] = 0.0
        first, second = body.carriers
        result[first] = to_centre - from_centre
        result[second] = body.radius * scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()
    return result


def composed(bodies: Sequence[Body], first: Floats, then: Floats) -> Floats:
    """(node_count, 3) the one step of two, the second one from where the first has led."""
    result = first + then
    for body in bodies:
        spin = body.carriers[1]
        turn = scipy.spatial.transform.Rotation.from_rotvec(
            then[spin] / body.radius
        ) * scipy.spatial.transform.Rotation.from_rotvec(first[spin] / body.radius)
        result[spin] = body.radius * turn.as_rotvec()
    return result


def parts_of(bodies: Sequence[Body], node_count: int) -> Ints:
    """(node_count, 2) places of the freedoms that move each node: itself and -1, or the carriers of its body."""
    parts = np.column_stack([np.arange(node_count), np.full(node_count, -1)])
    for body in bodies:
        parts[body.nodes] = body.carriers
    return parts


def reduced_pairs(pairs: Ints, bodies: Sequence[Body], node_count: int) -> Ints:
    """(m, 2) places whose freedoms elements on ``pairs`` of nodes couple."""
    parts = parts_of(bodies, node_count)
    found = [np.column_stack([parts[pairs[:, 0], p], parts[pairs[:, 1], q]]) for p in range(2) for q in range(2)]
    every = np.concatenate([*found, np.array([body.carriers for body in bodies])])
    return every[(every >= 0).all(axis=1) & (every[:, 0] != every[:, 1])]
