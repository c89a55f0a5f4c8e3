"""The commands ``render`` and ``report``: draw a finished run again, or write it as one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from taichi_membrane.commands.common import RunFolder, console, made_folder
from taichi_membrane.errors import InputError
from taichi_membrane.fields import drawn

if TYPE_CHECKING:
    from taichi_membrane.scene import Camera
    from taichi_membrane.simulation.results import RunResult


def _drawn_field(name: str | None) -> str | None:
    if name is not None and name not in drawn():
        raise typer.BadParameter(f"{name!r} is not one of {', '.join(drawn())}")
    return name


def render(
    directory: RunFolder,
    field: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"What colours show: {', '.join(drawn())}.", callback=_drawn_field),
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
    magnify: Annotated[float | None, typer.Option(help="Draw displacements so many times larger.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the pictures, which must not be there yet; else the run's own."),
    ] = None,
) -> None:
    """Draw the pictures of a finished run again.

    What is not given is as in the scene of the run.
    """
    from taichi_membrane.commands import printing
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
        "magnify": magnify,
    }
    camera = _camera(scene.camera, {key: value for key, value in asked.items() if value is not None})
    try:
        scene.check_picture(camera.field)
    except ValueError as error:
        raise InputError(str(error)) from None
    if out is not None and out.exists():
        raise InputError(f"{out}: there is such a file or folder; pictures of its own need a new one")
    folder = directory if out is None else made_folder(out)
    with ProgressView(scene, console(stderr=True)) as view:
        files = redraw(directory, camera=camera, out=folder, observer=view)
    printing.print_files(console(), folder, files)


def report(directory: RunFolder) -> None:
    """Write DIR/report.html: the run as one page that opens from the disk, with a view to turn, curve and tables.

    Of a run that is not at its end the page shows the load steps so far, and says so.
    """
    from taichi_membrane.execution.run import read_result

    write_page(read_result(directory), directory, quiet=False)


def write_page(result: RunResult, directory: Path, quiet: bool) -> None:
    """Write the page of a run and name it."""
    from taichi_membrane.page import document

    size = document.write_page(result, directory / document.PAGE)
    if not quiet:
        typer.echo(f"wrote {directory / document.PAGE} ({size / 1e6:.1f} MB)")


def _camera(camera: Camera, changes: dict[str, Any]) -> Camera:
    from pydantic import ValidationError

    from taichi_membrane.scene.messages import mistakes

    data = {**camera.model_dump(), **changes}
    try:
        return type(camera).model_validate(data)
    except ValidationError as error:
        raise InputError(f"camera: {mistakes(error, data, type(camera))}") from None
