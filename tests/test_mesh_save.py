"""Meshes that go out and come back: every format that is written, objects of other libraries, and the mesh of a run."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from run_files import MESH, SCENE

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read_mesh
from taichi_membrane.output.vtu import write_vtu
from taichi_membrane.shapes import panel, sphere, tube


def tent(*, warp: bool) -> Mesh:
    """A panel with groups of all kinds: overlapping ones, a guy to a loose point, a name of two kinds, a lone point."""
    flat = panel(width=3.0, height=2.0, along_x=4, along_y=3)
    count = flat.node_count
    return Mesh.build(
        flat.points + 0.1,
        flat.triangles,
        {"peg": [0, 3], "rim": [1, 2]},
        {"low": [0, 1, 2], "mid dle": [2, 3, 4], "rim": [7]},
        flat.tri_warp if warp else None,
        lines=[[0, count], [3, count], [4, 5]],
        line_groups={"guy": [0, 1], "batten": [2], "both": [1, 2]},
        loose_points=[[1 / 3, -2.0, 0.0], [9.0, 9.0, 9.0]],
        loose_groups={"anchor": [count], "eye": [count + 1], "peg": [count + 1]},
    )


def assert_same(found: Mesh, mesh: Mesh) -> None:
    assert np.array_equal(found.points, mesh.points)
    assert np.array_equal(found.triangles, mesh.triangles)
    assert np.array_equal(found.loose_points, mesh.loose_points)
    assert np.array_equal(found.lines, mesh.lines)
    for kind in ("tri_groups", "line_groups", "node_groups", "loose_groups"):
        there, wanted = getattr(found, kind), getattr(mesh, kind)
        for name, members in wanted.items():
            assert there[name].tolist() == members.tolist(), (kind, name)
        if kind in ("tri_groups", "line_groups"):
            assert set(there) == set(wanted), kind


@pytest.mark.parametrize("suffix", ["vtu", "inp", "msh"])
def test_a_mesh_with_groups_comes_back_to_the_last_bit(tmp_path: Path, suffix: str) -> None:
    mesh = tent(warp=suffix == "vtu")
    path = tmp_path / f"tent.{suffix}"
    mesh.save(path)
    found = tm.read_mesh(path)
    assert_same(found, mesh)
    if suffix == "vtu":
        assert found.tri_warp is not None
        assert found.tri_warp == pytest.approx(mesh.tri_warp, abs=1e-15)
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_stl_holds_bare_surfaces_in_single_precision(tmp_path: Path) -> None:
    bare = Mesh.build(sphere(radius=3.0, divisions=3).points, sphere(radius=3.0, divisions=3).triangles)
    bare.save(tmp_path / "ball.stl")
    found = read_mesh(tmp_path / "ball.stl")
    assert found.is_closed
    corners = found.points[found.triangles] - bare.points[bare.triangles]
    assert np.abs(corners).max() <= 3.0 * np.finfo(np.float32).eps


@pytest.mark.parametrize(
    ("name", "warp", "words"),
    [
        ("a.stl", False, "cannot say groups and lines"),
        ("a.inp", True, "cannot say the warp directions"),
        ("a.msh", True, "cannot say the warp directions"),
        ("a.xyz", False, "the file extension '.xyz' is not one that is written; allowed: .vtu, .inp, .msh, .stl"),
        ("missing/a.vtu", False, "the mesh cannot be written: No such file"),
    ],
)
def test_what_a_format_cannot_say_is_refused(tmp_path: Path, name: str, warp: bool, words: str) -> None:
    with pytest.raises(InputError, match=words):
        tent(warp=warp).save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("suffix", "group"), [("inp", 'a"b'), ("msh", 'a"b'), ("inp", " a"), ("inp", "A")])
def test_names_that_a_format_cannot_hold_are_refused(tmp_path: Path, suffix: str, group: str) -> None:
    flat = panel(width=1.0, height=1.0, along_x=1, along_y=1)
    mesh = Mesh.build(flat.points, flat.triangles, None, {group: [0], "a": [1]})
    with pytest.raises(InputError, match=r"cannot say; \.vtu can"):
        mesh.save(tmp_path / f"m.{suffix}")
    mesh.save(tmp_path / "m.vtu")
    assert read_mesh(tmp_path / "m.vtu").tri_groups[group].tolist() == [0]


def test_the_mesh_of_a_run_gives_back_its_groups_and_directions(tmp_path: Path) -> None:
    from taichi_membrane.output.writer import _group_marks

    marks = _group_marks(MESH.tri_groups, MESH.tri_count)
    cells = {"fabric": np.zeros(MESH.tri_count, dtype=np.int32)} | marks
    if MESH.tri_warp is not None:
        cells["warp"] = MESH.tri_warp
    write_vtu(tmp_path / "mesh.vtu", MESH, MESH.lines[:0], _group_marks(MESH.node_groups, MESH.node_count), cells, {})
    found = read_mesh(tmp_path / "mesh.vtu")
    for name, members in MESH.tri_groups.items():
        assert found.tri_groups[name].tolist() == members.tolist()
    for name, members in MESH.node_groups.items():
        assert found.node_groups[name].tolist() == members.tolist()
    assert (found.tri_warp is None) == (MESH.tri_warp is None)


def test_meshio_objects_convert_in_one_call() -> None:
    ball = sphere(radius=2.0, divisions=2)
    thing = meshio.Mesh(
        ball.points,
        [("triangle", ball.triangles), ("line", [[0, 1]])],
        cell_data={"part": [np.arange(ball.tri_count) % 2, np.array([5])]},
        point_sets={"pole": [0]},
        cell_sets={"some": [np.array([0, 3]), np.array([], dtype=int)]},
    )
    mesh = Mesh.from_object(thing, scale=2.0)
    assert np.array_equal(mesh.points, 2.0 * ball.points)
    assert len(mesh.tri_groups["part_0"]) == len(mesh.tri_groups["part_1"]) == ball.tri_count / 2
    assert mesh.tri_groups["some"].tolist() == [0, 3]
    assert mesh.line_groups["part_5"].tolist() == [0]
    assert mesh.node_groups["pole"].tolist() == [0]


class _Trimesh:
    """What a trimesh object has."""

    def __init__(self, mesh: Mesh) -> None:
        self.vertices, self.faces = mesh.points, mesh.triangles
        self.face_attributes = {"part": np.arange(mesh.tri_count) % 2, "heat": np.zeros(mesh.tri_count)}


class _Pyvista:
    """What a pyvista grid has."""

    def __init__(self, mesh: Mesh) -> None:
        self.points = mesh.points
        self.cells = np.column_stack((np.full(mesh.tri_count, 3), mesh.triangles)).ravel()
        self.celltypes = np.full(mesh.tri_count, 5)
        self.offset = np.arange(mesh.tri_count + 1) * 3
        self.cell_data = {"part": np.arange(mesh.tri_count) % 2}
        self.point_data: dict[str, np.ndarray] = {}

    def cast_to_unstructured_grid(self) -> _Pyvista:
        return self


@pytest.mark.parametrize("kind", [_Trimesh, _Pyvista])
def test_objects_that_look_like_other_libraries_convert(kind: type) -> None:
    ball = tube(radius=1.0, length=3.0, around=5, along=3, cap_end="none")
    mesh = Mesh.from_object(kind(ball))
    assert np.array_equal(mesh.triangles, ball.triangles)
    assert mesh.tri_groups["part_1"].tolist() == list(range(1, ball.tri_count, 2))


def test_the_libraries_themselves_convert_where_they_are_installed() -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = sphere(radius=2.0, divisions=2)
    mesh = Mesh.from_object(trimesh.Trimesh(ball.points, ball.triangles, process=False))
    assert np.array_equal(mesh.triangles, ball.triangles)


def test_other_objects_and_solids_are_refused() -> None:
    with pytest.raises(InputError, match=r"builtins\.dict is no mesh of meshio, trimesh or pyvista"):
        Mesh.from_object({})
    solid = meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])])
    with pytest.raises(InputError, match="holds 1 tetra cells: solid elements are no membrane"):
        Mesh.from_object(solid)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lines": [[0, 0]]}, r"line 0 joins nodes \(0, 0\)"),
        ({"lines": [[0, 20]]}, r"line 0 joins nodes \(0, 20\); two different ones from 0 to 19"),
        ({"lines": [0, 1]}, r"lines must have shape \(line_count, 2\)"),
        ({"lines": [[0, 1]], "line_groups": {"a": [1]}}, "line group 'a' holds 1"),
        (
            {"loose_points": [[0, 0, 9]], "loose_groups": {"a": [3]}},
            "loose group 'a' holds 3; loose points are 20 to 20",
        ),
        ({"join": -1.0}, "join = -1.0 must be a distance above 0"),
    ],
)
def test_bad_lines_and_loose_points_are_refused(options: dict, words: str) -> None:
    flat = panel(width=3.0, height=2.0, along_x=4, along_y=3)
    with pytest.raises(InputError, match=words):
        Mesh.build(flat.points, flat.triangles, **options)


def test_repair_carries_lines_and_loose_points_along() -> None:
    flat = panel(width=3.0, height=2.0, along_x=4, along_y=3)
    points = np.vstack(([[50.0, 50, 50]], flat.points))  # a node in front that nothing uses
    count = len(points)
    mesh = Mesh.build(
        points,
        flat.triangles + 1,
        repair=True,
        lines=[[1, count]],
        loose_points=[[0, 0, 9]],
        loose_groups={"top": [count]},
    )
    assert mesh.lines.tolist() == [[0, flat.node_count]]
    assert mesh.loose_groups["top"].tolist() == [flat.node_count]
    with pytest.raises(InputError, match="line 0 uses a node that no element uses"):
        Mesh.build(points, flat.triangles + 1, repair=True, lines=[[0, 1]])


def test_a_run_on_a_mesh_with_open_seams_is_read_back(tmp_path: Path) -> None:
    from taichi_membrane.output.reader import _mesh

    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, -1, 0]]
    mesh = Mesh.build(points, [[0, 1, 2], [4, 3, 5]], open_seams=True)
    checksum = write_vtu(tmp_path / "mesh.vtu", mesh, mesh.lines[:0], {}, {}, {})
    assert _mesh(SCENE, tmp_path / "mesh.vtu", checksum).node_count == 6


def test_an_array_that_numbers_the_cells_makes_no_groups() -> None:
    ball = sphere(radius=2.0, divisions=12)
    thing = meshio.Mesh(ball.points, [("triangle", ball.triangles)], cell_data={"id": [np.arange(ball.tri_count)]})
    mesh = Mesh.from_object(thing)
    assert set(mesh.tri_groups) == {"all"}
    assert mesh.notes == ("'id' has 1152 different values, more than 1000: taken as numbering, not as groups",)
