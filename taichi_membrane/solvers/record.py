"""What the engine hands over: the state of the elements; what solvers report while they work, and how they ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mechanics.preparation import Floats

# What a residual is compared with (force): fixed, or asked for at each iteration where it follows the state, as reactions do.
Reference = float | Callable[[], float]


def force_now(reference: Reference) -> float:
    """A reference at the present state."""
    return reference() if callable(reference) else reference


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a solver reports while it works."""

    iteration: int
    residual: float
    seconds: float


@dataclass(frozen=True)
class SolveRecord:
    """How a solve ended.

    :param reason: ``residual`` when converged, else ``iteration limit``, ``not finite``, ``no descent`` (Newton found no step that
        lowers the energy) or ``stagnated at a residual of …`` (relaxation met round-off).
    :param residual: 2-norm of the out-of-balance forces on free degrees of freedom over the reference load.
    :param method: which solver did it, such as ``newton`` or, where several took part, ``newton 60 + relaxation 500 + newton 7``.
    """

    converged: bool
    reason: str
    iterations: int
    residual: float
    seconds: float
    method: str


def joined(*parts: SolveRecord) -> SolveRecord:
    """One record of several solvers' work on one state; the last one's verdict counts."""
    return replace(
        parts[-1],
        method=" + ".join(
            f"{part.method} {part.iterations}" if "+" not in part.method else part.method for part in parts
        )
        if len(parts) > 1
        else parts[-1].method,
        iterations=sum(part.iterations for part in parts),
        seconds=sum(part.seconds for part in parts),
    )


@dataclass(frozen=True, kw_only=True)
class ElementState:
    """State of every triangle at the present displacements; stresses and strains in fabric axes (warp, weft, shear).

    :param strain: (m, 3); shear is the engineering shear strain.
    :param stress: (m, 3) force per area.
    :param state: (m,) 0 taut, 1 wrinkled, 2 slack.
    :param fold_strain: (m,) largest principal strain stored in folds, zero where taut.
    :param taut_margin: (m,) minor principal trial stress over the fabric's larger modulus; negative where not taut.
    :param slack_margin: (m,) major principal strain; negative where slack.
    """

    strain: Floats
    stress: Floats
    state: NDArray[np.int8]
    fold_strain: Floats
    taut_margin: Floats
    slack_margin: Floats
