"""Inflated bodies of six-node triangles: errors fall with the fourth power of the size, where those of three nodes fall with the
second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from taichi_membrane.assurance.verification import pressure
from taichi_membrane.assurance.verification.benchmark import Benchmark, Solution


def _of_six_nodes(
    case: Benchmark, sizes: tuple[int, int, int], bounds: Mapping[str, float], orders: Mapping[str, float]
) -> Benchmark:
    """A case of order 2 with its own sizes and bounds.

    :param bounds: of each quantity on the finest mesh; what has none is left out. ``orders`` of those that do not have 3.5.
    """
    quantities = tuple(
        replace(one, bound=bounds[one.name], order=orders.get(one.name, 3.5))
        for one in case.quantities
        if one.name in bounds
    )

    def run(size: int) -> Solution:
        found = case.run(size)
        return Solution(values={one.name: found.values[one.name] for one in quantities}, points=found.points)

    return replace(
        case, name=f"{case.name}_six", title=f"{case.title}, six-node triangles", sizes=sizes, more_sizes=(2 * sizes[-1],),
        quantities=quantities, run=run,
    )  # fmt: skip


def sphere() -> Benchmark:
    """The sphere; its small extension is met as far as the shape at rest is, to a share of itself."""
    bounds = {"extension, small": 5e-5, "extension, large": 5e-6, "stress, large": 5e-6}
    return _of_six_nodes(pressure.sphere(order=2), (4, 8, 16), bounds, {})


def cylinder() -> Benchmark:
    """The tube with caps; the small hoop extension, as large as the ring is out of round, is met the least."""
    bounds = {"hoop extension, small": 6e-4, "axial extension, small": 2e-5, "hoop extension, large": 2e-5}
    bounds |= {"axial extension, large": 1e-5, "hoop stress, large": 5e-6}
    orders = {"hoop extension, small": 2.5, "axial extension, large": 3.0}
    return _of_six_nodes(pressure.cylinder(order=2), (2, 4, 8), bounds, orders)


def disc() -> Benchmark:
    """The flat disc under follower pressure."""
    bounds = {"rise, Q = 0.01": 2e-6, "rise, Q = 0.1": 2e-6, "volume, Q = 0.1": 2e-6}
    return _of_six_nodes(pressure.disc(order=2), (4, 8, 16), bounds, {})
