"""Chambers: the surfaces that follower pressures act on, and on which of their sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh, quadratic
from taichi_membrane.mesh.check import FLAT_BODY
from taichi_membrane.mesh.topology import EdgeTable, edge_table, node_parts
from taichi_membrane.scene import Pressure, Scene, Stage
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.groups import groups_at, pressed_triangles


@dataclass(frozen=True, eq=False)
class Chamber:
    """The triangles that one pressure acts on.

    :param triangles: their numbers; ``sign`` (k,) 1 where their normals point out of the chamber, -1 where into it.
    """

    name: str
    mesh: Mesh
    triangles: Ints
    sign: Ints

    @cached_property
    def table(self) -> EdgeTable:
        """Edges of the chamber's triangles."""
        return edge_table(self.mesh.triangles[self.triangles], self.mesh.node_count)

    @cached_property
    def sense(self) -> Ints:
        """(edge_count,) how often the chamber's boundary runs along each edge of the table; 0 where it closes."""
        corners = self.mesh.triangles[self.triangles]
        along = np.where(corners < np.roll(corners, -1, axis=1), 1, -1) * self.sign[:, None]
        return np.asarray(np.add.reduceat(along.ravel()[self.table.half_edges], self.table.start))

    @property
    def is_closed(self) -> bool:
        """Whether it encloses a volume."""
        return bool((self.sense == 0).all())

    @property
    def area(self) -> float:
        """Area of its triangles at rest."""
        if self.mesh.order == 2:
            return float(quadratic.areas(self.mesh.points, self.mesh.cells[self.triangles]).sum())
        corners = self.mesh.points[self.mesh.triangles[self.triangles]]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(0.5 * np.linalg.norm(sides, axis=1).sum())

    def volume(self, points: Floats) -> float:
        """Volume enclosed with the nodes at ``points``; the cone to their middle for a chamber with holes."""
        if self.mesh.order == 2:
            cones = quadratic.volumes(points - self.mesh.points.mean(axis=0), self.mesh.cells[self.triangles])
            return float(self.sign @ cones)
        corners = points[self.mesh.triangles[self.triangles]] - self.mesh.points.mean(axis=0)
        return float((self.sign * np.linalg.det(corners)).sum() / 6.0)


def chambers_of(scene: Scene, mesh: Mesh) -> tuple[Chamber, ...]:
    """The scene's follower pressures that any stage gives a value other than zero, or shuts, in its order.

    :raises InputError: unknown groups, a side of an element that has two pressures, surfaces that are not those of a chamber.
    """
    used = [name for name, one in scene.pressures.items() if one.kind == "follower" and pressure_used(scene, name)]
    made = tuple(_chamber(mesh, name, scene.pressures[name]) for name in used)
    branching = len(mesh.junction_edges()) > 0
    for chamber in made:
        _check_sides_free(made, chamber)
    for chamber in made:
        if branching or (chamber.sign < 0).any():
            _check_orientation(chamber)
        shutting = [stage for stage in scene.ramps if chamber.name in shut_by(scene, stage)]
        if shutting:
            _check_closed(chamber)
            _check_filled(scene, chamber, shutting[0])
    return made


def sides(made: Sequence[Chamber], tri_count: int) -> tuple[Ints, Ints | None]:
    """(tri_count,) numbers of the chambers behind and before each triangle, -1 for none; None where there is none before any."""
    behind, ahead = np.full((2, tri_count), -1, dtype=np.int32)
    for number, chamber in enumerate(made):
        behind[chamber.triangles[chamber.sign > 0]] = number
        ahead[chamber.triangles[chamber.sign < 0]] = number
    return behind, ahead if (ahead >= 0).any() else None


def pressure_used(scene: Scene, name: str) -> bool:
    """Whether any stage gives this pressure a value other than zero, or shuts it; others are left out of the model."""
    return any(_raised(stage, name) or name in shut_by(scene, stage) for stage in scene.ramps)


def _raised(stage: Stage, name: str) -> bool:
    """Whether a stage gives a pressure a value other than zero."""
    return bool(stage.pressure.get(name) if isinstance(stage.pressure, dict) else stage.pressure)


def _chamber(mesh: Mesh, name: str, pressure: Pressure) -> Chamber:
    outwards, inwards = pressed_triangles(mesh, pressure, f"pressures.{name}")
    sign = np.repeat(np.array([1, -1], dtype=np.int8), [len(outwards), len(inwards)])
    return Chamber(name, mesh, np.concatenate([outwards, inwards]), sign)


