"""Where Newton, relaxation or the path do not get on: what a load step falls back to, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest
from tents import (
    Parts,
    borne,
    events,
    height_at,
    loads,
    pulled,
    softened,
    softened_to,
    tent,
)

from taichi_membrane.execution.observer import Silent
from taichi_membrane.simulation import equilibrium, load_step
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import Path, PathEnd, PathPoint

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# ---- where Newton or the path does not get on


@pytest.fixture
def clumsy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton gives up at once where relaxation can take over."""
    monkeypatch.setattr(equilibrium, "_NEWTON_PATIENCE", 1)


@pytest.fixture
def lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """No path is found."""

    def follow(path: Path, start: PathPoint, target: float, **more: Any) -> PathEnd:
        return PathEnd("lost", start, None, iterations=0)

    monkeypatch.setattr(load_step, "follow", follow)


@pytest.mark.usefixtures("clumsy", "lost")
def test_relaxation_comes_last_and_is_verified() -> None:
    """Below the limit it is taken; beyond it what it finds lies behind a jump, and is not."""
    below = tent().run(loads(tent=0.5))
    assert below.outcome == "finished"
    assert events(below.steps[-1]) == ["path", "lost", "relaxed"]
    assert 1.0 + below.steps[-1].probes["tent"] == pytest.approx(height_at(0.5), rel=1e-5)
    alone = tent().run(loads(tent=0.5), solver={"kind": "newton"})
    assert events(alone.steps[-1]) == ["load control"]
    for stage in (loads(tent=1.2), loads(tent=1.2) | {"snaps": "pass"}):
        above = tent().run(stage)
        assert above.outcome == "not converged"
        assert "refused" in events(above.steps[-1])
        reached = above.steps[-1].loads["tent"]
        assert 0.9 < reached < 1.0
        assert 1.0 + above.steps[-1].probes["tent"] == pytest.approx(height_at(reached), rel=1e-4)


@pytest.mark.usefixtures("clumsy")
def test_relaxation_through_a_motion_tells_the_snap() -> None:
    """A motion has no path to follow: a snap is taken, and told."""
    result = pulled(0.5, 5.0, solver={"max_cuts": 0})
    assert result.outcome == "finished"
    assert events(result.steps[-1]) == ["snap"]
    sink = -result.steps[-1].probes["tent"]
    assert sink + borne(1.0 - sink) / 0.5 == pytest.approx(5.0, rel=1e-4)


@pytest.mark.usefixtures("clumsy")
def test_an_unstable_equilibrium_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relaxation keeps a sheet flat, by symmetry, where flat is unstable; nothing pushes it off."""
    monkeypatch.setattr(Newton, "disturb", lambda _: None)
    monkeypatch.setattr(Newton, "_leave_saddle", lambda *_: None)
    result = Parts().sheet("sheet", 1.0).run(loads(sheet=4.0), solver={"max_cuts": 0})
    last = result.steps[-1]
    assert (result.outcome, last.converged) == ("not converged", False)
    assert events(last) == ["unstable", "refused"]
    assert "unstable" in last.reason
    assert last.loads == {"sheet": 0.0}


def test_no_start_of_a_path_is_no_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    """What load control found lies beyond a jump; with no path to tell how far it is stable the step has failed."""
    monkeypatch.setattr(Path, "start", lambda *_: None)
    for stages in ([loads(tent=1.2)], [loads(tent=softened_to(0.05)), loads(tent=1.2)]):
        result = tent().run(*stages, solver={"max_cuts": 0})
        last = result.steps[-1]
        assert (result.outcome, last.converged) == ("not converged", False)
        assert "beyond a jump" in last.reason
        assert events(last) == ["path"]  # relaxation would find what load control has found
        at = {"tent": 0.0} if len(stages) == 1 else stages[0]["loads"]
        assert last.loads == at
        assert 1.0 + last.probes["tent"] == pytest.approx(height_at(at["tent"]), rel=1e-4)


@pytest.mark.usefixtures("clumsy")
def test_newton_alone_calls_no_relaxation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Newton does not get on from a start that is no equilibrium, the hybrid goes on with relaxation, and only that."""
    monkeypatch.setattr(equilibrium, "_NEWTON_LIMIT", 1)
    under = tent(limit=5.0).anchor((0.0, 0.0, -100.0)).tie(EA=10.0, prestress=0.5)
    assert under.run(loads(tent=1.0)).outcome == "finished"
    alone = under.run(loads(tent=1.0), solver={"kind": "newton"})
    assert alone.outcome == "not converged"
    assert alone.steps[-1].iterations < 10


# ---- work that leads nowhere


