"""Each constant and each rule of the step policy, held by tents whose whole path is known in closed form.

A tent's tip is guided and its rim held, so that at the share ζ of its rise it bears λ = (3√3/2) ζ (1 - ζ²) of its limit, at
ζ = 1/√3. Tents that stand beside one another under one load bear it each for itself: their compliances add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from test_policy import beam

from taichi_membrane.execution.observer import Silent
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation import equilibrium, load_step
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.load_step import Stiffest
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.policy import Passage
from taichi_membrane.simulation.results import RunResult, StepResult
from taichi_membrane.simulation.way import Rest, Way
from taichi_membrane.solvers import path as path_module
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import Path, PathEnd, PathPoint
from taichi_membrane.solvers.record import SolveRecord

if TYPE_CHECKING:
    from taichi_membrane.mechanics.preparation import Floats

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SIDES, RADIUS, THICKNESS = 6, 10.0, 0.1
INNER = RADIUS * float(np.cos(np.pi / SIDES))


def modulus(limit: float, rise: float) -> float:
    """E of a tent that bears no more than ``limit``."""
    slant = float(np.hypot(INNER, rise))
    volume = SIDES * THICKNESS * RADIUS * float(np.sin(np.pi / SIDES)) * slant
    return limit * 3.0 * float(np.sqrt(3.0)) * slant**4 / (volume * rise**3)


def borne(height: float) -> float:
    """Load over the limit at a share of the rise."""
    return 1.5 * float(np.sqrt(3.0)) * height * (1.0 - height**2)


def softened_to(share: float) -> float:
    """Load over the limit at which the tent has this share of its first stiffness, dλ/dζ ~ 3 ζ² - 1."""
    return borne(float(np.sqrt((1.0 + 2.0 * share) / 3.0)))


def height_at(load: float, *, beyond: bool = False) -> float:
    """Stable share of the rise at a load over the limit: before the snap, or ``beyond`` it."""
    roots = np.roots([-1.5 * np.sqrt(3.0), 0.0, 1.5 * np.sqrt(3.0), -load])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    return float(real[0] if beyond else real[-1])


class Parts:
    """A mesh put together from tents, sheets and held points; each part is an element group and a fabric of its own."""

    def __init__(self) -> None:
        self.points: list[Any] = []
        self.triangles: list[Any] = []
        self.groups: dict[str, list[int]] = {"held": []}
        self.elements: dict[str, list[int]] = {}
        self.scene: dict[str, Any] = {
            "name": "parts",
            "units": {"length": "mm", "force": "N"},
            "mesh": {"shape": "given"},
            "fabrics": {},
            "supports": [{"group": "held", "hold": "xyz"}],
            "loads": {},
            "probes": {},
        }

    def tent(self, name: str, limit: float, rise: float, at: Sequence[float] = (0.0, 0.0, 0.0)) -> Parts:
        """A tent with a load on its tip, both of this name, and a probe of how far it sinks."""
        angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
        rim = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0.0 * angle])
        fan = [[0, 1 + k, 1 + (k + 1) % SIDES] for k in range(SIDES)]
        first = self._part(name, np.vstack([[[0.0, 0.0, rise]], rim]) + at, fan, {"E": modulus(limit, rise)})
        self.groups[name] = [first]
        self.groups["held"] += range(first + 1, first + 1 + SIDES)
        self.scene["supports"].append({"group": name, "hold": "xy"})
        self.scene["loads"][name] = {"group": name, "direction": [0.0, 0.0, -1.0]}
        self.scene["probes"][name] = {"kind": "displacement", "group": name, "component": "z"}
        return self

    def sheet(self, name: str, prestress: float, at: Sequence[float] = (0.0, 0.0, 0.0)) -> Parts:
        """A square of four prestressed triangles, pushed together by a load of its name; a probe tells how its centre bulges."""
        square = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [5, 5, 0]]) + np.asarray(at)
        fabric = {"E": 1000.0, "prestress": [prestress, prestress, 0.0], "warp": [1.0, 0.0, 0.0]}
        first = self._part(name, square, [[4, k, (k + 1) % 4] for k in range(4)], fabric)
        self.groups["held"] += [first, first + 3]
        self.groups |= {name: [first + 1, first + 2], f"{name}_centre": [first + 4]}
        self.scene["supports"].append({"group": name, "hold": "yz"})
        self.scene["loads"][name] = {"group": name, "direction": [-1.0, 0.0, 0.0]}
        self.scene["probes"][name] = {"kind": "displacement", "group": f"{name}_centre", "component": "z"}
        return self

    def anchor(self, at: Sequence[float], *, held: bool = True) -> Parts:
        """A point to tie something to; ``frame`` is the triangle that it belongs to."""
        first = self._part(
            "frame", np.array([[0, 0, 0], [0, 9, 0], [0, 0, 9]]) + np.asarray(at), [[0, 1, 2]], {"E": 1.0}
        )
        self.groups |= {"anchor": [first], "frame": [first, first + 1, first + 2]}
        if held:
            self.groups["held"] += self.groups["frame"]
        return self

    def tie(self, EA: float, unstressed: float = 1.0, **more: Any) -> Parts:
        """A cable from ``tent`` to ``anchor``."""
        self.scene["cables"] = {"tie": {"nodes": ["tent", "anchor"], "EA": EA, "unstressed": unstressed, **more}}
        return self

    def run(self, *stages: dict[str, Any], **more: Any) -> RunResult:
        """Run it; each stage gets a name."""
        observer = more.pop("observer", None)
        scene = self.scene | {"stages": [{"name": f"stage{k}", **stage} for k, stage in enumerate(stages)]} | more
        mesh = Mesh.build(np.vstack(self.points), np.vstack(self.triangles), self.groups, self.elements)
        return run(Scene.model_validate(scene), mesh=mesh, observer=observer)

    def _part(self, name: str, points: Any, triangles: Any, fabric: dict[str, Any]) -> int:
        first, before = sum(map(len, self.points)), sum(map(len, self.triangles))
        self.points.append(points)
        self.triangles.append(np.array(triangles) + first)
        self.elements[name] = list(range(before, before + len(triangles)))
        self.scene["fabrics"][name] = {"nu": 0.0, "thickness": THICKNESS, "law": "none"} | fabric
        return first


def tent(limit: float = 1.0, rise: float = 1.0) -> Parts:
    """One tent."""
    return Parts().tent("tent", limit, rise)


def loads(**values: float) -> dict[str, Any]:
    """A stage to these loads."""
    return {"loads": values}


def events(step: StepResult) -> list[str]:
    return [one.event for one in step.trace]


# ---- what a step hides


def error_of_one_step(big: tuple[float, float], small: tuple[float, float]) -> float:
    """The policy's e of a step to 1 N each on two tents of a limit and a rise, the second of which snaps on the way."""
    first = last = way = 0.0
    for (limit, rise), beyond in ((big, False), (small, True)):
        height = height_at(1.0 / limit, beyond=beyond)
        first += rise / (limit * 3.0 * np.sqrt(3.0))
        last += rise / (limit * 1.5 * np.sqrt(3.0) * abs(1.0 - 3.0 * height**2))
        way += rise * (1.0 - height)
    return float((0.5 * (1.0 / first + 1.0 / last) - 1.0 / way) / max(1.0 / first, 1.0 / last))


