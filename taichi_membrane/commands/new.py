"""The command ``new``: a scene of one's own, begun from one that there is."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from taichi_membrane.commands.common import made_folder
from taichi_membrane.errors import InputError


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new scene; its file is NAME.toml.")],
    like: Annotated[
        str, typer.Option(metavar="SCENE", help="A shipped scene, or a scene file, to begin with.")
    ] = "cantilever",
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the file.")] = Path(),
) -> None:
    """Write a scene file like another one, with what each key means; without the checks, which hold for its numbers.

    The file of its mesh, where it has one, is copied beside it. Nothing is overwritten.
    """
    from taichi_membrane.output.atomic import replacing
    from taichi_membrane.scene import MeshFile
    from taichi_membrane.scene.base import LONGEST_NAME, is_name
    from taichi_membrane.scene.file import load_scene, resolve_scene
    from taichi_membrane.scene.template import written_like

    if not is_name(name):
        raise InputError(
            f"{name!r} is no name of a scene: a letter, then letters, digits and _, at most {LONGEST_NAME}"
        )
    source = resolve_scene(like)
    scene = load_scene(source)
    target = made_folder(out) / f"{name}.toml"
    files = [(source, target)]
    if isinstance(scene.mesh, MeshFile) and not Path(scene.mesh.path).is_absolute():
        files.append((source.parent / scene.mesh.path, out / scene.mesh.path))
    for _, copy in files:
        if copy.exists():
            raise InputError(f"{copy}: there is such a file; it is not overwritten")
    text = written_like(name, source.name, source.read_text(encoding="utf-8-sig"))
    for original, copy in files[1:]:
        made_folder(copy.parent)
        with replacing(copy) as temporary:
            shutil.copyfile(original, temporary)
    with replacing(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    typer.echo(f"wrote {target}; next: taichi-membrane check {target}")
