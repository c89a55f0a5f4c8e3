"""The scene's schema with its words: what each key means, its unit, default, allowed values and an example.

The words stand below each field of the models, where whoever changes a field sees them. They are read from the source when the
schema is asked for: read at import, as pydantic can do, they would cost every start a tenth of a second.
"""

from __future__ import annotations

import ast
import inspect
import json
import tomllib
import types
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from taichi_membrane.scene import Scene
from taichi_membrane.scene.base import AllowedNames
from taichi_membrane.scene.file import shipped_scenes
from taichi_membrane.scene.quantity import UNITS

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Examples longer than this tell less than they cost.
_LONGEST_EXAMPLE = 100


@cache
def meanings(model: type[BaseModel]) -> dict[str, str]:
    """The text below each field of a model, or of a model that it extends, by the field's name."""
    (body,) = ast.parse(inspect.getsource(model)).body
    assert isinstance(body, ast.ClassDef)
    base = model.__bases__[0]
    found = dict(meanings(base)) if issubclass(base, BaseModel) and base.model_fields else {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            assert isinstance(field.target, ast.Name)
            found[field.target.id] = inspect.cleandoc(str(text.value.value))
    return found


def models() -> list[type[BaseModel]]:
    """The models of a scene: the scene itself, and those its fields refer to, in that order."""
    found: list[type[BaseModel]] = [Scene]
    for model in found:
        for field in model.model_fields.values():
            found += [one for one in _models_in(field.annotation) if one not in found]
    return found


def schema() -> dict[str, Any]:
    """The JSON schema of a scene, each key with its meaning and, where a shipped scene uses it, examples."""
    made = Scene.model_json_schema()
    given = examples()
    for model in models():
        table = made if model is Scene else made["$defs"][model.__name__]
        for key, entry in table["properties"].items():
            entry["description"] = meanings(model)[key]
            if (model, key) in given:
                entry["examples"] = [given[model, key]]
    return {"$schema": _DIALECT, **made}


@cache
def examples() -> dict[tuple[type[BaseModel], str], Any]:
    """The first short value that a shipped scene gives a key, by model and key."""
    found: dict[tuple[type[BaseModel], str], Any] = {}
    for path in shipped_scenes().values():
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        for model, key, value in _given(Scene.model_validate(data), data):
            if len(json.dumps(value)) <= _LONGEST_EXAMPLE:
                found.setdefault((model, key), value)
    return found


def page() -> str:
    """docs/scene.md: a table for each model."""
    lines = [
        "# Keys of a scene",
        "",
        "Made by `taichi-membrane schema --page` from the models in `taichi_membrane/scene/`; do not edit. Units stand in",
        "brackets; length and force are those of `[units]`. A number of a dimension may be a text with its own unit, such as",
        '`"35 kPa"`, `"0.8 mm"`, `"800 kN/m"` or `"430 daN/5cm"`: it is converted. Units are those of',
        f"{', '.join(f'`{name}`' for name in UNITS)}, and their products, quotients and powers (`·`, `/`, `²`).",
        "Examples are from the shipped scenes. For completion in an editor",
        "that knows JSON schemas for TOML, save `taichi-membrane schema` as `scene.schema.json` and put",
        "`#:schema scene.schema.json` on the first line of a scene.",
    ]
    for model in models():
        text = inspect.cleandoc(model.__doc__ or "").replace("``", "`")
        lines += [
            "",
            f"## {model.__name__}",
            "",
            text,
            "",
            "| key | value | default | meaning | example |",
            "| --- | --- | --- | --- | --- |",
        ]
        for key, field in model.model_fields.items():
            default = "" if field.is_required() else f"`{written(field.get_default(call_default_factory=True))}`"
            example = f"`{written(examples()[model, key])}`" if (model, key) in examples() else ""
            named = next(
                (one for one in _marks((*field.metadata, field.annotation)) if isinstance(one, AllowedNames)), None
            )
            kind = _kind(field.annotation) if named is None else ", ".join(f"`{name}`" for name in named.names())
            cells = (f"`{key}`", kind, default, meanings(model)[key].replace("``", "`"), example)
            lines.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _given(instance: BaseModel, data: Any) -> Iterator[tuple[type[BaseModel], str, Any]]:
    """Model, key and value as written of every key that a scene sets."""
    for key in type(instance).model_fields:
        if key not in data:
            continue
        yield type(instance), key, data[key]
        value, written = getattr(instance, key), data[key]
        if isinstance(value, BaseModel):
            yield from _given(value, written)
        elif isinstance(value, dict):
            for name, item in value.items():
                if isinstance(item, BaseModel):
                    yield from _given(item, written[name])
        elif isinstance(value, list):
            for item, item_written in zip(value, written, strict=True):
                if isinstance(item, BaseModel):
                    yield from _given(item, item_written)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models that an annotation names, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _marks(parts: tuple[Any, ...]) -> Iterator[Any]:
    """What annotations are marked with, however deep."""
    for part in parts:
        yield part
        yield from _marks((*get_args(part), *getattr(part, "__metadata__", ())))


def _kind(annotation: Any) -> str:
    """What may stand at a key, in words."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(arguments[0])
    if origin in (Union, types.UnionType):
        return " or ".join(_kind(one) for one in arguments if one is not types.NoneType)
    if origin is Literal:
        return ", ".join(f"`{one}`" for one in arguments)
    if origin is tuple:
        return f"{len(arguments)} numbers"
    if origin is list:
        return f"list of {_kind(arguments[0])}"
    if origin is dict:
        return f"table: name → {_kind(arguments[1])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}[annotation]


def written(value: Any) -> str:
    """A value as it stands in a scene file; a default that is no value as a dash."""
    if isinstance(value, BaseModel):
        return written({key: getattr(value, key) for key in value.model_fields_set})
    if value is None:
        return "–"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {written(item)}" for key, item in value.items()) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