@pytest.mark.parametrize(("rise", "seen"), [(0.0015, False), (0.004, True)])
def test_a_snap_is_seen_from_a_tenth_of_the_stiffness_on(rise: float, seen: bool) -> None:
    """A small tent snaps through beside a big one; alone it is a collapse at half the load, beside it soon a mere wrinkle."""
    error = error_of_one_step((5.0, 1.0), (0.5, rise))
    assert (error > 0.1) == seen
    assert 0.05 < error < 0.15
    result = Parts().tent("big", 5.0, 1.0).tent("small", 0.5, rise, at=(30.0, 0.0, 0.0)).run(loads(big=1.0, small=1.0))
    limit = result.steps[-1].limit
    if seen:
        assert limit is not None
        lower, upper = limit["load.small"]
        assert lower <= 0.5 <= upper
    else:
        assert (result.outcome, limit) == ("finished", None)
        assert result.steps[-1].probes["small"] < -2.0 * rise


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


def softened(prestress: Sequence[float], end: float, **stage: Any) -> RunResult:
    """Sheets beside a tent just below its limit of 1 N, so that the path is followed; both loads rise by the same to ``end``."""
    parts, mid = Parts().tent("tent", 1.0, 1.0, at=(0.0, 50.0, 0.0)), softened_to(0.05)
    for k, one in enumerate(prestress):
        parts.sheet(f"sheet{k}", one, at=(20.0 * k, 0.0, 0.0))

    def to(load: float) -> dict[str, Any]:
        return loads(tent=load, **{f"sheet{k}": load - 1e-3 for k in range(len(prestress))})

    return parts.run(to(1e-3), to(mid), to(end) | stage)


