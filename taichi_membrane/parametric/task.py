"""One trial as a text that goes to a worker, and its result as a text that comes back; nothing else passes between them."""

from __future__ import annotations

import base64
import io
import json
import os
import socket
import sys
import tempfile
import threading
import time
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_membrane.errors import InputError
from taichi_membrane.parametric.plan import Conditions, Trial
from taichi_membrane.scene import MeshFile, Scene

if TYPE_CHECKING:
    from taichi_membrane.simulation.results import RunResult, StepResult

_ONE_RUN = threading.Lock()  # a process has one Taichi: two runs in two of its threads would break each other
_MEBIBYTE = 2**20


def packed(trial: Trial, base: Path, how: Conditions, *, send_mesh: bool, files: str = "") -> str:
    """The text of a trial.

    :param send_mesh: put the mesh file into the text, for a worker that may not see this disk.
    :param files: ``return`` for all files of the run, zipped; or the address of a folder that the worker puts them in.
    """
    mesh, scene = None, trial.scene.model_dump(mode="json")
    if send_mesh and isinstance(trial.scene.mesh, MeshFile):
        path = base / trial.scene.mesh.path
        mesh, scene["mesh"]["path"] = base64.b64encode(path.read_bytes()).decode(), path.name
    task = {
        "scene": scene,
        "mesh": mesh,
        "base": str(base.resolve()),
        "name": trial.fingerprint,
        "files": files,
        **vars(how),
    }
    return json.dumps(task)


def carry_out(text: str) -> str:
    """Run the trial of a text; what comes back is a text in any case, also where the run is refused or breaks off."""
    task = json.loads(text)
    with _ONE_RUN, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        started, processor = time.perf_counter(), time.process_time()
        try:
            found = _found(task, Path(folder))
        except InputError as error:
            found = {"outcome": "refused", "reason": str(error)}
        except Exception as error:  # one trial that breaks off is one row, whatever the cause
            found = {"outcome": "crashed", "reason": f"{type(error).__name__}: {error}"}
        spent = {"processor_seconds": time.process_time() - processor, "wall_seconds": time.perf_counter() - started}
    return json.dumps({**found, **spent, "worker": f"{socket.gethostname()}:{os.getpid()}", "memory": _resident()})


def _found(task: dict[str, Any], folder: Path) -> dict[str, Any]:
    from taichi_membrane.execution.run import run

    scene, base = Scene.model_validate(task["scene"]).without_cases(), Path(task["base"])
    if task["mesh"] is not None and isinstance(scene.mesh, MeshFile):
        base = folder
        (base / scene.mesh.path).write_bytes(base64.b64decode(task["mesh"]))
    out = folder / "run" if task["files"] else None
    how = {key: task[key] for key in ("arch", "precision", "threads")}
    found = recorded(run(scene, base=base, out=out, render=False, **how))
    if out is not None:
        found |= _handed_over(_zipped(out), task["name"], task["files"])
    return found


def recorded(result: RunResult) -> dict[str, Any]:
    """What a row keeps of a run.

    Probes, negative eigenvalues and so on are those of the last load step that converged; the limit is the last one met.
    """
    done = [step for step in result.steps if step.converged]
    last = done[-1] if done else None
    limits = [step.limit for step in done if step.limit is not None]
    ended = result.steps[-1] if result.steps else None
    return {
        "outcome": result.outcome,
        "reason": "" if ended is None or result.converged else f"{ended.stage} {ended.stage_step}: {ended.reason}",
        "passed": result.passed,
        "stage": last and last.stage,
        "stage_step": last and last.stage_step,
        "probes": last.probes if last else {},
        "negative_eigenvalues": last and last.negative_pivots,
        "limit": limits[-1] if limits else None,
        "residual": last and last.residual,
        "iterations": sum(step.iterations for step in result.steps),
        "curve": _curve(result, done),
        "steps": [_step(step) for step in done],
        "provenance": result.provenance,
    }


def _step(step: StepResult) -> dict[str, Any]:
    return {"stage": step.stage, "stage_step": step.stage_step, "probes": step.probes, "derivatives": step.derivatives}


def _curve(result: RunResult, done: list[StepResult]) -> list[list[float]] | None:
    """x and y of the scene's curve, scaled as it says; None where it asks for none."""
    curve = result.scene.curve
    if curve is None or not done:
        return None
    inside = [curve.stage in (None, step.stage) for step in done]
    first = inside.index(True) if True in inside else len(done)
    keep = range(max(first - 1, 0), len(done))
    kept = [k for k in keep if inside[k] or k < first]
    pairs = ((curve.x, curve.x_scale), (curve.y, curve.y_scale))
    return [[float(scale * done[k].quantity(quantity)) for k in kept] for quantity, scale in pairs]


def _zipped(folder: Path) -> bytes:
    """All files of a folder."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:  # .vtu files are compressed already
        for file in sorted(folder.iterdir()):
            archive.write(file, file.name)
    return content.getvalue()


def _handed_over(content: bytes, name: str, files: str) -> dict[str, str]:
    """The zipped files as a text; or, put into a store, their address."""
    if files == "return":
        return {"files": base64.b64encode(content).decode()}
    import fsspec

    address = f"{files.rstrip('/')}/{name}.zip"
    with fsspec.open(address, "wb", auto_mkdir=True) if "://" not in address else fsspec.open(address, "wb") as target:
        target.write(content)
    return {"stored": address}


def _resident() -> float | None:
    """MiB of memory this process holds now; None where the system does not tell."""
    if not sys.platform.startswith("linux"):
        return None
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE
