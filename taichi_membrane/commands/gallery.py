"""The command ``gallery``: run shipped scenes and write the page that shows each with its picture and its checks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_membrane.commands.common import CHECK_FAILS, NOT_CONVERGED, console, made_folder, naming
from taichi_membrane.errors import InputError

if TYPE_CHECKING:
    from taichi_membrane.scene import Scene
    from taichi_membrane.simulation.results import RunResult

PAGE, PICTURES = "gallery.md", "gallery"
_SIZE = (960, 600)  # of a picture, small enough to be kept with the sources
_HEAD = """# Gallery

Every shipped scene as it ends, with its checks; `taichi-membrane gallery` runs them and writes this page and its pictures anew,
`taichi-membrane gallery NAME …` those named alone. Values are those of the last such run, in double precision.
"""


def gallery(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Shipped scenes to run anew; all without any.")
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of gallery.md and of its folder of pictures.")
    ] = Path("docs"),
) -> None:
    """Run the shipped scenes and write the page that shows each with its picture and its checks.

    What stands on the page of other scenes stays. Exit code: 0 all well, 1 a check fails, 2 bad input or a file that cannot be
    written, 3 a scene did not come to its end; the page is written all the same.
    """
    from taichi_membrane.commands.progress import ProgressView
    from taichi_membrane.execution.run import run
    from taichi_membrane.output.atomic import replacing
    from taichi_membrane.scene.file import load_scene, shipped_scenes

    shipped = shipped_scenes()
    chosen = _chosen(names or list(shipped), shipped)
    made_folder(out / PICTURES)
    page, code = out / PAGE, 0
    for number, name in enumerate(chosen, 1):
        scene = load_scene(shipped[name])
        typer.echo(f"[{number}/{len(chosen)}] {name}", err=True)
        with naming(shipped[name]), ProgressView(scene, console(stderr=True)) as view:
            result = run(scene, base=shipped[name].parent, observer=view)
        pictures = _draw(result, name, out / PICTURES)
        sections = {**_sections(page), name: _section(scene, name, result, pictures)}
        kept = [sections[one] for one in sorted(sections) if one in shipped]
        with replacing(page) as temporary:
            text = "\n".join((_HEAD, _contents(sorted(set(sections) & set(shipped))), *kept))
            temporary.write_text(text, encoding="utf-8", newline="\n")
        code = max(code, 0 if result.passed else CHECK_FAILS, 0 if result.converged else NOT_CONVERGED)
    typer.echo(f"wrote {page}, and {len(chosen)} scenes' pictures in {out / PICTURES}")
    if code:
        raise typer.Exit(code)


def _chosen(names: list[str], shipped: Iterable[str]) -> list[str]:
    """The scenes named, once each and in their order.

    :raises InputError: one that is not shipped.
    """
    allowed = list(shipped)
    for name in names:
        if name not in allowed:
            raise InputError(f"gallery: {name!r} is not a shipped scene; allowed: {', '.join(allowed)}")
    return [name for name in allowed if name in names]


def _draw(result: RunResult, name: str, folder: Path) -> list[str]:
    """Draw the last step, and the curve where the scene has one; returns the names of the files."""
    from taichi_membrane.pictures.gallery import draw_last_step, draw_run_curve

    drawn = []
    if result.steps:
        camera = result.scene.camera.model_copy(update={"size": _SIZE})
        draw_last_step(result, camera, folder / f"{name}.png")
        drawn.append(f"{name}.png")
        if result.scene.curve is not None:
            draw_run_curve(result, result.scene.curve, folder / f"{name}_curve.png")
            drawn.append(f"{name}_curve.png")
    return drawn


def _sections(page: Path) -> dict[str, str]:
    """What stands on a page, by scene."""
    try:
        text = page.read_text(encoding="utf-8") if page.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{page}: it cannot be read: {error}") from None
    found = re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]
    return {part.split("\n", 1)[0][3:].strip(): part.rstrip() + "\n" for part in found}


def _contents(names: Iterable[str]) -> str:
    return ", ".join(f"[{name}](#{name})" for name in names) + "\n"


def _section(scene: Scene, name: str, result: RunResult, pictures: list[str]) -> str:
    """A scene's heading, words, pictures and checks; a value that is out of its tolerance is bold."""
    from taichi_membrane.output.tables import Column, check_columns

    title, steps = scene.title or name, len(result.steps)
    size = f"{len(result.mesh.triangles)} triangles, {steps} load step{'s' * (steps != 1)}"
    lines = [
        f"## {name}",
        "",
        f"**{title}** ([scenes/{name}.toml](../scenes/{name}.toml); {size})",
        "",
        " ".join(scene.description.split()),
        "",
    ]
    if not result.converged:
        lines += [f"**It did not come to its end: {result.outcome}.**", ""]
    lines += [f"![{title}]({PICTURES}/{picture})\n" for picture in pictures]
    columns = [*check_columns(scene, result.checks)[:-1], Column("source", [check.source for check in result.checks])]
    lines += [_row(column.header for column in columns), _row("---" for _ in columns)]
    columns[2].cells[:] = [
        cell if check.passed else f"**{cell}**" for cell, check in zip(columns[2].cells, result.checks, strict=True)
    ]
    lines += [_row(cells) for cells in zip(*(column.cells for column in columns), strict=True)]
    return "\n".join(lines).rstrip() + "\n"


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
