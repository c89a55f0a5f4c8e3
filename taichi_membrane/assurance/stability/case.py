"""What a stress case is, how one entry of the matrix is run, and how it is judged.

A case is swept over levels from benign to extreme, by every solver and precision. An entry is one level solved by one solver. Its
verdict: ``converged`` (and right), ``honest failure`` (the program said so, and why), or ``WRONG``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from taichi_membrane.assurance.stability.bracket import Bracket, brackets
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import Precision
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import Model, build_mesh, build_model, with_scene_groups
from taichi_membrane.simulation.results import StepResult
from taichi_membrane.solvers.record import force_now

Floats = NDArray[np.float64]
Solver = Literal["newton", "hybrid", "relaxation"]
Measured = Callable[[Mesh, Sequence[StepResult]], Mapping[str, float]]

CONVERGED, HONEST, WRONG = "converged", "honest failure", "WRONG"

# Limits of the default set, the same for all cases: a sweep of relaxations must end. ``full`` leaves the program its own.
LIMITS = {"max_iterations": 10_000, "max_cuts": 1}
# A residual taken again from the state may differ from the solver's own by its rounding: in single precision by as much again.
_RESIDUAL_MARGIN = 2.0
# A state is checked by letting Newton go on to this share of the tolerance.
_POLISH, _POLISH_ITERATIONS = 1e-3, 30
# Central differences with step 1 are stable while the largest eigenvalue of M⁻¹ K is at most 4.
STABLE_EIGENVALUE = 4.0
_EIGENVALUE_MARGIN = 1e-6  # what the Lanczos iteration leaves
_EIGENVALUE_ACCURACY = 1e-8


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One level of a case, as data.

    :param scene: a scene without name, units and solver.
    :param mesh: for a scene whose mesh is ``given``.
    :param start: (n, 3) displacements to start from; None for the unstressed shape.
    :param measure: dimensionless numbers of a finished run; one called ``drift`` is reported as such.
    :param exact: what they should be, where that is known.
    :param collapse: largest stable values, by ``load.NAME`` or ``pressure.NAME``, where they are known: a bracket has to hold them.
    """

    scene: Mapping[str, Any]
    measure: Measured
    mesh: Mesh | None = None
    start: Floats | None = None
    exact: Mapping[str, float] = field(default_factory=dict)
    collapse: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A parameter swept from benign to extreme, with what the answers are held against.

    :param parameter: what the levels are values of.
    :param levels: from benign to extreme; ``more_levels`` follow with ``--full``.
    :param against: ``exact`` (the problem's numbers), ``base`` (the same solver's numbers at ``levels[0]``: an invariance), or
        ``peers`` (the other double-precision solvers at this level, the one that comes nearest).
    :param source: of the reference.
    :param bound: largest error allowed, relative to the reference or to ``floor``, whichever is larger.
    :param required: the level up to which the default solver has to be safe.
    :param known: by solver and precision, the level from which on it is known to be wrong; ``remark`` says why.
    """

    name: str
    theme: str
    title: str
    setting: str
    parameter: str
    levels: tuple[float, ...]
    problem: Callable[[float], Problem]
    against: Literal["exact", "base", "peers"]
    source: str
    bound: float
    required: float
    more_levels: tuple[float, ...] = ()
    floor: float = 0.0
    known: Mapping[str, float] = field(default_factory=dict)
    remark: str = ""

    def swept(self, *, full: bool) -> tuple[float, ...]:
        """The levels of a set."""
        return self.levels + (self.more_levels if full else ())


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What one solver made of one level.

    :param finite: no number that left the program is NaN or infinite.
    :param residual: of the state that is returned, taken anew; None where nothing is applied that it could be compared with.
    :param tolerance: the residual that counts as equilibrium.
    :param kept: the state returned is an equilibrium, or the one the run started from.
    :param strain: largest principal strain in size.
    :param eigenvalue: largest eigenvalue of M⁻¹ K in that state; None where the tangent is not at hand.
    :param moved: how far Newton, asked for a thousandth of the residual, moves the state: largest change over largest displacement;
        None where it cannot be asked.
    :param brackets: of the largest stable load, where the run says that there is one.
    """

    case: str
    level: float
    solver: Solver
    precision: Precision
    converged: bool
    reason: str
    finite: bool
    iterations: int
    seconds: float
    residual: float | None
    tolerance: float
    kept: bool
    strain: float
    energy: float | None
    eigenvalue: float | None
    moved: float | None
    values: dict[str, float]
    exact: dict[str, float]
    brackets: tuple[Bracket, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Judged:
    """An entry with its verdict.

    :param error: largest error of its numbers against the reference; None where there is no reference or no equilibrium.
    :param why: what is wrong, or why there is no equilibrium, or a remark on one that is right.
    :param known: it is wrong, and documented to be.
    """

    entry: Entry
    verdict: str
    error: float | None
    why: str
    known: bool = False


class Bench:
    """Runs problems of one precision in this process; keeps what was compiled for the problems that fit it."""

    def __init__(self, precision: Precision, *, full: bool = False, threads: int | None = None) -> None:
        from taichi_membrane.device import runtime

        self.precision = runtime.start(precision=precision, threads=threads).precision
        self.limits = {} if full else LIMITS
        self._compiled: list[Any] = []

    def run(self, case: Sweep, level: float, solver: Solver) -> Entry:
        """Solve one level of a case with one solver."""
        problem = case.problem(level)
        started = time.perf_counter()
        entry = Entry(
            case=case.name, level=level, solver=solver, precision=self.precision, converged=False, reason="", finite=True,
            iterations=0, seconds=0.0, residual=None, tolerance=0.0, kept=True, strain=0.0, energy=None, eigenvalue=None,
            moved=None, values={}, exact=dict(problem.exact),
        )  # fmt: skip
        try:
            model = self._model(problem, solver)
        except InputError as error:
            return replace(entry, reason=f"refused: {error}")
        work = self._taken(model)
        if problem.start is not None:
            work.system.set_displacement(problem.start)
        started = time.perf_counter()
        steps = list(work.steps())
        entry = replace(entry, seconds=time.perf_counter() - started, converged=work.outcome == "finished")
        entry = _with_findings(entry, problem, work, steps)
        if self.precision == "f64" and entry.finite:
            entry = _with_tangent(entry, work, _as_hybrid(model), steps[-1])
        return entry

    def _model(self, problem: Problem, solver: Solver) -> Model:
        settings = {**self.limits, **problem.scene.get("solver", {}), "kind": solver}
        scene = Scene.model_validate(
            {"name": "case", "units": {"length": "m", "force": "N"}, **problem.scene, "solver": settings}
        )
        mesh = build_mesh(scene) if problem.mesh is None else with_scene_groups(scene, problem.mesh)
        return build_model(scene, mesh)

    def _taken(self, model: Model) -> Any:
        """An analysis of the model, in kernels that are compiled already if they fit."""
        from taichi_membrane.simulation.analysis import Analysis

        for work in reversed(self._compiled):
            if work.take(model):
                return work
        work = Analysis(_as_hybrid(model))  # with the kernels of all solvers, so that times do not count compilation
        work.compile()
        work.take(model)
        self._compiled.append(work)
        return work


def _with_findings(entry: Entry, problem: Problem, work: Any, steps: Sequence[StepResult]) -> Entry:
    """Fill in what the run left: the last step's record, and numbers taken anew from the state the membrane is in."""
    last = steps[-1]
    model = work.model
    scale = math.hypot(model.reference_load(LoadState(last.drivers)), work.system.self_stress_norm())
    force = work.system.in_frames(work.system.out_of_balance())
    size = float(np.linalg.norm(np.where(model.structure.node_held, 0.0, force)))
    residual = size / scale if scale > 0.0 else None
    moved = len(steps) > 1 or any(last.drivers.values())
    values = dict(problem.measure(model.structure.mesh, steps)) if entry.converged else {}
    numbers: list[Any] = [
        last.displacement,
        last.reaction,
        last.elements.strain,
        last.elements.stress,
        last.volume,
        size,
    ]
    finite = all(np.isfinite(one).all() for one in numbers)
    finite = finite and all(map(math.isfinite, [*values.values(), *last.probes.values()]))
    if last.energy is not None and not math.isfinite(last.energy):
        finite = False
    warp, weft, shear = last.elements.strain.T
    half = np.hypot(0.5 * (warp - weft), 0.5 * shear)
    return replace(
        entry,
        reason=last.reason,
        finite=finite,
        iterations=sum(step.iterations for step in steps),
        residual=residual,
        tolerance=work.equilibrium.tolerance,
        kept=not moved or residual is None or residual <= _RESIDUAL_MARGIN * work.equilibrium.tolerance,
        strain=float((np.abs(0.5 * (warp + weft)) + half).max()),
        energy=last.energy,
        values=values,
        brackets=brackets(model.scene, last, problem.collapse),
    )


def _as_hybrid(model: Model) -> Model:
    """The same model solved by the hybrid."""
    solver = model.scene.solver.model_copy(update={"kind": "hybrid"})
    return replace(model, scene=model.scene.model_copy(update={"solver": solver}))


def _with_tangent(entry: Entry, work: Any, model: Model, last: StepResult) -> Entry:
    """Fill in what takes a tangent, whatever solver found the state."""
    work.take(model)
    work.system.set_displacement(last.displacement)
    state = LoadState(last.drivers)
    work.equilibrium.apply(state)
    eigenvalue = largest_eigenvalue(work)
    asked = entry.converged and entry.residual is not None
    moved = _moved_by_newton(work, last, force_now(work.equilibrium.reference(state))) if asked else None
    return replace(entry, eigenvalue=eigenvalue, moved=moved)


def _moved_by_newton(work: Any, last: StepResult, scale: float) -> float:
    """How far the state is from where a much smaller residual would put it; changes the membrane's displacements."""
    loads = work.model.nodal_loads(LoadState(last.drivers))
    work.newton.solve(
        tolerance=_POLISH * work.equilibrium.tolerance, reference=scale, loads=loads, max_iterations=_POLISH_ITERATIONS
    )
    change = np.abs(work.system.displacement() - last.displacement).max()
    return float(change / max(np.abs(last.displacement).max(), np.finfo(float).tiny))


def largest_eigenvalue(work: Any) -> float:
    """Largest eigenvalue of M⁻¹ K at an analysis' present state, double precision."""
    stiffness = work.newton.tangent.matrix()
    free = (~work.model.structure.node_held).ravel()
    root = np.where(
        free, 1.0 / np.sqrt(np.repeat(work.relaxation.masses(), 3)), 0.0
    )  # held components count as no stiffness
    scaled = sparse.diags(root) @ stiffness @ sparse.diags(root)
    if not scaled.count_nonzero():
        return 0.0  # all slack, without pressure
    start = np.random.default_rng(0).standard_normal(len(root))  # fixed: tables repeat
    return float(
        linalg.eigsh(scaled, k=1, which="LA", v0=start, tol=_EIGENVALUE_ACCURACY, return_eigenvectors=False)[0]
    )


def judge(case: Sweep, entries: Sequence[Entry]) -> list[Judged]:
    """Verdicts on all entries of a case, of any solvers and precisions."""
    return [_verdict(case, entry, entries) for entry in entries]


def _references(case: Sweep, entry: Entry, entries: Sequence[Entry]) -> list[Mapping[str, float]]:
    """What the entry's numbers may agree with; empty where there is nothing."""
    if case.against == "exact":
        return [entry.exact]
    found = [other for other in entries if other.converged and other.finite]
    if case.against == "base":
        same = [one for one in found if (one.solver, one.precision) == (entry.solver, entry.precision)]
        return [one.values for one in same if one.level == case.levels[0]]
    peers = [one for one in found if one.level == entry.level and one.precision == "f64" and one is not entry]
    # Newton and hybrid often take the same path: agreement with the other method says more.
    others = [one for one in peers if (one.solver == "relaxation") != (entry.solver == "relaxation")]
    return [one.values for one in others or peers]


def _verdict(case: Sweep, entry: Entry, entries: Sequence[Entry]) -> Judged:
    error = None
    references = _references(case, entry, entries)
    if entry.converged and references:
        error = min(
            max(abs(entry.values[name] - one) / max(abs(one), case.floor) for name, one in reference.items())
            for reference in references
        )
    wrong = _what_is_wrong(case, entry, error)
    if wrong:
        from_level = case.known.get(f"{entry.solver} {entry.precision}")
        levels = case.levels + case.more_levels
        known = from_level is not None and levels.index(entry.level) >= levels.index(from_level)
        return Judged(entry=entry, verdict=WRONG, error=error, why=wrong, known=known)
    if not entry.converged:
        return Judged(entry=entry, verdict=HONEST, error=None, why=entry.reason)
    other = error is not None and error > case.bound
    return Judged(
        entry=entry, verdict=CONVERGED, error=error, why="another equilibrium than the other solvers'" if other else ""
    )


def _what_is_wrong(case: Sweep, entry: Entry, error: float | None) -> str:
    """Why an entry is a fault of the program; empty when it is not."""
    if not entry.finite:
        return "a number that is not finite left the program"
    if entry.eigenvalue is not None and entry.eigenvalue > STABLE_EIGENVALUE * (1.0 + _EIGENVALUE_MARGIN):
        return (
            f"the fictitious masses do not bound the stiffness: largest eigenvalue of M⁻¹K {entry.eigenvalue:.4g} > 4"
        )
    for bracket in entry.brackets:
        if said := bracket.wrong():
            return said
    if not entry.converged:
        if not entry.reason:
            return "no equilibrium, and no reason given"
        return "" if entry.kept else f"the state kept is no equilibrium: residual {entry.residual:.1e}"
    if entry.residual is not None and entry.residual > _RESIDUAL_MARGIN * entry.tolerance:
        return f"said to be converged, but its residual is {entry.residual:.1e}"
    if error is not None and not error <= case.bound and not _of_its_own(case, entry):
        return f"said to be converged, but {error:.2e} from the reference, {case.bound:g} allowed"
    return ""


def _of_its_own(case: Sweep, entry: Entry) -> bool:
    """Whether a state that differs from the peers' is an equilibrium that a much smaller residual confirms."""
    return case.against == "peers" and entry.moved is not None and entry.moved <= case.bound


@dataclass(frozen=True, kw_only=True)
class Border:
    """How far a sweep went well.

    :param safe: last level before the first that is not right; None when that is the first one.
    :param breaks: the level at which it gives way, ``why`` for what reason; None when it does not.
    """

    safe: float | None
    breaks: float | None
    why: str


def border(levels: Sequence[float], judged: Sequence[Judged]) -> Border:
    """The border of the safe region of one sweep: the entries of one case, solver and precision."""
    by_level = {one.entry.level: one for one in judged}
    safe = None
    for level in levels:
        one = by_level.get(level)
        if one is None or one.verdict != CONVERGED:
            return Border(safe=safe, breaks=level, why="not run" if one is None else one.why)
        safe = level
    return Border(safe=safe, breaks=None, why="")
