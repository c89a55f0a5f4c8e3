"""Errors, orders and the Pareto front of a study's runs; no files, no processes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from taichi_membrane.study.plan import Plan
from taichi_membrane.study.runner import Run

_LARGEST_ORDER = 20.0  # an observed order beyond it says that the differences between meshes are noise
# Observed orders that a limit is taken from, by the order of the mesh: about 2 with three-node triangles, 3 (where fabric wrinkles)
# and 4 with six-node ones. Others are errors of opposite sign, layers that no mesh sees, or meshes that are too coarse.
_TRUSTED = {1: (1.5, 2.5), 2: (2.5, 4.5)}


@dataclass(frozen=True)
class Extrapolation:
    """Richardson's limit of a probe for vanishing mesh size, and the order at which it is approached."""

    value: float
    order: float


@dataclass(frozen=True, kw_only=True)
class MeshPoint:
    """A mesh's most exact run: its value, and its relative ``error`` against the reference, the discretisation error."""

    run: Run
    value: float
    error: float | None


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """How one probe approaches its limit over the meshes of one sequence, coarse to fine.

    :param reference: what errors are measured against, None where there is none; ``origin`` says where it comes from.
    :param fitted_order: slope of log error over log mesh size, by least squares; None below two meshes with an error.
    :param observed_order: the order to quote: fitted, but Richardson's where the reference is the finest mesh, which has an error
        of its own and makes the slope too steep; None where there is none.
    :param extrapolation: from the three finest meshes, None where they have no common limit or approach it at an order that is not
        their elements'; ``no_extrapolation`` says why.
    """

    sequence: str
    probe: str
    reference: float | None
    origin: str
    meshes: tuple[MeshPoint, ...]
    fitted_order: float | None
    observed_order: float | None
    extrapolation: Extrapolation | None
    no_extrapolation: str


@dataclass(frozen=True, kw_only=True)
class Row:
    """One probe of one run; errors are relative, None where they are not defined.

    :param error: against the reference.
    :param iteration_error: against the most exact run on the same mesh.
    :param discretisation_error: of that most exact run against the reference.
    :param pareto: no other run is at least as exact in less time: of the sequence, or against a reference that is given or the
        scene's, of the problem on whatever meshes and elements.
    """

    run: Run
    probe: str
    value: float | None
    reference: float | None
    error: float | None
    iteration_error: float | None
    discretisation_error: float | None
    pareto: bool


@dataclass(frozen=True, kw_only=True)
class Study:
    """All that a study found."""

    plan: Plan
    runs: tuple[Run, ...]
    rows: tuple[Row, ...]
    convergences: tuple[Convergence, ...]


def analyse(plan: Plan, runs: Sequence[Run]) -> Study:
    """Measure every probe of every run against its reference."""
    rows: list[Row] = []
    convergences = []
    for probe in plan.probes:
        for sequence in dict.fromkeys(run.case.sequence for run in runs):
            members = [run for run in runs if run.case.sequence == sequence]
            convergence = _convergence(plan, probe, sequence, [run for run in members if probe in run.probes])
            convergences.append(convergence)
            rows += _rows(convergence, members)
        # Against one truth all kinds of meshes and elements compete; against their own limits each does alone.
        absolute = plan.reference == "check" or isinstance(plan.reference, Mapping)
        own = [number for number, row in enumerate(rows) if row.probe == probe]
        _mark_front(rows, own, absolute=absolute)
    return Study(plan=plan, runs=tuple(runs), rows=tuple(rows), convergences=tuple(convergences))


def pareto_front(cost: Sequence[float], error: Sequence[float]) -> list[bool]:
    """Mark the points that no other point beats: none is at least as good in both and better in one."""
    points = list(zip(cost, error, strict=True))
    return [not any(c <= cost and e <= error and (c, e) != (cost, error) for c, e in points) for cost, error in points]


def fitted_order(size: Sequence[float], error: Sequence[float]) -> float | None:
    """Slope of log ``error`` over log ``size`` by least squares; None below two different sizes with an error above zero."""
    pairs = [(h, e) for h, e in zip(size, error, strict=True) if e > 0]
    if len({h for h, _ in pairs}) < 2:
        return None
    log_size, log_error = np.log(pairs).T
    return float(np.polyfit(log_size, log_error, 1)[0])


def extrapolate(size: Sequence[float], value: Sequence[float]) -> Extrapolation:
    """Richardson's extrapolation q(h) = q* + C hᵖ through the last three points, for any ratios of mesh sizes.

    The order p solves (q₁ - q₂)/(q₂ - q₃) = (h₁ᵖ - h₂ᵖ)/(h₂ᵖ - h₃ᵖ), whose right side grows with p from ln(h₁/h₂)/ln(h₂/h₃) at 0.

    :param size: falling mesh sizes; ``value`` the probe's value on each.
    :raises ValueError: fewer than three sizes, or values that approach no limit; the message says which.
    """
    if len(size) < 3:
        raise ValueError(f"needs 3 meshes, not {len(size)}")
    (h1, h2, h3), (q1, q2, q3) = size[-3:], value[-3:]
    if not h1 > h2 > h3:
        raise ValueError("two meshes have the same number of triangles")
    first, second = q1 - q2, q2 - q3
    if second == 0:
        raise ValueError("the two finest meshes give the same value")
    if first / second <= 0:
        raise ValueError("values go up and down with the mesh size")
    coarse, fine = h1 / h3, h2 / h3

    def excess(order: float) -> float:
        return float((coarse**order - fine**order) / (fine**order - 1.0) - first / second)

    if first / second <= math.log(coarse / fine) / math.log(fine) or excess(1e-6) >= 0:
        raise ValueError("differences between meshes do not shrink")
    if excess(_LARGEST_ORDER) <= 0:
        raise ValueError(f"the differences between meshes would mean an order above {_LARGEST_ORDER:g}")
    order = float(brentq(excess, 1e-6, _LARGEST_ORDER, xtol=1e-12))
    return Extrapolation(q3 - second / (fine**order - 1.0), order)


