"""Every case of the table of mesh formats: read with the right counts, area and groups, or refused with the right words."""

from __future__ import annotations

import base64
import struct
from pathlib import Path

import meshio
import numpy as np
import pytest
from mesh_cases import CASES, Case, Read

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read, read_mesh


def sizes(groups: object) -> dict[str, int]:
    return {name: len(members) for name, members in dict(groups).items()}  # type: ignore[call-overload]


def assert_is(mesh: Mesh, wanted: Read) -> None:
    """Counts and area agree; all named groups are there, with their sizes; no group of triangles or lines is there besides."""
    assert (mesh.tri_count, mesh.node_count, len(mesh.lines)) == (wanted.triangles, wanted.nodes, wanted.lines)
    assert float(mesh.tri_areas().sum()) == pytest.approx(wanted.area, rel=1e-12)
    named = {name: size for name, size in sizes(mesh.tri_groups).items() if name != "all"}
    assert named == wanted.tri_groups
    assert wanted.node_groups.items() <= sizes(mesh.node_groups).items()
    assert sizes(mesh.line_groups) == wanted.line_groups
    assert sizes(mesh.loose_groups) == wanted.loose_groups
    assert {name: values[0].size for name, values in mesh.tri_fields.items()} == wanted.tri_fields
    for words in wanted.notes:
        assert any(words in note for note in mesh.notes), mesh.notes
    if not wanted.notes:
        assert [note for note in mesh.notes if "holds only" not in note] == []


@pytest.mark.parametrize("case", CASES, ids=[f"{case.format.split()[0]}: {case.feature}" for case in CASES])
def test_a_file_is_read_right_or_refused_in_one_sentence(tmp_path: Path, case: Case) -> None:
    path = case.write(tmp_path)
    if isinstance(case.verdict, Read):
        assert_is(read_mesh(path), case.verdict)
        return
    with pytest.raises(InputError, match=case.verdict) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{tmp_path}")
    assert "cannot be read, the file may be damaged" not in str(caught.value), (
        "a reader failed where it should have said why"
    )
    assert "\n" not in str(caught.value)


def test_the_page_of_formats_is_made_from_this_table() -> None:
    from mesh_cases.page import PAGE, page

    assert PAGE.read_text(encoding="utf-8") == page(), "run PYTHONPATH=tests python -m mesh_cases"


def test_positions_of_an_instance_are_shifted_and_then_turned(tmp_path: Path) -> None:
    """A quarter turn about the line through (1, 2, 3) along z, after the shift by (1, 2, 3)."""
    case = next(case for case in CASES if case.feature.startswith("one part, two instances"))
    content = str(case.content).replace("0, 0, 7\n0, 0, 0, 0, 0, 1, 90", "1, 2, 3\n1, 2, 3, 1, 2, 4, 90")
    (tmp_path / "a.inp").write_text(content)
    mesh = read_mesh(tmp_path / "a.inp")
    assert mesh.points[8].tolist() == [2.0, 2.0, 5.0]
    assert mesh.points[[9, 11, 15]] == pytest.approx(np.array([[1.0, 2, 3], [1, 4, 3], [-1, 2, 3]]), abs=1e-15)


@pytest.mark.parametrize(
    ("card", "numbers", "local"),
    [
        ("CORD2R", "2.,3.,4.", (2.0, 3.0, 4.0)),
        ("CORD2C", "2.,90.,4.", (0.0, 2.0, 4.0)),
        ("CORD2S", "2.,90.,0.", (2.0, 0.0, 0.0)),
        ("CORD2S", "2.,30.,90.", (0.0, 1.0, 3**0.5)),
    ],
)
def test_positions_in_systems_of_nastran(tmp_path: Path, card: str, numbers: str, local: tuple[float, ...]) -> None:
    """Origin at (0, 10, 20); the system's z lies along x and its x along z, so its y, which is z cross x, along -y."""
    system = f"{card},5,0,0.,10.,20.,1.,10.,20.,\n,0.,10.,21.\n"
    (tmp_path / "n.bdf").write_text(
        f"{system}GRID,1,5,{numbers}\nGRID,2,0,50.,0.,0.\nGRID,3,0,0.,60.,0.\nCTRIA3,1,1,1,2,3\n"
    )
    x, y, z = local
    assert read_mesh(tmp_path / "n.bdf").points[0] == pytest.approx(np.array([z, 10.0 - y, 20.0 + x]), abs=1e-12)


def test_quads_are_split_along_the_shorter_diagonal(tmp_path: Path) -> None:
    (tmp_path / "o.obj").write_text("v 0 0 0\nv 3 -1 0\nv 4 4 0\nv 1 2 0\nf 1 2 3 4\n")
    mesh = read_mesh(tmp_path / "o.obj")
    edges = {tuple(edge) for edge in mesh.edges().tolist()}
    assert (1, 3) in edges
    assert (0, 2) not in edges
    assert (mesh.tri_normals()[:, 2] > 0).all()


