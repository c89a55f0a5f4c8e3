"""Cracks: what counts as one place is told by the numbers, and what a look at a mesh shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read_mesh
from taichi_membrane.mesh.crossing import crossings
from taichi_membrane.mesh.precision import resolution
from taichi_membrane.mesh.survey import lines_of, survey
from taichi_membrane.shapes import panel, sphere

BALL = sphere(radius=100.0, divisions=8)


def patches(change: float, *, single: bool = True) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The ball in two patches, as exported one by one; the seam's nodes of the upper one are moved out by a share."""
    upper = BALL.points[BALL.triangles].mean(axis=1)[:, 2] > 0.0
    points = BALL.points.astype(np.float32).astype(np.float64) if single else BALL.points
    other = points * (1.0 + change)
    other = other.astype(np.float32).astype(np.float64) if single else other
    triangles = np.where(upper[:, None], BALL.triangles + BALL.node_count, BALL.triangles)
    both = np.concatenate((points, other))
    used = np.unique(triangles)
    number = np.zeros(len(both), dtype=np.int32)
    number[used] = np.arange(len(used))
    return both[used], number[triangles]


def test_a_seam_that_differs_in_the_last_digit_is_refused_and_joined_by_repair(tmp_path: Path) -> None:
    points, triangles = patches(np.finfo(np.float32).eps)
    facets = np.zeros(len(triangles), dtype=[("n", "<f4", (3,)), ("c", "<f4", (3, 3)), ("a", "<u2")])
    facets["c"] = points[triangles]
    path = tmp_path / "ball.stl"
    path.write_bytes(b"x" * 80 + np.uint32(len(triangles)).tobytes() + facets.tobytes())
    with pytest.raises(
        InputError, match=r"32 pairs of free edges coincide or nearly do, .*largest gap [\d.e-]+, tolerance 4.77e-05"
    ):
        read_mesh(path)
    mesh = read_mesh(path, repair=True, scale=0.01)
    assert mesh.is_closed
    assert mesh.node_count == BALL.node_count
    assert mesh.tolerance == pytest.approx(4.77e-7, rel=1e-2)
    assert "32 pairs of free edges, largest gap" in mesh.mended[0]
    apart = read_mesh(path, open_seams=True)
    assert len(apart.boundary_edges()) == 64


def test_a_gap_beyond_the_digits_is_joined_only_when_its_size_is_given() -> None:
    points, triangles = patches(1e-5, single=False)
    shown = r"largest gap 0.001, .*join = 0.00101 in the scene's mesh"
    for repair in (False, True):
        with pytest.raises(InputError, match=shown):
            Mesh.build(points, triangles, repair=repair)
    assert Mesh.build(points, triangles, repair=True, join=0.00101).is_closed
    far, _ = patches(1e-2, single=False)
    assert not Mesh.build(far, triangles).is_closed, "a gap that is no crack: two bowls"


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (np.array([[0.0, 1.0, 2.0]]), 2.0 * 2.0**-23),  # whole numbers have no digits to lose
        (np.array([[1 / 3, 2 / 3, 0.1]]), 2 / 3 * 2.0**-52),
        (np.array([[1 / 3, 2 / 3, 0.1]]).astype(np.float32).astype(np.float64), 2 / 3 * 2.0**-23),
        (np.array([[0.333333, 12.666667, 0.1]]), 1e-6),
        (np.array([[333.333, 1266.67, 0.100001]]), 1e-2),  # six digits, as %g writes
        (np.array([[1234.5678, 0.0, 7.25]]), 1e-4),
        (np.zeros((1, 3)), 0.0),
        (np.array([[120.0, 7301.0, 13.0]]), 7301 * 2.0**-23),  # a drawing on whole millimetres is not rounded
    ],
)
def test_the_last_digit_is_told_from_the_numbers(points: NDArray[np.float64], expected: float) -> None:
    assert resolution(points) == pytest.approx(expected, rel=1e-6)


