"""What records show of themselves in a notebook: one line each, a data frame of the load steps, bounds that can be told apart."""

from __future__ import annotations

import sys

import pytest

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.simulation.analysis import _collapse
from taichi_membrane.simulation.results import RunResult


@pytest.fixture(scope="module")
def sphere() -> RunResult:
    scene = tm.load_scene("sphere", ["mesh.divisions=3", "checks=[]"])
    return tm.run(scene, render=False)


def test_records_are_one_line(sphere: RunResult) -> None:
    step = sphere.steps[-1]
    assert (
        repr(sphere) == f"RunResult(sphere: finished, {len(sphere.steps)} load steps, {sphere.mesh.tri_count} elements)"
    )
    assert repr(step).startswith(f"StepResult({step.stage} {step.stage_step}: converged, stable, radius = ")
    assert repr(sphere.mesh).startswith(
        f"Mesh({sphere.mesh.node_count} nodes, {sphere.mesh.tri_count} elements of order 1; groups: "
    )
    for one in (sphere, step, sphere.mesh, step.elements, step.state):
        assert "\n" not in repr(one)
        assert len(repr(one)) < 400


def test_the_table_has_every_step_with_drivers_probes_and_verdicts(sphere: RunResult) -> None:
    table = sphere.table()
    assert list(table.index) == [step.number for step in sphere.steps]
    for step, row in zip(sphere.steps, table.to_dict("records"), strict=True):
        assert {name: row[name] for name in step.probes} == step.probes
        assert {name: row[name] for name in step.drivers} == dict(step.drivers)
        assert (row["stage"], row["converged"], row["stable"]) == (step.stage, True, True)


def test_without_pandas_the_table_says_so(sphere: RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="table needs pandas"):
        sphere.table()


@pytest.mark.parametrize(
    ("low", "high", "told"),
    [
        (4.0, 4.5, "4 and 4.5"), (4.63756, 4.63757, "4.63756 and 4.63757"), (4.6375601, 4.6375612, "4.63756 and 4.637561"),
        (1.0, 1.0, "1 and 1"),
    ],
)  # fmt: skip
def test_bounds_have_the_digits_that_tell_them_apart(low: float, high: float, told: str) -> None:
    assert _collapse({"load.tip": (low, high)}) == f"collapse: the largest stable load has load.tip between {told}"
