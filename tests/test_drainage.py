"""Least slope and standing water of roofs, against planes, basins and brute force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import DrainageProbe, Scene
from taichi_membrane.simulation.drainage import check_rim, drainage, standing


def grid(count: int) -> tuple[Any, Any]:
    """Points (x, y) in the unit square and triangles between them."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, count))
    flat = np.column_stack([x.ravel(), y.ravel()])
    return flat, Delaunay(flat).simplices


def surface(height: Any, count: int = 9) -> Mesh:
    flat, triangles = grid(count)
    return Mesh.build(np.column_stack([flat, height(*flat.T)]), triangles)


def measured(of: str, mesh: Mesh, up: Any = (0.0, 0.0, 1.0), displacement: Any = 0.0) -> float:
    probe = DrainageProbe(kind="drainage", group="all", of=of, up=up)  # type: ignore[arg-type]
    return drainage(probe, mesh, np.arange(mesh.tri_count), displacement + np.zeros((mesh.node_count, 3)))


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_slope_of_planes(turned: float) -> None:
    """Whichever way the normals point."""
    mesh = surface(lambda x, y: np.maximum(0.5 * x, 0.2 + 0.1 * (x - 0.4)))
    assert measured("slope", mesh) == pytest.approx(np.degrees(np.arctan(0.1)), rel=1e-12)
    assert measured("slope", mesh, up=(0.0, 0.0, turned * 3.0)) == measured("slope", mesh)
    assert measured("slope", surface(lambda x, y: 0.0 * x)) == 0.0
    assert measured("slope", surface(lambda x, y: 0.3 * x), up=(1.0, 0.0, 0.0)) == pytest.approx(
        90.0 - np.degrees(np.arctan(0.3)), rel=1e-12
    )


def test_a_basin_holds_water_up_to_its_lowest_spill() -> None:
    """A pyramid of depth 0.5 upside down; where its rim sinks the way out leads over the node beside, at -1/8."""
    mesh = surface(lambda x, y: np.maximum(abs(x - 0.5), abs(y - 0.5)) - 0.5)
    assert measured("depth", mesh) == pytest.approx(0.5, abs=1e-15)
    lower = np.where((mesh.points == (0.0, 0.5, 0.0)).all(axis=1), -0.2, 0.0)[:, None] * (0.0, 0.0, 1.0)
    assert lower.any()
    assert measured("depth", mesh, displacement=lower) == pytest.approx(0.375, abs=1e-15)
    assert measured("depth", surface(lambda x, y: x + 0.1 * np.sin(9 * y))) == 0.0


def test_depth_is_that_of_the_best_way_out() -> None:
    """On random heights, against relaxing levels over all edges until none changes."""
    rng = np.random.default_rng(1)
    flat, triangles = grid(12)
    for _ in range(20):
        height = rng.normal(size=len(flat))
        edges = np.unique(
            np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1), axis=0
        )
        rim = (flat == 0.0).any(axis=1) | (flat == 1.0).any(axis=1)
        level = np.where(rim, height, np.inf)
        while True:
            before = level.copy()
            for a, b in (edges.T, edges.T[::-1]):
                np.minimum.at(level, a, np.maximum(before[b], height[a]))
            if np.array_equal(level, before):
                break
        assert np.array_equal(standing(height, triangles), level - height)
        assert standing(height, triangles).max() > 0.0


def test_a_closed_surface_is_refused() -> None:
    corners = np.vstack([np.zeros(3), np.eye(3)])
    closed = Mesh.build(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    with pytest.raises(InputError, match=r"probes.pond.group: the elements have no edge where they end"):
        check_rim(closed, np.arange(closed.tri_count), "probes.pond.group")


@pytest.mark.parametrize("order", [1, 2])
def test_a_sagging_sheet_is_told_by_a_probe(order: int) -> None:
    """A square sheet held all round, sagging under its load: the pond is as deep as its middle is low."""
    roof = {
        "name": "roof",
        "units": {"length": "m", "force": "kN"},
        "mesh": {"shape": "panel", "width": 2.0, "height": 2.0, "along_x": 6, "along_y": 6, "order": order},
        "fabric": {"E": 1000.0, "nu": 0.3, "thickness": 1.0, "prestress": [1.0, 1.0, 0.0], "warp": [1.0, 0.0, 0.0]},
        "supports": [{"group": "boundary", "hold": "xyz"}],
        "loads": {"snow": {"kind": "area", "group": "all", "direction": [0, 0, -1]}},
        "stages": [{"name": "snow", "loads": {"snow": 0.1}}],
        "probes": {
            "pond": {"kind": "drainage", "group": "all", "of": "depth"},
            "slope": {"kind": "drainage", "group": "all", "of": "slope"},
        },
        "checks": [{"probe": "pond", "stage": "snow", "at_most": 0.0, "source": "no ponding"}],
    }
    result = tm.run(Scene.model_validate(roof), render=False)
    step = result.steps[-1]
    assert step.probes["pond"] == pytest.approx(-step.displacement[:, 2].min(), rel=1e-12)
    assert step.probes["pond"] > 0.01
    assert 0.0 <= step.probes["slope"] < 5.0
    assert not result.checks[0].passed
