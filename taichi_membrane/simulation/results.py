"""Frozen records of what a run found; NumPy only, double precision, in the scene's units."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh
from taichi_membrane.names import SLACK, TAUT, WRINKLED, Arch, Outcome, Precision
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.policy import Trace
from taichi_membrane.solvers.record import ElementState

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ElementFields(ElementState):
    """What each triangle does; (m,) arrays unless said otherwise.

    :param major_stress: major principal stress; ``minor_stress`` the other one.
    :param major_direction: (m, 3) unit vector of the major stress on the deformed element; wrinkles run along it.
    """

    major_stress: Floats
    minor_stress: Floats
    major_direction: Floats

    def count(self) -> dict[str, int]:
        """Numbers of taut, wrinkled and slack elements."""
        numbers = np.bincount(self.state, minlength=3)
        return {"taut": int(numbers[TAUT]), "wrinkled": int(numbers[WRINKLED]), "slack": int(numbers[SLACK])}


@dataclass(frozen=True, kw_only=True)
class ModeResult:
    """Modes of a structure at rest.

    :param kind: ``vibration``, with frequencies as values (one over the time unit in which density is given; negative: growth of an
        unstable mode), or ``buckling``, with the share of the stage at which the extrapolated tangent becomes singular.
    :param values: in the order of importance: lowest frequency, or nearest buckling load, first.
    :param shapes: (len(values), n, 3) displacements, the largest of each being 1.
    """

    kind: Literal["vibration", "buckling"]
    values: tuple[float, ...]
    shapes: Floats


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """One load step.

    :param number: 0, 1, … over the whole run; ``stage_step`` counts 1, 2, … within ``stage``.
    :param pressures: each pressure's value; ``loads`` and ``motions`` each one's factor.
    :param displacement: (n, 3) nodal displacements; ``reaction`` (n, 3) support forces, zero at free components.
    :param volume: enclosed volume of a closed body, else the volume swept since rest.
    :param energy: potential energy (strain energy less work of pressures and loads); None under a law without energy, and
        where a pressure has no potential.
    :param converged: False marks a state that is *not* an equilibrium; ``reason`` says why.
    :param cuts: how often the step had to be halved.
    :param negative_pivots: negative eigenvalues of the tangent stiffness, 0 for a stable equilibrium; None where no tangent is
        used.
    :param limit: where the step met collapse, bounds of each pressure and load (``load.tip``) at the largest stable load; the
        step's own state is the equilibrium at the lower one.
    :param trace: what the step went through, each passage at a share of the stage's course.
    :param stiffest: largest current stiffness of the course so far, in the units of :class:`~.load_step.Stiffest`; the next step
        needs it.
    :param derivatives: of each probe asked for, with respect to ``load.NAME``, ``pressure.NAME`` and ``thickness[.GROUP]``.
    :param cable_forces: (cable_count,) force of each cable element, in the scene's order, tension positive; not in a run's files.
    :param contact_forces: sum of the forces of each plane on the structure along its normal; not in a run's files.
    """

    number: int
    stage: str
    stage_step: int
    pressures: dict[str, float]
    loads: dict[str, float]
    motions: dict[str, float]
    displacement: Floats
    reaction: Floats
    elements: ElementFields
    probes: dict[str, float]
    volume: float
    energy: float | None
    solver: str
    converged: bool
    reason: str
    iterations: int
    residual: float
    cuts: int
    negative_pivots: int | None
    limit: dict[str, tuple[float, float]] | None
    derivatives: dict[str, dict[str, float]]
    modes: ModeResult | None
    seconds: float
    trace: Trace = ()
    stiffest: float = 0.0
    cable_forces: Floats = field(default_factory=lambda: np.zeros(0))
    contact_forces: dict[str, float] = field(default_factory=dict)

    @property
    def stable(self) -> bool | None:
        """Whether the equilibrium is stable; None where nothing is known of it."""
        return None if self.negative_pivots is None else self.negative_pivots == 0


@dataclass(frozen=True, kw_only=True)
class CheckResult:
    """A check of the scene: probe value against reference; ``error`` relative or absolute as the tolerance is."""

    probe: str
    stage: str
    step: int
    value: float | None
    reference: float
    error: float | None
    tolerance: float
    relative: bool
    source: str
    passed: bool


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run is asked for beside its scene; see :func:`taichi_membrane.run`."""

    arch: Arch = "cpu"
    precision: Precision = "f64"
    threads: int | None = None


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """A finished run.

    :param seconds: time per phase: ``setup``, ``compile``, ``solve``, ``output``, ``render``.
    :param provenance: versions, back end and precision that really ran.
    :param outcome: how the run ended.
    :param directory: where files were written; None when none were.
    """

    scene: Scene
    mesh: Mesh
    steps: tuple[StepResult, ...]
    checks: tuple[CheckResult, ...]
    seconds: dict[str, float]
    provenance: dict[str, Any]
    outcome: Outcome = "interrupted"
    directory: Path | None = None
    files: tuple[Path, ...] = field(default=())

    @property
    def converged(self) -> bool:
        """True when every stage of the scene was run to its end and every load step converged."""
        return self.outcome == "finished"

    @property
    def passed(self) -> bool:
        """True when every check of the scene holds."""
        return all(check.passed for check in self.checks)

    def probe(self, name: str) -> Floats:
        """A probe's value at every load step."""
        return np.array([step.probes[name] for step in self.steps])
