"""Equilibrium at a load state by the scene's solver: Newton, relaxation, or both; arc length where load control finds none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_membrane.device import runtime
from taichi_membrane.mechanics.gas import Gas, ShutChamber
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.simulation.load_state import LoadState, stage_targets
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.solver_choice import chosen_solver
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import Path, PathEnd, PathPoint, follow
from taichi_membrane.solvers.record import Progress, SolveRecord
from taichi_membrane.solvers.relaxation import Relaxation

# Residual over applied load at which a state counts as equilibrium. On the cantilever 1e-6 leaves 2e-5 of the tip deflection, 3e-6
# leaves 2e-4; single precision reaches the latter with room to spare.
_DEFAULT_TOLERANCE = {"f64": 1e-6, "f32": 3e-6}

# Newton's iterations per solve: alone; and in the hybrid, before relaxation takes over for a dose of its iterations.
_NEWTON_LIMIT, _NEWTON_PATIENCE, _DOSES = 200, 60, (500, 3000)

# Along a path residuals are compared with the loads there, which may pass through zero: with this share of the step's at least.
_LEAST_REFERENCE = 1e-3

# Stable paths that are followed after one another where each branches off the one before.
_MOST_BRANCHES = 3
# How far above the point where one branches off it is looked for, as a share of the load step.
_BEYOND_BRANCHING = 0.01

# A step this many times as long as its first tangent foretells is followed along its path. Load steps of wrinkled tubes that
# stayed on theirs were at most 4.1 times as long (up to 18 where the pressure fell), those that had passed a limit 10 to 180 times.
_FAR = 6.0

# A jump beyond a limit by less than this share of the way to it is a snap of the wrinkled mesh and no collapse.
_SNAP = 0.5

# How many nodes a step that fails names.
_WORST_NODES = 3

Report = Callable[[Progress], None] | None


@dataclass(frozen=True, eq=False)
class Reached:
    """What a step from one load state towards another came to.

    :param reached: share of the step at which the membrane now is in equilibrium; 1 when the step is done.
    :param limit: shares of the step that bracket the largest stable load, where the path has a limit.
    :param trouble: where no equilibrium was found, what was worst in the last state that was tried.
    """

    record: SolveRecord
    reached: float
    limit: tuple[float, float] | None = None
    trouble: str = ""


class Equilibrium:
    """One membrane with its solvers."""

    def __init__(self, model: Model) -> None:
        self.membrane = System(model.structure)
        self.relaxation = Relaxation(self.membrane)
        self._made: Newton | None = None
        self._settle(model)

    def take(self, model: Model) -> bool:
        """Go on with another model, at rest, in the kernels compiled for this one; False, and no change, where they do not fit."""
        fits = self.membrane.accepts(model.structure)
        if fits:
            self.membrane.upload(model.structure)
            self._settle(model)
        return fits

    def _settle(self, model: Model) -> None:
        """What the model decides and no kernel depends on."""
        self.model = model
        self.kind = chosen_solver(model).kind
        if self.kind != "relaxation":
            if self._made is None or not self._made.tangent.accepts(model.structure):
                self._made = Newton(self.membrane, self.relaxation)
            else:
                self._made.upload()
        self.newton = self._made if self.kind != "relaxation" else None
        settings = model.scene.solver
        self.gas: Gas | None = None
        self.tolerance = settings.tolerance or _DEFAULT_TOLERANCE[runtime.current().precision]

    def compile(self) -> None:
        """Compile every kernel a run needs, moving nothing; so that compile time is a figure of its own.

        Beside Newton, relaxation's wait until a step needs them.
        """
        if self.newton is None:
            self.relaxation.compile()
        else:
            self.newton.compile()
        self.membrane.out_of_balance()
        self.membrane.potential_energy(np.zeros((self.membrane.node_count, 3)))
        self.membrane.element_state()

    def apply(self, state: LoadState) -> None:
        """Set pressures, loads and prescribed displacements."""
        if self.model.motions:
            self.membrane.set_displacement(self.model.moved(self.membrane.displacement(), state.motions))
        self._press(state)

    def _press(self, state: LoadState) -> None:
        self.membrane.set_pressures(self.model.chamber_pressures(state.pressures))
        self.membrane.set_loads(self.model.nodal_loads(state.pressures, state.loads))
        if self.gas is not None:
            self.gas.settle()

    def shut(self, names: Sequence[str], state: LoadState) -> None:
        """Shut the valves of the named chambers at the present state, a load state's equilibrium, and open all others."""
        chambers = []
        for name in names:
            swept = self.membrane.swept_volumes(self.membrane.displacement())
            pressure, number = self.model.scene.pressures[name], self.model.pressure_names.index(name)
            chamber = self.model.chambers[number]
            rest_volume = chamber.volume(self.model.structure.mesh.points)
            chambers.append(
                ShutChamber(
                    number=number,
                    triangles=chamber.triangles,
                    sign=chamber.sign,
                    rest_volume=rest_volume,
                    ambient=pressure.ambient or 0.0,
                    exponent=pressure.exponent,
                    volume=rest_volume + float(chamber.sign @ swept[chamber.triangles]),
                    pressure=state.pressures[name],
                )
            )
        self.gas = Gas(self.membrane, tuple(chambers)) if chambers else None
        if self.newton is not None:
            self.newton.fill(self.gas)

    def pressures(self, state: LoadState) -> dict[str, float]:
        """The pressures of a load state; those of shut chambers as they now are."""
        if self.gas is None:
            return state.pressures
        now = self.membrane.pressures()
        shut = {self.model.pressure_names[one.number]: float(now[one.number]) for one in self.gas.chambers}
        return {**state.pressures, **shut}

    def step(self, before: LoadState, after: LoadState, report: Report) -> Reached:
        """Go from an equilibrium at ``before`` to one at ``after``, or as far as there is a stable one.

        Where no equilibrium is found the membrane is back in the state it came from.
        """
        start = self.membrane.displacement()
        record = self._solve(after, report, doses=())
        trouble = "" if record.converged else self._trouble()
        doubtful = not (record.converged and record.definite) or self._has_jumped(start)
        if self.newton is not None and before.motions == after.motions and doubtful:
            found = self.membrane.displacement() if record.converged else None
            self.membrane.set_displacement(start)
            outcome = self._along_path(self.newton, before, after, record, found, report)
            if outcome is not None:
                return outcome
            self.membrane.set_displacement(start if found is None else found)
            self.apply(after)
        if not record.converged and self.kind == "hybrid":
            self.membrane.set_displacement(start)
            record = joined(record, self._solve(after, report, doses=_DOSES))
            trouble = "" if record.converged else self._trouble()
        if not record.converged:
            self.membrane.set_displacement(start)
        return Reached(record, float(record.converged), trouble=trouble)

    def _has_jumped(self, start: Floats) -> bool:
        """Whether Newton has gone so much further than the tangent at the start foretold that the state may lie beyond a limit."""
        if self.newton is None:
            return False
        way = float(np.linalg.norm(self.membrane.displacement() - start))
        return way > _FAR * self.newton.first_step

    def _trouble(self) -> str:
        """Where the present state, which is no equilibrium, is worst: nodes out of balance and the element strained most."""
        force = np.where(self.model.structure.node_held, 0.0, self.membrane.in_frames(self.membrane.out_of_balance()))
        size = np.linalg.norm(force, axis=1)
        lost = np.flatnonzero(~np.isfinite(size))
        if lost.size:
            return f"forces at {lost.size} of {size.size} nodes are not finite, the first is node {lost[0]}"
        worst = np.argsort(-size, kind="stable")[:_WORST_NODES]
        strain = np.abs(self.membrane.element_state().strain).max(axis=1)
        return (
            f"furthest out of balance: nodes {', '.join(map(str, worst))}; "
            f"largest strain: {strain.max():.3g} in element {strain.argmax()}"
        )

    def _solve(self, state: LoadState, report: Report, doses: tuple[int, ...]) -> SolveRecord:
        """Equilibrium at a load state from the present displacements: Newton, after each dose of relaxation Newton again."""
        self.apply(state)
        reference = self.reference(state)
        limit = self.model.scene.solver.max_iterations
        if self.newton is None:
            return self._relax(reference, limit, report)
        if not doses:
            patience = min(limit, _NEWTON_LIMIT if self.kind == "newton" else _NEWTON_PATIENCE)
            return self._newton(self.newton, state, reference, patience, report)
        parts: list[SolveRecord] = []
        for dose in doses:
            parts.append(self._relax(reference, min(dose, limit), report))
            balanced = parts[-1].converged and self.gas is None  # relaxation keeps pressures as they are
            if balanced or parts[-1].reason == "not finite":
                break
            start = self.membrane.displacement()
            patience = _NEWTON_LIMIT if dose == doses[-1] else _NEWTON_PATIENCE  # nothing takes over from the last one
            parts.append(self._newton(self.newton, state, reference, patience, report))
            if parts[-1].converged:
                break
            self.membrane.set_displacement(start)
        return joined(*parts)

    def _relax(self, reference: float, limit: int, report: Report) -> SolveRecord:
        return self.relaxation.solve(tolerance=self.tolerance, reference=reference, max_iterations=limit, report=report)

    def _newton(self, newton: Newton, state: LoadState, reference: float, limit: int, report: Report) -> SolveRecord:
        return newton.solve(
            tolerance=self.tolerance,
            reference=reference,
            loads=self.model.nodal_loads(state.pressures, state.loads),
            max_iterations=limit,
            report=report,
        )

    def path(self, newton: Newton, before: LoadState, after: LoadState) -> Path:
        """The equilibrium path in the share of the way from one load state to another, by arc length."""
        least = _LEAST_REFERENCE * max(self.reference(before), self.reference(after))
        return Path(
            newton,
            apply=lambda share: self._press(before.toward(after, share)),
            reference=lambda share: max(least, self._applied(before.toward(after, share))),
            tolerance=self.tolerance,
        )

    def _along_path(
        self,
        newton: Newton,
        before: LoadState,
        after: LoadState,
        tried: SolveRecord,
        found: Floats | None,
        report: Report,
    ) -> Reached | None:
        """Where load control found no equilibrium, or one that may lie on another branch: follow the path from the last one.

        :param found: what load control found.
        :return: the state that the path leads to, or the limit before it; None where neither is better than what was found.
        """
        path = self.path(newton, before, after)
        start = path.start(self.membrane.displacement(), 0.0)
        if start is None or start.negative > 0:
            return None

        def progress(point: PathPoint) -> None:
            if report is not None:
                report(Progress(iteration=point.iterations, residual=point.residual, seconds=0.0))

        end = follow(path, start, 1.0, progress)
        parts = [tried, _walked(end)]
        reach = start.length_for(1.0)
        for _ in range(_MOST_BRANCHES):
            branch = self._branch(newton, path, end, before, after, reach)
            if branch is None:
                break
            end = follow(path, branch, 1.0, progress)
            parts.append(_walked(end))
        if end.reason == "target":
            self.membrane.set_displacement(_between(end, 1.0))
            self.apply(after)
            parts.append(self._newton(newton, after, self.reference(after), _NEWTON_PATIENCE, report))
            return Reached(joined(*parts), 1.0) if parts[-1].converged else None
        if end.reason in ("limit", "bifurcation") and end.upper is not None:
            way = float(np.linalg.norm(end.last.position - start.position))
            if found is None or float(np.linalg.norm(found - end.last.position)) > _SNAP * way:
                self.membrane.set_displacement(end.last.position)
                return Reached(joined(*parts), end.last.factor, (end.last.factor, end.upper))
        return None  # a small jump: what load control found is the stable branch

    def _branch(
        self, newton: Newton, path: Path, end: PathEnd, before: LoadState, after: LoadState, reach: float
    ) -> PathPoint | None:
        """The start of a stable path that branches off where this one has lost its stability under rising load, if there is one.

        :param reach: how far from the last stable point it may be: what lies further off is another shape, behind a collapse.
        """
        if end.reason != "bifurcation":
            return None
        assert end.beyond is not None
        factor = min(1.0, end.beyond.factor + _BEYOND_BRANCHING)
        state = before.toward(after, factor)
        self.membrane.set_displacement(end.beyond.position)
        newton.disturb()
        self._press(state)
        record = self._newton(newton, state, path.reference(factor), _NEWTON_PATIENCE, None)
        position = self.membrane.displacement()
        if not record.converged or float(np.linalg.norm(position - end.last.position)) > reach:
            return None
        point = path.start(position, factor)
        return point if point is not None and point.negative == 0 else None

    def reference(self, state: LoadState) -> float:
        """Size of the applied loads and of prestress; failing both, of the scene's largest load, or of the support forces."""
        applied = self._applied(state)
        if applied > 0.0:
            return applied
        full = max(self.model.reference_load(one.pressures, one.loads) for one in stage_targets(self.model.scene))
        return full or float(np.linalg.norm(self.membrane.out_of_balance())) or 1.0

    def _applied(self, state: LoadState) -> float:
        """Size of the applied loads and of prestress; 0 where there are none."""
        return float(np.hypot(self.model.reference_load(state.pressures, state.loads), self.membrane.prestress_norm()))


def _walked(end: PathEnd) -> SolveRecord:
    """Record of following a path. Where it loses its stability the last point before is an equilibrium that may be kept."""
    return SolveRecord(
        converged=end.reason in ("limit", "bifurcation"),
        reason=end.reason,
        iterations=end.iterations,
        residual=end.last.residual,
        seconds=0.0,
        method="arc length",
    )


def _between(end: PathEnd, factor: float) -> Floats:
    """Displacements at a load factor between the last two points of a path, by interpolation."""
    last, beyond = end.last, end.beyond
    assert beyond is not None
    share = (factor - last.factor) / (beyond.factor - last.factor)
    return last.position + share * (beyond.position - last.position)


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