def test_the_tolerance_stays_below_a_share_of_the_shortest_edge() -> None:
    flat = panel(width=1.0, height=1.0, along_x=1, along_y=1)
    points = np.round(flat.points * 1e-2 + np.array([123.4567, 0.0, 0.0]), 4)  # digits of 1e-4, edges of 1e-2
    assert Mesh.build(points, flat.triangles).tolerance == pytest.approx(1e-5, rel=1e-6)


def test_a_survey_knows_bodies_loops_angles_and_crossings() -> None:
    flat = panel(width=3.0, height=4.0, along_x=3, along_y=4)
    in_hole = (np.abs(flat.points[flat.triangles].mean(axis=1)[:, :2] - 1.5) < 0.5).all(axis=1)
    hole = flat.triangles[~in_hole]
    points = np.concatenate((BALL.points, flat.points + np.array([500.0, 0.0, 0.0])))
    mesh = Mesh.build(points, np.concatenate((BALL.triangles, hole + BALL.node_count)))
    found = survey(mesh)
    assert [(body.tri_count, body.volume is None) for body in found.bodies] == [(512, False), (22, True)]
    assert found.bodies[0].volume == pytest.approx(BALL.enclosed_volume())
    assert [(loop.edge_count, loop.length, loop.closed) for loop in found.loops] == [(14, 14.0, True), (4, 4.0, True)]
    assert found.free_edge_count == 18
    assert found.smallest_angle[0] == pytest.approx(min(45.0, found.smallest_angle[0]))
    assert found.edge_lengths[0] == 1.0
    assert found.crossing == (0, None)
    text = dict(lines_of(found, "mm", "mm²", "mm³"))
    assert text["free edges"] == "18 in 2 loops: 14 mm (14 edges), 4 mm (4 edges)"
    assert text["crossings"] == "no elements pass through each other"


def test_triangles_that_pass_through_each_other_are_found_whatever_their_sizes() -> None:
    small = panel(width=1.0, height=1.0, along_x=20, along_y=20)
    big = np.array([[0.5, -90.0, -50.0], [0.5, 90.0, -50.0], [0.5, 0.0, 90.0]]) + np.array([0.012, 0, 0])
    points = np.concatenate((small.points, big))
    triangles = np.concatenate((small.triangles, [[small.node_count, small.node_count + 1, small.node_count + 2]]))
    pairs = crossings(points, triangles)
    x = small.points[small.triangles][:, :, 0]
    cut = np.flatnonzero((x.min(axis=1) < 0.512) & (x.max(axis=1) > 0.512))
    assert pairs.tolist() == [[int(t), small.tri_count] for t in cut]
    found = survey(Mesh.build(points, triangles))
    assert found.crossing == (len(cut), (int(cut[0]), small.tri_count))
    assert f"WARNING: {len(cut)} pairs" in dict(lines_of(found, "", "", ""))["crossings"]
    touching = big - np.array([0.512 + 1.0, 0, 0]) + np.array([1.0, 0, 0])  # stands on the panel's edge
    assert crossings(np.concatenate((small.points, touching)), triangles).tolist() == []


