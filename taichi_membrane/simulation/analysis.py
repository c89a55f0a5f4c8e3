"""Stages and load steps: ramp pressures and loads, solve, halve a step that fails, yield step results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from taichi_membrane.engine import runtime
from taichi_membrane.engine.membrane import ElementState, Membrane
from taichi_membrane.engine.newton import Newton
from taichi_membrane.engine.preparation import Floats
from taichi_membrane.engine.record import Progress, SolveRecord
from taichi_membrane.engine.relaxation import Relaxation
from taichi_membrane.errors import InputError
from taichi_membrane.scene import Scene, Stage
from taichi_membrane.simulation import probes
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.results import ElementFields, StepResult

# Residual over applied load at which a state counts as equilibrium. On the cantilever 1e-6 leaves 2e-5 of the tip deflection, 3e-6
# leaves 2e-4; single precision reaches the latter with room to spare.
_DEFAULT_TOLERANCE = {"f64": 1e-6, "f32": 3e-6}

# Newton's iterations per solve: alone; and in the hybrid, before relaxation takes over for a dose of its iterations.
_NEWTON_LIMIT, _NEWTON_PATIENCE, _DOSES = 200, 60, (500, 3000)

ProgressCallback = Callable[[str, int, int, Progress], None]


@dataclass(frozen=True)
class _LoadState:
    """Values of all pressures, load factors and motion factors at one instant."""

    pressures: dict[str, float]
    loads: dict[str, float]
    motions: dict[str, float]

    def toward(self, other: _LoadState, fraction: float) -> _LoadState:
        """The state at a fraction (0 to 1) of the way to another one; exactly the other one at 1."""
        if fraction == 1.0:
            return other

        def mix(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
            return {name: a[name] + fraction * (b[name] - a[name]) for name in a}

        return _LoadState(
            mix(self.pressures, other.pressures), mix(self.loads, other.loads), mix(self.motions, other.motions)
        )


class Analysis:
    """Runs the stages of a model on one membrane, step by step."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.membrane = Membrane(model.structure)
        self.relaxation = Relaxation(self.membrane)
        self.kind = solver_kind(model)
        self.newton = Newton(self.membrane, self.relaxation) if self.kind != "relaxation" else None
        settings = model.scene.solver
        self.tolerance = settings.tolerance or _DEFAULT_TOLERANCE[runtime.current().precision]
        mesh = model.structure.mesh
        self._rest_volume = mesh.enclosed_volume() if mesh.is_closed else 0.0
        self._has_energy = all(fabric.law != "clip" for fabric in model.structure.fabrics)

    def compile(self) -> None:
        """Compile every kernel a run needs, moving nothing; so that compile time is a figure of its own."""
        self.relaxation.compile()
        if self.newton is not None:
            self.newton.compile()
        self.membrane.out_of_balance()
        self.membrane.potential_energy(np.zeros((self.membrane.node_count, 3)))
        self.membrane.element_state()

    def steps(self, progress: ProgressCallback | None = None) -> Iterator[StepResult]:
        """Yield each load step as it is done; stop after the first that does not converge."""
        scene = self.model.scene
        state = _unloaded(scene)
        number = 0
        for stage in scene.stages:
            start, target = state, _stage_target(state, stage)
            for k in range(1, stage.steps + 1):
                following = start.toward(target, k / stage.steps)
                result = self._step(number, stage, k, state, following, progress)
                yield result
                if not result.converged:
                    return
                state = following
                number += 1

    def _step(
        self,
        number: int,
        stage: Stage,
        k: int,
        before: _LoadState,
        after: _LoadState,
        progress: ProgressCallback | None,
    ) -> StepResult:
        """One load step, halved as often as allowed while it fails; a failed one keeps the last equilibrium it reached."""
        started = time.perf_counter()
        report = None if progress is None else lambda p: progress(stage.name, k, stage.steps, p)
        reached, size, cuts, iterations = 0.0, 1.0, 0, 0
        good = self.membrane.displacement()
        while True:
            aim = min(1.0, reached + size)
            record = self._solve(before.toward(after, aim), report)
            iterations += record.iterations
            if record.converged:
                good, reached = self.membrane.displacement(), aim
                if reached == 1.0:
                    break
            else:
                self.membrane.set_displacement(good)
                if cuts == self.model.scene.solver.max_cuts:
                    break
                cuts, size = cuts + 1, 0.5 * size
        if not record.converged:
            reason = (
                f"no equilibrium found between {100 * reached:.4g} and {100 * aim:.4g} % of the step "
                f"({record.reason}, {cuts} halvings): collapse or snap-through; the last equilibrium is kept"
            )
            record = replace(record, reason=reason)
        return self._result(number, stage, k, before.toward(after, reached), record, iterations, cuts, started)

    def _solve(self, state: _LoadState, report: Callable[[Progress], None] | None) -> SolveRecord:
        """Find equilibrium at a load state, from the present displacements, by the scene's solver."""
        self._apply(state)
        reference = self._reference(state)
        limit = self.model.scene.solver.max_iterations
        if self.newton is None:
            return self._relax(reference, limit, report)
        loads = self.model.nodal_loads(state.pressures, state.loads)
        if self.kind == "newton":
            return self._newton(self.newton, reference, loads, min(limit, _NEWTON_LIMIT), report)
        return self._alternate(self.newton, reference, loads, limit, report)

    def _relax(self, reference: float, limit: int, report: Callable[[Progress], None] | None) -> SolveRecord:
        return self.relaxation.solve(tolerance=self.tolerance, reference=reference, max_iterations=limit, report=report)

    def _newton(
        self, newton: Newton, reference: float, loads: Floats, limit: int, report: Callable[[Progress], None] | None
    ) -> SolveRecord:
        return newton.solve(
            tolerance=self.tolerance, reference=reference, loads=loads, max_iterations=limit, report=report
        )

    def _alternate(
        self, newton: Newton, reference: float, loads: Floats, limit: int, report: Callable[[Progress], None] | None
    ) -> SolveRecord:
        """The hybrid: Newton while it gets on, relaxation in growing doses where it does not."""
        start = self.membrane.displacement()
        parts = [self._newton(newton, reference, loads, _NEWTON_PATIENCE, report)]
        for dose in _DOSES:
            if parts[-1].converged:
                break
            self.membrane.set_displacement(start)
            parts.append(self._relax(reference, min(dose, limit), report))
            if parts[-1].converged or parts[-1].reason == "not finite":
                break
            start = self.membrane.displacement()
            parts.append(self._newton(newton, reference, loads, _NEWTON_PATIENCE, report))
        last = parts[-1]
        return replace(
            last,
            method=" + ".join(f"{part.method} {part.iterations}" for part in parts) if len(parts) > 1 else last.method,
            iterations=sum(part.iterations for part in parts),
            seconds=sum(part.seconds for part in parts),
        )

    def _apply(self, state: _LoadState) -> None:
        self.membrane.set_pressures(self.model.chamber_pressures(state.pressures))
        self.membrane.set_loads(self.model.nodal_loads(state.pressures, state.loads))
        if self.model.motions:
            self.membrane.set_displacement(self.model.moved(self.membrane.displacement(), state.motions))

    def _reference(self, state: _LoadState) -> float:
        """Size of the applied loads and of prestress; failing both, of the scene's largest load, or of the support forces."""
        applied = np.hypot(self.model.reference_load(state.pressures, state.loads), self.membrane.prestress_norm())
        if applied > 0.0:
            return float(applied)
        full = max(self.model.reference_load(one.pressures, one.loads) for one in self._stage_targets())
        return full or float(np.linalg.norm(self.membrane.out_of_balance())) or 1.0

    def _stage_targets(self) -> list[_LoadState]:
        scene = self.model.scene
        state = _unloaded(scene)
        targets = []
        for stage in scene.stages:
            state = _stage_target(state, stage)
            targets.append(state)
        return targets

    def _result(
        self,
        number: int,
        stage: Stage,
        k: int,
        state: _LoadState,
        record: SolveRecord,
        iterations: int,
        cuts: int,
        started: float,
    ) -> StepResult:
        """Download the state once and make the step's record."""
        self._apply(state)
        displacement = self.membrane.displacement()
        elements = self._element_fields(self.membrane.element_state(), displacement)
        dead = self.model.nodal_loads(state.pressures, state.loads)
        local = self.membrane.in_frames(-self.membrane.out_of_balance())
        reaction = self.membrane.from_frames(np.where(self.model.structure.node_held, local, 0.0))
        volume = self._rest_volume + float(self.membrane.swept_volumes(displacement).sum())
        values = probes.evaluate(self.model, displacement, reaction, elements, volume)
        return StepResult(
            number=number,
            stage=stage.name,
            stage_step=k,
            pressures=state.pressures,
            loads=state.loads,
            motions=state.motions,
            displacement=displacement,
            reaction=reaction,
            elements=elements,
            probes=values,
            volume=volume,
            energy=self.membrane.potential_energy(dead)[0] if self._has_energy else None,
            solver=record.method,
            converged=record.converged,
            reason=record.reason,
            iterations=iterations,
            residual=record.residual,
            cuts=cuts,
            seconds=time.perf_counter() - started,
        )

    def _element_fields(self, state: ElementState, displacement: Floats) -> ElementFields:
        """Add principal stresses and the direction of the major one on the deformed elements."""
        warp, weft, shear = state.stress.T
        mean, half = 0.5 * (warp + weft), 0.5 * (warp - weft)
        radius = np.hypot(half, shear)
        angle = 0.5 * np.arctan2(shear, half)
        geometry = self.membrane.geometry
        at_rest = np.cos(angle)[:, None] * geometry.warp + np.sin(angle)[:, None] * geometry.weft
        return ElementFields(
            strain=state.strain,
            stress=state.stress,
            state=state.state,
            fold_strain=state.fold_strain,
            taut_margin=state.taut_margin,
            slack_margin=state.slack_margin,
            major_stress=mean + radius,
            minor_stress=mean - radius,
            major_direction=self._pushed_forward(at_rest, displacement),
        )

    def _pushed_forward(self, tangent: Floats, displacement: Floats) -> Floats:
        """Unit tangent vectors of the deformed elements that the given ones at rest are carried to."""
        mesh = self.model.structure.mesh
        rest = mesh.points[mesh.triangles]
        first, second = rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]
        normal = np.cross(first, second)
        squared = np.einsum("ij,ij->i", normal, normal)
        along_first = np.einsum("ij,ij->i", np.cross(tangent, second), normal) / squared
        along_second = np.einsum("ij,ij->i", np.cross(first, tangent), normal) / squared
        now = rest + displacement[mesh.triangles]
        moved = along_first[:, None] * (now[:, 1] - now[:, 0]) + along_second[:, None] * (now[:, 2] - now[:, 0])
        length = np.linalg.norm(moved, axis=1, keepdims=True)
        return np.asarray(moved / np.where(length > 0.0, length, 1.0))


