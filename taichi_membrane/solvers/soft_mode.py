"""The mode of lowest curvature: how it is found, and how large it is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System


def softest(
    factor: Factor, bound: Floats, shift: float, iterations: int, *, start: Floats | None, free: NDArray[np.bool_]
) -> tuple[Floats, float]:
    """The mode by inverse iteration, and its curvature in units of the shift.

    :param factor: the tangent with ``shift`` times ``bound``, factorised.
    :param start: where the iteration begins; None for a fixed start, so that runs repeat bit by bit.
    """
    mode = start if start is not None else np.where(free, np.random.default_rng(0).standard_normal(free.shape), 0.0)
    value = 0.0
    for _ in range(iterations):
        right = bound * mode
        mode = factor.substituted(right)  # the nearer to singular the better
        length = float(np.vdot(mode, bound * mode))
        value = float(np.vdot(mode, right)) / length - shift
        mode /= np.sqrt(length)
    return mode, value


def scaled(system: System, mode: Floats) -> Floats:
    """(node_count, 3) a mode, its largest component as large as sides and cables are where the mode moves.

    Sides are averaged with the mode's square: one needle somewhere else counts as little as it moves.
    """
    structure, moves = system.structure, (system.from_frames(mode) ** 2).sum(axis=1)
    sides = system.geometry.side_length.mean(axis=1)
    share = structure.by_sample(moves[structure.mesh.triangles].sum(axis=1))
    nodes, lengths = structure.cable_sides
    sides, share = np.concatenate([sides, lengths]), np.concatenate([share, moves[nodes].sum(axis=1)])
    length = float(share @ sides) / float(share.sum())
    return np.asarray(mode / np.abs(mode).max() * length)
