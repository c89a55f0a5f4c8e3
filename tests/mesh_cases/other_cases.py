"""DXF drawings, and what holds for all formats: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read
from mesh_cases.gmsh_cases import HALVES
from mesh_cases.surface_cases import O_NODES, O_SHEET


def x_face(corners: tuple[int, ...], layer: str) -> str:
    """A 3DFACE of a drawing; a triangle repeats its last corner."""
    text = f"0\n3DFACE\n8\n{layer}\n"
    for k, corner in enumerate((*corners, corners[-1])[:4]):
        text += "".join(f"{axis + k}\n{value}\n" for axis, value in zip((10, 20, 30), NODES[corner - 1], strict=True))
    return text


def x_drawing(entities: str, blocks: str = "") -> str:
    """A drawing."""
    return f"0\nSECTION\n2\nBLOCKS\n{blocks}0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n"


X_FACES = "".join(x_face(t, "low" if n < 4 else "high") for n, t in enumerate(TRIANGLES))
X_LINE = "0\nLINE\n8\nguy\n10\n0\n20\n0\n30\n0\n11\n9\n21\n9\n31\n-3\n"
X_POLYFACE = "0\nPOLYLINE\n8\nskin\n70\n64\n" + "".join(
    f"0\nVERTEX\n70\n192\n10\n{x}\n20\n{y}\n30\n{z}\n" for x, y, z in NODES
)
X_POLYFACE += "".join(f"0\nVERTEX\n70\n128\n71\n{a}\n72\n-{b}\n73\n{c}\n" for a, b, c in TRIANGLES) + "0\nSEQEND\n"
X_GRID = (
    "0\nPOLYLINE\n8\nnet\n70\n16\n71\n3\n72\n3\n"
    + "".join(f"0\nVERTEX\n70\n64\n10\n{x}\n20\n{y}\n30\n{z}\n" for x, y, z in NODES)
    + "0\nSEQEND\n"
)


def _x(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("DXF .dxf", feature, "x.dxf", content, verdict)


DXF = [
    _x("3DFACE, layers as groups", x_drawing(X_FACES), Read(tri_groups=HALVES)),
    _x(
        "3DFACE of four corners",
        x_drawing("".join(x_face(q, "q") for q in QUADS)),
        Read(tri_groups={"q": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _x("polyface meshes", x_drawing(X_POLYFACE), Read(tri_groups={"skin": 8})),
    _x("polygon meshes", x_drawing(X_GRID), Read(tri_groups={"net": 8}, notes=("split 4 quadrilaterals",))),
    _x(
        "lines",
        x_drawing(X_FACES + X_LINE),
        Read(lines=1, line_groups={"guy": 1}, loose_groups={"guy": 1}, tri_groups=HALVES),
    ),
    _x("texts, circles", x_drawing(X_FACES + "0\nCIRCLE\n8\n0\n"), Read(tri_groups=HALVES, notes=("CIRCLE (1",))),
    _x(
        "blocks that are inserted",
        x_drawing(X_FACES + "0\nINSERT\n2\nB\n", "0\nBLOCK\n2\nB\n" + X_LINE),
        "the block 'B' is inserted: explode blocks",
    ),
    _x("solids, surfaces, MESH", x_drawing(X_FACES + "0\nMESH\n8\n0\n"), "MESH is not read: convert it to 3DFACE"),
    _x("binary", "AutoCAD Binary DXF\r\n", "binary DXF is not read"),
    _x("a drawing that is cut off", x_drawing(X_FACES)[:-7], "the drawing has no EOF: it is cut off"),
    _x(
        "the drawing's unit",
        x_drawing(X_FACES).replace(
            "0\nSECTION", "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION", 1
        ),
        Read(tri_groups=HALVES, notes=("the drawing's unit is the millimetre ($INSUNITS)",)),
    ),
    _x(
        "entities of paper space",
        x_drawing(X_FACES + x_face((1, 3, 7), "sheet").replace("8\nsheet", "67\n1\n8\nsheet")),
        Read(tri_groups=HALVES, notes=("1 entity of paper space",)),
    ),
    _x(
        "faces with a direction of extrusion",
        x_drawing(X_FACES.replace("8\nlow", "8\nlow\n230\n-1")),
        Read(tri_groups=HALVES),
    ),
    _x(
        "invisible entities",
        x_drawing(X_FACES + x_face((1, 3, 7), "x").replace("8\nx", "60\n1\n8\nx")),
        Read(tri_groups=HALVES, notes=("1 invisible entity",)),
    ),
    _x(
        "layers that are off or frozen",
        x_drawing(X_FACES).replace(
            "0\nSECTION", "0\nSECTION\n2\nTABLES\n0\nLAYER\n2\nlow\n70\n1\n0\nENDSEC\n0\nSECTION", 1
        ),
        Read(tri_groups=HALVES, notes=("layers that are off or frozen, read like others: low",)),
    ),
    _x(
        "polyface meshes whose faces lie in layers of their own",
        x_drawing(X_POLYFACE.replace("0\nVERTEX\n70\n128", "0\nVERTEX\n8\nlow\n70\n128", 4)),
        Read(tri_groups={"low": 4, "skin": 4}),
    ),
    _x(
        "blocks with solids",
        x_drawing(X_FACES + "0\nINSERT\n2\nB\n", "0\nBLOCK\n2\nB\n0\n3DSOLID\n"),
        "the block 'B' is inserted: explode blocks",
    ),
]


def cracked(name: str, gap: float, node: str = "v {} {} {}") -> str:
    """The sheet of an OBJ file in two pieces along y = 1, whose nodes lie ``gap`` apart."""
    text = O_NODES + "".join(node.format(x, 1, gap) + "\n" for x in range(3))
    text += "".join(f"f {a} {b} {c}\n" for a, b, c in TRIANGLES[:4])
    return text + "".join("f " + " ".join(str(k + 6 if 4 <= k <= 6 else k) for k in t) + "\n" for t in TRIANGLES[4:])


# Below y = 1 one edge from 4 to 5, above it two, with a node between.
T_JOINT = (
    O_NODES
    + "v 0.5 1 0\n"
    + "".join(f"f {a} {b} {c}\n" for a, b, c in TRIANGLES[:4])
    + "f 4 10 7\nf 10 8 7\nf 10 5 8\nf 5 6 9\nf 5 9 8\n"
)
ANY = [
    Case(
        "any",
        "free edges that lie on each other",
        "o.obj",
        cracked("o", 0.0),
        "2 pairs of free edges coincide or nearly do, .* largest gap 0, .*--repair",
    ),
    Case(
        "any",
        "free edges that nearly do, within the digits",
        "o.obj",
        cracked("o", 1e-6).replace("v 2 2 0", "v 2.123457 2 0"),
        r"largest gap 1e-06, tolerance 4e-06.*--repair \(in Python repair=True\) joins them",
    ),
    Case(
        "any",
        "free edges that nearly do, beyond the digits",
        "o.obj",
        cracked("o", 9e-4),
        r"largest gap 0.0009, .* join = 0.00090",
    ),
    Case(
        "any",
        "nodes on a free edge (T-joints)",
        "o.obj",
        T_JOINT,
        r"node 9 at \(0.5, 1, 0\) lies on the free edge of nodes \(3, 4\), 0 from it, and is not one .* 1 such nodes in all",
    ),
    Case("any", "triangles given twice", "o.obj", O_SHEET + "f 5 1 2\n", "elements 0 and 8 have the same three nodes"),
    Case(
        "any",
        "triangles without area",
        "o.obj",
        O_SHEET + "f 1 2 3\n",
        r"element 8 \(nodes \(0, 1, 2\)\) is degenerate.* In the file: triangle 8 \(line 18\)",
    ),
    Case(
        "any",
        "three triangles at an edge",
        "o.obj",
        O_SHEET + "v 1 1 5\nf 1 5 10\n",
        Read(triangles=9, area=4.0 + 12.5**0.5, nodes=10),
    ),
    Case(
        "any",
        "coordinates that are no numbers",
        "o.obj",
        O_SHEET.replace("v 2 2 0", "v nan 2 0"),
        "node 8 has coordinates .* that are not finite",
    ),
    Case(
        "any",
        "a group named all that holds a part",
        "o.obj",
        O_SHEET.replace("f 1 2 5", "g all\nf 1 2 5").replace("f 4 5 8", "g\nf 4 5 8"),
        Read(tri_groups={"all_of_file": 4}, notes=("the group named 'all' goes by the name 'all_of_file'",)),
    ),
    Case(
        "any",
        "groups named all and all_of_file",
        "o.obj",
        O_SHEET.replace("f 1 2 5", "g all\nf 1 2 5").replace("f 4 5 8", "g all_of_file\nf 4 5 8"),
        Read(
            tri_groups={"all_of_file": 4, "all_of_file_2": 4},
            notes=("the group named 'all' goes by the name 'all_of_file_2'",),
        ),
    ),
    Case(
        "any",
        "a quadrilateral with a corner that points inwards",
        "o.obj",
        "v 0 10 0\nv -2 -1 0\nv 0 0 0\nv 2 -1 0\nf 1 2 3 4\n",
        Read(triangles=2, nodes=4, area=20.0, notes=("of these 1 along the longer diagonal",)),
    ),
    Case(
        "any",
        "a quadrilateral with three corners on one line",
        "o.obj",
        "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 1 3 0\nf 1 2 3 4\n",
        Read(triangles=2, nodes=4, area=3.0, notes=("of these 1 along the longer diagonal",)),
    ),
    Case(
        "any",
        "a quadrilateral that crosses itself",
        "o.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3 4\n",
        r"quad 0 \(line 5\) is a quadrilateral that crosses itself, is folded or has no area; 1 such in all",
    ),
    Case("any", "extensions of the trade that are not read", "o.step", "ISO-10303-21;", "it holds no mesh: mesh it"),
    Case("any", "an unknown extension", "o.docx", O_SHEET, "the file extension '.docx' is unknown; allowed: .3dm, "),
    Case(
        "any",
        "letters of Latin-1 and a byte order mark",
        "o.obj",
        b"\xef\xbb\xbf" + O_SHEET.replace("f 1 2 5", "g H\xfclle\nf 1 2 5").encode("latin-1"),
        Read(tri_groups={"Hülle": 8}),
    ),
    Case(
        "any",
        "UTF-16",
        "o.obj",
        O_SHEET.replace("f 1 2 5", "g Hülle\nf 1 2 5").encode("utf-16"),
        Read(tri_groups={"Hülle": 8}),
    ),
]
