"""Turns what pydantic finds wrong with a scene into one line: which keys, what is wrong, what is allowed."""

from __future__ import annotations

import difflib
import re
import types
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

_LONGEST_VALUE = 60  # characters of a bad value that are repeated in a message
_MOST_TOLD = 8  # mistakes in one message; who mends these runs it again
_MOST_READ = 200  # errors that are put into words; a file full of rubbish has a hundred thousand
_COMPARED = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}
# Models that stand at a key where a plain value may stand as well.
_TABLES = ("ElementField", "WarpSource")
# What a value should have been, by the first word of pydantic's error type.
_WANTED = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "a text",
    "list": "a list",
    "tuple": "a list",
    "dict": "a table",
    "model": "a table",
}


@dataclass(frozen=True)
class Fault:
    """One thing wrong: the dotted key it concerns (empty for the whole scene) and what is wrong."""

    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.key}: {self.text}" if self.key else self.text


@dataclass(frozen=True)
class _Place:
    """Where an error is: key as the user writes it, and the model whose table the last part of the key is in."""

    key: str
    table: type[BaseModel] | None
    annotation: Any


def mistakes(error: ValidationError, data: Any, model: type[BaseModel]) -> str:
    """Every mistake in one line, the one that explains most first; of a great many the first ones, and how many are left.

    :param data: what was validated; names the items of lists.
    :param model: the model it was validated with.
    """
    faults, unread = _faults(error, data, model)
    left = len(faults[_MOST_TOLD:]) + unread
    return "; ".join(map(str, faults[:_MOST_TOLD])) + (f" (and {left} more)" if left else "")


def _faults(error: ValidationError, data: Any, model: type[BaseModel]) -> tuple[list[Fault], int]:
    """What is wrong, by key, and how many errors were not put into words."""
    details = [detail for detail in error.errors(include_url=False) if not _wrong_branch(detail)]
    # A misspelt key is both unknown and missing; what was written tells more than what was not.
    details.sort(key=lambda detail: detail["type"] != "extra_forbidden")
    details, unread = details[:_MOST_READ], len(details[_MOST_READ:])
    faults: dict[str, Fault] = {}
    explained: set[str] = set()
    for detail in details:
        place = _place(detail["loc"], data, model)
        if detail["type"] == "missing" and place.key in explained:
            continue
        if detail["type"] == "extra_forbidden":
            meant = nearest(str(detail["loc"][-1]), _keys(place.table))
            explained.update({_joined(place.key.rpartition(".")[0], meant)} if meant else ())
        fault = _fault(detail, place)
        faults.setdefault(fault.key, fault)
    return list(faults.values()), unread


def nearest(word: str, allowed: Iterable[str]) -> str | None:
    """The allowed word that was probably meant, if one is near enough."""
    found = difflib.get_close_matches(word, list(allowed), n=1)
    return found[0] if found else None


def not_one_of(word: str, allowed: Sequence[str]) -> str:
    """Say that a word is not allowed, which one was probably meant, and which are allowed."""
    meant = nearest(word, allowed)
    return f"{did_you_mean(meant)}allowed: {', '.join(allowed) or '(none)'}"


def did_you_mean(meant: str | None) -> str:
    """The question that suggests a word; empty without one."""
    return f"did you mean {meant!r}? " if meant else ""


def _wrong_branch(detail: ErrorDetails) -> bool:
    """Pydantic tries each branch of "a number or a table"; only the branch that fits what was given has something to say."""
    if any(str(part).startswith("dict[") for part in detail["loc"]):
        return detail["type"] == "dict_type"
    branch = _branch(str(detail["loc"][-1])) if detail["loc"] else ""
    if isinstance(detail["input"], dict):
        return branch in ("float", "constrained-float") or branch.startswith("tuple[")
    return detail["type"] == "model_type" and branch in _TABLES


def _place(location: tuple[int | str, ...], data: Any, model: type[BaseModel]) -> _Place:
    """Follow pydantic's location, dropping the tags and branch names it mixes into the keys."""
    key, value = "", data
    table: type[BaseModel] | None = None
    annotation: Any = model
    for part in location:
        bare = _bare(annotation)
        origin = get_origin(bare)
        if origin in (Union, types.UnionType):
            annotation = _member(bare, str(part))
            continue
        if part == "[key]":
            continue
        if isinstance(bare, type) and issubclass(bare, BaseModel):
            table = bare
            field = bare.model_fields.get(str(part))
            annotation = field.annotation if field else None
        else:
            arguments = get_args(bare)
            annotation = arguments[1 if origin is dict else 0] if arguments else None
        value = _item(value, part)
        key = item_key(key, part, value)
    return _Place(key, table, annotation)


