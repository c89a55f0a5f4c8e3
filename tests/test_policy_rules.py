"""Each constant and each rule of the step policy, held by tents and sheets whose whole path is known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tents import (
    Parts,
    borne,
    bulge,
    events,
    height_at,
    loads,
    pulled,
    softened,
    softened_to,
    tent,
)

from taichi_membrane.execution.observer import Silent
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.policy import Passage
from taichi_membrane.simulation.results import RunResult
from taichi_membrane.simulation.stiffest import Stiffest
from taichi_membrane.simulation.way import Way
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.record import SolveRecord

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# ---- softness


@pytest.mark.parametrize(("share", "first"), [(0.3, "load control"), (0.15, "load control"), (0.07, "path")])
def test_below_a_tenth_of_the_first_stiffness_the_path_is_followed(share: float, first: str) -> None:
    """Stiffness and load of a tent are known: 1 - (λ/λ_max)² ≈ (s/s₀)². How long the steps of the course are does not matter."""
    load = softened_to(share)
    result = tent().run(loads(tent=load), loads(tent=load + 0.1 * (1.0 - load)))
    assert result.outcome == "finished"
    assert [one.trace[0].event for one in result.steps] == ["load control", first]
    height = height_at(load + 0.1 * (1.0 - load))
    assert 1.0 + result.steps[-1].probes["tent"] == pytest.approx(height, rel=1e-4)


def test_another_direction_of_the_load_has_a_softness_of_its_own() -> None:
    """A tent a hundred times softer than the one that was loaded before it is no softened structure."""
    both = Parts().tent("stiff", 100.0, 1.0).tent("soft", 1.0, 1.0, at=(30.0, 0.0, 0.0))
    result = both.run(loads(stiff=1.0), loads(soft=0.3))
    assert [events(step) for step in result.steps] == [["load control"]] * 2


@pytest.mark.parametrize(("turn", "same"), [(0.0, True), (3e-5, True), (1e-4, False)])
def test_a_course_is_a_direction_to_five_digits(turn: float, same: bool) -> None:
    """Loads told to five digits go on in one direction; what is turned by more is another course, whose stiffness is its own."""
    stiffest = Stiffest()
    ahead, aside = LoadState({"load.a": 1.0, "load.b": 3.0}), 3.0 * turn
    beyond = LoadState({"load.a": 2.0 + aside, "load.b": 6.0 - aside / 3.0})
    nothing = LoadState({"load.a": 0.0, "load.b": 0.0})
    assert stiffest.take(cast("Way", SimpleNamespace(before=nothing, after=ahead)), 1.0) == 1.0
    found = stiffest.take(cast("Way", SimpleNamespace(before=ahead, after=beyond)), 0.1)
    assert found == pytest.approx(0.1 if same else 1.0, rel=1e-3)


# ---- kinks


class Patience(Silent):
    """Ends a run that takes more iterations than it should."""

    def __init__(self, most: int) -> None:
        self.left = most

    def progress(self, stage: str, step: int, steps: int, iterations: int, residual: float, seconds: float) -> None:
        """Count one."""
        self.left -= 1
        assert self.left > 0, "the run does not come to an end"


def test_a_kink_is_found_to_a_thousandth_and_taken() -> None:
    """A slack cable under a tent goes taut when the tip has risen by its slack: from there on it is hundreds of times stiffer."""
    slack, first, last = 0.05, -0.1, -1.0
    under = tent().anchor((0.0, 0.0, -100.0)).tie(EA=5e5, unstressed=1.0 + slack / 101.0)
    result = under.run(loads(tent=first), loads(tent=last), observer=Patience(500))
    assert result.outcome == "finished"
    taut = (borne(1.0 + slack) - first) / (last - first)
    trace = result.steps[-1].trace
    (kink,) = [one.share for one in trace if one.event == "kink"]
    before = max(one.share for one in trace if one.event == "load control" and one.share < kink)
    assert before < taut < kink
    assert kink - before == 2.0**-10
    assert {one.event for one in trace} == {"bisected", "load control", "kink"}
    risen = result.steps[-1].probes["tent"]
    assert borne(1.0 + risen) - 5e5 * (risen - slack) / (101.0 + slack) == pytest.approx(last, rel=1e-4)


def test_a_limit_with_a_corner_is_bracketed() -> None:
    """A cable holds a tent that would long have snapped; as it goes slack the load falls at once."""
    under = tent().anchor((0.0, 0.0, -99.0)).tie(EA=500.0, unstressed=0.994)
    result = under.run(loads(tent=0.0), loads(tent=1.5))
    assert result.outcome == "collapse"
    limit = result.steps[-1].limit
    assert limit is not None
    lower, upper = limit["load.tent"]
    assert lower <= borne(0.4) <= upper
    assert upper - lower < 1.1e-3 * 1.5


# ---- starts


def test_from_an_unstrained_start_with_a_cable_the_first_bit_is_unverified() -> None:
    """Whether a cable is slack or taut hangs on the direction of the least move: the first thousandth of the way is taken."""
    under = tent().anchor((0.0, 0.0, -100.0)).tie(EA=500.0, unstressed=1.001)
    result = under.run(loads(tent=-1.0))
    assert result.steps[-1].trace[0] == Passage(event="unverified start", share=2.0**-10)
    assert events(result.steps[-1]).count("unverified start") == 1
    risen = result.steps[-1].probes["tent"]
    assert borne(1.0 + risen) - 500.0 * (risen - 0.101) / 101.101 == pytest.approx(-1.0, rel=1e-4)
    assert pulled(0.5, 5.0).steps[-1].trace[0] == Passage(event="unverified start", share=2.0**-10)
    down = under.run(loads(tent=1.2)).steps[
        -1
    ]  # the cable stays slack, the tent has its limit, and what was found lies beyond
    assert events(down) == ["unverified start", "path", "limit"]
    assert down.limit is not None
    assert down.limit["load.tent"][0] <= 1.0 <= down.limit["load.tent"][1]


def test_where_no_nearer_state_is_found_an_unstrained_start_is_unverified(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was tried in vain on the way to an equilibrium does not decide whether it is one."""
    solve = Equilibrium.solve

    def impatient(self: Equilibrium, *state: Any, patience: int | None = None, **more: Any) -> SolveRecord:
        record = solve(self, *state, patience=patience, **more)
        return record if patience is None else replace(record, converged=False, reason="iteration limit")

    monkeypatch.setattr(Equilibrium, "solve", impatient)
    under = tent().anchor((0.0, 0.0, -100.0)).tie(EA=500.0, unstressed=1.001)
    result = under.run(loads(tent=-1.0), solver={"max_cuts": 0})
    assert result.outcome == "finished"
    assert events(result.steps[-1]) == ["unverified start"]


