"""What became of a refinement, once the run on the refined mesh is done."""

from __future__ import annotations

from dataclasses import replace

from taichi_membrane.simulation.accuracy import Adaption
from taichi_membrane.simulation.results import RunResult


def judged(adaption: Adaption | None, result: RunResult) -> Adaption | None:
    """The verdict where the run on the refined mesh is done: it has to end in the state that the mesh was refined for."""
    if adaption is None or not adaption.reached:
        return adaption
    last, steps = adaption.rounds[-1], result.stage_steps
    if result.outcome != "finished" or not steps:
        told = steps[-1].reason if steps else "the run was stopped before its first load step"
        return replace(adaption, verdict="not run to its end", told=told)
    value = steps[-1].probes[adaption.probe]
    if abs(value - last.value) > last.allowed:
        told = f"the run on the refined mesh ends at {adaption.probe} = {value:.6g}, its refinement at {last.value:.6g}"
        return replace(adaption, verdict="another state", told=told)
    return adaption
