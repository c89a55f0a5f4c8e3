"""The movements of nodes that change a shape of given stress, and the stiffness of the shape against them.

Within a surface of one stress a node's movement along the normal changes it; a node between two elements of one cable of given
force moves along the cable without a change. At free edges, seams of two stresses and nodes of rigid bodies all movements count.

With the stress kept as Cauchy stress σ = n I the energy of an element is n t times its area: in terms of Green's strain E from the
present shape W = n t √det(I + 2 E), whose second derivative at E = 0 is n t (tr² - 2 E:E), in warp, weft and engineering shear
n t [[-1, 1, 0], [1, -1, 0], [0, 0, -1]]. For unequal warp and weft the mean of both stands in, and the iteration is not
quadratic. A cable of given force T has T/l (I - c cᵀ).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.simulation import rest_shape
from taichi_membrane.simulation.model import Model

_AREA = np.array([[-1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
# A movement of which supports leave less than this, squared, is held.
_HELD = 1e-6


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """The movements that change a shape.

    :param basis: (3 · node_count, m) orthonormal columns, nodal freedoms in the supports' axes; ``others`` are all that are free
        beside them.
    """

    model: Model
    basis: scipy.sparse.csr_matrix
    others: scipy.sparse.csr_matrix

    @classmethod
    def of(cls, model: Model) -> ShapeSpace:
        """Those of the shape that a model rests in."""
        structure = model.structure
        part = np.tile(np.eye(3), (structure.node_count, 1, 1))
        inside, normal = _inside(structure)
        part[inside] = np.einsum("ni,nj->nij", normal[inside], normal[inside])
        nodes, tangent = _along_cables(model)
        part[nodes] -= np.einsum("ni,nj->nij", tangent, tangent)
        if structure.node_frame is not None:
            part = structure.node_frame @ part @ structure.node_frame.transpose(0, 2, 1)
        free = ~structure.node_held
        part = part * free[:, :, None] * free[:, None, :]
        values, vectors = np.linalg.eigh(part)
        taken = np.where((values > _HELD)[:, None, :], vectors, 0.0)
        shares, rest = np.linalg.eigh(np.eye(3) * free[:, :, None] - taken @ taken.transpose(0, 2, 1))
        return cls(model, _columns(vectors, values > _HELD), _columns(rest, shares > 0.5))

    def components(self, forces: Floats) -> Floats:
        """(m,) what forces (node_count, 3), in the supports' axes, do along each movement."""
        return np.asarray(self.basis.T @ forces.ravel())

    def stiffness(self, tangent: scipy.sparse.csr_matrix) -> scipy.sparse.csc_matrix:
        """(m, m) the stiffness of the shape, of the tangent of force densities (:func:`.rest_shape.soft`) at rest in it."""
        whole = tangent + _beyond_densities(self.model)
        return scipy.sparse.csc_matrix(self.basis.T @ whole @ self.basis)

    def movement(self, components: Floats, tangent: scipy.sparse.csr_matrix) -> Floats | None:
        """(node_count, 3) the movement of given components; nodes follow in all other ways, by their force densities.

        None where these do not hold them.
        """
        moved = self.basis @ components
        pull = self.others.T @ (tangent @ moved)
        if pull.any():
            followed = answer(scipy.sparse.csc_matrix(self.others.T @ tangent @ self.others), -pull)
            if followed is None:
                return None
            moved = moved + self.others @ followed.components
        return np.asarray(moved).reshape(-1, 3)


def _columns(vectors: Floats, which: NDArray[np.bool_]) -> scipy.sparse.csr_matrix:
    """Matrix of some of the nodes' vectors (node_count, component, number)."""
    node, number = np.nonzero(which)
    rows = (3 * node[:, None] + np.arange(3)).ravel()
    columns = np.repeat(np.arange(len(node)), 3)
    size = (3 * len(vectors), len(node))
    return scipy.sparse.csr_matrix((vectors[node, :, number].ravel(), (rows, columns)), shape=size)


@dataclass(frozen=True)
class Answer:
    """What the stiffness of a shape tells: the movement that balances forces, and its negative eigenvalues (None: not known)."""

    components: Floats
    negative: int | None


