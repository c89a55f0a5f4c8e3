"""What several commands share: exit codes, arguments and options, the console."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision

if TYPE_CHECKING:
    from rich.console import Console

CHECK_FAILS, BAD_INPUT, NOT_CONVERGED, COLLAPSE, NO_COLLAPSE, INTERRUPTED = 1, 2, 3, 4, 5, 130

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A scene file, or the name of a shipped scene.")]
RunFolder = Annotated[Path, typer.Argument(metavar="DIR", help="The output folder of a run.")]
RepairOption = Annotated[
    bool, typer.Option("--repair", help="Mend a mesh file where that is safe: orientation, doubled and unused nodes.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value, such as stages.load.steps=3. May be repeated."),
]
SetForAllOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set a value for all runs. May be repeated.")
]
OnlyOption = Annotated[list[str] | None, typer.Option("--only", metavar="NAME", help="One case. May be repeated.")]
ArchOption = Annotated[Arch, typer.Option(help="Back end of Taichi.")]
PrecisionOption = Annotated[Precision, typer.Option(help="Floating-point type of the mechanics.")]


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """What turns out to be wrong only when the scene meets its mesh names the scene file, too."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def made_folder(path: Path) -> Path:
    """The folder that results go to, made now rather than after minutes of work.

    :raises InputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the output folder cannot be made: {error.strerror}") from error
    return path


def console(*, stderr: bool = False) -> Console:
    """The terminal, or what it is redirected to."""
    from rich.console import Console

    return Console(stderr=stderr, highlight=False)
