"""Arc length: following an equilibrium path through limit points, where load control has no next state.

Displacements and the load factor λ are found together, at a given distance Δs along the path (E. Riks, Int. J. Solids Struct.
15, 1979). Corrections stay perpendicular to the step: Δu·δu = 0. The tangent may be indefinite; its negative pivots tell the
stable part of the path from the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.solvers.newton import AnyFactor, Newton

# A step that takes few iterations is followed by a longer one, one that takes many by a shorter one.
_MOST_ITERATIONS, _FEW, _MANY = 14, 4, 9
_LONGER, _SHORTER = 1.5, 0.7
# A step is halved this often before the path counts as lost; a residual that grows so much is not going to come back.
_HALVINGS, _RUNAWAY = 12, 1e3
# Towards a target: the first step as a share of the way, most steps, how closely a limit is bracketed, the step after passing one.
_FIRST_STEP, _MOST_STEPS, _BRACKET, _REFINE = 0.25, 100, 1e-3, 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """An equilibrium on the path.

    :param position: (node_count, 3) displacements.
    :param factor: load factor λ.
    :param tangent: (node_count, 3) du/dλ.
    :param negative: negative pivots of the tangent stiffness: 0 where the equilibrium is stable.
    :param advance: (node_count, 3) the step that led here; zero at the start.
    :param iterations: corrections of that step, those of halved attempts included.
    :param residual: out-of-balance forces over the reference load.
    """

    position: Floats
    factor: float
    tangent: Floats
    negative: int
    advance: Floats
    iterations: int
    residual: float

    def length_for(self, change: float) -> float:
        """Distance along the tangent in which the load factor changes so much."""
        return abs(change) * float(np.linalg.norm(self.tangent))

    def slope(self) -> float:
        """dλ/ds along the direction of travel."""
        length = float(np.linalg.norm(self.tangent))
        return float(np.copysign(1.0 / length, np.vdot(self.tangent, self.advance)))  # at the start: rising


class Path:
    """Follows an equilibrium path in a load factor.

    :param apply: sets pressures and loads of the membrane for a load factor; both depend on it linearly.
    :param reference: 2-norm of the forces applied at a load factor, to which residuals there are compared: a membrane without
        its shape yet moves far under a thousandth of its load, and a path held to the whole load's tolerance is lost there.
    """

    def __init__(
        self, newton: Newton, apply: Callable[[float], None], reference: Callable[[float], float], tolerance: float
    ) -> None:
        self.newton = newton
        self.membrane = newton.membrane
        self.apply, self.reference, self.tolerance = apply, reference, tolerance

    def start(self, position: Floats, factor: float) -> PathPoint | None:
        """The path's first point, an equilibrium already; None where its tangent is singular."""
        return self._point(position, factor, np.zeros_like(position), 0, 0.0)

    def step(self, before: PathPoint, length: float) -> tuple[PathPoint | None, float]:
        """The next point at a distance ``length`` or less, onwards (from the start: with rising load), and the length to try next.

        None where the path is lost.
        """
        onwards = float(np.vdot(before.tangent, before.advance))
        unit = before.tangent / np.linalg.norm(before.tangent) * (-1.0 if onwards < 0.0 else 1.0)
        spent = 0
        for _ in range(_HALVINGS):
            point, iterations = self._correct(before, length * unit)
            spent += iterations
            if point is not None:
                longer = _LONGER if iterations <= _FEW else _SHORTER if iterations >= _MANY else 1.0
                return PathPoint(**{**vars(point), "iterations": spent}), length * longer
            length *= 0.5
        return None, length

    def _correct(self, before: PathPoint, advance: Floats) -> tuple[PathPoint | None, int]:
        """Iterate from the predicted point to equilibrium, perpendicular to the step; None where that fails."""
        slope = float(np.vdot(advance, before.tangent) / np.vdot(before.tangent, before.tangent))
        factor = before.factor + slope
        lowest = np.inf
        for iteration in range(_MOST_ITERATIONS + 1):
            position = before.position + self.membrane.from_frames(advance)
            self.membrane.set_displacement(position)
            self.apply(factor)
            force = self.newton.free_force()
            residual = float(np.linalg.norm(force)) / self.reference(factor)
            if residual <= self.tolerance:
                return self._point(position, factor, advance, iteration, residual), iteration
            lowest = min(lowest, residual)
            if not np.isfinite(residual) or residual > _RUNAWAY * lowest:
                break
            stiffness = self.newton.factorised(indefinite=True)
            if stiffness is None:
                break
            to_balance, tangent = stiffness.solve(force), self.tangent(stiffness, factor)
            change = -float(np.vdot(advance, to_balance) / np.vdot(advance, tangent))
            advance = advance + to_balance + change * tangent
            factor += change
        return None, iteration

    def _point(
        self, position: Floats, factor: float, advance: Floats, iterations: int, residual: float
    ) -> PathPoint | None:
        """An equilibrium with its tangent; None where that is singular."""
        self.membrane.set_displacement(position)
        self.apply(factor)
        stiffness = self.newton.at_rest()
        if stiffness is None:
            return None
        return PathPoint(
            position=position,
            factor=factor,
            tangent=self.tangent(stiffness, factor),
            negative=stiffness.negative,
            advance=advance,
            iterations=iterations,
            residual=residual,
        )

    def tangent(self, stiffness: AnyFactor, factor: float) -> Floats:
        """(node_count, 3) du/dλ at the present equilibrium, from its factorised tangent stiffness."""
        return stiffness.solve(self._unit_force(factor))

    def _unit_force(self, factor: float) -> Floats:
        """(node_count, 3) change of the free forces per load factor at fixed displacements; leaves ``factor`` applied."""
        self.apply(factor + 1.0)
        more = self.newton.free_force()
        self.apply(factor)
        return more - self.newton.free_force()