def test_a_package_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read, "find_spec", lambda name: None)
    for name, package in (("a.med", "h5py"), ("a.exo", "netCDF4"), ("a.3dm", "rhino3dm")):
        (tmp_path / name).write_bytes(b"x")
        with pytest.raises(
            InputError, match=rf"needs the package {package}, which is not installed: pip install 'taichi"
        ):
            read_mesh(tmp_path / name)


def test_a_failure_inside_a_reader_is_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(path: Path) -> object:
        def read_it(source: object) -> None:
            raise KeyError("inside")

        return read_it

    monkeypatch.setattr(read, "_reader", failing)
    (tmp_path / "a.obj").write_text("x")
    with pytest.raises(
        InputError, match=r"a\.obj: the mesh cannot be read, the file may be damaged: KeyError: 'inside'"
    ):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("cards", "place"),
    [
        ("*NODE, SYSTEM=C\n1, 2, 30, 4\n", (3**0.5, 1.0, 4.0)),
        ("*NODE, SYSTEM=S\n1, 2, 90, 30\n", (0.0, 3**0.5, 1.0)),  # 30 degrees up from the plane of x and y
        ("*SYSTEM\n5, 6, 7\n*NODE\n1, 1, 2, 3\n", (6.0, 8.0, 10.0)),
        ("*SYSTEM\n5, 6, 7, 5, 9, 7\n*NODE\n1, 1, 2, 3\n", (3.0, 7.0, 10.0)),
        ("*SYSTEM\n5, 6, 7, 5, 6, 9\n6, 6, 7\n*NODE\n1, 1, 2, 3\n", (7.0, 9.0, 8.0)),
    ],
)
def test_positions_in_systems_of_abaqus(tmp_path: Path, cards: str, place: tuple[float, ...]) -> None:
    rest = "*SYSTEM\n*NODE\n2, 50, 0, 0\n3, 0, 60, 0\n*ELEMENT, TYPE=S3\n1, 1, 2, 3\n"
    (tmp_path / "a.inp").write_text(cards + rest)
    mesh = read_mesh(tmp_path / "a.inp")
    assert mesh.points[0] == pytest.approx(np.array(place), abs=1e-12)
    assert mesh.points[1].tolist() == [50.0, 0.0, 0.0]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("size", ["UInt32", "UInt64"])
