"""How many digits a mesh's coordinates really have, from the numbers themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Rounded text is told from exact numbers by its fifth digit: a model drawn on whole millimetres of a hundred metres is not rounded.
_ROUNDED = 2e-5
_SAMPLE = 100_000  # coordinates that are looked at: digits do not depend on the place


def resolution(points: NDArray[np.float64]) -> float:
    """Size of the last digit of the coordinates [length]: of single precision, of text with few digits, or of double precision.

    Fixed decimals ("%.6f") and fixed digits ("%.6e", "%g") are told apart. Numbers that need no rounding, such as 0, 1 and 2, have
    the last digit of single precision: nothing tells that they have more.
    """
    values = np.abs(points[np.isfinite(points)])
    largest = float(values.max(initial=0.0))
    if largest == 0.0:
        return 0.0
    values = values[:: max(1, values.size // _SAMPLE)]
    with np.errstate(over="ignore"):
        single = bool((values.astype(np.float32).astype(np.float64) == values).all())
    found = float(np.finfo(np.float32 if single else np.float64).eps) * largest
    order = int(np.floor(np.log10(largest))) + 1  # digits before the point
    for digits in range(1, 13):
        step = 10.0 ** (order - digits)
        if step < found:
            break
        if _decimals(values, digits - order) or _significant(values, digits):
            return step if step <= _ROUNDED * largest else found
    return found


def _decimals(values: NDArray[np.float64], decimals: int) -> bool:
    """Whether all values are rounded to so many places after the point."""
    if abs(decimals) > 300:
        return False
    return bool((np.abs(np.round(values, decimals) - values) <= 4e-16 * values).all())


def _significant(values: NDArray[np.float64], digits: int) -> bool:
    """Whether all values have so few significant digits."""
    held = values[values > 1e-290]
    places = digits - 1 - np.floor(np.log10(held))
    # In two factors: ten to the power of three hundred has no room for more.
    half = np.trunc(places / 2)
    scaled = held * 10.0**half * 10.0 ** (places - half)
    return bool((np.abs(np.round(scaled) - scaled) <= 4e-16 * scaled + 1e-300).all())
