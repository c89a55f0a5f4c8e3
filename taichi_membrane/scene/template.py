"""A new scene from one that there is: its text, with what each key means above it."""

from __future__ import annotations

import re
import textwrap
import tomllib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from taichi_membrane.scene import Scene
from taichi_membrane.scene.schema import meanings, written

_WIDTH = 110
_HEADER = re.compile(r"\s*\[")
_LEFT_OUT = ("checks",)  # they hold for the numbers of the scene that they were made for


def written_like(name: str, source: str, text: str) -> str:
    """The text of a scene called ``name`` that is otherwise as another one, without its checks, each key explained once.

    :param source: what the other one is called.
    :param text: its TOML, a valid scene.
    """
    scene = Scene.model_validate(tomllib.loads(text))
    lines = [f"# Written like {source}. Keys, units and defaults: taichi-membrane schema --page", ""]
    told: set[tuple[type[BaseModel], str]] = set()
    owner: Any = scene
    kept = True
    counts: dict[str, int] = {}
    for statement in _statements(text):
        if _HEADER.match(statement):
            owner, path = _table(scene, statement, counts)
            kept = path.split(".")[0] not in _LEFT_OUT
        elif (key := _key(statement)) is not None and isinstance(owner, BaseModel) and kept:
            lines += _explained(type(owner), key, told)
            statement = f'name = "{name}"' if owner is scene and key == "name" else statement
        if kept:
            lines.append(statement)
    if scene.checks:
        lines += ["", f"# The checks of {source} are left out: they hold for its numbers. One looks so:"]
        lines += ["# [[checks]]", *(f"# {line}" for line in _check(scene))]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def _statements(text: str) -> Iterator[str]:
    """Comments, headers, empty lines, and keys with all lines of their values, one after the other."""
    gathered = ""
    for line in text.splitlines():
        gathered = f"{gathered}\n{line}" if gathered else line
        try:
            tomllib.loads(gathered)
        except tomllib.TOMLDecodeError:
            continue  # a value of several lines
        yield gathered
        gathered = ""


def _key(statement: str) -> str | None:
    """The key that a statement gives a value; None of comments and empty lines."""
    return next(iter(tomllib.loads(statement)), None)


def _table(scene: Scene, header: str, counts: dict[str, int]) -> tuple[Any, str]:
    """What a header opens, and its dotted name.

    :param counts: how often each list was opened so far; kept up.
    """
    nested = tomllib.loads(header)
    owner: Any = scene
    names: list[str] = []
    while nested:
        ((name, inner),) = nested.items()
        names.append(name)
        path = ".".join(names)
        owner = owner[name] if isinstance(owner, dict) else getattr(owner, name, None)
        if isinstance(inner, list):
            counts[path] = counts.get(path, 0) + 1
        if isinstance(owner, list | tuple):
            owner = owner[counts[path] - 1]
        nested = inner[0] if isinstance(inner, list) else inner
    return owner, ".".join(names)


def _explained(model: type[BaseModel], key: str, told: set[tuple[type[BaseModel], str]]) -> list[str]:
    """What a key means, as comments; nothing where it was said before."""
    meaning = meanings(model).get(key)
    if meaning is None or (model, key) in told:
        return []
    told.add((model, key))
    words = " ".join(meaning.replace("``", "").split())
    return textwrap.wrap(words, _WIDTH, initial_indent="# ", subsequent_indent="#   ")


def _check(scene: Scene) -> Iterator[str]:
    """The first check of a scene, as lines."""
    given = scene.checks[0].model_dump(exclude_defaults=True, exclude_none=True)
    for key, value in given.items():
        yield f"{key} = {written(value)}"
