"""Six-node triangles: corners 0, 1, 2 counter-clockwise, then nodes amid the sides opposite each of them, 3, 4, 5.

The surface is x = Σ N_i x_i with quadratic shape functions of the area coordinates L of the flat triangle; ξ = L₁ and η = L₂ are
the two free ones. n = x_ξ × x_η is twice the directed area per area of the flat triangle of coordinates, so that the directed area
is ½ Σ w n with weights w that add up to 1. Three-node triangles are the case of a constant n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Cells = NDArray[np.integer]

# The corners (columns) of the four flat triangles that one is cut in: at each corner, and between the nodes amid the sides.
QUARTERS = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]])
# The nodes at the two ends of the side opposite each corner, and amid it.
SIDES = np.array([[1, 2, 3], [2, 0, 4], [0, 1, 5]])


@dataclass(frozen=True, eq=False)
class Rule:
    """Points of a quadrature over a triangle.

    :param places: (k, 3) area coordinates; ``weights`` (k,) of sum 1.
    """

    places: Floats
    weights: Floats

    @property
    def shapes(self) -> Floats:
        """(k, 6) shape functions."""
        return shapes(self.places)

    @property
    def slopes(self) -> Floats:
        """(k, 6, 2) their derivatives along ξ and η."""
        return slopes(self.places)


def shapes(places: Floats) -> Floats:
    """(k, 6) shape functions at area coordinates (k, 3): L (2 L - 1) of corners, 4 L L' amid sides."""
    opposite = 4.0 * np.roll(places, -1, axis=1) * np.roll(places, -2, axis=1)
    return np.concatenate([places * (2.0 * places - 1.0), opposite], axis=1)


def slopes(places: Floats) -> Floats:
    """(k, 6, 2) derivatives of the shape functions along ξ = L₁ and η = L₂ at area coordinates (k, 3)."""
    by_place = np.zeros((len(places), 6, 3))
    for corner in range(3):
        by_place[:, corner, corner] = 4.0 * places[:, corner] - 1.0
        one, other = (corner + 1) % 3, (corner + 2) % 3
        by_place[:, 3 + corner, one], by_place[:, 3 + corner, other] = 4.0 * places[:, other], 4.0 * places[:, one]
    return by_place[:, :, 1:] - by_place[:, :, :1]


def _turned(places: list[tuple[float, float, float]], weights: list[float]) -> Rule:
    """A rule from one place of each three that turn into one another."""
    every = np.concatenate([[np.roll(one, turn) for turn in range(3)] for one in places])
    return Rule(every, np.repeat(weights, 3))


def _six() -> Rule:
    """The rule of six points that is exact to degree 4 (Strang and Fix; Dunavant)."""
    near, far = (8.0 - np.sqrt(10.0)) / 18.0, np.sqrt(38.0 - 44.0 * np.sqrt(0.4)) / 18.0
    places = [near + far, near - far]  # of both kinds the coordinate that comes twice
    weight = np.sqrt(213125.0 - 53320.0 * np.sqrt(10.0)) / 3720.0
    weights = [(620.0 / 3720.0) + weight, (620.0 / 3720.0) - weight]
    kinds = sorted(zip(places, weights, strict=True))  # near the corners first
    return _turned([(1.0 - 2.0 * one, one, one) for one, _ in kinds], [one for _, one in kinds])


# Exact to degree 2 and to degree 4; the first three points lie nearest to corners 0, 1, 2.
RULES = {3: _turned([(2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0)], [1.0 / 3.0]), 6: _six()}

# Shares of the nodes in what is lumped, such as mass: in the proportion of ∫ N_i², all of them above zero.
LUMPED = np.array([3.0, 3.0, 3.0, 16.0, 16.0, 16.0]) / 57.0


def tangents(points: Floats, cells: Cells, rule: Rule) -> tuple[Floats, Floats]:
    """(m, k, 3) x_ξ and x_η of cells (m, 6) at the points of a rule."""
    along = np.einsum("kic,mid->cmkd", rule.slopes, points[cells])
    return along[0], along[1]


