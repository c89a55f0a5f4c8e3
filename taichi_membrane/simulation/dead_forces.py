"""Nodal forces that keep their direction: those of loads, and of pressures that do not follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.quadratic import node_shares, side_shares
from taichi_membrane.scene import BodyLoad, Load, Pressure, Scene, WeightLoad
from taichi_membrane.scene.drivers import kind_named
from taichi_membrane.scene.loads import AnyLoad
from taichi_membrane.simulation.bodies import body_forces
from taichi_membrane.simulation.chambers import pressure_used
from taichi_membrane.simulation.groups import group_nodes, group_triangles, pressed_triangles
from taichi_membrane.simulation.masses import nodal_mass
from taichi_membrane.simulation.present import node_area


def unit_forces_of(scene: Scene, mesh: Mesh) -> dict[str, Floats]:
    """(n, 3) dead nodal forces at value 1 of each driver that has some."""
    found = {}
    for kind, unit_force in DEAD_FORCES.items():
        entry = kind_named(kind)
        for name, driver in entry.defined(scene).items():
            force = unit_force(scene, mesh, name, driver)
            if force is not None:
                found[f"{kind}.{name}"] = force
    return found


def _fixed_pressure(scene: Scene, mesh: Mesh, name: str, pressure: Pressure) -> Floats | None:
    """(n, 3) nodal forces of a pressure that keeps its direction, at value 1; None of others and of one that is never used."""
    if pressure.kind != "fixed" or not pressure_used(scene, name):
        return None
    share = np.zeros(mesh.tri_count)
    for elements, sign in zip(pressed_triangles(mesh, pressure, f"pressures.{name}"), (1.0, -1.0), strict=True):
        share[elements] += sign
    return preparation.nodal_pressure(mesh, share)


def _unit_load(scene: Scene, mesh: Mesh, name: str, load: AnyLoad) -> Floats | None:
    """(n, 3) nodal forces of a load at factor 1; None of those on the surface, which follow it (:mod:`surface_loads`)."""
    if isinstance(load, WeightLoad):
        down = np.array(load.direction) / np.linalg.norm(load.direction)
        return nodal_mass(scene, mesh, lumped=False)[:, None] * (load.g * down)
    if isinstance(load, BodyLoad):
        return body_forces(scene, mesh, name, load)
    return _dead_load(mesh, name, load) if isinstance(load, Load) else None


def _dead_load(mesh: Mesh, name: str, load: Load) -> Floats:
    """(n, 3) nodal forces of a load on a group at factor 1."""
    key = f"loads.{name}"
    force = np.zeros((mesh.node_count, 3))
    direction = np.array(load.direction)
    if load.kind == "area":
        return force + _tributary_area(mesh, group_triangles(mesh, load.group, f"{key}.group"))[:, None] * direction
    nodes = group_nodes(mesh, load.group, f"{key}.group")
    if load.kind == "line":
        return force + _tributary_length(mesh, nodes, key)[:, None] * direction
    if load.spread == "equal":
        share = np.zeros(mesh.node_count)
        share[nodes] = 1.0
    elif load.spread == "edges":
        share = _tributary_length(mesh, nodes, key)
    else:
        share = (
            node_area(mesh, np.zeros_like(mesh.points))
            if mesh.order == 2
            else _tributary_area(mesh, np.arange(mesh.tri_count))
        )
        share[np.setdiff1d(np.arange(mesh.node_count), nodes)] = 0.0
    return force + (share / share.sum())[:, None] * direction


def _tributary_area(mesh: Mesh, elements: Ints) -> Floats:
    """(n,) a third of the area of each of the elements around a node; of six-node ones ∫ N dA."""
    if mesh.order == 2:
        shares = np.zeros((mesh.tri_count, 6))
        shares[elements] = node_shares(mesh.points, mesh.cells[elements])
        return preparation.sum_to_nodes(mesh, shares.reshape(-1, 1))[:, 0]
    area = np.zeros(mesh.tri_count)
    area[elements] = mesh.tri_areas()[elements]
    return preparation.sum_to_nodes(mesh, np.repeat(area / 3.0, 3)[:, None])[:, 0]


def _tributary_length(mesh: Mesh, nodes: Ints, key: str) -> Floats:
    """(n,) half the length of the edges, of those with both ends in the group, that meet at a node; of curved ones ∫ N ds."""
    member = np.zeros(mesh.node_count, dtype=bool)
    member[nodes] = True
    if mesh.order == 2:
        curved = np.column_stack([mesh.edge_table.nodes, mesh.edge_middles])
        curved = curved[member[curved].all(axis=1)]
        if not len(curved):
            raise InputError(f"{key}.group: no mesh edge has its three nodes in this group of {len(nodes)} nodes")
        shares = side_shares(mesh.points, curved).ravel()
        return np.bincount(curved.ravel(), weights=shares, minlength=mesh.node_count).astype(np.float64, copy=False)
    edges = mesh.edges()
    edges = edges[member[edges].all(axis=1)]
    if not len(edges):
        raise InputError(f"{key}.group: no mesh edge has both ends in this group of {len(nodes)} nodes")
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    total = np.bincount(edges.ravel(), weights=np.repeat(0.5 * length, 2), minlength=mesh.node_count)
    return np.asarray(total, dtype=np.float64)


# Dead nodal forces at value 1 by kinds of drivers; in this order they are summed.
DEAD_FORCES: dict[str, Callable[[Scene, Mesh, str, Any], Floats | None]] = {
    "load": _unit_load,
    "pressure": _fixed_pressure,
}
