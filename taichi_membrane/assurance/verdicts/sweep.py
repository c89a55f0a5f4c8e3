"""Runs verdict cases in processes of their own, so that one that dies costs its case and no other."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from taichi_membrane.assurance.verdicts import bench, catalogue
from taichi_membrane.assurance.verdicts.case import Case, Finding

Told = Callable[[Case, Sequence[Finding]], None]


def run_case(name: str) -> list[Finding]:
    """A case by all its numbers of load steps, in this process."""
    case = catalogue.CASES[name]
    return [bench.run(case, steps, threads=1) for steps in case.steps]


def run_all(cases: Sequence[Case], *, jobs: int, told: Told) -> dict[str, list[Finding]]:
    """Findings of all cases, by case; ``told`` hears of each as it is done."""
    waiting = list(reversed(cases))
    found: dict[str, list[Finding]] = {case.name: [] for case in cases}

    def work(_: int) -> None:
        pool = _pool()
        while waiting:
            case = waiting.pop()
            try:
                found[case.name] = pool.submit(run_case, case.name).result()
            except BrokenProcessPool:
                pool.shutdown()
                pool = _pool()
                found[case.name] = [Finding(case=case.name, steps=case.steps[0], crashed="the process died")]
            told(case, found[case.name])
        pool.shutdown()

    with ThreadPoolExecutor(max_workers=jobs) as workers:
        list(workers.map(work, range(jobs)))
    return found


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn"))