def normals(points: Floats, cells: Cells, rule: Rule) -> Floats:
    """(m, k, 3) n of cells (m, 6) at the points of a rule."""
    return np.cross(*tangents(points, cells, rule))


def area_vectors(points: Floats, cells: Cells) -> Floats:
    """(m, 3) directed areas; exact."""
    return np.asarray(0.5 * np.einsum("k,mkd->md", RULES[3].weights, normals(points, cells, RULES[3])))


def areas(points: Floats, cells: Cells) -> Floats:
    """(m,) areas, by six points."""
    rule = RULES[6]
    return np.asarray(0.5 * np.linalg.norm(normals(points, cells, rule), axis=2) @ rule.weights)


def volumes(points: Floats, cells: Cells) -> Floats:
    """(m,) volumes of the cones from the origin to cells, ⅓ ∫ x·dA; exact."""
    rule = RULES[6]
    return np.asarray(
        np.einsum("k,ki,mid,mkd->m", rule.weights, rule.shapes, points[cells], normals(points, cells, rule)) / 6.0
    )


def node_areas(points: Floats, cells: Cells) -> Floats:
    """(m, 6, 3) ∫ N_i dA, the directed area that belongs to each node; exact. They are ∂V/∂x of a volume that is closed."""
    rule = RULES[6]
    return np.asarray(0.5 * np.einsum("k,ki,mkd->mid", rule.weights, rule.shapes, normals(points, cells, rule)))


def node_shares(points: Floats, cells: Cells) -> Floats:
    """(m, 6) ∫ N_i |dA|, the area that belongs to each node; near zero at corners."""
    rule = RULES[6]
    size = np.linalg.norm(normals(points, cells, rule), axis=2)
    return np.asarray(0.5 * np.einsum("k,ki,mk->mi", rule.weights, rule.shapes, size))


def swept_volumes(points: Floats, displacement: Floats, cells: Cells) -> Floats:
    """(m,) volumes that cells sweep on the straight way from rest: ∫ u·(N + ½ N' + ⅓ N'') over the triangle, N' the part of n that
    is linear in u, N'' the quadratic one; exact."""
    rule = RULES[6]
    rest = tangents(points, cells, rule)
    moved = tangents(displacement, cells, rule)
    linear = np.cross(rest[0], moved[1]) + np.cross(moved[0], rest[1])
    mean = np.cross(*rest) + 0.5 * linear + np.cross(*moved) / 3.0
    return np.asarray(0.5 * np.einsum("k,ki,mid,mkd->m", rule.weights, rule.shapes, displacement[cells], mean))


def _along_side() -> tuple[Floats, Floats, Floats]:
    """Weights (k,), shape functions and their slopes (k, 3) of a curved side at Gauss points: of its two ends, then amid it."""
    at, weights = np.polynomial.legendre.leggauss(4)
    values = np.column_stack([0.5 * at * (at - 1.0), 0.5 * at * (at + 1.0), 1.0 - at**2])
    return weights, values, np.column_stack([at - 0.5, at + 0.5, -2.0 * at])


def side_shares(points: Floats, sides: Cells) -> Floats:
    """(m, 3) ∫ N_i ds along curved sides (m, 3), by their nodes at both ends and amid them."""
    weights, values, slope = _along_side()
    speed = np.linalg.norm(np.einsum("ki,mid->mkd", slope, points[sides]), axis=2)
    return np.asarray(np.einsum("k,ki,mk->mi", weights, values, speed))


def side_products() -> Floats:
    """(3, 3, 3) ∫ N_a N_b N_c' along a curved side."""
    weights, values, slope = _along_side()
    return np.asarray(np.einsum("k,ka,kb,kc->abc", weights, values, values, slope))


def quarters(cells: Cells) -> Cells:
    """(4 m, 3) the flat triangles between neighbouring nodes, four of each cell: at its corners 0, 1, 2, then between these."""
    return cells[:, QUARTERS].reshape(-1, 3)
