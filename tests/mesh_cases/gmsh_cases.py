"""Gmsh meshes: the cases of the table."""

from __future__ import annotations

from mesh_cases.common import NODES, QUADS, TRIANGLES, Case, Read, rows

G_HEAD = "$MeshFormat\n{} 0 8\n$EndMeshFormat\n"
G_NAMES = '$PhysicalNames\n4\n1 5 "rim"\n2 1 "low"\n2 2 "high"\n0 9 "peg"\n$EndPhysicalNames\n'
G_NODES = "$Nodes\n9\n" + rows(NODES, separator=" ") + "$EndNodes\n"


def g_old(elements: list[tuple[int, ...]], names: str = G_NAMES, version: str = "2.2") -> str:
    """A file of format 2.2; elements are (type, number of tags, tags …, nodes …)."""
    return (
        G_HEAD.format(version)
        + names
        + G_NODES
        + f"$Elements\n{len(elements)}\n"
        + rows(elements, separator=" ")
        + "$EndElements\n"
    )


G_SHEET: list[tuple[int, ...]] = [(2, 2, 1 if n < 4 else 2, 7, *nodes) for n, nodes in enumerate(TRIANGLES)]
G_RIM: list[tuple[int, ...]] = [(1, 2, 5, 1, 1, 2), (1, 2, 5, 1, 2, 3)]
HALVES = {"low": 4, "high": 4}


def g_new(entities: str, blocks: list[tuple[int, int, int, list[tuple[int, ...]]]], names: str = G_NAMES) -> str:
    """A file of format 4.1; blocks are (dimension, entity, type, nodes of elements)."""
    count = sum(len(block[3]) for block in blocks)
    text = G_HEAD.format("4.1") + names + f"$Entities\n{entities}$EndEntities\n$Nodes\n1 9 1 9\n2 1 0 9\n"
    text += "".join(f"{n}\n" for n in range(1, 10)) + "".join(f"{x} {y} {z}\n" for x, y, z in NODES) + "$EndNodes\n"
    text += f"$Elements\n{len(blocks)} {count} 1 {count}\n"
    number = 1
    for dimension, entity, kind, elements in blocks:
        text += f"{dimension} {entity} {kind} {len(elements)}\n" + rows(elements, number, " ")
        number += len(elements)
    return text + "$EndElements\n"


G_ENTITIES = "0 1 2 0\n1 0 0 0 2 0 0 1 5 0\n1 0 0 0 2 1 0 1 1 0\n2 0 1 0 2 2 0 2 2 1 0\n"
G_BLOCKS: list[tuple[int, int, int, list[tuple[int, ...]]]] = [
    (1, 1, 1, [(1, 2), (2, 3)]),
    (2, 1, 2, TRIANGLES[:4]),
    (2, 2, 2, TRIANGLES[4:]),
]


def g_data(name: str, values: list[tuple[float, ...]]) -> str:
    """Data of elements; rows are (number of the element, its values)."""
    head = f'$ElementData\n1\n"{name}"\n1\n0.0\n3\n0\n{len(values[0]) - 1}\n{len(values)}\n'
    return head + "".join(" ".join(map(str, row)) + "\n" for row in values) + "$EndElementData\n"


def _g(feature: str, content: str, verdict: Read | str) -> Case:
    return Case("gmsh .msh", feature, "g.msh", content, verdict)


