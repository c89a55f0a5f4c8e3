"""Frozen records of what a run found; NumPy only, double precision, in the scene's units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import fields
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import SLACK, TAUT, WRINKLED, Arch, EstimatedSteps, Outcome, Precision, Verdict
from taichi_membrane.scene import Case, Scene
from taichi_membrane.simulation.accuracy import Adaption, Cascade, Estimate, Layer
from taichi_membrane.simulation.load_state import of_kind
from taichi_membrane.simulation.policy import Trace
from taichi_membrane.simulation.state import State

Floats = NDArray[np.float64]

_STABILITY = {True: "stable", False: "unstable", None: "stability not known"}


FieldValues = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class ElementFields:
    """What each triangle does: the element fields of :data:`taichi_membrane.fields.FIELDS` as attributes, such as ``major_stress``.

    :param values: arrays by name.
    """

    values: FieldValues

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name == "values" or name not in self.values:  # the former while a copy is made
            raise AttributeError(f"no element field {name!r}")
        return self.values[name]

    def __repr__(self) -> str:
        """The names alone."""
        return f"ElementFields({', '.join(self.values)})"

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
    :param missing: why there are fewer than the scene asks for; empty where there are not.
    """

    kind: Literal["vibration", "buckling"]
    values: tuple[float, ...]
    shapes: Floats
    missing: str = ""


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """One load step.

    :param number: 0, 1, … over the whole run; ``stage_step`` counts 1, 2, … within ``stage``.
    :param drivers: value of each pressure, factor of each load and motion, by names such as ``load.tip``; ``pressures``, ``loads``
        and ``motions`` are those of one kind by their bare names.
    :param fields: the values of every field of :data:`taichi_membrane.fields.FIELDS` by name; see there for shapes and units.
    :param volume: enclosed volume of a closed body, else the volume swept since rest.
    :param energy: potential energy (strain energy less work of pressures and loads); None under a law without energy, and
        where a pressure has no potential.
    :param converged: False marks a state that is *not* an equilibrium; ``reason`` says why.
    :param cuts: how often the step had to be halved.
    :param negative_pivots: negative eigenvalues of the tangent stiffness, 0 for a stable equilibrium; None where no tangent is
        used. Where pressure has no potential, negative real ones, as far as they are found: 0 means no divergence, and
        ``unknown["stable"]`` says what that leaves open.
    :param limit: where the step met collapse, bounds of each pressure and load (``load.tip``) at the largest stable load; the
        step's own state is the equilibrium at the lower one.
    :param trace: what the step went through, each passage at a share of the stage's course.
    :param unknown: why there is no value of ``stable``, ``derivatives``, ``modes`` or ``limit``, of those that have none.
    :param state: what it hands to the next step: the run goes on from it.
    :param walls: of walls that touch each other, how many ``searches`` for pairs and ``patterns`` of the matrix the step took, and
        how many sides of elements pass through others at its end, ``crossings``: facets of round walls do by a little.
    :param contact_forces: sum of the sizes of the nodal forces of each plane and obstacle.
    :param balance: resultants of what acts, which cancel: dead ``loads``, those on the ``surface``, ``reactions`` of supports,
        motions and springs, and ``contact`` where there are obstacles. ``imbalance`` is the size of their sum over the largest of
        the sums of the sizes of the forces that each consists of.
    :param relieved: amount of gas that the relief valve of each chamber let out in the step, of those that opened, by the name of
        its pressure, of joined chambers the first one's.
    """

    number: int
    stage: str
    stage_step: int
    drivers: Mapping[str, float]
    fields: FieldValues
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
    state: State
    seconds: float
    unknown: Mapping[str, str] = field(default_factory=dict)
    trace: Trace = ()
    contact_forces: dict[str, float] = field(default_factory=dict)
    balance: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    imbalance: float = 0.0
    walls: dict[str, int] = field(default_factory=dict)
    relieved: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        """One line: arrays stay in ``fields``."""
        state = f"not converged, {self.reason}" if not self.converged else f"converged, {_STABILITY[self.stable]}"
        values = "".join(f", {name} = {value:.6g}" for name, value in self.probes.items())
        return f"StepResult({self.stage} {self.stage_step}: {state}{values})"

    @property
    def stable(self) -> bool | None:
        """Whether the equilibrium is stable; None where nothing is known of it, and ``unknown`` says why."""
        return None if self.negative_pivots is None or "stable" in self.unknown else self.negative_pivots == 0

    def quantity(self, name: str) -> float:
        """What a curve plots: a probe, ``volume``, ``pressure`` (the first) or a driver such as ``load.tip``."""
        if name in self.probes:
            return self.probes[name]
        if name == "volume":
            return self.volume
        return next(iter(self.pressures.values())) if name == "pressure" else self.drivers[name]

    @property
    def pressures(self) -> dict[str, float]:
        """Value of each pressure."""
        return of_kind(self.drivers, "pressure")

    @property
    def loads(self) -> dict[str, float]:
        """Factor of each load."""
        return of_kind(self.drivers, "load")

    @property
    def motions(self) -> dict[str, float]:
        """Factor of each motion."""
        return of_kind(self.drivers, "motion")

    @property
    def displacement(self) -> Floats:
        """(n, 3) nodal displacements."""
        return self.fields["displacement"]

    @property
    def reaction(self) -> Floats:
        """(n, 3) support forces, those of springs to the ground among them; zero where neither is."""
        return self.fields["reaction"]

    @property
    def cable_forces(self) -> Floats:
        """(cable_count,) force of each straight piece of a cable, tension positive: in the scene's order, those that slide last."""
        return self.fields["cable_force"]

    @property
    def elements(self) -> ElementFields:
        """What each triangle does."""
        held = fields.of(self.fields.keys())
        return ElementFields({one.name: self.fields[one.name] for one in held if one.place == "element"})


