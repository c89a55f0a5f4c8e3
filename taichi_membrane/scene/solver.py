"""How equilibrium is found, and the modes computed about it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import Record


class Solver(Record):
    """How equilibrium is found.

    ``tolerance``: 2-norm of the out-of-balance forces on free degrees of freedom over that of the applied forces, pressure
    included; by default 1e-6 in double precision, 3e-6 in single. ``max_iterations`` limits relaxation per solve. ``max_cuts``:
    how often a load step that fails is halved. ``stability``: count the negative eigenvalues of the tangent at every load step
    (with Newton; it costs a factorisation where the next step changes a pressure). ``memory``: GiB that a factor may take, by
    default what the machine has; above it the hybrid relaxes alone. ``kind``: ``newton`` on the relaxed energy,
    ``relaxation`` (any back end and precision, any law), or ``hybrid``, which lets relaxation take over where Newton does not get
    on. Where load control finds no equilibrium, both Newton kinds follow the path by arc length to it, or to collapse.
    """

    kind: Literal["hybrid", "newton", "relaxation"] = "hybrid"
    """``newton``, ``relaxation``, or ``hybrid``: Newton, with relaxation where it does not get on."""
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Out-of-balance over acting forces at which a state is an equilibrium; 1e-6, in single precision 3e-6."""
    max_iterations: Annotated[int, Field(ge=1, le=1_000_000_000)] = 200_000
    """Most iterations of relaxation in one solve."""
    max_cuts: Annotated[int, Field(ge=0, le=20)] = 4
    """How often a load step that fails is halved."""
    stability: bool = True
    """Count negative eigenvalues of the tangent at every load step."""
    memory: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Memory that a factor may take [GiB]; what the machine has without it."""


class Modes(Record):
    """Modes computed at every load step of a stage (of all stages when None), Newton only.

    ``vibration``: lowest frequencies about the present state, in vacuo. ``buckling``: nearest loads at which the tangent,
    extrapolated linearly along the stage's course, becomes singular.
    """

    kind: Literal["vibration", "buckling"]
    """``vibration`` about the present state, or linearised ``buckling``."""
    count: Annotated[int, Field(ge=1, le=100)] = 4
    """How many."""
    stage: str | None = None
    """Stage at whose load steps they are computed; all without it."""
