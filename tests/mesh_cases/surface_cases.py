"""STL, OBJ, PLY, OFF: the cases of the table."""

from __future__ import annotations

import struct

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read


def s_text(name: str, triangles: list[tuple[int, int, int]]) -> str:
    """A solid of text STL."""
    text = f"solid {name}\n"
    for corners in triangles:
        at = "".join(f"      vertex {x} {y} {z}\n" for x, y, z in (NODES[k - 1] for k in corners))
        text += f"  facet normal 0 0 1\n    outer loop\n{at}    endloop\n  endfacet\n"
    return text + f"endsolid {name}\n"


def s_binary(triangles: list[tuple[int, int, int]], colour: int = 0) -> bytes:
    """Binary STL."""
    data = b"solid by some program".ljust(80) + struct.pack("<I", len(triangles))
    for corners in triangles:
        at = [value for k in corners for value in NODES[k - 1]]
        data += struct.pack("<12fH", 0.0, 0.0, 1.0, *at, colour)
    return data


def _s(feature: str, content: str | bytes, verdict: Read | str) -> Case:
    return Case("STL .stl", feature, "s.stl", content, verdict)


S_SHEET = s_text("", TRIANGLES)
STL = [
    _s("text; corners at one place are one node", S_SHEET, Read()),
    _s(
        "several solids, one group each",
        s_text("low part", TRIANGLES[:4]) + s_text("high", TRIANGLES[4:]),
        Read(tri_groups={"low part": 4, "high": 4}),
    ),
    _s(
        "solids of one name, or of none",
        s_text("a", TRIANGLES[:2]) + s_text("a", TRIANGLES[2:4]) + s_text("", TRIANGLES[4:]),
        Read(tri_groups={"a": 2, "a_2": 2, "solid_3": 4}),
    ),
    _s("capitals, tabs, lines of Windows", S_SHEET.upper().replace("\n", "\r\n").replace("   ", "\t"), Read()),
    _s("binary, also with a header that begins with solid", s_binary(TRIANGLES), Read()),
    _s(
        "binary: attributes such as colours",
        s_binary(TRIANGLES, 31),
        Read(notes=("the attribute (such as a colour) of 8 facets",)),
    ),
    _s(
        "stored normals that contradict the corners",
        S_SHEET.replace("0 0 1\n    outer", "0 0 -1\n    outer", 1),
        Read(notes=("the stored normal of 1 of 8 facets contradicts",)),
    ),
    _s("a file that is cut off", S_SHEET[:-60], "the file ends in the middle of a facet: it is cut off|line"),
    _s(
        "binary: a count that does not fit the size",
        s_binary(TRIANGLES)[:-50],
        "8 facets are announced, which takes 484 bytes, and the file has 434",
    ),
    _s(
        "a facet of four corners",
        S_SHEET.replace("    endloop", "      vertex 0 1 0\n    endloop", 1),
        "line 8: the facet has 4 vertices",
    ),
    _s(
        "normals that are no numbers",
        S_SHEET.replace("0 0 1\n    outer", "-nan(ind) -nan(ind) -nan(ind)\n    outer"),
        Read(),
    ),
    _s(
        "facets without area",
        S_SHEET.replace("vertex 1 1 0", "vertex 2 0 0", 1),
        r"element 0 .* is degenerate: .* In the file: facet 0 \(line 2\)",
    ),
    _s(
        "zeros with a minus",
        S_SHEET.replace("vertex 0 ", "vertex -0 ", 1).replace("vertex 1 0 0", "vertex 1 -0.0 0", 1),
        Read(),
    ),
    _s("stored normals that are only inexact", S_SHEET.replace("normal 0 0 1", "normal 0.866 0 0.5"), Read()),
]


O_NODES = "".join(f"v {x} {y} {z}\n" for x, y, z in NODES)
O_SHEET = O_NODES + "".join(f"f {a} {b} {c}\n" for a, b, c in TRIANGLES)