# A probe of one's own: from the mesh and the load step, all else measured, a number.
ProbeFunction = Callable[[Mesh, StepResult], float]


@dataclass(frozen=True, kw_only=True)
class CheckResult:
    """A check of the scene: a probe's value against a reference, or within bounds.

    :param reference: None where bounds are given: ``at_most``, ``at_least`` or both.
    :param error: relative or absolute as the tolerance is; of bounds by how much the worse one is passed, below zero within.
    """

    probe: str
    stage: str
    step: int
    value: float | None
    reference: float | None
    error: float | None
    tolerance: float
    relative: bool
    source: str
    passed: bool
    at_most: float | None = None
    at_least: float | None = None


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """A load case.

    :param after: stage at whose end it starts.
    :param reason: why its loads are not reached; empty where they are.
    :param steps: its load steps, as far as it came.
    """

    name: str
    title: str
    after: str
    verdict: Verdict
    reason: str
    steps: tuple[StepResult, ...]

    @property
    def reached(self) -> bool:
        """Whether its loads are reached, and its state is not known to be unstable: only then it has numbers."""
        return self.verdict == "reached"

    @property
    def end(self) -> StepResult | None:
        """The state under all of its loads; None where that is not reached."""
        return self.steps[-1] if self.reached else None


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run is asked for beside its scene; see :func:`taichi_membrane.run`."""

    arch: Arch = "cpu"
    precision: Precision = "f64"
    threads: int | None = None
    render: bool = True
    estimate: EstimatedSteps = ""
    cascade: int = 0


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """A finished run.

    :param seconds: time per phase: ``setup``, ``compile``, ``solve``, ``output``, ``render``.
    :param provenance: versions, back end and precision that really ran.
    :param outcome: how the run ended.
    :param layers: of all lines beside which the wall is disturbed, how long boundary layers are and whether the mesh resolves them.
    :param estimate: errors of probes, where they were asked for and the stages came to an end.
    :param adaption: what the mesh was refined for, and what became of it, where the scene asks for that.
    :param cascade: how the run came from coarse meshes to its own, where that was asked for.
    :param directory: where files were written; None when none were.
    """

    scene: Scene
    mesh: Mesh
    steps: tuple[StepResult, ...]
    checks: tuple[CheckResult, ...]
    seconds: dict[str, float]
    provenance: dict[str, Any]
    outcome: Outcome = "interrupted"
    layers: tuple[Layer, ...] = ()
    estimate: Estimate | None = None
    adaption: Adaption | None = None
    cascade: Cascade | None = None
    directory: Path | None = None
    files: tuple[Path, ...] = field(default=())

    def __repr__(self) -> str:
        """One line."""
        checks = f", {sum(one.passed for one in self.checks)} of {len(self.checks)} checks hold" if self.checks else ""
        return f"RunResult({self.scene.name}: {self.outcome}, {len(self.steps)} load steps, {self.mesh.tri_count} elements{checks})"

    def table(self) -> Any:
        """The load steps as a pandas data frame: stage, drivers and probes by name, verdicts.

        :raises InputError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise InputError("table needs pandas: install 'taichi-membrane[notebook]'") from None
        rows = [
            {
                "stage": step.stage, "stage_step": step.stage_step, **step.drivers, **step.probes, "converged": step.converged,
                "stable": step.stable, "iterations": step.iterations, "residual": step.residual,
            }
            for step in self.steps
        ]  # fmt: skip
        return pandas.DataFrame(rows, index=pandas.Index([step.number for step in self.steps], name="step"))

    @property
    def converged(self) -> bool:
        """True when every stage and case of the scene was run to its end and every load step converged."""
        return self.outcome == "finished" and all(case.reached for case in self.cases.values())

    @property
    def stage_steps(self) -> tuple[StepResult, ...]:
        """The load steps of the stages, without those of cases, which come after them."""
        named = {case.name for case in self.scene.cases}
        return tuple(step for step in self.steps if step.stage not in named)

    @property
    def cases(self) -> dict[str, CaseResult]:
        """The load cases by their names, in the scene's order."""
        return {case.name: self._case(case) for case in self.scene.cases}

    def _case(self, case: Case) -> CaseResult:
        after = self.scene.start_of(case)
        steps = tuple(step for step in self.steps if step.stage == case.name)
        verdict, reason = _verdict(case, steps, self.outcome, after)
        return CaseResult(name=case.name, title=case.title, after=after, verdict=verdict, reason=reason, steps=steps)

    def start(self, name: str) -> StepResult | None:
        """The load step that a stage or case starts from; None where that is the unstressed shape, or was not reached."""
        before = self.scene.before(self.scene.ramp(name))
        found = [step for step in self.steps if before and step.stage == before[-1].name and step.converged]
        return found[-1] if found else None

    @property
    def passed(self) -> bool:
        """True when every check of the scene holds, and a mesh that is refined for a probe's error meets its tolerance."""
        return all(check.passed for check in self.checks) and (self.adaption is None or self.adaption.reached)

    def probe(self, name: str) -> Floats:
        """A probe's value at every load step."""
        return np.array([step.probes[name] for step in self.steps])


def _verdict(case: Case, steps: Sequence[StepResult], outcome: Outcome, after: str) -> tuple[Verdict, str]:
    """What became of a case, and why where its loads are not reached."""
    if not steps and outcome == "interrupted":
        return "interrupted", "the run was stopped before it"
    if not steps:
        return "not started", f"stage {after}, from whose end it starts, did not come to it"
    last = steps[-1]
    if not last.converged:
        return "not converged", last.reason
    if last.limit is not None:
        return "collapse", last.reason.removeprefix("collapse: ")
    if last.stage_step < case.steps:
        return "interrupted", f"the run was stopped after {last.stage_step} of {case.steps} load steps"
    if last.stable is False:
        return "unstable", f"its state is unstable ({last.negative_pivots} negative eigenvalues of the tangent)"
    return "reached", ""