def test_binary_arrays_of_vtu_in_all_their_spellings(tmp_path: Path, order: str, apart: bool, size: str) -> None:
    """Either byte order; the length before the numbers encoded with them or by itself; a pixel, whose corners go in rows."""

    def array(name: str, kind: str, values: np.ndarray) -> str:
        data = values.astype(values.dtype.newbyteorder(order)).tobytes()
        head = np.array([len(data)], dtype=f"{order}u{4 if size == 'UInt32' else 8}").tobytes()
        parts = [head, data] if apart else [head + data]
        text = "".join(base64.b64encode(part).decode() for part in parts)
        width = ' NumberOfComponents="3"' if name == "xyz" else ""
        return f'<DataArray type="{kind}" Name="{name}"{width} format="binary">{text}</DataArray>'

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=np.float64)
    (tmp_path / "v.vtu").write_text(
        f'<VTKFile type="UnstructuredGrid" byte_order="{"LittleEndian" if order == "<" else "BigEndian"}" header_type="{size}">'
        f'<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1"><Points>{array("xyz", "Float64", points)}</Points><Cells>'
        f"{array('connectivity', 'Int32', np.arange(4, dtype=np.int32))}{array('offsets', 'Int32', np.array([4], dtype=np.int32))}"
        f"{array('types', 'UInt8', np.array([8], dtype=np.uint8))}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    mesh = read_mesh(tmp_path / "v.vtu")
    assert np.array_equal(mesh.points, points)
    assert float(mesh.tri_areas().sum()) == 1.0


@pytest.mark.parametrize(
    ("card", "rows", "digit"),
    [
        ("CORD2C", ("100.,33.333,0.", "100.,77.125,0.", "100.,50.012,60."), 1e-3 * np.pi / 180 * 100),
        ("CORD2C", ("100.,30.,0.", "100.,60.,0.", "100.,45.,161.234"), 1e-3),
        ("CORD2S", ("200.,30.,10.", "200.,60.,20.", "200.,45.,61.234"), 1e-3 * np.pi / 180 * 200),
        ("CORD2R", ("100.,30.,10.", "100.,60.,20.", "100.,45.,161.234"), 1e-3),
    ],
)
def test_digits_of_angles_count_at_their_radius(tmp_path: Path, card: str, rows: tuple[str, ...], digit: float) -> None:
    """Three decimals of degrees or of length; the tolerance for equal nodes is four of the last digit."""
    system = f"{card},5,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n"
    grids = "".join(f"GRID,{n},5,{row}\n" for n, row in enumerate(rows, 1))
    (tmp_path / "n.bdf").write_text(f"{system}{grids}CTRIA3,1,1,1,2,3\n")
    assert read_mesh(tmp_path / "n.bdf").tolerance == pytest.approx(4.0 * digit, rel=1e-6)


def test_numbers_that_differ_from_cell_to_cell_are_no_groups(tmp_path: Path) -> None:
    """A thousand different values group the cells; one more numbers them."""
    for count in (1000, 1001):
        strip = "".join(f"v {k // 2} {k % 2} 0\n".replace("v ", "") for k in range(count + 2))
        faces = "".join(f"3 {k + k % 2} {k + 1 - k % 2} {k + 2} {k}\n" for k in range(count))
        (tmp_path / "p.ply").write_text(
            f"ply\nformat ascii 1.0\nelement vertex {count + 2}\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face {count}\nproperty list uchar int vertex_indices\nproperty int part\nend_header\n{strip}{faces}"
        )
        mesh = read_mesh(tmp_path / "p.ply", repair=True)
        assert len(mesh.tri_groups) == (1 + count if count == 1000 else 1)
        assert ("'part' has 1001 different values" in " ".join(mesh.notes)) == (count == 1001)


def quad_in_space(corners: list[tuple[float, float]], seed: int) -> str:
    """An OBJ file of one quadrilateral in a plane, turned and shifted at random."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.column_stack((np.array(corners), np.zeros(4))) @ turn.T + rng.normal(size=3)
    return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()) + "f 1 2 3 4\n"


@pytest.mark.parametrize("seed", range(20))
def test_round_off_does_not_choose_how_a_quad_is_split(tmp_path: Path, seed: int) -> None:
    """A square's diagonals are equal: the first is taken. A thousandth of a thousandth of difference counts. Three corners on one
    line give no triangle without area."""
    path = tmp_path / "o.obj"
    for corners, wanted in (
        ([(0.0, 0.0), (0.7, 0.0), (0.7, 0.7), (0.0, 0.7)], (0, 2)),
        ([(0.0, 0.0), (0.7, 0.0), (0.7 + 1e-6, 0.7 + 1e-6), (0.0, 0.7)], (1, 3)),
        ([(0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.1, 0.9)], (1, 3)),
    ):
        path.write_text(quad_in_space(corners, seed))
        assert wanted in {tuple(edge) for edge in read_mesh(path).edges().tolist()}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("version", ["2.2", "4.1"])
def test_binary_gmsh_of_either_byte_order(tmp_path: Path, version: str, order: str) -> None:
    """Two triangles of a square; the number one after the header tells the order of the bytes."""
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    content = f"$MeshFormat\n{version} 1 8\n".encode() + struct.pack(f"{order}i", 1) + b"\n$EndMeshFormat\n"
    if version == "2.2":
        nodes = b"4\n" + b"".join(struct.pack(f"{order}i3d", n, *at) for n, at in enumerate(points, 1))
        rows = struct.pack(f"{order}3i", 2, 2, 2) + struct.pack(f"{order}12i", 1, 7, 1, 1, 2, 3, 2, 7, 1, 1, 3, 4)
        rows = b"2\n" + rows
    else:
        content += b"$Entities\n" + struct.pack(f"{order}4Q", 0, 0, 1, 0)
        content += struct.pack(f"{order}i6dQiQ", 1, *(0.0,) * 6, 1, 7, 0) + b"\n$EndEntities\n"
        nodes = struct.pack(f"{order}4Q3iQ4Q", 1, 4, 1, 4, 2, 1, 0, 4, 1, 2, 3, 4)
        nodes += b"".join(struct.pack(f"{order}3d", *at) for at in points)
        rows = struct.pack(f"{order}4Q3iQ8Q", 1, 2, 1, 2, 2, 1, 2, 2, 1, 1, 2, 3, 2, 1, 3, 4)
    content += b"$Nodes\n" + nodes + b"\n$EndNodes\n$Elements\n" + rows + b"\n$EndElements\n"
    (tmp_path / "g.msh").write_bytes(content)
    mesh = read_mesh(tmp_path / "g.msh")
    assert mesh.points.tolist() == [list(at) for at in points]
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.tri_groups["physical_7"].tolist() == [0, 1]


def test_a_reader_of_another_library_that_ends_the_program_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ending(path: Path) -> None:
        print("no such thing")
        raise SystemExit(1)

    monkeypatch.setattr(meshio, "read", ending)
    (tmp_path / "a.su2").write_text("x")
    with pytest.raises(InputError, match=r"a\.su2: the mesh cannot be read by meshio: no such thing$"):
        read_mesh(tmp_path / "a.su2")
