"""What is computed once, in NumPy and double precision, before anything is uploaded: geometry matrices, fabric constants,
gather lists."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.quadratic import RULES, node_areas, tangents
from taichi_membrane.names import SideStrain, WrinklingLaw


@dataclass(frozen=True, kw_only=True)
class FabricConstants:
    """An orthotropic fabric: moduli in force per area, thickness in length.

    ``poisson`` is the contraction in weft per extension in warp; ``prestress`` (warp, weft, shear) acts at zero strain.
    """

    e_warp: float
    e_weft: float
    poisson: float
    shear: float
    thickness: float
    law: WrinklingLaw = "tension_field"
    side_strain: SideStrain = "engineering"
    prestress: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def isotropic(self) -> bool:
        """True when the constants are those of an isotropic sheet, up to round-off in G = E/(2(1+ν))."""
        isotropic_shear = self.e_warp / (2 * (1 + self.poisson))
        return self.e_warp == self.e_weft and abs(self.shear - isotropic_shear) <= 1e-12 * isotropic_shear

    def compliance(self) -> Floats:
        """(3, 3) compliance in fabric axes, ε = S σ with the engineering shear strain."""
        cross = -self.poisson / self.e_warp
        return np.array([[1 / self.e_warp, cross, 0], [cross, 1 / self.e_weft, 0], [0, 0, 1 / self.shear]])

    def stiffness(self) -> Floats:
        """(3, 3) plane-stress stiffness in fabric axes (eq. 8 of the seed paper)."""
        divisor = 1 - self.poisson**2 * self.e_weft / self.e_warp
        cross = self.poisson * self.e_weft
        return np.array([[self.e_warp, cross, 0], [cross, self.e_weft, 0], [0, 0, divisor * self.shear]]) / divisor

    def record(self) -> dict[str, float]:
        """Entries of the Taichi record of :func:`taichi_membrane.mechanics.fabric.fabric_record`."""
        c, s = self.stiffness(), self.compliance()
        root_warp, root_weft = float(np.sqrt(self.e_warp)), float(np.sqrt(self.e_weft))
        kappa = 0.5 * (1 / self.shear - 2 * self.poisson / self.e_warp) * root_warp * root_weft
        return {
            "c11": c[0, 0], "c12": c[0, 1], "c22": c[1, 1], "c33": c[2, 2],
            "root_warp": root_warp, "root_weft": root_weft, "root_shear": float(np.sqrt(root_warp * root_weft)),
            "eta": 0.0 if self.isotropic else 0.5 * (kappa - 1),
            "compliance_warp": s[0, 0], "compliance_cross": s[0, 1], "compliance_weft": s[1, 1],
            "compliance_shear": s[2, 2],
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Cables:
    """Straight two-node elements, each with T = T₀ + EA (l - L)/L.

    :param nodes: (n, 2) node numbers.
    :param length: (n,) unstressed lengths L, which need not be the distances of the nodes at rest.
    :param stiffness: (n,) EA [force].
    :param prestress: (n,) T₀, the force at the unstressed length.
    :param bar: (n,) True where compression is borne; elsewhere T is zero where it would be negative.
    """

    nodes: Ints
    length: Floats
    stiffness: Floats
    prestress: Floats
    bar: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Ropes:
    """Cables that slide over their inner nodes, each with one force T = T₀ + EA (l - L)/L, or none where that is negative.

    :param chain: node numbers of all of them, one after another; no node comes twice in one of them.
    :param start: (n + 1,) where each begins in ``chain``.
    :param closed: (n,) True where the last node is joined to the first.
    :param length: (n,) whole unstressed lengths L.
    :param stiffness: (n,) EA [force].
    :param prestress: (n,) T₀, the force at the unstressed length.
    """

    chain: Ints
    start: Ints
    closed: NDArray[np.bool_]
    length: Floats
    stiffness: Floats
    prestress: Floats

    @property
    def count(self) -> int:
        """Number of cables."""
        return len(self.length)

    @property
    def side_counts(self) -> Ints:
        """(n,) number of straight pieces of each."""
        return np.diff(self.start) - 1 + self.closed

    @property
    def sides(self) -> Ints:
        """(k, 2) nodes of all straight pieces, cable by cable."""
        found = []
        for nodes, closed in zip(self._nodes(), self.closed, strict=True):
            found.append(np.column_stack([nodes, np.roll(nodes, -1)])[: len(nodes) if closed else -1])
        return np.concatenate(found)

    @property
    def pairs(self) -> Ints:
        """(k, 2) every two nodes of a cable, which one force couples: rows (0, 1), (0, 2), … (1, 2), … of each."""
        return np.concatenate(
            [np.column_stack([nodes[i] for i in np.triu_indices(len(nodes), 1)]) for nodes in self._nodes()]
        )

    @property
    def pair_start(self) -> Ints:
        """(n + 1,) where the pairs of each begin."""
        many = np.diff(self.start)
        return np.concatenate([[0], np.cumsum(many * (many - 1) // 2)])

    def _nodes(self) -> list[Ints]:
        return np.split(self.chain, self.start[1:-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Springs:
    """Springs from nodes to the ground, each with the force -k <u·d> on its node along d, u the displacement.

    :param nodes: (n,) node numbers.
    :param stiffness: (n,) k [force/length].
    :param direction: (n, 3) unit vectors d.
    :param kind: (n,) 0 for both ways, 1 where only motion along d is resisted (tension), -1 where only that against it is.
    """

    nodes: Ints
    stiffness: Floats
    direction: Floats
    kind: Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanLoads:
    """Loads along one direction on each unit of area seen along it; each has a value that a run sets.

    :param direction: unit vector of the force.
    :param share: (tri_count, n) how much of each load a triangle bears.
    """

    direction: Floats
    share: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Water:
    """A liquid that stands on one side of some triangles.

    :param up: unit vector upwards.
    :param floor: height along it at which its level has the value 0.
    :param weight: (tri_count,) weight per volume where it presses along the normals, less than 0 where against them, else 0.
    """

    mesh: Mesh
    up: Floats
    floor: float
    weight: Floats

    @cached_property
    def tri(self) -> Ints:
        """Numbers of its triangles."""
        return np.flatnonzero(self.weight)

    def level(self, value: float) -> float:
        """Height of its level along ``up``."""
        return self.floor + value


@dataclass(frozen=True, kw_only=True)
class TriangleGeometry:
    """Per point where strain is sampled, one or ``samples`` of each triangle (m then is that many times their number): side lengths
    at rest (m, 3), area (m,), strain matrix G (m, 3, 3) with ε = G δ, unit warp and weft (m, 3)."""

    side_length: Floats
    area: Floats
    strain_matrix: Floats
    warp: Floats
    weft: Floats


def triangle_geometry(
    mesh: Mesh, tri_warp: Floats, *, samples: int = 1, where: str = "fabric.warp"
) -> TriangleGeometry:
    """Geometry of all triangles in their fabric axes, at the points where strain is sampled.

    The inverse of the rows [cos²θ, sin²θ, sinθ cosθ] of eq. 6 in closed form: the strain that has extension in side a alone
    is -(n_b⊗n_c + n_c⊗n_b) L_a δ_a / (8 A²), n the sides turned by a right angle. No matrix is inverted: slivers keep digits.

    :raises InputError: a warp direction that is (nearly) perpendicular to its element, with the element number.
    """
    sides = sample_sides(mesh, mesh.points, samples)
    directed = np.cross(sides[:, 0], sides[:, 1])
    double_area = np.linalg.norm(directed, axis=1)
    normal = directed / double_area[:, None]
    warp = _projected(
        np.repeat(tri_warp, samples, axis=0), normal, np.repeat(np.arange(mesh.tri_count), samples), where
    )
    weft = np.cross(normal, warp)
    x, y = np.einsum("iaj,ij->ia", sides, warp), np.einsum("iaj,ij->ia", sides, weft)
    length = np.linalg.norm(sides, axis=2)
    xb, xc, yb, yc = np.roll(x, -1, 1), np.roll(x, -2, 1), np.roll(y, -1, 1), np.roll(y, -2, 1)
    factor = length / double_area[:, None] ** 2
    strain_matrix = np.stack([-yb * yc * factor, -xb * xc * factor, (xb * yc + xc * yb) * factor], axis=1)
    area = 0.5 * double_area
    if mesh.order == 2:
        area = area * np.tile(RULES[samples].weights, mesh.tri_count)
    return TriangleGeometry(side_length=length, area=area, strain_matrix=strain_matrix, warp=warp, weft=weft)


def sample_sides(mesh: Mesh, points: Floats, samples: int) -> Floats:
    """(samples · tri_count, 3, 3) side vectors where strain is sampled, with the nodes at ``points``: side a from corner a+1 to
    corner a+2, of six-node triangles those of the triangle that the tangents at a point span (:mod:`six_node`)."""
    if mesh.order == 1:
        corners = points[mesh.triangles]
        return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    by_xi, by_eta = tangents(points, mesh.cells, RULES[samples])
    return np.stack([by_eta - by_xi, -by_eta, by_xi], axis=2).reshape(-1, 3, 3)


def project_on_elements(directions: Floats, normals: Floats, elements: Ints, where: str) -> Floats:
    """Unit projections of the given elements' directions on their planes; (m, 3) arrays in, (len(elements), 3) out.

    :raises InputError: a direction that is perpendicular to its element to within 1e-6, with the element number.
    """
    return _projected(directions[elements], normals[elements], elements, where)


def _projected(asked: Floats, normal: Floats, elements: Ints, where: str) -> Floats:
    """The same of directions and normals (k, 3) that belong to ``elements`` (k,)."""
    tangent = asked - np.einsum("ij,ij->i", asked, normal)[:, None] * normal
    length = np.linalg.norm(tangent, axis=1)
    bad = np.flatnonzero(length <= 1e-6 * np.linalg.norm(asked, axis=1))
    if bad.size:
        raise InputError(
            f"{where}: the direction {asked[bad[0]].tolist()} is perpendicular to element {elements[bad[0]]} "
            f"(and {bad.size - 1} others), so it has no projection on the fabric there"
        )
    return tangent / length[:, None]


def gather_lists(slots: Ints, node_count: int) -> tuple[Ints, Ints]:
    """Start of each node's list (node_count + 1,) and the list of slots: numbers of the ends of elements at each node, ascending.

    Sums over these lists replace atomic additions, whose order and therefore last bits change from run to run.

    :param slots: node of each slot.
    """
    order = np.argsort(slots, kind="stable").astype(np.int32)
    start = np.zeros(node_count + 1, dtype=np.int32)
    np.cumsum(np.bincount(slots, minlength=node_count), out=start[1:])
    return start, order


def nodal_pressure(mesh: Mesh, tri_pressure: Floats) -> Floats:
    """(node_count, 3) nodal forces of a pressure per triangle on the unstressed shape; a scale for residuals."""
    if mesh.order == 2:
        return sum_to_nodes(mesh, (tri_pressure[:, None, None] * node_areas(mesh.points, mesh.cells)).reshape(-1, 3))
    force = (tri_pressure * mesh.tri_areas())[:, None] * mesh.tri_normals() / 3.0
    return sum_to_nodes(mesh, np.repeat(force, 3, axis=0))


def volume_gradient(points: Floats, triangles: Ints, share: Floats | Ints) -> Floats:
    """(node_count, 3) ∂V/∂x of the volume that triangles enclose: a sixth of (b - a) × (c - a) of each at its three corners.

    :param triangles: (k, 3), or (k, 6) all nodes of six-node ones.
    :param share: how often each triangle's volume counts; -1 where its normal points inwards.
    """
    if triangles.shape[1] == 6:
        areas = (node_areas(points, triangles) * np.asarray(share)[:, None, None]).reshape(-1, 3)
        return np.stack([np.bincount(triangles.ravel(), c, minlength=len(points)) for c in areas.T], axis=1)
    corners = points[triangles]
    vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * (share / 6.0)[:, None]
    columns = [np.bincount(triangles.ravel(), np.repeat(c, 3), minlength=len(points)) for c in vector.T]
    return np.stack(columns, axis=1)


def sum_to_nodes(mesh: Mesh, corner_values: Floats) -> Floats:
    """Sum (3 · tri_count, k) corner values, or (6 · tri_count, k) of all nodes of six-node triangles, giving (node_count, k)."""
    flat = mesh.cells.reshape(-1)
    columns = [np.bincount(flat, weights=column, minlength=mesh.node_count) for column in corner_values.T]
    return np.stack(columns, axis=1)


def sides_of(triangles: Ints) -> Ints:
    """(3 · tri_count, 2) nodes of the triangles' sides, side a from corner a+1 to corner a+2."""
    return np.column_stack([np.roll(triangles, -1, axis=1).ravel(), np.roll(triangles, -2, axis=1).ravel()])