GMSH = [
    _g(
        "2.2: physical groups of surfaces, curves, points",
        g_old([*G_RIM, (15, 2, 9, 1, 5), *G_SHEET]),
        Read(lines=2, tri_groups=HALVES, line_groups={"rim": 2}, node_groups={"rim": 3, "peg": 1}),
    ),
    _g(
        "2.2: an element in several groups, written once for each",
        g_old([*G_SHEET, *((2, 2, 3, 7, *t) for t in TRIANGLES)], G_NAMES.replace("4\n1 5", '5\n2 3 "sheet"\n1 5')),
        Read(tri_groups={**HALVES, "sheet": 8}, notes=("'peg' (dimension 0, number 9) has no elements",)),
    ),
    _g(
        "2.2: a name that a curve and a surface share",
        g_old([*G_RIM, *G_SHEET], G_NAMES.replace("rim", "low")),
        Read(
            lines=2,
            tri_groups=HALVES,
            line_groups={"low": 2},
            node_groups={"low": 3},
            notes=("'low' names lines and triangles",),
        ),
    ),
    _g(
        "2.2: groups without names",
        g_old([*G_RIM, *G_SHEET], ""),
        Read(lines=2, tri_groups={"physical_1": 4, "physical_2": 4}, line_groups={"physical_5": 2}),
    ),
    _g(
        "2.2: one element twice in one group",
        g_old([*G_SHEET, G_SHEET[0]]),
        "elements 0 and 8 have the same three nodes",
    ),
    _g(
        "2.2: a row that has lost a node",
        g_old([*G_RIM, *G_SHEET], "").replace("5 2 2 1 7 2 3 6\n", "5 2 2 1 7 2 3\n"),
        "element 2 is defined twice, with other nodes",
    ),
    _g(
        "2.2: quadrilaterals",
        g_old([(3, 2, 1, 1, *quad) for quad in QUADS]),
        Read(tri_groups={"low": 8}, notes=("split 4 quadrilaterals",)),
    ),
    _g(
        "data of elements, numbers and vectors",
        g_old([*G_RIM, *G_SHEET])
        + g_data("t", [(n, 0.5) for n in range(3, 11)])
        + g_data("my fibre", [(n, 1, 0, 0) for n in range(1, 11)]),
        Read(
            lines=2,
            tri_groups=HALVES,
            line_groups={"rim": 2},
            node_groups={"rim": 3},
            tri_fields={"t": 1, "my fibre": 3},
            notes=("'peg' (dimension 0, number 9) has no elements",),
        ),
    ),
    _g(
        "data of an element that is not there",
        g_old(G_SHEET) + g_data("t", [(9, 0.5)]),
        "\\$ElementData 't' is of element 9, which is not defined",
    ),
    _g(
        "data without a name",
        g_old(G_SHEET) + "$ElementData\n0\n0\n3\n0 1 0\n$EndElementData\n",
        "a name, and the numbers of components \\(at most 9\\) and of elements are expected",
    ),
    _g(
        "4.1: groups by entities, an entity in several",
        g_new(G_ENTITIES, G_BLOCKS),
        Read(
            lines=2,
            tri_groups={"low": 8, "high": 4},
            line_groups={"rim": 2},
            node_groups={"rim": 3},
            notes=("'peg' (dimension 0, number 9) has no elements",),
        ),
    ),
    _g(
        "4.1: a group against the orientation of its surface",
        g_new(G_ENTITIES.replace("2 2 1 0", "1 -2 0"), G_BLOCKS),
        "run along their common edge",
    ),
    _g(
        "partial saves: nodes that no element uses",
        g_old(G_SHEET[:4]),
        Read(triangles=4, area=2, nodes=6, tri_groups={"low": 4}, notes=("left out 3 nodes",)),
    ),
    _g(
        "counts that do not agree",
        g_old(G_SHEET).replace("$Elements\n8", "$Elements\n7"),
        "8 numbers are left over at the section's end",
    ),
    _g(
        "second-order elements",
        g_old([*G_SHEET, (16, 2, 1, 1, 1, 2, 3, 4, 5, 6, 1, 2)]),
        "elements of gmsh's type 16 .*second-order elements are not read",
    ),
    _g(
        "solids",
        g_old([*G_SHEET, (4, 2, 1, 1, 1, 2, 3, 4)]),
        "the file holds tetrahedra: solid elements are no membrane",
    ),
    _g(
        "partitions of 4.1",
        g_new(G_ENTITIES, G_BLOCKS).replace("$Nodes", "$PartitionedEntities\n2\n$EndPartitionedEntities\n$Nodes"),
        "a partitioned mesh is not read",
    ),
    _g(
        "versions 1 and 4.0",
        g_old(G_SHEET, version="4.0"),
        "line 2: format '4.0' is not read; save as version 4.1 or 2.2",
    ),
    _g(
        "nodes that are not defined",
        g_old([*G_SHEET[:-1], (2, 2, 1, 1, 5, 9, 77)]),
        "a triangle uses node 77, which is not defined",
    ),
    _g(
        "4.1: groups that have a surface in both orientations",
        g_new(G_ENTITIES.replace("2 2 1 0", "2 2 -1 0"), G_BLOCKS),
        Read(
            lines=2,
            tri_groups={"low": 8, "high": 4},
            line_groups={"rim": 2},
            notes=("the physical groups 2, -1 of entity 2 have its elements in both orientations",),
        ),
    ),
    _g(
        "two physical groups of one name",
        g_old(G_SHEET, G_NAMES.replace('2 2 "high"', '2 2 "low"')),
        Read(
            tri_groups={"low": 8},
            notes=("several groups are named 'low': they are joined", "the physical group 'rim'"),
        ),
    ),
]
