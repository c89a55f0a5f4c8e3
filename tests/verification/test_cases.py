"""Every verification case: the bound on its finest mesh and the rate at which its error falls, from the case's own record."""

from __future__ import annotations

import pytest

from taichi_membrane.assurance.verification import catalogue
from taichi_membrane.assurance.verification.benchmark import run_benchmark
from taichi_membrane.device.runtime import Runtime


@pytest.mark.parametrize("name", catalogue.CASES)
def test_case_meets_its_bound_at_its_rate(name: str, runtime_cpu: Runtime) -> None:
    result = run_benchmark(catalogue.CASES[name]())
    assert not result.failure
    found = {one.quantity.name: (one.values, one.errors, one.slope) for one in result.quantities}
    assert {one.quantity.name: one.within_bound for one in result.quantities} == dict.fromkeys(found, True), found
    assert {one.quantity.name: one.falls_fast_enough for one in result.quantities} == dict.fromkeys(found, True), found
