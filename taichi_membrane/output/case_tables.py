"""Load cases in tables, files and the summary: verdicts, ranges over the cases, support forces, envelopes."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import fields
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.tables import Column, number_column
from taichi_membrane.output.vtu import write_vtu
from taichi_membrane.scene.drivers import driver_names
from taichi_membrane.simulation.cases import Number, Range, envelope, numbers, ranges
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.reactions import support_forces
from taichi_membrane.simulation.results import CaseResult, RunResult

CASES, ENVELOPE = "cases.csv", "envelope.vtu"
_NONE = "-"


def case_columns(result: RunResult) -> list[Column]:
    """The table of cases: verdict, reason, and of those that were reached the numbers that are not the same in all."""
    cases = list(result.cases.values())
    columns = [
        Column("case", [case.name for case in cases]),
        Column("after", [case.after for case in cases], rank=1),
        Column("verdict", [case.verdict if case.reached else case.verdict.upper() for case in cases]),
    ]
    held = {case.name: numbers(result, case) for case in cases}
    scene = result.scene
    shown = [
        *scene.probes,
        *_changing(result),
        *(("largest utilisation",) if "utilisation" in scene.extra_fields else ()),
    ]
    shown += ["largest major resultant", "slack share"]
    for name in dict.fromkeys(shown):
        there = {case.name: held[case.name][name] for case in cases if name in held[case.name]}
        unit = next((number.unit for number in there.values()), "")
        column = number_column(name, unit, [number.value for number in there.values()])
        cells = dict(zip(there, column.cells, strict=True))
        important = name in scene.probes or name == "largest utilisation"
        columns.append(
            replace(column, cells=[cells.get(case.name, _NONE) for case in cases], rank=0 if important else 1)
        )
    return columns


def _changing(result: RunResult) -> list[str]:
    """Drivers that some case changes."""
    ends = [case.end for case in result.cases.values() if case.end is not None]
    return [name for name in driver_names(result.scene) if len({end.drivers[name] for end in ends}) > 1]


def range_columns(result: RunResult) -> list[Column]:
    """The worst cases: least and largest of each quantity over the cases that were reached, but support forces."""
    kept = set(driver_names(result.scene)) - set(_changing(result))
    found = [one for one in ranges(result) if not one.quantity.startswith("reaction of ") and one.quantity not in kept]
    return [
        Column("quantity", [one.quantity for one in found]),
        Column("least", [_told(one.least, one) for one in found]),
        Column("in", [one.least_case for one in found]),
        Column("largest", [_told(one.largest, one) for one in found]),
        Column("in", [one.largest_case if _vary(one) else "all" for one in found]),
    ]


def _vary(one: Range) -> bool:
    return one.least.value != one.largest.value


def _told(number: Number, among: Range) -> str:
    """A number with its place; what is round-off beside the other end of its range is 0."""
    (value,) = number_column("", "", [number.value, among.least.value, among.largest.value]).cells[:1]
    place = f" ({number.place})" if number.place else ""
    return f"{f'{value} {number.unit}'.rstrip()}{place}"


def reaction_columns(result: RunResult) -> list[Column]:
    """Support forces of each held group at the end of each case that was reached, anchors among them."""
    rows = [
        (name, group, total)
        for name, case in result.cases.items()
        if case.end is not None
        for group, total in support_forces(result.scene, result.mesh, case.end).items()
    ]
    vectors = np.array([total for _, _, total in rows]).reshape(-1, 3)
    parts = [*vectors.T.tolist(), np.linalg.norm(vectors, axis=1).tolist()]
    force = result.scene.units.force
    return [
        Column("case", [name for name, _, _ in rows]),
        Column("support", [group for _, group, _ in rows]),
        *(number_column(name, force, values) for name, values in zip(("x", "y", "z", "size"), parts, strict=True)),
    ]


def worst_reaction_columns(result: RunResult) -> list[Column]:
    """The largest force of each support over the cases as a vector, and the range of its vertical part."""
    found = {one.quantity: one for one in ranges(result)}
    groups = [name.removeprefix("reaction of ").removesuffix(", size") for name in found if name.endswith(", size")]
    largest = [found[f"reaction of {group}, size"] for group in groups]
    at = [numbers(result, result.cases[one.largest_case]) for one in largest]
    parts = [
        [held[f"reaction of {group}, {axis}"].value for group, held in zip(groups, at, strict=True)] for axis in "xyz"
    ]
    upright = [found[f"reaction of {group}, z"] for group in groups]
    force = result.scene.units.force
    return [
        Column("support", groups),
        number_column("largest", force, [one.largest.value for one in largest]),
        *(number_column(axis, force, values) for axis, values in zip("xyz", parts, strict=True)),
        Column("in", [one.largest_case for one in largest]),
        number_column("least z", force, [one.least.value for one in upright]),
        Column("in", [one.least_case for one in upright]),
        number_column("largest z", force, [one.largest.value for one in upright]),
        Column("in", [one.largest_case for one in upright]),
    ]


def write_cases(result: RunResult, directory: Path) -> list[Path]:
    """Write cases.csv, and envelope.vtu where a case was reached."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    held = {name: numbers(result, case) for name, case in result.cases.items()}
    units = {quantity: number.unit for values in held.values() for quantity, number in values.items()}
    heads = [f"{quantity} [{unit}]" if unit else quantity for quantity, unit in units.items()]
    table.writerow(["case", "title", "after", "verdict", "reason", "load_steps", *heads])
    for name, case in result.cases.items():
        first = [name, case.title, case.after, case.verdict, case.reason, len(case.steps)]
        values = [held[name][quantity].value if quantity in held[name] else "" for quantity in units]
        table.writerow([*first, *values])
    with replacing(directory / CASES) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    return [directory / CASES, *_write_envelope(result, directory)]


