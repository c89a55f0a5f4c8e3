"""Abaqus input files: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read, rows

A_NODES = "*NODE\n" + rows(NODES)
A_LOWER, A_UPPER = rows(TRIANGLES[:4]), rows(TRIANGLES[4:], 5)
A_SHEET = A_NODES + "*ELEMENT, TYPE=S3, ELSET=bag\n" + A_LOWER + A_UPPER
A_PART = "*Part, name=sheet\n" + A_SHEET + "*Nset, nset=left\n1, 4, 7\n*End Part\n*Assembly, name=A\n"
A_TWO = (
    A_PART
    + "*Instance, name=one, part=sheet\n0, 0, 5\n*End Instance\n*Instance, name=two, part=sheet\n0, 0, 7\n"
    + "0, 0, 0, 0, 0, 1, 90\n*End Instance\n"
)
BAG = {"tri_groups": {"bag": 8}}


def _a(feature: str, content: str, verdict: Read | str, **others: str) -> Case:
    return Case(
        "Abaqus .inp", feature, "a.inp", content, verdict, {f"{name}.inc": text for name, text in others.items()}
    )


ABAQUS = [
    _a("triangles S3, S3R, STRI3, M3D3, CPS3, CPE3", A_SHEET.replace("S3", "M3D3"), Read(**BAG)),
    _a(
        "small letters, tabs and blanks",
        A_SHEET.lower().replace(", type", "\t,  Type ").replace("=", " = "),
        Read(**BAG),
    ),
    _a("line ends of Windows", A_SHEET.replace("\n", "\r\n"), Read(**BAG)),
    _a(
        "comments, empty lines, a heading of any text",
        "*HEADING\nnode 1, 2\n** x\n\n" + A_SHEET.replace("*ELEM", "**\n*ELEM"),
        Read(**BAG),
    ),
    _a("a keyword that goes on after a comma", A_SHEET.replace("S3, ELSET", "S3,\n  ELSET"), Read(**BAG)),
    _a("an element that goes on after a comma", A_SHEET.replace("1, 1, 2, 5\n", "1, 1, 2,\n5\n"), Read(**BAG)),
    _a(
        "ELSET of a block",
        A_NODES + "*ELEMENT, TYPE=S3\n" + A_LOWER + "*ELEMENT, TYPE=S3, ELSET=top\n" + A_UPPER,
        Read(tri_groups={"top": 4}),
    ),
    _a(
        "ELSET named on several blocks",
        A_SHEET.replace("5, 4, 5, 8", "*ELEMENT, TYPE=S3, ELSET=patch\n5, 4, 5, 8\n*ELEMENT, TYPE=S3, ELSET=BAG"),
        Read(tri_groups={"bag": 7, "patch": 1}),
    ),
    _a(
        "ELSET and NSET with GENERATE, before what they name",
        "*ELSET, ELSET=all8, GENERATE\n1, 8, 1\n*NSET, NSET=right, GENERATE\n3, 9, 3\n" + A_SHEET,
        Read(tri_groups={"all8": 8, "bag": 8}, node_groups={"right": 3}),
    ),
    _a(
        "GENERATE over numbers that are missing",
        A_SHEET + "*NSET, NSET=odd, GENERATE\n1, 1000000001, 2\n",
        Read(node_groups={"odd": 5}, **BAG),
    ),
    _a(
        "sets of sets, in any order",
        A_SHEET + "*NSET, NSET=both\nleft, right\n*NSET, NSET=left\n1, 4, 7\n*NSET, NSET=right\n3,6\n9,\n",
        Read(node_groups={"left": 3, "right": 3, "both": 6}, **BAG),
    ),
    _a("sets that grow", A_SHEET + "*NSET, NSET=rim\n1, 2\n*NSET, NSET=Rim\n3\n", Read(node_groups={"rim": 3}, **BAG)),
    _a("nodes of an element set", A_SHEET + "*NSET, NSET=of, ELSET=bag\n", Read(node_groups={"of": 9}, **BAG)),
    _a("NSET of a node block", A_SHEET.replace("*NODE", "*NODE, NSET=every"), Read(node_groups={"every": 9}, **BAG)),
    _a("names in quotation marks", A_SHEET.replace("=bag", '="my, bag"'), Read(tri_groups={"my, bag": 8})),
    _a(
        "a set of a reference point",
        A_SHEET + "*NODE\n99, 1, 1, 5\n*NSET, NSET=RP\n99\n",
        Read(loose_groups={"RP": 1}, notes=("'RP' holds only 1 point",), **BAG),
    ),
    _a(
        "cables T3D2, B31, with nodes of their own",
        A_SHEET + "*NODE\n20, 9, 9, -3\n*ELEMENT, TYPE=T3D2, ELSET=guy\n9, 9, 20\n",
        Read(lines=1, line_groups={"guy": 1}, loose_groups={"guy": 1}, **BAG),
    ),
    _a(
        "quadrilaterals S4, S4R, M3D4, CPS4",
        A_NODES + "*ELEMENT, TYPE=S4R, ELSET=q\n" + rows(QUADS),
        Read(tri_groups={"q": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _a(
        "quadrilaterals with a repeated corner",
        A_NODES + "*ELEMENT, TYPE=S4, ELSET=q\n" + rows([(a, b, c, c) for a, b, c in TRIANGLES]),
        Read(tri_groups={"q": 8}, notes=("8 quadrilaterals with a repeated corner",)),
    ),
    _a(
        "one part, two instances, shifted and turned",
        A_TWO
        + "*Nset, nset=held, instance=two\nleft\n*Elset, elset=some, instance=one, generate\n1, 3\n*End Assembly\n",
        Read(
            triangles=16,
            area=8,
            nodes=18,
            tri_groups={"one": 8, "two": 8, "one.bag": 8, "two.bag": 8, "some": 3},
            node_groups={"held": 3, "one.left": 3, "two.left": 3},
        ),
    ),
    _a(
        "nodes of instances in sets and elements of the assembly",
        A_TWO + "*Nset, nset=n\none.1, two.9\n*Element, type=T3D2, elset=tie\n1, one.1, two.1\n*End Assembly\n",
        Read(
            triangles=16,
            area=8,
            nodes=18,
            lines=1,
            tri_groups={"one": 8, "two": 8, "one.bag": 8, "two.bag": 8},
            line_groups={"tie": 1},
            node_groups={"n": 2},
        ),
    ),
    _a(
        "a mesh inside its instance",
        "*Part, name=p\n*End Part\n*Assembly, name=A\n*Instance, name=i, part=p\n"
        + A_SHEET
        + "*End Instance\n*End Assembly\n",
        Read(**BAG),
    ),
    _a(
        "several parts, each with its numbers",
        A_PART.replace("*Assembly, name=A\n", "")
        + A_PART.replace("=sheet", "=other")
        + "*Instance, name=i, part=sheet\n*End Instance\n*Instance, name=j, part=other\n10, 0, 0\n*End Instance\n*End Assembly\n",
        Read(triangles=16, area=8, nodes=18, tri_groups={"i": 8, "j": 8, "i.bag": 8, "j.bag": 8}),
    ),
    _a(
        "several parts without instances",
        A_PART.replace("*Assembly, name=A\n", "") + A_PART.replace("=sheet", "=other"),
        r"2 parts \('sheet', 'other'\) and no instances",
    ),
    _a("one part without an instance", A_PART, Read(notes=("has no instance",), **BAG)),
    _a(
        "INCLUDE of a file beside it", "*INCLUDE, INPUT=n.inc\n" + A_SHEET.removeprefix(A_NODES), Read(**BAG), n=A_NODES
    ),
    _a(
        "nodes in a file of their own",
        "*NODE, INPUT=n.inc\n" + A_SHEET.removeprefix(A_NODES),
        Read(**BAG),
        n=rows(NODES),
    ),
    _a(
        "INCLUDE from outside its folder",
        "*INCLUDE, INPUT=../n.inc\n",
        r"line 1: the included file '../n.inc' lies outside",
    ),
    _a("INCLUDE of itself", "*INCLUDE, INPUT=a.inp\n", r"line 1: the included file 'a.inp' includes itself"),
    _a(
        "nodes in cylinders, SYSTEM=C",
        "*NODE, SYSTEM=C\n1, 1, 0, 0\n2, 1, 90, 0\n3, 1, 90, 2\n*ELEMENT, TYPE=S3\n1, 1, 2, 3\n",
        Read(triangles=1, nodes=3, area=2**0.5),
    ),
    _a("*SYSTEM", "*SYSTEM\n5, 5, 5, 5, 5, 6\n5, 6, 5\n" + A_SHEET, Read(**BAG)),
    _a(
        "sections, materials, steps",
        A_SHEET + "*MEMBRANE SECTION, ELSET=bag, MATERIAL=m\n0.1\n*MATERIAL, NAME=m\n*STEP\n*STATIC\n*END STEP\n",
        Read(notes=("*MEMBRANESECTION (1, first on line 20)",), **BAG),
    ),
    _a(
        "second-order elements",
        A_SHEET + "*ELEMENT, TYPE=STRI65\n9, 1,2,3,4,5,6\n",
        r"line 20: element type 'STRI65': second-order elements are not read",
    ),
    _a(
        "solids and other elements",
        A_SHEET + "*ELEMENT, TYPE=C3D8R\n",
        r"line 20: element type 'C3D8R' is not one that is read",
    ),
    _a(
        "keywords that make nodes or elements",
        A_SHEET + "*NGEN\n1, 9\n",
        r"line 20: \*NGEN is not read: write the nodes out",
    ),
    _a(
        "nodes that are not defined",
        A_SHEET.replace("8, 5, 9, 8", "8, 5, 77, 8"),
        r"line 19: an element uses node 77, which is not defined",
    ),
    _a(
        "sets of what is not defined",
        A_SHEET + "*NSET, NSET=x\n1, 77\n",
        r"line 21: the node set 'x' names node 77, which is not defined",
    ),
    _a(
        "sets that hold themselves",
        A_SHEET + "*NSET, NSET=x\ny\n*NSET, NSET=y\nx\n",
        r"line 20: the node set 'x' holds itself",
    ),
    _a("numbers given twice", A_SHEET + "*NODE\n1, 5, 5, 5\n", r"line 21: node 1 is at another place than on line 2"),
    _a(
        "parameters cut short",
        A_SHEET + "*NSET, NSET=every, GEN\n1, 9, 1\n",
        Read(node_groups={"every": 9}, **BAG),
    ),
    _a(
        "parameters that are not read",
        A_SHEET.replace("TYPE=S3", "TYPE=S3, OFFSET=100"),
        r"line 11: \*ELEMENT: the parameter 'OFFSET' is not read; allowed: TYPE, ELSET, INPUT",
    ),
    _a(
        "nodes of an instance's element set",
        A_TWO + "*NSET, NSET=a, ELSET=one.bag\n*NSET, NSET=b, ELSET=bag, INSTANCE=two\n*END ASSEMBLY\n",
        Read(
            triangles=16,
            nodes=18,
            area=8.0,
            tri_groups={"one": 8, "two": 8, "one.bag": 8, "two.bag": 8},
            node_groups={"a": 9, "b": 9, "one.left": 3, "two.left": 3},
        ),
    ),
    _a(
        "an element set with an instance's name",
        A_TWO + "*ELSET, ELSET=two, INSTANCE=one, INTERNAL\n1, 2\n*END ASSEMBLY\n",
        Read(
            triangles=16,
            nodes=18,
            area=8.0,
            tri_groups={"one": 8, "two": 2, "one.bag": 8, "two.bag": 8},
            notes=("the instance 'two' gives no group: an element set of the assembly has its name",),
        ),
    ),
    _a(
        "a keyword without its comma",
        A_SHEET.replace("*ELEMENT,", "*ELEMENT"),
        r"line 11: a comma is missing between keyword and parameter: '\*ELEMENT TYPE=S3'",
    ),
]
