"""Whether walls have passed through each other: by sides of elements that cross elements, and by nodes that have crossed them."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.mechanics.wall_search import SAME, Walls, closest


def _near(at: Floats, reach: Floats, middle: Floats, radius: Floats) -> tuple[Ints, Ints]:
    """Numbers of balls about ``middle`` and of others about ``at`` that may meet."""
    lists: Any = scipy.spatial.cKDTree(at).query_ball_point(middle, radius + float(reach.max()), return_sorted=True)
    number = np.repeat(np.arange(len(middle)), [len(one) for one in lists])
    other = np.concatenate([np.zeros(0), *lists]).astype(np.int64)
    meet = np.linalg.norm(middle[number] - at[other], axis=1) <= radius[number] + reach[other]
    return number[meet], other[meet]


def _balls(corners: Floats) -> tuple[Floats, Floats]:
    """Middles and radii of triangles (m, 3, 3)."""
    middle = corners.mean(axis=1)
    return middle, np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)


def _heights(points: Floats, corners: Floats) -> Floats:
    """(k,) distance of points from the planes of triangles, with its sign."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-300)
    return np.asarray(np.einsum("ij,ij->i", points - corners[:, 0], normal))


def crossings(walls: Walls, places: Floats) -> tuple[int, float]:
    """How many sides of elements pass through other elements, and how far their shorter ends reach at most, in their lengths."""
    corners, none = walls.corners, 2.0 * SAME * walls.size
    every = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = np.unique(np.sort(every, axis=1), axis=0)
    length = np.linalg.norm(places[edges[:, 1]] - places[edges[:, 0]], axis=1)
    edge, tri = _near(*_balls(places[corners]), places[edges].mean(axis=1), 0.5 * length)
    apart = (edges[edge][:, :, None] != corners[tri][:, None, :]).all(axis=(1, 2))
    edge, tri = edge[apart], tri[apart]
    first, second = (_heights(places[edges[edge, k]], places[corners[tri]]) for k in range(2))
    depth = np.minimum(np.abs(first), np.abs(second))
    through = (first * second < 0.0) & (depth > none)
    edge, tri = edge[through], tri[through]
    first, second, depth = first[through], second[through], depth[through]
    part = (first / (first - second))[:, None]
    hit = (1.0 - part) * places[edges[edge, 0]] + part * places[edges[edge, 1]]
    inside = closest(hit, places[corners[tri]])[1] <= none
    return int(inside.sum()), float((depth / length[edge])[inside].max(initial=0.0))


def passed(walls: Walls, before: Floats, after: Floats) -> Ints:
    """Nodes that have gone through an element on the straight way of all from ``before`` to ``after``, (node_count, 3)."""
    nodes, none = walls.nodes, 2.0 * SAME * walls.size
    middle, moved = 0.5 * (before + after), after - before
    at, radius = _balls(middle[walls.corners])
    radius = radius + 0.5 * np.linalg.norm(moved[walls.corners], axis=2).max(axis=1)
    number, tri = _near(at, radius, middle[nodes], 0.5 * np.linalg.norm(moved[nodes], axis=1))
    node = nodes[number]
    others = ~walls.is_own(node, tri)
    node, tri = node[others], tri[others]
    corner = walls.corners[tri]
    first, second = _heights(before[node], before[corner]), _heights(after[node], after[corner])
    through = (first * second < 0.0) & (np.minimum(np.abs(first), np.abs(second)) > none)
    node, corner, first, second = node[through], corner[through], first[through], second[through]
    then = first / (first - second)
    place = before[node] + then[:, None] * moved[node]
    there = before[corner] + then[:, None, None] * moved[corner]
    # Heights are not linear in the way: what turns is met a little earlier or later.
    near = closest(place, there)[1] <= none + np.abs(_heights(place, there))
    return np.unique(node[near])