def _unloaded(scene: Scene) -> _LoadState:
    """The state before the first stage."""
    return _LoadState(*(dict.fromkeys(names, 0.0) for names in (scene.pressures, scene.loads, scene.motions)))


def _stage_target(before: _LoadState, stage: Stage) -> _LoadState:
    """State at a stage's end: what the stage does not name keeps its value."""
    pressures = dict(before.pressures)
    if isinstance(stage.pressure, dict):
        pressures.update(stage.pressure)
    elif stage.pressure is not None:
        pressures.update(dict.fromkeys(pressures, stage.pressure))
    return _LoadState(pressures, {**before.loads, **stage.loads}, {**before.motions, **stage.motions})


def solver_kind(model: Model) -> str:
    """The solver a run uses: the scene's, or relaxation where Newton cannot work and the scene does not insist on it.

    :raises InputError: the scene asks for Newton alone in single precision, or with the clipped law, which has no energy.
    """
    kind = model.scene.solver.kind
    hindrance = None
    if runtime.current().precision == "f32":
        hindrance = "it needs precision f64, not f32"
    elif any(fabric.law == "clip" for fabric in model.structure.fabrics):
        hindrance = "the law 'clip' has no energy and no symmetric tangent"
    if kind == "newton" and hindrance is not None:
        raise InputError(
            f"solver.kind = 'newton': {hindrance}; use 'relaxation', or 'hybrid', which then relaxes alone"
        )
    return "relaxation" if hindrance is not None else kind
