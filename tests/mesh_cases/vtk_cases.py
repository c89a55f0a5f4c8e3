"""VTK's files, old and XML: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, TRIANGLES, Case, Read


def v_old(dataset: str, extra: str = "", version: str = "3.0") -> str:
    """An old VTK file in text."""
    points = "".join(f"{x} {y} {z}\n" for x, y, z in NODES)
    return f"# vtk DataFile Version {version}\ntitle\nASCII\nDATASET {dataset}{extra}".replace(
        "POINTS", f"POINTS 9 float\n{points}"
    )


V_CELLS = "".join(f"3 {a - 1} {b - 1} {c - 1}\n" for a, b, c in TRIANGLES)
V_GRID = v_old("UNSTRUCTURED_GRID\nPOINTS", "CELLS 8 32\n" + V_CELLS + "CELL_TYPES 8\n" + "5\n" * 8)
V_PART = "CELL_DATA 8\nSCALARS part int 1\nLOOKUP_TABLE default\n3 3 3 3 4 4 4 4\n"


def x_vtu(cell_data: str = "", kind: str = "5") -> str:
    """A .vtu file in text."""
    points = " ".join(f"{x} {y} {z}" for x, y, z in NODES)
    corners = " ".join(f"{a - 1} {b - 1} {c - 1}" for a, b, c in TRIANGLES)
    ends = " ".join(str(3 * n) for n in range(1, 9))
    return (
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
        '<Piece NumberOfPoints="9" NumberOfCells="8"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">'
        f'{points}</DataArray></Points><Cells><DataArray type="Int32" Name="connectivity" format="ascii">{corners}</DataArray>'
        f'<DataArray type="Int32" Name="offsets" format="ascii">{ends}</DataArray><DataArray type="UInt8" Name="types" '
        f'format="ascii">{f"{kind} " * 8}</DataArray></Cells><CellData>{cell_data}</CellData></Piece></UnstructuredGrid></VTKFile>'
    )


X_PART = '<DataArray type="Int32" Name="part" format="ascii">3 3 3 3 4 4 4 4</DataArray>'
PARTS = {"part_3": 4, "part_4": 4}


def _v(feature: str, name: str, content: str, verdict: Read | str) -> Case:
    return Case("VTK .vtk .vtu .vtp", feature, name, content, verdict)


VTK = [
    _v(".vtk: unstructured grids, whole numbers of cells as groups", "v.vtk", V_GRID + V_PART, Read(tri_groups=PARTS)),
    _v(
        ".vtk: polygon data",
        "v.vtk",
        v_old("POLYDATA\nPOINTS", "POLYGONS 8 32\n" + V_CELLS + V_PART),
        Read(tri_groups=PARTS),
    ),
    _v(
        ".vtk: version 5 with offsets",
        "v.vtk",
        v_old(
            "POLYDATA\nPOINTS",
            "POLYGONS 9 24\nOFFSETS vtktypeint64\n0 3 6 9 12 15 18 21 24\nCONNECTIVITY vtktypeint64\n"
            + "".join(f"{a - 1} {b - 1} {c - 1}\n" for a, b, c in TRIANGLES),
            "5.1",
        ),
        Read(),
    ),
    _v(
        ".vtk: fields, vectors of points",
        "v.vtk",
        V_GRID
        + "CELL_DATA 8\nFIELD FieldData 1\npart 1 8 int\n3 3 3 3 4 4 4 4\nPOINT_DATA 9\nVECTORS u float\n"
        + "0 0 0\n" * 9,
        Read(tri_groups=PARTS, notes=("not carried over: 'u' of points",)),
    ),
    _v(
        ".vtk: lines, of several points",
        "v.vtk",
        v_old("POLYDATA\nPOINTS", "LINES 1 4\n3 0 1 2\nPOLYGONS 8 32\n" + V_CELLS),
        Read(lines=2),
    ),
    _v(
        ".vtk: triangle strips",
        "v.vtk",
        v_old("POLYDATA\nPOINTS", "TRIANGLE_STRIPS 1 5\n4 0 1 3 4\n"),
        "cell 0 is a triangle strip",
    ),
    _v(
        ".vtk: structured grids",
        "v.vtk",
        v_old("STRUCTURED_GRID\nDIMENSIONS 3 3 1\nPOINTS"),
        "'STRUCTURED_GRID' is not read",
    ),
    _v(".vtu: whole numbers of cells as groups", "v.vtu", x_vtu(X_PART), Read(tri_groups=PARTS)),
    _v(
        ".vtu: numbering, real numbers",
        "v.vtu",
        x_vtu('<DataArray type="Float64" Name="t" format="ascii">1 1 1 1 1 1 1 1</DataArray>'),
        Read(tri_fields={"t": 1}),
    ),
    _v(
        ".vtu: marks of our own, group:NAME",
        "v.vtu",
        x_vtu('<DataArray type="Int8" Name="group:my%20bag" format="ascii">1 1 1 0 0 0 0 0</DataArray>'),
        Read(tri_groups={"my bag": 3}),
    ),
    _v(
        ".vtu: arrays of a wrong length",
        "v.vtu",
        x_vtu(X_PART.replace("3 3 3 3 ", "3 ")),
        "the array 'part' has 5 values, 8 are needed",
    ),
    _v(".vtu: solids", "v.vtu", x_vtu(kind="10"), "cell 0 is of VTK's type 10: solid elements are no membrane"),
    _v(".vtu: second-order cells", "v.vtu", x_vtu(kind="23"), "cell 0 is of VTK's type 23: second-order elements"),
    _v(".vtu: a file that is cut off", "v.vtu", x_vtu()[:-30], "the file is no well-formed XML"),
    _v(
        ".vtu: cells marked as ghosts",
        "v.vtu",
        x_vtu('<DataArray type="UInt8" Name="vtkGhostType" format="ascii">0 0 0 0 0 0 0 1</DataArray>'),
        Read(notes=("1 cell of 8 marked as ghosts",)),
    ),
    _v(
        ".vtu: texts",
        "v.vtu",
        x_vtu('<Array type="String" Name="names" format="ascii">65 0</Array>'),
        Read(notes=("the array 'names' of type 'String'",)),
    ),
]
