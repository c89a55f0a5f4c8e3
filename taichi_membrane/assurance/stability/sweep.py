"""Runs the sweeps: each precision in a process of its own, because one process has one Taichi runtime."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from taichi_membrane.assurance.stability import catalogue
from taichi_membrane.assurance.stability.case import Bench, Entry, Solver
from taichi_membrane.names import Precision

Told = Callable[[str, str, Sequence[Entry]], None]


@dataclass(frozen=True)
class Lane:
    """Solvers that share a process, one case after the other."""

    precision: Precision
    solvers: tuple[Solver, ...]

    @property
    def name(self) -> str:
        """For messages."""
        return f"{' and '.join(self.solvers)} in {self.precision}"


# The longest first: with two jobs the third begins when the first of these two ends.
LANES = (Lane("f64", ("relaxation",)), Lane("f32", ("relaxation",)), Lane("f64", ("newton", "hybrid")))

_bench: Bench | None = None


def sweep(bench: Bench, name: str, solvers: Sequence[Solver], *, full: bool) -> list[Entry]:
    """Run a case's levels with each of the solvers; the default set leaves a solver off after a level without equilibrium."""
    case = catalogue.CASES[name]()
    entries: list[Entry] = []
    going = list(solvers)
    # Level by level, so that solvers share the kernels of a mesh.
    for level in case.swept(full=full):
        found = [bench.run(case, level, solver) for solver in going]
        entries += found
        if not full:
            going = [one.solver for one in found if one.converged]
    return entries


def _in_process(name: str, lane: Lane, full: bool) -> list[Entry]:
    """A sweep in a worker; its runtime and compiled kernels stay for the next one."""
    global _bench
    if _bench is None:
        _bench = Bench(lane.precision, full=full, threads=1)
    return sweep(_bench, name, lane.solvers, full=full)


def run_all(names: Sequence[str], *, full: bool, jobs: int, told: Told) -> dict[str, list[Entry]]:
    """Entries of all cases, by case; ``told`` hears of each case, lane and its entries as they are done."""
    found: dict[str, list[Entry]] = {name: [] for name in names}
    with ThreadPoolExecutor(max_workers=jobs) as lanes:
        for part in lanes.map(lambda lane: list(_lane(lane, names, full, told)), LANES):
            for name, entries in part:
                found[name] += entries
    return found


def _lane(lane: Lane, names: Sequence[str], full: bool, told: Told) -> Iterator[tuple[str, list[Entry]]]:
    """All cases of a lane; a process that dies costs its case and no other."""
    pool = _pool()
    for name in names:
        try:
            entries = pool.submit(_in_process, name, lane, full).result()
        except BrokenProcessPool:
            entries = [_crashed(name, lane)]
            pool.shutdown()
            pool = _pool()
        told(name, lane.name, entries)
        yield name, entries
    pool.shutdown()


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn"))


def _crashed(name: str, lane: Lane) -> Entry:
    """What stands for a sweep whose process died: a failure without a reason, which is judged as wrong."""
    return Entry(
        case=name, level=catalogue.CASES[name]().levels[0], solver=lane.solvers[0], precision=lane.precision, converged=False,
        reason="", finite=True, iterations=0, seconds=0.0, residual=None, tolerance=0.0, kept=False, strain=0.0,
        energy=None, eigenvalue=None, moved=None, values={}, exact={},
    )  # fmt: skip
