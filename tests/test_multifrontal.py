"""The direct solver against dense linear algebra: solutions, inertia, refusals, and what the order of elimination promises."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import lapack

from taichi_membrane import shapes
from taichi_membrane.algebra import elimination as elimination_module
from taichi_membrane.algebra import multifrontal
from taichi_membrane.algebra.elimination import Elimination, eliminate
from taichi_membrane.algebra.multifrontal import Multifrontal
from taichi_membrane.mesh import Mesh


def random_system(mesh: Mesh, seed: int) -> tuple[Elimination, np.ndarray, np.ndarray]:
    """A symmetric matrix of random 3×3 blocks on a mesh's graph: symbolic factorisation, blocks, and the dense matrix."""
    rng = np.random.default_rng(seed)
    elimination = eliminate(mesh.points, mesh.edges())
    blocks = np.empty((elimination.block_count, 3, 3))
    diagonal = rng.normal(size=(mesh.node_count, 3, 3))
    blocks[elimination.node_block] = diagonal + diagonal.transpose(0, 2, 1)
    blocks[elimination.edge_block] = rng.normal(size=(len(elimination.edge_node), 3, 3))
    full = np.zeros((mesh.node_count, 3, mesh.node_count, 3))
    nodes = np.arange(mesh.node_count)
    full[nodes, :, nodes, :] = blocks[elimination.node_block]
    column, row = elimination.edge_node.T
    full[row, :, column, :] = blocks[elimination.edge_block]
    full[column, :, row, :] = blocks[elimination.edge_block].transpose(0, 2, 1)
    return elimination, blocks, full.reshape(3 * mesh.node_count, -1)


def two_bodies() -> Mesh:
    """Two spheres that do not touch, numbered alternately."""
    one = shapes.sphere(radius=1.0, divisions=2)
    points = np.concatenate([one.points, one.points + np.array([5.0, 0.0, 0.0])])
    shuffled = np.random.default_rng(3).permutation(len(points))
    place = np.argsort(shuffled)
    return Mesh.build(points[shuffled], place[np.concatenate([one.triangles, one.triangles + one.node_count])])