@dataclass(frozen=True, kw_only=True, eq=False)
class PathEnd:
    """How following a path towards a load factor ended.

    :param reason: ``target``; ``limit`` (the load factor has a maximum below it); ``bifurcation`` (the path loses its stability
        while the load still rises); ``lost`` (no further equilibrium was found).
    :param last: the last stable point below the target.
    :param beyond: the point after it: above the target, or past the limit; None where lost.
    :param upper: an upper bound of the largest stable load factor, where the path is concave between the two; None where there is
        no limit.
    """

    reason: str
    last: PathPoint
    beyond: PathPoint | None
    upper: float | None
    iterations: int


def follow(path: Path, start: PathPoint, target: float, progress: Callable[[PathPoint], None]) -> PathEnd:
    """Follow a path from a stable point, with rising load, to a target load factor or to where it loses its stability.

    A limit is bracketed to :data:`_BRACKET` of the way from the start to the target.
    """
    last, spent = start, 0
    close = _BRACKET * (target - start.factor)
    length = start.length_for(_FIRST_STEP * (target - start.factor))
    for _ in range(_MOST_STEPS):
        point, longer = path.step(last, length)
        if point is None:
            break
        spent += point.iterations
        progress(point)
        if point.negative == 0 and point.factor >= target:
            return PathEnd(reason="target", last=last, beyond=point, upper=None, iterations=spent)
        if point.negative > 0 or point.factor <= last.factor:
            falling = point.slope() < 0.0
            upper = _crossing(last, point) if falling else point.factor
            # Tangents that meet below either point belong to a path that is not concave between them: no bound yet.
            bounds = not falling or upper >= max(last.factor, point.factor)
            if bounds and upper - last.factor <= close:
                reason = "limit" if falling else "bifurcation"
                return PathEnd(reason=reason, last=last, beyond=point, upper=upper, iterations=spent)
            length = _REFINE * float(np.linalg.norm(point.advance))
        else:
            last, length = point, longer
    return PathEnd(reason="lost", last=last, beyond=None, upper=None, iterations=spent)


def _crossing(before: PathPoint, after: PathPoint) -> float:
    """Load factor where the tangents of a rising and a falling point meet: not below a concave path between them."""
    rise, fall = before.slope(), after.slope()
    length = float(np.linalg.norm(after.advance))
    at = (after.factor - before.factor - fall * length) / (rise - fall)
    return before.factor + rise * at
