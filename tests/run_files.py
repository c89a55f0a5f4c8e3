"""Made-up runs for the tests of the files of a run: every number differs in every bit, no engine is needed."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane import fields as tables
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import Outcome
from taichi_membrane.output.writer import Writer
from taichi_membrane.scene import Scene
from taichi_membrane.shapes import panel
from taichi_membrane.simulation.results import (
    CheckResult,
    ModeResult,
    RunResult,
    Settings,
    StepResult,
)
from taichi_membrane.simulation.state import PathState, State

SCENE = Scene.model_validate(
    {
        "name": "strip",
        "title": "Ä strip <&>",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "panel", "width": 3.0, "height": 2.0, "along_x": 3, "along_y": 2},
        "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.5},
        "supports": [{"group": "x_min", "hold": "xyz"}],
        "loads": {
            "pull": {"group": "x_max", "direction": [1, 0, 0]},
            "wind": {"group": "all", "direction": [0, 0, 2], "kind": "area"},
            "seam": {"group": "x_max", "direction": [0, 0, 1], "kind": "line"},
        },
        "stages": [{"name": "load", "steps": 3, "loads": {"pull": 3.0}}],
        "probes": {
            "tip": {"kind": "displacement", "group": "x_max", "component": "x"},
            "foot": {"kind": "reaction", "group": "x_min", "component": "x"},
            "girth": {"kind": "radius", "group": "x_max", "axis": "x"},
            "volume": {"kind": "volume"},
            "peak": {"kind": "stress"},
            "wrinkled": {"kind": "area_share"},
        },
    }
)


def a_mesh() -> Mesh:
    """A small panel with groups whose names XML and file names would trip over."""
    plain = panel(width=3.0, height=2.0, along_x=3, along_y=2)
    awkward = {'a "b" <c> & ü:/%': [0, 1]}
    return Mesh.build(
        plain.points, plain.triangles, {**plain.node_groups, **awkward}, {**plain.tri_groups, **awkward}, plain.tri_warp
    )


MESH = a_mesh()
SETTINGS = Settings(precision="f32", threads=2, render=False)
PROVENANCE = {"arch": "x64", "threads": 2}
DRIVERS = {"pressure.inside": 0.0, "load.pull": 1.0 / 3.0, "load.wind": 0.0, "load.seam": -2e-300}
FABRIC = np.arange(MESH.tri_count, dtype=np.int32) % 2


def a_step(number: int, **changes: Any) -> StepResult:
    """A step with numbers that differ in every bit (seeded by the step's number)."""
    rng = np.random.default_rng(number)
    m = MESH.tri_count
    values = {one.name: rng.normal(size=one.shape(MESH.node_count, m)) for one in tables.of(())}
    values["state"] = rng.integers(0, 3, m).astype(np.int8)
    modes = ModeResult(kind="vibration", values=(1.0 / 3.0, 2.0), shapes=rng.normal(size=(2, MESH.node_count, 3)))
    step = StepResult(
        number=number,
        stage="load",
        stage_step=number + 1,
        drivers=DRIVERS | {"pressure.inside": 0.1 * number},
        fields=values,
        probes=dict(zip(SCENE.probes, map(float, rng.normal(size=6)), strict=True)),
        volume=1.5,
        energy=-2.5,
        solver="relaxation",
        converged=True,
        reason="residual, with a comma",
        iterations=12,
        residual=1e-7,
        cuts=0,
        negative_pivots=number,
        limit={"load.pull": (1.0 / 3.0, 0.5)} if number else None,
        derivatives={"tip": {"load.pull": 1.0 / 3.0}} if number else {},
        modes=modes if number else None,
        unknown={"modes": "the scene asks for none here"} if not number else {},
        state=State(
            displacement=values["displacement"],
            drivers=DRIVERS | {"pressure.inside": 0.1 * number},
            stiffest=1.0 / 3.0,
            let_out={"inside": 1.0 / 7.0} if number else {},
            path=PathState(
                factor=1.0 / 3.0,
                tangent=rng.normal(size=(MESH.node_count, 3)),
                advance=rng.normal(size=(MESH.node_count, 3)),
                negative=1,
                length=2.0 / 7.0,
            )
            if number
            else None,
        ),
        seconds=0.25,
    )
    return replace(step, **changes)


def with_fields(step: StepResult, **values: Any) -> StepResult:
    """The step with other values of some fields."""
    return replace(step, fields={**step.fields, **values})


def a_writer(directory: Path) -> Writer:
    return Writer(directory, SCENE, MESH, settings=SETTINGS, provenance=PROVENANCE, tri_fabric=FABRIC)


def a_result(steps: list[StepResult], directory: Path) -> RunResult:
    check = CheckResult(
        probe="tip", stage="load", step=3, value=None, reference=1.0, error=None, tolerance=0.1, relative=True,
        source="bar", passed=False,
    )  # fmt: skip
    whole = len(steps) == 3
    outcome: Outcome = "not converged" if not steps[-1].converged else "finished" if whole else "interrupted"
    return RunResult(
        scene=SCENE, mesh=MESH, steps=tuple(steps), checks=(check,), seconds={"compile": 1.0}, provenance={},
        outcome=outcome, directory=directory,
    )  # fmt: skip


def a_run(directory: Path, steps: list[StepResult]) -> list[Path]:
    writer = a_writer(directory)
    for step in steps:
        writer.write_step(step, {"solve": 1.0})
    return writer.finish(a_result(steps, directory))


def outcome(directory: Path) -> dict[str, Any]:
    """All files of a run without what the clock says: the bytes of each, the rows of the history, the summary's content."""
    files: dict[str, Any] = {path.name: path.read_bytes() for path in directory.iterdir()}
    if "history.csv" in files:
        rows = list(csv.DictReader(io.StringIO(files["history.csv"].decode())))
        files["history.csv"] = [{key: value for key, value in row.items() if key != "seconds"} for row in rows]
    summary = json.loads(files["summary.json"])
    for record in [summary, *summary["steps"]]:
        del record["seconds"]
    del summary["sha256"]
    files["summary.json"] = json.dumps(summary)  # as text, so that the order of keys counts
    return files


def different(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Names of the files in which two outcomes differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def same(a: Any, b: Any) -> bool:
    """Equal to the last bit, arrays, records and NaN included."""
    if isinstance(a, StepResult | ModeResult | State | PathState):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    return bool(a == b) or (a != a and b != b)