def bulge(prestress: float, load: float) -> float:
    """How far one sheet bulges at a load, alone, in small steps from where it is flat."""
    result = (
        Parts()
        .sheet("sheet", prestress)
        .run(loads(sheet=0.0), loads(sheet=0.99 * prestress), loads(sheet=load) | {"steps": 10})
    )
    assert result.outcome == "finished"
    return abs(result.steps[-1].probes["sheet"])


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


def test_planes_foretell_nothing() -> None:
    """A floor stops the tip half way, so that the tent does not collapse; its rigid planes are no part of the tangent."""
    parts = tent()
    parts.scene["planes"] = {"floor": {"through": [0.0, 0.0, 0.5], "normal": [0.0, 0.0, 1.0], "group": "tent"}}
    result = parts.run(loads(tent=0.5), loads(tent=2.0))
    assert result.outcome == "finished"
    assert [events(step) for step in result.steps] == [["unverified start"]] * 2
    assert result.steps[-1].probes["tent"] == pytest.approx(-0.5, abs=1e-6)


# ---- motions


def pulled(stiffness: float, distance: float, steps: int = 1, **more: Any) -> RunResult:
    """A tent whose tip is pulled down by a bar to a frame that moves down."""
    parts = tent().anchor((0.0, 0.0, -100.0), held=False).tie(EA=stiffness * 101.0, kind="bar")
    parts.scene["motions"] = {"pull": {"kind": "translation", "group": "frame", "direction": [0.0, 0.0, -1.0]}}
    return parts.run({"motions": {"pull": distance}, "steps": steps}, **more)


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


# ---- the load displacement


def ways(before: LoadState, after: LoadState, **scene: Any) -> Way:
    """The way between two load states of a short tube, whose one end slides in a slanted plane."""
    whole = {
        "name": "tube",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 10.0, "length": 20.0, "around": 6, "along": 2},
        "fabric": {"E": 100.0, "nu": 0.0, "thickness": 1.0},
        "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "normal": [0.6, 0.8, 0.0]}],
        "stages": [{"name": "stage", "pressure": 0.3}],
    }
    taken = Scene.model_validate(whole | scene)
    model = build_model(taken, build_mesh(taken, None))
    model.structure.prepare(matrix=True)
    found = Equilibrium(model)
    assert found.newton is not None
    return found.way(before, after)


