"""Runs verdict cases through the public way in, and examines what they leave."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import Any

import taichi_membrane as tm
from taichi_membrane.assurance.stability.bracket import brackets
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts import oracle
from taichi_membrane.assurance.verdicts.case import Case, Finding, State
from taichi_membrane.errors import InputError
from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.load_state import stage_targets
from taichi_membrane.simulation.model import build_model
from taichi_membrane.simulation.results import RunResult, StepResult


def scene_of(problem: Problem) -> Scene:
    """The problem's scene; names and units matter to none of them."""
    return Scene.model_validate({"name": "case", "units": {"length": "m", "force": "N"}, **problem.scene})


def run(case: Case, steps: int, *, threads: int | None = None) -> Finding:
    """Run a case in a number of load steps, in this process; all cores when ``threads`` is None."""
    started = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            problem = case.problem(steps)
            result = tm.run(scene_of(problem), mesh=problem.mesh, render=False, threads=threads)
        except InputError as error:
            return Finding(case=case.name, steps=steps, refused=str(error))
        except Exception as error:
            return Finding(case=case.name, steps=steps, crashed=f"{type(error).__name__}: {error}")
    seconds = time.perf_counter() - started
    warned = tuple(dict.fromkeys(f"{one.category.__name__}: {one.message}" for one in caught))
    return finding(case, steps, problem, result, seconds, warned)


def finding(
    case: Case, steps: int, problem: Problem, result: RunResult, seconds: float, warned: Sequence[str] = ()
) -> Finding:
    """What a run said of itself, and what its states are."""
    last = result.steps[-1]
    reached = result.outcome in ("finished", "no collapse") and last.limit is None
    return Finding(
        case=case.name,
        steps=steps,
        outcome=result.outcome,
        passed=result.passed,
        reason=last.reason,
        limits=last.limit,
        targets={one.name: one.target for one in brackets(result.scene, last, {})},
        followed=next(stage for stage in result.scene.stages if stage.name == last.stage).control == "arc_length",
        at_target=_at_target(result.scene, last),
        snapped=any("snap" in word for word in _words(result.steps)),
        states=examined(case, result),
        values=dict(problem.measure(result.mesh, result.steps)) if reached else {},
        exact=dict(problem.exact),
        iterations=sum(step.iterations for step in result.steps),
        seconds=seconds,
        warned=tuple(warned),
    )


def _words(steps: Sequence[StepResult]) -> list[str]:
    """What the steps tell of how they went."""
    return [f"{step.reason} {getattr(step, 'trace', '')}".lower() for step in steps]


def _at_target(scene: Scene, last: StepResult) -> bool:
    """Whether a step has its stage's loads; pressures of shut chambers follow their volume."""
    index = [stage.name for stage in scene.stages].index(last.stage)
    target, shut = stage_targets(scene)[index], shut_by(scene, scene.stages[index])
    pressures = {name: value for name, value in target.pressures.items() if name not in shut}
    there = [(pressures, last.pressures), (target.loads, last.loads), (target.motions, last.motions)]
    complete = index == len(scene.stages) - 1
    return complete and all(
        abs(has[name] - value) <= 1e-12 * abs(value) for asked, has in there for name, value in asked.items()
    )


def examined(case: Case, result: RunResult) -> tuple[State, ...]:
    """The last state of each stage, taken anew."""
    from taichi_membrane.simulation import analysis

    model = build_model(result.scene, result.mesh)
    work: Any = analysis.ready(model)
    last = {step.stage: step for step in result.steps}
    return tuple(oracle.examine(work, model, step, potential=case.potential) for step in last.values())
