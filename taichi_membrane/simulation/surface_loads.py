"""Loads that follow the moving surface beside the pressures of chambers: wind, and loads per plan area such as snow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, PlanLoads, nodal_pressure, sides_now, sum_to_nodes
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene, SnowLoad, WindLoad, WindTable
from taichi_membrane.simulation.groups import group_triangles

# A radius of this share of the mesh's size has no direction.
_NO_RADIUS = 1e-9


@dataclass(frozen=True, eq=False)
class SurfaceLoads:
    """What winds and loads per plan area do to each triangle at value 1, by their names; those that no stage uses are left out.

    :param winds: (tri_count,) pressure along the normal.
    :param snows: (tri_count,) share of the load that a triangle bears, all along ``down``.
    """

    mesh: Mesh
    winds: Mapping[str, Floats]
    snows: Mapping[str, Floats]
    down: Floats

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of their values, in the order that the structure has them."""
        return tuple(f"load.{name}" for name in (*self.winds, *self.snows))

    @property
    def wind(self) -> Floats | None:
        """(tri_count, n) all winds."""
        return np.column_stack(list(self.winds.values())) if self.winds else None

    @property
    def plan_loads(self) -> PlanLoads | None:
        """All loads per plan area."""
        return PlanLoads(direction=self.down, share=np.column_stack(list(self.snows.values()))) if self.snows else None

    def at_rest(self, name: str) -> Floats:
        """(node_count, 3) nodal forces of one of them at value 1 on the unstressed shape."""
        if name in self.winds:
            return nodal_pressure(self.mesh, self.winds[name])
        sides = sides_now(self.mesh, np.zeros_like(self.mesh.points), np.arange(self.mesh.tri_count))
        plan = np.maximum(-np.cross(sides[:, 1], sides[:, 2]) @ self.down, 0.0)
        corner = (self.snows[name] * plan / 6.0)[:, None] * self.down
        return sum_to_nodes(self.mesh, np.repeat(corner, 3, axis=0))


def surface_loads_of(scene: Scene, mesh: Mesh, *, unused: bool = False) -> SurfaceLoads:
    """A scene's winds and loads per plan area on its mesh.

    :param unused: with those that every stage leaves at zero.
    :raises InputError: unknown groups, two coefficients of one element, an angle that a table does not reach.
    """
    winds, snows, down = {}, {}, np.array([0.0, 0.0, -1.0])
    for name, load in scene.loads.items():
        used = unused or any(stage.loads.get(name) for stage in scene.stages)
        if isinstance(load, WindLoad):
            coefficient = _coefficients(mesh, name, load)
            if used:
                winds[name] = (-load.q if load.face == "front" else load.q) * coefficient
        elif isinstance(load, SnowLoad):
            share = np.zeros(mesh.tri_count)
            for group in [load.group] if isinstance(load.group, str) else load.group:
                share[group_triangles(mesh, group, f"loads.{name}.group")] = 1.0
            if used:
                snows[name] = share
                down = np.array(load.direction) / np.linalg.norm(load.direction)
    return SurfaceLoads(mesh, winds, snows, down)


def _coefficients(mesh: Mesh, name: str, load: WindLoad) -> Floats:
    """(tri_count,) pressure coefficient of each triangle; 0 where the wind does not blow."""
    if load.table is not None:
        return _tabled(mesh, load.table, f"loads.{name}.table")
    found, owner = np.full(mesh.tri_count, load.cp.get("all", 0.0)), np.full(mesh.tri_count, -1)
    names = [group for group in load.cp if group != "all"]
    for number, group in enumerate(names):
        members = group_triangles(mesh, group, f"loads.{name}.cp")
        taken = members[owner[members] >= 0]
        if taken.size:
            other = names[owner[taken[0]]]
            raise InputError(
                f"loads.{name}.cp: element {taken[0]} (and {taken.size - 1} others) has {load.cp[other]:g} by group {other!r} and "
                f"{load.cp[group]:g} by group {group!r}"
            )
        owner[members], found[members] = number, load.cp[group]
    return found


def _tabled(mesh: Mesh, table: WindTable, key: str) -> Floats:
    """Coefficients by the angle from the windward side at the triangles' centres."""
    members = group_triangles(mesh, table.group, f"{key}.group")
    radius = mesh.points[mesh.triangles[members]].mean(axis=1) - np.array(table.centre)
    towards = -np.array(table.direction) / np.linalg.norm(table.direction)
    if table.axis is not None:
        axis = np.array(table.axis) / np.linalg.norm(table.axis)
        radius = radius - np.outer(radius @ axis, axis)
        towards = towards - (towards @ axis) * axis
        if np.linalg.norm(towards) < 1e-6:
            raise InputError(
                f"{key}: the wind blows along the axis: direction = {list(table.direction)}, axis = {list(table.axis)}"
            )
        towards = towards / np.linalg.norm(towards)
    length = np.linalg.norm(radius, axis=1)
    lost = np.flatnonzero(length <= _NO_RADIUS * np.linalg.norm(np.ptp(mesh.points, axis=0)))
    if lost.size:
        raise InputError(
            f"{key}.centre: element {members[lost[0]]} (and {lost.size - 1} others) lies at the centre, or on the axis"
        )
    angle = np.degrees(np.arccos(np.clip(radius @ towards / length, -1.0, 1.0)))
    outside = np.flatnonzero((angle < table.angles[0]) | (angle > table.angles[-1]))
    if outside.size:
        raise InputError(
            f"{key}.angles: they go from {table.angles[0]:g} to {table.angles[-1]:g}, but element {members[outside[0]]} "
            f"(and {outside.size - 1} others) is at {angle[outside[0]]:.6g} degrees"
        )
    found = np.zeros(mesh.tri_count)
    found[members] = np.interp(angle, table.angles, table.cp)
    return found
