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
    """Converged steps that a curve shows: all of stages, or those of its stage or case with the state before it."""
    if curve.stage is None:
        return [step for step in result.stage_steps if step.converged]
    inside = [step for step in result.steps if step.converged and step.stage == curve.stage]
    start = result.start(curve.stage) if inside else None
    return inside if start is None else [start, *inside]
