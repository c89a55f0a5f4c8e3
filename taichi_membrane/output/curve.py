"""The quantities that a curve over the load steps may have on its axes."""

from __future__ import annotations

from taichi_membrane.scene import Curve, Scene
from taichi_membrane.scene.units import load_unit, motion_unit, probe_unit
from taichi_membrane.simulation.results import RunResult, StepResult


def quantity_names(scene: Scene) -> list[str]:
    """Probes, ``volume``, ``pressure.NAME``, ``load.NAME`` and ``motion.NAME`` of a scene."""
    acting = {"pressure": list(scene.pressures), "load": list(scene.loads), "motion": list(scene.motions)}
    factors = [f"{kind}.{name}" for kind, names in acting.items() for name in names]
    return list(dict.fromkeys([*scene.probes, "volume", *factors]))


def quantity_value(step: StepResult, quantity: str) -> float:
    """A quantity at a load step; ``pressure`` alone is the first one's. A probe goes before all else of its name."""
    if quantity in step.probes:
        return step.probes[quantity]
    if quantity == "volume":
        return step.volume
    kind, _, name = quantity.partition(".")
    if kind == "pressure":
        return step.pressures[name or next(iter(step.pressures))]
    return step.motions[name] if kind == "motion" else step.loads[name]


def quantity_label(scene: Scene, quantity: str) -> str:
    """Name and unit of a quantity, for an axis."""
    kind, _, name = quantity.partition(".")
    if quantity in scene.probes:
        unit = probe_unit(scene, quantity)
        return f"{quantity.replace('_', ' ')} [{unit}]" if unit else quantity.replace("_", " ")
    if quantity == "volume":
        return f"volume [{scene.units.volume}]"
    if kind == "pressure":
        return f"pressure{' ' + name if name else ''} [{scene.units.stress}]"
    unit = motion_unit(scene, name) if kind == "motion" else factor_unit(scene, name).strip()
    return f"{kind} {name} [{unit}]"


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
