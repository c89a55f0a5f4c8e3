"""Repair: good meshes are damaged at random and come back; what cannot be mended safely is refused as before."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pytest
from bad_input import PROFILE
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read_mesh
from taichi_membrane.shapes import cushion, panel, sphere, tube


def two_balls() -> Mesh:
    """A ball, and another one beside it."""
    one, other = sphere(radius=1.0, divisions=2), sphere(radius=2.0, divisions=1)
    points = np.concatenate((one.points, other.points + np.array([5.0, 0.0, 0.0])))
    return Mesh.build(points, np.concatenate((one.triangles, other.triangles + one.node_count)))


GOOD = [
    sphere(radius=1.0, divisions=2),
    panel(width=3.0, height=2.0, along_x=4, along_y=3),
    cushion(width=1.0, height=1.0, along_x=4, along_y=4),
    tube(radius=1.0, length=3.0, around=5, along=3, cap_end="none"),
    two_balls(),
]


@dataclass
class Damaged:
    """Arrays of a mesh with faults, and how many of each there are."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    groups: dict[str, NDArray[np.int32]]
    turned: int = 0
    doubled: int = 0
    unused: int = 0


@st.composite
def damage(draw: st.DrawFn) -> tuple[Mesh, Damaged]:
    """A good mesh, and the same with triangles turned over, corners on nodes of their own, and nodes that nothing uses."""
    good = draw(st.sampled_from(GOOD))
    bad = Damaged(good.points.copy(), good.triangles.copy(), {"some": np.arange(0, good.node_count, 2, dtype=np.int32)})
    # On an open surface nothing but the majority tells which side is meant.
    most = good.tri_count if good.is_closed else (good.tri_count - 1) // 2
    rows = draw(st.lists(st.integers(0, good.tri_count - 1), max_size=most, unique=True))
    bad.triangles[rows] = bad.triangles[rows][:, ::-1]
    bad.turned = len(rows)
    for row in draw(st.lists(st.integers(0, good.tri_count - 1), max_size=2, unique=True)):
        corner = draw(st.integers(0, 2))
        node = int(bad.triangles[row, corner])
        if _crack_is_open(good, row, node):
            bad.triangles[row, corner] = len(bad.points)
            bad.points = np.vstack((bad.points, bad.points[node]))
            bad.doubled += 1
    bad.unused = draw(st.integers(0, 2))
    bad.points = np.vstack((bad.points, np.full((bad.unused, 3), 0.123)))
    shift = draw(st.integers(0, 2))  # unused nodes in front, so that every number changes
    bad.points = np.vstack((np.full((shift, 3), 9.0), bad.points))
    bad.triangles, bad.unused = bad.triangles + shift, bad.unused + shift
    bad.groups = {name: members + shift for name, members in bad.groups.items()}
    return good, bad


def _crack_is_open(mesh: Mesh, row: int, node: int) -> bool:
    """Whether a triangle's corner on a node of its own leaves two edges free that were not: what is joined again."""
    boundary = {tuple(sorted(edge)) for edge in mesh.boundary_edges().tolist()}
    edges = [tuple(sorted((node, int(n)))) for n in mesh.triangles[row] if n != node]
    return not any(edge in boundary for edge in edges)


def same_surface(a: Mesh, b: Mesh) -> bool:
    """The same triangles in the same order, whatever the numbers of the nodes and the corner they begin with."""

    def corners(mesh: Mesh) -> NDArray[np.float64]:
        at = mesh.points[mesh.triangles]
        first = np.array([min(range(3), key=lambda k: tuple(t[k])) for t in at.tolist()])
        return np.stack([np.roll(t, -k, axis=0) for t, k in zip(at, first, strict=True)])

    return a.tri_count == b.tri_count and bool((corners(a) == corners(b)).all())


@settings(PROFILE, max_examples=400)
@given(case=damage())
def test_a_damaged_mesh_comes_back(case: tuple[Mesh, Damaged]) -> None:
    good, bad = case
    members = np.arange(0, good.tri_count, 3)
    mesh = Mesh.build(bad.points, bad.triangles, bad.groups, {"third": members}, repair=True)
    if good.components().max() == 0:  # the sides of two bodies are weighed one by one
        assert same_surface(mesh, good)
    assert mesh.node_count == good.node_count
    assert mesh.is_closed == good.is_closed
    assert mesh.tri_groups["third"].tolist() == members.tolist()
    there = {tuple(point) for point in mesh.points[mesh.node_groups["some"]].tolist()}
    assert there >= {tuple(point) for point in good.points[::2].tolist()}
    told = " ".join(mesh.mended)
    assert (f"joined {bad.doubled} nodes" in told) == (bad.doubled > 0)
    assert (f"left out {bad.unused} nodes" in told) == (bad.unused > 0)
    assert len(mesh.mended) <= 3
    if bad.turned + bad.doubled + bad.unused == 0:
        assert mesh.mended == ()


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("points", "triangles", "fault", "told"),
    [
        (SQUARE, [[0, 1, 2], [0, 3, 2], [2, 3, 0]][:2], "along their common edge", "turned over 1 of 2 elements, the first"),
        ([*SQUARE, [5.0, 5, 5]], [[0, 1, 2], [0, 2, 3]], "1 of 5 nodes belong to no", "left out 1 nodes that no element uses,"),
        (GOOD[0].points, GOOD[0].triangles[:, ::-1], "is inside out", "turned over 32 of 32 elements, the first is element 0; 1 "),
    ],
)  # fmt: skip
def test_a_refusal_names_the_repair_and_the_repair_says_what_it_did(
    points: NDArray[np.float64], triangles: list, fault: str, told: str
) -> None:
    with pytest.raises(InputError, match=fault) as caught:
        Mesh.build(points, triangles)
    assert str(caught.value).endswith("; --repair (in Python repair=True) does that")
    assert Mesh.build(points, triangles, repair=True).mended[0].startswith(told)


STRIP = np.array([[np.cos(a), np.sin(a), z] for a in np.arange(5) * 2 * np.pi / 5 for z in (0.0, 0.5)])
MOEBIUS = [[2 * k, 2 * k + 1, 2 * k + 2] for k in range(4)] + [[2 * k + 2, 2 * k + 1, 2 * k + 3] for k in range(4)]
MOEBIUS += [[8, 9, 1], [1, 9, 0]]


@pytest.mark.parametrize(
    ("points", "triangles", "fault"),
    [
        (STRIP, MOEBIUS, "run along their common edge"),
        (SQUARE, [[0, 1, 2], [0, 2, 3], [2, 0, 1]], "have the same three nodes"),
        (SQUARE, [[0, 1, 2], [3, 2, 3]], "repeats a node"),
    ],
)
def test_what_has_no_safe_mending_is_refused_and_no_repair_is_promised(
    points: NDArray[np.float64], triangles: list, fault: str
) -> None:
    with pytest.raises(InputError, match=fault) as caught:
        Mesh.build(points, triangles, repair=True)
    assert "--repair" not in str(caught.value)


def test_sheets_that_lie_on_each_other_stay_apart() -> None:
    flat = GOOD[2]
    assert Mesh.build(flat.points, flat.triangles, repair=True).node_count == flat.node_count
    # Cut both sheets along the same edges: four free edges at one place, and nothing tells which belong together.
    points, triangles = flat.points.copy(), flat.triangles.copy()
    centre = [int(flat.node_groups[name][0]) for name in ("centre_top", "centre_bottom")]
    for node in centre:
        row = int(np.flatnonzero((triangles == node).any(axis=1))[0])
        triangles[row][triangles[row] == node] = len(points)
        points = np.vstack((points, points[node]))
    mesh = Mesh.build(points, triangles, repair=True)
    assert mesh.node_count == len(points)
    assert mesh.mended[0].startswith("left 8 free edges alone: more than two lie at one place")


def test_the_command_mends_a_file_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ball = GOOD[0]
    triangles = ball.triangles.copy()
    triangles[[3, 7]] = triangles[[3, 7]][:, ::-1]
    meshio.Mesh(2.0 * ball.points, [("triangle", triangles)]).write("ball.vtu")
    Path("ball.toml").write_text(
        'name = "ball"\nunits = { length = "mm", force = "N" }\nmesh = { path = "ball.vtu", shape = "file", scale = 0.5 }\n'
        'fabric = { E = 10.0, nu = 0.3, thickness = 1.0 }\nsupports = [{ group = "all", hold = "xyz" }]\n'
        'stages = [{ name = "inflate", pressure = 0.002 }]\n'
    )
    refused = CliRunner().invoke(app, ["check", "ball.toml"], catch_exceptions=False)
    assert refused.exit_code == 2
    assert "--repair" in refused.stderr
    done = CliRunner().invoke(app, ["check", "ball.toml", "--repair"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    assert "mended turned over 2 of 32 elements, the first is element 3" in " ".join(done.stdout.split())
    assert same_surface(read_mesh("ball.vtu", repair=True, scale=0.5), ball)


def test_a_run_tells_and_keeps_what_was_noted_and_mended_in_the_file(tmp_path: Path) -> None:
    """A ball of quads, one of them turned over, with element data that are not used: on the terminal and in the summary."""
    mesh = meshio.Mesh(
        [[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)],
        [("quad", [[0, 2, 3, 1], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [5, 7, 3, 1]])],
        cell_data={"t": [np.linspace(0.1, 0.2, 6)]},
    )
    mesh.write(tmp_path / "box.vtu")
    (tmp_path / "box.toml").write_text(
        'name = "box"\nunits = { length = "mm", force = "N" }\nmesh = { path = "box.vtu", shape = "file" }\n'
        'fabric = { E = 10.0, nu = 0.3, thickness = 1.0 }\nsupports = [{ group = "all", hold = "xyz" }]\n'
        'stages = [{ name = "inflate", pressure = 0.002 }]\n'
    )
    done = CliRunner().invoke(
        app,
        ["run", str(tmp_path / "box.toml"), "--repair", "--no-render", "--out", str(tmp_path / "out")],
        catch_exceptions=False,
    )
    told = " ".join(done.stdout.split())
    assert done.exit_code == 0, told + done.stderr
    assert "mended turned over 2 of 12 elements" in told
    assert "noted split 6 quadrilaterals in two triangles each" in told
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert summary["mesh"]["mended"][0].startswith("turned over 2 of 12 elements")
    assert summary["mesh"]["notes"][-1] == "element data not used by the scene: t"
