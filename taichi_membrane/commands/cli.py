"""The command ``taichi-membrane``: run, check and draw scenes; verify the mechanics.

Results go to standard output, progress and errors to standard error. Exit codes: 0 all well, 1 a check of the scene fails, 2 bad
input or a file that cannot be written, 3 a load step did not converge or a path did not come to its loads, 4 the structure
collapses before its last load, 5 a stage that should meet collapse met none, 130 interrupted.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from taichi_membrane.commands.study import study
from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision

if TYPE_CHECKING:
    from rich.console import Console

    from taichi_membrane.execution.observer import Observer
    from taichi_membrane.scene import Camera, Scene
    from taichi_membrane.simulation.results import RunResult

# Modules that take long to import (NumPy, pydantic, rich) are imported by the commands that need them: help is instant.

CHECK_FAILS, BAD_INPUT, NOT_CONVERGED, COLLAPSE, NO_COLLAPSE, INTERRUPTED = 1, 2, 3, 4, 5, 130


class _Commands(TyperGroup):
    """Ends a command with one line and an exit code where the user, and not the program, is at fault."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except MemoryError as error:
            typer.echo(f"error: not enough memory: {error or 'a coarser mesh or fewer load steps need less'}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="How pressurised fabric deforms, carries load, wrinkles and collapses.",
)

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A scene file, or the name of a shipped scene.")]
RepairOption = Annotated[
    bool, typer.Option("--repair", help="Mend a mesh file where that is safe: orientation, doubled and unused nodes.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value, such as stages.load.steps=3. May be repeated."),
]


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"taichi-membrane {version('taichi-membrane')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the command itself; the app's help text stands above."""


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """What turns out to be wrong only when the scene meets its mesh names the scene file, too."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


@app.command()
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
    arch: Annotated[Arch, typer.Option(help="Back end of Taichi.")] = "cpu",
    precision: Annotated[Precision, typer.Option(help="Floating-point type of the mechanics.")] = "f64",
    overrides: SetOption = None,
    render: Annotated[bool, typer.Option("--render/--no-render", help="Draw pictures and the curve.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but failures.")] = False,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads.", show_default="all cores")] = None,
    repair: RepairOption = False,
) -> None:
    """Solve the load steps of a scene, write and draw them.

    Judges the checks of the scene. Exit code: 0 all well, 1 a check fails, 2 bad input or a file that cannot be written, 3 a load
    step did not converge or a path did not come to its loads, 4 the structure collapses before its last load, 5 a stage that should
    meet collapse (until = "collapse") met none.
    """
    if resume is not None:
        _go_on(context, resume, render, quiet)
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
        with _naming(path):
            return run_scene(
                model,
                out=directory,
                base=path.parent,
                arch=arch,
                precision=precision,
                threads=threads,
                render=render,
                repair=repair,
                observer=observer,
            )

    _run(work, model, directory, quiet)


def _go_on(context: typer.Context, directory: Path, render: bool, quiet: bool) -> None:
    """The command ``run --resume``."""
    from taichi_membrane.execution.run import resume as resume_run
    from taichi_membrane.output.reader import read_scene

    allowed = ("--resume", "--render", "--quiet")
    sources = {one.opts[0]: context.get_parameter_source(str(one.name)) for one in context.command.params}
    given = [
        option.replace("scene", "SCENE")
        for option, source in sources.items()
        if option not in allowed and source is not None and source.name != "DEFAULT"
    ]
    if given:
        raise InputError(
            f"--resume {directory}: scene and settings are those of the run in that folder; leave out {', '.join(given)}"
        )
    _run(
        lambda observer: resume_run(directory, render=render, observer=observer),
        read_scene(directory),
        directory,
        quiet,
    )


def _run(work: Callable[[Observer], RunResult], scene: Scene, directory: Path, quiet: bool) -> None:
    """Do the work of a run while its progress is shown; print the result, and end with the exit code of its verdict."""
    from taichi_membrane.commands import report
    from taichi_membrane.commands.progress import ProgressView

    view = ProgressView(scene, None if quiet else _console(stderr=True))
    try:
        with view:
            result = work(view)
    except KeyboardInterrupt:
        kept = f"{len(view.steps)} load steps are kept in {directory}" if view.steps else "no load step was finished"
        typer.echo(f"interrupted: {kept}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    console = _console()
    if not quiet and not view.paths:
        typer.echo(f"{directory}: nothing is left to do, the run has ended")
    if quiet or not view.paths:
        report.print_failed_steps(console, result)
        report.print_failed_checks(console, result)
    else:
        report.print_run(console, result)
    if not result.converged:
        raise typer.Exit({"collapse": COLLAPSE, "no collapse": NO_COLLAPSE}.get(result.outcome, NOT_CONVERGED))
    if not result.passed:
        raise typer.Exit(CHECK_FAILS)


@app.command()
def check(scene: SceneArgument, overrides: SetOption = None, repair: RepairOption = False) -> None:
    """Validate a scene and its mesh; run nothing."""
    from taichi_membrane.commands import report
    from taichi_membrane.execution.run import summarise
    from taichi_membrane.scene import file as scene_file

    path = scene_file.resolve_scene(scene)
    loaded = scene_file.load_scene(path, overrides or ())
    with _naming(path):
        model, compiled_in, left_out = summarise(loaded, path.parent, repair=repair)
    report.print_model(_console(), model, compiled_in, left_out)


@app.command()
def render(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The output folder of a run.")],
    field: Annotated[
        Literal["state", "fold_strain", "major_stress", "displacement"] | None, typer.Option(help="What colours show.")
    ] = None,
    azimuth: Annotated[float | None, typer.Option(help="Degrees about z.")] = None,
    elevation: Annotated[float | None, typer.Option(min=-90, max=90, help="Degrees above the xy plane.")] = None,
    projection: Annotated[Literal["perspective", "orthographic"] | None, typer.Option()] = None,
    width: Annotated[int | None, typer.Option(min=240, max=8192, help="Pixels.")] = None,
    height: Annotated[int | None, typer.Option(min=160, max=8192, help="Pixels.")] = None,
    outline: Annotated[bool | None, typer.Option("--outline/--no-outline", help="The unstressed shape.")] = None,
    loads: Annotated[bool | None, typer.Option("--loads/--no-loads", help="Arrows at loads.")] = None,
    supports: Annotated[bool | None, typer.Option("--supports/--no-supports", help="Marks at supports.")] = None,
    directions: Annotated[
        bool | None, typer.Option("--directions/--no-directions", help="Lines along the wrinkles.")
    ] = None,
) -> None:
    """Draw the pictures of a finished run again.

    What is not given is as in the scene of the run.
    """
    from taichi_membrane.commands import report
    from taichi_membrane.commands.progress import ProgressView
    from taichi_membrane.execution.run import redraw
    from taichi_membrane.output.reader import read_scene

    scene = read_scene(directory)
    asked = {
        "field": field,
        "azimuth": azimuth,
        "elevation": elevation,
        "projection": projection,
        "size": (width or scene.camera.size[0], height or scene.camera.size[1]),
        "outline": outline,
        "loads": loads,
        "supports": supports,
        "directions": directions,
    }
    camera = _camera(scene.camera, {key: value for key, value in asked.items() if value is not None})
    with ProgressView(scene, _console(stderr=True)) as view:
        files = redraw(directory, camera=camera, observer=view)
    report.print_files(_console(), directory, files)


@app.command()
def verify(
    full: Annotated[bool, typer.Option("--full", help="Finer meshes too; up to an hour.")] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Output folder.")] = Path("renders/verification"),
    only: Annotated[list[str] | None, typer.Option("--only", metavar="NAME", help="One case. May be repeated.")] = None,
) -> None:
    """Run the cases with a known answer; write a table, its numbers and plots of the error against mesh size.

    Exit code: 0 all well, 1 a case misses its bound or its rate, 2 bad input.
    """
    from taichi_membrane.commands.verify import verify as run_cases

    code = run_cases(full, out, only or [])
    if code:
        raise typer.Exit(code)


@app.command()
def stress(
    full: Annotated[
        bool, typer.Option("--full", help="More levels, every solver on all of them; up to an hour.")
    ] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Output folder.")] = Path("renders/stability"),
    only: Annotated[list[str] | None, typer.Option("--only", metavar="NAME", help="One case. May be repeated.")] = None,
    jobs: Annotated[int, typer.Option(min=1, max=3, help="Processes side by side.")] = 2,
) -> None:
    """Push materials, meshes, states and loads until something gives; write where.

    Exit code: 0 all well, 1 a wrong result or a border that has moved in, 2 bad input.
    """
    from taichi_membrane.commands.stress import stress as run_cases

    code = run_cases(full, out, only or [], jobs)
    if code:
        raise typer.Exit(code)


@app.command()
def scenes() -> None:
    """List the shipped scenes."""
    from taichi_membrane.scene.file import load_scene, shipped_scenes

    shipped = {name: load_scene(path).title for name, path in shipped_scenes().items()}
    width = max(map(len, shipped), default=0)
    for name, title in shipped.items():
        typer.echo(f"{name:<{width}}  {title}".rstrip())


@app.command()
def schema(
    page: Annotated[bool, typer.Option("--page", help="As a page of tables (Markdown) instead.")] = False,
) -> None:
    """Print the JSON schema of a scene: each key with its meaning, unit, default and allowed values."""
    from taichi_membrane.scene import schema as words

    typer.echo(words.page().rstrip() if page else json.dumps(words.schema(), indent=2, ensure_ascii=False))


app.command()(study)


def _camera(camera: Camera, changes: dict[str, Any]) -> Camera:
    from pydantic import ValidationError

    from taichi_membrane.scene.messages import mistakes

    data = {**camera.model_dump(), **changes}
    try:
        return type(camera).model_validate(data)
    except ValidationError as error:
        raise InputError(f"camera: {mistakes(error, data, type(camera))}") from None


def _console(*, stderr: bool = False) -> Console:
    from rich.console import Console

    return Console(stderr=stderr, highlight=False)


def main() -> None:
    """Entry point of the installed command."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal that cannot show "mm³" gets a question mark rather than a crash.
            stream.reconfigure(errors="replace")
    app(prog_name="taichi-membrane")
