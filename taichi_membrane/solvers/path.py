"""Arc length: following an equilibrium path through limit points, where load control has no next state.

Displacements and the load factor λ are found together, at a given distance Δs along the path (E. Riks, Int. J. Solids Struct.
15, 1979). Corrections stay perpendicular to the step: Δu·δu = 0. The tangent may be indefinite; its negative pivots tell the
stable part of the path from the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.record import SolveRecord

# Sizes of steps are a matter of cost within a factor of ten either way, but where tests/test_policy_rules.py tells a difference.
# A step that takes few iterations is followed by a longer one, one that takes many by a shorter one.
_MOST_ITERATIONS, _FEW, _MANY = 14, 4, 9
_LONGER, _SHORTER = 1.5, 0.7
# A step is halved this often before the path counts as lost; a residual that grows so much is not going to come back.
_HALVINGS, _RUNAWAY = 12, 1e3
# What is still due of a point, over its step. Near a limit a residual within tolerance may be any displacement: at ten times this,
# or without, a column of 12 sides is lost on points that drift to the branch beside; at a tenth of it nothing changes but the cost.
_SETTLED = 1e-2
# Towards a target: the first step as a share of the way, most steps, how closely a limit is bracketed, the step after passing one.
_FIRST_STEP, _MOST_STEPS, _BRACKET, _REFINE = 0.25, 300, 1e-3, 0.3
# A point that lies more across the step than along it (45°) may be of another branch, and is looked for nearer: without that, and
# without a second pair of points, one of twelve runs of a bent tube jumped over the first ring that wrinkles, and its limit came
# out 1.6e-3 too high.
_STRAIGHT = 0.7
# Steps that have shrunk so far below the shortest are round-off: the path is lost. It ends what leads nowhere, at whatever size.
_VANISHING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """An equilibrium on the path.

    :param position: (node_count, 3) displacements.
    :param factor: load factor λ.
    :param tangent: (node_count, 3) du/dλ.
    :param negative: negative pivots of the tangent stiffness: 0 where the equilibrium is stable.
    :param advance: (node_count, 3) the step that led here; zero at the start.
    :param foretold: length of that step before its corrections, which lie across it.
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
    foretold: float = 0.0

    def length_for(self, change: float) -> float:
        """Distance along the tangent in which the load factor changes so much."""
        return abs(change) * float(np.linalg.norm(self.tangent))

    def rising(self) -> PathPoint:
        """This stable point, to go on from with rising load.

        Beside a bifurcation a step may have led across, onto a branch along which its own direction points back.
        """
        if float(np.vdot(self.tangent, self.advance)) >= 0.0:
            return self
        return replace(self, advance=self.tangent * (np.linalg.norm(self.advance) / np.linalg.norm(self.tangent)))

    def slope(self) -> float:
        """dλ/ds along the direction of travel."""
        length = float(np.linalg.norm(self.tangent))
        if length == 0.0:
            return np.inf  # the load moves nothing
        return float(np.copysign(1.0 / length, np.vdot(self.tangent, self.advance)))  # at the start: rising


