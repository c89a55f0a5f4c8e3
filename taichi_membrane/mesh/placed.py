"""A mesh with its nodes at other places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import check
from taichi_membrane.mesh.surface import Mesh


def placed(mesh: Mesh, points: NDArray[np.float64]) -> Mesh:
    """The mesh with the same elements and groups, its nodes at ``points`` (node_count, 3).

    Its warp is projected on the elements there. A warp that is normal to its element is left as it was.
    """
    warp = mesh.tri_warp
    if warp is not None:
        vector = check.area_vectors(points, mesh.triangles)
        normal = vector / np.linalg.norm(vector, axis=1, keepdims=True)
        along = warp - np.einsum("ij,ij->i", warp, normal)[:, None] * normal
        length = np.linalg.norm(along, axis=1, keepdims=True)
        warp = check.frozen(np.where(length > 1e-6, along / np.maximum(length, 1e-6), warp))
    moved = replace(mesh, points=check.frozen(np.array(points, dtype=np.float64)), tri_warp=warp)
    if "_edges" in mesh.__dict__:
        moved.__dict__["_edges"] = mesh.__dict__["_edges"]  # a matter of the elements alone
    return moved
