"""What a verification case is, and how it is run and judged.

A case computes some quantities on meshes of several sizes. Each has a reference with its source, the rate at which its error has to
fall with the size (where there is one), and the largest relative error allowed on the finest mesh of the default set.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import RunResult

Floats = NDArray[np.float64]

# A slope measured over two halvings of the mesh has not reached its limit: higher terms of the error still tilt it.
ORDER_MARGIN = 0.3


class NoEquilibriumError(Exception):
    """A load step of a case did not converge."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One number of a case.

    :param reference: the value it should have; not zero.
    :param bound: largest relative error on the finest default mesh.
    :param order: the error falls at least as size to the power of minus this; None where no rate can be expected.
    :param remark: why there is no order, or where the theory behind the reference ends.
    :param resolution: relative error below which the reference itself (its digits, its theory) is not to be trusted.
    """

    name: str
    reference: float
    source: str
    bound: float
    order: float | None = 2.0
    remark: str = ""
    resolution: float = 1e-6

    def __post_init__(self) -> None:
        if self.order is None and not self.remark:
            raise ValueError(f"{self.name}: say in remark why no order is expected")


@dataclass(frozen=True, kw_only=True)
class Curve:
    """An exact curve that the computed points of a case are drawn on."""

    x_label: str
    y_label: str
    x: Floats
    y: Floats
    exact: str = "exact"


@dataclass(frozen=True, kw_only=True)
class Solution:
    """What one mesh gave: the value of each quantity by name, and points (x, y) of the case's curve if it has one."""

    values: Mapping[str, float]
    points: tuple[Floats, Floats] | None = None


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """A problem with a known answer.

    :param setting: geometry, material, supports, loads, in a sentence or two.
    :param size_label: what ``sizes`` count; the element size falls as one over it.
    :param sizes: the default meshes, coarse to fine; ``more_sizes`` are added by ``verify --full``.
    :param run: computes the quantities on a mesh of one size.
    """

    name: str
    title: str
    setting: str
    size_label: str
    sizes: tuple[int, int, int]
    more_sizes: tuple[int, ...]
    quantities: tuple[Quantity, ...]
    run: Callable[[int], Solution]
    curve: Curve | None = None


@dataclass(frozen=True, kw_only=True)
class QuantityResult:
    """A quantity on all meshes; ``errors`` are relative to the reference, with their sign."""

    quantity: Quantity
    sizes: tuple[int, ...]
    values: tuple[float, ...]
    bounded: int
    slope: float | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "slope", measured_order(self.sizes, self.errors, self.quantity.resolution))

    @property
    def errors(self) -> tuple[float, ...]:
        """Relative errors, mesh by mesh."""
        reference = self.quantity.reference
        return tuple((value - reference) / abs(reference) for value in self.values)

    @property
    def within_bound(self) -> bool:
        """Whether the finest default mesh, and every finer one, is near enough."""
        return all(abs(error) <= self.quantity.bound for error in self.errors[self.bounded :])

    @property
    def falls_fast_enough(self) -> bool:
        """Whether the error falls at the expected rate; errors beneath the resolution of the reference need not."""
        expected = self.quantity.order
        return expected is None or self.slope is None or self.slope >= expected - ORDER_MARGIN

    @property
    def passed(self) -> bool:
        """Bound and rate hold."""
        return self.within_bound and self.falls_fast_enough


@dataclass(frozen=True, kw_only=True)
class BenchmarkResult:
    """A case on all meshes.

    :param seconds: wall time per mesh, compilation included.
    :param points: points of the case's curve on the finest mesh.
    :param failure: why a run ended without equilibrium; empty when all went well.
    """

    case: Benchmark
    sizes: tuple[int, ...]
    quantities: tuple[QuantityResult, ...]
    seconds: tuple[float, ...]
    points: tuple[Floats, Floats] | None
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Every quantity is right and no run failed."""
        return not self.failure and all(one.passed for one in self.quantities)


def run_benchmark(case: Benchmark, *, full: bool = False) -> BenchmarkResult:
    """Run a case on its default meshes, or with ``full`` on its finer ones too."""
    sizes = case.sizes + (case.more_sizes if full else ())
    outcomes: dict[int, Solution] = {}
    seconds: dict[int, float] = {}
    failure = ""
    for size in reversed(sizes):  # the finest first: the others fit in the kernels that are compiled for it
        started = time.perf_counter()
        try:
            outcomes[size] = case.run(size)
        except NoEquilibriumError as error:
            failure = f"{size} {case.size_label}: {error}"
            continue
        seconds[size] = time.perf_counter() - started
    done = tuple(size for size in sizes if size in outcomes)
    return BenchmarkResult(
        case=case,
        sizes=done,
        quantities=tuple(
            QuantityResult(
                quantity=one,
                sizes=done,
                values=tuple(outcomes[size].values[one.name] for size in done),
                bounded=len(case.sizes) - 1,
            )
            for one in case.quantities
            if outcomes
        ),
        seconds=tuple(seconds[size] for size in done),
        points=outcomes[done[-1]].points if done else None,
        failure=failure,
    )


def measured_order(sizes: tuple[int, ...], errors: tuple[float, ...], resolution: float) -> float | None:
    """Slope of log error against log size, by least squares, with its sign turned; None with fewer than two usable points.

    The fit ends at the first error beneath the resolution.
    """
    size, error = np.array(sizes, dtype=float), np.abs(errors)
    below = np.flatnonzero(error < resolution)
    count = int(below[0]) if len(below) else len(error)
    if count < 2:
        return None
    return float(-np.polyfit(np.log(size[:count]), np.log(error[:count]), 1)[0])


def solve(data: Mapping[str, Any], mesh: Mesh | None = None) -> RunResult:
    """Run a scene given as a mapping without its name and units, which no result depends on.

    :raises NoEquilibriumError: a load step did not converge.
    """
    scene = Scene.model_validate({"name": "case", "units": {"length": "m", "force": "N"}, **data})
    result = run(scene, mesh=mesh, render=False)
    if not result.converged:
        last = result.steps[-1]
        raise NoEquilibriumError(f"stage {last.stage}, step {last.stage_step}: {last.reason}")
    return result
