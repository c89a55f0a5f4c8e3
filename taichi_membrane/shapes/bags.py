"""Bags: airbags sewn of two flat sheets, and tubes that lie on the ground."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_count, check_length, check_multiple, check_name, check_size
from taichi_membrane.shapes.grid import cushion, panel
from taichi_membrane.shapes.patchwork import Ints, Patchwork, quads, zip_rows
from taichi_membrane.shapes.rings import Ring, ring_directions
from taichi_membrane.shapes.round import cap_of, disc

Outline = Literal["square", "disc"]
Part = Literal["whole", "quarter"]
TubeEnds = Literal["open", "flat", "hemisphere"]


def airbag(*, outline: Outline, size: float, divisions: int, part: Part = "whole") -> Mesh:
    """Two flat sheets in z = 0 about the origin, sewn to each other along their rim; or a quarter of the upper one.

    :param outline: ``square`` or ``disc``.
    :param size: side of the square, or diameter of the disc [length].
    :param divisions: elements from the middle to the rim, at least 2.
    :param part: ``whole``, or the quarter x, y >= 0 of the upper sheet, for three planes of symmetry.
    :return: node group ``seam`` (the rim); of a whole bag ``centre_top``, ``centre_bottom`` and the element groups ``top`` (normal
        +z) and ``bottom`` (normal -z); of a quarter ``centre``, ``mirror_x`` (on x = 0), ``mirror_y`` (on y = 0), ``end_x`` and
        ``end_y`` (the nodes of the seam on the x and the y axis). A square has ``corners``. Warp runs along x.
    """
    check_name("airbag", "outline", outline, get_args(Outline))
    check_length("airbag", "size", size)
    check_count("airbag", "divisions", divisions, 2)
    check_name("airbag", "part", part, get_args(Part))
    check_size("airbag", 16 * divisions**2)
    if outline == "square":
        if part == "whole":
            return cushion(width=size, height=size, along_x=2 * divisions, along_y=2 * divisions)
        return _square_quarter(0.5 * size, divisions)
    return _disc_pair(0.5 * size, divisions) if part == "whole" else _disc_quarter(0.5 * size, divisions)


def _square_quarter(half: float, divisions: int) -> Mesh:
    sheet = panel(width=half, height=half, along_x=divisions, along_y=divisions, pattern="alternating")
    nodes = sheet.node_groups
    groups = {
        "seam": np.union1d(nodes["x_max"], nodes["y_max"]),
        "centre": nodes["corner_00"],
        "corners": nodes["corner_11"],
        "mirror_x": nodes["x_min"],
        "mirror_y": nodes["y_min"],
        "end_x": nodes["corner_10"],
        "end_y": nodes["corner_01"],
    }
    return Mesh.build(sheet.points, sheet.triangles, groups, None, sheet.tri_warp, where="airbag")


def _disc_pair(radius: float, rings: int) -> Mesh:
    sheet = disc(radius=radius, rings=rings)
    work = Patchwork()
    upper = work.nodes(sheet.points)
    rim = sheet.node_groups["rim"]
    inner = np.setdiff1d(upper, rim)
    lower = upper.copy()
    lower[inner] = work.nodes(sheet.points[inner])
    work.piece(upper[sheet.triangles], ("top",), [1.0, 0.0, 0.0])
    work.piece(lower[sheet.triangles[:, ::-1]], ("bottom",), [1.0, 0.0, 0.0])
    centre = sheet.node_groups["centre"]
    work.node_groups |= {"seam": rim.astype(np.int64), "centre_top": upper[centre], "centre_bottom": lower[centre]}
    return work.mesh("airbag")


def _disc_quarter(radius: float, rings: int) -> Mesh:
    """Rows of 1, 3, 5, … nodes on quarters of circles."""
    work = Patchwork()
    rows: list[Ints] = []
    for ring in range(rings + 1):
        cosine, sine = (part[: 2 * ring + 1] for part in ring_directions(Ring(max(8 * ring, 1))))
        distance = radius * ring / rings
        rows.append(work.nodes(np.column_stack((distance * cosine, distance * sine, 0.0 * cosine))))
    triangles = np.concatenate([zip_rows(rows[k + 1], rows[k])[:, ::-1] for k in range(rings)])
    work.piece(_upwards(work, triangles), (), [1.0, 0.0, 0.0])
    work.node_groups |= {
        "seam": rows[-1],
        "centre": rows[0],
        "mirror_y": np.array([row[0] for row in rows]),
        "mirror_x": np.array([row[-1] for row in rows]),
        "end_x": rows[-1][:1],
        "end_y": rows[-1][-1:],
    }
    return work.mesh("airbag")


def _upwards(work: Patchwork, triangles: Ints) -> Ints:
    """Triangles of one orientation, turned over if their normals point down."""
    a, b, c = work.points[triangles[0]]
    return triangles if np.cross(b - a, c - a)[2] > 0.0 else triangles[:, ::-1]


def water_tube(*, radius: float, length: float, around: int, along: int, ends: TubeEnds = "open") -> Mesh:
    """Tube along x that lies on the plane z = 0, its middle above the origin, for a filling with a level.

    :param radius: radius of its round section [length]; it touches the plane along a line.
    :param length: length of its wall [length].
    :param around: elements round it, a multiple of 4; ``along`` from end to end. Its generators are straight.
    :param ends: ``open``, as a slice between planes of symmetry; ``flat`` or ``hemisphere``, which close it.
    :return: node groups ``start`` (ring at -x), ``end``, ``base`` (the lowest line), ``crown`` (the highest one); for
        even ``along`` ``middle`` (ring at x = 0), ``middle_base``, ``middle_crown``, ``middle_left`` (towards +y) and
        ``middle_right``. Element groups ``tube`` and with ends ``caps``. Normals point outwards, warp runs along the tube, on caps
        to their middle.
    """
    check_length("water_tube", "radius", radius)
    check_length("water_tube", "length", length)
    check_multiple("water_tube", "around", around, 4, "so that there are lowest, highest and outermost lines")
    check_count("water_tube", "along", along, 1)
    check_name("water_tube", "ends", ends, get_args(TubeEnds))
    check_size("water_tube", 2 * around * (along + around))
    work = Patchwork()
    cosine, sine = ring_directions(Ring(around))
    x = length * (2 * np.arange(along + 1) - along) / (2 * along)
    ring = np.column_stack((-radius * sine, radius * (1.0 + cosine)))
    at = work.nodes(np.stack(np.broadcast_arrays(x[:, None], ring[:, 0], ring[:, 1]), axis=-1))
    work.piece(quads(np.column_stack((at, at[:, :1])).T, banded=True), ("tube",), [1.0, 0.0, 0.0])
    work.node_groups |= {"start": at[0], "end": at[-1], "crown": at[:, 0], "base": at[:, around // 2]}
    if along % 2 == 0:
        middle = at[along // 2]
        work.node_groups |= {"middle": middle, "middle_crown": middle[:1]}
        for name, quarter in (("middle_right", 1), ("middle_base", 2), ("middle_left", 3)):
            work.node_groups[name] = middle[quarter * around // 4, None]
    if ends != "open":
        for rim, way in ((at[0], -1), (at[-1], 1)):
            _close(work, rim, ends, radius, way)
    return work.mesh("water_tube")


def _close(work: Patchwork, rim: Ints, kind: str, radius: float, way: int) -> None:
    """Close an end of a water tube towards +x or -x."""
    places, triangles = cap_of(kind, radius, Ring(len(rim)), way)
    added = work.nodes(places + np.array([work.points[rim[0], 0], 0.0, radius]))
    corners = np.concatenate((rim, added))[triangles]
    work.piece(corners, ("caps",), work.points[added[-1]] - work.points[corners].mean(axis=1))
