"""What load cases come to: the numbers of each at its end, their ranges over all cases, and envelopes element by element.

A case whose loads are not reached, or whose state is unstable, has a verdict and a reason and no numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taichi_membrane.arrays import Floats
from taichi_membrane.names import SLACK, STATE_NAMES
from taichi_membrane.scene.drivers import driver_names, driver_unit
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.reactions import support_forces
from taichi_membrane.simulation.results import CaseResult, RunResult, StepResult

# Element fields whose largest value over the cases an envelope has; of shear the largest size.
ENVELOPED = ("utilisation", "major_resultant", "warp_resultant", "weft_resultant", "shear_resultant")


@dataclass(frozen=True)
class Number:
    """A number of a case, with its unit; ``place`` says where it is, of one that is somewhere."""

    value: float
    unit: str
    place: str = ""


@dataclass(frozen=True)
class Range:
    """Least and largest value of a quantity over the cases that have it, and the names of the cases."""

    quantity: str
    least: Number
    least_case: str
    largest: Number
    largest_case: str


@dataclass(frozen=True, eq=False)
class Envelope:
    """Extremes over the ends of all cases that were reached, element by element.

    :param cases: their names.
    :param values: (m,) largest value of each of :data:`ENVELOPED` that the run has, by name; of shear the largest size.
    :param governing: (m,) number in ``cases`` of the one that uses most of the strength, or has the largest major resultant.
    :param slack: (m,) whether the element is slack in any of them.
    """

    cases: tuple[str, ...]
    values: dict[str, Floats]
    governing: np.ndarray[tuple[int], np.dtype[np.int32]]
    slack: np.ndarray[tuple[int], np.dtype[np.bool_]]


def numbers(result: RunResult, case: CaseResult) -> dict[str, Number]:
    """The numbers of a case at its end, by name: probes, drivers, extremes, cable and support forces; none where it has no end."""
    return {} if case.end is None else dict(_numbers(result, case.end))


def ranges(result: RunResult) -> list[Range]:
    """Least and largest of every number over the cases that have it."""
    of_case = {name: numbers(result, case) for name, case in result.cases.items()}
    quantities = dict.fromkeys(quantity for held in of_case.values() for quantity in held)
    found = []
    for quantity in quantities:
        held = [(name, values[quantity]) for name, values in of_case.items() if quantity in values]
        low, high = min(held, key=lambda one: one[1].value), max(held, key=lambda one: one[1].value)
        found.append(Range(quantity, low[1], low[0], high[1], high[0]))
    return found


def envelope(result: RunResult) -> Envelope | None:
    """Extremes over the ends of all cases that were reached; None where none was."""
    ends = [(name, case.end) for name, case in result.cases.items() if case.end is not None]
    if not ends:
        return None
    steps = [step for _, step in ends]
    names = [name for name in ENVELOPED if name in steps[0].fields]
    held = {name: np.stack([step.fields[name] for step in steps]) for name in names}
    values = {name: (np.abs(all_) if name == "shear_resultant" else all_).max(axis=0) for name, all_ in held.items()}
    leading = (
        np.where(np.isnan(held["utilisation"]).any(axis=0), held["major_resultant"], held["utilisation"])
        if ("utilisation" in held)
        else held["major_resultant"]
    )
    return Envelope(
        cases=tuple(name for name, _ in ends), values=values, governing=leading.argmax(axis=0).astype(np.int32),
        slack=np.any([step.fields["state"] == SLACK for step in steps], axis=0),
    )  # fmt: skip


def _numbers(result: RunResult, step: StepResult) -> Iterator[tuple[str, Number]]:
    scene, units = result.scene, result.scene.units
    for name, value in step.probes.items():
        yield name, Number(value, probe_unit(scene, name) if name in scene.probes else "")
    for name in driver_names(scene):
        yield name, Number(step.drivers[name], driver_unit(scene, name))
    yield from _extremes(result, step)
    owner = line_elements(scene, result.mesh)[1]
    for number, name in enumerate(scene.cables):
        force = step.cable_forces[owner == number]
        yield f"force of {name}", Number(float(force.max()), units.force)
        if force.min() != force.max():
            yield f"least force of {name}", Number(float(force.min()), units.force)
    for group, total in support_forces(scene, result.mesh, step).items():
        for axis, part in zip("xyz", total.tolist(), strict=True):
            yield f"reaction of {group}, {axis}", Number(part, units.force)
        yield f"reaction of {group}, size", Number(float(np.linalg.norm(total)), units.force)


def _extremes(result: RunResult, step: StepResult) -> Iterator[tuple[str, Number]]:
    """Largest values over the elements with their places, the largest displacement, and shares of the area."""
    scene, mesh = result.scene, result.mesh
    for name in ENVELOPED:
        values = step.fields.get(name)
        if values is None or not np.isfinite(values).any():
            continue
        size = np.abs(values) if name == "shear_resultant" else values
        element = int(np.nanargmax(size))
        unit = f"{scene.units.resultant} Cauchy" if name.endswith("resultant") else ""
        yield f"largest {name.replace('_', ' ')}", Number(float(size[element]), unit, f"element {element}")
    moved = np.linalg.norm(step.displacement, axis=1)
    yield "largest displacement", Number(float(moved.max()), scene.units.length, f"node {int(moved.argmax())}")
    area = np.bincount(step.elements.state, weights=mesh.tri_areas(), minlength=3)
    for name, share in zip(STATE_NAMES, (area / area.sum()).tolist(), strict=True):
        yield f"{name} share", Number(share, "")
