"""Contact with obstacles: solves repeated with better multipliers, until contact forces and gaps agree (Uzawa's method).

At the multipliers λ a solve ends with the contact forces <λ - k g>. With these as the next multipliers the gaps of nodes in contact
shrink by about 1/(1 + k/c), c the stiffness with which the structure resists a push on one node. k is the stiffness bound of the
node's elements at rest, which c does not exceed: gaps halve at worst, and across a sheet, where c is small, shrink a thousandfold.

Friction takes part in the same rounds. Each solve has the limits, the coefficient times the pushes, of the one before, so that it
has a potential: Panagiotopoulos' way from friction of given limits to Coulomb's. Along a rope round a cylinder the limits then
follow T' = μ T by Picard's iteration, whose error after n rounds is (μ φ)ⁿ/n! of the force at the other end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.touching import Touching
from taichi_membrane.mechanics.wall_search import Touched
from taichi_membrane.solvers.record import Reference, SolveRecord, force_now
from taichi_membrane.solvers.relaxation import Relaxation
from taichi_membrane.solvers.walls import WallContact

# Halved so often, any gap is round-off. Friction, whose directions turn while they are found, may take more.
_MOST_ROUNDS, _MOST_WITH_FRICTION = 50, 200
# No accepted state has a node that has passed an obstacle by more than this share of the structure's size; single precision
# resolves a tenth of its own.
PENETRATION = {"f64": 1e-6, "f32": 1e-5}


class Contact:
    """The obstacles of a system; without any, solves are left as they are."""

    def __init__(self, system: System, relaxation: Relaxation) -> None:
        self.system, self.relaxation = system, relaxation
        self._bound: Floats | None = None
        self.walls = None if system.walls is None else WallContact(system)

    @property
    def used(self) -> bool:
        """Whether anything can be touched."""
        return bool(self.system.contacts) or self.walls is not None

    def upload(self) -> None:
        """Take over the structure that is now in the system's fields."""
        self._bound = None
        if self.walls is not None:
            self.walls.upload()

    def solve(self, work: Callable[[], SolveRecord], tolerance: float, reference: Reference) -> SolveRecord:
        """Equilibrium in contact: gaps of nodes that are pushed, as forces k g, are below ``tolerance`` times ``reference``, and no
        node has passed an obstacle by more than :data:`PENETRATION`.

        :param work: solves at the present multipliers.
        """
        if not self.used:
            return work()
        self.begin()
        record = work()
        rounds = _MOST_WITH_FRICTION if self.system.frictions or self.walls is not None else _MOST_ROUNDS
        for _ in range(rounds):
            if not record.converged:
                return record
            now = self.system.touching()
            if self._agrees(now, tolerance * force_now(reference)):
                return record
            for one, push in zip(self.system.contacts, now.push, strict=True):
                one.set(one.stiffness, push)
            for rub in self.system.frictions:
                rub.set(now.normal[rub.contact.number], now.friction[rub.contact.number], rub.contact.multiplier)
            if self.walls is not None:
                self.walls.renew()
            again = work()
            record = replace(
                again, iterations=record.iterations + again.iterations, seconds=record.seconds + again.seconds
            )
        return replace(record, converged=False, reason=f"contact forces not found in {rounds} rounds")

    def _agrees(self, now: Touching, least: float) -> bool:
        """Whether the contact forces are the multipliers."""
        known = np.array([one.multiplier for one in self.system.contacts]).reshape(now.push.shape)
        size = float(np.linalg.norm(np.ptp(self.system.structure.points, axis=0)))
        deepest = PENETRATION["f32" if self.system.split_displacement else "f64"] * size
        off = np.linalg.norm(now.push - known) ** 2 + sum(
            np.linalg.norm(one.beyond(now.normal[one.contact.number], now.friction[one.contact.number])) ** 2
            for one in self.system.frictions
        )
        turned, through = (0.0, 0.0) if self.walls is None else self.walls.off()
        return float(np.sqrt(off + turned**2)) <= least and max(now.deepest(), through) <= deepest

    def begin(self) -> None:
        """Multipliers from the present state alone, so that a run that was stopped goes on as if it had not been: what keeps
        nodes at an obstacle from passing it."""
        if not self.used:
            return
        structure = self.system.structure
        if self._bound is None:
            self._bound = self._bound_at_rest()
        if self.walls is not None:
            self.walls.begin(self._bound)
        self._let_go()
        force = np.where(structure.node_held, 0.0, self.system.in_frames(self.system.out_of_balance()))
        others, now = self.system.from_frames(force), self.system.touching()
        for one, gap, normal in zip(self.system.contacts, now.gap, now.normal, strict=True):
            pressed = -np.einsum("ij,ij->i", others, normal)
            one.set(self._bound, np.maximum(pressed - self._bound * gap, 0.0))
        for rub in self.system.frictions:
            rub.begin(now.normal[rub.contact.number])

    def accept(self) -> None:
        """Make the present equilibrium the history of friction."""
        displacement = self.system.displacement()
        for one in self.system.frictions:
            one.keep(displacement, one.forces())
        if self.walls is not None:
            self.walls.accept()

    def go_on(self, friction: Sequence[Floats], touched: Touched | None) -> None:
        """Take over the friction forces (node_count, 3) of an earlier analysis at the present place, and what walls touch."""
        if self.walls is not None and touched is not None:
            self.walls.go_on(touched)
        displacement = self.system.displacement()
        for one, force in zip(self.system.frictions, friction, strict=True):
            one.keep(displacement, force)

    @property
    def history(self) -> tuple[Floats, ...]:
        """(node_count, 3) friction forces of each obstacle that has friction, at the last equilibrium."""
        return tuple(one.carried for one in self.system.frictions)

    def restore(self, multipliers: Sequence[Floats]) -> None:
        """Set the multipliers that were found for a state."""
        for one, multiplier in zip(self.system.contacts, multipliers, strict=True):
            one.set(one.stiffness, multiplier)

    def _let_go(self) -> None:
        none = np.zeros(self.system.node_count)
        for one in self.system.contacts:
            one.set(none, none)
        for rub in self.system.frictions:
            rub.let_go()

    def _bound_at_rest(self) -> Floats:
        """(node_count,) twice the masses without contact, at rest."""
        position = self.system.displacement()
        if self.walls is not None:
            self.walls.let_go()
        self.system.set_displacement(np.zeros_like(position))
        self._let_go()
        bound = 2.0 * self.relaxation.masses()
        self.system.set_displacement(position)
        return bound
