"""Sails, cones, panels with yarns, bags, pumpkins, hulls: chambers, areas and volumes against closed forms, groups, refusals."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from closed_bodies import area, assert_second_order, volume
from scipy.special import ellipe, ellipk

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes import airbag, cone, drop_stitch, hull, hypar, pumpkin, water_tube
from taichi_membrane.shapes.balloons import half_meridian, isotensoid

SAIL: dict[str, Any] = {"width": 8, "depth": 6, "rise": 3, "along": 8}
CONE: dict[str, Any] = {"radius": 5, "ring": 1, "height": 2, "around": 24, "up": 6}
PANEL: dict[str, Any] = {"width": 1, "length": 2, "height": 0.2, "along_x": 8, "along_y": 12, "up": 4}
BAG: dict[str, Any] = {"outline": "disc", "size": 0.6, "divisions": 6}
TUBE: dict[str, Any] = {"radius": 0.5, "length": 3, "around": 16, "along": 6}
PUMPKIN: dict[str, Any] = {"radius": 10, "gores": 12, "along": 16, "across": 4}
HULL: dict[str, Any] = {"length": 30, "radius": 5, "around": 24, "along": 30}


def sail(**changes: Any) -> Mesh:
    return hypar(**(SAIL | changes))


def tent(**changes: Any) -> Mesh:
    return cone(**(CONE | changes))


def board(**changes: Any) -> Mesh:
    return drop_stitch(**(PANEL | changes))


def bag(**changes: Any) -> Mesh:
    return airbag(**(BAG | changes))


def lying(**changes: Any) -> Mesh:
    return water_tube(**(TUBE | changes))


def lobes(**changes: Any) -> Mesh:
    return pumpkin(**(PUMPKIN | changes))


def ship(**changes: Any) -> Mesh:
    return hull(**(HULL | changes))


def places(mesh: Mesh, group: str) -> np.ndarray:
    return mesh.points[mesh.node_groups[group]]


def test_a_sail_is_a_hyperbolic_paraboloid_with_parabolic_edges() -> None:
    mesh = sail(sag=0.15)
    assert (mesh.tri_normals()[:, 2] > 0).all()
    assert places(mesh, "low_1").tolist() == [[-4, -3, 0]]
    assert places(mesh, "low_2").tolist() == [[4, 3, 0]]
    assert places(mesh, "high_1").tolist() == [[4, -3, 3]]
    assert places(mesh, "high_2").tolist() == [[-4, 3, 3]]
    assert places(mesh, "centre").tolist() == [[0, 0, 1.5]]
    x, y, _ = places(mesh, "edge_1").T
    assert y == pytest.approx(-3 + 0.15 * 8 * (1 - (x / 4) ** 2), rel=1e-13)
    x, y, _ = places(mesh, "edge_2").T
    assert x == pytest.approx(4 - 0.15 * 6 * (1 - (y / 3) ** 2), rel=1e-13)
    assert mesh.node_groups["edges"].tolist() == mesh.node_groups["boundary"].tolist()
    flat = sail(sag=0, rise=0)
    assert flat.tri_areas().sum() == pytest.approx(48, rel=1e-13)
    # Its area with straight edges: the integral of √(1 + (2 rise/(w d))² (x² + y²)) over the plan, by a fine sum.
    slope = 3 / (8 * 6) * 2
    u, v = (np.arange(400) + 0.5) / 400 * 8 - 4, (np.arange(400) + 0.5) / 400 * 6 - 3
    exact = np.sqrt(1 + slope**2 * (u[:, None] ** 2 + v**2)).mean() * 48
    assert_second_order([sail(sag=0, along=n).tri_areas().sum() for n in (4, 8, 16)], exact, 2e-4)


def test_a_cone_runs_from_its_rim_to_its_ring() -> None:
    for corners in (0, 6):
        mesh = tent(corners=corners)
        assert (mesh.tri_normals()[:, 2] > 0).all()
        ring = places(mesh, "ring")
        assert np.hypot(ring[:, 0], ring[:, 1]) == pytest.approx(1, rel=1e-13)
        assert (ring[:, 2] == 2).all()
        assert (places(mesh, "rim")[:, 2] == 0).all()
        assert mesh.tri_warp is not None
        middle = mesh.points[mesh.triangles].mean(axis=1)
        assert ((mesh.tri_warp * middle)[:, :2].sum(axis=1) < 0).all(), "from rim to ring"
    assert_second_order([tent(height=0, around=n).tri_areas().sum() for n in (24, 48, 96)], 24 * pi, 1e-3)
    corner = places(mesh, "corner_2")[0]
    assert corner == pytest.approx([5 * cos(pi / 3), 5 * sin(pi / 3), 0], rel=1e-13)
    edge = places(mesh, "edge_1")
    assert edge[[0, -1]] == pytest.approx(np.array([places(mesh, "corner_1")[0], corner]))
    middle_of_edge = edge[np.argmin(np.abs(np.arctan2(edge[:, 1], edge[:, 0]) - pi / 6))]
    assert hypot(*middle_of_edge) == pytest.approx(5 * cos(pi / 6) - 0.1 * 5, rel=1e-13)
    assert np.isin(mesh.node_groups["edge_6"], mesh.node_groups["rim"]).all()
    assert mesh.node_groups["corner_1"] in mesh.node_groups["edge_6"]


@pytest.mark.parametrize("yarns", ["cables", "webs"])
@pytest.mark.parametrize("bulge", [0.0, 120.0, 180.0])
def test_a_panel_is_one_chamber_with_its_wall_an_arc(yarns: str, bulge: float) -> None:
    half = radians(bulge) / 2
    arc = 0.2 / (2 * sin(half)) if half else 0.0
    # Of the wall's mitred corners each is half the section of a square prism: the segment's moment about its chord, twice.
    segment = arc**2 * (half - sin(half) * cos(half))
    chords = np.linspace(-half, half, 20001)
    rise = arc * (np.cos(chords) - cos(half)) if half else chords * 0.0
    corners = 4 * np.trapezoid(rise**2, arc * np.sin(chords)) if half else 0.0
    exact = 1 * 2 * 0.2 + 2 * (1 + 2) * segment + corners
    volumes = [volume(board(yarns=yarns, bulge=bulge, up=up), ("shell", 1)) for up in (4, 8, 16)]
    if bulge:
        assert_second_order(volumes, exact, 2e-3)
    else:
        assert volumes[0] == pytest.approx(exact, rel=1e-12)


def test_yarns_join_nodes_above_each_other_and_are_symmetric() -> None:
    mesh = board(every=2)
    ends = mesh.points[mesh.lines[mesh.line_groups["yarns"]]]
    assert len(ends) == 3 * 5
    assert np.abs(ends[:, 1] - ends[:, 0] - [0, 0, 0.2]).max() < 1e-15
    assert np.abs(ends.mean(axis=0)[:, :2]).max() < 1e-15
    webs = board(every=4, yarns="webs")
    strips = webs.points[webs.triangles[webs.tri_groups["webs"]]]
    assert np.abs(strips[..., 0]).max() < 1e-15
    assert np.abs(strips[..., 1]).max() == pytest.approx(1 - 2 / 12)
    assert area(webs, "webs") == pytest.approx(0.2 * (2 - 2 * 2 / 12))
    assert area(webs, "top") == pytest.approx(2)
    assert places(mesh, "centre_top").tolist() == [[0, 0, 0.2]]
    assert np.abs(places(mesh, "middle")[:, 1]).max() < 1e-15
    assert (places(mesh, "x_max")[:, 0] == 0.5).all()


@pytest.mark.parametrize("outline", ["square", "disc"])
def test_a_bag_is_two_sheets_and_its_quarter_one_of_theirs(outline: str) -> None:
    whole, quarter = bag(outline=outline), bag(outline=outline, part="quarter")
    assert whole.is_closed
    assert whole.enclosed_volume() == 0.0
    assert (whole.tri_normals()[whole.tri_groups["top"], 2] > 0).all()
    assert (whole.tri_normals()[whole.tri_groups["bottom"], 2] < 0).all()
    assert (quarter.tri_normals()[:, 2] > 0).all()
    exact = 0.36 if outline == "square" else pi * 0.09
    for part, share in (("whole", 2), ("quarter", 0.25)):
        areas = [bag(outline=outline, part=part, divisions=n).tri_areas().sum() for n in (4, 8, 16)]
        if outline == "disc":
            assert_second_order(areas, share * exact, 5e-3)
        else:
            assert areas[0] == pytest.approx(share * exact, rel=1e-13)
    assert (places(quarter, "mirror_x")[:, 0] == 0).all()
    assert (places(quarter, "mirror_y")[:, 1] == 0).all()
    assert places(quarter, "end_x") == pytest.approx(np.array([[0.3, 0, 0]]), abs=1e-15)
    assert places(quarter, "end_y") == pytest.approx(np.array([[0, 0.3, 0]]), abs=1e-15)
    # No element lies on the seam with all its corners: it could not leave the plane.
    assert np.isin(whole.triangles, whole.node_groups["seam"]).sum(axis=1).max() == 2
    for name in ("centre_top", "centre_bottom"):
        assert places(whole, name) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(("ends", "exact"), [("flat", 0.75 * pi), ("hemisphere", 0.75 * pi + pi / 6)])
def test_a_tube_lies_on_the_plane(ends: str, exact: float) -> None:
    meshes = [lying(ends=ends, around=n, along=n // 2) for n in (16, 32, 64)]
    assert_second_order([mesh.enclosed_volume() for mesh in meshes], exact, 5e-3)
    for mesh in (lying(), meshes[0]):
        assert (places(mesh, "base")[:, 2] == 0).all()
        assert (places(mesh, "crown")[:, 2] == 1).all()
        assert mesh.points[:, 2].min() == 0.0
        assert places(mesh, "middle_left").tolist() == [[0, 0.5, 0.5]]
        assert places(mesh, "middle_right").tolist() == [[0, -0.5, 0.5]]
        assert (places(mesh, "middle")[:, 0] == 0).all()
        assert (places(mesh, "start")[:, 0] == -1.5).all()
    assert np.sort(np.concatenate([meshes[0].tri_groups[k] for k in ("tube", "caps")])).tolist() == list(
        range(len(meshes[0].triangles))
    )


def test_the_meridian_of_a_pumpkin_needs_no_hoop_tension() -> None:
    """sin φ = (x/R)² all along; length 1.3110287771 R to the pole and height 0.5990701173 R: those of the Mylar balloon."""
    assert half_meridian(2.0) == pytest.approx(2.0 * 1.3110287771, rel=1e-10)
    arc = np.linspace(-half_meridian(2.0), half_meridian(2.0), 2001)
    x, z = isotensoid(2.0, arc)
    assert z[-1] == pytest.approx(2.0 * (2.0 * ellipe(0.5) - ellipk(0.5)) / 2**0.5, rel=1e-12)
    assert z[-1] / 2.0 == pytest.approx(0.5990701173, rel=1e-9)
    assert np.abs(x[[0, -1]]).max() < 1e-12
    step = arc[1] - arc[0]
    middle = (0.5 * (x[1:] + x[:-1]) / 2.0) ** 2
    assert np.abs(np.diff(z) / step - middle).max() < 2e-6
    assert np.abs(np.hypot(np.diff(x), np.diff(z)) / step - 1.0).max() < 1e-6


def test_a_pumpkin_has_its_tendons_on_that_meridian_and_arcs_between_them() -> None:
    mesh = lobes(bulge=80)
    assert mesh.is_closed
    for number in (1, 5):
        x, y, z = places(mesh, f"tendon_{number}")[np.argsort(places(mesh, f"tendon_{number}")[:, 2])].T
        assert np.cos(np.arctan2(y, x) - 2 * pi * (number - 1) / 12) == pytest.approx(1, abs=1e-12)
        assert np.hypot(x, y)[[0, -1]] == pytest.approx(1.0, rel=1e-12)
        # The arc at an even share of the meridian between the fittings.
        slope = np.diff(z) / np.hypot(np.diff(np.hypot(x, y)), np.diff(z))
        rough = (0.5 * (np.hypot(x, y)[1:] + np.hypot(x, y)[:-1]) / 10) ** 2
        assert np.abs(slope - rough).max() < 0.02
    assert np.hypot(*places(mesh, "equator")[:, :2].T) == pytest.approx(10, rel=1e-13)
    half_chord = 10 * sin(pi / 12)
    crest = 10 * cos(pi / 12) + half_chord / sin(radians(40)) * (1 - cos(radians(40)))
    assert np.hypot(*places(mesh, "crests")[:, :2].T) == pytest.approx(crest, rel=1e-13)
    assert len(mesh.lines) == 12 * 16
    assert np.isin(np.sort(mesh.lines, axis=1) @ [10**6, 1], mesh.edges() @ [10**6, 1]).all(), "along edges of the mesh"
    counted = [mesh.tri_groups[f"gore_{k}"] for k in range(1, 13)]
    assert np.sort(np.concatenate(counted)).tolist() == mesh.tri_groups["gores"].tolist()
    assert places(mesh, "pole_top")[0, :2] == pytest.approx(0, abs=1e-12)


def test_a_round_pumpkin_has_the_volume_of_the_mylar_balloon() -> None:
    """2.7458 R³ at many gores; what is cut off at the fittings, a thousandth of the radius, is 1e-8 of it."""
    meshes = [lobes(gores=n, bulge=360 / n, across=1, along=n, fitting=0.01) for n in (16, 32, 64)]
    exact = 2 * pi / 3 * 1.3110287771 * 1000
    assert_second_order([mesh.enclosed_volume() for mesh in meshes], exact, 3e-3)


def test_a_hull_has_the_volume_of_its_ellipsoids() -> None:
    for nose in (0.3, 0.5):
        meshes = [ship(around=n, along=n, nose=nose) for n in (16, 32, 64)]
        assert_second_order([mesh.enclosed_volume() for mesh in meshes], 2 / 3 * pi * 25 * 30, 5e-3)
        x = meshes[0].points[:, 0]
        assert [x.min(), x.max()] == pytest.approx([-30 * nose, 30 * (1 - nose)])
    assert np.hypot(*places(ship(), "equator")[:, 1:].T) == pytest.approx(5, rel=1e-13)


@pytest.mark.parametrize("fins", [2, 3, 4])
def test_fins_are_chambers_with_the_hull_as_their_root(fins: int) -> None:
    mesh = ship(fins=fins, fin_reach=6, fin_sweep=2, ribs=2)
    assert volume(mesh, ("hull", 1)) == pytest.approx(ship().enclosed_volume(), rel=1e-12)
    volumes = [volume(mesh, (f"fin_{k}", 1), (f"into_fin_{k}", -1)) for k in range(1, fins + 1)]
    assert volumes == pytest.approx([volumes[0]] * fins, rel=1e-12)
    assert volumes[0] > 5.0
    for k in range(fins):
        tip = places(mesh, f"tip_{k + 1}")
        turn = 2 * pi * k / fins
        assert tip[:, 1] == pytest.approx(-6 * sin(turn), abs=1e-12)
        assert tip[:, 2] == pytest.approx(6 * cos(turn), abs=1e-12)
    assert len(mesh.tri_groups["ribs"]) == 2 * fins * 2 * 4
    assert area(mesh, "roots") > 0


def test_bridles_are_below_and_symmetric() -> None:
    mesh = ship(bridle_angle=45)
    one, two, three, four = (places(mesh, f"bridle_{k}")[0] for k in (1, 2, 3, 4))
    assert one[1] > 0
    assert two == pytest.approx(one * [1, -1, 1])
    assert four == pytest.approx(three * [1, -1, 1])
    assert one[1] == pytest.approx(-one[2])
    assert one[0] < 0 < three[0]


@pytest.mark.parametrize(
    ("make", "changes", "words"),
    [
        (sail, {"width": 0}, "hypar: width = 0 must be a finite number above 0"),
        (sail, {"rise": -1}, "hypar: rise = -1 must be from 0 to inf"),
        (sail, {"rise": float("nan")}, "hypar: rise = nan must be from 0 to inf"),
        (sail, {"sag": 0.5}, "hypar: sag = 0.5 must be from 0 to 0.4"),
        (sail, {"sag": 0.4}, r"hypar: sag = 0.4 must be below 0.375; opposite edges would meet"),
        (sail, {"along": 1}, "hypar: along = 1 must be a whole number of at least 2"),
        (tent, {"ring": 5}, "cone: ring = 5 must be below 5, where the rim comes nearest to the axis"),
        (tent, {"corners": 3, "sag": 0.2}, r"cone: ring = 1 must be below 0.767949, where the rim comes nearest"),
        (tent, {"corners": 5}, "cone: around = 24 must be a multiple of 5, so that each corner has a node"),
        (tent, {"corners": 2}, "cone: corners = 2 must be a whole number of at least 3"),
        (tent, {"corners": 6, "sag": 0.5}, "cone: sag = 0.5 must be from 0 to 0.4"),
        (tent, {"up": 0}, "cone: up = 0 must be a whole number of at least 1"),
        (board, {"height": -1}, "drop_stitch: height = -1 must be a finite number above 0"),
        (board, {"bulge": 181}, "drop_stitch: bulge = 181 must be from 0 to 180 degrees"),
        (board, {"bulge": 90, "up": 1}, "drop_stitch: bulge = 90 needs up = 2 at least"),
        (board, {"every": 0}, "drop_stitch: every = 0 must be a whole number of at least 1"),
        (board, {"yarns": "rope"}, "drop_stitch: yarns = 'rope' must be one of cables, webs"),
        (bag, {"outline": "oval"}, "airbag: outline = 'oval' must be one of square, disc"),
        (bag, {"part": "half"}, "airbag: part = 'half' must be one of whole, quarter"),
        (bag, {"divisions": 1}, "airbag: divisions = 1 must be a whole number of at least 2"),
        (bag, {"divisions": 10_000}, "airbag: the divisions give 1600000000 triangles, at most 50000000"),
        (lying, {"around": 18}, "water_tube: around = 18 must be a multiple of 4, so that there are lowest"),
        (lying, {"ends": "none"}, "water_tube: ends = 'none' must be one of open, flat, hemisphere"),
        (lying, {"radius": True}, "water_tube: radius = True must be a finite number above 0"),
        (lobes, {"gores": 2}, "pumpkin: gores = 2 must be a whole number of at least 3"),
        (lobes, {"bulge": 20}, "pumpkin: bulge = 20 must be from 30 to 180 degrees; 360/gores = 30 is a round body"),
        (lobes, {"fitting": 1}, "pumpkin: fitting = 1 must be from 0.01 to 0.9"),
        (lobes, {"along": 1}, "pumpkin: along = 1 must be a whole number of at least 2"),
        (ship, {"around": 20}, "hull: around = 20 must be a multiple of 8, so that rings near the ends"),
        (ship, {"fins": 5}, "hull: around = 24 must be a multiple of 5, so that all fins are alike"),
        (ship, {"around": 16, "fins": 8}, "hull: around = 16 must be at least 4 fins = 32"),
        (ship, {"nose": 0}, "hull: nose = 0 must be from 0.1 to 0.9"),
        (
            ship,
            {"fins": 4, "fin_from": 0.8, "fin_to": 0.8},
            "fin_from = 0.8 and fin_to = 0.8 must be two rings of elements apart",
        ),
        (ship, {"fins": 4, "fin_reach": 3}, r"hull: fin_reach = 3 must be above 4\.\d+, 1.05 times the hull's radius"),
        (ship, {"fins": 4, "fin_sweep": 20}, r"hull: fin_sweep = 20 must be from 0 to \d\.\d+"),
        (
            ship,
            {"fins": 4, "fin_to": 0.95, "radius": 1},
            r"a fin's root ends at 0.\d+ of the length, where a ring has \d+ nodes",
        ),
        (ship, {"bridle_angle": 181}, "hull: bridle_angle = 181 must be from 0 to 180 degrees"),
    ],
)
def test_arguments_out_of_range_are_named(make: Callable[..., Mesh], changes: dict[str, Any], words: str) -> None:
    make()
    with pytest.raises(InputError, match=words):
        make(**changes)
