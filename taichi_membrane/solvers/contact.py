"""Contact with planes: solves repeated with better multipliers, until contact forces and gaps agree (Uzawa's method).

At the multipliers λ a solve ends with the contact forces <λ - k g>. With these as the next multipliers the gaps of nodes in contact
shrink by about 1/(1 + k/c), c the stiffness with which the structure resists a push on one node. k is the stiffness bound of the
node's elements at rest, which c does not exceed: gaps halve at worst, and across a sheet, where c is small, shrink a thousandfold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.solvers.record import Reference, SolveRecord, force_now
from taichi_membrane.solvers.relaxation import Relaxation

# Halved so often, any gap is round-off.
_MOST_ROUNDS = 50


class Contact:
    """The planes of a system; without any, solves are left as they are."""

    def __init__(self, system: System, relaxation: Relaxation) -> None:
        self.system, self.relaxation = system, relaxation
        self._bound: Floats | None = None

    def upload(self) -> None:
        """Take over the structure that is now in the system's fields."""
        self._bound = None

    def solve(self, work: Callable[[], SolveRecord], tolerance: float, reference: Reference) -> SolveRecord:
        """Equilibrium in contact: gaps of nodes that are pushed, as forces k g, are below ``tolerance`` times ``reference``.

        :param work: solves at the present multipliers.
        """
        if not self.system.planes:
            return work()
        self._begin()
        record = work()
        for _ in range(_MOST_ROUNDS):
            if not record.converged:
                return record
            pushes = [one.push() for one in self.system.planes]
            lacking = [push - one.multiplier for push, one in zip(pushes, self.system.planes, strict=True)]
            if float(np.linalg.norm(lacking)) <= tolerance * force_now(reference):
                return record
            for one, push in zip(self.system.planes, pushes, strict=True):
                one.set(one.stiffness, push)
            again = work()
            record = replace(
                again, iterations=record.iterations + again.iterations, seconds=record.seconds + again.seconds
            )
        return replace(record, converged=False, reason=f"contact forces not found in {_MOST_ROUNDS} rounds")

    def _begin(self) -> None:
        """Multipliers from the present state alone, so that a run that was stopped goes on as if it had not been: what keeps
        nodes at a plane from passing it."""
        structure = self.system.structure
        if self._bound is None:
            self._bound = self._bound_at_rest()
        force = np.where(structure.node_held, 0.0, self.system.in_frames(self.system.out_of_balance()))
        others = self.system.from_frames(force)
        for one in self.system.planes:
            pressed = one.push() - others @ one.plane.normal
            one.set(self._bound, np.maximum(pressed - self._bound * one.gap(), 0.0))

    def _bound_at_rest(self) -> Floats:
        """(node_count,) twice the masses without contact, at rest."""
        position = self.system.displacement()
        self.system.set_displacement(np.zeros_like(position))
        for one in self.system.planes:
            one.set(np.zeros(self.system.node_count), np.zeros(self.system.node_count))
        bound = 2.0 * self.relaxation.masses()
        self.system.set_displacement(position)
        return bound
