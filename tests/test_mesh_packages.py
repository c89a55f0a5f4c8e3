"""Formats that need a package more: read right where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import read_mesh
from taichi_membrane.shapes import sphere

BALL = sphere(radius=2.0, divisions=2)


@pytest.mark.parametrize(
    ("name", "package"), [("b.med", "h5py"), ("b.xdmf", "h5py"), ("b.h5m", "h5py"), ("b.exo", "netCDF4")]
)
def test_a_closed_body_comes_back(tmp_path: Path, name: str, package: str) -> None:
    pytest.importorskip(package)
    meshio.Mesh(BALL.points, [("triangle", BALL.triangles)]).write(tmp_path / name)
    mesh = read_mesh(tmp_path / name)
    assert mesh.is_closed
    assert np.array_equal(mesh.triangles, BALL.triangles)


def test_families_of_med_are_groups_by_kind(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    tags = [np.where(np.arange(BALL.tri_count) < 5, -6, -7), np.array([-8])]
    mesh: Any = meshio.Mesh(
        BALL.points, [("triangle", BALL.triangles), ("line", [[0, 1]])], cell_data={"cell_tags": tags}
    )
    mesh.cell_tags = {-6: ["bag", "top"], -7: ["bag"], -8: ["bag"]}
    mesh.write(tmp_path / "b.med")
    found = read_mesh(tmp_path / "b.med")
    assert len(found.tri_groups["bag"]) == BALL.tri_count
    assert found.tri_groups["top"].tolist() == [0, 1, 2, 3, 4]
    assert found.line_groups["bag"].tolist() == [0]
    assert found.node_groups["bag"].tolist() == [0, 1]


def a_cgns(path: Path, *, kind: int = 5, zones: int = 1) -> None:
    """The ball in a CGNS file: one section of triangles, a boundary condition of points and one of elements."""
    import h5py

    def node(parent: Any, name: str, label: str, data: Any = None) -> Any:
        own = parent.create_group(name)
        own.attrs["label"] = np.bytes_(label)
        if data is not None:
            own[" data"] = np.frombuffer(data.encode(), dtype=np.int8) if isinstance(data, str) else np.asarray(data)
        return own

    with h5py.File(path, "w") as file:
        base = node(file, "Base", "CGNSBase_t", [2, 3])
        for number in range(zones):
            zone = node(base, f"Zone{number}", "Zone_t", [[BALL.node_count], [BALL.tri_count], [0]])
            node(zone, "ZoneType", "ZoneType_t", "Unstructured")
            grid = node(zone, "GridCoordinates", "GridCoordinates_t")
            for k, axis in enumerate("XYZ"):
                node(grid, f"Coordinate{axis}", "DataArray_t", BALL.points[:, k])
            section = node(zone, "bag", "Elements_t", [kind, 0])
            node(section, "ElementRange", "IndexRange_t", [1, BALL.tri_count])
            node(section, "ElementConnectivity", "DataArray_t", BALL.triangles.ravel() + 1)
            conditions = node(zone, "ZoneBC", "ZoneBC_t")
            held = node(conditions, "held", "BC_t", "FamilySpecified")
            node(held, "PointList", "IndexArray_t", [[1, 3]])
            some = node(conditions, "some", "BC_t", "FamilySpecified")
            node(some, "GridLocation", "GridLocation_t", "CellCenter")
            node(some, "PointRange", "IndexRange_t", [[2, 4]])


def test_sections_and_boundary_conditions_of_cgns_are_groups(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    a_cgns(tmp_path / "b.cgns")
    mesh = read_mesh(tmp_path / "b.cgns")
    assert np.array_equal(mesh.points, BALL.points)
    assert np.array_equal(mesh.triangles, BALL.triangles)
    assert len(mesh.tri_groups["bag"]) == BALL.tri_count
    assert mesh.tri_groups["some"].tolist() == [1, 2, 3]
    assert mesh.node_groups["held"].tolist() == [0, 2]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kind": 10}, "CGNS's type 10: solid elements"),
        ({"kind": 6}, "type 6: second-order"),
        ({"zones": 2}, "2 zones"),
    ],
)
def test_what_cgns_says_and_is_not_read_is_refused(tmp_path: Path, options: dict[str, int], words: str) -> None:
    pytest.importorskip("h5py")
    a_cgns(tmp_path / "b.cgns", **options)
    with pytest.raises(InputError, match=words):
        read_mesh(tmp_path / "b.cgns")
    (tmp_path / "c.cgns").write_bytes(b"rubbish")
    with pytest.raises(InputError, match="no HDF5 file"):
        read_mesh(tmp_path / "c.cgns")


def test_meshes_of_a_rhino_model(tmp_path: Path) -> None:
    rhino3dm: Any = pytest.importorskip("rhino3dm")
    model, mesh = rhino3dm.File3dm(), rhino3dm.Mesh()
    for point in BALL.points.tolist():
        mesh.Vertices.Add(*point)
    for corners in BALL.triangles.tolist():
        mesh.Faces.AddFace(*corners)
    attributes = rhino3dm.ObjectAttributes()
    attributes.Name = "balloon"
    model.Objects.AddMesh(mesh, attributes)
    model.Write(str(tmp_path / "b.3dm"), 7)
    found = read_mesh(tmp_path / "b.3dm")
    assert found.is_closed
    assert len(found.tri_groups["balloon"]) == found.tri_count == BALL.tri_count


def test_an_object_of_a_layer_s_name_stays_apart_and_units_are_told(tmp_path: Path) -> None:
    rhino3dm: Any = pytest.importorskip("rhino3dm")
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = rhino3dm.UnitSystem.Millimeters
    numbers = []
    for name in ("other", "bag"):
        layer = rhino3dm.Layer()
        layer.Name = name
        numbers.append(model.Layers.Add(layer))
    for shift, name, place in ((0.0, "bag", numbers[0]), (9.0, "patch", numbers[1])):
        mesh = rhino3dm.Mesh()
        for x, y in ((0, 0), (1, 0), (0, 1)):
            mesh.Vertices.Add(x + shift, float(y), 0.0)
        mesh.Faces.AddFace(0, 1, 2)
        attributes = rhino3dm.ObjectAttributes()
        attributes.Name, attributes.LayerIndex = name, place
        model.Objects.AddMesh(mesh, attributes)
    model.Write(str(tmp_path / "b.3dm"), 7)
    found = read_mesh(tmp_path / "b.3dm")
    assert found.tri_groups["object_bag"].tolist() == [0]
    assert found.tri_groups["bag"].tolist() == found.tri_groups["patch"].tolist() == [1]
    assert found.notes == ("the model's unit is Millimeters; its numbers are taken as they stand",)


def an_exodus(path: Path, kind: str = "SHELL", nodes: int = 4) -> None:
    """A square of one quadrilateral and two triangles beside it, in two blocks; a node set, a side set."""
    netcdf: Any = pytest.importorskip("netCDF4")
    with netcdf.Dataset(path, "w") as file:
        for name, size in (
            ("num_nodes", 6),
            ("num_el_blk", 2),
            ("num_node_sets", 1),
            ("num_side_sets", 1),
            ("len_name", 33),
        ):
            file.createDimension(name, size)
        for axis, values in (("x", [0, 1, 1, 0, 2, 2]), ("y", [0, 0, 1, 1, 0, 1]), ("z", [0] * 6)):
            file.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = values
        file.createVariable("eb_prop1", "i4", ("num_el_blk",))[:] = [10, 20]
        file.createVariable("eb_names", "S1", ("num_el_blk", "len_name"))[0, :3] = np.array(list("bag"), dtype="S1")
        for number, kind_of, corners in ((1, kind, [[1, 2, 3, 4, 5, 6][:nodes]]), (2, "TRI3", [[2, 5, 6], [2, 6, 3]])):
            file.createDimension(f"n{number}", len(corners))
            file.createDimension(f"w{number}", len(corners[0]))
            own = file.createVariable(f"connect{number}", "i4", (f"n{number}", f"w{number}"))
            own.elem_type = kind_of
            own[:] = corners
        file.createDimension("held", 2)
        file.createVariable("node_ns1", "i4", ("held",))[:] = [1, 4]
        file.createVariable("ns_prop1", "i4", ("num_node_sets",))[:] = [7]


def test_blocks_and_node_sets_of_exodus_are_groups(tmp_path: Path) -> None:
    an_exodus(tmp_path / "b.exo")
    mesh = read_mesh(tmp_path / "b.exo")
    assert float(mesh.tri_areas().sum()) == pytest.approx(2.0)
    assert mesh.tri_groups["bag"].tolist() == [0, 1]
    assert mesh.tri_groups["block_20"].tolist() == [2, 3]
    assert mesh.node_groups["nodeset_7"].tolist() == [0, 3]
    assert "not carried over: sideset_1" in mesh.notes


@pytest.mark.parametrize(
    ("kind", "nodes", "words"),
    [
        ("HEX8", 4, "connect1 holds elements 'HEX8' of 4 nodes: solid elements"),
        ("TRI6", 6, "connect1 holds elements 'TRI6' of 6 nodes: second-order"),
    ],
)
def test_what_exodus_says_and_is_not_read_is_refused(tmp_path: Path, kind: str, nodes: int, words: str) -> None:
    an_exodus(tmp_path / "b.e", kind, nodes)
    with pytest.raises(InputError, match=words):
        read_mesh(tmp_path / "b.e")
    (tmp_path / "c.e").write_bytes(b"rubbish")
    with pytest.raises(InputError, match="no netCDF file"):
        read_mesh(tmp_path / "c.e")


def test_what_another_library_says_of_a_file_is_noted(tmp_path: Path) -> None:
    """SU2 names its markers; they come as numbers, which is said."""
    (tmp_path / "m.su2").write_text(
        "NDIME= 2\nNELEM= 2\n5 0 1 2 0\n5 0 2 3 1\nNPOIN= 4\n0 0 0\n1 0 1\n1 1 2\n0 1 3\nNMARK= 1\n"
        "MARKER_TAG= rim\nMARKER_ELEMS= 1\n3 0 1\n"
    )
    mesh = read_mesh(tmp_path / "m.su2")
    assert mesh.tri_count == 2
    assert any(note.startswith("meshio says: Warning:") and "rim" in note for note in mesh.notes), mesh.notes
