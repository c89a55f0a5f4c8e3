"""The quantities that a curve over the load steps may have on its axes."""

from __future__ import annotations

from taichi_membrane.scene import Curve, Scene
from taichi_membrane.scene.drivers import driver_label, driver_names
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.results import RunResult, StepResult


def quantity_names(scene: Scene) -> list[str]:
    """Probes, ``volume`` and the drivers of a scene."""
    return list(dict.fromkeys([*scene.probes, "volume", *driver_names(scene)]))


def quantity_label(scene: Scene, quantity: str) -> str:
    """Name and unit of what a curve plots, for an axis."""
    if quantity in scene.probes:
        words, unit = quantity.replace("_", " "), probe_unit(scene, quantity)
    elif quantity == "volume":
        words, unit = quantity, scene.units.volume
    elif quantity == "pressure":
        words, unit = quantity, scene.units.stress
    else:
        words, unit = quantity.replace(".", " "), driver_label(scene, quantity)
    return f"{words} [{unit}]" if unit else words


def curve_steps(result: RunResult, curve: Curve) -> list[StepResult]:
    """Converged steps that a curve shows: all, or those of its stage with the state before it."""
    steps = [step for step in result.steps if step.converged]
    inside = [number for number, step in enumerate(steps) if curve.stage in (None, step.stage)]
    if curve.stage is None or not inside:
        return [steps[number] for number in inside]
    return steps[max(inside[0] - 1, 0) : inside[0]] + [steps[number] for number in inside]
