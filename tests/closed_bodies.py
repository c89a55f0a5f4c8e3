"""Volumes and areas of element groups, and how fast they come near to closed forms."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mesh import Mesh


def volume(mesh: Mesh, *groups: tuple[str, int]) -> float:
    """Volume that element groups enclose, their normals outwards for sign 1; fails where they leave a hole."""
    corners = np.concatenate([mesh.triangles[mesh.tri_groups[name]][:, ::sign] for name, sign in groups])
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there = np.unique(pairs, axis=0, return_counts=True)
    back = np.unique(pairs[:, ::-1], axis=0, return_counts=True)
    assert (there[0] == back[0]).all(), "closed, and each edge run both ways"
    assert (there[1] == back[1]).all()
    return float(np.linalg.det(mesh.points[corners]).sum() / 6)


def area(mesh: Mesh, group: str) -> float:
    return float(mesh.tri_areas()[mesh.tri_groups[group]].sum())


def assert_second_order(values: list[float], exact: float, share: float) -> None:
    """Errors fall by four with each halving, and the last one is below a share."""
    error = np.abs(np.array(values) / exact - 1)
    assert (np.log2(error[:-1] / error[1:]) > 1.9).all(), error
    assert error[-1] < share
