"""A whole run: scene, mesh, model, load steps, files, pictures, checks."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.execution.adapted import adapted, check_adaptable, refined_for
from taichi_membrane.execution.cascaded import cascade_of, stepping
from taichi_membrane.execution.observer import Clock, Observer
from taichi_membrane.execution.saved import refuse_other_bits, refuse_other_probes
from taichi_membrane.execution.turn import in_turn, refuse_within
from taichi_membrane.names import Arch, EstimatedSteps, Precision
from taichi_membrane.scene import Camera, Scene

if TYPE_CHECKING:
    from taichi_membrane.device.runtime import Runtime
    from taichi_membrane.mesh import Mesh
    from taichi_membrane.output.reader import SavedRun
    from taichi_membrane.output.writer import Writer
    from taichi_membrane.simulation.accuracy import Adaption, Estimate
    from taichi_membrane.simulation.model import Model
    from taichi_membrane.simulation.refined import Refined
    from taichi_membrane.simulation.results import ProbeFunction, RunResult, Settings, StepResult
    from taichi_membrane.simulation.solver_choice import SolverChoice


def run(
    scene: Scene | Path | str,
    *,
    mesh: Mesh | None = None,
    out: Path | None = None,
    base: Path | None = None,
    arch: Arch = "cpu",
    precision: Precision = "f64",
    threads: int | None = None,
    render: bool = True,
    repair: bool = False,
    probes: Mapping[str, ProbeFunction] | None = None,
    estimate: bool | Literal["last", "all"] = False,
    cascade: int = 0,
    observer: Observer | None = None,
) -> RunResult:
    """Run a scene and return what it found; write files as the steps are done when ``out`` is given.

    Several threads may call this: their runs are done one after another.

    :param scene: the scene, its file, or the name of a shipped one.
    :param mesh: a mesh object for a scene whose mesh is ``{"shape": "given"}``.
    :param out: folder for summary.json, history.csv, step files, curve.png and pictures; nothing is written when None.
    :param base: folder that a relative mesh path starts from; when None that of the scene's file, else the current one.
    :param render: draw pictures and the curve (only with ``out``).
    :param repair: mend a mesh file where that is safe; ``RunResult.mesh.mended`` says what was done.
    :param probes: what to measure at every load step beside the scene's probes, by name: functions of the mesh and the
        :class:`StepResult`, which has everything else, that give a number.
    :param estimate: solve the last load step (True, ``last``) or all of them again on the mesh cut in four, and tell the errors of
        probes: ``RunResult.estimate``.
    :param cascade: run on the mesh cut in four so many times; load steps are solved on the scene's mesh and carried over.
    :raises InputError: a scene, mesh or back end that cannot be used; a file that cannot be written, say on a full disk; another
        run that writes in ``out``; a call from within another run. A step that does not converge raises nothing: it ends the run,
        and ``RunResult.converged`` says so.
    """
    refuse_within()
    clock = Clock(observer)
    if not isinstance(scene, Scene):
        from taichi_membrane.scene.file import load_scene, resolve_scene

        path = resolve_scene(scene) if isinstance(scene, str) else scene
        scene, base = load_scene(path), base or path.parent
    from taichi_membrane.simulation.model import build_mesh, build_model, with_scene_groups
    from taichi_membrane.simulation.obstacles import with_surfaces
    from taichi_membrane.simulation.results import Settings

    scene = with_surfaces(scene, base)
    which: EstimatedSteps = "last" if estimate is True else estimate or ""
    given = mesh
    settings = Settings(arch=arch, precision=precision, threads=threads, render=render, estimate=which, cascade=cascade)

    def work() -> RunResult:
        with clock.phase("setup", "reading the mesh"):
            found = build_mesh(scene, base, repair=repair) if given is None else with_scene_groups(scene, given)
            model = build_model(scene, found, probes)
            chain = cascade_of(model, cascade)
        return _carry_out(model, settings, clock, out=out, chain=chain)

    with _sole_writer(out):
        return in_turn(work, clock.stop)


def resume(
    directory: Path,
    *,
    render: bool | None = None,
    probes: Mapping[str, ProbeFunction] | None = None,
    observer: Observer | None = None,
) -> RunResult:
    """Go on with a run that was stopped, from its last whole load step; scene, mesh and settings are those in its folder.

    All numbers and files become what they would be had the run not been stopped, to the last bit, apart from times. Of a run that
    has ended, converged or not, nothing is done again: its result is read from its files.

    :param directory: the folder of the run.
    :param render: draw pictures and the curve at the end, as in :func:`run`; as the run was asked to when None.
    :param probes: the functions that the run was begun with, if any.
    :raises InputError: the folder is not a run of this program, or is damaged; it was begun with other versions or on another back
        end; a file cannot be written; another process writes there.
    """
    refuse_within()
    clock = Clock(observer)
    from taichi_membrane.output.reader import is_complete, read_run
    from taichi_membrane.simulation.model import build_model

    def work() -> RunResult:
        with clock.phase("setup", "reading the run"):
            saved = read_run(Path(directory))
            if not saved.complete:
                refuse_other_probes(saved, probes or {})
            model = build_model(saved.scene, saved.given, probes)
            if saved.scene.forms and saved.steps:
                from taichi_membrane.simulation import rest_shape

                fields = saved.steps[0].fields
                model = rest_shape.found(model, saved.mesh.points, fields["stress"], fields["cable_force"])
        clock.observer.kept(saved.steps)
        if saved.complete:
            return _result(saved)
        for phase, seconds in saved.seconds.items():
            clock.seconds[phase] = clock.seconds.get(phase, 0.0) + seconds
        settings = saved.settings if render is None else replace(saved.settings, render=render)
        return _carry_out(model, settings, clock, out=saved.directory, saved=saved)

    with _sole_writer(None if is_complete(Path(directory)) else Path(directory)):
        return in_turn(work, clock.stop)


def _sole_writer(out: Path | None) -> AbstractContextManager[None]:
    """Keeps other runs out of the folder that this one writes in; it is one that a run may write in.

    :raises InputError: another process is at work in it; it holds other files and no run.
    """
    if out is None:
        return nullcontext()
    from taichi_membrane.output.lock import sole_writer
    from taichi_membrane.output.writer import check_directory

    check_directory(Path(out))
    return sole_writer(Path(out))


def _carry_out(
    model: Model,
    settings: Settings,
    clock: Clock,
    *,
    out: Path | None,
    saved: SavedRun | None = None,
    chain: Sequence[Refined] = (),
) -> RunResult:
    """Solve the load steps that are not saved yet; write, judge and draw all.

    :param chain: the models on finer meshes that they are carried over to, the last of which is run.
    """
    observer, coarse, model = clock.observer, model, chain[-1].model if chain else model
    with clock.phase("setup"):
        fine = refined_for(model, settings)  # what cannot be refined is refused before anything is solved
        check_adaptable(model)
    with clock.phase("start", "starting Taichi"):
        from taichi_membrane.device import runtime

        active = runtime.start(arch=settings.arch, precision=settings.precision, threads=settings.threads)
        from taichi_membrane.simulation import analysis, probes
        from taichi_membrane.simulation.solver_choice import chosen_solver

        if out is not None and settings.render and not active.on_cpu:
            from taichi_membrane.pictures.driver import check_driver

            check_driver()
    from taichi_membrane.simulation.results import RunResult

    probes.validate(model)
    probes.validate_own(model)
    model, adaption = adapted(model, clock) if saved is None else (model, saved.adaption)
    with clock.phase("setup"):
        if adaption is not None:
            fine = refined_for(model, settings)
        solver = chosen_solver(model)
        model.structure.prepare(matrix=solver.kind != "relaxation")
        if fine is not None:
            fine.model.structure.prepare(matrix=chosen_solver(fine.model).kind != "relaxation")
    provenance = _provenance(model, active, solver)
    if saved is not None:
        refuse_other_bits(saved, provenance)
    writer = _writer(out, model, settings, provenance, saved, adaption)
    with clock.phase("compile", "compiling kernels"):
        # Uploads compile a kernel for every type of field, so they belong here too.
        if fine is not None:
            analysis.ready(fine.model)  # in its kernels there is room for the coarse model
        work = analysis.ready(model)
    result = RunResult(
        scene=model.scene, mesh=model.structure.mesh, steps=() if saved is None else saved.steps, checks=(),
        seconds=clock.seconds, provenance=provenance, directory=out, adaption=adaption,
    )  # fmt: skip
    try:
        observer.phase("solving")
        steps, told = stepping(work, coarse, chain, clock, result.steps)
        while (step := clock.timed("solve", lambda: next(steps, None))) is not None:
            result = replace(result, steps=(*result.steps, step), mesh=work.model.structure.mesh)
            observer.step_done(step)
            if writer is not None:
                with clock.phase("output"):
                    for path in writer.write_step(step, clock.seconds, result.mesh):
                        observer.wrote(path)
    except InputError:
        raise  # a file that cannot be written, so nothing more is
    except BaseException:
        # Also after Ctrl-C: what was computed is judged, drawn and kept.
        _finish(replace(result, outcome=work.outcome), work.model, writer, clock, render=settings.render)
        raise
    result, model = replace(result, outcome=work.outcome, cascade=told()), work.model
    if fine is not None and any(step.converged for step in result.steps):
        try:
            result = replace(result, estimate=_estimated(model, fine, result.steps, settings, clock))
        except KeyboardInterrupt:
            _finish(result, model, writer, clock, render=settings.render)
            raise
    return _finish(result, model, writer, clock, render=settings.render)


def _estimated(model: Model, fine: Refined, steps: Sequence[StepResult], settings: Settings, clock: Clock) -> Estimate:
    """Solve load steps again on the mesh cut in four."""
    from taichi_membrane.simulation import analysis
    from taichi_membrane.simulation.estimating import Again

    with clock.phase("estimate", "solving on the mesh cut in four"):
        return Again(model, fine, analysis.ready(fine.model), clock.progress).estimate(steps, settings.estimate)


def _writer(
    out: Path | None,
    model: Model,
    settings: Settings,
    provenance: dict[str, Any],
    saved: SavedRun | None,
    adaption: Adaption | None,
) -> Writer | None:
    """The writer of a run's files, where files are wanted."""
    if out is None:
        return None
    from taichi_membrane.output.writer import Writer

    structure = model.structure
    return Writer(
        Path(out),
        model.scene,
        model.given or structure.mesh,
        settings=settings,
        provenance=provenance,
        tri_fabric=structure.tri_fabric.astype(np.int32),
        saved=saved,
        own_probes=model.own_probes,
        adaption=adaption,
    )


