"""Rings of nodes about an axis and the triangle strips between them.

A ring of n nodes starts at angle 0 (phase 0) or half a pitch further (phase 1). Both kinds map to themselves under
reversal of the angle, so every shape made of them has a plane of symmetry through angle 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Ring:
    """``count`` nodes evenly around the axis; one node stands for a pole. ``phase`` is in half pitches, 0 or 1."""

    count: int
    phase: int = 0


def ring_directions(ring: Ring) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return cosine and sine of the angles of a ring's nodes, bit-equal up to sign at mirrored nodes."""
    n = ring.count
    half_pitches = 2 * np.arange(n) + ring.phase
    turned = np.minimum(half_pitches, 2 * n - half_pitches)  # angle folded into half a turn
    folded = np.minimum(turned, n - turned)  # and into a quarter
    cosine = np.where(2 * folded == n, 0.0, np.cos(np.pi * folded / n)) * np.where(2 * turned > n, -1.0, 1.0)
    sine = np.sin(np.pi * folded / n) * np.where(half_pitches > n, -1.0, 1.0)
    return cosine, sine


def zip_rings(lower: Ring, upper: Ring) -> NDArray[np.int64]:
    """Triangulate the band between two rings of any node counts.

    Every side of a ring gets one triangle, with the node of the other ring that is nearest in angle to the side's
    middle. Nodes of the lower ring have numbers from 0, those of the upper ring follow. Seen from where the angle grows
    to the right and the upper ring is above, the triangles run counter-clockwise.

    :return: (lower.count + upper.count, 3) node numbers; a pole takes part with one side less.
    """
    n, m = lower.count, upper.count
    i, j = np.arange(n), np.arange(m)
    # Angles of the sides' middles in whole numbers, so that ties are seen exactly. A tie is one quadrilateral with two
    # equal diagonals: it is broken one way on one half of the turn and the other way on the other, as a mirror does.
    low_middle = 2 * m * (2 * i + 1 + lower.phase)
    low_middle += np.where(low_middle < 2 * n * m, -1, 1)
    high_middle = 2 * n * (2 * j + 1 + upper.phase)
    low_apex = n + np.searchsorted(high_middle, low_middle) % m
    high_apex = np.searchsorted(low_middle, high_middle) % n
    low = np.column_stack((i, (i + 1) % n, low_apex))
    high = np.column_stack((n + (j + 1) % m, n + j, high_apex))
    return np.concatenate([part for part, count in ((low, n), (high, m)) if count > 1])


def zip_stack(rings: Sequence[Ring]) -> NDArray[np.int64]:
    """Triangulate the bands between successive rings, numbered one ring after the other from 0."""
    bands: list[NDArray[np.int64]] = []
    first = 0
    for lower, upper in itertools.pairwise(rings):
        bands.append(zip_rings(lower, upper) + first)
        first += lower.count
    return np.concatenate(bands) if bands else np.empty((0, 3), dtype=np.int64)


def wall_triangles(*, around: int, along: int, pattern: str, first_phase: int) -> NDArray[np.int64]:
    """Triangulate ``along`` bands between rings of ``around`` nodes each, band after band.

    ``staggered`` turns every ring half a pitch against the one before, beginning with ``first_phase``; ``diagonal``
    keeps straight generators and one diagonal direction, ``alternating`` turns that from one square to the next.
    """
    j = np.arange(around)
    if pattern == "staggered":
        templates = [zip_rings(Ring(around, p), Ring(around, 1 - p)) for p in (first_phase, 1 - first_phase)]
    else:
        right = (j + 1) % around
        below = np.column_stack((j, right, around + right))
        above = np.column_stack((j, around + right, around + j))
        templates = [np.concatenate((below, above))] * 2
        if pattern == "alternating":
            below_2 = np.column_stack((j, right, around + j))
            above_2 = np.column_stack((right, around + right, around + j))
            odd = (j % 2 == 1)[:, None]
            templates = [
                np.concatenate((np.where(turned, below_2, below), np.where(turned, above_2, above)))
                for turned in (odd, ~odd)
            ]
    band = np.arange(along)
    return np.stack(templates)[band % 2].reshape(-1, 3) + np.repeat(band * around, 2 * around)[:, None]