def _write_envelope(result: RunResult, directory: Path) -> list[Path]:
    """Largest values over the cases, element by element, on the shape that displacements are counted from."""
    found = envelope(result)
    if found is None:
        return []
    cells: dict[str, NDArray[Any]] = {fields.named(name).arrays[0]: values for name, values in found.values.items()}
    cells |= {"governing_case": found.governing, "slack_in_any": found.slack.astype(np.int8)}
    lines, owner = line_elements(result.scene, result.mesh)
    with replacing(directory / ENVELOPE) as temporary:
        write_vtu(temporary, result.mesh, lines, {}, cells, {"cable": owner})
    return [directory / ENVELOPE]


def case_records(result: RunResult) -> dict[str, Any]:
    """The summary's part: each case with verdict and numbers, the worst case of each quantity, what envelope.vtu numbers."""
    found = envelope(result)
    return {
        "cases": [_record(result, case) for case in result.cases.values()],
        "case_ranges": {
            one.quantity: {
                "unit": one.least.unit,
                "least": one.least.value, "least_case": one.least_case,
                "largest": one.largest.value, "largest_case": one.largest_case,
            }
            for one in ranges(result)
        },
        "envelope_cases": None if found is None else found.cases,
    }  # fmt: skip


def _record(result: RunResult, case: CaseResult) -> dict[str, Any]:
    scene, end = result.scene, case.end
    return {
        "name": case.name,
        "title": case.title,
        "after": case.after,
        "verdict": case.verdict,
        "reason": case.reason,
        "load_steps": [step.number for step in case.steps],
        "numbers": {
            name: {"value": one.value, "unit": one.unit, **({"place": one.place} if one.place else {})}
            for name, one in numbers(result, case).items()
        },
        "reactions": None
        if end is None
        else {group: total.tolist() for group, total in support_forces(scene, result.mesh, end).items()},
    }


def failed_lines(result: RunResult) -> list[str]:
    """Each case whose loads are not reached, and why."""
    return [
        f"{case.verdict.upper()}: case {name}: {case.reason}" for name, case in result.cases.items() if not case.reached
    ]
