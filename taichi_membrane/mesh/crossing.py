"""Pairs of triangles that pass through each other, found with a spatial index."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

# Share of a product of lengths within which a signed volume is round-off: what touches does not cross.
_TOUCH = 1e-10
_BLOCK = 50_000  # triangles whose neighbours are looked up together


def crossings(points: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.int64]:
    """(n, 2) numbers of triangles that share no node and have an edge of one pass through the inside of the other.

    Sheets that lie on each other in one plane, and what merely touches, are not among them.
    """
    corners = points[triangles]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = [np.empty((0, 2), dtype=np.int64)]
    for pairs in _near(centre, radius):
        one, other = pairs.T
        meet = ((low[one] <= high[other]) & (low[other] <= high[one])).all(axis=1)
        one, other = one[meet], other[meet]
        apart = ~(triangles[one][:, :, None] == triangles[other][:, None, :]).any(axis=(1, 2))
        one, other = one[apart], other[apart]
        hit = _pierces(corners[one], corners[other]) | _pierces(corners[other], corners[one])
        found.append(np.sort(np.column_stack((one[hit], other[hit])), axis=1))
    return np.unique(np.concatenate(found), axis=0)


def _near(centre: NDArray[np.float64], radius: NDArray[np.float64]) -> Iterator[NDArray[np.int64]]:
    """Pairs whose surrounding spheres meet.

    By classes of size, each twice the one below, so that a few large triangles do not make every small one a neighbour of all.
    """
    size = np.floor(np.log2(radius / radius.min())).astype(np.int64)
    trees: list[tuple[NDArray[np.int64], scipy.spatial.cKDTree, float]] = []
    for value in np.unique(size).tolist():
        own = np.flatnonzero(size == value)
        tree = scipy.spatial.cKDTree(centre[own])
        largest = float(radius[own].max())
        for begin in range(0, len(own), _BLOCK):
            part = own[begin : begin + _BLOCK]
            block = scipy.spatial.cKDTree(centre[part])
            for members, other, reach in [*trees, (own, tree, largest)]:
                near = block.sparse_distance_matrix(other, largest + reach, output_type="ndarray")
                pairs = np.column_stack((part[near["i"]], members[near["j"]]))
                yield pairs[pairs[:, 0] < pairs[:, 1]] if members is own else pairs
        trees.append((own, tree, largest))


def _pierces(edges_of: NDArray[np.float64], through: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether an edge of the first triangle of a pair passes through the inside of the second."""
    a, b, c = (through[:, k] for k in range(3))
    hit = np.zeros(len(through), dtype=bool)
    for k in range(3):
        p, q = edges_of[:, k], edges_of[:, (k + 1) % 3]
        scale = np.maximum(np.ptp(through, axis=1).max(axis=1), np.abs(q - p).max(axis=1)) ** 3 * _TOUCH
        before, after = _volume(a, b, c, p), _volume(a, b, c, q)
        sides = np.stack([_volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)])
        inside = (sides > scale).all(axis=0) | (sides < -scale).all(axis=0)
        hit |= inside & (((before > scale) & (after < -scale)) | ((before < -scale) & (after > scale)))
    return hit


def _volume(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.asarray(((d - a) * np.cross(b - a, c - a)).sum(axis=1))
