"""Tents on arches and mattresses: closed chambers, areas and volumes against closed forms, groups, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from closed_bodies import area, assert_second_order, volume

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes import arch_tent, mattress
from taichi_membrane.shapes.patchwork import zip_rows

TENT: dict[str, Any] = {"span": 6, "radius": 0.3, "spacing": 4, "around": 8, "along": 16, "across": 4}
MATTRESS: dict[str, Any] = {
    "width": 0.8, "length": 2, "height": 0.1, "cells_x": 4, "along_x": 4, "along_y": 4, "up": 2
}  # fmt: skip


def tent(**changes: Any) -> Mesh:
    return arch_tent(**(TENT | changes))


def bed(**changes: Any) -> Mesh:
    return mattress(**(MATTRESS | changes))


@pytest.mark.parametrize("seam", [0.0, 90.0, 180.0])
@pytest.mark.parametrize("angle", [180.0, 120.0])
def test_arches_and_skin_converge_to_their_closed_forms(seam: float, angle: float) -> None:
    sizes = (1, 2, 4)
    meshes = [tent(seam=seam, angle=angle, around=8 * n, along=16 * n, across=2 * n, roof=60, guy=30) for n in sizes]
    arc = 6 / (2 * sin(radians(angle) / 2))
    reach = arc + 0.3 * cos(radians(seam))
    wide = 4 - 2 * 0.3 * sin(radians(seam))
    for number in (1, 2):
        volumes = [volume(mesh, (f"arch_{number}", 1)) for mesh in meshes]
        assert_second_order(volumes, pi * 0.3**2 * arc * radians(angle), 0.01)
    assert_second_order([area(mesh, "skin") for mesh in meshes], wide * reach * radians(angle), 0.001)
    assert_second_order([area(mesh, "plates") for mesh in meshes], 4 * pi * 0.3**2, 0.01)


def test_closed_ends_fill_the_plane_within_the_arch() -> None:
    meshes = [tent(along=along, ends="closed") for along in (16, 32, 64)]
    for mesh in meshes:
        for name, way in (("start", -1), ("end", 1)):
            assert np.allclose(mesh.tri_normals()[mesh.tri_groups[f"gable_{name}"]], [0, way, 0])
            assert (mesh.points[mesh.node_groups[f"sill_{name}"], 1] == 2 * way).all()
            assert np.abs(mesh.points[mesh.node_groups[f"sill_{name}"], 2]).max() < 1e-12
    assert_second_order([area(mesh, "gables") for mesh in meshes], pi * 2.7**2, 0.001)


def test_a_saddle_is_cut_as_a_parabola() -> None:
    mesh = tent(sag=0.5, arches=3)
    skin = np.unique(mesh.triangles[mesh.tri_groups["skin"]])
    x, y, z = mesh.points[skin].T
    share = np.mod(y, 4) / 4
    assert np.hypot(x, z) == pytest.approx(3.3 - 0.5 * 4 * share * (1 - share), rel=1e-13)


@pytest.mark.parametrize("seam", [0.0, 180.0])
def test_groups_of_a_tent_are_where_they_say(seam: float) -> None:
    mesh = tent(arches=3, seam=seam, guy=45, roof=90, along=16)
    p, nodes, elements = mesh.points, mesh.node_groups, mesh.tri_groups
    assert np.abs(p[nodes["crown_2"]] - [0, 0, 3.3]).max() < 1e-12
    for number, y in ((1, -4), (2, 0), (3, 4)):
        for side, way in (("windward", -1), ("leeward", 1)):
            place = [way * 3.3 * sin(pi / 4), y, 3.3 * cos(pi / 4)]
            assert np.abs(p[nodes[f"guy_{side}_{number}"]] - place).max() < 1e-12
        assert np.abs(p[nodes[f"feet_{number}"]][:, 2]).max() < 1e-12
        sewn = nodes[f"seam_{number}"]
        assert np.isin(sewn, mesh.triangles[elements["skin"]]).all()
        assert np.isin(sewn, mesh.triangles[elements[f"arch_{number}"]]).all()
    reach = 3.3 if seam == 0.0 else 2.7
    assert np.abs(p[nodes["skirt_windward"]][:, [0, 2]] - [-reach, 0]).max() < 1e-12
    turn = np.degrees(np.arctan2(*p[mesh.triangles].mean(axis=1)[:, [0, 2]].T))
    assert (turn[elements["windward"]] < -45).all()
    assert (np.abs(turn[elements["roof"]]) < 45).all()
    assert (turn[elements["leeward"]] > 45).all()
    zones = np.concatenate([elements[name] for name in ("windward", "roof", "leeward")])
    assert np.sort(zones).tolist() == elements["skin"].tolist()
    assert (
        np.einsum("ij,ij->i", mesh.tri_normals(), p[mesh.triangles].mean(axis=1) * [1, 0, 1])[elements["skin"]] > 0
    ).all()
    # Every seam edge has the two elements of the arch and one of each bay.
    counts = mesh.edge_table.tri_count
    on_seam = np.isin(mesh.edges(), np.concatenate([nodes["seam_1"], nodes["seam_3"]])).all(axis=1)
    assert set(counts[on_seam & (counts > 2)]) == {3}
    assert set(counts[np.isin(mesh.edges(), nodes["seam_2"]).all(axis=1)]) == {4}
    assert mesh.tri_warp is not None
    assert (np.abs(mesh.tri_warp[elements["skin"], 1]) < 0.2).all()


@pytest.mark.parametrize("bulge", [0.0, 100.0, 180.0])
def test_cells_close_and_fill_their_sections(bulge: float) -> None:
    def cells(mesh: Mesh) -> list[float]:
        return [
            volume(mesh, (f"cell_{k}", 1), *([(f"into_{k}", -1)] if f"into_{k}" in mesh.tri_groups else []))
            for k in range(1, 9)
        ]

    meshes = [bed(cells_y=2, along_x=n, bulge=bulge) for n in (4, 8, 16)]
    half = radians(bulge) / 2
    segments = 2 * (0.1 / sin(half)) ** 2 * (half - sin(half) * cos(half)) if bulge else 0.0
    exact = 1.0 * (0.2 * 0.1 + segments)
    for mesh in meshes:
        assert min(cells(mesh)) == pytest.approx(max(cells(mesh)), rel=1e-12)
        assert mesh.points[:, 2].min() == 0.0
    if bulge:
        assert_second_order([cells(mesh)[0] for mesh in meshes], exact, 0.02)
    else:
        assert cells(meshes[0])[3] == pytest.approx(exact, rel=1e-12)


def test_groups_of_a_mattress_are_where_they_say() -> None:
    mesh = bed(cells_x=3, cells_y=2)
    p, nodes, elements = mesh.points, mesh.node_groups, mesh.tri_groups
    normals, middles = mesh.tri_normals(), p[mesh.triangles].mean(axis=1)
    assert (normals[elements["top"]] == [0, 0, 1]).all()
    assert (normals[elements["bottom"]] == [0, 0, -1]).all()
    assert area(mesh, "walls") == pytest.approx(0.1 * (2 * 2 + 0.8), rel=1e-12)
    assert area(mesh, "edges") == pytest.approx(0.1 * 2 * (2 + 0.8), rel=1e-12)
    assert (np.einsum("ij,ij->i", normals, middles - [0, 0, 0.05])[elements["edges"]] > 0).all()
    assert "into_1" not in elements
    assert set(elements["into_5"]) <= set(elements["cell_4"]) | set(elements["cell_2"])
    assert p[nodes["top"], 2] == pytest.approx(0.1)
    assert sorted(map(tuple, p[nodes["corners"]].tolist())) == [(x, y, 0) for x in (-0.4, 0.4) for y in (-1, 1)]
    assert p[nodes["centre_top"]] == pytest.approx(np.array([[0, 0, 0.1]]), abs=1e-15)
    assert len(nodes["rim_top"]) == 2 * (12 + 8)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 4), (2, 6), (7, 3), (0, 4), (4, 0)])
def test_rows_are_zipped_once(n: int, m: int) -> None:
    low = np.column_stack((np.linspace(0, 1, n + 1) if n else [0.5], np.zeros(n + 1), np.zeros(n + 1)))
    high = np.column_stack((np.linspace(0, 1, m + 1) if m else [0.5], np.ones(m + 1), np.zeros(m + 1)))
    triangles = zip_rows(np.arange(n + 1), n + 1 + np.arange(m + 1))
    p = np.concatenate((low, high))[triangles]
    areas = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2] / 2
    assert len(triangles) == n + m
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx((min(n, 1) + min(m, 1)) / 2, rel=1e-13)


@pytest.mark.parametrize(
    ("make", "changes", "words"),
    [
        (tent, {"radius": 3}, "arch_tent: radius = 3 must be below the radius of the arc, 3 at this span and angle"),
        (tent, {"spacing": 0.5}, r"arch_tent: spacing = 0.5 must be above 2 radius = 0.6; the arches would overlap"),
        (tent, {"around": 7}, "arch_tent: around = 7 must be even"),
        (tent, {"along": 15}, "arch_tent: along = 15 must be even"),
        (tent, {"across": 0}, "arch_tent: across = 0 must be a whole number of at least 1"),
        (tent, {"arches": 1}, "arch_tent: arches = 1 must be a whole number of at least 2"),
        (tent, {"angle": 360}, "arch_tent: angle = 360 must be below 360 degrees"),
        (tent, {"roof": 180}, "arch_tent: roof = 180 must be below 180 degrees"),
        (tent, {"guy": 90}, "arch_tent: guy = 90 must be below 90 degrees, half of angle"),
        (tent, {"roof": 175}, "with along = 16 no element of the skin is windward; roof = 175 degrees"),
        (tent, {"sag": 2.7}, "arch_tent: sag = 2.7 must be below the radius of the arches' inner lines, 2.7"),
        (tent, {"sag": -1}, "arch_tent: sag = -1 must be a finite number above 0"),
        (tent, {"seam": 181}, "arch_tent: seam = 181 must be 0 to 180 degrees"),
        (tent, {"ends": "half"}, "arch_tent: ends = 'half' must be one of open, closed"),
        (tent, {"along": 100_000, "around": 1000}, "triangles, at most 50000000"),
        (bed, {"height": 0}, "mattress: height = 0 must be a finite number above 0"),
        (bed, {"cells_x": 0}, "mattress: cells_x = 0 must be a whole number of at least 1"),
        (bed, {"along_x": 1}, "mattress: along_x = 1 must be a whole number of at least 2"),
        (bed, {"bulge": 181}, "mattress: bulge = 181 must be 0 to 180 degrees"),
        (bed, {"bulge": float("nan")}, "mattress: bulge = nan must be a finite number"),
    ],
)
def test_arguments_out_of_range_are_named(make: Callable[..., Mesh], changes: dict[str, Any], words: str) -> None:
    make()
    with pytest.raises(InputError, match=words):
        make(**changes)
