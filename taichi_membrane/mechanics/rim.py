"""Where follower pressure has no potential: lines at which it ends or jumps, on nodes that can move.

A triangle's exact tangent of p A is not symmetric. Over a surface the skew parts cancel, but for those of edges at which the
pressures of their triangles, each with the sense in which it runs along the edge, add up to q ≠ 0. The tangent then is K = S + Z,
S symmetric (what :mod:`tangent` assembles) and, for virtual displacements v and changes u,

    v·Z u = ½ Σ q ∮ v·(dx × u):   an edge s adds q/12 [s]× ⊗ [[2, 1], [1, 2]] for its two ends; Zᵀ = -Z.

A curved edge of three nodes adds q/2 Σ_c S_abc [x_c]× for each two of them, S_abc = ∫ N_a N_b N_c' along it.

Z vanishes where an edge's ends cannot move, or only in one plane with the edge, as in a plane of symmetry.

Loads per plan area have no potential anywhere; their skew part (:mod:`snow_skew`) is added to Z.

In place of an energy Newton lowers minus the work of all forces along its straight step. Its slope is that of the forces and its
curvature d·S d, as d·Z d = 0: the exact unsymmetric step goes down wherever S is positive definite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from taichi_membrane.algebra.krylov import Found, gmres
from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.algebra.refinement import GOOD, USELESS, refined
from taichi_membrane.mechanics.body import cross_matrices
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mechanics.skew import Blocks, Part, Skew
from taichi_membrane.mechanics.snow_skew import SnowSkew
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.wet import WaterSkew, rim_moves
from taichi_membrane.mesh.quadratic import side_products

__all__ = ["EdgeSkew", "Rim", "Skew", "SkewFactor", "symmetric"]

_SHARES = np.array([[2.0, 1.0], [1.0, 2.0]]) / 12.0  # of the two ends of an edge: ∫ N_a N_b / 2
_CURVED = 0.5 * side_products()  # S/2
# Directions closer than this are one: round-off of frames is 1e-16, a plane of symmetry that is off by more is none.
_IN_PLANE = 1e-9
# Pressures that cancel to this share of the largest one leave a skew part below the tangent's own round-off.
_EQUAL = 1e-14
# Residual of the linear solves, well below what derivatives are asked for; the iterations it may take (23 were seen at most).
# At 1e-9, which saves an eighth of them, the path of a dome in wind was lost at its limit.
_TOLERANCE, _MOST = 1e-11, 400
# Eigenvalues of K near zero that are looked at beyond twice those S has below zero; all of so many freedoms.
_NEIGHBOURS, _DENSE = 4, 30
_FLUTTER = "flutter, which masses and damping decide, is not looked for"


@dataclass(frozen=True, eq=False)
class Rim:
    """Edges of one structure at which pressures may be without a potential.

    :param nodes: (k, 2) their ends, or (k, 3) with the node amid each.
    :param sense: (k, pressure_count) how often the boundary of each chamber, or wind, runs along the edge; q = sense · p.
    :param liquids: numbers of those without a potential.
    """

    structure: Structure
    nodes: Ints
    sense: Floats
    liquids: tuple[int, ...] = ()

    @classmethod
    def of(cls, structure: Structure) -> Rim:
        """All such edges of a structure, for any pressures."""
        nodes, sense = structure.pressure_edges
        loose = _can_turn(structure, nodes)
        liquids = tuple(number for number, one in enumerate(structure.water) if rim_moves(structure, one))
        return cls(structure, nodes[loose], sense[loose], liquids)

    def at(self, values: Floats, displacement: Floats) -> Skew | None:
        """Skew part of the tangent at a state; None where all forces have a potential.

        :param values: of all loads on the surface, as :meth:`.System.pressures` has them.
        """
        found: list[Part | None] = [self._edges(values[: self.structure.pressure_count], displacement)]
        found.append(SnowSkew.at(self.structure, values[self.structure.snow_values], displacement))
        levels = values[self.structure.water_values]
        for number in self.liquids:
            found.append(WaterSkew(self.structure, self.structure.water[number], float(levels[number]), displacement))
        parts = [part for part in found if part is not None]
        return Skew(self.structure, parts, displacement) if parts else None

    def _edges(self, pressures: Floats, displacement: Floats) -> EdgeSkew | None:
        """That of pressures that end or jump at edges."""
        if not len(self.nodes):
            return None
        jump = self.sense @ pressures
        chosen = np.flatnonzero(np.abs(jump) > _EQUAL * np.abs(pressures).max())
        kind = EdgeSkew if self.nodes.shape[1] == 2 else CurvedEdgeSkew
        return kind(self.structure, self.nodes[chosen], jump[chosen], displacement) if len(chosen) else None


def _can_turn(structure: Structure, nodes: Ints) -> Ints:
    """Numbers of the edges whose ends span with their motions more than a plane that holds the edge."""
    if not len(nodes):
        return np.empty(0, dtype=np.int64)
    frames = np.broadcast_to(np.eye(3), (*nodes.shape, 3, 3))
    if structure.node_frame is not None:
        frames = structure.node_frame[nodes]
    ways = (np.where(structure.node_fixed[nodes], 0.0, 1.0)[..., None] * frames).reshape(len(nodes), -1, 3)
    along = structure.points[nodes[:, 1:]] - structure.points[nodes[:, :1]]
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    span = np.linalg.matrix_rank(ways, tol=_IN_PLANE)
    with_edge = np.linalg.matrix_rank(np.concatenate([ways, along], axis=1), tol=_IN_PLANE)
    return np.flatnonzero((span > 1) & ~((span == 2) & (with_edge == 2)))


@dataclass(frozen=True, eq=False)
class EdgeSkew:
    """Skew part of the tangent of pressures that end or jump at edges, at a state.

    :param nodes: (k, 2) edges; ``jump`` (k,) q of each.
    :param base: (node_count, 3) displacements of the state.
    """

    structure: Structure
    nodes: Ints
    jump: Floats
    base: Floats

    @property
    def told(self) -> str:
        """Where it is, in words."""
        points = self.structure.points
        small = 1e-9 * float(np.ptp(points, axis=0).max())  # a coordinate this small is round-off
        ends = [", ".join(f"{0.0 if abs(x) < small else x:.6g}" for x in points[node]) for node in self.nodes[0][:2]]
        return f"{len(self.nodes)} edges, the first from ({ends[0]}) to ({ends[1]})"

    def blocks(self) -> Blocks:
        """q/12 [s]× ⊗ [[2, 1], [1, 2]] of each edge."""
        places = self.structure.points + self.base
        x, y, z = ((places[self.nodes[:, 1]] - places[self.nodes[:, 0]]) * self.jump[:, None]).T
        zero = np.zeros_like(x)
        cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
        pairs = [(a, b) for a in range(2) for b in range(2)]
        return Blocks(
            np.concatenate([self.nodes[:, a] for a, _ in pairs]),
            np.concatenate([self.nodes[:, b] for _, b in pairs]),
            np.concatenate([_SHARES[a, b] * cross for a, b in pairs]),
        )

    def work_beyond(self, displacement: Floats) -> float:
        """What p times the volume swept since rest takes for work and the way from ``base`` straight to a displacement does not do.

        The swept volume is that of the straight way from rest; over the triangle of the two ways the rim encloses the rest:
        Σ q/2 ∫∫ s·(u × du), with the edge s averaged over rest, base and displacement.
        """
        tail, head = self.nodes.T
        step = displacement - self.base
        place = self.structure.points + (self.base + displacement) / 3.0
        edge = place[head] - place[tail]
        total = np.zeros(len(edge))
        for a in range(2):
            for b in range(2):
                turned = np.cross(self.base[self.nodes[:, a]], step[self.nodes[:, b]])
                total += _SHARES[a, b] * np.einsum("ij,ij->i", edge, turned)
        return float(self.jump @ total)


@dataclass(frozen=True, eq=False)
class CurvedEdgeSkew(EdgeSkew):
    """The same of curved edges, (k, 3) with the node amid each."""

    def blocks(self) -> Blocks:
        """q/2 Σ_c S_abc [x_c]× of each edge."""
        places = self.jump[:, None, None] * (self.structure.points + self.base)[self.nodes]
        pairs = [(a, b) for a in range(3) for b in range(3)]
        return Blocks(
            np.concatenate([self.nodes[:, a] for a, _ in pairs]),
            np.concatenate([self.nodes[:, b] for _, b in pairs]),
            np.concatenate([cross_matrices(np.einsum("c,ncd->nd", _CURVED[a, b], places)) for a, b in pairs]),
        )

    def work_beyond(self, displacement: Floats) -> float:
        """As of straight edges."""
        place = (self.structure.points + (self.base + displacement) / 3.0)[self.nodes]
        base, step = self.base[self.nodes], (displacement - self.base)[self.nodes]
        total = np.zeros(len(place))
        for a in range(3):
            for b in range(3):
                edge = np.einsum("c,ncd->nd", _CURVED[a, b], place)
                total += np.einsum("ij,ij->i", edge, np.cross(base[:, a], step[:, b]))
        return float(self.jump @ total)


@dataclass(frozen=True, eq=False)
class SkewFactor:
    """K = S + Z with S factorised: GMRES over the components at the rim alone, each product one solve with S."""

    factor: Factor
    skew: Skew
    _short: list[Found] = field(default_factory=list)  # of the last solution, where GMRES used its products up

    def solve(self, right: Floats, within: float = USELESS) -> Floats:
        """x with K x = ``right``; not a number where more than ``within`` of that is left."""
        return self._proved(self.substituted, self.times, right, within)

    def solve_transposed(self, right: Floats, within: float = USELESS) -> Floats:
        """x with Kᵀ x = ``right``, Kᵀ = S - Z, likewise."""
        turned = partial(self._solve, transposed=True), partial(self.times, transposed=True)
        return self._proved(*turned, right, within)

    def _proved(
        self, solve: Callable[[Floats], Floats], times: Callable[[Floats], Floats], right: Floats, within: float
    ) -> Floats:
        """A solution that is refined; where GMRES used its products up it has to be good all the same."""
        self._short.clear()
        found = refined(solve, times, right, within)
        if self._short and not float(np.linalg.norm(right - times(found))) <= GOOD * float(np.linalg.norm(right)):
            return np.full_like(found, np.nan)
        return found

    @property
    def refusal(self) -> str:
        """Why the last solution was refused."""
        if not self._short:
            return self.factor.refusal
        last = self._short[-1]
        return f"GMRES over the free rim left {last.left:.1e} of its right-hand side after {last.products} products"

    def substituted(self, right: Floats) -> Floats:
        """x with K x = ``right``, as near as GMRES comes."""
        return self._solve(right, transposed=False)

    def times(self, vector: Floats, *, transposed: bool = False) -> Floats:
        """K, or Kᵀ, times a vector (n, 3)."""
        return self.factor.times(vector) + self.skew.times(vector, transposed=transposed)

    def residual(self, solution: Floats, right: Floats) -> float:
        """Backward error of K x = b, over the size of S."""
        return self.factor.residual(solution, right - self.skew.times(solution))

    def _solve(self, right: Floats, *, transposed: bool) -> Floats:
        ends = self.skew.ends

        def product(values: Floats) -> Floats:
            spread = np.zeros_like(right)
            spread[ends] = values.reshape(-1, 3)
            turned = self.factor.substituted(self.skew.times(spread, transposed=transposed))
            return values + turned[ends].ravel()

        at_rim = gmres(product, self.factor.substituted(right)[ends].ravel(), tolerance=_TOLERANCE, most=_MOST)
        if not at_rim.enough:
            self._short.append(at_rim)
        spread = np.zeros_like(right)
        spread[ends] = at_rim.solution.reshape(-1, 3)
        return self.factor.substituted(right - self.skew.times(spread, transposed=transposed))

    @property
    def negative(self) -> int:
        """Negative real eigenvalues of K, as far as they are found.

        None where S has none, as x·K x = x·S x. Else among the eigenvalues nearest zero, through which a structure that becomes
        unstable without swinging has to go; pairs of complex ones, flutter, are not counted.
        """
        return self._near_zero[0]

    @property
    def doubt(self) -> str:
        """What no negative real eigenvalue leaves open: flutter always, and eigenvalues that were not looked at."""
        return f"divergence only: {self._near_zero[1]}; {_FLUTTER}"

    @cached_property
    def _near_zero(self) -> tuple[int, str]:
        """Number of negative real eigenvalues that are found, and what is known where there are none."""
        below = self.factor.negative
        if below == 0:
            return 0, "nothing diverges, as the symmetric part of the tangent is positive definite"
        free = ~self.skew.structure.node_held
        size = int(free.sum())

        def inverse_times(x: Floats) -> Floats:
            right = np.zeros(free.shape)
            right[free] = x.ravel()
            return self.substituted(right)[free]

        wanted = size if size <= _DENSE else min(2 * below + _NEIGHBOURS, size - 2)
        inverse: Any
        if wanted == size:
            inverse = np.linalg.eigvals(np.array([inverse_times(column) for column in np.eye(size)]).T)
        else:
            operator = scipy.sparse.linalg.LinearOperator((size, size), matvec=inverse_times, dtype=np.float64)
            start = np.random.default_rng(0).standard_normal(size)
            try:
                inverse = scipy.sparse.linalg.eigs(operator, k=wanted, which="LM", v0=start, return_eigenvectors=False)
            except scipy.sparse.linalg.ArpackNoConvergence as error:
                inverse = error.eigenvalues
        real = np.abs(inverse.imag) <= _IN_PLANE * np.abs(inverse)
        which = f"of the tangent's {size} eigenvalues" + (f" the {wanted} nearest zero" if wanted < size else "")
        seen = "" if len(inverse) >= wanted else f", of which {len(inverse)} were found"
        return int((real & (inverse.real < 0.0)).sum()), f"{which}{seen}: none is real and negative"


def symmetric(factor: Factor) -> Factor:
    """The factorised symmetric part of a tangent."""
    return factor.factor if isinstance(factor, SkewFactor) else factor
