"""What one load step yields: the state downloaded once, with everything derived from it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.scene import WALLS, Modes, Stage
from taichi_membrane.simulation import modes, probes, sensitivity
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.force_balance import force_balance
from taichi_membrane.simulation.load_state import Course, LoadState
from taichi_membrane.simulation.masses import nodal_mass
from taichi_membrane.simulation.present import Present
from taichi_membrane.simulation.results import ModeResult, StepResult
from taichi_membrane.simulation.solver_choice import chosen_solver
from taichi_membrane.simulation.state import State
from taichi_membrane.simulation.utilisation import allowed
from taichi_membrane.solvers.record import SolveRecord

# Share of the largest force at a node that is none: a triangle's corner beside the point that is touched gets round-off.
_NO_FORCE = 1e-9


@dataclass(frozen=True)
class AtRest:
    """What the factorised tangent at an equilibrium tells; nothing where there is none."""

    negative_pivots: int | None = None
    doubt: str = ""
    derivatives: dict[str, dict[str, float]] = field(default_factory=dict)
    modes: ModeResult | None = None
    no_derivatives: str = ""
    no_modes: str = ""


class Measure:
    """Makes the results of load steps."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.model = equilibrium.model
        self.equilibrium = equilibrium
        self.system = equilibrium.system
        asked = "utilisation" in self.model.scene.extra_fields
        self._allowed = allowed(self.model.scene, self.model.structure.tri_fabric) if asked else None
        self._has_energy = all(fabric.law != "clip" for fabric in self.model.structure.fabrics)

    def step(
        self,
        number: int,
        stage: Stage,
        k: int,
        course: Course,
        share: float,
        record: SolveRecord,
        cuts: int,
        started: float,
        *,
        limit: dict[str, tuple[float, float]] | None = None,
    ) -> StepResult:
        """The record of step ``k`` of a stage, at the system's present state.

        :param share: how far along the stage's course the state is.
        :param started: when the step began, by :func:`time.perf_counter`.
        :param limit: bounds of the loads at which the structure collapses, where the step found that it does.
        """
        state, displacement, relieved = self._settled(course.at(share), record)
        contact, pushes = self._contact(), self._pushes()
        present = self._present(displacement, contact, pushes, stage)
        values = present.fields(self.model.scene.extra_fields)
        balance = force_balance(
            self.model.structure, displacement, self.system.surface_loads(), loads=self.model.nodal_loads(state),
            reactions=present.reaction, contact=present.contact_force,
        )  # fmt: skip
        swept = self.system.swept_volumes(displacement)
        volume = self.model.rest_volume + float((self.model.enclosing * swept).sum())
        energy = self._energy(state, displacement)
        at_rest = self._at_rest(stage, course, share) if record.converged else AtRest()
        step = StepResult(
            number=number,
            stage=stage.name,
            stage_step=k,
            drivers=state.values,
            fields=values,
            probes=probes.evaluate(self.model, values, swept, state, contact, pushes),
            volume=volume,
            energy=energy,
            solver=record.method,
            converged=record.converged,
            reason=record.reason,
            iterations=record.iterations,
            # Infinite and undefined alike: files know one word for both.
            residual=record.residual if np.isfinite(record.residual) else np.nan,
            cuts=cuts,
            negative_pivots=at_rest.negative_pivots,
            limit=limit,
            derivatives=at_rest.derivatives,
            modes=at_rest.modes,
            unknown=self._unknown(stage, at_rest, converged=record.converged, limited=limit is not None),
            state=self._handed_on(state, displacement),
            seconds=time.perf_counter() - started,
            contact_forces={name: float(np.linalg.norm(one, axis=1).sum()) for name, one in contact.items()},
            balance=dict(balance.resultants),
            imbalance=balance.error,
            walls={} if self.equilibrium.contact.walls is None else self.equilibrium.contact.walls.counts(),
            relieved=relieved,
        )
        return probes.with_own(self.model, step)

    def _settled(self, state: LoadState, record: SolveRecord) -> tuple[LoadState, Floats, dict[str, float]]:
        """The load state and displacements that the step has come to, and what relief valves let out; accepted where converged."""
        self.equilibrium.apply(state)
        state = self.equilibrium.settled(state)
        relieved = self.equilibrium.filling.accept() if record.converged else {}
        displacement = self.system.displacement()
        # Single precision holds a displacement in two parts, and their sum can be split in more than one way: the next step starts
        # from the same split whether it follows at once or after a resume.
        self.system.set_displacement(displacement)
        if record.converged:
            self.equilibrium.contact.accept()
        else:
            self.equilibrium.contact.begin()  # those of the equilibrium that is kept
        return state, displacement, relieved

    def _handed_on(self, state: LoadState, displacement: Floats) -> State:
        """What the next step begins with."""
        contact = self.equilibrium.contact
        return State(
            displacement=displacement,
            drivers=state.values,
            let_out=dict(self.equilibrium.filling.let_out),
            friction=contact.history,
            touched=None if contact.walls is None else contact.walls.kept,
        )

    def _present(
        self, displacement: Floats, contact: dict[str, Floats], pushes: dict[str, Floats], stage: Stage
    ) -> Present:
        """The system's present state, downloaded."""
        local = -self.system.balance()
        reaction = self.system.spread(np.where(self.model.structure.node_held, local, 0.0))
        if self.system.springs is not None:
            reaction = reaction + self.system.springs.forces(displacement)
        return Present(
            structure=self.model.structure,
            displacement=displacement,
            reaction=reaction,
            contact_force=sum(contact.values(), np.zeros_like(displacement)),
            contact_push=sum(pushes.values(), np.zeros(len(displacement))),
            elements=self.system.element_state(),
            cable_force=self.system.cable_forces(),
            free_strain=self.model.structure.free_strain(self.system.growth()),
            allowed=None if self._allowed is None else self._allowed / stage.effect_factor,
        )

    def _energy(self, state: LoadState, displacement: Floats) -> float | None:
        """Potential energy at the system's present state; None where there is none."""
        if not self._has_energy or self.system.frictions:
            return None
        if self.equilibrium.rim.at(self.system.surface_loads(), displacement) is not None:
            return None  # follower pressure without a potential
        energy = self.system.potential_energy(self.model.nodal_loads(state))[0]
        contents = self.equilibrium.filling.contents
        return energy if contents is None else energy + contents.energy()[0]

    def _contact(self) -> dict[str, Floats]:
        """(node_count, 3) what each plane and obstacle pushes the nodes with, by name."""
        found = {name: np.zeros((self.system.node_count, 3)) for name in self.model.scene.touchable}
        for one, forces in zip(self.system.contacts, self.system.touching().forces(), strict=True):
            found[one.obstacle.name] += forces
        if self.system.walls is not None:
            found[WALLS] += self.system.walls.forces()
        return found

    def _pushes(self) -> dict[str, Floats]:
        """(node_count,) sizes of what each plane and obstacle pushes the nodes with across itself, by name."""
        found = {name: np.zeros(self.system.node_count) for name in self.model.scene.touchable}
        for one, push in zip(self.system.contacts, self.system.touching().push, strict=True):
            found[one.obstacle.name] += push
        if self.system.walls is not None:
            size = np.linalg.norm(self.system.walls.forces(), axis=1)
            found[WALLS] += np.where(size > _NO_FORCE * size.max(initial=0.0), size, 0.0)
        return found

    def again(self, step: StepResult) -> None:
        """Bring the system back to the state that a step left it in."""
        self.system.set_displacement(step.state.displacement)
        self.equilibrium.apply(LoadState(step.state.drivers))
        self.equilibrium.contact.go_on(step.state.friction, step.state.touched)
        if step.converged:
            # Handed on to the next step; a new one of a barely definite matrix may be refused.
            self._tangent(step.stage)

    def _modes_asked(self, stage: str) -> Modes | None:
        asked = self.model.scene.modes
        return asked if asked is not None and asked.stage in (None, stage) else None

    def _tangent(self, stage: str) -> Factor | None:
        """The factorised tangent at the present state, where it is used and not singular."""
        newton = self.equilibrium.newton
        return newton.at_rest() if newton is not None and self._tangent_asked(stage) else None

    def _tangent_asked(self, stage: str) -> bool:
        """Whether the scene asks for what only a tangent tells."""
        scene = self.model.scene
        return scene.solver.stability or bool(scene.derivatives) or self._modes_asked(stage) is not None

    def _at_rest(self, stage: Stage, course: Course, share: float) -> AtRest:
        """What the tangent at an equilibrium tells, where it is used and not singular."""
        newton, asked, factor = self.equilibrium.newton, self._modes_asked(stage.name), self._tangent(stage.name)
        if newton is None or factor is None:
            return AtRest()
        displacement = self.system.displacement()
        filling = self.equilibrium.filling
        found, no_derivatives = sensitivity.derivatives(self.model, newton, factor, displacement, filling)
        shapes, no_modes = None, ""
        try:
            if asked is not None and asked.kind == "vibration":
                shapes = modes.vibration(newton, factor, self._mass, asked)
            elif asked is not None and factor.negative:
                no_modes = "buckling is that of a stable state"
            elif asked is not None and course.start != course.target:
                path = self.equilibrium.path(self.equilibrium.way(course.start, course.target))
                shapes = modes.buckling(path, displacement, share, factor, asked)
            elif asked is not None:
                no_modes = "the stage changes nothing"
        except ArithmeticError as error:
            no_modes = str(error)
        return AtRest(
            negative_pivots=factor.negative, doubt=factor.doubt, derivatives=found, modes=shapes,
            no_derivatives=no_derivatives, no_modes=no_modes,
        )  # fmt: skip

    def _unknown(self, stage: Stage, found: AtRest, *, converged: bool, limited: bool) -> dict[str, str]:
        """Why there is no value of what a step could tell."""
        scene, newton = self.model.scene, self.equilibrium.newton
        if not converged:
            why = "the state is no equilibrium"
        elif newton is None:
            why = f"relaxation has no tangent ({chosen_solver(self.model).reason or 'solver.kind = relaxation'})"
        elif self._tangent_asked(stage.name) and self.system.contacts and newton.skew() is not None:
            why = "contact beside a pressure without a potential: not implemented"
        elif self._tangent_asked(stage.name) and self.system.frictions:
            why = "friction has no potential: whether it keeps the state stable is not looked for"
        elif self._tangent_asked(stage.name) and self.system.walls is not None:
            why = "contact of walls with each other: not implemented"
        elif self._tangent_asked(stage.name):
            why = "the tangent is singular"
        else:
            why = "solver.stability is off"
        reasons = {}
        if found.negative_pivots is None:
            reasons["stable"] = why
        elif found.negative_pivots == 0 and found.doubt:
            reasons["stable"] = found.doubt
        if not found.derivatives:
            reasons["derivatives"] = (found.no_derivatives or why) if scene.derivatives else "the scene asks for none"
        if found.modes is None:
            asked = self._modes_asked(stage.name) is not None
            reasons["modes"] = (found.no_modes or why) if asked else "the scene asks for none here"
        if not limited:
            met = "no divergence was met, and flutter is not looked for" if found.doubt else "none was met"
            met = "by arc length limits are passed" if stage.control == "arc_length" else met
            reasons["limit"] = why if newton is None or not converged else met
        return reasons

    @cached_property
    def _mass(self) -> Floats:
        return nodal_mass(self.model.scene, self.model.structure.mesh)
