"""Resultants of all that acts on a structure, which have to cancel: dead loads, loads on its surface, support forces, contact.

Each is summed from what makes it, not from what the others leave: loads on the surface from areas and pressures as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, sides_now
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.wet import corner_forces
from taichi_membrane.mesh.quadratic import area_vectors


@dataclass(frozen=True)
class Balance:
    """Resultants of what acts.

    :param resultants: along x, y, z, of ``loads``, ``surface``, ``reactions`` and ``contact``, those that the scene has.
    :param error: size of their sum over the largest of the sums of the sizes of the forces that each consists of; 0 without any.
    """

    resultants: Mapping[str, tuple[float, float, float]]
    error: float


def force_balance(
    structure: Structure, displacement: Floats, surface: Floats, *, loads: Floats, reactions: Floats, contact: Floats
) -> Balance:
    """The balance of forces.

    :param surface: values of all loads on the surface, in the structure's order.
    :param loads: (node_count, 3) dead forces, as ``reactions`` and ``contact`` are.
    """
    parts = {"loads": loads, "surface": surface_forces(structure, displacement, surface), "reactions": reactions}
    parts["contact"] = contact
    total = np.sum([forces.sum(axis=0) for forces in parts.values()], axis=0)
    gross = max(float(np.linalg.norm(forces, axis=1).sum()) for forces in parts.values())
    used = {name: forces for name, forces in parts.items() if name != "contact" or structure.obstacles}
    return Balance(
        {name: tuple(forces.sum(axis=0).tolist()) for name, forces in used.items()},
        float(np.linalg.norm(total)) / gross if gross > 0.0 else 0.0,
    )


def surface_forces(structure: Structure, displacement: Floats, values: Floats) -> Floats:
    """(n, 3) forces of pressures, winds, loads per plan area and liquids on the elements as they lie."""
    mesh = structure.mesh
    if mesh.order == 2:
        return _pressures(structure, values)[:, None] * area_vectors(mesh.points + displacement, mesh.cells)
    sides = sides_now(mesh, displacement, np.arange(mesh.tri_count))
    directed = np.cross(sides[:, 1], sides[:, 2])  # doubled areas
    forces = 0.5 * _pressures(structure, values)[:, None] * directed
    if structure.snow is not None:
        down, level = structure.snow.direction, structure.snow.share @ values[structure.snow_values]
        forces += (0.5 * level * np.maximum(-directed @ down, 0.0))[:, None] * down
    wet = [
        corner_forces(mesh.points, one, level, displacement).sum(axis=1)
        for one, level in zip(structure.water, values[structure.water_values], strict=True)
    ]
    return np.concatenate([forces, *wet])


def _pressures(structure: Structure, values: Floats) -> Floats:
    """(tri_count,) pressure along each triangle's normal."""
    padded = np.append(values[: structure.chamber_count], 0.0)  # the last one is that of no chamber
    pressure = padded[structure.tri_chamber]
    if structure.tri_ahead is not None:
        pressure = pressure - padded[structure.tri_ahead]
    if structure.wind is not None:
        pressure = pressure + structure.wind @ values[structure.chamber_count : structure.pressure_count]
    return np.asarray(pressure)
