"""What a solution leaves of its right-hand side, ‖b - K x‖/‖b‖: it is mended once where that is much, and refused where it stays.

Round-off leaves eps times the condition number, at most 3e-7 in the shipped scenes, next to the largest load of an air beam. To
know it costs 4 % of an iteration there, so that it is asked only of factors whose pivots do not rule it out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taichi_membrane.arrays import Floats

# What equilibria are balanced to and derivatives are asked for: a solution that leaves less is as good as any.
GOOD = 1e-6
# Newton would have to do a tenth again and again; the eigenvalues behind it are within ten round-offs of zero.
USELESS = 0.1
# A definite matrix leaves at most so much more than eps · rows/(smallest pivot's share of its diagonal entry); eight shipped scenes
# come to 2e-3 … 2.4 times that.
_MARGIN = 10.0
SINGULAR = "the tangent is singular to round-off"


def refined(
    solve: Callable[[Floats], Floats], times: Callable[[Floats], Floats], right: Floats, within: float
) -> Floats:
    """x with K x = ``right`` by ``solve``, refined once where it leaves more than :data:`GOOD`; not a number where more than
    ``within`` is left then.

    :param times: K times a vector.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.linalg.norm(right))
        solution = solve(right)
        left = right - times(solution)
        if float(np.linalg.norm(left)) <= GOOD * size:
            return solution
        better = solution + solve(left)
        before, after = (float(np.linalg.norm(right - times(x))) for x in (solution, better))
        if not min(before, after) <= within * size:  # not a number, too
            return np.full_like(solution, np.nan)
        return better if after < before else solution


def sure(share: float, rows: int) -> bool:
    """Whether solutions are good by the smallest pivot's share of its diagonal entry."""
    return share * GOOD >= _MARGIN * float(np.finfo(float).eps) * rows