def test_check_prints_what_a_mistake_of_units_or_a_hole_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = Mesh.build(
        BALL.points,
        BALL.triangles[1:],
        {},
        {"most": range(300)},
        loose_points=[[9, 9, 9]],
        loose_groups={"RP": [BALL.node_count]},
    )
    mesh.save("ball.vtu")
    Path("ball.toml").write_text(
        'name = "ball"\nunits = { length = "mm", force = "N" }\nmesh = { path = "ball.vtu" }\n'
        'fabric = { E = 10.0, nu = 0.3, thickness = 1.0 }\nsupports = [{ group = "all", hold = "xyz" }]\n'
        'stages = [{ name = "inflate", pressure = 0.002 }]\n'.replace("{ path", '{ shape = "file", path')
    )
    done = CliRunner().invoke(app, ["check", "ball.toml"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    text = " ".join(done.stdout.split())
    for words in (
        "free edges 3 in 1 loop",
        "angles smallest",
        "edges shortest",
        "size 200 × 200 × 200 mm",
        "are one",
        "loose 1 points",
    ):
        assert words in text, text
    refused = CliRunner().invoke(app, ["check", "ball.toml", "--set", "supports=[{group='RP', hold='x'}]"])
    assert refused.exit_code == 2
    assert "node group 'RP' holds only points that no element uses" in refused.stderr


def test_free_edges_of_three_sheets_at_one_place_are_refused() -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0], [1, 0, 0], [0, -1, -1]]
    triangles = np.arange(9).reshape(3, 3)
    with pytest.raises(InputError, match=r"3 free edges lie on each other by more than two, .* keeps them apart"):
        Mesh.build(points, triangles)
    assert Mesh.build(points, triangles, open_seams=True).tri_count == 3


def test_a_flat_triangle_is_no_joint_with_itself() -> None:
    """Its apex lies nearer to its own base than the tolerance."""
    mesh = Mesh.build([[0, 0, 0], [1, 0, 0], [0.5, 2e-4, 0]], [[0, 1, 2]])
    assert mesh.tri_count == 1


def test_triangles_that_cross_at_their_tips_are_found() -> None:
    """Their middles are farther apart than either is large."""
    one = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0], [3.0, 0.0, 0.0]])
    other = np.array([[5.5, 0.01, -0.5], [5.5, 0.01, 0.5], [2.5, 0.01, -0.01]])
    pairs = crossings(np.concatenate((one, other)), np.arange(6).reshape(2, 3))
    assert pairs.tolist() == [[0, 1]]


def test_minus_zero_is_zero(tmp_path: Path) -> None:
    facets = ["0 0 0 1 0 0 0 1 0", "-0.0 -0.0 0 0 1 0 -1 0 0"]
    text = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {' '.join(facet.split()[3 * k : 3 * k + 3])}\n" for k in range(3))
        + "endloop\nendfacet\n"
        for facet in facets
    )
    (tmp_path / "z.stl").write_text(f"solid z\n{text}endsolid z\n")
    assert read_mesh(tmp_path / "z.stl").node_count == 4


def test_holes_that_touch_make_a_loop_that_meets_itself() -> None:
    flat = panel(width=4.0, height=4.0, along_x=4, along_y=4)
    middle = flat.points[flat.triangles].mean(axis=1)
    cut = ((middle[:, :2] > 1) & (middle[:, :2] < 2)).all(axis=1) | ((middle[:, :2] > 2) & (middle[:, :2] < 3)).all(
        axis=1
    )
    found = survey(Mesh.build(flat.points, flat.triangles[~cut]))
    assert [(loop.edge_count, loop.closed) for loop in found.loops] == [(16, True), (8, False)]
    assert "8 (8 edges, meets itself)" in " ".join(dict(lines_of(found, "", "", ""))["free edges"].split())


def test_triangles_whose_tips_pass_through_each_other_far_from_their_middles() -> None:
    tip = 3**0.5 / 2
    one = np.array([[0.1, 0.02, 0.0], [-1.4, 0.02 - tip, 0.0], [-1.4, 0.02 + tip, 0.0]])
    other = np.array([[-0.1, 0.0, 0.0], [1.4, 0.0, -tip], [1.4, 0.0, tip]])
    assert crossings(np.concatenate((one, other)), np.arange(6).reshape(2, 3)).tolist() == [[0, 1]]


def test_a_thin_triangle_is_no_crack_of_its_own() -> None:
    """Its third corner is nearer to its free edge than nodes of different elements may be."""
    points = np.array([[0.0, 0, 0], [2, 0, 0], [1, 5e-4, 0], [1, 1, 0]])
    assert Mesh.build(points, [[0, 1, 2], [0, 2, 3], [2, 1, 3]]).tri_count == 3
