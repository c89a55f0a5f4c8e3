"""Reads a scene from TOML, with keys overridden by ``KEY=VALUE`` texts; finds the scenes that come with the package."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_membrane.errors import InputError, kind_of_path
from taichi_membrane.scene import Scene
from taichi_membrane.scene.messages import did_you_mean, mistakes, nearest, shown

LARGEST_FILE = 1_000_000  # bytes; a scene holds no mesh, so a larger file is not one
# A dotted key of many parts: reading it takes Python's TOML reader time with the square of their number.
_DEEP_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){40}""")


def load_scene(path: Path | str, overrides: Sequence[str] = ()) -> Scene:
    """Read and validate a scene file.

    :param path: the file; as a text also the name of a shipped scene.
    :param overrides: ``KEY=VALUE`` texts. KEY is dotted, such as ``mesh.around`` or ``stages.load.steps``; an item of a list
        goes by its ``name`` or its number from 1. VALUE is a TOML value; what is not one is taken as a text.
    :raises InputError: the file cannot be read, or is not a scene; the message names file, key and what is allowed.
    """
    path = resolve_scene(path) if isinstance(path, str) else path
    return with_overrides(path, read_data(path), overrides)


def read_data(path: Path) -> dict[str, Any]:
    """The tables of a scene file, not validated yet.

    :raises InputError: the file cannot be read, or is not TOML.
    """
    return _parse(path, _read(path))


def with_overrides(source: Path | str, data: dict[str, Any], overrides: Sequence[str]) -> Scene:
    """Validate a scene's tables with keys replaced as in :func:`load_scene`; ``data`` stays as it is.

    :param source: file or name, for messages.
    :raises InputError: not a scene.
    """
    changed = changed_data(source, data, overrides)
    try:
        return Scene.model_validate(changed)
    except ValidationError as error:
        told = mistakes(error, changed, Scene)
    where = f"{source} with {' '.join(overrides)}" if overrides and _is_scene(data) else str(source)
    raise InputError(f"{where}: {told}")


def changed_data(source: Path | str, data: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A scene's tables with keys replaced as in :func:`load_scene`, not validated; ``data`` stays as it is.

    :raises InputError: an override that is none, or a list on its way has no such item.
    """
    changed = copy.deepcopy(data)
    for override in overrides:
        _override(source, changed, override)
    return changed


def shipped_scenes() -> dict[str, Path]:
    """Name and file of each scene that comes with the package (in a checkout: of its top folder), sorted by name."""
    package = Path(__file__).resolve().parent.parent
    folder = package / "shipped_scenes"
    if not folder.is_dir() and (package.parent / "pyproject.toml").is_file():
        folder = package.parent / "scenes"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def resolve_scene(text: str) -> Path:
    """The scene file a user means: a path, or the name of a shipped scene.

    :raises InputError: neither.
    """
    if not text.strip():
        raise InputError("the name of the scene is empty: give a scene file, or the name of a shipped scene")
    path, shipped = Path(text), shipped_scenes()
    kind = kind_of_path(path)
    if kind == "file":
        return path
    if text in shipped:
        return shipped[text]
    if kind == "folder":
        raise InputError(f"{text}: a scene file is needed, this is a folder")
    guess = did_you_mean(nearest(text, shipped))
    raise InputError(
        f"{text}: no such scene file, nor a shipped scene of that name; {guess}shipped: {', '.join(shipped)}"
    )


def _read(path: Path) -> str:
    kind = kind_of_path(path)
    if kind != "file":
        fault = "there is no such scene file" if kind == "missing" else f"a scene file is needed, this is a {kind}"
        raise InputError(f"{path}: {fault}")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise InputError(f"{path}: {size} bytes are too many for a scene; {LARGEST_FILE} at most")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: the scene file cannot be read: {error.strerror}") from error
    try:
        return content.decode("utf-8-sig")  # editors on Windows put a byte-order mark first
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}: line {line} is not UTF-8 text: byte 0x{content[error.start]:02x} at offset {error.start}"
        ) from None


def _parse(path: Path, text: str) -> dict[str, Any]:
    deep = _DEEP_KEY.search(text)
    if deep is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise InputError(
            f"{path}: line {line} has a key of more than 40 parts: tables are nested too deeply for a scene"
        )
    try:
        return tomllib.loads(text)
    except ValueError as error:  # a number of thousands of digits raises this alone, all else is a TOMLDecodeError
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: lists or tables are nested too deeply for a scene") from None


def _is_scene(data: dict[str, Any]) -> bool:
    """Whether the file is a scene as it stands, so that what is wrong comes from the overrides."""
    try:
        Scene.model_validate(data)
    except ValidationError:
        return False
    return True


def _override(path: Path | str, data: dict[str, Any], text: str) -> None:
    """Put one value in place, making the tables on the way to it."""
    key, sign, value = text.partition("=")
    parts = [part.strip() for part in key.replace("[", ".").replace("]", "").split(".")]
    if not sign or not all(parts):
        raise InputError(f"override {text!r}: expected KEY=VALUE, such as mesh.around=64")
    place: Any = data
    for depth, part in enumerate(parts):
        if not isinstance(place, dict | list):
            held = shown(place)
            raise InputError(f"{path} with {text}: {'.'.join(parts[:depth])} is {held}, neither a table nor a list")
        at: Any = (
            _index(place, part, f"{path} with {text}: {'.'.join(parts[:depth])}") if isinstance(place, list) else part
        )
        if depth == len(parts) - 1:
            place[at] = _value(value)
        else:
            place = place.setdefault(at, {}) if isinstance(place, dict) else place[at]


def value_at(source: Path | str, data: dict[str, Any], key: str) -> Any:
    """What stands at a key as overrides write it; None where nothing does.

    :raises InputError: a list on the way has no such item.
    """
    place: Any = data
    for part in key.replace("[", ".").replace("]", "").split("."):
        if isinstance(place, list):
            place = place[_index(place, part, f"{source}: {key}")]
        else:
            place = place.get(part) if isinstance(place, dict) else None
    return place


def _index(items: list[Any], part: str, where: str) -> int:
    """Position of a list's item, given by its name or its number from 1."""
    names = [item.get("name") if isinstance(item, dict) else None for item in items]
    if part in names:
        return names.index(part)
    if part.isdecimal() and 1 <= int(part) <= len(items):
        return int(part) - 1
    allowed = [f"1 to {len(items)}", *(str(name) for name in names if name is not None)] if items else ["(no items)"]
    raise InputError(f"{where} has no item {part!r}; allowed: {', '.join(allowed)}")


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text.strip()
    # A text with a line break could smuggle in further keys.
    return parsed["value"] if parsed.keys() == {"value"} else text.strip()