def test_a_pressure_works_on_the_volume() -> None:
    """From any shape to any other its load displacement is its change times the volume swept: exactly, as volume is cubic."""
    way = ways(LoadState({"pressure.inside": 0.1}), LoadState({"pressure.inside": 0.3}))
    membrane, random = way.system, np.random.default_rng(1)
    rests = []
    for share in (0.0, 1.0):
        moved = membrane.in_frames(random.normal(size=(membrane.node_count, 3)))
        moved[membrane.structure.node_held] = 0.0
        position = membrane.retract(np.zeros_like(moved), moved)
        membrane.set_displacement(position)
        rests.append(Rest(share=share, position=position, force=way.force(share), stiffness=1.0, negative=0))
    first, last = rests
    swept = [float(membrane.swept_volumes(one.position).sum()) for one in rests]
    assert way._load_displacement(first, last) == pytest.approx(0.2 * (swept[1] - swept[0]), rel=1e-9)
    np.testing.assert_array_equal(membrane.displacement(), last.position)
    assert membrane.pressures() == pytest.approx(0.3)


def test_a_turning_motion_acts_by_where_it_is() -> None:
    """Half a turn on the way of a whole one the end moves the other way; what it moves is left where it was."""
    motions = {"turn": {"kind": "rotation", "group": "end", "axis": [0, 0, 1], "through": [0, 0, 0]}}
    supports = [{"group": "start", "hold": "xyz"}]
    ends = [LoadState({"pressure.inside": 0.0, "motion.turn": angle}) for angle in (0.0, 360.0)]
    way = ways(*ends, motions=motions, supports=supports)
    way.press(0.25)
    before = way.system.displacement()
    force = way.force(0.25)
    np.testing.assert_array_equal(way.system.displacement(), before)

    def free(share: float) -> Floats:
        way.press(share)
        return way.newton.free_force()

    step = 1e-4
    slow = (free(0.25 + step) - free(0.25 - step)) / (2.0 * step)
    assert np.linalg.norm(force - slow) < 1e-3 * np.linalg.norm(slow)
    assert np.linalg.norm(slow) > 0.0


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


def test_a_load_that_moves_nothing_foretells_nothing() -> None:
    """On a held rim it does no work, and has no stiffness to compare."""
    parts = tent()
    parts.scene["loads"]["rim"] = {"group": "held", "direction": [0.0, 0.0, -1.0]}
    assert events(parts.run(loads(rim=1.0)).steps[-1]) == ["unverified start"]


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


# ---- ends of a path


def test_at_a_limit_the_pressure_is_that_of_the_last_stable_state() -> None:
    """Its reactions balance the wind that is told, not one that was tried beyond it."""
    parts = tent()
    parts.scene["pressures"] = {"wind": {"kind": "fixed"}}
    parts.scene["probes"]["rim"] = {"kind": "reaction", "group": "held", "component": "z"}
    area = 0.5 * SIDES * RADIUS**2 * float(np.sin(2.0 * np.pi / SIDES))
    result = parts.run({"pressure": -1.2 * 3.0 / area})
    assert result.outcome == "collapse"
    last = result.steps[-1]
    assert last.limit is not None
    assert -3.0 / area == pytest.approx(last.limit["pressure.wind"][0], rel=1e-3)
    assert abs(last.probes["rim"]) == pytest.approx(abs(last.pressures["wind"]) * area, rel=1e-5)


@pytest.mark.parametrize("change", [{"rim": 1.0}, {}], ids=["held nodes", "no change"])
def test_a_load_that_moves_nothing_is_carried(change: dict[str, float]) -> None:
    """Along a path as by load control: there is no direction to go in, and no number comes of dividing by none."""
    parts = tent()
    parts.scene["loads"]["rim"] = {"group": "held", "direction": [0.0, 0.0, -1.0]}
    with np.errstate(all="raise"):
        result = parts.run({"loads": change, "control": "arc_length", "steps": 3})
    assert result.outcome == "finished"
    last = result.steps[-1]
    assert (last.stage_step, last.loads["rim"], last.negative_pivots) == (1, change.get("rim", 0.0), 0)
    assert not last.displacement.any()
    assert on_curve(0.0, 0.0, np.inf).slope() == np.inf  # the load rises, and nothing moves


