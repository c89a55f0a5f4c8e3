"""What is done to meshes of verdict cases: seeded scatter, needles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh

Floats = NDArray[np.float64]


def _rebuilt(mesh: Mesh, points: Floats, triangles: NDArray[np.int32], parents: NDArray[np.int64]) -> Mesh:
    """A mesh with other points and triangles, each of which belongs to the groups of its parent."""
    nodes = {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    elements = {
        name: np.flatnonzero(np.isin(parents, members)) for name, members in mesh.tri_groups.items() if name != "all"
    }
    warp = None if mesh.tri_warp is None else mesh.tri_warp[parents]
    return Mesh.build(points, triangles, nodes, elements, warp)


def scattered(mesh: Mesh, share: float, seed: int) -> Mesh:
    """Nodes moved at random by up to a share of the shortest edge along each axis; those in named groups stay."""
    edges = mesh.points[mesh.edges()]
    shortest = float(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).min())
    noise = np.random.default_rng(seed).uniform(-share * shortest, share * shortest, mesh.points.shape)
    noise[~_anonymous(mesh)] = 0.0
    return _rebuilt(mesh, mesh.points + noise, mesh.triangles, np.arange(mesh.tri_count))


def _anonymous(mesh: Mesh) -> NDArray[np.bool_]:
    """Nodes in no group but "all"."""
    free = np.ones(mesh.node_count, dtype=bool)
    for name, members in mesh.node_groups.items():
        if name != "all":
            free[members] = False
    return free


def with_needle(mesh: Mesh, share: float = 1e-3) -> Mesh:
    """One more node, on an edge at a small share of its length: two of its four triangles are needles.

    The edge is one of those whose nodes are in no group, the nearest to the middle of the mesh.
    """
    edges = mesh.edges()
    edges = edges[_anonymous(mesh)[edges].all(axis=1)]
    middle = mesh.points[edges].mean(axis=1) - mesh.points.mean(axis=0)
    first, second = edges[np.linalg.norm(middle, axis=1).argmin()]
    points = np.vstack((mesh.points, (1.0 - share) * mesh.points[first] + share * mesh.points[second]))
    new, triangles, parents = len(mesh.points), mesh.triangles.astype(np.int32), np.arange(mesh.tri_count)
    both = np.flatnonzero(np.isin(mesh.triangles, (first, second)).sum(axis=1) == 2)
    halves = triangles[both]
    triangles = np.vstack((triangles, np.where(halves == first, new, halves)))
    triangles[both] = np.where(halves == second, new, halves)
    return _rebuilt(mesh, points, triangles, np.concatenate((parents, both)))
