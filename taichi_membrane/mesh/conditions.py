"""Picks nodes or elements by a condition on their coordinates, such as ``x < 5 and y = 0 within 0.1``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError

if TYPE_CHECKING:
    from taichi_membrane.mesh import Mesh

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
_TERM = re.compile(rf"([xyzr])\s*(<=|>=|<|>|=)\s*({_NUMBER})(?:\s*within\s+({_NUMBER}))?", re.IGNORECASE)
_EXAMPLES = (
    "write for example 'x = 0 within 1e-6', 'z >= 3' or 'x < 5 and y = 0 within 0.1'; "
    "the coordinates are x, y, z and r, the distance from the z axis"
)


@dataclass(frozen=True)
class _Term:
    text: str
    coordinate: str
    comparison: str
    value: float
    tolerance: float

    def holds(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        if self.comparison == "=":
            return np.abs(values - self.value) <= self.tolerance
        compare = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}[self.comparison]
        return np.asarray(compare(values, self.value))


def select(mesh: Mesh, where: str, *, kind: Literal["nodes", "elements"], key: str) -> NDArray[np.int32]:
    """Return the sorted numbers of the nodes, or of the elements by their centroids, that meet a condition.

    :param where: comparisons ``=`` (with ``within`` and a tolerance), ``<``, ``<=``, ``>``, ``>=`` of x, y, z or r
        (distance from the z axis) with a number [length], joined by ``and``. Unstressed positions count.
    :param key: the scene key that holds the condition; begins every message.
    :raises InputError: the condition cannot be read, or nothing meets it.
    """
    terms = [_read_term(part, where, key) for part in re.split(r"\band\b", where, flags=re.IGNORECASE)]
    at = mesh.points if kind == "nodes" else mesh.points[mesh.triangles].mean(axis=1)
    values = {"x": at[:, 0], "y": at[:, 1], "z": at[:, 2], "r": np.hypot(at[:, 0], at[:, 1])}
    masks = [term.holds(values[term.coordinate]) for term in terms]
    found = np.flatnonzero(np.logical_and.reduce(masks)).astype(np.int32)
    if not found.size:
        told = "; ".join(_told(term, values[term.coordinate], mask) for term, mask in zip(terms, masks, strict=True))
        what = "node" if kind == "nodes" else "element (its centroid counts)"
        raise InputError(f"{key}: no {what} meets '{where}': {told}")
    return found


def _read_term(part: str, where: str, key: str) -> _Term:
    text = part.strip()
    match = _TERM.fullmatch(text)
    if match is None:
        raise InputError(f"{key}: cannot read '{text}' in the condition '{where}'; {_EXAMPLES}")
    coordinate, comparison, value, tolerance = match.groups()
    if (comparison == "=") != (tolerance is not None):
        fault = (
            "'=' needs 'within' and a tolerance" if comparison == "=" else f"'within' goes with '=', not '{comparison}'"
        )
        raise InputError(f"{key}: {fault} in '{text}'; {_EXAMPLES}")
    term = _Term(text, coordinate.lower(), comparison, float(value), float(tolerance or 0.0))
    if term.tolerance < 0.0 or not np.isfinite([term.value, term.tolerance]).all():
        raise InputError(f"{key}: '{text}' needs a finite value and a tolerance of at least 0")
    return term


def _told(term: _Term, values: NDArray[np.float64], mask: NDArray[np.bool_]) -> str:
    if mask.any():
        return f"'{term.text}' alone holds for {int(mask.sum())}"
    nearest = values[np.argmin(np.abs(values - term.value))]
    return (
        f"'{term.text}' holds for none, {term.coordinate} runs from {values.min():.6g} to {values.max():.6g} "
        f"and comes nearest at {nearest:.9g}"
    )
