"""Range checks for the arguments of parametric shapes."""

from __future__ import annotations

import math
import numbers

from taichi_membrane import bounds
from taichi_membrane.errors import InputError

# Node and element numbers are 32-bit and the solver keeps some hundred bytes per element: beyond this it is a slip.
MOST_TRIANGLES = 50_000_000
# Building and checking takes 320 to 370 bytes per triangle (measured); the divisions may count up to twice the triangles.
BYTES_PER_TRIANGLE = 160


def check_length(where: str, name: str, value: float) -> float:
    """Return a length, refused unless it is finite and above 0."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{where}: {name} = {value!r} must be a finite number above 0")
    return float(value)


def check_count(where: str, name: str, value: int, lowest: int) -> int:
    """Return a number of divisions, refused unless it is a whole number of at least ``lowest``."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < lowest:
        raise InputError(f"{where}: {name} = {value!r} must be a whole number of at least {lowest}")
    return int(value)


def check_between(where: str, name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return a number, refused unless it is finite and from ``low`` to ``high``; ``unit`` ends the message."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not low <= value <= high:
        told = f" {unit}" if unit else ""
        raise InputError(f"{where}: {name} = {value!r} must be from {low:g} to {high:g}{told}")
    return float(value)


def check_multiple(where: str, name: str, value: int, part: int, what: str) -> int:
    """Return a number of divisions, refused unless it is a whole number of ``part``; ``what`` tells why."""
    if check_count(where, name, value, part) % part:
        raise InputError(f"{where}: {name} = {value} must be a multiple of {part}, {what}")
    return value


def check_name(where: str, name: str, value: str, allowed: tuple[str, ...]) -> None:
    """Refuse a word that is not among the allowed ones."""
    if value not in allowed:
        raise InputError(f"{where}: {name} = {value!r} must be one of {', '.join(allowed)}")


def check_size(where: str, tri_count: int) -> None:
    """Refuse a shape of more triangles than a computer holds."""
    if tri_count > MOST_TRIANGLES:
        raise InputError(f"{where}: the divisions give {tri_count} triangles, at most {MOST_TRIANGLES} are allowed")
    short = bounds.shortage(BYTES_PER_TRIANGLE * tri_count)
    if short is not None:
        raise InputError(f"{where}: the divisions give up to {tri_count} triangles; a mesh of that size {short}")
