"""Rigid motions that supports leave free, described in words."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, rigid_motions_left
from taichi_membrane.shapes import panel, sphere, tube

ALL_SIX = [f"translation along {axis}" for axis in "xyz"]


def fixed(mesh: Mesh, *held: tuple[str, str]) -> NDArray[np.bool_]:
    """Mark (group, components) such as ("start", "xz")."""
    mask = np.zeros((mesh.node_count, 3), dtype=bool)
    for group, components in held:
        for component in components:
            mask[mesh.node_groups[group], "xyz".index(component)] = True
    return mask


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_free_body_has_six(size: float) -> None:
    ball = sphere(radius=size, divisions=2)
    told = rigid_motions_left(ball, fixed(ball))
    assert told == ALL_SIX + [f"rotation about {axis} through (0, 0, 0)" for axis in "xyz"]


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_clamped_ring_holds_all(size: float) -> None:
    mesh = tube(radius=size, length=4 * size, around=8, along=4)
    assert rigid_motions_left(mesh, fixed(mesh, ("start", "xyz"))) == []


def test_pinned_node_leaves_three_rotations_through_it() -> None:
    mesh = panel(width=3.0, height=2.0, along_x=3, along_y=2)
    told = rigid_motions_left(mesh, fixed(mesh, ("corner_11", "xyz")))
    assert told == [f"rotation about {axis} through (3, 2, 0)" for axis in "xyz"]


def test_two_pinned_nodes_leave_their_hinge() -> None:
    mesh = panel(width=2.0, height=2.0, along_x=2, along_y=2)
    hinge = fixed(mesh, ("corner_00", "xyz"), ("corner_11", "xyz"))
    assert rigid_motions_left(mesh, hinge) == ["rotation about (0.7071, 0.7071, 0) through (1, 1, 0)"]
    assert rigid_motions_left(mesh, fixed(mesh, ("y_min", "xyz"))) == ["rotation about x through (1, 0, 0)"]


def test_supports_that_guide() -> None:
    mesh = panel(width=2.0, height=2.0, along_x=2, along_y=2)
    assert rigid_motions_left(mesh, fixed(mesh, ("all", "z"))) == [
        "translation along x",
        "translation along y",
        "rotation about z through (1, 1, 0)",
    ]
    # No x part at (0, 0) and no y part at (2, 2): the turning point has the y of the one and the x of the other.
    off_centre = fixed(mesh, ("all", "z"), ("corner_00", "x"), ("corner_11", "y"))
    assert rigid_motions_left(mesh, off_centre) == ["rotation about z through (2, 0, 0)"]
    # Held against z, and against y on the edge y = 0: the panel may slide along x and nothing else.
    assert rigid_motions_left(mesh, fixed(mesh, ("all", "z"), ("y_min", "y"))) == ["translation along x"]


def test_a_small_clamped_patch_holds_all() -> None:
    mesh = panel(width=1.0, height=1.0, along_x=100, along_y=100)
    mask = np.zeros((mesh.node_count, 3), dtype=bool)
    mask[mesh.triangles[0]] = True
    assert rigid_motions_left(mesh, mask) == []


def test_symmetry_planes_of_an_octant_hold_all() -> None:
    ball = sphere(radius=1.0, divisions=4)
    mask = np.abs(ball.points) < 1e-12  # a node on a plane of symmetry stays in it; exact zeros by construction
    assert rigid_motions_left(ball, mask) == []


def test_a_screw_is_not_called_a_rotation() -> None:
    # The velocity a + a x r with a = (1, 1, 1) has no x part where y - z = 1, no y part where z - x = 1 and no z part
    # where x - y = 1; two nodes of each kind leave that screw of pitch 1 and nothing else.
    points = [[0.0, 1, 0], [0, 3, 2], [0, 0, 1], [2, 0, 3], [1, 0, 0], [3, 2, 0]]
    mesh = Mesh.build(points, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    mask = np.zeros((6, 3), dtype=bool)
    mask[[0, 1, 2, 3, 4, 5], [0, 0, 1, 1, 2, 2]] = True
    assert rigid_motions_left(mesh, mask) == [
        "rotation about (0.5774, 0.5774, 0.5774) through (1, 1, 1) with an advance of 1 per radian along it"
    ]


def test_every_part_is_named() -> None:
    one = panel(width=1.0, height=1.0, along_x=1, along_y=1)
    mesh = Mesh.build(
        np.concatenate((one.points, one.points + np.array([5.0, 0, 0]))),
        np.concatenate((one.triangles, one.triangles + 4)),
    )
    mask = np.zeros((8, 3), dtype=bool)
    mask[:4] = True
    mask[4:, 2] = True
    mask[4, 1] = mask[5, 1] = True
    assert rigid_motions_left(mesh, mask) == ["translation along x of the part with node 4 (4 nodes)"]


def test_wrong_shape_is_refused() -> None:
    one = panel(width=1.0, height=1.0, along_x=1, along_y=1)
    with pytest.raises(InputError, match=r"shape \(4, 3\), got \(4,\)"):
        rigid_motions_left(one, np.zeros(4, dtype=bool))
