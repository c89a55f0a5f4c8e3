"""What a look at a mesh should tell: bodies, loops of free edges, angles, lengths, areas, and where it passes through itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mesh import check, quadratic
from taichi_membrane.mesh.crossing import crossings
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import node_parts

# Triangles beyond which crossings are not looked for: at this number the search takes about ten seconds and a gigabyte.
MOST_SEARCHED = 1_000_000
_MOST_SHOWN = 6  # bodies and loops that are listed


@dataclass(frozen=True)
class Body:
    """A connected part.

    :param volume: enclosed volume [length³]; None where the part is open.
    """

    node_count: int
    tri_count: int
    area: float
    volume: float | None


@dataclass(frozen=True)
class Loop:
    """Free edges that are connected: the rim of a hole or of a sheet. ``closed``: each node of it has two free edges."""

    edge_count: int
    length: float
    closed: bool


@dataclass(frozen=True)
class Survey:
    """Figures of a mesh, in its units.

    :param smallest_angle: degrees, and the element that has it.
    :param edge_lengths: shortest, median and longest.
    :param tolerance: how near nodes of free edges are one.
    :param crossing: pairs of elements that pass through each other, and the first of them; None where it was not looked for.
    """

    bodies: tuple[Body, ...]
    loops: tuple[Loop, ...]
    free_edge_count: int
    smallest_angle: tuple[float, int]
    edge_lengths: tuple[float, float, float]
    size: tuple[float, float, float]
    tolerance: float
    crossing: tuple[int, tuple[int, int] | None] | None


def survey(mesh: Mesh) -> Survey:
    """Work out the figures of a mesh."""
    edges = mesh.edges()
    length = np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
    pairs = crossings(mesh.points, mesh.triangles) if mesh.tri_count <= MOST_SEARCHED else None
    first = (int(pairs[0, 0]), int(pairs[0, 1])) if pairs is not None and len(pairs) else None
    sides = np.ptp(mesh.points, axis=0).tolist()
    return Survey(
        bodies=_bodies(mesh),
        loops=_loops(mesh),
        free_edge_count=len(mesh.boundary_edges()),
        smallest_angle=_smallest_angle(mesh),
        edge_lengths=(float(length.min()), float(np.median(length)), float(length.max())),
        size=(sides[0], sides[1], sides[2]),
        tolerance=mesh.tolerance,
        crossing=None if pairs is None else (len(pairs), first),
    )


def _bodies(mesh: Mesh) -> tuple[Body, ...]:
    label = mesh.components()
    of_tri = label[mesh.triangles[:, 0]]
    count = int(label.max()) + 1
    nodes, triangles = np.bincount(label, minlength=count), np.bincount(of_tri, minlength=count)
    area = np.bincount(of_tri, weights=mesh.tri_areas(), minlength=count)
    volume = check.part_volumes(mesh.points, mesh.triangles, label)
    if mesh.order == 2:
        cones = quadratic.volumes(mesh.points - mesh.points.mean(axis=0), mesh.cells)
        volume = np.bincount(of_tri, weights=cones, minlength=count).astype(np.float64, copy=False)
    is_open = np.zeros(count, dtype=bool)
    is_open[label[mesh.boundary_edges()]] = True
    is_open[label[mesh.junction_edges()]] = True  # a body with inner walls has several volumes
    order = [k for k in np.argsort(-area, kind="stable").tolist() if triangles[k]]  # nodes of cables alone are none
    return tuple(
        Body(int(nodes[k]), int(triangles[k]), float(area[k]), None if is_open[k] else float(volume[k]))
        for k in order
        if triangles[k] > 0  # the others are ends of cables
    )


def _loops(mesh: Mesh) -> tuple[Loop, ...]:
    """Connected free edges, the longest first."""
    edges = mesh.boundary_edges()
    if not len(edges):
        return ()
    nodes, flat = np.unique(edges, return_inverse=True)
    ends = flat.reshape(-1, 2)
    count, label = node_parts(ends.astype(np.int32), len(nodes))
    length = np.linalg.norm(mesh.points[edges[:, 0]] - mesh.points[edges[:, 1]], axis=1)
    if mesh.order == 2:
        curved = np.column_stack([edges, mesh.edge_middles[mesh.edge_table.tri_count == 1]])
        length = quadratic.side_shares(mesh.points, curved).sum(axis=1)
    total = np.bincount(label[ends[:, 0]], weights=length, minlength=count)
    edge_count = np.bincount(label[ends[:, 0]], minlength=count)
    degree = np.bincount(ends.ravel(), minlength=len(nodes))
    odd = np.bincount(label, weights=degree != 2, minlength=count)
    order = np.argsort(-total, kind="stable").tolist()
    return tuple(Loop(int(edge_count[k]), float(total[k]), bool(odd[k] == 0)) for k in order)


def _smallest_angle(mesh: Mesh) -> tuple[float, int]:
    corners = mesh.points[mesh.triangles]
    smallest = np.full(mesh.tri_count, 180.0)
    for k in range(3):
        one, other = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        sine = np.linalg.norm(np.cross(one, other), axis=1)
        smallest = np.minimum(smallest, np.degrees(np.arctan2(sine, (one * other).sum(axis=1))))
    at = int(np.argmin(smallest))
    return float(smallest[at]), at


def lines_of(found: Survey, length: str, area: str, volume: str) -> list[tuple[str, str]]:
    """The survey as lines of a label and a text, with units."""
    lines = [("bodies", "1")] if len(found.bodies) == 1 else []
    for number, body in enumerate(found.bodies[:_MOST_SHOWN] if len(found.bodies) > 1 else (), 1):
        closed = f"closed, volume {body.volume:.6g} {volume}" if body.volume is not None else "open"
        name = f"body {number} of {len(found.bodies)}: "
        lines.append(
            (
                "bodies",
                f"{name}{body.node_count} nodes, {body.tri_count} elements, area {body.area:.6g} {area}, {closed}",
            )
        )
    if len(found.bodies) > _MOST_SHOWN:
        lines.append(("bodies", f"and {len(found.bodies) - _MOST_SHOWN} smaller ones"))
    loops = [
        f"{loop.length:.6g} {length} ({loop.edge_count} edges{'' if loop.closed else ', meets itself'})"
        for loop in found.loops
    ]
    more = f" and {len(loops) - _MOST_SHOWN} shorter ones" if len(loops) > _MOST_SHOWN else ""
    told = (
        f" in {len(loops)} loop{'' if len(loops) == 1 else 's'}: {', '.join(loops[:_MOST_SHOWN])}{more}"
        if loops
        else ""
    )
    lines.append(("free edges", f"{found.free_edge_count or 'none'}{told}"))
    angle, element = found.smallest_angle
    lines.append(("angles", f"smallest {angle:.3g}°, of element {element}"))
    lines.append(("edges", "shortest {:.6g}, median {:.6g}, longest {:.6g}".format(*found.edge_lengths) + f" {length}"))
    lines.append(("size", " × ".join(f"{side:.6g}" for side in found.size) + f" {length}"))
    lines.append(("tolerance", f"nodes of free edges within {found.tolerance:.3g} {length} are one"))
    lines.append(("crossings", _crossings(found)))
    return lines


def _crossings(found: Survey) -> str:
    if found.crossing is None:
        return f"not looked for in more than {MOST_SEARCHED} elements"
    count, first = found.crossing
    if first is None:
        return "no elements pass through each other"
    return f"WARNING: {count} pairs of elements pass through each other, the first are {first[0]} and {first[1]}"
