"""Fabrics by name: numbers of ``fabrics.toml`` that stand where a scene gives none, each with its source and what it is worth."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from taichi_membrane.scene.messages import not_one_of

_MODULI = ("E", "E_warp", "E_weft", "G", "stiffness", "stiffness_warp", "stiffness_weft", "G_t")
_STRENGTHS = ("strength", "strength_warp", "strength_weft")
KINDS = ("measured", "sheet", "assumed")


@dataclass(frozen=True)
class Entry:
    """A number of a preset.

    :param value: as a scene has it, a number or a text with a unit.
    :param kind: ``measured``, of a ``sheet``, or ``assumed``.
    :param source: where it comes from; empty of what is assumed.
    """

    value: float | str
    kind: str
    source: str


def names() -> list[str]:
    """Names of all presets."""
    return [name for name in _tables() if name != "sources"]


def title(name: str) -> str:
    """What a preset is."""
    return str(_tables()[name]["title"])


def entries(name: str) -> dict[str, Entry]:
    """The numbers of a preset by their keys of a fabric."""
    found, sources = {}, _tables()["sources"]
    for key, given in _tables()[name].items():
        if key != "title":
            value, kind, *source = given
            found[key] = Entry(value, kind, sources[source[0]] if source else "")
    return found


@cache
def _tables() -> dict[str, dict[str, Any]]:
    return tomllib.loads(files("taichi_membrane.scene").joinpath("fabrics.toml").read_text(encoding="utf-8"))


def used(given: Mapping[str, Any]) -> dict[str, Entry]:
    """The numbers that a fabric, as it was written, takes from its preset: those of keys that it does not give.

    Moduli of another kind than those of the preset replace them all. Strengths count only beside a ``safety``, and not beside own.

    :raises ValueError: no such preset.
    """
    name = given["preset"]
    if name not in names():
        raise ValueError(f"preset: {name!r} is unknown; {not_one_of(str(name), names())}")
    found = {key: entry for key, entry in entries(name).items() if given.get(key) is None}
    other = any(given.get(key) is not None and key not in entries(name) for key in (*_MODULI, "thickness"))
    if other and "E" not in entries(name):
        found = {key: entry for key, entry in found.items() if key not in _MODULI}
    if given.get("mass_per_area") is not None:
        found.pop("density", None)
    if given.get("density") is not None:
        found.pop("mass_per_area", None)
    if given.get("safety") is None or any(given.get(key) is not None for key in _STRENGTHS):
        found = {key: entry for key, entry in found.items() if key not in _STRENGTHS}
    return found


def filled(given: Any) -> Any:
    """A fabric as it was written, with the numbers of its preset in place of those that it does not give.

    :raises ValueError: no such preset.
    """
    if not isinstance(given, Mapping) or given.get("preset") is None:
        return given
    numbers = used(given)
    more: dict[str, Any] = {key: entry.value for key, entry in numbers.items()}
    strengths = [entry for key, entry in numbers.items() if key in _STRENGTHS]
    if strengths and not given.get("strength_source"):
        more["strength_source"] = f"preset {given['preset']}, {strengths[0].kind}: {strengths[0].source}"
    return {**given, **more}


def told(data: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Of each fabric of a scene, as it was written, that has a preset: its key, and a number of it with its source, in words."""
    fabrics = {
        "fabric": data.get("fabric"),
        **{f"fabrics.{name}": one for name, one in data.get("fabrics", {}).items()},
    }
    for key, given in fabrics.items():
        if isinstance(given, Mapping) and given.get("preset") is not None:
            yield key, f"preset {given['preset']}: {title(given['preset'])}"
            for number, entry in used(given).items():
                worth = f"{entry.kind}, {entry.source}" if entry.source else f"{entry.kind}: without a source"
                yield key, f"{number} = {entry.value} ({worth})"