def _o(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("OBJ .obj", feature, "o.obj", content, verdict)


OBJ = [
    _o("triangles", O_SHEET, Read()),
    _o("negative numbers", O_NODES + "".join(f"f {a - 10} {b - 10} {c - 10}\n" for a, b, c in TRIANGLES), Read()),
    _o("texture and normals of corners", O_SHEET.replace("f 1 2 5", "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1 5//1"), Read()),
    _o(
        "groups, objects, materials",
        O_SHEET.replace("f 1 2 5", "o thing\ng low half\nusemtl pvc\nf 1 2 5").replace(
            "f 4 5 8", "g high\nusemtl pes\nf 4 5 8"
        ),
        Read(tri_groups={"thing": 8, "low": 4, "half": 4, "high": 4, "pvc": 4, "pes": 4}),
    ),
    _o(
        "one name for a group and a material with other faces",
        O_SHEET.replace("f 1 2 5", "g bag\nf 1 2 5\nusemtl bag"),
        Read(tri_groups={"group_bag": 8, "material_bag": 7}),
    ),
    _o(
        "quadrilaterals",
        O_NODES + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in QUADS),
        Read(notes=("split 4 quadrilaterals",)),
    ),
    _o(
        "lines and points",
        O_SHEET + "g guy\nl 1 2 3\ng peg\np 9\n",
        Read(lines=2, line_groups={"guy": 2}, node_groups={"guy": 3, "peg": 1}),
    ),
    _o(
        "colours of vertices",
        O_SHEET.replace("v 0 0 0\n", "v 0 0 0 1 0.5 0.5\n"),
        Read(notes=("the colour of 1 vertex",)),
    ),
    _o("a line that goes on", O_SHEET.replace("f 1 2 5", "f 1 2 \\\n5"), Read()),
    _o("faces of more corners", O_NODES + "f 1 2 3 6 9\n", "line 10: a face has 5 corners, 3 or 4 are read"),
    _o(
        "curves and surfaces",
        O_SHEET + "cstype bezier\n",
        "line 18: cstype: curves, surfaces and commands are not read",
    ),
    _o(
        "vertices that there are not", O_SHEET + "f 1 2 10\n", "line 18: vertex 10 is used, and the file has 9 vertices"
    ),
    _o(
        "number signs inside names",
        O_SHEET.replace("f 1 2 5", "usemtl pvc#1 # low\nf 1 2 5").replace("f 4 5 8", "usemtl pvc#2\nf 4 5 8"),
        Read(tri_groups={"pvc#1": 4, "pvc#2": 4}),
    ),
]


P_HEAD = "ply\nformat {} 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\n"
P_FACES = "element face 8\nproperty list uchar int {}\nend_header\n"
P_BODY = "".join(f"{x} {y} {z}\n" for x, y, z in NODES) + "".join(
    f"3 {a - 1} {b - 1} {c - 1}\n" for a, b, c in TRIANGLES
)
P_SHEET = P_HEAD.format("ascii") + P_FACES.format("vertex_indices") + P_BODY


def p_binary(order: str) -> bytes:
    """Binary PLY of either byte order."""
    name = "binary_little_endian" if order == "<" else "binary_big_endian"
    data = (P_HEAD.format(name) + P_FACES.format("vertex_index")).encode()
    data += b"".join(struct.pack(f"{order}3f", *at) for at in NODES)
    return data + b"".join(struct.pack(f"{order}B3i", 3, a - 1, b - 1, c - 1) for a, b, c in TRIANGLES)


def _p(feature: str, content: str | bytes, verdict: Read | str) -> Case:
    return Case("PLY .ply", feature, "p.ply", content, verdict)


# The first two triangles as one quadrilateral, last, so that a row of the first one's length does not fit it.
P_MIXED = p_binary("<").replace(b"face 8", b"face 7")
P_MIXED = P_MIXED[: -8 * 13] + P_MIXED[-4 * 13 :] + P_MIXED[-6 * 13 : -4 * 13] + struct.pack("<B4i", 4, 0, 1, 4, 3)