def sides_now(mesh: Mesh, displacement: Floats, tri: Ints) -> Floats:
    """(k, 3, 3) vectors of the sides of some triangles at a displacement; side a from corner a+1 to corner a+2."""
    corners = (mesh.points + displacement)[mesh.triangles[tri]]
    return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)


def pairs_of(cells: Ints) -> Ints:
    """(n, 2) nodes of every two of cells' nodes: of triangles their sides, of six-node ones rows (0, 1), (0, 2), … (1, 2), …"""
    if cells.shape[1] == 3:
        return sides_of(cells)
    return cells[:, np.column_stack(np.triu_indices(6, 1))].reshape(-1, 2)


def edge_keys(pairs: Ints, node_count: int) -> NDArray[np.int64]:
    """A number for each pair of nodes (n, 2), whichever comes first; ascending with the lower node."""
    return pairs.min(axis=1).astype(np.int64) * node_count + pairs.max(axis=1)


def pair_lists(pairs: Ints, edges: Ints, rows: Ints, node_count: int) -> tuple[Ints, Ints]:
    """Start of each edge's list (edge_count + 1,) and the list of pairs: numbers of those on each edge, ascending, or the
    complement where the block of a pair has to be transposed.

    :param pairs: (n, 2) nodes of the rows and of the columns of the block that each pair stores.
    :param edges: (edge_count, 2) sorted, the lower node first; ``rows`` the node of the rows of each edge's block.
    """
    edge = np.searchsorted(edge_keys(edges, node_count), edge_keys(pairs, node_count))
    order = np.argsort(edge, kind="stable").astype(np.int32)
    start = np.zeros(len(edges) + 1, dtype=np.int32)
    np.cumsum(np.bincount(edge, minlength=len(edges)), out=start[1:])
    return start, np.where(pairs[order, 0] == rows[edge[order]], order, ~order).astype(np.int32)
