"""What solvers report while they work, and how they ended."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a solver reports while it works."""

    iteration: int
    residual: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class SolveRecord:
    """How a solve ended.

    :param reason: ``residual`` when converged, else ``iteration limit``, ``not finite``, ``no descent`` (Newton found no step that
        lowers the energy) or ``stagnated at a residual of …`` (relaxation met round-off).
    :param residual: 2-norm of the out-of-balance forces on free degrees of freedom over the reference load.
    :param definite: False where Newton met a tangent that is not positive definite: the state may lie on another branch.
    :param method: which solver did it, such as ``newton`` or, where several took part, ``newton 60 + relaxation 500 + newton 7``.
    """

    converged: bool
    reason: str
    iterations: int
    residual: float
    seconds: float
    method: str
    definite: bool = True
