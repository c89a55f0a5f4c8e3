"""Writes what a study found: a table for programs, one for people, and everything as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taichi_membrane.output.atomic import replacing
from taichi_membrane.study.analyse import Convergence, Row, Study
from taichi_membrane.study.plan import RUN_DEFAULTS
from taichi_membrane.study.runner import RUNS, Run

FORMAT, FORMAT_VERSION = "taichi_membrane study", 1
PHASES = ("setup", "start", "compile", "solve", "output")


def write_tables(study: Study, directory: Path) -> list[Path]:
    """Write ``study.csv``, ``study.json`` and ``study.md``, each whole or not at all; returns the files.

    :raises InputError: one of them cannot be written.
    """
    contents = {"study.csv": _csv(study), "study.json": _json(study), "study.md": _markdown(study)}
    for name, text in contents.items():
        with replacing(directory / name) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="\n")
    return [directory / name for name in contents]


def _csv(study: Study) -> str:
    """A row per run and probe; errors are relative, times in seconds, empty where there is no number."""
    records = [_flat(study, row) for row in study.rows]
    text = io.StringIO()
    table = csv.DictWriter(text, list(records[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(records)
    return text.getvalue()


def _flat(study: Study, row: Row) -> dict[str, object]:
    run, case = row.run, row.run.case
    return {
        "run": case.identity,
        **case.varied,
        "triangles": case.tri_count,
        **{key: value for key, value in case.settings.items() if key in RUN_DEFAULTS},
        "jobs": run.jobs,
        "status": run.status,
        "probe": row.probe,
        "unit": study.plan.unit(row.probe),
        "value": row.value,
        "reference": row.reference,
        "error": row.error,
        "iteration_error": row.iteration_error,
        "discretisation_error": row.discretisation_error,
        "pareto": row.pareto,
        **{f"{phase}_s": run.seconds.get(phase) for phase in PHASES},
        "wall_s": run.wall_seconds,
        "iterations": run.iterations,
        "residual": run.residual,
        "peak_memory_MiB": run.peak_memory,
        "reason": run.reason,
    }


def _json(study: Study) -> str:
    plan = study.plan
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "scene": str(plan.path),
        "varied": list(plan.varied),
        "fixed": dict(plan.cases[0].fixed),
        "probes": {probe: plan.unit(probe) for probe in plan.probes},
        "reference": dict(plan.reference) if isinstance(plan.reference, Mapping) else plan.reference,
        "runs": [_run_record(run) for run in study.runs],
        "measurements": [_row_record(row) for row in study.rows],
        "convergence": [_convergence_record(item) for item in study.convergences],
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _run_record(run: Run) -> dict[str, Any]:
    case = run.case
    return {
        "run": case.identity,
        "folder": f"{RUNS}/{case.identity}",
        "settings": case.settings,
        "sequence": case.sequence,
        "triangles": case.tri_count,
        "stage": case.stage,
        "stage_step": case.step,
        **{key: value for key, value in vars(run).items() if key not in ("case", "probes")},
    }


def _row_record(row: Row) -> dict[str, Any]:
    return {"run": row.run.case.identity, **{key: value for key, value in vars(row).items() if key != "run"}}


def _convergence_record(item: Convergence) -> dict[str, Any]:
    return {
        "probe": item.probe,
        "sequence": item.sequence,
        "reference": item.reference,
        "origin": item.origin,
        "fitted_order": item.fitted_order,
        "observed_order": item.observed_order,
        "extrapolation": None if item.extrapolation is None else asdict(item.extrapolation),
        "no_extrapolation": item.no_extrapolation,
        "meshes": [
            {
                "run": point.run.case.identity,
                "mesh": point.run.case.mesh,
                "triangles": point.run.case.tri_count,
                "size": point.run.case.size,
                "value": point.value,
                "discretisation_error": point.error,
            }
            for point in item.meshes
        ],
    }


def _markdown(study: Study) -> str:
    plan = study.plan
    case = plan.cases[0]
    parts = [f"# Error against run time: {case.scene.name}", f"{len(study.runs)} runs of `{plan.path.name}`."]
    if case.fixed:
        parts.append("Set for all: " + ", ".join(f"`{key}={value}`" for key, value in case.fixed.items()) + ".")
    parts += [
        "Errors are relative: *error* against the reference, *iteration* against the most exact run on the same mesh, "
        "*discretisation* of that run against the reference. A star marks the Pareto front of error and set-up + solve time, "
        "against one given reference of all kinds of meshes and elements. "
        "*Compile* has the start of Taichi in it; Taichi's cache on disk is off, so that every run compiles everything.",
    ]
    jobs = max(run.jobs for run in study.runs)
    if jobs > 1:
        parts.append(f"Up to {jobs} runs shared the machine: their times are not those of a run alone.")
    for item in study.convergences:
        rows = [row for row in study.rows if (row.probe, row.run.case.sequence) == (item.probe, item.sequence)]
        parts += [f"## {title(item, plan.unit(item.probe))}", convergence_text(item), _table(rows)]
    return "\n\n".join(parts) + "\n"


def title(item: Convergence, unit: str) -> str:
    """Name of a probe with its unit, and its sequence where there is more than one."""
    return f"{item.probe}{f' [{unit}]' if unit else ''}" + (f", {item.sequence}" if item.sequence else "")


def convergence_text(item: Convergence) -> str:
    """Reference and observed orders in a sentence."""
    reference = "none" if item.reference is None else f"{item.reference:.8g}"
    words = [f"Reference {reference} ({item.origin})."]
    if item.reference == 0:
        words.append("Relative errors against zero are not defined.")
    if item.fitted_order is not None:
        words.append(f"Order fitted to the discretisation errors: {item.fitted_order:.2f}.")
    if item.extrapolation is not None:
        found = item.extrapolation
        words.append(f"Richardson on the three finest meshes: order {found.order:.2f}, limit {found.value:.8g}.")
    else:
        words.append(f"No limit by extrapolation: {item.no_extrapolation}.")
    return " ".join(words)


def _table(rows: Sequence[Row]) -> str:
    header = ["triangles", "settings", "value", "error", "iteration", "discretisation", "set-up s", "compile s"]
    header += ["solve s", "output s", "iterations", "peak MiB", "Pareto"]
    lines = [header, ["--:", "---", *["--:"] * 10, ":-:"]]
    for row in sorted(rows, key=lambda row: row.run.case.tri_count):
        run, seconds = row.run, row.run.seconds
        compiled = [seconds[phase] for phase in ("start", "compile") if phase in seconds]
        lines.append(
            [str(run.case.tri_count), f"`{run.case.label}`"]
            + [f"{row.value:.8g}" if row.value is not None else f"**{run.status}**"]
            + [_scientific(value) for value in (row.error, row.iteration_error, row.discretisation_error)]
            + [_time(seconds.get("setup")), _time(sum(compiled) if compiled else None)]
            + [_time(seconds.get("solve")), _time(seconds.get("output"))]
            + [str(run.iterations), f"{run.peak_memory:.0f}", "★" if row.pareto else ""]
        )
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    failed = [f"- `{row.run.case.label}`: {row.run.status}: {row.run.reason}" for row in rows if row.run.reason]
    return "\n\n".join([table, *(["\n".join(failed)] if failed else [])])


def _scientific(value: float | None) -> str:
    return "" if value is None else f"{value:.2e}"


def _time(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.3g}"