def on_curve(at: float, load: float, slope: float, step: float = 0.0) -> PathPoint:
    """A point of a path of one displacement."""
    return PathPoint(
        position=np.array([[at]]), factor=load, tangent=np.array([[1.0 / slope]]), negative=int(slope < 0.0),
        advance=np.array([[step]]), iterations=0, residual=0.0,
    )  # fmt: skip


def test_a_limit_is_not_told_below_the_largest_load() -> None:
    """λ = s² (3 - 2 s) first curves upwards and has its maximum, 1, at s = 1: nowhere do bounds from two points cut it off."""
    bounds = []
    for first in np.linspace(0.05, 0.95, 91):
        for last in np.linspace(1.005, 1.2, 40):
            step = last - first
            (a, up), (b, down) = ((s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)) for s in (first, last))
            slack = abs(0.5 * (up + down) * step - (b - a))
            points = on_curve(first, a, up), on_curve(last, b, down, step)
            bounds.append(path_module._upper_bound(*points, slack, at_floor=False) or 0.0)
    assert min(bounds) >= 1.0
    tangents = on_curve(0.2, 0.104, 0.96), on_curve(1.01, 0.999698, -0.0606, 0.81)
    assert path_module._upper_bound(*tangents, 0.0, at_floor=False) is None  # they meet below the second point


def test_a_fall_to_another_branch_is_a_limit_once_it_is_looked_at_closely() -> None:
    """λ = s up to 1, where it drops to a branch that rises as well: two points tell a limit between them only at the floor."""
    before, after = on_curve(0.95, 0.95, 1.0), on_curve(1.05, 0.5, 0.1, 0.1)
    assert path_module._upper_bound(before, after, 0.0, at_floor=False) is None
    assert path_module._upper_bound(before, after, 0.0, at_floor=True) == pytest.approx(1.05)


def test_a_wrinkling_tube_is_followed_in_growing_steps() -> None:
    """Where a step took few iterations the next one is longer: otherwise a collapse would cost thousands."""
    result = run(beam(0.03, 18.0, 1))
    assert result.outcome == "finished"
    assert sum(step.iterations for step in result.steps) < 1000


def test_a_path_is_told_how_far_its_tangents_and_its_secant_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two points of a tent's path both are known: 1.2 λ = borne(1 - w), where the tip is at -w."""
    seen: list[tuple[float, float]] = []

    def follow(path: Path, start: PathPoint, target: float, *, see: Any, **more: Any) -> PathEnd:
        point, _ = path.step(start, start.length_for(0.5))
        assert point is not None
        seen.append((float(-point.position[0, 2]), see(start, point).slack))
        return PathEnd("lost", start, None, iterations=0)

    monkeypatch.setattr(load_step, "follow", follow)
    tent().run(loads(tent=1.2), solver={"max_cuts": 0})
    ((sink, slack),) = seen
    tangents = 0.5 * 1.5 * np.sqrt(3.0) * (2.0 + 3.0 * (1.0 - sink) ** 2 - 1.0) / 1.2
    assert slack == pytest.approx(abs(tangents * sink - borne(1.0 - sink) / 1.2), rel=1e-3)


@pytest.mark.parametrize("times", [50.0, 2000.0])
def test_a_limit_far_below_the_aim_is_found(times: float) -> None:
    """Of an aim thousands of times too high the limit is a small share, at which nearly nothing acts, by the aim's measure."""
    result = tent().run(loads(tent=times))
    assert result.outcome == "collapse"
    limit = result.steps[-1].limit
    assert limit is not None
    lower, upper = limit["load.tent"]
    assert lower <= 1.0 + 1e-5
    assert upper >= 1.0
    assert upper - lower <= 2e-3 * times