PLY = [
    _p("text; vertex_indices or vertex_index", P_SHEET.replace("indices", "index"), Read()),
    _p("binary, low byte first", p_binary("<"), Read()),
    _p("binary, triangles and quadrilaterals mixed", P_MIXED, Read(notes=("split 1 quadrilateral ",))),
    _p("binary, high byte first", p_binary(">"), Read()),
    _p(
        "whole numbers of faces as groups",
        P_SHEET.replace("end_header", "property int part\nend_header")
        .replace("\n3 ", "\n3 ")
        .replace("0 1 4\n", "0 1 4 7\n")
        .replace("3 0 4 3\n", "3 0 4 3 7\n")
        .replace("3 1 2 5\n", "3 1 2 5 7\n")
        .replace("3 1 5 4\n", "3 1 5 4 7\n")
        .replace("3 3 4 7\n", "3 3 4 7 8\n")
        .replace("3 3 7 6\n", "3 3 7 6 8\n")
        .replace("3 4 5 8\n", "3 4 5 8 8\n")
        .replace("3 4 8 7\n", "3 4 8 7 8\n"),
        Read(tri_groups={"part_7": 4, "part_8": 4}),
    ),
    _p(
        "edges",
        P_SHEET.replace("end_header", "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header")
        + "0 1\n",
        Read(lines=1),
    ),
    _p("faces of more corners", P_SHEET.replace("3 0 1 4\n", "5 0 1 2 5 4\n"), "face 0 has 5 corners, 3 or 4 are read"),
    _p(
        "triangle strips",
        P_SHEET.replace("end_header", "element tristrips 1\nproperty list int int vertex_indices\nend_header")
        + "3 0 1 2\n",
        "triangle strips are not read",
    ),
    _p("counts that do not agree", P_SHEET + "3 0 1 4\n", "line 27: more lines follow than are announced"),
    _p("a file that is cut off", P_SHEET[:-8], "8 times face are announced, 7 are there: cut off"),
    _p(
        "normals and colours of vertices, texture of faces",
        P_HEAD.format("ascii").replace("property float x", "property uchar red\nproperty float x")
        + P_FACES.format("vertex_indices").replace("end_header", "property list uchar float texcoord\nend_header")
        + "".join(f"255 {x} {y} {z}\n" for x, y, z in NODES)
        + "".join(f"3 {a - 1} {b - 1} {c - 1} 2 0 0\n" for a, b, c in TRIANGLES),
        Read(notes=("'texcoord' of faces", "'red' of vertices")),
    ),
]


F_BODY = P_BODY


def _f(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("OFF .off", feature, "f.off", content, verdict)


OFF = [
    _f("counts on the next line, after tabs, with comments", "OFF # x\n\t9\t8 0\n# y\n" + F_BODY, Read()),
    _f("counts on the first line, two of them", "OFF 9 8\n" + F_BODY, Read()),
    _f("without the word", "9 8 0\n" + F_BODY, Read()),
    _f(
        "COFF: colours of vertices",
        "COFF\n9 8 0\n" + "".join(f"{x} {y} {z} 255 0 0 255\n" for x, y, z in NODES) + F_BODY[54:],
        Read(notes=("normals, colours or texture of the vertices",)),
    ),
    _f(
        "NOFF: normals",
        "NOFF\n9 8 0\n" + "".join(f"{x} {y} {z} 0 0 1\n" for x, y, z in NODES) + F_BODY[54:],
        Read(notes=("normals, colours",)),
    ),
    _f(
        "colours of faces",
        "OFF\n9 8 0\n" + F_BODY.replace("3 0 1 4\n", "3 0 1 4 255 0 0\n"),
        Read(notes=("the colour of 1 face",)),
    ),
    _f("other dimensions", "4OFF\n9 8 0\n", "line 1: 4OFF: points of other than three dimensions"),
    _f("binary", "OFF BINARY\n", "line 1: binary OFF is not read"),
    _f(
        "counts that do not agree",
        "OFF\n9 9 0\n" + F_BODY,
        "line 2: 9 vertices and 9 faces are announced, and 17 lines follow",
    ),
]
