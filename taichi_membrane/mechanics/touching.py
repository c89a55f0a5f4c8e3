"""What a system's contacts are: the terms of its obstacles, and gaps, forces and normals of all nodes at one instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mechanics.contact import ContactTerm
from taichi_membrane.mechanics.friction import FrictionTerm
from taichi_membrane.mechanics.nodes import Nodes
from taichi_membrane.mechanics.obstacles import BoxTerm, DrumTerm, RoundTerm
from taichi_membrane.mechanics.planes import PlaneTerm
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.surface_contact import SurfaceTerm

_TERMS: dict[str, type[ContactTerm]] = {
    "plane": PlaneTerm,
    "sphere": RoundTerm,
    "cylinder": RoundTerm,
    "drum": DrumTerm,
    "box": BoxTerm,
    "surface": SurfaceTerm,
}
# Normals of one node closer to each other's span than this say nothing more.
_SAME = 1e-6


def contact_terms(nodes: Nodes, structure: Structure) -> tuple[ContactTerm, ...]:
    """The terms of a structure's obstacles."""
    return tuple(_TERMS[one.kind](nodes, structure, number) for number, one in enumerate(structure.obstacles))


def friction_terms(nodes: Nodes, structure: Structure, contacts: Sequence[ContactTerm]) -> tuple[FrictionTerm, ...]:
    """The terms of those that have friction."""
    return tuple(
        FrictionTerm(nodes, structure, one) for one in contacts if structure.obstacles[one.number].friction > 0.0
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Touching:
    """Contact at one instant.

    :param gap: (obstacles, node_count) distance of each node from each obstacle, negative where it has passed it.
    :param push: (obstacles, node_count) contact forces.
    :param normal: (obstacles, node_count, 3) their directions.
    :param friction: (obstacles, node_count, 3) friction forces.
    """

    gap: Floats
    push: Floats
    normal: Floats
    friction: Floats

    @property
    def active(self) -> NDArray[np.bool_]:
        """(obstacles, node_count) where there is contact."""
        return np.asarray(self.push > 0.0)

    def forces(self) -> Floats:
        """(obstacles, node_count, 3) contact forces, with friction."""
        return np.asarray(self.push[..., None] * self.normal + self.friction)

    def deepest(self) -> float:
        """How far nodes that are pushed have passed an obstacle at most."""
        return float(np.max(np.where(self.active, -self.gap, 0.0), initial=0.0))


def held_by_contact(active: NDArray[np.bool_], normals: Floats, free: NDArray[np.bool_]) -> Floats:
    """(node_count, 3, 3) projections N Nᵀ on the span of the normals at which nodes are in contact, among their free components.

    :param normals: (obstacles, node_count, 3), in the axes that ``free`` (node_count, 3) refers to.
    """
    held = np.zeros((len(free), 3, 3))
    for touches, normal in zip(active, normals, strict=True):
        rest = np.where(free, normal, 0.0)
        rest = rest - np.einsum("nij,nj->ni", held, rest)
        length = np.linalg.norm(rest, axis=1, keepdims=True)
        unit = np.where(touches[:, None] & (length > _SAME), rest / np.where(length > _SAME, length, 1.0), 0.0)
        held += unit[:, :, None] * unit[:, None, :]
    return held
