"""Meshes of which some triangles are bisected: conforming, on the true surface, with groups, lines and what nodes carry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from taichi_membrane import shapes
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.bisection import bisected

PANEL = {"width": 3.0, "height": 2.0, "along_x": 3, "along_y": 2}
TUBE = {"radius": 2.0, "length": 5.0, "around": 8, "along": 3, "cap_start": "none", "cap_end": "hemisphere"}


def some(mesh: Mesh, share: float = 0.2) -> NDArray[np.bool_]:
    return np.random.default_rng(3).random(mesh.tri_count) < share


def least_angle(mesh: Mesh) -> float:
    corners = mesh.points[mesh.triangles]
    side = np.linalg.norm(np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1), axis=2)
    a, b, c = side.T
    cosines = [
        (b**2 + c**2 - a**2) / (2 * b * c),
        (c**2 + a**2 - b**2) / (2 * c * a),
        (a**2 + b**2 - c**2) / (2 * a * b),
    ]
    return float(np.degrees(np.arccos(np.max(cosines))))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_closed_surface_stays_closed_and_the_rest_as_it_was(order: int, times: int) -> None:
    mesh = shapes.sphere(radius=1.5, divisions=3, order=order)
    marked = some(mesh, 0.1)
    found = bisected(mesh, marked, shapes.place_of("sphere", {"radius": 1.5}), times=times).mesh
    assert found.is_closed
    assert mesh.tri_count + times * marked.sum() <= found.tri_count < 2**times * mesh.tri_count
    assert np.array_equal(found.points[: mesh.node_count], mesh.points)
    assert np.linalg.norm(found.points, axis=1) == pytest.approx(1.5, rel=1e-12)
    kept = {frozenset(one) for one in mesh.cells.tolist()} & {frozenset(one) for one in found.cells.tolist()}
    assert len(kept) > 0.2 * mesh.tri_count


@pytest.mark.parametrize("order", [1, 2])
def test_marked_triangles_are_a_half_and_then_a_quarter_at_most(order: int) -> None:
    mesh = shapes.panel(**PANEL, order=order)  # type: ignore[arg-type]
    marked = np.arange(mesh.tri_count) == 4
    area = mesh.tri_areas()[4]
    labelled = Mesh.build(
        mesh.points, mesh.triangles, tri_groups={"it": [4], "others": np.flatnonzero(~marked)}, tri_middle=mesh.tri_middle,
        tri_fields={"number": np.arange(mesh.tri_count, dtype=float)},
    )  # fmt: skip
    for times in (1, 2):
        found = bisected(labelled, marked, None, times=times).mesh
        areas = found.tri_areas()
        assert areas[found.tri_groups["it"]].max() <= 0.5**times * area * (1 + 1e-12)
        assert areas[found.tri_groups["it"]].sum() == pytest.approx(area, rel=1e-12)
        assert areas.sum() == pytest.approx(6.0, rel=1e-12)
        assert len(found.tri_groups["it"]) + len(found.tri_groups["others"]) == found.tri_count
        assert set(found.tri_fields["number"][found.tri_groups["it"]]) == {4.0}


@pytest.mark.parametrize("order", [1, 2])
def test_what_is_of_the_elements_degree_is_carried_over_exactly(order: int) -> None:
    mesh = shapes.panel(**PANEL, order=order)  # type: ignore[arg-type]
    cut = bisected(mesh, some(mesh, 0.4), shapes.place_of("panel", PANEL), times=3)

    def values(points: Any) -> Any:
        x, y = points[:, 0], points[:, 1]
        return 1.0 + 2.0 * x - y + (order - 1) * (x**2 - 3.0 * x * y)

    assert cut.prolongation @ values(mesh.points) == pytest.approx(values(cut.mesh.points), abs=1e-12)


def test_angles_stay_bounded_towards_a_point() -> None:
    """Rivara: by half the least angle of the mesh; so much is never lost here."""
    mesh = shapes.disc(radius=1.0, rings=2)
    start = least_angle(mesh)
    for _ in range(12):
        at_rim = (np.linalg.norm(mesh.points[mesh.triangles] - [1.0, 0.0, 0.0], axis=2) < 1e-9).any(axis=1)
        mesh = bisected(mesh, at_rim, shapes.place_of("disc", {"radius": 1.0})).mesh
    assert least_angle(mesh) > 0.45 * start
    assert mesh.tri_areas().min() < 1e-3 * mesh.tri_areas().max()


@pytest.mark.parametrize("order", [1, 2])
def test_rings_get_their_new_nodes_and_none_beside(order: int) -> None:
    mesh = shapes.tube(**TUBE, order=order)  # type: ignore[arg-type]
    near = mesh.points[mesh.triangles][:, :, 0].min(axis=1) < 1e-9
    found = bisected(mesh, near, shapes.place_of("tube", TUBE), times=2).mesh
    for name, x in (("start", 0.0), ("end", 5.0)):
        there = np.flatnonzero(np.abs(found.points[:, 0] - x) < 1e-9)
        assert np.array_equal(found.node_groups[name], there)
    assert np.array_equal(found.node_groups["boundary"], found.node_groups["start"])
    assert len(found.node_groups["start"]) > len(mesh.node_groups["start"])
    assert len(found.node_groups["end"]) == len(mesh.node_groups["end"])


@pytest.mark.parametrize("order", [1, 2])
def test_an_even_ring_is_cut_all_round_or_not_at_all(order: int) -> None:
    mesh = shapes.tube(**TUBE, order=order)  # type: ignore[arg-type]
    on_end = np.isin(mesh.triangles, mesh.node_groups["end"]).sum(axis=1) == 2
    one = np.arange(mesh.tri_count) == np.flatnonzero(on_end)[0]
    place = shapes.place_of("tube", TUBE)
    for even, counts in (((), {9, 10, 11, 12}), (("end",), {16, 32})):
        found = bisected(mesh, one, place, times=4, even=even).mesh
        ring = found.points[found.node_groups["end"]]
        assert len(ring) // order in counts
        gaps = np.diff(np.sort(np.degrees(np.arctan2(ring[:, 2], ring[:, 1]))))
        assert (gaps.max() < 1.001 * gaps.min()) == bool(even)


@pytest.mark.parametrize("order", [1, 2])
def test_lines_along_edges_are_cut_with_them(order: int) -> None:
    panel = shapes.panel(**PANEL, order=order)  # type: ignore[arg-type]
    rim = np.flatnonzero(panel.points[:, 1] == 0.0)
    rim = rim[np.argsort(panel.points[rim, 0])]
    mesh = Mesh.build(
        panel.points, panel.triangles, tri_middle=panel.tri_middle, lines=np.column_stack([rim[:-1], rim[1:]]),
        line_groups={"hem": np.arange(len(rim) - 1)},
    )  # fmt: skip
    found = bisected(mesh, np.arange(mesh.tri_count) < 2, None, times=2).mesh
    ends = found.points[found.lines[found.line_groups["hem"]]]
    assert len(ends) > len(rim) - 1
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(3.0, rel=1e-12)
    keys = {tuple(one) for one in np.sort(found.edges(), axis=1).tolist()}
    assert all(tuple(sorted(one)) in keys for one in found.lines.tolist())


def test_walls_that_meet_are_cut_together() -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]
    mesh = Mesh.build(points, [[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    found = bisected(mesh, np.array([True, False, False]), None, times=3).mesh
    table = found.edge_table
    along = np.abs(found.points[table.nodes][:, :, 1:]).max(axis=(1, 2)) == 0.0
    assert (table.tri_count[along] == 3).all()
    assert found.tri_areas().sum() == pytest.approx(1.5, rel=1e-12)
