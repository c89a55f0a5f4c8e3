"""A whole run: scene, mesh, model, load steps, files, pictures, checks."""

from __future__ import annotations

import platform
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision
from taichi_membrane.scene import Camera, Scene
from taichi_membrane.simulation.observer import Clock, Observer, Silent

if TYPE_CHECKING:
    from taichi_membrane.engine.runtime import Runtime
    from taichi_membrane.mesh import Mesh
    from taichi_membrane.output.writer import Writer
    from taichi_membrane.simulation.model import Model
    from taichi_membrane.simulation.results import RunResult


def run(
    scene: Scene,
    *,
    mesh: Mesh | None = None,
    out: Path | None = None,
    base: Path | None = None,
    arch: Arch = "cpu",
    precision: Precision = "f64",
    threads: int | None = None,
    render: bool = True,
    repair: bool = False,
    observer: Observer | None = None,
) -> RunResult:
    """Run a scene and return what it found; write files as the steps are done when ``out`` is given.

    :param mesh: a mesh object for a scene whose mesh is ``{"shape": "given"}``.
    :param out: folder for summary.json, history.csv, step files, curve.png and pictures; nothing is written when None.
    :param base: folder that a relative mesh path starts from; the current one when None.
    :param render: draw pictures and the curve (only with ``out``).
    :param repair: mend a mesh file where that is safe; ``RunResult.mesh.mended`` says what was done.
    :raises InputError: a scene, mesh or back end that cannot be used. A step that does not converge raises nothing: it ends
        the run, and ``RunResult.converged`` says so.
    """
    observer = observer or Silent()
    clock = Clock(observer)
    from taichi_membrane.simulation.model import build_mesh, build_model, with_scene_groups
    from taichi_membrane.simulation.results import RunResult

    with clock.phase("setup", "reading the mesh"):
        mesh = build_mesh(scene, base, repair=repair) if mesh is None else with_scene_groups(scene, mesh)
        model = build_model(scene, mesh)
    with clock.phase("start", "starting Taichi"):
        from taichi_membrane.engine import runtime

        active = runtime.start(arch=arch, precision=precision, threads=threads)
        from taichi_membrane.simulation import analysis, probes
        from taichi_membrane.simulation.equilibrium import solver_kind

        if out is not None and render and not active.on_cpu:
            from taichi_membrane.pictures.driver import check_driver

            check_driver()
    probes.validate(model)
    with clock.phase("setup"):
        model.structure.prepare(matrix=solver_kind(model) != "relaxation")
    with clock.phase("compile", "compiling kernels"):
        # Uploads compile a kernel for every type of field, so they belong here too.
        work = analysis.Analysis(model)
        work.compile()
    provenance = _provenance(model, active)
    writer = _writer(out, model, provenance)
    result = RunResult(
        scene=scene, mesh=mesh, steps=(), checks=(), seconds=clock.seconds, provenance=provenance, directory=out
    )
    try:
        observer.phase("solving")
        steps = work.steps(lambda stage, k, n, p: observer.progress(stage, k, n, p.iteration, p.residual, p.seconds))
        while (step := clock.timed("solve", lambda: next(steps, None))) is not None:
            result = replace(result, steps=(*result.steps, step))
            observer.step_done(step)
            if writer is not None:
                with clock.phase("output"):
                    for path in writer.write_step(step, clock.seconds):
                        observer.wrote(path)
    finally:
        # Also after Ctrl-C: what was computed is judged, drawn and kept.
        result = replace(result, checks=probes.run_checks(scene, result.steps), outcome=work.outcome)
        if writer is not None and result.steps:
            result = _finish(result, writer, clock, render=render)
    return result


def _writer(out: Path | None, model: Model, provenance: dict[str, Any]) -> Writer | None:
    """The writer of a run's files, where files are wanted."""
    if out is None:
        return None
    from taichi_membrane.output.writer import Writer

    structure = model.structure
    return Writer(
        Path(out), model.scene, structure.mesh, provenance=provenance, tri_fabric=structure.tri_fabric.astype(np.int32)
    )


def _finish(result: RunResult, writer: Writer, clock: Clock, *, render: bool) -> RunResult:
    """Draw the pictures and write the final summary."""
    if render:
        from taichi_membrane.pictures import gallery

        with clock.phase("render", "drawing"):
            for path in gallery.draw_run(result, writer.directory, result.scene.camera):
                writer.note(path)
                clock.observer.wrote(path)
    return replace(result, files=tuple(writer.finish(result)))


def summarise(scene: Scene, base: Path | None = None, *, repair: bool = False) -> tuple[Model, list[str], list[str]]:
    """Validate a scene and its mesh without running it; the model, what is compiled in and what is left out.

    :raises InputError: anything a run would refuse before it starts.
    """
    from taichi_membrane.simulation import probes
    from taichi_membrane.simulation.model import build_mesh, build_model

    model = build_model(scene, build_mesh(scene, base, repair=repair))
    probes.validate(model)
    compiled_in, left_out = model.structure.features().describe()
    return model, compiled_in, left_out


def redraw(directory: Path, *, camera: Camera | None = None, observer: Observer | None = None) -> list[Path]:
    """Draw a finished run's pictures again, with another camera if one is given.

    :raises InputError: the folder is not a run of this program, or is damaged.
    """
    observer = observer or Silent()
    from taichi_membrane.engine import runtime
    from taichi_membrane.output.reader import read_run
    from taichi_membrane.simulation.results import RunResult

    scene, mesh, steps = read_run(directory)
    if not steps:
        raise InputError(f"{directory}: this run has no load steps to draw")
    runtime.start()  # before anything imports Taichi, whose banner would land on standard output
    from taichi_membrane.pictures import gallery

    result = RunResult(scene=scene, mesh=mesh, steps=tuple(steps), checks=(), seconds={}, provenance={})
    observer.phase("drawing")
    paths = []
    for path in gallery.draw_run(result, directory, camera or scene.camera):
        observer.wrote(path)
        paths.append(path)
    return paths


def _provenance(model: Model, active: Runtime) -> dict[str, Any]:
    """What really ran, so that a number can be traced."""
    compiled_in, left_out = model.structure.features().describe()
    return {
        "taichi_membrane": metadata.version("taichi-membrane"),
        "taichi": active.taichi_version,
        "python": platform.python_version(),
        "numpy": metadata.version("numpy"),
        "arch": active.arch,
        "precision": active.precision,
        "threads": active.threads,
        "compiled_in": compiled_in,
        "left_out": left_out,
    }
