"""What a load step may hide: jumps of a part beside others, at loads that are known in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tents import Parts, borne, events, height_at, loads, tent

from taichi_membrane.simulation.results import RunResult
from taichi_membrane.simulation.way import Way

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def jump_of_one_step(big: tuple[float, float], small: tuple[float, float]) -> float:
    """Share of the load displacement of a step to 1 N each, on two tents of a limit and a rise, that is a jump of the second."""
    (limit, rise), (_, small_rise) = big, small
    way = rise * (1.0 - height_at(1.0 / limit)) + small_rise * (1.0 - height_at(1.0 / small[0], beyond=True))
    return small_rise * float(np.sqrt(3.0)) / way


def assert_collapsed(result: RunResult, load: str, limit: float) -> None:
    """Collapse is told at the limit of a tent, to a ten-thousandth."""
    assert result.outcome == "collapse"
    found = result.steps[-1].limit
    assert found is not None
    lower, upper = found[f"load.{load}"]
    assert lower <= limit + 1e-4
    assert upper >= limit - 1e-4
    assert upper - lower < 2e-3


@pytest.mark.parametrize(("rise", "seen"), [(0.0005, False), (0.0007, True)])
def test_a_snap_is_seen_from_a_fortieth_of_the_way_on(rise: float, seen: bool) -> None:
    """A small tent snaps through beside a big one; alone it is a collapse at half the load, beside it soon a mere wrinkle."""
    jump = jump_of_one_step((5.0, 1.0), (0.5, rise))
    assert (2.0 * jump > 0.05) == seen
    assert 0.02 < jump < 0.03
    result = Parts().tent("big", 5.0, 1.0).tent("small", 0.5, rise, at=(30.0, 0.0, 0.0)).run(loads(big=1.0, small=1.0))
    limit = result.steps[-1].limit
    if seen:
        assert limit is not None
        lower, upper = limit["load.small"]
        assert lower <= 0.5 <= upper
    else:
        assert (result.outcome, limit) == ("finished", None)
        assert result.steps[-1].probes["small"] < -2.0 * rise


@pytest.mark.parametrize("looks", [True, False])
def test_a_smooth_step_is_taken_at_once_where_halfway_is_as_foreseen(
    looks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From three times its rise to near its limit a tent's λ(P), a cubic, has e = 0.1; without a look halfway it is cut."""
    if not looks:
        monkeypatch.setattr(Way, "foreseen", lambda *_: False)
    result = tent().run(loads(tent=borne(3.0)) | {"steps": 8}, loads(tent=0.9))
    assert (events(result.steps[-1]) == ["load control"]) == looks
    assert ("bisected" in events(result.steps[-1])) != looks
    assert 1.0 + result.steps[-1].probes["tent"] == pytest.approx(height_at(0.9), rel=1e-4)


@pytest.mark.parametrize("rise", [4.0, 6.0])
def test_a_snap_within_a_curved_step_is_not_foreseen(rise: float) -> None:
    """A small tent snaps through at 0.53 N beside a big one whose λ(P) is curved: a twentieth of ΔP, and more."""
    both = Parts().tent("big", 1.0, 1.0).tent("small", 0.53, rise, at=(30.0, 0.0, 0.0))
    result = both.run(loads(big=borne(3.0), small=0.0) | {"steps": 8}, loads(big=0.9, small=1.0))
    assert_collapsed(result, "small", 0.53)


def test_parts_that_cancel_are_looked_at_halfway() -> None:
    """A small tent snaps through and stiffens as a big one softens: ends and secant agree to 0.013, and 0.4 of ΔP is a jump."""
    both = Parts().tent("big", 1.0, 1.0).tent("small", 0.05, 0.238, at=(30.0, 0.0, 0.0))
    result = both.run(loads(big=0.95, small=1.0))
    assert_collapsed(result, "small", 0.05)


def test_parts_that_take_over_are_looked_at_halfway() -> None:
    """A small tent snaps through beside a big one that softens to a third: a jump of 0.078 of ΔP behind e's twentieth."""
    both = Parts().tent("big", 1.0, 1.0).tent("small", 0.25, 0.292, at=(30.0, 0.0, 0.0))
    result = both.run(loads(big=borne(2.0), small=0.0) | {"steps": 8}, loads(big=0.9, small=1.0) | {"steps": 2})
    assert_collapsed(result, "small", 0.25)


@pytest.mark.parametrize(("below", "rise"), [(1e-3, 0.01), (1e-4, 0.003)])
def test_a_tangent_that_foretells_a_jump_is_looked_at_halfway(below: float, rise: float) -> None:
    """A small tent just below its limit is so soft that the way of its jump, 0.13 or 0.04 of ΔP, is what its tangent foretells."""
    both = Parts().tent("big", 2.0, 0.5).tent("small", 0.5, rise, at=(30.0, 0.0, 0.0))
    result = both.run(loads(small=0.5 * (1.0 - below)), loads(big=1.0, small=1.0))
    assert_collapsed(result, "small", 0.5)


def test_no_branch_is_a_state_far_beyond_a_limit() -> None:
    """Where the load of all falls as the small tent snaps it is no branch: what lies just above is far away for its stiffness."""
    both = Parts().tent("big", 1.0, 1.0).tent("small", 0.53, 1.88, at=(30.0, 0.0, 0.0))
    result = both.run(loads(big=borne(2.0), small=0.0) | {"steps": 8}, loads(big=0.9, small=1.0))
    assert_collapsed(result, "small", 0.53)


def test_bounds_are_as_wide_as_residuals_leave_the_load() -> None:
    """A small tent's limit is a ten-thousandth of the forces beside it, which residuals are relative to."""
    beside = Parts().tent("big", 1.5, 0.5).tent("small", 0.0127, 1.0, at=(30.0, 0.0, 0.0))
    result = beside.run(loads(big=1.5 * borne(4.0)) | {"steps": 12}, loads(big=1.5 * borne(3.9), small=0.127))
    assert result.outcome == "collapse"
    last = result.steps[-1]
    assert last.limit is not None
    lower, upper = last.limit["load.small"]
    assert lower <= 0.0127 <= upper
    assert lower < last.drivers["load.small"] < upper
    assert last.residual < 1e-6


@pytest.mark.parametrize(("far", "is_near"), [(1.9, True), (2.1, False)])
def test_a_branch_is_no_further_than_twice_what_its_stiffness_tells(far: float, is_near: bool) -> None:
    """At a stiffness of 10 a hundredth of the load tells a thousandth of the way."""
    below, beyond = (cast(Any, SimpleNamespace(share=share, stiffness=10.0)) for share in (0.5, 0.51))
    way = cast(Any, SimpleNamespace(_load_displacement=lambda *_: far * 1e-3))
    assert Way.near(way, below, beyond) == is_near


def test_a_cubic_that_snaps_through_is_not_foreseen() -> None:
    """Halfway on it lies an equilibrium, an unstable one: the limit is found all the same."""
    result = tent().run(loads(tent=borne(3.0)) | {"steps": 8}, loads(tent=1.2))
    assert result.outcome == "collapse"
    limit = result.steps[-1].limit
    assert limit is not None
    assert limit["load.tent"][0] <= 1.0 <= limit["load.tent"][1]
