"""Equilibrium at a load state by the scene's solver: Newton, relaxation, or both; arc length where load control finds none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from taichi_membrane.device import runtime
from taichi_membrane.mechanics.rim import Rim
from taichi_membrane.mechanics.system import System
from taichi_membrane.scene import Stage
from taichi_membrane.simulation.filling import Filling
from taichi_membrane.simulation.load_state import LoadState, stage_targets
from taichi_membrane.simulation.load_step import LoadStep
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.policy import Event, Passage
from taichi_membrane.simulation.reached import Reached
from taichi_membrane.simulation.solver_choice import chosen_solver
from taichi_membrane.simulation.stiffest import Stiffest
from taichi_membrane.simulation.way import Way
from taichi_membrane.solvers.contact import Contact
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import Path
from taichi_membrane.solvers.record import Progress, Reference, SolveRecord, force_now, joined
from taichi_membrane.solvers.relaxation import Relaxation

# Residual over applied load at which a state counts as equilibrium. On the cantilever 1e-6 leaves 2e-5 of the tip deflection, 3e-6
# leaves 2e-4; single precision reaches the latter with room to spare.
_DEFAULT_TOLERANCE = {"f64": 1e-6, "f32": 3e-6}

# Newton's iterations per solve: alone; and in the hybrid, before relaxation takes over for a dose of its iterations.
_NEWTON_LIMIT, _NEWTON_PATIENCE, _DOSES = 200, 60, (500, 3000)

# Along a path residuals are compared with the loads there, which may pass through zero: with this share of the step's at least.
_LEAST_REFERENCE = 1e-3

# Round-offs of the stiffest forces that the residual of motions, or the force of a way that moves nothing, may consist of: a node
# gathers some six triangles, each of three corners and as many sides.
_ROUND_OFFS = 50.0

# Largest stress over the modulus that is none: rounding of a side's length leaves 1e-15, and a mesh that has not moved has exactly
# none, so that no verdict hangs on the size between these and the strains of a load, 1e-3 in an inflated tube.
_NO_STRESS = 1e-13

# How many nodes a step that fails names.
_WORST_NODES = 3

Report = Callable[[Progress], None] | None


class Equilibrium:
    """One system with its solvers."""

    def __init__(self, model: Model) -> None:
        self.system = System(model.structure)
        self.relaxation = Relaxation(self.system)
        self.contact = Contact(self.system, self.relaxation)
        self._made: Newton | None = None
        self._settle(model)

    def take(self, model: Model) -> bool:
        """Go on with another model, at rest, in the kernels compiled for this one; False, and no change, where they do not fit."""
        fits = self.system.accepts(model.structure)
        if fits:
            self.system.upload(model.structure)
            self.contact.upload()
            self._settle(model)
        return fits

    def _settle(self, model: Model) -> None:
        """What the model decides and no kernel depends on."""
        self.model = model
        self.kind = chosen_solver(model).kind
        if self.kind != "relaxation":
            if self._made is None or not self._made.tangent.accepts(model.structure):
                self._made = Newton(self.system, self.relaxation)
            else:
                self._made.upload()
        self.newton = self._made if self.kind != "relaxation" else None
        if self.contact.walls is not None:
            self.contact.walls.tangent = None if self.newton is None else self.newton.tangent
        settings = model.scene.solver
        self.filling = Filling(model, self.system)
        if self.newton is not None:
            self.newton.fill(self.filling.contents)
        self.rim = Rim.of(model.structure)
        self.tolerance = settings.tolerance or _DEFAULT_TOLERANCE[runtime.current().precision]

    def compile(self) -> None:
        """Compile every kernel a run needs, moving nothing; so that compile time is a figure of its own.

        Beside Newton, relaxation's wait until a step needs them.
        """
        if self.newton is None:
            self.relaxation.compile()
        else:
            self.newton.compile()
        self.system.out_of_balance()
        self.system.potential_energy(np.zeros((self.system.node_count, 3)))
        self.system.element_state()

    def apply(self, state: LoadState) -> None:
        """Set pressures, loads, stress-free strain and prescribed displacements."""
        if self.model.motions or self.model.moved_bodies:
            self.system.set_displacement(self.model.moved(self.system.displacement(), state))
        self.press(state)

    def press(self, state: LoadState) -> None:
        """Set pressures, loads, stress-free strain and the places of obstacles."""
        self.system.set_surface_loads(self.model.surface_values(state))
        self.system.set_loads(self.model.nodal_loads(state))
        for rigid in self.system.rigid:
            rigid.set_moments(self.model.body_moments(state))
        self.system.set_growth(self.model.growth_values(state))
        self.system.place_obstacles(state.obstacles)
        self.filling.press(state)

    def shut(self, stage: Stage, let_out: Mapping[str, float] | None = None) -> None:
        """Shut the valves that a stage shuts and open all others; see :meth:`.Filling.shut`."""
        self.filling.shut(stage, let_out)
        if self.newton is not None:
            self.newton.fill(self.filling.contents)

    def settled(self, state: LoadState) -> LoadState:
        """A load state with the pressures of shut chambers, and the amounts of gas in all, as they now are."""
        return self.filling.settled(state)

    def step(
        self,
        before: LoadState,
        after: LoadState,
        report: Report = None,
        *,
        stiffest: Stiffest | None = None,
        snaps: bool = False,
    ) -> Reached:
        """Go from an equilibrium at ``before`` to one at ``after``, or as far as there is a stable one.

        Where no equilibrium is found the membrane is back in the state it came from. Without Newton nothing is known of stability,
        nor with friction, which has no potential and makes what is found depend on the steps, nor where walls touch each other.

        :param stiffest: of the course that the step is part of; :class:`~.load_step.LoadStep` has the rest.
        """
        if self.newton is not None and not self.system.frictions and self.system.walls is None:
            return LoadStep(self, before, after, stiffest or Stiffest(), snaps=snaps, report=report).run()
        start = self.system.displacement()
        record = self.solve(after, report)
        if not record.converged and self.kind == "hybrid":
            self.system.set_displacement(start)
            record = joined(record, self.solve(after, report, relax=True))
        if record.converged and self.contact.walls is not None and (why := self.contact.walls.passed()):
            record = replace(record, converged=False, reason=why)
        if record.converged:
            self.contact.accept()
            event: Event = "relaxed" if self.newton is None else "unverified"
            return Reached(record, 1.0, trace=(Passage(event=event, share=1.0),))
        trouble = self.trouble()
        self.system.set_displacement(start)
        return Reached(record, 0.0, trouble=trouble)

    def trouble(self) -> str:
        """Where the present state, which is no equilibrium, is worst: nodes out of balance and the element strained most."""
        force = np.where(self.model.structure.node_held, 0.0, self.system.balance())
        size = np.linalg.norm(force, axis=1)
        lost = np.flatnonzero(~np.isfinite(size))
        if lost.size:
            return f"forces at {lost.size} of {size.size} nodes are not finite, the first is node {lost[0]}"
        worst = np.argsort(-size, kind="stable")[:_WORST_NODES]
        strain = np.abs(self.system.element_state().strain).max(axis=1)
        return (
            f"furthest out of balance: nodes {', '.join(map(str, worst))}; "
            f"largest strain: {strain.max():.3g} in element {strain.argmax()}"
        )

    def solve(
        self, state: LoadState, report: Report, *, relax: bool = False, patience: int | None = None
    ) -> SolveRecord:
        """Equilibrium at a load state from the present displacements, by Newton where there is one.

        :param relax: doses of relaxation first, after each of them Newton again.
        :param patience: Newton's iterations at most, without relaxation; the solver's own number when None.
        """
        self.apply(state)
        reference = self.reference(state)
        limit = self.model.scene.solver.max_iterations
        if self.newton is None:
            return self._relax(reference, limit, report)
        if not relax:
            usual = _NEWTON_LIMIT if self.kind == "newton" else _NEWTON_PATIENCE
            return self._newton(self.newton, state, reference, min(limit, patience or usual), report)
        parts: list[SolveRecord] = []
        for dose in _DOSES:
            parts.append(self._relax(reference, min(dose, limit), report))
            balanced = parts[-1].converged and self.filling.contents is None  # relaxation keeps pressures as they are
            if balanced or parts[-1].reason == "not finite":
                break
            start = self.system.displacement()
            patience = _NEWTON_LIMIT if dose == _DOSES[-1] else _NEWTON_PATIENCE  # nothing takes over from the last one
            parts.append(self._newton(self.newton, state, reference, patience, report))
            if parts[-1].converged:
                break
            self.system.set_displacement(start)
        return joined(*parts)

    def _relax(self, reference: Reference, limit: int, report: Report) -> SolveRecord:
        def work() -> SolveRecord:
            return self.relaxation.solve(
                tolerance=self.tolerance, reference=reference, max_iterations=limit, report=report
            )

        return self.contact.solve(work, self.tolerance, reference)

    def _newton(
        self, newton: Newton, state: LoadState, reference: Reference, limit: int, report: Report
    ) -> SolveRecord:
        def work() -> SolveRecord:
            return newton.solve(
                tolerance=self.tolerance,
                reference=reference,
                loads=self.model.nodal_loads(state),
                max_iterations=limit,
                report=report,
            )

        return self.contact.solve(work, self.tolerance, reference)

    def way(self, before: LoadState, after: LoadState) -> Way:
        """The straight way between two load states; there has to be a Newton solver."""
        assert self.newton is not None
        # The forces of a liquid are not linear in its level, those of a gas in its amount, nor those of wrinkled fabric in its
        # stress-free strain.
        curved = [f"load.{name}" for name in self.model.surface.waters]
        curved += [name for name in before.values if name.startswith("amount.")]
        curved += self.model.growth.drivers
        shut = self.filling.contents is not None and self.filling.contents.chambers
        curved += [name for name in before.values if shut and name.startswith("ambient.")]
        return Way(
            self.newton,
            before,
            after,
            self.apply if before.motions != after.motions else self.press,
            linear=all(before.values[name] == after.values[name] for name in curved),
            round_off=self._round_off(before, after),
        )

    def _round_off(self, before: LoadState, after: LoadState) -> Callable[[float], float] | None:
        """What rounding leaves of the force of stress-free strain, which may be hindered evenly and move nothing."""
        if all(before.values[name] == after.values[name] for name in self.model.growth.drivers):
            return None
        eps = float(np.finfo(self.system.dtype).eps)
        ends = sum(self.system.self_stress_norm(self.model.growth_values(one)) for one in (before, after))
        return lambda share: _ROUND_OFFS * eps * (self.system.stress_norm() / share + ends)

    def carries_nothing(self) -> bool:
        """Whether the fabric is without stress at the present state."""
        stiffest = max(max(fabric.e_warp, fabric.e_weft) for fabric in self.model.structure.fabrics)
        return float(np.abs(self.system.element_state().stress).max(initial=0.0)) <= _NO_STRESS * stiffest

    def relieved(self, way: Way, share: float) -> bool:
        """Whether what acts at the start of a way has gone at a share of it, but for less than its path is followed to."""
        start, now = (self._applied(way.at(one)) for one in (0.0, share))
        return now <= self._least(way) < start

    def _least(self, way: Way) -> float:
        return _LEAST_REFERENCE * max(force_now(self.reference(one)) for one in (way.before, way.after))

    def path(self, way: Way) -> Path:
        """The equilibrium path in the share of a way, by arc length."""
        least = self._least(way)
        volumes = self.filling.volumes()  # those of trial states may be anything
        return Path(
            way.newton,
            apply=way.press,
            force=way.force,
            reference=lambda share: max(least, self._applied(way.at(share), volumes)),
            tolerance=self.tolerance,
        )

    def reference(self, state: LoadState) -> Reference:
        """Size of what acts: applied loads, prestress and hindered stress-free strain.

        Failing all, the reactions of motions, or the scene's largest load.
        """
        applied = self._applied(state)
        if applied > 0.0:
            return applied
        if any((*state.motions.values(), *state.obstacles.values())):
            return self._reactions()
        targets = stage_targets(self.model.scene)
        return max(self._applied(one) for one in targets) or 1.0

    def _reactions(self) -> Reference:
        """Size of the support forces at the present state, for a membrane that motions alone act on.

        Where they come to less than the tolerance of what the motion called up before anything gave way, the membrane carries
        nothing, and that is what the residual is compared with. Below the round-off of strains of size ε u/ℓ, forces of ε ‖2 M u‖
        with the fictitious masses M that bound the stiffness, nothing is told; the tolerance is :data:`_ROUND_OFFS` of these.
        """
        held, system = self.model.structure.node_held, self.system
        bound = 2.0 * self.relaxation.masses()[:, None] * system.displacement()
        share = min(_ROUND_OFFS * float(np.finfo(system.dtype).eps) / self.tolerance, 1.0)
        floor = share * float(np.linalg.norm(bound))
        called_up = float(np.linalg.norm(system.out_of_balance()))

        def now() -> float:
            carried = float(np.linalg.norm(np.where(held, system.balance(), 0.0)))
            least = called_up if carried <= self.tolerance * called_up else 0.0
            return max(carried, floor, least) or 1.0

        return now

    def _applied(self, state: LoadState, volumes: list[float] | None = None) -> float:
        """Size of the applied loads, of prestress and of hindered stress-free strain; 0 where there are none.

        :param volumes: of each gas in shut chambers, whose pressures they make; the present ones when None.
        """
        state = self.filling.with_pressures(state, volumes)
        inner = self.system.self_stress_norm(self.model.growth_values(state))
        return float(np.hypot(self.model.reference_load(state), inner))
