"""What is wrong with what a run says of itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from taichi_membrane.assurance.stability.bracket import Bracket
from taichi_membrane.assurance.verdicts.case import MARGIN, Case, Finding

MISSED = "missed limit"
FALSE = "false limit"
UPSIDE_DOWN = "bracket upside down"
OUTSIDE = "limit outside the truth"
UNSTABLE = "unstable success"
UNBALANCED = "out of balance"
OFF_TARGET = "not at its loads"
VALUE = "wrong number"
DEPENDENT = "depends on steps"
CRASH = "crash"
KINDS = (MISSED, FALSE, UPSIDE_DOWN, OUTSIDE, UNSTABLE, UNBALANCED, OFF_TARGET, VALUE, DEPENDENT, CRASH)

# A residual taken again may differ from the solver's own by its rounding.
_RESIDUAL_MARGIN = 2.0
# Reactions are the forces at held nodes of the same state, by the same kernel: they differ by nothing but the order of sums.
_REACTION_MARGIN = 1e-9


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong."""

    kind: str
    why: str


def faults(case: Case, found: Finding) -> tuple[Fault, ...]:
    """What is wrong with one run, by itself and against the truth."""
    if found.crashed:
        return (Fault(CRASH, found.crashed),)
    if found.refused:
        expected = bool(case.may_refuse) and case.may_refuse in found.refused
        return () if expected else (Fault(CRASH, f"refused: {found.refused}"),)
    return (*_states(found), *_bounds(found), *_against_truth(case, found), *_numbers(case, found))


def _states(found: Finding) -> list[Fault]:
    """Equilibrium and stability of what is passed off as a result."""
    wrong = []
    claimed = found.states if found.reached or found.limits is not None else found.states[:-1]
    for one in claimed:
        where = f"{one.stage} {one.stage_step}"
        if not one.residual <= _RESIDUAL_MARGIN * one.tolerance:
            wrong.append(Fault(UNBALANCED, f"{where}: residual {one.residual:.2e}, allowed {one.tolerance:g}"))
        if not one.reactions <= _REACTION_MARGIN:
            wrong.append(Fault(UNBALANCED, f"{where}: reactions differ by {one.reactions:.1e} of the largest"))
        admitted = one.told == one.negative and (found.followed or not found.passed)
        if one.negative and not admitted:
            wrong.append(Fault(UNSTABLE, f"{where}: {one.negative} negative eigenvalues, told {one.told}"))
    if found.reached and not found.at_target:
        wrong.append(Fault(OFF_TARGET, "said to be finished, but the last step has not its stage's loads"))
    return wrong


def _bounds(found: Finding) -> list[Fault]:
    """Order of the bounds, and that there are any."""
    if found.limits is None:
        return []
    if not found.limits:
        return [Fault(OUTSIDE, "a limit is told without bounds")]
    return [
        Fault(UPSIDE_DOWN, said)
        for name, (lower, upper) in found.limits.items()
        if (said := Bracket(name=name, lower=lower, upper=upper, target=found.targets[name]).wrong())
    ]


def _against_truth(case: Case, found: Finding) -> list[Fault]:
    truth = case.truth
    if truth.kind == "holds" and found.limits is not None:
        return [Fault(FALSE, f"{found.told()}, but it holds")]
    if truth.kind != "limit":
        return []
    if found.limits is None:
        # Where a stable branch may carry any load, only the stability of the state reached tells.
        missed = found.reached and not found.snapped and math.isfinite(truth.upper - truth.lower)
        return [Fault(MISSED, f"{found.told()}, but {truth}")] if missed else []
    bounds = found.limits.get(truth.name)
    if bounds is None:
        return [Fault(OUTSIDE, f"no bounds of {truth.name}")] if found.limits else []
    if overlap(bounds, (truth.lower, truth.upper)):
        return []
    rising = found.targets[truth.name] > truth.lower
    early = max(bounds) < truth.lower if rising else min(bounds) > truth.upper
    return [Fault(FALSE if early else OUTSIDE, f"{found.told()}, but {truth}")]


def _numbers(case: Case, found: Finding) -> list[Fault]:
    if not found.reached:
        return []
    return [
        Fault(VALUE, f"{name} is {found.values[name]:.6g}, not {exact:.6g}")
        for name, exact in found.exact.items()
        if not abs(found.values[name] - exact) <= case.allowed * max(1.0, abs(exact))
    ]


def overlap(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two intervals have a value in common, to the margin that equilibria are known to."""
    (a, b), (c, d) = sorted(one), sorted(other)
    margin = MARGIN * max(abs(value) for value in (a, b, c, d) if math.isfinite(value))
    return a <= d + margin and c <= b + margin


def dependent(findings: Sequence[Finding]) -> dict[int, Fault]:
    """The runs of one case, by their number, that contradict an earlier one that went another number of load steps.

    A run without a verdict (not converged, refused, crashed) contradicts nothing.
    """
    wrong: dict[int, Fault] = {}
    for number, one in enumerate(findings):
        for other in findings[:number]:
            if _contradict(one, other):
                wrong[number] = Fault(
                    DEPENDENT, f"{other.steps} steps: {other.told()}; {one.steps} steps: {one.told()}"
                )
                break
    return wrong


def _contradict(one: Finding, other: Finding) -> bool:
    if one.limits is None or other.limits is None:
        return (one.reached and other.limits is not None) or (other.reached and one.limits is not None)
    common = one.limits.keys() & other.limits.keys()
    return not all(overlap(one.limits[name], other.limits[name]) for name in common)
