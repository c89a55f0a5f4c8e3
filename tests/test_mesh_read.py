"""Reading mesh files: every format gives the same mesh, groups keep their names, rubbish gives one message."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import meshio
import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import read_mesh
from taichi_membrane.shapes import sphere

# Two triangles of a unit square, as gmsh writes them: a point of the geometry that no triangle uses (tag 9, the
# centre of some arc), a named line, a named vertex and two named surfaces; node tags are neither dense nor sorted.
GMSH_4_1 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
4
0 7 "peg"
1 5 "hem"
2 1 "lower"
2 2 "upper"
$EndPhysicalNames
$Entities
2 1 2 0
1 1 1 0 1 7
2 9 9 9 0
1 0 0 0 0 1 0 1 5 0
1 0 0 0 1 1 0 1 1 0
2 0 0 0 1 1 0 1 2 0
$EndEntities
$Nodes
2 5 1 9
0 2 0 1
9
9 9 9
2 1 0 4
1
2
8
3
0 0 0
1 0 0
0 1 0
1 1 0
$EndNodes
$Elements
4 4 1 4
0 1 15 1
1 3
1 1 1 1
2 1 8
2 1 2 1
3 1 2 3
2 2 2 1
4 1 3 8
$EndElements
"""


def test_gmsh_physical_groups(tmp_path: Path) -> None:
    path = tmp_path / "square.msh"
    path.write_text(GMSH_4_1)
    mesh = read_mesh(path)
    assert (mesh.node_count, mesh.tri_count) == (4, 2), "the unused geometry point is dropped"
    at = {name: {tuple(p[:2]) for p in mesh.points[nodes].tolist()} for name, nodes in mesh.node_groups.items()}
    assert at["hem"] == {(0, 0), (0, 1)}
    assert at["peg"] == {(1, 1)}
    assert at["lower"] == {(0, 0), (1, 0), (1, 1)}
    assert at["upper"] == {(0, 0), (1, 1), (0, 1)}
    assert {name: g.tolist() for name, g in mesh.tri_groups.items()} == {"all": [0, 1], "lower": [0], "upper": [1]}
    assert mesh.tri_normals().tolist() == [[0, 0, 1], [0, 0, 1]]


def quiet_write(mesh: meshio.Mesh, path: Path, **options: str) -> None:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        mesh.write(path, **options)


def test_old_gmsh_tags_name_groups_across_blocks(tmp_path: Path) -> None:
    points = [[9.0, 9, 9], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    cells = [("triangle", [[1, 2, 3]]), ("line", [[1, 4], [1, 2]]), ("triangle", [[1, 3, 4]])]
    tags = [np.array([2]), np.array([5, 6]), np.array([2])]
    names = {"cloth": np.array([2, 2]), "hem": np.array([5, 1]), "also_2_but_a_line": np.array([2, 1])}
    mesh = meshio.Mesh(points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}, field_data=names)
    quiet_write(mesh, tmp_path / "old.msh", file_format="gmsh22")
    found = read_mesh(tmp_path / "old.msh")
    assert found.tri_groups["cloth"].tolist() == [0, 1]
    assert found.node_groups["hem"].tolist() == [0, 3]
    assert "also_2_but_a_line" not in found.node_groups


def test_sets_keep_their_names(tmp_path: Path) -> None:
    ball = sphere(radius=2.0, divisions=2)
    north = [t for t, nodes in enumerate(ball.triangles) if ball.points[nodes, 2].mean() > 0]
    mesh = meshio.Mesh(
        ball.points,
        [("triangle", ball.triangles)],
        point_sets={"pole": ball.node_groups["north"]},
        cell_sets={"upper": [np.array(north)]},
    )
    quiet_write(mesh, tmp_path / "ball.inp")
    found = read_mesh(tmp_path / "ball.inp")
    assert found.node_groups["pole"].tolist() == ball.node_groups["north"].tolist()
    assert found.tri_groups["upper"].tolist() == north
    assert found.node_groups["upper"].tolist() == np.unique(ball.triangles[north]).tolist()


@pytest.mark.parametrize("suffix", ["msh", "vtk", "vtu", "stl", "obj", "ply", "off", "inp", "mesh"])
def test_every_common_format_gives_the_same_closed_body(tmp_path: Path, suffix: str) -> None:
    ball = sphere(radius=3.0, divisions=3)
    path = tmp_path / f"ball.{suffix}"
    quiet_write(meshio.Mesh(ball.points, [("triangle", ball.triangles)]), path)
    found = read_mesh(str(path))
    assert (found.node_count, found.tri_count, found.is_closed) == (ball.node_count, ball.tri_count, True)
    # The text formats keep 8 digits (stl, in single precision) or more.
    assert found.enclosed_volume() == pytest.approx(ball.enclosed_volume(), rel=1e-6)


def test_flat_file_gets_its_third_coordinate(tmp_path: Path) -> None:
    points = "0 0 0\n1 0 1\n1 1 2\n0 1 3\n"
    (tmp_path / "flat.su2").write_text(f"NDIME= 2\nNELEM= 2\n5 0 1 2 0\n5 0 2 3 1\nNPOIN= 4\n{points}NMARK= 0\n")
    assert read_mesh(tmp_path / "flat.su2").points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("pentagon.obj", OBJ + "f 1 2 3 4 1\n", "line 5: a face has 5 corners, 3 or 4 are read: triangulate"),
        ("none.obj", OBJ, "the file holds no triangles and no cells"),
        ("mixed.obj", OBJ + "f 1 2 3\nf 1 4 3\n", r"elements 0 and 1 run along .* nodes \(0, 2\)"),
        ("beyond.obj", OBJ + "f 1 2 9\n", "line 5: vertex 9 is used, and the file has 4 vertices"),
        ("rubbish.msh", "\x00\x01 rubbish", "a section such as .Nodes is expected at byte 0"),
        ("rubbish.vtk", "rubbish\n" * 9, "'# vtk DataFile Version …', a title, and ASCII or BINARY"),
        ("rubbish.vtu", "<VTKFile", "no well-formed XML: unclosed token"),
        ("empty.obj", "", "the file holds no triangles and no cells"),
        ("cut.msh", GMSH_4_1[:-30], r"line 34: .Elements has no .EndElements: the file is cut off"),
        ("letter.docx", "dear", "the file extension '.docx' is unknown; allowed: .*.msh.*.vtu"),
        ("letter", "dear", "the file extension '' is unknown"),
    ],
)
def test_unreadable_files_are_told_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str, words: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", ""), "meshio's own printing is kept off the terminal"


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such mesh file"):
        read_mesh(tmp_path / "nowhere.msh")
    with pytest.raises(InputError, match="this is a folder"):
        read_mesh(tmp_path)
