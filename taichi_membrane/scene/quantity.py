"""Numbers with a unit as text, such as ``"35 kPa"``: read exactly, compared in dimension, converted to the scene's units.

The table of units is :data:`UNITS`. Products, quotients and powers of them are units as well: ``kN/m``, ``N/mm²``, ``g/m^2``,
``kN·m``, and ``daN/5cm``, as sheets of strip tests write. All factors are exact fractions, so that ``"0.8 mm"`` in a scene in mm is
the number 0.8 to the last bit. Scenes name no unit of time: in texts it is the second.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

Exponents = tuple[int, int, int, int]  # of mass, length, time and angle


@dataclass(frozen=True)
class Measure:
    """A unit: its size in kg, m, s and degrees, and the exponents of these."""

    size: Fraction
    of: Exponents

    def times(self, other: Measure, power: int) -> Measure:
        """The product with a power of another one."""
        exponents = tuple(one + power * two for one, two in zip(self.of, other.of, strict=True))
        return Measure(self.size * other.size**power, exponents)  # type: ignore[arg-type]


_MASS, _LENGTH, _TIME, _ANGLE = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
_FORCE, _STRESS, _VOLUME = (1, 1, -2, 0), (1, -1, -2, 0), (0, 3, 0, 0)
_ONE = Measure(Fraction(1), (0, 0, 0, 0))
# Exact by definition: inch, pound and standard gravity (1959, 1901); a column of water has 1000 kg/m³.
_G, _POUND, _INCH = Fraction("9.80665"), Fraction("0.45359237"), Fraction("0.0254")
_SIZES: tuple[tuple[Exponents, dict[str, Fraction | int | str]], ...] = (
    (_LENGTH, {"mm": "1/1000", "cm": "1/100", "m": 1, "in": _INCH, "ft": 12 * _INCH}),
    (_FORCE, {"N": 1, "daN": 10, "kN": 1000, "MN": 10**6, "kgf": _G, "lbf": _POUND * _G, "kip": 1000 * _POUND * _G}),
    (
        _STRESS,
        {
            "Pa": 1, "hPa": 100, "kPa": 1000, "MPa": 10**6, "GPa": 10**9, "mbar": 100, "bar": 10**5, "mmH2O": _G,
            "inH2O": 1000 * _G * _INCH, "psi": _POUND * _G / _INCH**2, "ksi": 1000 * _POUND * _G / _INCH**2,
            "psf": _POUND * _G / (12 * _INCH) ** 2,
        },
    ),
    (_VOLUME, {"L": "1/1000"}),
    (_MASS, {"g": "1/1000", "kg": 1, "t": 1000, "oz": _POUND / 16, "lb": _POUND}),
    (_TIME, {"s": 1, "ms": "1/1000"}),
    (_ANGLE, {"°": 1, "deg": 1}),
)  # fmt: skip
UNITS = {name: Measure(Fraction(size), of) for of, sizes in _SIZES for name, size in sizes.items()}
# What the brackets of a key's meaning call a dimension is written in these.
_WORDS = ("mass", "force", "length", "time", "degrees")
_NAMED: dict[Exponents, str] = {
    _LENGTH: "a length", (0, 2, 0, 0): "an area", _VOLUME: "a volume", _FORCE: "a force", _STRESS: "a pressure or stress",
    (1, 0, -2, 0): "a force per length", (1, 2, -2, 0): "a moment", (1, -2, -2, 0): "a weight per volume", _MASS: "a mass",
    (1, -2, 0, 0): "a mass per area", (1, -3, 0, 0): "a mass per volume", (1, -1, 0, 0): "a mass per length",
    _TIME: "a time", (0, 1, -2, 0): "an acceleration", _ANGLE: "an angle", (0, 0, 0, 0): "a mere number",
}  # fmt: skip
_POWERS = {"²": 2, "³": 3, "⁴": 4}
_TEXT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_FACTOR = re.compile(r"(\d{1,6})?\s*([^\W\d_²³⁴]+?H2O|[^\W\d_²³⁴]+|°)(?:\^?(-?\d)|([²³⁴]))?")
_PATTERN = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*\S.*$"

_units: ContextVar[Mapping[str, Measure] | None] = ContextVar("units", default=None)


def dimension_words(of: Exponents) -> str:
    """What has these exponents, in words."""
    return _NAMED.get(of) or "a quantity of another dimension"


def split(text: str) -> tuple[Fraction, str] | None:
    """Number and unit of a text; None where it does not begin with a number or has no unit behind it."""
    found = _TEXT.fullmatch(text) if len(text) <= 100 else None
    if found is None or not found[2] or len(found[1]) > 40 or abs(_exponent(found[1])) > 60:
        return None
    return Fraction(found[1]), found[2]


def _exponent(number: str) -> int:
    """Of ten, as written."""
    return int(re.split("[eE]", number)[1]) if re.search("[eE]", number) else 0


def measure(unit: str, table: Mapping[str, Measure] = UNITS) -> Measure:
    """Size and exponents of a unit.

    :raises ValueError: it is none; the message names the nearest one that is, and all that there are.
    """
    found, power, rest = _ONE, 1, unit.strip()
    while rest:
        factor = _FACTOR.match(rest)
        if factor is None:
            raise ValueError(f"{unit!r} is no unit; write such as kN/m, N/mm² or g/m^2")
        count, name, digit, raised = factor.groups()
        if name not in table:
            meant = difflib.get_close_matches(name, list(table), n=1)
            guess = f"did you mean {meant[0]!r}? " if meant else ""
            raise ValueError(f"unknown unit {name!r}; {guess}allowed: {', '.join(table)}, and what they make by · / ²")
        found = found.times(Measure(Fraction(count or 1), _ONE.of), power)
        found = found.times(table[name], power * (int(digit) if digit else _POWERS.get(raised or "", 1)))
        rest = rest[factor.end() :].lstrip()
        power = -1 if rest.startswith("/") else 1
        if rest[:1] in ("/", "·", "*", "."):
            rest = rest[1:].lstrip() or "?"  # a sign with nothing behind it is no unit
    return found


def exponents(dimension: str) -> Exponents:
    """Exponents of a dimension in words, such as ``force/length²``."""
    return measure(dimension, _words_in("m", "N")).of


@contextmanager
def in_units(length: str, force: str) -> Iterator[None]:
    """Convert the texts that are read within to these units of length and force, to seconds and degrees."""
    token = _units.set(_words_in(length, force))
    try:
        yield
    finally:
        _units.reset(token)


@cache
def _words_in(length: str, force: str) -> Mapping[str, Measure]:
    """The measures that ``length``, ``force``, ``time`` and ``degrees`` stand for."""
    sizes = (UNITS[force], UNITS[length], UNITS["s"], UNITS["deg"])
    return dict(zip(_WORDS[1:], sizes, strict=True))


def converted(text: str, dimension: str = "") -> float:
    """A text's number in the units of the scene that is being read.

    :param dimension: what is needed, in words such as ``force/length²``; anything when empty.
    :raises ValueError: an unknown unit, another dimension, or no scene whose units are known.
    """
    table = _units.get()
    parts = split(text)
    assert parts is not None
    number, unit = parts
    given = measure(unit)
    if table is None:
        raise ValueError(
            f"{text!r} has a unit, which only a scene can convert: give numbers here, or give Scene a table (dict) in its place"
        )
    if dimension:
        wanted = measure(dimension, table)
        if wanted.of != given.of:
            raise ValueError(
                f"{text!r} is {dimension_words(given.of)}, but {dimension_words(wanted.of)} [{dimension}] is needed"
            )
    return float(number * given.size / _coherent(given.of, table).size)


def _coherent(of: Exponents, table: Mapping[str, Measure]) -> Measure:
    """The unit of some exponents that is made of those of a scene."""
    mass, length, time, angle = of
    found = _ONE.times(table["force"], mass)  # a mass is force · time² / length
    found = found.times(table["length"], length - mass).times(table["time"], time + 2 * mass)
    return found.times(table["degrees"], angle)


@dataclass(frozen=True)
class Dimension:
    """Marks a number of a scene that may as well be a text with a unit of this dimension; of any when empty."""

    name: str = ""

    def read(self, value: Any) -> Any:
        """The number that a text with a unit stands for; all else as it is."""
        return converted(value, self.name) if isinstance(value, str) and split(value) is not None else value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [handler(core), {"type": "string", "pattern": _PATTERN}]}


LENGTH, AREA, VOLUME, FORCE = Dimension("length"), Dimension("length²"), Dimension("length³"), Dimension("force")
PER_LENGTH, STRESS, PER_VOLUME = Dimension("force/length"), Dimension("force/length²"), Dimension("force/length³")
MOMENT, ACCELERATION, DEGREES = Dimension("force · length"), Dimension("length/time²"), Dimension("degrees")
MASS_PER_LENGTH = Dimension("force · time²/length²")
MASS_PER_AREA = Dimension("force · time²/length³")
MASS_PER_VOLUME = Dimension("force · time²/length⁴")
ANY = Dimension()
