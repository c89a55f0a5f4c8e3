"""MEDIT, Kratos, LS-DYNA: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read, rows

M_SHEET = (
    "MeshVersionFormatted 2\nDimension\n3\nVertices\n9\n"
    + "".join(f"{x} {y} {z} {5 if x == 0 else 0}\n" for x, y, z in NODES)
    + "Edges\n1\n1 2 8\nTriangles\n8\n"
    + "".join(f"{a} {b} {c} {1 if n < 4 else 2}\n" for n, (a, b, c) in enumerate(TRIANGLES))
    + "End\n"
)


def _m(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("MEDIT .mesh", feature, "m.mesh", content, verdict)


MEDIT = [
    _m(
        "references of triangles, edges, vertices as groups",
        M_SHEET,
        Read(lines=1, tri_groups={"ref_1": 4, "ref_2": 4}, line_groups={"ref_8": 1}, node_groups={"ref_5": 3}),
    ),
    _m(
        "dimension 2",
        M_SHEET.replace("Dimension\n3", "Dimension 2").replace(" 0 0\n", " 0\n").replace(" 0 5\n", " 5\n"),
        Read(lines=1, line_groups={"ref_8": 1}, tri_groups={"ref_1": 4, "ref_2": 4}),
    ),
    _m(
        "corners, ridges, normals",
        M_SHEET.replace("End", "Corners\n2\n1 3\nRidges\n1\n1\nEnd"),
        Read(
            lines=1,
            tri_groups={"ref_1": 4, "ref_2": 4},
            line_groups={"ref_8": 1},
            notes=("Corners (2, line 28), Ridges (1, line 31)",),
        ),
    ),
    _m(
        "tetrahedra",
        M_SHEET.replace("End", "Tetrahedra\n1\n1 2 3 4 0\nEnd"),
        "line 28: Tetrahedra: solid elements are no membrane",
    ),
    _m(
        "counts that do not agree",
        M_SHEET.replace("Triangles\n8", "Triangles\n7"),
        "line 27: the keyword '5' is not one that is read",
    ),
    _m(
        "vertices that there are not",
        M_SHEET.replace("5 9 8 2", "5 10 8 2"),
        "a triangle uses vertex 10; the file has 9 vertices, from 1",
    ),
]


K_SHEET = (
    "Begin ModelPartData\nEnd ModelPartData\nBegin Properties 1\nTHICKNESS 0.1\nEnd Properties\nBegin Nodes // x\n"
    + rows(NODES, separator=" ")
    + "End Nodes\nBegin Elements MembraneElement3D3N\n"
    + "".join(f"{n} {1 if n < 5 else 2} {a} {b} {c}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1))
    + "End Elements\nBegin Elements CableElement3D2N\n20 3 1 2\nEnd Elements\n"
)
K_PART = (
    "Begin SubModelPart sail\nBegin SubModelPartNodes\n1\n2\nEnd SubModelPartNodes\n"
    "Begin SubModelPartElements\n1\n2\n3\nEnd SubModelPartElements\n"
    "Begin SubModelPart rim\nBegin SubModelPartNodes\n3\nEnd SubModelPartNodes\nEnd SubModelPart\nEnd SubModelPart\n"
)
PROPERTIES = {"properties_1": 4, "properties_2": 4}


def _k(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("Kratos .mdpa", feature, "k.mdpa", content, verdict)


KRATOS = [
    _k(
        "membranes, cables, properties as groups",
        K_SHEET,
        Read(lines=1, tri_groups=PROPERTIES, line_groups={"properties_3": 1}),
    ),
    _k(
        "sub model parts, also inside each other",
        K_SHEET + K_PART,
        Read(
            lines=1,
            line_groups={"properties_3": 1},
            tri_groups={"sail": 3, **PROPERTIES},
            node_groups={"sail": 2, "sail.rim": 1},
            notes=("'sail' names points and triangles",),
        ),
    ),
    _k(
        "conditions, data of nodes",
        K_SHEET + "Begin Conditions SurfaceCondition3D3N\n1 0 1 2 5\nEnd Conditions\n",
        Read(
            lines=1, tri_groups=PROPERTIES, line_groups={"properties_3": 1}, notes=("Conditions SurfaceCondition3D3N",)
        ),
    ),
    _k(
        "solids",
        K_SHEET.replace("MembraneElement3D3N", "SmallDisplacementElement3D4N"),
        "line 18: SmallDisplacementElement3D4N 1 has 5 numbers",
    ),
    _k("blocks that do not end", K_SHEET[:-13], "the block Elements has no end: the file is cut off"),
    _k(
        "nodes that are not defined",
        K_SHEET.replace("8 2 5 9 8", "8 2 5 77 8"),
        "line 25: element 8 uses node 77, which is not defined",
    ),
    _k(
        "quadrilaterals in a plane",
        K_SHEET[: K_SHEET.index("Begin Elements")]
        + "Begin Elements Element2D4N\n"
        + "".join(f"{n} 1 {a} {b} {c} {d}\n" for n, (a, b, c, d) in enumerate(QUADS, 1))
        + "End Elements\n",
        Read(tri_groups={"properties_1": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _k(
        "conditions of sub model parts",
        K_SHEET
        + "Begin SubModelPart a\nBegin SubModelPartConditions\n1\nEnd SubModelPartConditions\nEnd SubModelPart\n",
        Read(
            lines=1, tri_groups=PROPERTIES, line_groups={"properties_3": 1}, notes=("SubModelPartConditions (line 31)",)
        ),
    ),
    _k(
        "geometries in place of elements",
        K_SHEET[: K_SHEET.index("Begin Elements")] + "Begin Geometries Triangle3D3\n1 1 2 5\nEnd Geometries\n",
        r"the file holds no triangles and no cells, and 9 nodes; not carried over: Geometries Triangle3D3 \(line 17\)",
    ),
]


D_NODES = "*KEYWORD\n*NODE\n" + "".join(f"{n:8d}{x:16.8f}{y:16.8f}{z:16.8f}\n" for n, (x, y, z) in enumerate(NODES, 1))
D_SHELLS = "*ELEMENT_SHELL\n" + "".join(
    f"{n:8d}{1 if n < 5 else 2:8d}{a:8d}{b:8d}{c:8d}{c:8d}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)
)
D_PARTS = "*PART\nbag\n" + f"{1:10d}{1:10d}{1:10d}\n" + "patch\n" + f"{2:10d}{1:10d}{1:10d}\n"
D_SHEET = D_NODES + D_SHELLS + D_PARTS + "*END\n"
PART = {"part_1": 4, "part_2": 4}
NAMED = {**PART, "bag": 4, "patch": 4}


def _d(feature: str, content: str, verdict: Read | str, **others: str) -> Case:
    return Case(
        "LS-DYNA .k .key .dyn", feature, "d.k", content, verdict, {f"{name}.inc": text for name, text in others.items()}
    )


DYNA = [
    _d("shells, parts and their titles as groups", D_SHEET, Read(tri_groups={**PART, "bag": 4, "patch": 4})),
    _d(
        "fields between commas, comments",
        "$ x\n" + D_SHEET.replace("       8       2       5       9       8       8", "8,2,5,9,8,8"),
        Read(tri_groups=NAMED),
    ),
    _d(
        "quadrilaterals",
        D_NODES + "*ELEMENT_SHELL\n" + "".join(f"{n},1,{a},{b},{c},{d}\n" for n, (a, b, c, d) in enumerate(QUADS, 1)),
        Read(tri_groups={"part_1": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _d(
        "thickness of shells",
        D_NODES
        + "*ELEMENT_SHELL_THICKNESS\n"
        + "".join(f"{n},1,{a},{b},{c},{c}\n0.1,0.1,0.1\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)),
        Read(tri_groups={"part_1": 8}, notes=("thickness, angle or offset of 8 shells",)),
    ),
    _d(
        "beams and belts",
        D_SHEET.replace("*PART", "*ELEMENT_BEAM\n      20       3       1       2       0\n*PART"),
        Read(lines=1, tri_groups=NAMED, line_groups={"part_3": 1}),
    ),
    _d(
        "sets of nodes, shells, parts",
        D_SHEET.replace(
            "*PART",
            "*SET_NODE_LIST_TITLE\nheld\n         7\n         1         2\n*SET_SHELL_LIST_GENERATE\n         8\n"
            "         2         4\n*SET_PART_LIST\n         9\n         1         2\n*PART",
        ),
        Read(tri_groups={"set_shell_8": 3, "set_part_9": 8, **NAMED}, node_groups={"held": 2}),
    ),
    _d("INCLUDE of a file beside it", "*KEYWORD\n*INCLUDE\nn.inc\n" + D_SHELLS, Read(tri_groups=PART), n=D_NODES),
    _d(
        "INCLUDE from outside its folder",
        "*KEYWORD\n*INCLUDE\n/etc/passwd\n",
        "line 3: the included file '/etc/passwd' lies outside",
    ),
    _d(
        "other keywords",
        D_SHEET.replace("*PART", "*MAT_FABRIC\n1\n*PART"),
        Read(tri_groups=NAMED, notes=(r"*MAT_FABRIC (1, first on line 21)",)),
    ),
    _d(
        "solids",
        D_SHEET.replace("*PART", "*ELEMENT_SOLID\n*PART"),
        r"line 21: \*ELEMENT_SOLID: solid elements are no membrane",
    ),
    _d(
        "parameters in place of numbers",
        D_SHEET.replace("       8       2       5", "       8      &p       5"),
        "line 20: a number of a shell is the parameter '&p'",
    ),
    _d(
        "nodes that are moved",
        D_SHEET.replace("*PART", "*NODE_TRANSFORM\n1,1\n*PART"),
        r"line 21: \*NODE_TRANSFORM is not read",
    ),
    _d(
        "nodes that are not defined",
        D_SHEET.replace("9       8       8\n", "77       8       8\n").replace("       577", "       5      77"),
        "line 20: shell 8 uses node 77|line 20",
    ),
    _d(
        "blank titles",
        D_SHEET.replace("*PART\nbag", "*PART\n"),
        Read(tri_groups={**PART, "patch": 4}),
    ),
    _d(
        "blank cards of thickness",
        D_NODES
        + "*ELEMENT_SHELL_THICKNESS\n"
        + "".join(f"{n},1,{a},{b},{c},{c}\n\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)),
        Read(tri_groups={"part_1": 8}, notes=("thickness, angle or offset of 8 shells",)),
    ),
    _d(
        "one title of several parts or sets",
        D_SHEET.replace("*END", "*SET_SHELL_LIST_TITLE\nbag\n7\n5\n*SET_SHELL_LIST_TITLE\nbag\n8\n6\n*END"),
        Read(
            tri_groups={"set_shell_7": 1, "set_shell_8": 1, "patch": 4, **PART},
            notes=("titles of several parts or sets, which go by their numbers alone: 'bag'",),
        ),
    ),
    _d(
        "sets of parts that add sets, or name parts",
        D_SHEET.replace(
            "*END", "*SET_PART\n1\n1\n*SET_PART\n2\n2\n*SET_PART_ADD\n3\n1,2\n*SET_PART_GENERAL\n4\nPART,2\n*END"
        ),
        Read(tri_groups={"set_part_1": 4, "set_part_2": 4, "set_part_3": 8, "set_part_4": 4, **NAMED}),
    ),
    _d(
        "parts with inertia",
        D_NODES
        + D_SHELLS
        + "*PART_INERTIA\nbag\n1,1,1\n0,0,0,1,1\n1,0,0,1,0,1\n0,0,0\n1,0,0\npatch\n2,1,1\n0,0,0,1,0\n1,0,0,1,0,1\n0,0,0\n",
        Read(tri_groups={"bag": 4, "patch": 4, **PART}),
    ),
    _d(
        "format I10",
        "*KEYWORD I10=Y\n*NODE\n"
        + "".join(f"{n:10d}{x:16.8f}{y:16.8f}{z:16.8f}\n" for n, (x, y, z) in enumerate(NODES, 1))
        + "*ELEMENT_SHELL\n"
        + "".join(f"{n:10d}{1:10d}{a:10d}{b:10d}{c:10d}{c:10d}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)),
        Read(tri_groups={"part_1": 8}),
    ),
    _d(
        "long format",
        "*KEYWORD LONG=Y\n*NODE\n"
        + "".join(f"{n:20d}{x:20.8f}{y:20.8f}{z:20.8f}\n" for n, (x, y, z) in enumerate(NODES, 1))
        + "*ELEMENT_SHELL\n"
        + "".join(f"{n:20d}{1:20d}{a:20d}{b:20d}{c:20d}{c:20d}\n" for n, (a, b, c) in enumerate(TRIANGLES, 1)),
        Read(tri_groups={"part_1": 8}),
    ),
    _d(
        "constraints of nodes",
        D_SHEET.replace(f"{2:16.8f}{2:16.8f}{0:16.8f}\n", f"{2:16.8f}{2:16.8f}{0:16.8f}{7:8d}{7:8d}\n"),
        Read(tri_groups=NAMED, notes=("the constraints of 1 node",)),
    ),
    _d(
        "files brought in and moved",
        D_SHEET.replace("*PART", "*INCLUDE_STAMPED_PART\nx.k\n*PART"),
        r"line 21: \*INCLUDE_STAMPED_PART is not read: only \*INCLUDE is",
    ),
    _d(
        "keywords in a format of their own: +, -, %",
        "*KEYWORD\n*NODE +\n"
        + "".join(f"{n:20d}{x:20.8f}{y:20.8f}{z:20.8f}\n" for n, (x, y, z) in enumerate(NODES, 1))
        + "*ELEMENT_SHELL%\n"
        + "".join(f"{n:10d}{1:10d}{a:10d}{b:10d}{c:10d}{c:10d}\n" for n, (a, b, c) in enumerate(TRIANGLES[:4], 1))
        + "*ELEMENT_SHELL -\n"
        + "".join(f"{n:8d}{2:8d}{a:8d}{b:8d}{c:8d}{c:8d}\n" for n, (a, b, c) in enumerate(TRIANGLES[4:], 5)),
        Read(tri_groups=PART),
    ),
]