def answer(stiffness: scipy.sparse.csc_matrix, forces: Floats) -> Answer | None:
    """Solve for the movement; None where the stiffness is singular."""
    try:
        factor = scipy.sparse.linalg.splu(
            stiffness, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:
        return None
    symmetric = np.array_equal(factor.perm_r, factor.perm_c)  # then its pivots have the signs of the eigenvalues
    components = factor.solve(forces)
    if not np.isfinite(components).all():
        return None
    return Answer(components, int((factor.U.diagonal() < 0.0).sum()) if symmetric else None)


def _beyond_densities(model: Model) -> scipy.sparse.csr_matrix:
    """(3 · node_count, 3 · node_count) what the stiffness of given stress has beyond that of force densities, by supports' axes.

    It has no part of softness: of moduli that are a thousandth of the stress, little.
    """
    structure = model.structure
    geometry, mesh = structure.geometry, structure.mesh
    corners = mesh.points[mesh.triangles]
    side = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    unit = side / geometry.side_length[:, :, None]
    prestress = structure.prestress
    mean = 0.5 * (prestress[:, 0] + prestress[:, 1])
    volume = geometry.area * structure.thickness
    matrix = geometry.strain_matrix
    natural = (volume * mean)[:, None, None] * (matrix.transpose(0, 2, 1) @ _AREA @ matrix)
    engineering = np.array([one.side_strain != "green" for one in structure.fabrics])[structure.tri_fabric]
    forces = volume[:, None] * np.einsum("iba,ib->ia", matrix, prestress)
    for a in range(3):  # the natural force of engineering strain keeps its size along the side, Green's its density
        natural[:, a, a] += np.where(engineering, forces[:, a] / geometry.side_length[:, a], 0.0)
    # ∂δ_a/∂x: minus the side's direction at its first end, corner a+1, plus at its second, corner a+2.
    gradient = np.zeros((mesh.tri_count, 3, 3, 3))  # side, corner, component
    for a in range(3):
        gradient[:, a, (a + 1) % 3] = -unit[:, a]
        gradient[:, a, (a + 2) % 3] = unit[:, a]
    rows = gradient.reshape(mesh.tri_count, 3, 9)
    blocks = rows.transpose(0, 2, 1) @ natural @ rows
    freedom = (3 * mesh.triangles[:, :, None] + np.arange(3)).reshape(mesh.tri_count, 9)
    size = 3 * structure.node_count
    total = _scattered(blocks, freedom, size)
    cables = structure.cables
    forced = rest_shape.with_force(model.scene, mesh)[0]
    by_force = _by_force(model, forced)
    if cables is not None and by_force.any():
        nodes = cables.nodes[by_force]
        along = mesh.points[nodes[:, 1]] - mesh.points[nodes[:, 0]]
        length = np.linalg.norm(along, axis=1)
        row = np.concatenate([-along, along], axis=1) / length[:, None]
        density = cables.prestress[by_force] / length
        pair = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 6)
        total = total - _scattered(density[:, None, None] * row[:, :, None] * row[:, None, :], pair, size)
    freedoms = _freedoms(structure)
    return scipy.sparse.csr_matrix(freedoms.T @ total @ freedoms)


def _freedoms(structure: Structure) -> scipy.sparse.csr_matrix:
    """(3 · node_count, 3 · node_count) displacements of nodes for their freedoms: along supports' axes, and with rigid bodies."""
    count = structure.node_count
    frame = np.tile(np.eye(3), (count, 1, 1)) if structure.node_frame is None else structure.node_frame
    turn = scipy.sparse.csr_matrix(scipy.sparse.block_diag(list(frame.transpose(0, 2, 1))))
    if not structure.bodies:
        return turn
    blocks, rows, columns = [], [], []
    rest = np.flatnonzero(~structure.node_in_body)
    blocks.append(np.tile(np.eye(3), (len(rest), 1, 1)).ravel())
    rows.append(np.repeat(3 * rest[:, None] + np.arange(3), 3, axis=1).ravel())
    columns.append(np.tile(3 * rest[:, None] + np.arange(3), (1, 3)).ravel())
    for body in structure.bodies:
        first, second = body.carriers
        carried = np.concatenate([3 * first + np.arange(3), 3 * second + np.arange(3)])
        blocks.append(body.map_at(np.zeros((count, 3))).ravel())
        rows.append(np.repeat(3 * body.nodes[:, None] + np.arange(3), 6, axis=1).ravel())
        columns.append(np.tile(carried, 3 * len(body.nodes)))
    data = np.concatenate(blocks), (np.concatenate(rows), np.concatenate(columns))
    return scipy.sparse.csr_matrix(turn @ scipy.sparse.csr_matrix(data, shape=(3 * count, 3 * count)))


