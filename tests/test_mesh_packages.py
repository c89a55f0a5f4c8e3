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