@pytest.mark.parametrize(("prestress", "event"), [(5e-5, "load control"), (5e-4, "unverified start")])
def test_a_start_off_balance_by_more_than_rounding_is_no_equilibrium(prestress: float, event: str) -> None:
    """A cable's prestress pulls at the tip: so much of the load, 1 N, is out of balance at the start; 1e-6 is the tolerance."""
    under = tent(limit=5.0).anchor((0.0, 0.0, -100.0)).tie(EA=1e-3, prestress=prestress)
    assert events(under.run(loads(tent=1.0)).steps[-1]) == [event]


# ---- bifurcations


def test_sheets_bulge_one_after_another_on_one_path() -> None:
    """Four sheets give way at four loads; each bulges as it does alone, and none is a collapse."""
    prestress, end = (0.998, 0.9987, 0.9993, 0.9996), 0.9999
    result = softened(prestress, end)
    assert result.outcome == "finished"
    last = result.steps[-1]
    assert {"path", "bifurcation", "branch"} <= set(events(last))
    assert last.negative_pivots == 0
    for k, one in enumerate(prestress):
        assert abs(last.probes[f"sheet{k}"]) == pytest.approx(bulge(one, end - 1e-3), rel=1e-2)


@pytest.mark.parametrize("end", [1.003, 1.001])
def test_a_limit_soon_after_a_branch_is_not_jumped_over(end: float) -> None:
    """A sheet bulges just below the limit of the tent beside it: that is the largest load."""
    result = softened([1.0007], end)
    assert result.outcome == "collapse"
    last = result.steps[-1]
    assert last.limit is not None
    lower, upper = last.limit["load.tent"]
    assert lower <= 1.0 + 1e-5  # it is an equilibrium, and known to the residual's tolerance
    assert upper >= 1.0
    assert abs(last.probes["sheet0"]) > 1e-3


@pytest.mark.parametrize("way", [2e-3, 3e-3])
def test_a_branch_is_found_in_a_short_step(way: float) -> None:
    """In a step of a few thousandths of the load a branch is still told from the flat state, which is unstable."""
    start = softened_to(0.05)
    result = softened([(start + 0.3 * way - 1e-3) / 0.998], start + way)
    assert result.outcome == "finished"
    assert "branch" in events(result.steps[-1])
    assert abs(result.steps[-1].probes["sheet0"]) > 1e-3


def test_sheets_bulge_where_they_are_pushed_from_a_start_that_is_no_equilibrium() -> None:
    """Flat it is in balance too, but unstable: it is pushed off, whatever the start was."""
    result = Parts().sheet("sheet", 1.0).run(loads(sheet=4.0))
    assert events(result.steps[-1])[-1] == "unverified start"
    assert result.steps[-1].negative_pivots == 0
    assert abs(result.steps[-1].probes["sheet"]) == pytest.approx(bulge(1.0, 4.0), rel=1e-4)


def test_an_unstable_equilibrium_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """By symmetry a sheet stays flat where that is unstable, if nothing disturbs it: then its bulging is its largest load."""
    monkeypatch.setattr(Newton, "disturb", lambda _: None)
    monkeypatch.setattr(Newton, "_push", lambda *_: None)
    result = Parts().sheet("sheet", 1.0).run(loads(sheet=-0.5), loads(sheet=1.5))
    assert result.outcome == "collapse"
    assert [step.negative_pivots for step in result.steps] == [0, 0]
    assert result.steps[-1].limit is not None
    lower, upper = result.steps[-1].limit["load.sheet"]
    assert lower == pytest.approx(1.0, rel=5e-3)
    assert lower < upper


