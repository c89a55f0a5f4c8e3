"""The tangent of what is free to move in contact: nodes that touch slide along their obstacles, which are rigid.

Second-order work on the constraint surface: the normals of nodes in contact are taken out, contact forces with the curvature of
the obstacles stay in. Its inertia is that of the structure with rigid obstacles, whatever springs the multipliers are found with.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.mechanics.coupled import coupled
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.touching import held_by_contact

if TYPE_CHECKING:
    from taichi_membrane.solvers.newton import Newton


def held_now(newton: Newton, active: NDArray[np.bool_], normals: Floats) -> Floats:
    """(node_count, 3, 3) projections on the freedoms that contact holds; see :func:`.touching.held_by_contact`."""
    return held_by_contact(active, np.stack([newton.system.in_frames(one) for one in normals]), newton.free)


def factor_in_contact(newton: Newton) -> Factor | None:
    """The factorised tangent of the freedoms that contact leaves; None where it is singular, pressures have no potential,
    nodes rub, or walls touch each other."""
    if newton.skew() is not None or newton.system.frictions or newton.system.walls is not None:
        return None
    now, blocks = newton.system.touching(), newton.tangent.assemble()
    held = held_now(newton, now.active, now.normal)
    newton.tangent.hold(held)
    factor = newton.tangent.solver.factorise(blocks, newton.tangent.loose(newton.free), indefinite=True)
    if factor is None or newton.contents is None:
        return factor
    terms = [
        replace(term, gradient=term.gradient - np.einsum("nij,nj->ni", held, term.gradient))
        for term in newton.contents.rank_one()
    ]
    return coupled(factor, terms, newton.free)
