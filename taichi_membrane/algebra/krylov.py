"""GMRES without restart, for few unknowns and dear products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from taichi_membrane.arrays import Floats

# A new direction this small beside the right-hand side is round-off: the space holds the solution.
_EXHAUSTED = 1e-15


@dataclass(frozen=True, eq=False)
class Found:
    """What GMRES came to.

    :param left: ‖b - A x‖/‖b‖ of the ``solution``, by the products' own account.
    :param products: how many it took.
    :param enough: whether ``left`` is what was asked for, or the space was exhausted; else the products were used up.
    """

    solution: Floats
    left: float
    products: int
    enough: bool


def gmres(product: Callable[[Floats], Floats], right: Floats, *, tolerance: float, most: int) -> Found:
    """Solution of A x = ``right`` with a residual of ``tolerance`` times it, or the best after ``most`` products.

    Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7 (1986).
    """
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return Found(right, 0.0, 0, True)
    basis = np.zeros((8, len(right)))  # grows
    basis[0] = right / size
    turns: list[tuple[float, float]] = []
    triangle, aim = np.zeros((0, 0)), [size]  # of R x = aim, as Givens' turns leave it
    left, enough = size, False
    for k in range(1, min(most, len(right)) + 1):
        vector, column = product(basis[k - 1]), np.zeros(k + 1)
        for _ in range(2):  # once leaves round-off, twice is enough
            parts = basis[:k] @ vector
            column[:k] += parts
            vector = vector - parts @ basis[:k]
        column[k] = last = float(np.linalg.norm(vector))
        for j, (cosine, sine) in enumerate(turns):
            column[j], column[j + 1] = (
                cosine * column[j] + sine * column[j + 1],
                cosine * column[j + 1] - sine * column[j],
            )
        length = float(np.hypot(column[k - 1], column[k]))
        turns.append((column[k - 1] / length, column[k] / length) if length else (0.0, 1.0))
        column[k - 1] = length or 1.0  # of a direction that the product takes to nothing new none is taken
        triangle = np.pad(triangle, ((0, 1), (0, 1)))
        triangle[:, k - 1] = column[:k]
        aim[-1:] = [turns[-1][0] * aim[-1], -turns[-1][1] * aim[-1]]
        left = abs(aim[k])
        enough = left <= tolerance * size or last <= _EXHAUSTED * size or k == len(right)
        if enough:
            break
        if k == len(basis):
            basis = np.concatenate([basis, np.zeros_like(basis)])
        basis[k] = vector / last
    share = solve_triangular(triangle, aim[:-1])
    return Found(share @ basis[: len(share)], left / size, len(share), enough)
