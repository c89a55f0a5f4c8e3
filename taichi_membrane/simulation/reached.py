"""What a load step came to."""

from __future__ import annotations

from dataclasses import dataclass

from taichi_membrane.simulation.policy import Trace
from taichi_membrane.solvers.record import SolveRecord


@dataclass(frozen=True, eq=False)
class Reached:
    """What a step from one load state towards another came to.

    :param reached: share of the step at which the membrane now is in equilibrium; 1 when the step is done.
    :param limit: shares of the step that bracket the largest stable load, where the path has a limit.
    :param trouble: where no equilibrium was found, what was worst in the last state that was tried.
    :param trace: what the step went through, at shares of it.
    """

    record: SolveRecord
    reached: float
    limit: tuple[float, float] | None = None
    trouble: str = ""
    trace: Trace = ()
