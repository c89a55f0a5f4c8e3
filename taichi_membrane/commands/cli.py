"""The command ``taichi-membrane``: run, check and draw scenes; verify the mechanics.

Results go to standard output, progress and errors to standard error. Exit codes: 0 all well, 1 a check of the scene fails, 2 bad
input or a file that cannot be written, 3 a load step did not converge, a path did not come to its loads or a load case has no
stable end, 4 the structure collapses before its last load or in a load case, 5 a stage that should meet collapse met none, 130
interrupted.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from taichi_membrane.commands.common import (
    BAD_INPUT,
    INTERRUPTED,
    OnlyOption,
    RepairOption,
    SceneArgument,
    SetOption,
    console,
    naming,
)
from taichi_membrane.commands.drawing import render, report
from taichi_membrane.commands.fit import fit
from taichi_membrane.commands.gallery import gallery
from taichi_membrane.commands.new import new
from taichi_membrane.commands.run import run
from taichi_membrane.commands.study import study
from taichi_membrane.commands.sweep import sweep
from taichi_membrane.errors import InputError

# Modules that take long to import (NumPy, pydantic, rich) are imported by the commands that need them: help is instant.


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


def check(scene: SceneArgument, overrides: SetOption = None, repair: RepairOption = False) -> None:
    """Validate a scene and its mesh; run nothing."""
    from taichi_membrane.commands.model_printing import print_model
    from taichi_membrane.execution.run import summarise
    from taichi_membrane.scene import file as scene_file
    from taichi_membrane.scene import presets
    from taichi_membrane.scene.texts import conversions

    path = scene_file.resolve_scene(scene)
    data = scene_file.changed_data(path, scene_file.read_data(path), overrides or ())
    loaded = scene_file.load_scene(path, overrides or ())
    with naming(path):
        model, compiled_in, left_out = summarise(loaded, path.parent, repair=repair)
    texts = conversions(loaded, data, loaded.units)
    print_model(console(), model, compiled_in, left_out, texts, list(presets.told(data)))


def verify(
    full: Annotated[bool, typer.Option("--full", help="Finer meshes too; up to an hour.")] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Output folder.")] = Path("renders/verification"),
    only: OnlyOption = None,
) -> None:
    """Run the cases with a known answer; write a table, its numbers and plots of the error against mesh size.

    Exit code: 0 all well, 1 a case misses its bound or its rate, 2 bad input.
    """
    from taichi_membrane.commands.verify import verify as run_cases

    code = run_cases(full, out, only or [])
    if code:
        raise typer.Exit(code)


def stress(
    full: Annotated[
        bool, typer.Option("--full", help="More levels, every solver on all of them; up to an hour.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output folder.", show_default="renders/ and the set's name")
    ] = None,
    only: OnlyOption = None,
    jobs: Annotated[int, typer.Option(min=1, max=3, help="Processes side by side.")] = 2,
    which: Annotated[
        Literal["stability", "verdicts"],
        typer.Option("--set", help="Borders of safe results, or the truth of what runs say of themselves."),
    ] = "stability",
) -> None:
    """Push materials, meshes, states and loads until something gives; write where. Or hold verdicts against the truth.

    Exit code: 0 all well, 1 a wrong result or a border that has moved in, 2 bad input.
    """
    directory = out or Path("renders") / which
    if which == "verdicts":
        from taichi_membrane.commands.verdicts import verdicts

        code = verdicts(full, directory, only or [], jobs)
    else:
        from taichi_membrane.commands.stress import stress as run_cases

        code = run_cases(full, directory, only or [], jobs)
    if code:
        raise typer.Exit(code)


def scenes() -> None:
    """List the shipped scenes."""
    from taichi_membrane.scene.file import load_scene, shipped_scenes

    shipped = {name: load_scene(path).title for name, path in shipped_scenes().items()}
    width = max(map(len, shipped), default=0)
    for name, title in shipped.items():
        typer.echo(f"{name:<{width}}  {title}".rstrip())


def schema(
    page: Annotated[bool, typer.Option("--page", help="As a page of tables (Markdown) instead.")] = False,
) -> None:
    """Print the JSON schema of a scene: each key with its meaning, unit, default and allowed values."""
    from taichi_membrane.scene import schema as words

    typer.echo(words.page().rstrip() if page else json.dumps(words.schema(), indent=2, ensure_ascii=False))


for _command in (run, check, new, render, report, verify, stress, scenes, gallery, schema, study, sweep, fit):
    app.command()(_command)


def main() -> None:
    """Entry point of the installed command."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal that cannot show "mm³" gets a question mark rather than a crash.
            stream.reconfigure(errors="replace")
    app(prog_name="taichi-membrane")
