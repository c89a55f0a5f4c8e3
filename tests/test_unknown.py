"""What a load step could tell and does not: each has its reason."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_gas import sphere
from test_members import strip
from test_path import LIMIT, tent
from test_rim import sail, tube
from test_threads import sheet
from told import assert_told

import taichi_membrane as tm
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.rim import SkewFactor
from taichi_membrane.output.reader import read_run
from taichi_membrane.output.tables import stability_notes, stability_text
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def changed(scene: Scene, **changes: Any) -> Scene:
    """A scene with some keys in other words."""
    return Scene.model_validate(scene.model_dump() | changes)


def push(load: float = 0.5, **stage: Any) -> list[dict[str, Any]]:
    """A stage that pushes the tent down."""
    return [{"name": "push", "steps": 4, "loads": {"push": load * LIMIT}, **stage}]


SOLVER = {"kind": "hybrid", "stability": False}
CLIPPED = {"E": 1e5, "nu": 0.3, "thickness": 0.01, "law": "clip"}

# Runs of each kind, and what they say of the stability of their last load step.
KINDS: dict[str, tuple[Callable[[], RunResult], str]] = {
    "relaxation": (lambda: tm.run(sheet(4, "relaxation")), "relaxation has no tangent (solver.kind = relaxation)"),
    "law without tangent": (lambda: tm.run(changed(sheet(4, "hybrid"), fabric=CLIPPED)), "relaxation has no tangent (the law"),
    "hybrid": (lambda: tm.run(sheet(4, "hybrid")), "stable"),
    "not asked": (lambda: tm.run(changed(sheet(4, "hybrid"), solver=SOLVER)), "solver.stability is off"),
    "singular": (
        lambda: tm.run(changed(sheet(4, "newton"), stages=[{"name": "rest", "pressure": 0.0}])),
        "the tangent is singular",
    ),
    "no equilibrium": (
        lambda: tm.run(changed(sheet(3, "relaxation"), solver={"kind": "relaxation", "max_iterations": 1, "max_cuts": 0})),
        "the state is no equilibrium",
    ),
    "derivatives": (lambda: tent(push(), derivatives=["sink"]), "stable"),
    "buckling": (lambda: tent(push(), modes={"kind": "buckling", "count": 1}), "stable"),
    "buckling at rest": (
        lambda: tent([*push(), {"name": "hold"}], modes={"kind": "buckling", "count": 1}),
        "stable",
    ),
    "collapse": (lambda: tent(push(1.2)), "stable"),
    "unstable": (lambda: tent(push(1.2, control="arc_length", steps=20, until="steps")), "unstable (1)"),
    "gas": (lambda: tm.run(sphere(4, 1.4)), "stable"),
    "plane": (lambda: tm.run(strip()), "stable"),
    "two pressures": (lambda: tm.run(tube()), "divergence only: nothing diverges, as the symmetric part"),
    "free rim": (lambda: tm.run(sail(5.0)), "divergence only: nothing diverges, as the symmetric part"),
}  # fmt: skip


@pytest.mark.parametrize("kind", list(KINDS))
def test_of_every_kind_of_result_each_is_a_value_or_a_reason(kind: str) -> None:
    """And what is said of stability is what is known of it."""
    make, told = KINDS[kind]
    result = make()
    assert_told(result)
    if kind == "unstable":
        assert told in {stability_text(step) for step in result.steps}
        return
    last = result.steps[-1]
    assert last.unknown.get("stable", stability_text(last)).startswith(told)


def test_what_is_not_known_says_why(tmp_path: Path) -> None:
    """In results, read back, and of every name that has no value."""
    relaxed = tm.run(sheet(4, "relaxation"), out=tmp_path / "out", render=False)
    assert set(relaxed.steps[0].unknown) == {"stable", "derivatives", "modes", "limit"}
    newton = tm.run(sheet(4, "hybrid"))
    assert newton.steps[0].unknown["limit"] == "none was met"
    followed = tent(push(1.2, control="arc_length", steps=20, until="steps"))
    assert {step.unknown["limit"] for step in followed.steps} == {"by arc length limits are passed"}
    assert [step.unknown for step in read_run(tmp_path / "out").steps] == [step.unknown for step in relaxed.steps]


def test_without_a_potential_nothing_is_called_stable(tmp_path: Path) -> None:
    """In the result, the table, the history, the summary and read back; the same tube under equal pressures is stable."""
    result = tm.run(tube(), out=tmp_path / "out", render=False)
    (step,) = result.steps
    assert (step.stable, step.negative_pivots, stability_text(step)) == (None, 0, "no divergence")
    assert "flutter" in step.unknown["stable"]
    assert "flutter" in step.unknown["limit"]
    assert stability_notes(result.steps) == [("load step 0", step.unknown["stable"])]
    with (tmp_path / "out" / "history.csv").open(encoding="utf-8", newline="") as file:
        assert [row["stability"] for row in csv.DictReader(file)] == ["no divergence"]
    record = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["steps"][0]
    assert (record["stable"], record["unknown"]) == (None, step.unknown)
    assert read_run(tmp_path / "out").steps[0].stable is None
    equal = tm.run(tube(cap=0.6)).steps[-1]
    assert (equal.stable, equal.negative_pivots) == (True, 0)


class Dense:
    """A factorised symmetric matrix of 3 components a node."""

    doubt = ""

    def __init__(self, matrix: Floats) -> None:
        self.matrix = matrix
        self.negative = int((np.linalg.eigvalsh(matrix) < 0.0).sum())

    def substituted(self, right: Floats) -> Floats:
        """Solution (n, 3)."""
        return np.linalg.solve(self.matrix, right.ravel()).reshape(right.shape)


def coupled(diagonal: list[float], jump: float) -> SkewFactor:
    """K = S + Z of one node: S diagonal, Z the skew part between its first two components."""
    turn = np.zeros((3, 3))
    turn[0, 1], turn[1, 0] = jump, -jump

    def times(vector: Floats, *, transposed: bool = False) -> Floats:
        return (turn.T if transposed else turn).dot(vector.ravel()).reshape(vector.shape)

    held = SimpleNamespace(node_held=np.zeros((1, 3), dtype=bool))
    skew: Any = SimpleNamespace(structure=held, ends=np.array([0]), times=times)
    factor: Any = Dense(np.diag(diagonal))
    return SkewFactor(factor, skew)


@pytest.mark.parametrize(
    ("diagonal", "jump", "negative", "told"),
    [
        ([5.0, 1.0, 1.0], 9.0, 0, "symmetric part of the tangent is positive definite"),  # stable or fluttering
        ([5.0, -1.0, 1.0], 1.0, 1, ""),  # one negative eigenvalue of either: it diverges
        ([5.0, -1.0, 1.0], 4.0, 0, "3 eigenvalues: none is real and negative"),  # 2 ± 2.6 i: S has one, K none
        (
            [-0.5, -0.4, 1.0],
            2.0,
            0,
            "3 eigenvalues: none is real and negative",
        ),  # -0.45 ± 2 i: it swings up, and S has two
        ([-0.5, -0.4, 1.0], 0.01, 2, ""),
    ],
)
def test_the_symmetric_part_is_no_verdict(diagonal: list[float], jump: float, negative: int, told: str) -> None:
    """Its negative eigenvalues are not those of the tangent; a pair that swings is not seen, and that is said."""
    found = coupled(diagonal, jump)
    assert found.negative == negative
    assert found.doubt.startswith("divergence only: ")
    assert "flutter" in found.doubt
    assert told in found.doubt
