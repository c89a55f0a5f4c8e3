"""Local systems of coordinates of mesh files: cylinders, spheres, rotations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray


def to_cartesian(system: str, numbers: Sequence[float]) -> NDArray[np.float64]:
    """Cartesian coordinates from those of a system: R as they are, C (r, θ, z), S (r, φ, θ) as Abaqus counts; degrees.

    Abaqus' sphere: φ about z from x, θ up from the plane of x and y.
    """
    if system == "R":
        return np.array(numbers)
    radius, angle, third = numbers[0], np.radians(numbers[1]), numbers[2]
    if system == "C":
        return np.array([radius * np.cos(angle), radius * np.sin(angle), third])
    up = np.radians(third)
    return radius * np.array([np.cos(angle) * np.cos(up), np.sin(angle) * np.cos(up), np.sin(up)])


def about_axis(axis: ArrayLike, degrees: float) -> NDArray[np.float64]:
    """The matrix (3, 3) that turns vectors about an axis."""
    direction = np.asarray(axis, dtype=np.float64)
    return np.asarray(
        scipy.spatial.transform.Rotation.from_rotvec(
            degrees * direction / np.linalg.norm(direction), degrees=True
        ).as_matrix()
    )