class Path:
    """Follows an equilibrium path in a load factor.

    :param apply: sets pressures and loads of the membrane for a load factor; both depend on it linearly.
    :param force: (node_count, 3) change of the free forces per load factor at fixed displacements; leaves the factor applied.
    :param reference: 2-norm of the forces applied at a load factor, to which residuals there are compared: a membrane without
        its shape yet moves far under a thousandth of its load, and a path held to the whole load's tolerance is lost there.
    """

    def __init__(
        self,
        newton: Newton,
        apply: Callable[[float], None],
        force: Callable[[float], Floats],
        reference: Callable[[float], float],
        tolerance: float,
    ) -> None:
        self.newton = newton
        self.system = newton.system
        self.apply, self.force, self.reference, self.tolerance = apply, force, reference, tolerance

    def start(self, position: Floats, factor: float) -> PathPoint | None:
        """The path's first point, an equilibrium already; None where its tangent is singular."""
        return self._point(position, factor, np.zeros_like(position), 0, 0.0)

    def step(self, before: PathPoint, length: float) -> tuple[PathPoint | None, float]:
        """The next point at a distance ``length`` or less, onwards (from the start: with rising load), and the length to try next.

        None where the path is lost.
        """
        onwards = float(np.vdot(before.tangent, before.advance))
        if not np.any(before.tangent):
            return None, length  # the load moves nothing: there is no way along the path
        unit = before.tangent / np.linalg.norm(before.tangent) * (-1.0 if onwards < 0.0 else 1.0)
        spent = 0
        for _ in range(_HALVINGS):
            point, iterations = self._correct(before, length * unit)
            spent += iterations
            if point is not None:
                longer = _LONGER if iterations <= _FEW else _SHORTER if iterations >= _MANY else 1.0
                return replace(point, iterations=spent, foretold=length), length * longer
            length *= 0.5
        return None, length

    def land(self, before: PathPoint, beyond: PathPoint, factor: float) -> PathPoint | None:
        """The path's point at a load factor between those of two neighbours, stable or not; None where it is not found.

        Newton's method at that load, from between the two. What lies further from there than half their distance is another branch;
        the way is then shortened by a point in between.
        """
        for _ in range(_HALVINGS):
            advance = self.system.difference(before.position, beyond.position)
            share = (factor - before.factor) / (beyond.factor - before.factor)
            found = self._balanced(self.system.between(before.position, beyond.position, share), factor, advance)
            if found is not None:
                return found
            point = self._correct(before, share * advance)[0]
            if point is None or point.factor in (before.factor, beyond.factor):
                return None
            before, beyond = (point, beyond) if (point.factor < factor) == (before.factor < factor) else (before, point)
        return None

    def _balanced(self, position: Floats, factor: float, chord: Floats) -> PathPoint | None:
        """Equilibrium at a fixed load factor, no further from a position than half the chord; None where there is none."""
        begin, near = position, 0.5 * float(np.linalg.norm(chord))
        for iteration in range(_MOST_ITERATIONS + 1):
            self.system.set_displacement(position)
            self.apply(factor)
            force = self.newton.free_force()
            residual = self._residual(force, factor)
            if residual <= self.tolerance:
                return self._point(position, factor, chord, iteration, residual)
            stiffness = self.newton.factorised(indefinite=True)
            if stiffness is None:
                break
            position = self.system.retract(position, stiffness.solve(force))
            if not float(np.linalg.norm(position - begin)) <= near:  # not a number, too
                break
        return None

    def _correct(self, before: PathPoint, advance: Floats) -> tuple[PathPoint | None, int]:
        """Iterate from the predicted point to equilibrium, perpendicular to the step; None where that fails."""
        slope = float(np.vdot(advance, before.tangent) / np.vdot(before.tangent, before.tangent))
        factor = before.factor + slope
        lowest = np.inf
        for iteration in range(_MOST_ITERATIONS + 1):
            position = self.system.retract(before.position, advance)
            self.system.set_displacement(position)
            self.apply(factor)
            force = self.newton.free_force()
            residual = self._residual(force, factor)
            balanced = residual <= self.tolerance
            lowest = min(lowest, residual)
            if not np.isfinite(residual) or residual > _RUNAWAY * lowest:
                break
            stiffness = self.newton.at_rest() if balanced else self.newton.factorised(indefinite=True)
            if stiffness is None:
                break
            to_balance, tangent = stiffness.solve(force), self.tangent(stiffness, factor)
            across = float(np.vdot(advance, tangent))
            if across == 0.0:
                break  # the path runs across the step: nothing to correct the load by
            change = -float(np.vdot(advance, to_balance)) / across
            due = to_balance + change * tangent
            settled = np.linalg.norm(due) <= _SETTLED * np.linalg.norm(advance) or iteration == _MOST_ITERATIONS
            if balanced and settled:
                return self._point(position, factor, advance, iteration, residual), iteration
            advance = self.system.composed(advance, due)
            factor += change
        return None, iteration

    def _residual(self, force: Floats, factor: float) -> float:
        """Out-of-balance force over the reference; infinite where a step went so far astray that it overflows."""
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.linalg.norm(force)) / self.reference(factor)

    def _point(
        self, position: Floats, factor: float, advance: Floats, iterations: int, residual: float
    ) -> PathPoint | None:
        """An equilibrium with its tangent; None where that is singular."""
        self.system.set_displacement(position)
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

    def tangent(self, stiffness: Factor, factor: float) -> Floats:
        """(node_count, 3) du/dλ at the present equilibrium, from its factorised tangent stiffness."""
        return stiffness.solve(self.force(factor))


