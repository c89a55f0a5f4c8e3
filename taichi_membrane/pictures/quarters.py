"""Six-node triangles as pictures have them: four flat ones each, at the corners and between the nodes amid the sides.

Each shows what the points nearest to it say: the first three points where strain is sampled are nearest to corners 0, 1 and 2, and
the rest, or where there is no rest all three, are about the middle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.names import WRINKLED


def by_quarter(at_points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4 m,) values of quarters from those at the points of m triangles, (m, 3) or (m, 6)."""
    inner = at_points[:, 3:] if at_points.shape[1] > 3 else at_points
    return np.column_stack([at_points[:, :3], inner.mean(axis=1)]).ravel()


def states_by_quarter(at_points: NDArray[np.int8]) -> NDArray[np.int8]:
    """(4 m,) states of quarters; in the middle wrinkled where the points there are not alike."""
    inner = at_points[:, 3:] if at_points.shape[1] > 3 else at_points
    middle = np.where((inner == inner[:, :1]).all(axis=1), inner[:, 0], WRINKLED)
    return np.column_stack([at_points[:, :3], middle]).astype(np.int8).ravel()


def spread(values: NDArray[Any]) -> NDArray[Any]:
    """(4 m, …) the values of triangles, (m, …), for each of their quarters."""
    return np.repeat(values, 4, axis=0)
