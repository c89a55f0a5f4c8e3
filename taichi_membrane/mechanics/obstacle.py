"""Rigid obstacles as the engine knows them: smooth pieces, each with a signed distance of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from taichi_membrane.arrays import Floats, Ints
from taichi_membrane.mechanics.facets import Facets

# ``cylinder`` is infinite, ``drum`` one with ends.
ObstacleKind = Literal["plane", "sphere", "cylinder", "drum", "box", "surface"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """A rigid obstacle that nodes touch and do not pass.

    :param name: of the scene's plane or obstacle that it is, or is a wall of.
    :param nodes: numbers of the nodes that it holds up.
    :param centre: a point of a plane or of a cylinder's axis, the centre of the others.
    :param frame: rows are its axes: the last one a plane's unit normal, to the side where the structure is, or a cylinder's axis.
    :param size: radius of a sphere or cylinder; radius and half length of a drum; half lengths of a box along its axes.
    :param rounding: radius of the edges of a drum or box.
    :param hollow: whether the structure is within a sphere or cylinder, or behind a surface, rather than outside or before it.
    :param motion: displacement at value 1 of its motion; zero where it stays.
    :param facets: the triangles of a surface.
    :param offset: distance from the facets at which nodes touch.
    :param friction: coefficient of Coulomb friction.
    """

    name: str
    kind: ObstacleKind
    nodes: Ints
    centre: Floats
    frame: Floats = field(default_factory=lambda: np.eye(3))
    size: tuple[float, ...] = ()
    rounding: float = 0.0
    hollow: bool = False
    motion: Floats = field(default_factory=lambda: np.zeros(3))
    facets: Facets | None = None
    offset: float = 0.0
    friction: float = 0.0

    @property
    def code(self) -> tuple[str, bool, bool]:
        """What of it is compiled."""
        return self.kind, self.hollow, self.friction > 0.0
