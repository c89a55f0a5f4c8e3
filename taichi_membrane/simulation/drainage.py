"""Whether water runs off a surface: its least slope, and how deep water would stand in its hollows."""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh, quadratic
from taichi_membrane.mesh.topology import edge_table
from taichi_membrane.scene import DrainageProbe


def check_rim(mesh: Mesh, elements: Ints, key: str) -> None:
    """Refuse a surface that water cannot leave.

    :raises InputError: the elements have no edge where they end.
    """
    if not (edge_table(_facets(mesh, elements), mesh.node_count).tri_count == 1).any():
        raise InputError(f"{key}: the elements have no edge where they end, and water runs off; name those of a roof")


def drainage(probe: DrainageProbe, mesh: Mesh, elements: Ints, displacement: Floats) -> float:
    """The least slope [degrees] of some elements, or the largest depth of water that stands on them."""
    up = np.array(probe.up) / np.linalg.norm(probe.up)
    points, facets = mesh.points + displacement, _facets(mesh, elements)
    return _least_slope(points, facets, up) if probe.of == "slope" else float(standing(points @ up, facets).max())


def standing(height: Floats, facets: NDArray[np.int32]) -> Floats:
    """(n,) depth of the water that stands over each node after any amount of rain; 0 off the facets.

    Its level is the lowest that the highest point of a way to an edge where the facets end can have: on flat facets such ways lead
    along edges. Nodes are reached from those edges, the lowest level first (Barnes, Lehman and Mulla, Computers & Geosciences 62,
    2014).
    """
    edges = edge_table(facets, len(height))
    neighbours: dict[int, list[int]] = {}
    for first, second in edges.nodes.tolist():
        neighbours.setdefault(first, []).append(second)
        neighbours.setdefault(second, []).append(first)
    level = np.full(len(height), np.inf)
    rim = np.unique(edges.nodes[edges.tri_count == 1])
    level[rim] = height[rim]
    waiting = [(float(level[node]), node) for node in rim.tolist()]
    heapify(waiting)
    while waiting:
        reached, node = heappop(waiting)
        for other in neighbours[node]:
            if np.isinf(level[other]):
                level[other] = max(reached, height[other])
                heappush(waiting, (float(level[other]), other))
    return np.where(np.isinf(level), 0.0, level - height)


def _least_slope(points: Floats, facets: Ints, up: Floats) -> float:
    """Of facets against the horizontal, in degrees; facets without area have none."""
    a, b, c = (points[facets[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    across = np.linalg.norm(np.cross(normal, up), axis=1)
    return float(np.rad2deg(np.arctan2(across, np.abs(normal @ up))[across + np.abs(normal @ up) > 0.0].min()))


def _facets(mesh: Mesh, elements: Ints) -> NDArray[np.int32]:
    """(k, 3) flat triangles of elements: of six-node ones four each."""
    chosen = mesh.cells[elements]
    return (chosen if mesh.order == 1 else quadratic.quarters(chosen)).astype(np.int32)
