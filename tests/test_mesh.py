"""The mesh record: topology, groups, selection by coordinates, and one message for every fault."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, select, with_groups

# A tetrahedron with outward normals: corner at the origin, three unit legs.
TETRA_POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
TETRA_TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SQUARE_POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
SQUARE_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def tetra() -> Mesh:
    return Mesh.build(TETRA_POINTS, TETRA_TRIANGLES)


def square() -> Mesh:
    return Mesh.build(SQUARE_POINTS, SQUARE_TRIANGLES)


def test_closed_body_knows_its_size() -> None:
    mesh = tetra()
    assert (mesh.node_count, mesh.tri_count, len(mesh.edges())) == (4, 4, 6)
    assert mesh.is_closed
    assert "boundary" not in mesh.node_groups
    assert len(mesh.boundary_edges()) == 0
    # A few operations on numbers of order one: exact to a few units in the last place.
    assert mesh.enclosed_volume() == pytest.approx(1 / 6, rel=1e-15)
    assert mesh.tri_areas() == pytest.approx([0.5, 0.5, 0.5, np.sqrt(3) / 2], rel=1e-15)
    expected = [[0, 0, -1], [0, -1, 0], [-1, 0, 0], [3**-0.5] * 3]
    assert mesh.tri_normals() == pytest.approx(np.array(expected), abs=1e-15)


def test_volume_far_from_the_origin_keeps_its_digits() -> None:
    turned = TETRA_POINTS @ np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    mesh = Mesh.build(turned + np.array([1e6, -2e6, 3e6]) / 3, TETRA_TRIANGLES)
    # With 16 digits a length of 1 at 1e6 keeps 1e-10; a sum about the origin would keep nothing (1e18 * 1e-16).
    assert mesh.enclosed_volume() == pytest.approx(1 / 6, rel=1e-8)


def test_open_surface_has_a_directed_boundary() -> None:
    mesh = square()
    assert not mesh.is_closed
    assert mesh.node_groups["boundary"].tolist() == [0, 1, 2, 3]
    assert {tuple(e) for e in mesh.boundary_edges().tolist()} == {(0, 1), (1, 2), (2, 3), (3, 0)}
    assert mesh.edges().tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
    with pytest.raises(InputError, match="4 edges are free"):
        mesh.enclosed_volume()


def test_components_label_nodes_joined_by_triangles() -> None:
    two = Mesh.build(
        np.concatenate((SQUARE_POINTS, SQUARE_POINTS + 5.0)), np.concatenate((SQUARE_TRIANGLES, SQUARE_TRIANGLES + 4))
    )
    label = two.components()
    assert label[:4].tolist() == [label[0]] * 4
    assert label[4:].tolist() == [label[4]] * 4
    assert sorted({*label.tolist()}) == [0, 1]
    assert tetra().components().tolist() == [0, 0, 0, 0]


def test_arrays_are_private_typed_and_read_only() -> None:
    points = SQUARE_POINTS.copy()
    mesh = Mesh.build(points, SQUARE_TRIANGLES, {"left": [3, 0, 3]}, {"first": [0]}, np.tile([2.0, 0, 1], (2, 1)))
    points[0] = 9.0
    assert mesh.points[0].tolist() == [0, 0, 0]
    assert mesh.points.dtype == np.float64
    assert mesh.triangles.dtype == np.int32
    assert mesh.node_groups["left"].tolist() == [0, 3]
    assert mesh.tri_groups["all"].tolist() == [0, 1]
    assert mesh.tri_warp is not None
    assert mesh.tri_warp.tolist() == [[1, 0, 0], [1, 0, 0]], "projected on the element and made unit"
    held = [mesh.points, mesh.triangles, mesh.tri_warp, *mesh.node_groups.values(), *mesh.tri_groups.values()]
    for array in held:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert all(group.dtype == np.int32 for group in (*mesh.node_groups.values(), *mesh.tri_groups.values()))


def needle() -> NDArray[np.float64]:
    points = SQUARE_POINTS.copy()
    points[3] = [0.5, 0.5 + 1e-13, 0.0]
    return points


TWO_TETRAS = np.concatenate((TETRA_TRIANGLES, TETRA_TRIANGLES[:, ::-1] + 4))


@pytest.mark.parametrize(
    ("points", "triangles", "words"),
    [
        ([[0, 0]], SQUARE_TRIANGLES, r"shape \(node_count, 3\), got \(1, 2\)"),
        ([["a", 0, 0]], SQUARE_TRIANGLES, "not an array of numbers"),
        ([[0, 0, 0], [1, 0]], SQUARE_TRIANGLES, "not an array of numbers"),
        (np.zeros((0, 3)), SQUARE_TRIANGLES, "no nodes"),
        (SQUARE_POINTS, np.zeros((0, 3), dtype=int), "no triangles"),
        (SQUARE_POINTS, [[0, 1, 2, 3]], r"shape \(tri_count, 3\), got \(1, 4\)"),
        (SQUARE_POINTS, SQUARE_TRIANGLES + 0.0, "whole numbers, got float64"),
        ([*SQUARE_POINTS[:3], [0, np.nan, 0]], SQUARE_TRIANGLES, r"node 3 has coordinates \(0.0, nan, 0.0\)"),
        (SQUARE_POINTS, [[0, 1, 2], [0, 2, 4]], "element 1 uses node 4, but node numbers run from 0 to 3"),
        (SQUARE_POINTS, [[0, 1, 2], [0, -2, 3]], "element 1 uses node -2, but node numbers run from 0 to 3"),
        (SQUARE_POINTS, [[0, 1, 2], [3, 2, 3]], r"element 1 repeats a node: \(3, 2, 3\)"),
        (needle(), SQUARE_TRIANGLES, r"element 1 \(nodes \(0, 2, 3\)\) is degenerate: area 5e-14 .* edge of 1.41"),
        ([*SQUARE_POINTS, [0, 0, 1], [0, 0, 2]], SQUARE_TRIANGLES, "2 of 6 nodes .* the first is node 4"),
        (SQUARE_POINTS, [[0, 1, 2], [0, 2, 3], [2, 0, 1]], r"elements 0 and 2 have the same three nodes \[0, 1, 2\]"),
        (SQUARE_POINTS, [[0, 1, 2], [0, 2, 3], [1, 0, 2]], "elements 0 and 2 have the same three nodes"),
        (SQUARE_POINTS, [[0, 1, 2], [0, 3, 2]], r"elements 0 and 1 run along .* nodes \(0, 2\).*1 such edges"),
        (TETRA_POINTS, TETRA_TRIANGLES[:, ::-1], "inside out: its enclosed volume is -0.166667"),
        (
            np.concatenate((TETRA_POINTS, TETRA_POINTS + 3.0)),
            TWO_TETRAS,
            "body with node 4, one of 1 such bodies, is inside out",
        ),
        (
            np.concatenate((TETRA_POINTS * 10.0 - 2.0, TETRA_POINTS)),
            np.concatenate((TETRA_TRIANGLES[:, ::-1], TETRA_TRIANGLES[:, ::-1] + 4)),
            "body with node 0, one of 2 such bodies, is inside out",
        ),
    ],
)
def test_faults_are_told_in_one_message(points: object, triangles: object, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Mesh.build(points, triangles, where="scene.toml: mesh")
    assert str(caught.value).startswith("scene.toml: mesh: ")
    assert "\n" not in str(caught.value)


def test_cavity_and_flat_body_are_right() -> None:
    # Double wall: gas between two skins; the inner one has its normals towards the cavity.
    outer = (TETRA_POINTS - 0.25) * 10.0
    hollow = Mesh.build(np.concatenate((outer, TETRA_POINTS - 0.25)), TWO_TETRAS)
    assert hollow.enclosed_volume() == pytest.approx((1000 - 1) / 6, rel=1e-12)  # round-off of 8 terms of up to 1e2
    flat = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0], [0.5, 0.5, 0]]
    fan = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    below = np.where(fan == 4, 5, fan)[:, ::-1]
    assert Mesh.build(flat, np.concatenate((fan, below))).enclosed_volume() == 0.0


@pytest.mark.parametrize(
    ("nodes", "elements", "warp", "words"),
    [
        ({"a": []}, {}, None, "node group 'a' is empty"),
        ({"a": [0, 4]}, {}, None, "node group 'a' holds 4, but node numbers run from 0 to 3"),
        ({}, {"skin": [-1]}, None, "element group 'skin' holds -1, but element numbers run from 0 to 1"),
        ({"a": [0.5]}, {}, None, "group 'a' must be whole numbers, got float64"),
        ({"a": [True, False, True, False]}, {}, None, "must be whole numbers, got bool"),
        ({" ": [0]}, {}, None, "must have a name"),
        ({"all": [0]}, {}, None, "'all' is reserved for all 4, the group given holds 1"),
        ({}, {}, [[1, 0, 0]], r"shape \(2, 3\), got \(1, 3\)"),
        ({}, {}, [[1, 0, 0], [0, 0, 2]], "warp direction .* of element 1 has no part in the element's plane"),
        ({}, {}, [[1, 0, 0], [0, 0, 0]], "of element 1 has no part"),
        ({}, {}, [[1, np.nan, 0], [1, 0, 0]], "of element 0 has no part"),
    ],
)
def test_faulty_groups_and_warp_are_refused(nodes: dict, elements: dict, warp: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Mesh.build(SQUARE_POINTS, SQUARE_TRIANGLES, nodes, elements, warp)


def test_groups_are_added_and_names_are_not_taken_twice() -> None:
    mesh = with_groups(square(), {"left": [3, 0]}, {"upper": [1]})
    assert mesh.node_groups["left"].tolist() == [0, 3]
    assert mesh.tri_groups["upper"].tolist() == [1]
    assert "boundary" in mesh.node_groups
    with pytest.raises(InputError, match="node group 'left' exists already, with 2 members"):
        with_groups(mesh, {"left": [1]})
    with pytest.raises(InputError, match="element group 'upper' holds 2, but"):
        with_groups(mesh, triangles={"upper": [2]})


@pytest.mark.parametrize(
    ("condition", "nodes"),
    [
        ("x = 1 within 1e-6", [1, 2]),
        ("x=1 within 0", [1, 2]),
        ("x <= 0.0", [0, 3]),
        ("X < 1 and y > .5", [3]),
        ("y >= 1 AND x >= 1e0", [2]),
        ("z = -0.5 within +0.5", [0, 1, 2, 3]),
        ("r < 1.1", [0, 1, 3]),
    ],
)
def test_nodes_are_selected_by_coordinates(condition: str, nodes: list[int]) -> None:
    assert select(square(), condition, kind="nodes", key="supports[0]").tolist() == nodes


def test_elements_are_selected_by_their_centroid() -> None:
    assert select(square(), "x > 0.5", kind="elements", key="k").tolist() == [0]
    assert select(square(), "r = 0.7453559925 within 1e-9", kind="elements", key="k").tolist() == [0, 1]


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("x = 1.25 within 0.1", "no node meets .*'x = 1.25 within 0.1' holds for none, x runs from 0 to 1 .* at 1$"),
        ("x > 0.5 and z > 2", "'x > 0.5' alone holds for 2; 'z > 2' holds for none, z runs from 0 to 0"),
        ("x = 1", "'=' needs 'within' and a tolerance"),
        ("x < 1 within 2", "'within' goes with '=', not '<'"),
        ("x == 1", "cannot read 'x == 1' in the condition"),
        ("w < 1", "cannot read 'w < 1'.*write for example 'x = 0 within 1e-6'"),
        ("x < 1 and", "cannot read ''"),
        ("", "cannot read ''"),
        ("x < 1 or y < 1", "cannot read 'x < 1 or y < 1'"),
        ("x < __import__('os')", "cannot read"),
        ("x = 0 within -1", "a tolerance of at least 0"),
        ("x < 1e999", "a finite value"),
    ],
)
def test_conditions_that_select_nothing_or_make_no_sense(condition: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        select(square(), condition, kind="nodes", key="supports[0].where")
    assert str(caught.value).startswith("supports[0].where: ")


def test_a_million_triangles_are_checked_without_loops() -> None:
    # Every fault must be found in the last element too, where an overflow of a 32-bit edge key would hide it.
    n = 710
    y, x = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    points = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate((np.column_stack((a, a + 1, a + n + 2)), np.column_stack((a, a + n + 2, a + n + 1))))
    assert Mesh.build(points, triangles).tri_count == 2 * n * n
    triangles[-1] = triangles[-1][::-1]
    with pytest.raises(InputError, match=f"and {len(triangles) - 1} run along"):
        Mesh.build(points, triangles)
