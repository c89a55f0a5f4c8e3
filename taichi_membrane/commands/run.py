"""The command ``run``: solve, write and draw a scene, or go on with a run that was stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_membrane.commands.common import (
    CHECK_FAILS,
    COLLAPSE,
    INTERRUPTED,
    NO_COLLAPSE,
    NOT_CONVERGED,
    ArchOption,
    PrecisionOption,
    RepairOption,
    SetOption,
    console,
    naming,
)
from taichi_membrane.commands.drawing import write_page
from taichi_membrane.errors import InputError

if TYPE_CHECKING:
    from taichi_membrane.execution.observer import Observer
    from taichi_membrane.scene import Scene
    from taichi_membrane.simulation.results import RunResult

RenderOption = Annotated[
    bool,
    typer.Option(
        "--render/--no-render",
        help="Draw pictures and the curve.",
        show_default="yes; with --resume as the run was begun",
    ),
]
EstimateOption = Annotated[
    bool,
    typer.Option(
        "--estimate", help="Estimate the errors of probes: the last load step solved again on the mesh cut in four."
    ),
]
EstimateAllOption = Annotated[bool, typer.Option("--estimate-all", help="The same of all load steps.")]
CascadeOption = Annotated[
    int,
    typer.Option(
        "--cascade",
        min=0,
        max=6,
        metavar="N",
        show_default=False,
        help="Run on the mesh cut in four N times: load steps are solved on the scene's mesh and carried over.",
    ),
]
ReportOption = Annotated[bool, typer.Option("--report", help="Also write report.html, as the command report does.")]


def run(
    context: typer.Context,
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help="A scene file, or the name of a shipped scene.")
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Go on with the run in DIR that was stopped; takes no SCENE and no settings."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output folder.", show_default="renders/NAME of the scene")
    ] = None,
    arch: ArchOption = "cpu",
    precision: PrecisionOption = "f64",
    overrides: SetOption = None,
    render: RenderOption = True,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but failures.")] = False,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads.", show_default="all cores")] = None,
    repair: RepairOption = False,
    report: ReportOption = False,
    estimate: EstimateOption = False,
    estimate_all: EstimateAllOption = False,
    cascade: CascadeOption = 0,
) -> None:
    """Solve the load steps of a scene, write and draw them.

    Judges the checks of the scene. Exit code: 0 all well, 1 a check fails or a refined mesh misses its tolerance, 2 bad input or a
    file that cannot be written, 3 a load step did not converge, a path did not come to its loads or a load case has no stable end,
    4 the structure collapses before its last load or in a load case, 5 a stage that should meet collapse (until = "collapse") met
    none.
    """
    if resume is not None:
        _go_on(context, resume, quiet, report)
        return
    if scene is None:
        raise typer.BadParameter("a scene, or --resume DIR", ctx=context, param_hint="SCENE")
    from taichi_membrane.execution.run import run as run_scene
    from taichi_membrane.output.writer import check_directory
    from taichi_membrane.scene import file as scene_file

    path = scene_file.resolve_scene(scene)
    model = scene_file.load_scene(path, overrides or ())
    directory = out or Path("renders") / model.name
    check_directory(directory)  # now rather than after minutes of work

    def work(observer: Observer) -> RunResult:
        with naming(path):
            return run_scene(
                model,
                out=directory,
                base=path.parent,
                arch=arch,
                precision=precision,
                threads=threads,
                render=render,
                repair=repair,
                estimate="all" if estimate_all else estimate,
                cascade=cascade,
                observer=observer,
            )

    _run(work, model, directory, quiet, report)


def _go_on(context: typer.Context, directory: Path, quiet: bool, report: bool) -> None:
    """The command ``run --resume``."""
    from taichi_membrane.execution.run import resume as resume_run
    from taichi_membrane.output.reader import read_scene

    allowed = ("--resume", "--render", "--quiet", "--report")
    sources = {one.opts[0]: context.get_parameter_source(str(one.name)) for one in context.command.params}
    given = [option for option, source in sources.items() if source is not None and source.name != "DEFAULT"]
    barred = [option.replace("scene", "SCENE") for option in given if option not in allowed]
    if barred:
        raise InputError(
            f"--resume {directory}: scene and settings are those of the run in that folder; leave out {', '.join(barred)}"
        )
    render = context.params["render"] if "--render" in given else None
    _run(
        lambda observer: resume_run(directory, render=render, observer=observer),
        read_scene(directory),
        directory,
        quiet,
        report,
    )


def _run(work: Callable[[Observer], RunResult], scene: Scene, directory: Path, quiet: bool, report: bool) -> None:
    """Do the work of a run while its progress is shown; print the result, and end with the exit code of its verdict."""
    from taichi_membrane.commands import printing
    from taichi_membrane.commands.progress import ProgressView

    view = ProgressView(scene, None if quiet else console(stderr=True))
    try:
        with view:
            result = work(view)
    except KeyboardInterrupt:
        kept = f"{len(view.steps)} load steps are kept in {directory}" if view.steps else "no load step was finished"
        typer.echo(f"interrupted: {kept}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    terminal = console()
    if not quiet and not view.paths:
        typer.echo(f"{directory}: nothing is left to do, the run has ended")
    if quiet or not view.paths:
        printing.print_failed_steps(terminal, result)
        printing.print_failed_cases(terminal, result)
        printing.print_failed_checks(terminal, result)
        printing.print_failed_adaption(terminal, result)
    else:
        printing.print_run(terminal, result)
    if report and result.steps:
        write_page(result, directory, quiet)
    if result.outcome != "finished":
        raise typer.Exit({"collapse": COLLAPSE, "no collapse": NO_COLLAPSE}.get(result.outcome, NOT_CONVERGED))
    missed = {case.verdict for case in result.cases.values()} - {"reached"}
    if missed:
        raise typer.Exit(COLLAPSE if missed == {"collapse"} else NOT_CONVERGED)
    if not result.passed:
        raise typer.Exit(CHECK_FAILS)