MESHES = {
    "tube": shapes.tube(radius=1.0, length=6.0, around=14, along=18),
    "disc": shapes.disc(radius=1.0, rings=9),
    "one triangle": Mesh.build(np.eye(3), [[0, 1, 2]]),
    "two bodies": two_bodies(),
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("definite", [True, False])
def test_solutions_and_inertia_are_those_of_dense_algebra(name: str, definite: bool) -> None:
    """Random blocks are indefinite; a large enough diagonal makes them definite. Seeds 0 to 2."""
    mesh = MESHES[name]
    for seed in range(3):
        elimination, blocks, full = random_system(mesh, seed)
        eigenvalues = np.linalg.eigvalsh(full)
        shift = np.full((mesh.node_count, 3), 1.0 - eigenvalues[0] if definite else 0.3)
        factor = Multifrontal(elimination).factorise(blocks, shift, indefinite=not definite)
        assert factor is not None
        shifted = eigenvalues + shift[0, 0]
        assert factor.negative == (shifted < 0.0).sum()
        assert (factor.negative == 0) == definite
        right = np.random.default_rng(seed).normal(size=(mesh.node_count, 3))
        exact = np.linalg.solve(full + np.diag(shift.ravel()), right.ravel()).reshape(-1, 3)
        # Pivoting stays within fronts, so an indefinite factor may lose a few digits more than LAPACK's.
        assert np.abs(factor.solve(right) - exact).max() < (1e-12 if definite else 1e-8) * np.abs(exact).max()


def test_what_is_not_definite_is_refused() -> None:
    """By a hair, and where a row is empty."""
    mesh = MESHES["disc"]
    elimination, blocks, full = random_system(mesh, 0)
    lowest = np.linalg.eigvalsh(full)[0]
    for above, accepted in ((1e-6, True), (-1e-6, False)):
        shift = np.full((mesh.node_count, 3), above - lowest)
        assert (Multifrontal(elimination).factorise(blocks, shift) is not None) == accepted
    flat = blocks * 0.0
    flat[elimination.node_block] = np.diag([1.0, 1.0, 0.0])  # nothing resists motion along z
    assert Multifrontal(elimination).factorise(flat) is None
    assert Multifrontal(elimination).factorise(flat, indefinite=True) is None


def test_a_pivot_of_round_off_is_singular() -> None:
    """A free triangle chain: each front's last pivot is what cancellation leaves, not a stiffness."""
    mesh = MESHES["tube"]
    elimination = eliminate(mesh.points, mesh.edges())
    blocks = np.zeros((elimination.block_count, 3, 3))
    blocks[elimination.edge_block] = -np.eye(3)
    degree = np.bincount(mesh.edges().ravel(), minlength=mesh.node_count)
    blocks[elimination.node_block] = degree[:, None, None] * np.eye(
        3
    )  # the graph's Laplacian: constants have no stiffness
    assert Multifrontal(elimination).factorise(blocks) is None
    assert Multifrontal(elimination).factorise(blocks, np.full((mesh.node_count, 3), 1e-9)) is not None


def test_a_positive_pivot_of_round_off_is_singular_too() -> None:
    """A triangle of three springs of random stiffness, free to move: what is left of the last pivot has either sign."""
    mesh = MESHES["one triangle"]
    elimination = eliminate(mesh.points, mesh.edges())
    edges, positive = mesh.edges(), 0
    for seed in range(30):
        stiffness = np.random.default_rng(seed).uniform(0.5, 1.5, size=3)
        blocks = np.zeros((elimination.block_count, 3, 3))
        blocks[elimination.edge_block] = -stiffness[:, None, None] * np.eye(3)
        diagonal = np.bincount(edges.ravel(), np.repeat(stiffness, 2))
        blocks[elimination.node_block] = diagonal[:, None, None] * np.eye(3)
        assert Multifrontal(elimination).factorise(blocks) is None
        full = np.diag(diagonal)
        full[edges[:, 0], edges[:, 1]] = full[edges[:, 1], edges[:, 0]] = -stiffness
        order = elimination.dissection.order
        _, failed = lapack.dpotrf(full[np.ix_(order, order)], lower=1)
        positive += failed == 0
    assert positive > 0  # LAPACK alone lets some pass


@pytest.mark.parametrize("name", ["tube", "disc"])
def test_threads_change_no_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups of a few fronts each on three threads, every call without Python's lock; and a refusal leaves memory for the next."""
    mesh = MESHES[name]
    _, blocks, full = random_system(mesh, 0)
    lowest = np.linalg.eigvalsh(full)[0]
    right = np.random.default_rng(1).normal(size=(mesh.node_count, 3))
    monkeypatch.setattr(elimination_module, "_SMALLEST_GROUP", 0.0)
    monkeypatch.setattr(multifrontal, "_WORTH_SHARING", 0.0)
    monkeypatch.setattr(multifrontal, "_LARGE_PANEL", 0)
    elimination = eliminate(mesh.points, mesh.edges())
    assert len(elimination.groups) > 4
    one, three = (Multifrontal(elimination, threads) for threads in (1, 3))
    for above in (1.0, 0.5, 1e-3):
        shift = np.full((mesh.node_count, 3), above - lowest)
        factors = [solver.factorise(blocks, shift) for solver in (one, three)]
        expected, found = (factor.solve(right) for factor in factors if factor is not None)
        assert np.array_equal(expected, found)
        assert three.factorise(blocks, np.full((mesh.node_count, 3), -above - lowest)) is None
    # Memory comes back, after a refusal too: later factorisations of one thread need no array that the first did not.
    known = set(map(id, one.memory._spare))
    assert one.factorise(blocks, shift) is not None
    assert one.factorise(blocks, -shift) is None
    assert set(map(id, one.memory._spare)) == known
    assert len(three.memory._spare) <= len(elimination.groups)


@pytest.mark.parametrize("name", MESHES)
def test_fronts_partition_the_nodes_and_children_come_first(name: str) -> None:
    """Every node is eliminated once; what a front touches belongs to it or to its ancestors."""
    elimination = eliminate(MESHES[name].points, MESHES[name].edges())
    dissection = elimination.dissection
    assert sorted(dissection.order) == list(range(MESHES[name].node_count))
    front_of = np.repeat(np.arange(len(dissection.parent)), np.diff(dissection.start))
    for number, (a, b) in enumerate(pairwise(elimination.border_start)):
        ancestors, at = set(), dissection.parent[number]
        while at >= 0:
            assert at > number
            ancestors.add(at)
            at = dissection.parent[at]
        assert set(front_of[elimination.border[a:b]]) <= ancestors


def test_the_factor_grows_as_n_log_n() -> None:
    """Nested dissection of a surface: each quadrupling of the nodes adds the same number of entries per node."""
    per_node = []
    for divisions in (40, 80, 160):
        mesh = shapes.panel(width=1.0, height=1.0, along_x=divisions, along_y=divisions)
        per_node.append(eliminate(mesh.points, mesh.edges()).factor_entries() / mesh.node_count)
    first, second = np.diff(per_node)
    assert 0.0 < second < 1.2 * first


def truss(mesh: Mesh, shift: float, turned: list[int]) -> tuple[Elimination, np.ndarray]:
    """Springs of random stiffness along the edges, held by nothing but ``shift``; those in ``turned`` push instead of pulling."""
    elimination = eliminate(mesh.points, mesh.edges())
    column, row = elimination.edge_node.T
    along = mesh.points[column] - mesh.points[row]
    along /= np.linalg.norm(along, axis=1)[:, None]
    stiffness = np.random.default_rng(0).uniform(0.1, 10.0, len(along))
    stiffness[turned] *= -0.3
    springs = stiffness[:, None, None] * along[:, :, None] * along[:, None, :]
    diagonal = np.tile(shift * np.eye(3), (mesh.node_count, 1, 1))
    np.add.at(diagonal, column, springs)
    np.add.at(diagonal, row, springs)
    blocks = np.empty((elimination.block_count, 3, 3))
    blocks[elimination.edge_block], blocks[elimination.node_block] = -springs, diagonal
    return elimination, blocks


@pytest.mark.parametrize("name", ["tube", "disc", "two bodies"])
def test_an_indefinite_matrix_that_is_singular_to_round_off_is_refused(name: str) -> None:
    """Rigid motions have no stiffness: a count of negative eigenvalues there is one of round-off, and it was taken for a result.

    Held by a millionth of its stiffness in place of nothing, the same truss is factorised, counted and solved.
    """
    for shift in (0.0, 1e-17, 1e-15):
        elimination, blocks = truss(MESHES[name], shift, [0, 5, 9])
        assert Multifrontal(elimination).factorise(blocks, indefinite=True) is None, shift
    elimination, blocks = truss(MESHES[name], 1e-6, [0, 5, 9])
    factor = Multifrontal(elimination).factorise(blocks, indefinite=True)
    assert factor is not None
    identity = np.eye(3 * MESHES[name].node_count).reshape(-1, MESHES[name].node_count, 3)
    full = np.array([factor.times(column).ravel() for column in identity])
    assert factor.negative == (np.linalg.eigvalsh(full) < 0.0).sum() > 0
    right = np.random.default_rng(1).standard_normal((MESHES[name].node_count, 3))
    solution = factor.solve(right)
    assert factor.residual(solution, right) < 1e-14
    assert factor.residual(1.001 * solution, right) > 1e-12  # not of the size of the matrix alone
    blocks[:] = 0.0  # the factor keeps what it is of
    assert factor.residual(solution, right) < 1e-14