def _bare(annotation: Any) -> Any:
    """An annotation without its constraints and without its None."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) in (Union, types.UnionType):
        members = [member for member in get_args(annotation) if member is not types.NoneType]
        if len(members) == 1:
            return _bare(members[0])
    return annotation


def _branch(label: str) -> str:
    """A branch's name without the validators that pydantic writes around it: of ``function-after[check(), Name]``, ``Name``."""
    while match := re.fullmatch(r"function-\w+\[[\w.]+\(\), (.*)\]", label):
        label = match[1]
    return label


def _member(union: Any, label: str) -> Any:
    """The member of a union that a tag (of models) or a branch name (of plain types) stands for."""
    label = _branch(label)
    for member in map(_bare, get_args(union)):
        if isinstance(member, type) and issubclass(member, BaseModel):
            if label == member.__name__ or label in _tags(member):
                return member
        elif label.removeprefix("constrained-").startswith(getattr(get_origin(member) or member, "__name__", "?")):
            return member
    return None


def _tags(model: type[BaseModel]) -> tuple[str, ...]:
    """The values of a model's first field, which is what tells the members of a union apart."""
    first = next(iter(model.model_fields.values())).annotation
    return get_args(first) if get_origin(first) is Literal else ()


def _item(value: Any, part: int | str) -> Any:
    try:
        return value[part]
    except (KeyError, IndexError, TypeError):
        return None


def _joined(table: str, key: str) -> str:
    return f"{table}.{key}" if table else key


def item_key(key: str, part: int | str, value: Any) -> str:
    """Items of a list go by their name where they have one, else by number, from 1."""
    if isinstance(part, str):
        return _joined(key, part)
    name = value.get("name") if isinstance(value, dict) else None
    return f"{key}.{name}" if isinstance(name, str) and name.isidentifier() else f"{key}[{part + 1}]"


def _keys(table: type[BaseModel] | None) -> tuple[str, ...]:
    return tuple(table.model_fields) if table is not None else ()


def _fault(detail: ErrorDetails, place: _Place) -> Fault:
    """Word one error; the tag errors concern the key of the tag inside the table they are reported for."""
    kind, context, given = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "extra_forbidden":
        return Fault(place.key, f"unknown key; {not_one_of(str(detail['loc'][-1]), _keys(place.table))}")
    if kind == "union_tag_invalid":
        key = _joined(place.key, context["discriminator"].strip("'"))
        allowed = re.findall(r"'([^']*)'", context["expected_tags"])
        return Fault(key, f"{shown(context['tag'])} is unknown; {not_one_of(str(context['tag']), allowed)}")
    if kind == "union_tag_not_found":
        key = _joined(place.key, context["discriminator"].strip("'"))
        allowed = [tag for member in get_args(_bare(place.annotation)) for tag in _tags(member)]
        return Fault(key, f"missing; allowed: {', '.join(allowed)}")
    if kind == "literal_error":
        allowed = re.findall(r"'([^']*)'", context["expected"])
        return Fault(place.key, f"{shown(given)} is unknown; {not_one_of(str(given), allowed)}")
    return Fault(place.key, _text(kind, context, given, detail["msg"]))


def _text(kind: str, context: dict[str, Any], given: Any, message: str) -> str:
    """Word an error that needs nothing but itself."""
    value = shown(given)
    if kind in _COMPARED:
        limit, relation = _COMPARED[kind]
        return f"{value} must be {relation} {context[limit]:g}"
    match kind:
        case "missing":
            return "missing"
        case "finite_number":
            return f"{value} must be a finite number"
        case "value_error":
            return str(context["error"])
        case "string_pattern_mismatch":
            return f"{value} does not match the pattern {context['pattern']}"
        case "string_too_short":
            return f"{value} is too short; {context['min_length']} characters at least"
        case "string_too_long":
            return f"{value} is too long; {context['max_length']} characters at most"
        case "too_short":
            return f"{context['actual_length']} items, but at least {context['min_length']} are needed"
        case "too_long":
            held = context["actual_length"] or len(given)  # pydantic does not count a table's keys
            return f"{held} items, but at most {context['max_length']} are allowed"
    wanted = _WANTED.get(kind.partition("_")[0])
    return f"must be {wanted}, not {value}" if wanted else message


def shown(value: Any) -> str:
    """A bad value as it is repeated in a message: short, whatever it is."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        return "a list"
    if isinstance(value, int) and value.bit_length() > 256:
        return f"a whole number of {value.bit_length()} bits"  # Python refuses to write the largest ones in decimal
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"