@dataclass(frozen=True, eq=False)
class PathEnd:
    """How following a path towards a load factor ended.

    :param reason: ``target``; ``limit`` (the load factor has a maximum below it); ``bifurcation`` (the path loses its stability
        while the load still rises); ``lost`` (no further equilibrium was found).
    :param last: the last stable point below the target.
    :param beyond: the point after it: above the target, or past the limit; None where lost.
    :param lower: a lower bound of the largest stable load factor, to what residuals leave open.
    :param upper: an upper bound of it, likewise, if the path is concave between the two; None where there is no limit.
    """

    reason: str
    last: PathPoint
    beyond: PathPoint | None
    iterations: int
    lower: float | None = None
    upper: float | None = None

    def record(self, *, again: bool = False) -> SolveRecord:
        """Record of following the path. Where it loses its stability the last point before is an equilibrium that may be kept.

        :param again: its iterations are counted already.
        """
        return SolveRecord(
            converged=self.reason in ("limit", "bifurcation"),
            reason=self.reason,
            iterations=0 if again else self.iterations,
            residual=self.last.residual,
            seconds=0.0,
            method="arc length",
        )


class Seen(NamedTuple):
    """What two points of a path tell of the piece between them.

    :param smooth: whether they are seen to lie on one smooth piece, near enough; else one is looked for nearer.
    :param slack: how much of the load factor secant and tangents differ by.
    :param noise: how much of the load factor residuals come to: the two are not known better.
    """

    smooth: bool
    slack: float
    noise: float


def follow(
    path: Path,
    start: PathPoint,
    target: float,
    *,
    see: Callable[[PathPoint, PathPoint], Seen],
    longest: float,
    shortest: float,
    progress: Callable[[PathPoint], None],
) -> PathEnd:
    """Follow a path from a stable point, with rising load, to a target load factor or to where it loses its stability.

    :param longest: of the first step, a distance; ``shortest``: share of the first step below which points are taken as they are.

    A limit is bracketed to :data:`_BRACKET` of the factor's way from 0 to the target, by two pairs of points: the bound that one
    gives has to hold for the nearer one, as a path that turns sharply, such as a column's, need not be concave.
    """
    last, spent, bound, highest = start, 0, -np.inf, start.factor
    length = min(start.length_for(_FIRST_STEP * (target - start.factor)), longest)
    least = shortest * length
    for _ in range(_MOST_STEPS):
        point, longer = path.step(last, length)
        if point is None:
            break
        spent += point.iterations
        progress(point)
        moved = float(np.linalg.norm(point.advance))
        smooth, slack, noise = see(last, point)
        if not (smooth and point.foretold >= _STRAIGHT * moved) and moved > least:
            if point.foretold <= _VANISHING * least:
                break
            length = 0.5 * point.foretold
            continue
        if point.negative == 0 and point.factor > highest - noise:
            highest = max(highest, point.factor)
            if point.factor >= target:
                return PathEnd("target", last, point, iterations=spent)
            last, length = point.rising(), longer
            continue
        upper = _upper_bound(last, point, slack, at_floor=moved <= least)
        narrow = upper is not None and upper - last.factor <= _BRACKET * target
        if upper is not None and narrow and upper <= bound + noise:
            falling = point.slope() < 0.0 or point.factor < last.factor
            reason = "limit" if falling else "bifurcation"
            top = max(upper, highest) + noise
            return PathEnd(reason, last, point, iterations=spent, lower=last.factor - noise, upper=top)
        if moved <= _VANISHING * least:
            break
        if upper is not None and narrow:
            bound = upper
        length = _REFINE * point.foretold
    return PathEnd("lost", last, None, iterations=spent)


def _upper_bound(before: PathPoint, after: PathPoint, slack: float, *, at_floor: bool) -> float | None:
    """Not below the largest load factor between a rising stable point and one that is unstable or lower; None where unknown.

    :param slack: what the path may bulge above its tangents, as far as they and the secant differ.
    :param at_floor: the two are as near as points are looked for: the rising one's tangent bounds a path that is not concave, too.
    """
    length = float(np.linalg.norm(after.advance))
    # dx/dλ over the distance x along the chord, as λ(x) need not be concave over an arc that turns: where a column buckles the
    # tangents of both ends are as steep as one likes along a chord that they hardly go along.
    rise, fall = (float(np.vdot(point.tangent, after.advance)) / length for point in (before, after))
    upper = (
        after.factor if fall >= 0.0 else _crossing(before.factor, max(rise, 0.0), after.factor, fall, length) + slack
    )
    if upper >= max(before.factor, after.factor):
        return upper
    # Tangents that meet below either point belong to a path that is not concave between them.
    return max(after.factor, before.factor + length / rise if rise > 0.0 else np.inf) if at_floor else None


def _crossing(before: float, rise: float, after: float, fall: float, length: float) -> float:
    """Load factor where the tangents of a rising and a falling point meet: not below a concave path between them.

    :param rise: dx/dλ ≥ 0 at the first, ``fall`` < 0 at the second, ``length`` further.
    """
    return (length + rise * before - fall * after) / (rise - fall)