# ---- snaps


def steep(**stage: Any) -> RunResult:
    """A steep tent whose tip nothing guides: it tips over below the limit of its upright path, to hang below the rim."""
    parts = tent(rise=60.0)
    parts.scene["supports"] = [{"group": "held", "hold": "xyz"}]
    return parts.run(loads(tent=1.2) | stage)


def test_a_snap_is_passed_only_where_the_stage_says_so() -> None:
    """A guided tent at its limit, a free one where it tips over: both jump, and both land as far below the rim."""
    for result in (tent().run(loads(tent=1.2)), steep()):
        assert (result.outcome, result.steps[-1].negative_pivots) == ("collapse", 0)
    for rise, limit, result in (
        (1.0, "limit", tent().run(loads(tent=1.2) | {"snaps": "pass"})),
        (60.0, "bifurcation", steep(snaps="pass")),
    ):
        assert result.outcome == "finished"
        assert events(result.steps[-1]) == ["path", limit, "snap", "load control"]
        beyond = rise * height_at(1.2, beyond=True)
        assert rise + result.steps[-1].probes["tent"] == pytest.approx(beyond, rel=1e-4)


def test_a_snap_just_below_the_aim_lands_on_the_aim() -> None:
    """The state beyond a limit is looked for above it, but no further than the load that was asked for."""
    result = tent().run(loads(tent=1.004) | {"snaps": "pass"})
    assert events(result.steps[-1])[-1] == "snap"
    assert result.steps[-1].loads == {"tent": 1.004}
    assert 1.0 + result.steps[-1].probes["tent"] == pytest.approx(height_at(1.004, beyond=True), rel=1e-5)


def test_an_unstable_start_foretells_nothing() -> None:
    """A path is left between its limits, where a tent is unstable: what load control finds from there is stable, and no more."""
    result = tent().run(
        {"loads": {"tent": 1.2}, "control": "arc_length", "steps": 8, "until": "steps"}, loads(tent=0.3)
    )
    assert [step.negative_pivots for step in result.steps[-2:]] == [1, 0]
    assert events(result.steps[-1]) == ["unverified start"]
    height = 1.0 + result.steps[-1].probes["tent"]
    assert min(abs(height - height_at(0.3)), abs(height - height_at(0.3, beyond=True))) < 1e-5


def test_a_step_that_ends_on_a_plane_is_verified() -> None:
    """A floor stops the tip half way, so that the tent does not collapse: what it leaves free is as stiff as foretold."""
    parts = tent()
    parts.scene["planes"] = {"floor": {"through": [0.0, 0.0, 0.5], "normal": [0.0, 0.0, 1.0], "group": "tent"}}
    result = parts.run(loads(tent=0.5), loads(tent=2.0))
    assert result.outcome == "finished"
    assert {events(step)[-1] for step in result.steps} <= {"load control", "contact"}
    assert result.steps[-1].stable is True
    assert result.steps[-1].probes["tent"] == pytest.approx(-0.5, abs=1e-6)


# ---- motions


@pytest.mark.parametrize("steps", [1, 4])
def test_a_motion_passes_a_snap_and_tells_where(steps: int) -> None:
    """The frame is at w + λ(1 - w)/k where the tip is at -w: that has a maximum, beyond which the tip jumps."""
    stiffness, distance = 0.5, 5.0
    edge = np.sqrt((1.0 - stiffness / (1.5 * np.sqrt(3.0))) / 3.0)
    limit = (1.0 - edge + borne(edge) / stiffness) / distance
    result = pulled(stiffness, distance, steps)
    assert result.outcome == "finished"
    (snap,) = [one.share for step in result.steps for one in step.trace if one.event == "snap"]
    assert limit < snap <= limit + 2.0**-10
    sink = -result.steps[-1].probes["tent"]
    assert sink + borne(1.0 - sink) / stiffness == pytest.approx(distance, rel=1e-4)


def test_a_motion_without_a_snap_tells_none() -> None:
    """A stiff bar takes the tip through its limit and back up: nothing jumps."""
    result = pulled(5.0, 3.0)
    assert result.outcome == "finished"
    assert "snap" not in events(result.steps[-1])
    sink = -result.steps[-1].probes["tent"]
    assert sink + borne(1.0 - sink) / 5.0 == pytest.approx(3.0, rel=1e-4)


# ---- landing


def test_landing_takes_more_than_one_attempt() -> None:
    """A cable catches the tip just before the aim: between the path's last two points there is a kink."""
    over = tent().anchor((0.0, 0.0, 101.0)).tie(EA=1e3, unstressed=1.0038)
    step = over.run(loads(tent=softened_to(0.05))).steps[-1]
    assert events(step)[-2:] == ["path", "target"]
    assert step.cuts == 0
    sink = -step.probes["tent"]
    assert borne(1.0 - sink) + 1e3 * (sink - 0.38) / 100.38 == pytest.approx(softened_to(0.05), rel=1e-4)
