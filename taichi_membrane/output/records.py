"""What the summary of a run has of each load step, beside its arrays, and of the fields."""

from __future__ import annotations

from typing import Any

from taichi_membrane import fields
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.simulation.state import State


def record(step: StepResult, file: str, checksum: str) -> dict[str, Any]:
    """A load step in the summary: all but its arrays."""
    scalars = {key: value for key, value in vars(step).items() if key not in ("fields", "modes", "trace", "state")}
    modes = (
        None
        if step.modes is None
        else {
            "kind": step.modes.kind,
            "values": step.modes.values,
            "missing": step.modes.missing,
        }
    )
    trace = [[one.event, one.share] for one in step.trace]
    return {
        **scalars,
        "stable": step.stable,
        "trace": trace,
        "state": _state_record(step.state),
        "modes": modes,
        "element_states": step.elements.count(),
        "file": file,
        "sha256": checksum,
    }


def _state_record(state: State) -> dict[str, Any]:
    """What a load step hands on, but its displacements and drivers, which stand beside it, and the arrays of path and friction."""
    path = state.path
    scalars = None if path is None else {"factor": path.factor, "negative": path.negative, "length": path.length}
    return {
        "stiffest": state.stiffest, "let_out": state.let_out, "path": scalars, "friction": len(state.friction),
        "walls": state.touched is not None,
    }  # fmt: skip


def field_notes(scene: Scene, *, cables: bool) -> dict[str, dict[str, Any]]:
    """What the arrays of a step's file mean, those of cables where there are some."""
    return {
        field.name: {
            "arrays": field.arrays,
            "place": field.place,
            "meaning": field.words(scene.field_units),
            "unit": getattr(scene.field_units, field.unit) if field.unit else "",
            **({"measure": f"{field.measure}: {fields.MEASURES[field.measure]}"} if field.measure else {}),
        }
        for field in fields.of(scene.extra_fields)
        if cables or field.place != "cable"
    }
