"""NASTRAN bulk data: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read


def n_grid(fields: str = "        ") -> str:
    """GRID cards in small fields, in a given system."""
    return "".join(f"GRID    {n:<8}{fields}{x:<8.4f}{y:<8.4f}{z:<8.4f}\n" for n, (x, y, z) in enumerate(NODES, 1))


N_GRID = n_grid()
N_TRIANGLES = "".join(
    f"CTRIA3  {n:<8}{10 if n < 5 else 20:<8}{a:<8}{b:<8}{c:<8}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)
)
N_SHEET = N_GRID + N_TRIANGLES
PIDS = {"tri_groups": {"pid_10": 4, "pid_20": 4}}
N_CYLINDER = [(1.0, 45.0 * k, 1.0 * z) for z in range(3) for k in range(3)]


def n_cylinder(card: str) -> str:
    """A quarter of a cylinder about z, in the system that the cards define."""
    return card + "".join(f"GRID,{n},1,{r},{a},{z}\n" for n, (r, a, z) in enumerate(N_CYLINDER, 1)) + N_TRIANGLES


QUARTER = 8 * 0.5 * 0.7653668647301796  # eight triangles of half of height 1 times a chord over 45 degrees


def _n(feature: str, content: str, verdict: Read | str, **others: str) -> Case:
    return Case(
        "NASTRAN .bdf .nas .fem",
        feature,
        "n.bdf",
        content,
        verdict,
        {f"{name}.inc": text for name, text in others.items()},
    )


NASTRAN = [
    _n("small fields, with or without BEGIN BULK and ENDDATA", N_SHEET, Read(**PIDS)),
    _n(
        "executive and case control before BEGIN BULK",
        "SOL 101\nCEND\nSUBCASE 1\nBEGIN BULK\n" + N_SHEET + "ENDDATA\nGRID,1\n",
        Read(**PIDS),
    ),
    _n(
        "free fields",
        N_GRID + "".join(f"CTRIA3,{n},10,{a},{b},{c}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)),
        Read(tri_groups={"pid_10": 8}),
    ),
    _n("tabs", N_SHEET.replace("CTRIA3  1       10      ", "CTRIA3\t1\t10\t"), Read(**PIDS)),
    _n(
        "large fields, mixed with small",
        N_SHEET.replace(
            "CTRIA3  8       20      5       9       8       \n",
            f"CTRIA3* {8:<16}{20:<16}{5:<16}{9:<16}*X\n*X      {8:<16}\n",
        ),
        Read(**PIDS),
    ),
    _n(
        "exponents without their letter",
        N_SHEET.replace("1.0000  0.0000  0.0000", "1.0+0   .0D0    0.000-7 "),
        Read(**PIDS),
    ),
    _n("comments, small letters, lines of Windows", "$ x\n" + N_SHEET.lower().replace("\n", " $ y\r\n"), Read(**PIDS)),
    _n("CORD2C", n_cylinder("CORD2C,1,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n"), Read(area=QUARTER, **PIDS)),
    _n(
        "CORD2C given in another system",
        n_cylinder("CORD2C,1,7,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\nCORD2R,7,0,3.,4.,5.,4.,4.,5.,\n,3.,5.,5.\n"),
        Read(area=QUARTER, **PIDS),
    ),
    _n(
        "CORD1C",
        n_cylinder("GRID,91,,0.,0.,0.\nGRID,92,,0.,0.,1.\nGRID,93,,1.,0.,0.\nCORD1C,1,91,92,93\n"),
        Read(area=QUARTER, notes=("left out 3 nodes",), **PIDS),
    ),
    _n(
        "CORD2S",
        "CORD2S,1,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\nGRID,1,1,2.,0.,0.\nGRID,2,1,2.,90.,0.\nGRID,3,1,2.,90.,90.\nCTRIA3,1,5,1,2,3\n",
        Read(triangles=1, nodes=3, area=2 * 3**0.5, tri_groups={"pid_5": 1}),
    ),
    _n(
        "GRDSET",
        "GRDSET,,1\n" + n_cylinder("CORD2C,1,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n").replace(",1,1.0,", ",,1.0,"),
        Read(area=QUARTER, **PIDS),
    ),
    _n(
        "systems that are not defined",
        N_SHEET.replace("GRID    5               ", "GRID    5       6       "),
        r"line 5: GRID: there is no coordinate system 6",
    ),
    _n(
        "properties and materials as groups",
        N_SHEET + "PSHELL,10,3,0.1\nPSHELL,20,3,0.1\n",
        Read(tri_groups={"pid_10": 4, "pid_20": 4, "mid_3": 8}, notes=("not carried over: PSHELL's thickness",)),
    ),
    _n(
        "CQUAD4, CQUADR, CTRIAR",
        N_GRID + "".join(f"CQUAD4,{n},1,{a},{b},{c},{d}\n" for n, (a, b, c, d) in enumerate(QUADS, 1)),
        Read(tri_groups={"pid_1": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _n(
        "cables CROD, CBAR, CBEAM, CONROD",
        N_SHEET + "CROD,31,7,1,2\nCONROD,32,2,3,1,0.5\n",
        Read(lines=2, line_groups={"pid_7": 1}, **PIDS),
    ),
    _n(
        "material angles and offsets",
        N_SHEET.replace("1       2       5       ", "1       2       5       30.     0.1     "),
        Read(notes=("the material angle of 1", "the offset of 1"), **PIDS),
    ),
    _n(
        "loads, supports, rigid links",
        N_SHEET + "SPC,1,1,123\nRBE2,50,1,123,2\n",
        Read(notes=("SPC (1, first on line 18), RBE2 (1, first on line 19)",), **PIDS),
    ),
    _n("INCLUDE of a file beside it", "INCLUDE 'g.inc'\n" + N_TRIANGLES, Read(**PIDS), g=N_GRID),
    _n("INCLUDE from outside its folder", "INCLUDE '../g.inc'\n", "line 1: the included file '../g.inc' lies outside"),
    _n(
        "second-order elements",
        N_SHEET + "CTRIA6,9,1,1,2,3,4,5,6\n",
        "line 18: CTRIA6: second-order elements are not read",
    ),
    _n("solids", N_SHEET + "CTETRA,9,1,1,2,3,4\n", "line 18: CTETRA: solid elements are no membrane"),
    _n("other elements", N_SHEET + "CELAS1,9,1,1,1,2,1\n", "line 18: the card 'CELAS1' is not one that is read"),
    _n(
        "fields that repeat the card before",
        N_SHEET + "GRID,20,,0.,0.,5.\n=,*(1),=,=,=,*(1.)\n=(3)\n",
        "line 19: fields that repeat or count on",
    ),
    _n(
        "points that are not defined",
        N_SHEET.replace("9       8       \n", "77      8       \n"),
        "line 17: CTRIA3 8 uses grid point 77, which is not defined",
    ),
    _n("superelements", "BEGIN BULK\n" + N_SHEET + "BEGIN SUPER=1\n", "line 19: a second BEGIN BULK"),
    _n(
        "thickness at the corners",
        N_SHEET.replace("CTRIA3  8       20      5       9       8       ", "CTRIA3,8,20,5,9,8,,,\n,,,0.1,0.2,0.3"),
        Read(notes=("the thickness at the corners of 1 elements",), **PIDS),
    ),
    _n(
        "constraints of grid points",
        N_SHEET.replace("GRID    9               2.0000  2.0000  0.0000", "GRID,9,,2.,2.,0.,,123"),
        Read(notes=("the constraints (PS) of 1 grid point",), **PIDS),
    ),
    _n(
        "sets of the case control",
        "CEND\nSET 1 = 1 THRU 5\nBEGIN BULK\n" + N_SHEET,
        Read(notes=("SET of the case control (1, first on line 2)",), **PIDS),
    ),
    _n(
        "elements that name no property",
        N_SHEET.replace("10      ", "        ").replace("20      ", "        ") + "PSHELL,8,3\n",
        Read(tri_groups={"pid_8": 1, "mid_3": 1}),
    ),
    _n("SPC1", N_SHEET + "SPC1,1,123,1,THRU,3\n", Read(notes=("SPC1 (1, first on line 18)",), **PIDS)),
]
