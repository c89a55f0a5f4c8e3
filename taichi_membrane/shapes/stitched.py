"""Drop-stitch panels: two skins that yarns hold at a distance."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.arguments import check_between, check_count, check_length, check_name, check_size
from taichi_membrane.shapes.patchwork import Floats, Ints, Patchwork, quads

Yarns = Literal["cables", "webs"]


def drop_stitch(
    *,
    width: float,
    length: float,
    height: float,
    along_x: int,
    along_y: int,
    up: int,
    every: int = 1,
    yarns: Yarns = "cables",
    bulge: float = 0.0,
) -> Mesh:
    """Rectangular panel about the z axis on z = 0: two flat skins, a wall round them, and yarns between: one closed chamber.

    :param width: size of the skins along x [length]; ``length`` along y; ``height`` their distance.
    :param along_x: elements of a skin along x, at least 2; ``along_y`` along y; ``up`` of the wall from skin to skin.
    :param every: a yarn, or web, at every so many nodes of a skin, counted from its middle.
    :param yarns: ``cables``: line elements from skin to skin; ``webs``: walls along y, sewn to both skins but for their ends.
    :param bulge: angle of the arc that the wall is cut to [degrees], 0 (flat) to 180 (half a circle).
    :return: element groups ``shell`` (the chamber: all but the webs, normals outwards), ``top``, ``bottom``, ``wall``; ``webs``.
        Group of line elements ``yarns``. Node groups ``rim_top``, ``rim_bottom``, ``x_min``, ``x_max``, ``y_min``, ``y_max`` (both
        rims' edges there), ``middle`` (both skins at y = 0, even ``along_y``), ``stitched`` (ends of yarns), ``centre_top``,
        ``centre_bottom`` (even divisions). Warp runs along y, round the wall in z.
    """
    _check_panel((width, length, height), (along_x, along_y, up), every, yarns, bulge)
    work = Patchwork()
    x, y = (size * (np.arange(n + 1) / n - 0.5) for size, n in ((width, along_x), (length, along_y)))
    skins = [
        work.nodes(np.stack((*np.meshgrid(x, y, indexing="ij"), np.full((len(x), len(y)), z)), axis=-1))
        for z in (0.0, height)
    ]
    bottom, top = skins
    work.piece(quads(top, banded=True), ("shell", "top"), [0.0, 1.0, 0.0])
    work.piece(quads(bottom, banded=True)[:, ::-1], ("shell", "bottom"), [0.0, 1.0, 0.0])
    rims = _loop(bottom), _loop(top)
    _add_wall(work, rims, height, up, math.radians(bulge))
    _add_yarns(work, skins, every, up, yarns)
    work.node_groups |= {
        "rim_bottom": rims[0],
        "rim_top": rims[1],
        "x_min": np.concatenate([skin[0] for skin in skins]),
        "x_max": np.concatenate([skin[-1] for skin in skins]),
        "y_min": np.concatenate([skin[:, 0] for skin in skins]),
        "y_max": np.concatenate([skin[:, -1] for skin in skins]),
    }
    if along_y % 2 == 0:
        work.node_groups["middle"] = np.concatenate([skin[:, along_y // 2] for skin in skins])
        if along_x % 2 == 0:
            work.node_groups["centre_top"] = top[along_x // 2, along_y // 2, None]
            work.node_groups["centre_bottom"] = bottom[along_x // 2, along_y // 2, None]
    return work.mesh("drop_stitch")


def _check_panel(
    sizes: tuple[float, float, float], parts: tuple[int, int, int], every: int, yarns: str, bulge: float
) -> None:
    for name, value in zip(("width", "length", "height"), sizes, strict=True):
        check_length("drop_stitch", name, value)
    along_x, along_y, up = parts
    for name, count, lowest in (("along_x", along_x, 2), ("along_y", along_y, 2), ("up", up, 1), ("every", every, 1)):
        check_count("drop_stitch", name, count, lowest)
    check_name("drop_stitch", "yarns", yarns, get_args(Yarns))
    check_between("drop_stitch", "bulge", bulge, 0.0, 180.0, "degrees")
    if bulge and up < 2:
        raise InputError(
            f"drop_stitch: bulge = {bulge:g} needs up = 2 at least, so that the wall has nodes to bulge; up = {up}"
        )
    check_size("drop_stitch", 4 * along_x * along_y + 2 * up * (2 * (along_x + along_y) + along_x * along_y // every))


def _loop(skin: Ints) -> Ints:
    """Nodes round a skin, counter-clockwise seen from above, each once."""
    return np.concatenate((skin[:-1, 0], skin[-1, :-1], skin[:0:-1, -1], skin[0, :0:-1]))


def _stitched(parts: int, every: int) -> Ints:
    """Numbers of the inner nodes of a side that yarns begin at, symmetric about its middle where that can be."""
    first = (parts // 2) % every or every
    return np.arange(first, parts, every)


def _add_wall(work: Patchwork, rims: tuple[Ints, Ints], height: float, up: int, bulge: float) -> None:
    """Add the wall between two rims, an arc over the height; at the corners of the panel it is mitred."""
    low = work.points[rims[0]]
    extent = np.abs(low[:, :2]).max(axis=0)
    outwards = np.where(np.abs(low[:, :2]) == extent, np.sign(low[:, :2]), 0.0)
    share = 2.0 * np.arange(1, up) / up - 1.0
    half = 0.5 * bulge
    rise, place = np.zeros(up - 1), 0.5 * height * share
    if half > 0.0:
        arc = height / (2.0 * math.sin(half))
        rise, place = arc * (np.cos(half * share) - math.cos(half)), arc * np.sin(half * share)
    between = np.empty((up - 1, len(low), 3))
    between[..., :2] = low[:, :2] + rise[:, None, None] * outwards
    between[..., 2] = (0.5 * height + place)[:, None]
    at = np.concatenate((rims[0][None], work.nodes(between), rims[1][None]))
    work.piece(quads(np.column_stack((at, at[:, :1])).T, banded=True), ("shell", "wall"), [0.0, 0.0, 1.0])


def _add_yarns(work: Patchwork, skins: list[Ints], every: int, up: int, yarns: str) -> None:
    """Add yarns between the skins: lines, or webs along y that stop a node before the wall."""
    bottom, top = skins
    where = [_stitched(count - 1, every) for count in top.shape]
    if yarns == "cables":
        grid = np.ix_(*where)
        work.line("yarns", np.column_stack((bottom[grid].ravel(), top[grid].ravel())))
        work.node_groups["stitched"] = np.concatenate((bottom[grid].ravel(), top[grid].ravel()))
        return
    for column in where[0]:
        ends = bottom[column, 1:-1], top[column, 1:-1]
        places: list[Floats] = [work.points[end] for end in ends]
        share = (np.arange(1, up) / up)[:, None, None]
        at = np.concatenate((ends[0][None], work.nodes(places[0] + share * (places[1] - places[0])), ends[1][None]))
        work.piece(quads(at, banded=True), ("webs",), [0.0, 0.0, 1.0])
    work.node_groups["stitched"] = np.concatenate((bottom[where[0], 1:-1].ravel(), top[where[0], 1:-1].ravel()))