def _scattered(blocks: Floats, freedom: NDArray[np.int64], size: int) -> scipy.sparse.csr_matrix:
    rows = np.repeat(freedom, freedom.shape[1], axis=1).ravel()
    columns = np.tile(freedom, (1, freedom.shape[1])).ravel()
    return scipy.sparse.csr_matrix((blocks.ravel(), (rows, columns)), shape=(size, size))


def _by_force(model: Model, forced: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which elements of cables that do not slide have a given force (and not a force density)."""
    _, owner = rest_shape.line_elements(model.scene, model.structure.mesh)
    cables = list(model.scene.cables.values())
    given = np.array([one.force is not None for one in cables], dtype=bool)
    return forced & given[owner[: len(forced)]] if len(forced) else forced


def _inside(structure: Structure) -> tuple[NDArray[np.bool_], Floats]:
    """Which nodes lie within a surface of one stress, and the unit normals of all that have some."""
    mesh = structure.mesh
    area = mesh.tri_normals() * mesh.tri_areas()[:, None]
    normal = np.zeros((structure.node_count, 3))
    for corner in range(3):
        np.add.at(normal, mesh.triangles[:, corner], area)
    length = np.linalg.norm(normal, axis=1)
    inside = length > 0.0
    table = mesh.edge_table
    open_edges = np.diff(np.append(table.start, len(table.half_edges))) != 2
    inside[np.unique(table.nodes[open_edges])] = False
    inside[_of_several_stresses(structure)] = False
    inside[np.unique(structure.cable_sides[0])] = False
    inside[structure.node_in_body] = False
    return inside, normal / np.where(length > 0.0, length, 1.0)[:, None]


def _of_several_stresses(structure: Structure) -> NDArray[np.bool_]:
    """Which nodes lie between elements of different stress resultants."""
    kinds = np.array([np.array(one.prestress) * one.thickness for one in structure.fabrics])
    _, kind = np.unique(kinds, axis=0, return_inverse=True)
    of_corner = np.repeat(kind.ravel()[structure.tri_fabric], 3)
    corners = structure.mesh.triangles.ravel()
    low, high = np.full(structure.node_count, len(kinds)), np.full(structure.node_count, -1)
    np.minimum.at(low, corners, of_corner)
    np.maximum.at(high, corners, of_corner)
    return np.asarray(low < high)


def _along_cables(model: Model) -> tuple[NDArray[np.int64], Floats]:
    """Nodes between two elements of one cable of given force, and the direction of the cable there."""
    nodes, owner = rest_shape.line_elements(model.scene, model.structure.mesh)
    points = model.structure.mesh.points
    cables = list(model.scene.cables.values())
    forced = np.array([one.force is not None and not one.sliding for one in cables], dtype=bool)
    if not forced.any():
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    ends = np.concatenate([nodes, nodes[:, ::-1]])
    owners = np.tile(owner, 2)
    order = np.argsort(ends[:, 0], kind="stable")
    ends, owners = ends[order], owners[order]
    node, start, number = np.unique(ends[:, 0], return_index=True, return_counts=True)
    start, node = start[number == 2], node[number == 2]
    same = (owners[start] == owners[start + 1]) & forced[owners[start]] & ~model.structure.node_in_body[node]
    start, node = start[same], node[same]
    one, other = (points[ends[at, 1]] - points[node] for at in (start, start + 1))
    tangent = one / np.linalg.norm(one, axis=1, keepdims=True) - other / np.linalg.norm(other, axis=1, keepdims=True)
    return node.astype(np.int64), tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