def read_result(directory: Path) -> RunResult:
    """The result of a run, as far as it came, from the files in its folder.

    :raises InputError: the folder is not a run of this program, or is damaged.
    """
    from taichi_membrane.output.reader import read_run

    return _result(read_run(Path(directory)))


def _result(saved: SavedRun) -> RunResult:
    """The result of a run from its files."""
    from taichi_membrane.simulation import probes
    from taichi_membrane.simulation.results import RunResult

    return RunResult(
        scene=saved.scene,
        mesh=saved.mesh,
        steps=saved.steps,
        checks=probes.run_checks(saved.scene, saved.steps),
        seconds=saved.seconds,
        provenance=saved.provenance,
        outcome=saved.outcome,
        layers=saved.layers,
        estimate=saved.estimate,
        adaption=saved.adaption,
        cascade=saved.cascade,
        directory=saved.directory,
        files=saved.files,
    )


def _finish(result: RunResult, model: Model, writer: Writer | None, clock: Clock, *, render: bool) -> RunResult:
    """Judge the checks and the mesh, draw the pictures and write the final summary."""
    from taichi_membrane.simulation import probes
    from taichi_membrane.simulation.judging import judged
    from taichi_membrane.simulation.told_layers import told_layers

    checks = probes.run_checks(result.scene, result.steps)
    result = replace(result, checks=checks, layers=told_layers(model, result.steps))
    result = replace(result, adaption=judged(result.adaption, result))
    if writer is None or not result.steps:
        return result
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
    from taichi_membrane.simulation.obstacles import with_surfaces

    scene = with_surfaces(scene, base)
    model = build_model(scene, build_mesh(scene, base, repair=repair))
    probes.validate(model)
    check_adaptable(model)
    compiled_in, left_out = model.structure.features().describe()
    return model, compiled_in, left_out


