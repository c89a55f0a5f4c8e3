"""The page's block of numbers: arrays made small, one after the other, then zlib and base64.

Each array is stored as the differences of neighbours (of its unsigned bit patterns, modulo their range), the low bytes of all
first, then the next ones: neighbours in a mesh are alike, so that the planes of high bytes compress to little. Only quantising
loses digits.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["u8", "u16", "i16", "u32", "f32"]
Entry = dict[str, Any]

_TYPES: dict[Kind, str] = {"u8": "u1", "u16": "<u2", "i16": "<i2", "u32": "<u4", "f32": "<f4"}
MISSING = 65535  # code of a value that is not finite
LEVELS = 65534  # codes 0 … 65534 span a field's range
FULL_SCALE = 32767  # code of a vector field's largest component


class Pack:
    """Collects arrays; each gets an entry that says where it lies."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def add(self, values: NDArray[Any], kind: Kind) -> Entry:
        """Append an array in C order; the values must fit the kind."""
        stored = np.ascontiguousarray(values).astype(_TYPES[kind]).ravel()
        width = stored.dtype.itemsize
        bits = stored.view(f"<u{width}")
        differences = np.diff(bits, prepend=bits.dtype.type(0))  # unsigned: modulo the range
        entry = {"kind": kind, "offset": len(self._bytes), "count": len(stored)}
        self._bytes += differences.view(np.uint8).reshape(-1, width).T.tobytes()
        return entry

    def add_field(self, values: NDArray[np.float64], low: float, high: float) -> Entry:
        """Append values as whole numbers over a range; half a step, (high - low) / 131068, is the largest error."""
        return self.add(field_codes(values, low, high), "u16")

    def add_vectors(self, values: NDArray[np.float64]) -> Entry:
        """Append (k, 3) vectors, x of all first, scaled by their largest component; the error is at most half of ``scale``."""
        scale = float(np.abs(values).max(initial=0.0)) / FULL_SCALE or 1.0
        return {"scale": scale, "codes": self.add(np.rint(values.T / scale), "i16")}

    def text(self) -> str:
        """All arrays, compressed, as base64."""
        return base64.b64encode(zlib.compress(bytes(self._bytes), 9)).decode("ascii")


def field_codes(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Codes of values in a range: 0 for ``low``, 65534 for ``high``, 65535 for what is not finite."""
    share = (values - low) / (high - low) if high > low else np.zeros_like(values)
    return np.where(np.isfinite(values), np.rint(LEVELS * share), MISSING)


def finite_range(arrays: list[NDArray[np.float64]]) -> tuple[float, float]:
    """Least and largest finite value of all arrays; 0, 0 where there is none."""
    finite = np.concatenate([values[np.isfinite(values)] for values in arrays])
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