def _check_sides_free(made: Sequence[Chamber], chamber: Chamber) -> None:
    """Refuse two pressures on one side of an element."""
    for other in made[: [one.name for one in made].index(chamber.name)]:
        for sign, side in ((1, "behind"), (-1, "before")):
            both = np.intersect1d(other.triangles[other.sign == sign], chamber.triangles[chamber.sign == sign])
            if both.size:
                raise InputError(
                    f"pressures.{chamber.name}: {both.size} elements, the first is {both[0]}, overlap with pressure "
                    f"{other.name!r}, which already lies {side} them; a wall between two chambers is in 'group' of the one "
                    "behind it and in 'against' of the one that its normals point into"
                )


def _check_orientation(chamber: Chamber) -> None:
    """Refuse edges at which the chamber's surface goes on without closing: it branches, or its sides do not agree."""
    mesh, table = chamber.mesh, chamber.table
    bad = np.flatnonzero((table.tri_count > 1) & (chamber.sense != 0))
    if bad.size:
        elements = chamber.triangles[np.array(table.triangles_at(int(bad[0])))]
        named = [f"{element} ({groups_at(mesh, element)})" for element in elements.tolist()]
        ends = [tuple(mesh.points[node].tolist()) for node in table.nodes[bad[0]]]
        raise InputError(
            f"pressures.{chamber.name}: its elements {', '.join(named)} meet at the edge from {ends[0]} to {ends[1]} and do not "
            f"enclose one side; {bad.size} such edges in all. Name in 'group' what has the chamber behind it, in 'against' what "
            "has it before it, in neither what lies inside it"
        )
    for part in surfaces(chamber):
        if part.is_closed and part.volume(mesh.points) < -FLAT_BODY * part.area**1.5 and not _within(part, chamber):
            which = (
                "the chamber is"
                if len(part.triangles) == len(chamber.triangles)
                else f"{_told(part)} of its surfaces is"
            )
            raise InputError(
                f"pressures.{chamber.name}: {which} inside out: its volume is {part.volume(mesh.points):.6g}; "
                "exchange 'group' and 'against'"
            )


def surfaces(chamber: Chamber) -> list[Chamber]:
    """The connected surfaces of a chamber: several of those that are joined for good."""
    corners = chamber.mesh.triangles[chamber.triangles]
    label = node_parts(chamber.table.nodes, chamber.mesh.node_count)[1][corners[:, 0]]
    return [
        Chamber(chamber.name, chamber.mesh, chamber.triangles[label == one], chamber.sign[label == one])
        for one in np.unique(label)
    ]


def _within(part: Chamber, chamber: Chamber) -> bool:
    """Whether a surface may be the inner one of a chamber: it lies within the box of another that is not inside out."""
    points = chamber.mesh.points
    low, high = (end(points[part.mesh.triangles[part.triangles]], axis=(0, 1)) for end in (np.min, np.max))
    for other in surfaces(chamber):
        corners = points[other.mesh.triangles[other.triangles]]
        inside = (corners.min(axis=(0, 1)) < low).all() and (corners.max(axis=(0, 1)) > high).all()
        if inside and other.volume(points) > 0.0:
            return True
    return False


def _told(part: Chamber) -> str:
    """Which surface of a chamber is meant, in words."""
    return f"the one with element {part.triangles[0]} ({groups_at(part.mesh, int(part.triangles[0]))})"


def _check_closed(chamber: Chamber) -> None:
    """Refuse to shut a chamber of which a surface leaves a hole."""
    parts = surfaces(chamber)
    for part in parts:
        free = int((part.sense != 0).sum())
        if free:
            which = "its" if len(parts) == 1 else f"of its {len(parts)} surfaces {_told(part)} has a hole: its"
            raise InputError(
                f"pressures.{chamber.name}: a chamber that is shut must have no hole, but {which} {len(part.triangles)} elements "
                f"have {free} free edges"
            )


def _check_filled(scene: Scene, chamber: Chamber, first: Stage) -> None:
    """Refuse to shut a flat chamber before any pressure has given it a volume."""
    before = scene.before(first)
    volume = chamber.volume(chamber.mesh.points)
    if volume <= FLAT_BODY * chamber.area**1.5 and not any(_raised(stage, chamber.name) for stage in before):
        raise InputError(
            f"{first.key}: it shuts the valve of {chamber.name!r}, whose chamber is flat (volume {volume:.6g}) and holds "
            "no gas yet; give it a pressure in a stage before"
        )
