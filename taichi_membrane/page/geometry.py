"""Where things are on the page's picture: the sphere it shows, marks that keep apart, directions as angles, margins at nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from taichi_membrane.mesh import Mesh
from taichi_membrane.names import WRINKLED
from taichi_membrane.simulation.results import Floats, StepResult

HALF_TURN = 256  # codes of a direction, which is the same after half a turn


def bounding_sphere(mesh: Mesh, steps: tuple[StepResult, ...]) -> tuple[Floats, float]:
    """Middle of the box around all positions of a run, and a radius about it that holds them."""
    sets = [mesh.points, *(mesh.points + step.displacement for step in steps)]
    low = np.min([points.min(axis=0) for points in sets], axis=0)
    high = np.max([points.max(axis=0) for points in sets], axis=0)
    centre = 0.5 * (low + high)
    return centre, max(float(np.linalg.norm(points - centre, axis=1).max()) for points in sets)


def apart(points: Floats, distance: float) -> NDArray[np.intp]:
    """Numbers of some of the points (k, 3), none nearer to another than a distance; the first ones win."""
    free = np.ones(len(points), dtype=bool)
    tree = cKDTree(points) if len(points) else None
    kept = []
    for number, point in enumerate(points):
        if free[number] and tree is not None:
            kept.append(number)
            free[tree.query_ball_point(point, distance)] = False
    return np.array(kept, dtype=np.intp)


def direction_codes(mesh: Mesh, step: StepResult) -> NDArray[np.int64]:
    """(m,) angle of the major stress from an element's first side, counter-clockwise about its normal, in 256ths of half a turn.

    Zero where the element is not wrinkled.
    """
    corners = (mesh.points + step.displacement)[mesh.triangles]
    side, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(np.cross(side, other), side)
    lengths = [np.linalg.norm(vectors, axis=1).clip(1e-300) for vectors in (side, across)]
    along = step.elements.major_direction
    x, y = ((along * vectors).sum(axis=1) / length for vectors, length in zip((side, across), lengths, strict=True))
    codes = np.rint(np.arctan2(y, x) * HALF_TURN / np.pi).astype(np.int64) % HALF_TURN
    return np.where(step.elements.state == WRINKLED, codes, 0)


def node_means(mesh: Mesh) -> csr_array:
    """(n, m) matrix that takes values of elements to nodes: means weighted by the elements' areas."""
    area = mesh.tri_areas()
    total = np.bincount(mesh.triangles.ravel(), weights=np.repeat(area, 3), minlength=mesh.node_count)
    columns = np.repeat(np.arange(mesh.tri_count), 3)
    rows = mesh.triangles.ravel()
    return csr_array((area[columns] / total[rows], (rows, columns)), shape=(mesh.node_count, mesh.tri_count))
