"""Meshes cut in four: places, groups, lines, and what is carried over to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.quarters import quartered
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.refined import refined

PANEL = {"width": 3.0, "height": 2.0, "along_x": 3, "along_y": 2}


def panel(order: int = 1, **more: int) -> Mesh:
    return shapes.panel(**{**PANEL, **more}, order=order)  # type: ignore[arg-type]


@pytest.mark.parametrize("order", [1, 2])
def test_a_panel_cut_in_four_is_the_panel_of_twice_as_many_cells(order: int) -> None:
    """Points, groups and triangles, whatever their numbers are."""
    found, twice = quartered(panel(order), shapes.place_of("panel", PANEL)).mesh, panel(order, along_x=6, along_y=4)
    at = {tuple(place): number for number, place in enumerate(np.round(twice.points, 9))}
    number = np.array([at[tuple(place)] for place in np.round(found.points, 9)])
    assert len(np.unique(number)) == found.node_count == twice.node_count
    assert set(found.node_groups) == set(twice.node_groups) - {"centre"}  # where the coarse panel has no node
    for name, members in twice.node_groups.items():
        if name == "centre":
            continue
        assert np.array_equal(np.sort(number[found.node_groups[name]]), members), name
    cells = {frozenset(one) for one in twice.cells.tolist()}
    assert {frozenset(one) for one in number[found.cells].tolist()} == cells
    assert found.tri_areas().sum() == pytest.approx(6.0, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_what_is_of_the_elements_degree_is_carried_over_exactly(order: int) -> None:
    mesh = panel(order)
    cut = quartered(mesh, shapes.place_of("panel", PANEL))

    def values(points: Any) -> Any:
        x, y = points[:, 0], points[:, 1]
        return 1.0 + 2.0 * x - y + (order - 1) * (x**2 - 3.0 * x * y)

    assert cut.prolongation @ values(mesh.points) == pytest.approx(values(cut.mesh.points), abs=1e-12)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("shape", "given", "radius"),
    [
        ("sphere", {"radius": 2.0, "divisions": 2}, lambda p: np.linalg.norm(p, axis=1)),
        (
            "tube", {"radius": 2.0, "length": 5.0, "around": 6, "along": 2, "cap_start": "none", "cap_end": "hemisphere"},
            lambda p: np.linalg.norm(p - np.column_stack([np.minimum(p[:, 0], 5.0), 0 * p[:, 0], 0 * p[:, 0]]), axis=1),
        ),
        (
            "arch", {"span": 10.0, "radius": 2.0, "around": 6, "along": 6, "angle": 180.0},
            lambda p: np.hypot(np.hypot(p[:, 0], p[:, 2]) - 5.0, p[:, 1]),
        ),
    ],
)  # fmt: skip
def test_new_nodes_lie_on_the_true_surface(shape: str, given: dict[str, Any], radius: Any, order: int) -> None:
    mesh = getattr(shapes, shape)(**given, order=order)
    found = quartered(mesh, shapes.place_of(shape, given)).mesh
    assert found.tri_count == 4 * mesh.tri_count
    assert radius(found.points) == pytest.approx(2.0, rel=1e-12)
    assert (radius(quartered(mesh, None).mesh.points) < 2.0 - 1e-4).any()


@pytest.mark.parametrize("order", [1, 2])
def test_edges_across_a_corner_are_no_part_of_a_rim(order: int) -> None:
    """A square cut along one diagonal: all its nodes are on the rim, and the middle of the diagonal is not."""
    square = shapes.panel(width=1.0, height=1.0, along_x=1, along_y=1, order=order)
    rim = square.node_groups["boundary"]
    named = replace(square, node_groups={**square.node_groups, "rim": rim})
    found = quartered(named, None).mesh
    assert np.array_equal(found.node_groups["rim"], found.node_groups["boundary"])
    assert len(found.node_groups["rim"]) == 8 * order


def test_lines_along_edges_are_cut_and_others_stay() -> None:
    mesh = Mesh.build(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], lines=[[0, 1], [1, 4], [3, 1]],
        line_groups={"sewn": [0], "free": [1, 2]}, loose_points=[[5, 0, 0]], loose_groups={"mast": [4]},
    )  # fmt: skip
    found = quartered(mesh, None).mesh
    places = np.concatenate([found.points, found.loose_points])
    sewn, free = (places[found.lines[found.line_groups[name]]] for name in ("sewn", "free"))
    assert np.linalg.norm(sewn[:, 1] - sewn[:, 0], axis=1) == pytest.approx([0.5, 0.5])
    assert sewn[0, 0].tolist() == [0, 0, 0]
    assert sewn[1, 1].tolist() == [1, 0, 0]
    assert free.tolist() == [
        [[1, 0, 0], [5, 0, 0]],
        [[0, 1, 0], [1, 0, 0]],
    ]  # the diagonal of the square is the other one
    assert places[found.loose_groups["mast"]].tolist() == [[5, 0, 0]]


def sheet(order: int, **changes: Any) -> Scene:
    """A sheet with a cable along one edge, a guy to an anchor, and every kind of dead load."""
    scene = {
        "name": "sheet",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "panel", **PANEL, "order": order},
        "groups": {"patch": {"where": "x < 2.1 and y < 1.1"}, "flap": {"where": "x < 1", "kind": "elements"}},
        "fabric": {"E": 100.0, "nu": 0.2, "thickness": 1.0, "density": 2.0},
        "supports": [{"group": "x_min", "hold": "xyz"}],
        "anchors": {"post": [5.0, 2.0, 1.0]},
        "cables": {
            "edge": {"along": "y_max", "EA": 10.0}, "guy": {"nodes": ["corner_11", "post"], "EA": 10.0, "parts": 3},
        },
        "loads": {
            "total": {"group": "patch", "direction": [0, 0, -1]},
            "evenly": {"group": "x_max", "direction": [0, 0, -1], "spread": "edges"},
            "line": {"kind": "line", "group": "y_min", "direction": [1, 0, 0]},
            "area": {"kind": "area", "group": "flap", "direction": [0, 1, 0]},
            "weight": {"kind": "weight", "g": 9.81},
        },
        "stages": [{"name": "load", "pressure": 1.0, "loads": {"total": 1.0}}],
    }  # fmt: skip
    return Scene.model_validate({**scene, **changes})


@pytest.mark.parametrize("order", [1, 2])
def test_loads_and_members_are_the_same_on_the_finer_mesh(order: int) -> None:
    scene = sheet(order)
    model = build_model(scene, build_mesh(scene))
    fine = refined(model)
    assert fine.model.unit_forces.keys() == model.unit_forces.keys()
    for name, force in model.unit_forces.items():
        assert fine.model.unit_forces[name].sum(axis=0) == pytest.approx(force.sum(axis=0), rel=1e-12), name
    cables, coarse = fine.model.structure.cables, model.structure.cables
    assert cables is not None
    assert coarse is not None
    assert cables.length.sum() == pytest.approx(coarse.length.sum(), rel=1e-12)
    assert len(cables.length) == 2 * (len(coarse.length) - 3) + 3  # the guy goes through the air
    mesh = fine.model.structure.mesh
    assert mesh.points[mesh.node_groups["post"]].tolist() == [[5.0, 2.0, 1.0]]
    held = fine.model.structure.node_held
    assert np.array_equal(np.flatnonzero(held[: mesh.cells.max() + 1].all(axis=1)), mesh.node_groups["x_min"])
    shape = fine.displacement(model.structure.mesh.points)
    assert shape == pytest.approx(mesh.points, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"springs": {"bed": {"group": "y_max", "stiffness": [0, 0, 1.0]}}}, r"springs.bed are at each of 4 nodes of 'y_max'"),
        (
            {"planes": {"floor": {"group": "all", "through": [0, 0, -1], "normal": [0, 0, 1], "friction": 0.3}}},
            r"with friction \(floor.friction\)",
        ),
        ({"contact": {}}, r"with walls that touch each other \(contact\)"),
    ],
)  # fmt: skip
def test_what_depends_on_more_than_the_load_state_is_refused(changes: dict[str, Any], told: str) -> None:
    scene = sheet(1, anchors={}, cables={}, supports=[{"group": "boundary", "hold": "xyz"}], **changes)
    with pytest.raises(InputError, match=f"estimate: .*{told}"):
        refined(build_model(scene, build_mesh(scene)))
