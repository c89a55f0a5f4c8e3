"""Loads that follow the moving surface beside the pressures of chambers: wind, loads per plan area such as snow, liquids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.pond import Pond
from taichi_membrane.mechanics.preparation import Floats, PlanLoads, Water, nodal_pressure, sides_now, sum_to_nodes
from taichi_membrane.mechanics.wet import corner_forces
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import ElementField, Scene, SnowLoad, WaterLoad, WindLoad, WindTable
from taichi_membrane.simulation.element_data import element_values
from taichi_membrane.simulation.groups import group_triangles

# A radius of this share of the mesh's size has no direction.
_NO_RADIUS = 1e-9


@dataclass(frozen=True, eq=False)
class SurfaceLoads:
    """What winds, loads per plan area and liquids do to each triangle, by their names; those that no stage uses are left out.

    :param winds: (tri_count,) pressure along the normal at value 1.
    :param volumes: weight per volume of the liquids whose volume stages give.
    :param snows: (tri_count,) share of the load that a triangle bears, all along ``down``.
    """

    mesh: Mesh
    winds: Mapping[str, Floats]
    snows: Mapping[str, Floats]
    down: Floats
    waters: Mapping[str, Water]
    volumes: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Of all, in the order that the structure has their values."""
        return (*self.winds, *self.snows, *self.waters)

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of their values, in the order that the structure has them."""
        return tuple(f"load.{name}" for name in self.names)

    @property
    def wind(self) -> Floats | None:
        """(tri_count, n) all winds."""
        return np.column_stack(list(self.winds.values())) if self.winds else None

    @property
    def plan_loads(self) -> PlanLoads | None:
        """All loads per plan area."""
        return PlanLoads(direction=self.down, share=np.column_stack(list(self.snows.values()))) if self.snows else None

    def at_rest(self, name: str, value: float = 1.0) -> Floats:
        """(node_count, 3) nodal forces of one of them at a value on the unstressed shape."""
        if name in self.winds:
            return nodal_pressure(self.mesh, value * self.winds[name])
        still, corners = np.zeros_like(self.mesh.points), np.zeros((self.mesh.tri_count, 3, 3))
        if name in self.waters:
            one = self.waters[name]
            if name in self.volumes:
                value = self.pond(name, value).level(still)
            corners[one.tri] = corner_forces(self.mesh.points, one, value, still)
        else:
            sides = sides_now(self.mesh, still, np.arange(self.mesh.tri_count))
            plan = np.maximum(-np.cross(sides[:, 1], sides[:, 2]) @ self.down, 0.0)
            corners += (value * self.snows[name] * plan / 6.0)[:, None, None] * self.down
        return sum_to_nodes(self.mesh, corners.reshape(-1, 3))

    def level(self, name: str, value: float, displacement: Floats) -> float:
        """Height of a liquid's level above its floor, from what a stage gives."""
        return self.pond(name, value).level(displacement) if name in self.volumes else value

    def pond(self, name: str, volume: float) -> Pond:
        """A liquid by its volume."""
        number = len(self.winds) + len(self.snows) + list(self.waters).index(name)
        return Pond(number=number, one=self.waters[name], weight=self.volumes[name], volume=volume)


def surface_loads_of(scene: Scene, mesh: Mesh, *, unused: bool = False) -> SurfaceLoads:
    """A scene's winds, loads per plan area and liquids on its mesh.

    :param unused: with those that every stage leaves at zero.
    :raises InputError: unknown groups, two coefficients of one element, an angle that a table does not reach, a floor too high.
    """
    winds, snows, waters, down = {}, {}, {}, np.array([0.0, 0.0, -1.0])
    volumes: dict[str, float] = {}
    for name, load in scene.loads.items():
        used = unused or any(stage.loads.get(name) for stage in scene.ramps)
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
        elif isinstance(load, WaterLoad):
            water = _water(mesh, name, load)
            if used:
                waters[name] = water
                volumes |= {name: load.specific_weight} if load.given == "volume" else {}
    return SurfaceLoads(mesh, winds, snows, down, waters, volumes)


def _water(mesh: Mesh, name: str, load: WaterLoad) -> Water:
    """A liquid on a mesh."""
    up = np.array(load.up) / np.linalg.norm(load.up)
    weight = np.zeros(mesh.tri_count)
    for group in [load.group] if isinstance(load.group, str) else load.group:
        weight[group_triangles(mesh, group, f"loads.{name}.group")] = (
            load.specific_weight if load.face == "back" else -load.specific_weight
        )
    water = Water(mesh=mesh, up=up, floor=float(np.array(load.floor) @ up), weight=weight)
    lowest = float((mesh.points @ up)[mesh.triangles[water.tri]].min())
    if load.given == "level" and lowest < water.floor - _NO_RADIUS * np.linalg.norm(np.ptp(mesh.points, axis=0)):
        raise InputError(
            f"loads.{name}.floor: at height {water.floor:.6g}, but elements of the group go down to {lowest:.6g} and would be "
            "wet at level zero; give a floor no higher than that"
        )
    return water


def _coefficients(mesh: Mesh, name: str, load: WindLoad) -> Floats:
    """(tri_count,) pressure coefficient of each triangle; 0 where the wind does not blow."""
    if load.table is not None:
        return _tabled(mesh, load.table, f"loads.{name}.table")
    if isinstance(load.cp, ElementField):
        everywhere = np.arange(mesh.tri_count)
        return load.cp.scale * element_values(mesh, load.cp.field, everywhere, f"loads.{name}.cp.field", (1,))
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
    """Coefficients by the angle from the windward side at the triangles' centres.

    Of potential flow: 1 less the square of the speed, which is 3/2 sin θ on a sphere, 2 sin θ around a cylinder by the part of the
    wind across its axis; the part along it goes on as it is.
    """
    members = group_triangles(mesh, table.group, f"{key}.group")
    radius = mesh.points[mesh.triangles[members]].mean(axis=1) - np.array(table.centre)
    towards, across = -np.array(table.direction) / np.linalg.norm(table.direction), 1.0
    if table.axis is not None:
        axis = np.array(table.axis) / np.linalg.norm(table.axis)
        radius = radius - np.outer(radius @ axis, axis)
        towards = towards - (towards @ axis) * axis
        across = float(np.linalg.norm(towards))
        if across < 1e-6:
            raise InputError(
                f"{key}: the wind blows along the axis: direction = {list(table.direction)}, axis = {list(table.axis)}"
            )
        towards = towards / across
    length = np.linalg.norm(radius, axis=1)
    lost = np.flatnonzero(length <= _NO_RADIUS * np.linalg.norm(np.ptp(mesh.points, axis=0)))
    if lost.size:
        raise InputError(
            f"{key}.centre: element {members[lost[0]]} (and {lost.size - 1} others) lies at the centre, or on the axis"
        )
    if table.flow is not None:
        sine = np.linalg.norm(np.cross(radius, towards), axis=1) / length
        found = np.zeros(mesh.tri_count)
        found[members] = across**2 * (1.0 - ((1.5 if table.axis is None else 2.0) * sine) ** 2)
        return found
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