def redraw(
    directory: Path, *, camera: Camera | None = None, out: Path | None = None, observer: Observer | None = None
) -> list[Path]:
    """Draw a finished run's pictures again, with another camera if one is given.

    :param out: folder for them; the run's own when None.
    :raises InputError: the folder is not a run of this program, or is damaged.
    """
    clock = Clock(observer)
    from taichi_membrane.device import runtime
    from taichi_membrane.output.reader import read_run
    from taichi_membrane.simulation.results import RunResult

    saved = read_run(directory)
    if not saved.steps:
        raise InputError(f"{directory}: this run has no load steps to draw")
    result = RunResult(
        scene=saved.scene, mesh=saved.mesh, steps=saved.steps, checks=(), seconds={}, provenance=saved.provenance
    )

    def work() -> list[Path]:
        runtime.start()  # before anything imports Taichi, whose banner would land on standard output
        from taichi_membrane.pictures import gallery

        clock.observer.phase("drawing")
        paths = []
        for path in gallery.draw_run(result, out or directory, camera or saved.scene.camera):
            clock.observer.wrote(path)
            paths.append(path)
        return paths

    return in_turn(work, clock.stop)


def _provenance(model: Model, active: Runtime, solver: SolverChoice) -> dict[str, Any]:
    """What really ran, so that a number can be traced."""
    compiled_in, left_out = model.structure.features().describe()
    return {
        "taichi_membrane": metadata.version("taichi-membrane"),
        "taichi": active.taichi_version,
        "python": platform.python_version(),
        "numpy": metadata.version("numpy"),
        "scipy": metadata.version("scipy"),
        "arch": active.arch,
        "precision": active.precision,
        "threads": active.threads,
        "solver": solver.kind,
        "solver_reason": solver.reason,
        "compiled_in": compiled_in,
        "left_out": left_out,
    }