def test_landing_on_a_corner_is_given_up() -> None:
    """Against a cable as good as rigid no chord comes near the aim; the path is left for load control, which is."""
    over = tent().anchor((0.0, 0.0, 101.0)).tie(EA=1e5, unstressed=1.0038)
    result = over.run(loads(tent=softened_to(0.05)))
    assert result.outcome == "finished"
    assert result.steps[-1].iterations < 500  # a landing at least takes one, and eighty of them would


def test_a_point_that_does_not_converge_is_looked_for_nearer() -> None:
    """Beside a big tent the path of a small one that snaps is narrow, and most first steps overshoot."""
    result = Parts().tent("big", 5.0, 1.0).tent("small", 0.5, 0.004, at=(30.0, 0.0, 0.0)).run(loads(big=1.0, small=1.0))
    assert result.outcome == "collapse"
    assert result.steps[-1].iterations < 250


# ---- paths that go astray


@pytest.fixture
def careless(monkeypatch: pytest.MonkeyPatch) -> None:
    """The path is followed to its aim through whatever is unstable on the way."""

    def follow(path: Path, start: PathPoint, target: float, **more: Any) -> PathEnd:
        point, length = start, start.length_for(0.25)
        while point.factor < target:
            found, length = path.step(point, length)
            assert found is not None
            point = found
        return PathEnd(reason="target", last=start, beyond=point, upper=None, iterations=0)

    monkeypatch.setattr(load_step, "follow", follow)


@pytest.mark.usefixtures("careless")
def test_a_path_that_ends_beyond_a_jump_does_not_land_there() -> None:
    """Down through both limits and up again to the load: stable there, but no stable path leads to it."""
    result = tent().run(loads(tent=1.2))
    assert result.outcome == "not converged"
    reached = result.steps[-1].loads["tent"]
    assert 0.9 < reached < 1.0
    assert 1.0 + result.steps[-1].probes["tent"] == pytest.approx(height_at(reached), rel=1e-4)


@pytest.mark.usefixtures("careless")
def test_a_path_that_ends_unstable_does_not_land_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flat sheet that nothing disturbs is in balance at any load, on one smooth path, and unstable from its bulging on."""
    monkeypatch.setattr(Newton, "disturb", lambda _: None)
    monkeypatch.setattr(Newton, "_push", lambda *_: None)
    result = Parts().sheet("sheet", 1.0).run(loads(sheet=-0.5), loads(sheet=1.5))
    assert result.outcome == "not converged"
    assert result.steps[-1].loads["sheet"] < 1.0


@pytest.mark.usefixtures("clumsy", "lost")
def test_relaxation_that_ends_unstable_is_refused() -> None:
    """By symmetry it keeps a sheet flat, which no stiffness tells from a stable path."""
    result = Parts().sheet("sheet", 1.0).run(loads(sheet=0.5), loads(sheet=1.5), solver={"max_cuts": 0})
    assert result.outcome == "not converged"
    assert events(result.steps[-1]) == ["path", "lost", "refused"]
    assert result.steps[-1].loads == {"sheet": 0.5}


@pytest.mark.usefixtures("lost")
def test_newton_alone_does_not_end_in_relaxation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither Newton nor the path gets on, and the scene has asked for nothing else."""
    monkeypatch.setattr(equilibrium, "_NEWTON_LIMIT", 1)
    result = tent().run(loads(tent=0.5), solver={"kind": "newton", "max_cuts": 0})
    assert events(result.steps[-1]) == ["path", "lost"]


def test_a_limit_after_branches_is_snapped_through() -> None:
    """That a branch was taken before has nothing to do with it."""
    result = softened((0.998, 0.999, 0.9995), 1.003, snaps="pass")
    assert result.outcome == "finished"
    assert "branch" in events(result.steps[-1])
    assert "snap" in events(result.steps[-1])
    assert 1.0 + result.steps[-1].probes["tent"] == pytest.approx(height_at(1.003, beyond=True), rel=1e-4)


def test_a_load_that_moves_nothing_leaves_what_is_stable_so() -> None:
    """On a held rim it does no work, and has no stiffness to compare; the equilibrium stays, and is asked whether it is stable."""
    parts = tent()
    parts.scene["loads"]["rim"] = {"group": "held", "direction": [0.0, 0.0, -1.0]}
    step = parts.run(loads(rim=1.0)).steps[-1]
    assert events(step) == ["load control"]
    assert step.stable is True


class Count(Silent):
    """Iterations as they are told: Newton's one by one, those of a path's points, which take no time of their own, together."""

    def __init__(self) -> None:
        self.iterations = 0

    def progress(self, stage: str, step: int, steps: int, iterations: int, residual: float, seconds: float) -> None:
        """Count."""
        self.iterations += iterations if seconds == 0.0 else min(iterations, 1)


def test_each_iteration_counts_once() -> None:
    """Also where the path's last point before a limit becomes the result."""
    count = Count()
    assert tent().run(loads(tent=1.2), observer=count).steps[-1].iterations == count.iterations
