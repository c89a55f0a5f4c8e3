"""How soft a structure has become on a straight course of the load, against the stiffest that it was there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.simulation.way import Way

# Cosine of the angle between ways of one course: rounding of load values leaves 1e-16, a user's digits less than 1e-9.
_PARALLEL = 1.0 - 1e-9


@dataclass
class Stiffest:
    """The largest current stiffness met on a straight course so far, in units that do not depend on how it is cut into steps.

    :param direction: unit vector of the change of all load values; another direction is another course.
    """

    direction: Floats | None = None
    value: float = 0.0

    def resume(self, change: Floats) -> None:
        """Go on on the course of a run that was stopped, whose value is known."""
        self.direction = change / (np.linalg.norm(change) or 1.0)

    def take(self, way: Way, stiffness: float) -> float:
        """Take a stiffness into account; its share of the stiffest of the course."""
        change = way.before.change(way.after)
        squared = float(change @ change)
        direction = change / np.sqrt(squared)
        if self.direction is None or float(direction @ self.direction) < _PARALLEL:
            self.direction, self.value = direction, 0.0
        now = abs(stiffness) * squared  # dλ/dP of a way twice as long is a quarter
        self.value = max(self.value, now)
        return now / self.value