def _convergence(plan: Plan, probe: str, sequence: str, runs: Sequence[Run]) -> Convergence:
    """Compare the most exact run on each mesh."""
    groups = [[run for run in runs if run.case.mesh == mesh] for mesh in dict.fromkeys(run.case.mesh for run in runs)]
    best = sorted((min(group, key=_inexactness) for group in groups), key=lambda run: run.case.tri_count)
    sizes, values = [run.case.size for run in best], [run.probes[probe] for run in best]
    found, extrapolation, reason = None, None, ""
    try:
        found = extrapolate(sizes, values)
        reason = _doubt(found.order, best[-1].case.scene.order)
        extrapolation = None if reason else found
    except ValueError as error:
        reason = str(error)
    reference, origin = _reference(plan, probe, best, extrapolation, reason)
    # Against the finest mesh, that mesh itself has no error to tell; of a single mesh, only the iteration errors are asked for.
    against_itself = {best[-1].case.mesh} if plan.reference == "finest" and len(best) > 1 else set()
    meshes = tuple(
        MeshPoint(
            run=run,
            value=run.probes[probe],
            error=None if run.case.mesh in against_itself else _relative(run.probes[probe], reference),
        )
        for run in best
    )
    known = [(point.run.case.size, point.error) for point in meshes if point.error is not None]
    fitted = fitted_order([size for size, _ in known], [error for _, error in known])
    richardson = None if found is None else found.order
    return Convergence(
        sequence=sequence,
        probe=probe,
        reference=reference,
        origin=origin,
        meshes=meshes,
        fitted_order=fitted,
        observed_order=richardson if plan.reference == "finest" else fitted,
        extrapolation=extrapolation,
        no_extrapolation=reason,
    )


def _doubt(order: float, degree: int) -> str:
    """Why no limit is taken from an observed order, with triangles of a degree; nothing where one is."""
    low, high = _TRUSTED[degree]
    if low <= order <= high:
        return ""
    kind = {1: "three-node", 2: "six-node"}[degree]
    return f"order {order:.2f}; a limit is told of orders from {low:g} to {high:g} with {kind} triangles"


def _reference(
    plan: Plan, probe: str, best: Sequence[Run], extrapolation: Extrapolation | None, reason: str
) -> tuple[float | None, str]:
    if isinstance(plan.reference, Mapping):
        return plan.reference[probe], "given"
    if not best:
        return None, "no run converged"
    finest = best[-1].case
    if plan.reference == "check":
        return finest.check_reference(probe), "check of the scene"
    if plan.reference == "finest":
        return best[-1].probes[
            probe
        ], f"most exact run on the finest mesh: {finest.label}, {finest.tri_count} triangles"
    if extrapolation is None:
        return None, f"no limit: {reason}"
    return extrapolation.value, f"Richardson's extrapolation, observed order {extrapolation.order:.2f}"


def _rows(convergence: Convergence, runs: Sequence[Run]) -> list[Row]:
    """The errors of each run of a sequence."""
    by_mesh = {point.run.case.mesh: point for point in convergence.meshes}
    rows = []
    for run in runs:
        value, point = run.probes.get(convergence.probe), by_mesh.get(run.case.mesh)
        measured = point is not None and point.error is not None
        rows.append(
            Row(
                run=run,
                probe=convergence.probe,
                value=value,
                reference=convergence.reference,
                error=_relative(value, convergence.reference) if measured else None,
                iteration_error=_relative(value, point.value if point else None),
                discretisation_error=point.error if point else None,
                pareto=False,
            )
        )
    return rows


def _mark_front(rows: list[Row], numbers: Sequence[int], *, absolute: bool) -> None:
    """Mark the rows of a probe that no other of the same competition beats.

    :param absolute: whether all sequences of one problem are one competition.
    """

    def competition(row: Row) -> str:
        return row.run.case.problem if absolute else row.run.case.sequence

    for name in dict.fromkeys(competition(rows[number]) for number in numbers):
        known = {
            number: (rows[number].run.cost, error)
            for number in numbers
            if competition(rows[number]) == name and (error := rows[number].error) is not None
        }
        front = pareto_front([cost for cost, _ in known.values()], [error for _, error in known.values()])
        for number, best in zip(known, front, strict=True):
            rows[number] = replace(rows[number], pareto=best)


def _inexactness(run: Run) -> tuple[bool, float, float]:
    """Sorts runs on one mesh: double precision first, then tight tolerance, then small residual."""
    return (
        run.case.settings["precision"] != "f64",
        run.case.scene.solver.tolerance or 0.0,  # within a study either all cases give one or none does
        math.inf if run.residual is None else run.residual,
    )


def _relative(value: float | None, reference: float | None) -> float | None:
    return None if value is None or not reference else abs(value - reference) / abs(reference)
