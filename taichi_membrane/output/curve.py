"""The quantities that a curve over the load steps may have on its axes."""

from __future__ import annotations

from taichi_membrane.scene import Curve, Scene
from taichi_membrane.scene.units import load_unit
from taichi_membrane.simulation.results import RunResult, StepResult


def quantity_names(scene: Scene) -> list[str]:
    """Probes, ``volume``, ``pressure.NAME``, ``load.NAME`` and ``motion.NAME`` of a scene."""
    acting = {"pressure": list(scene.pressures), "load": list(scene.loads), "motion": list(scene.motions)}
    factors = [f"{kind}.{name}" for kind, names in acting.items() for name in names]
    return list(dict.fromkeys([*scene.probes, "volume", *factors]))


def factor_unit(scene: Scene, name: str) -> str:
    """What follows a load's factor in text: its unit, or that it multiplies the direction."""
    unit = load_unit(scene, name)
    return f" {unit}" if unit else " × direction"


def curve_steps(result: RunResult, curve: Curve) -> list[StepResult]:
    """Converged steps that a curve shows: all, or those of its stage with the state before it."""
    steps = [step for step in result.steps if step.converged]
    inside = [number for number, step in enumerate(steps) if curve.stage in (None, step.stage)]
    if curve.stage is None or not inside:
        return [steps[number] for number in inside]
    return steps[max(inside[0] - 1, 0) : inside[0]] + [steps[number] for number in inside]
