"""What one load step hands to the next, and so all that a run that was stopped goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from taichi_membrane.arrays import Floats
from taichi_membrane.mechanics.wall_search import Touched


@dataclass(frozen=True, kw_only=True, eq=False)
class PathState:
    """A point of an equilibrium path that is followed by arc length, beside its displacements.

    :param factor: share of the stage's way.
    :param tangent: (n, 3) change of the displacements per share, in the supports' axes; ``advance`` the step that led here.
    :param negative: negative eigenvalues of the tangent stiffness.
    :param length: distance to try next along the path.
    """

    factor: float
    tangent: Floats
    advance: Floats
    negative: int
    length: float


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """What one load step hands to the next.

    :param displacement: (n, 3).
    :param drivers: value of every driver, pressures and amounts of gas as they are.
    :param stiffest: largest current stiffness of the course so far, in the units of :class:`~.stiffest.Stiffest`.
    :param let_out: amount of gas that relief valves have let out since the stage began, by the first pressure of each gas.
    :param path: where the stage's path is, of a stage by arc length.
    :param friction: (n, 3) friction forces of each obstacle that has friction, or of each of its walls.
    :param touched: what walls touch of each other.
    """

    displacement: Floats
    drivers: Mapping[str, float]
    stiffest: float = 0.0
    let_out: Mapping[str, float]
    path: PathState | None = None
    friction: tuple[Floats, ...] = ()
    touched: Touched | None = None

    def __repr__(self) -> str:
        """One line, without the arrays."""
        drivers = ", ".join(f"{name} = {value:g}" for name, value in self.drivers.items())
        return f"State({len(self.displacement)} nodes; {drivers})"
