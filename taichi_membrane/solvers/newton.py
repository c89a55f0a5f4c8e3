"""Newton's method on the relaxed potential energy: the full-matrix counterpart of relaxation, on the same fields.

Each iteration assembles residual and tangent, factorises, and backtracks on the potential energy along the step. Where the
tangent is not positive definite (flat, slack, buckling) a multiple of the relaxation's fictitious masses is added until it is;
the shift is withdrawn as full steps succeed. With no shift and full steps the convergence is quadratic.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.protocol import DIRECT, Algebra, Factor
from taichi_membrane.mechanics.contents import Contents
from taichi_membrane.mechanics.coupled import coupled
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.rim import Rim, Skew, SkewFactor, symmetric
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.solvers.in_contact import factor_in_contact
from taichi_membrane.solvers.record import Progress, Reference, SolveRecord, force_now
from taichi_membrane.solvers.relaxation import Relaxation
from taichi_membrane.solvers.soft_mode import scaled, softest

# Shifts are multiples of 2 M. Twice that bounds the tangent in size (K ≤ 4 M), so that a shift of 2 makes any definite; enormous
# pressures come near: their load stiffness has been seen at -2.3 M.
_SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-8, 2.0
_SHIFT_FACTOR = 10.0
# The first shift tried; the next one over the softest mode's negative curvature; inverse iterations for that mode in a step.
_FIRST_SHIFT, _MARGIN, _MODE_ITERATIONS = 1e-6, 2.0, 3
# A step that lowers the energy by less than this share of what its quadratic model promises is shortened while that helps.
_POOR = 0.25
# Armijo's share of the predicted decrease, and the shortest step tried before the shift is raised.
_DECREASE, _SHORTEST = 1e-4, 1 / 64
# Shortest exact step where the symmetric part is indefinite; shorter ones than a sixteenth lead nowhere (hypar sails, 16 cases).
_SHORTEST_OUTRIGHT = 1 / 16
# Energies agree to this share of the terms that they are the difference of when round-off alone separates them; the residual
# then decides. Of the gas in a shut chamber these are a thousand times what is left.
_ENERGY_NOISE = 1e-13
# Away from an unstable equilibrium: the first push, as a share of the sides there, and how exactly its direction is found.
_FIRST_PUSH, _INVERSE_ITERATIONS, _DISTURBANCE = 1e-3, 12, 1e-2


class Newton:
    """Newton's method for one system; shares its fields with a relaxation, whose masses scale the shift.

    Forces and steps here are (node_count, 3) in the axes that supports refer to, zero at held components.

    :param algebra: solves its linear systems.
    """

    def __init__(self, system: System, relaxation: Relaxation, algebra: Algebra = DIRECT) -> None:
        self.system = system
        self.relaxation = relaxation
        self.tangent = Tangent(system, algebra)
        self.free: NDArray[np.bool_] = ~system.structure.node_held
        self.shift = 0.0
        self.contents: Contents | None = None
        self.rim = Rim.of(system.structure)
        self._refusal = ""  # why a linear solution of the present step was refused
        self._skew: Skew | None = None  # of the state that the present step starts from
        self._kept: tuple[tuple[Floats, ...], Factor] | None = None
        self._lowest = 0.0
        self._mode: Floats | None = None
        self._energy_size = 0.0  # of the terms that the last energy was the difference of

    def compile(self) -> None:
        """Compile the assembly kernels."""
        self.tangent.assemble()

    def solve(
        self,
        *,
        tolerance: float,
        reference: Reference,
        loads: Floats,
        max_iterations: int,
        report: Callable[[Progress], None] | None = None,
    ) -> SolveRecord:
        """Iterate from the present displacements until the residual is below ``tolerance`` times ``reference``.

        :param loads: (node_count, 3) dead nodal forces, for the potential energy.
        """
        started = time.perf_counter()
        self.shift, self._lowest, self._mode = 0.0, 0.0, None
        position = self.system.displacement()
        energy = self._restarted(loads)
        residual, reason, iteration = np.inf, "iteration limit", 0
        for iteration in range(max_iterations + 1):
            force = self.free_force()
            with np.errstate(over="ignore", invalid="ignore"):  # of a step that went far astray
                residual = float(np.linalg.norm(force)) / force_now(reference)
            if report is not None:
                report(Progress(iteration=iteration, residual=residual, seconds=time.perf_counter() - started))
            if not np.isfinite(residual) or not np.isfinite(energy):
                reason = "not finite"
                break
            if residual <= tolerance:
                found = self._leave_saddle(position, energy, loads)
                if found is None:
                    reason = "residual"
                    break
                position, energy = found
                continue
            if self._skew is not None:
                energy = self._restarted(loads)
            if iteration == max_iterations:
                break
            self._refusal = ""
            found = self._step(position, energy, force, loads)
            if found is None:
                reason = f"no descent; {self._refusal}" if self._refusal else "no descent"
                break
            position, energy = found
        return SolveRecord(
            converged=reason == "residual",
            reason=reason,
            iterations=iteration,
            residual=residual,
            seconds=time.perf_counter() - started,
            method="newton",
        )

    def fill(self, contents: Contents | None) -> None:
        """Couple the displacements with gas in shut chambers and liquids of given volume, or no longer."""
        if contents is not None or self.contents is not None:
            self._kept = None  # the tangent of another problem
        self.contents = contents

    def free_force(self) -> Floats:
        """(node_count, 3) out-of-balance forces at free components."""
        return np.where(self.free, self.system.balance(), 0.0)

    def factorised(self, *, indefinite: bool = False) -> Factor | None:
        """The present tangent, factorised; see :meth:`.LinearSolver.factorise`."""
        blocks = self.tangent.assemble()
        loose = self.tangent.loose(self.free) if indefinite else None
        factor = self.tangent.solver.factorise(blocks, loose, indefinite=indefinite)
        return self._whole(factor, self.skew())

    def skew(self) -> Skew | None:
        """Skew part of the present tangent; None where the present pressures have a potential."""
        return self.rim.at(self.system.surface_loads(), self.system.displacement())

    def _whole(self, factor: Factor | None, skew: Skew | None) -> Factor | None:
        """The factorised sparse symmetric part with what shut chambers and pressures without a potential add."""
        if factor is not None and self.contents is not None:
            factor = coupled(factor, self.contents.rank_one(), self.free)
        return factor if factor is None or skew is None else SkewFactor(factor, skew)

    def _restarted(self, loads: Floats) -> float:
        """Potential energy at the present displacements, from which the work of pressures without a potential is counted."""
        self._skew = self.skew()
        return self._settled_energy(loads)

    def _settled_energy(self, loads: Floats) -> float:
        """Potential energy at the present displacements, with pressures and levels that follow them set to what they are there."""
        if self.contents is not None:
            self.contents.settle()
        energy, stored = self.system.potential_energy(loads)
        self._energy_size = abs(stored) + abs(energy - stored)
        if self.contents is not None:
            more, size = self.contents.energy()
            energy, self._energy_size = energy + more, self._energy_size + size
        if self._skew is not None:
            energy += self._skew.work_beyond(self.system.displacement())
        return energy

    def _return(self, position: Floats) -> None:
        """Go back to displacements, and pressures, that a trial step has left."""
        self.system.set_displacement(position)
        if self.contents is not None:
            self.contents.settle()

    def at_rest(self) -> Factor | None:
        """The factorised tangent at the present state, indefinite or not; None where it is singular.

        Where nodes touch obstacles it is that of the freedoms which are left to them, with the contact forces as they are. It is
        kept, so that a load step that starts from here need not factorise again, nor who asks twice.
        """
        if self._kept is not None and self._is_here(self._kept):
            return self._kept[1]
        touching = bool(self.system.contacts) or self.system.walls is not None
        factor = factor_in_contact(self) if touching else self.factorised(indefinite=True)
        self._kept = None if factor is None else (self._tangent_state(), factor)
        return factor

    def upload(self) -> None:
        """Take over the structure that is now in the system's fields, all chambers open."""
        self.tangent.upload()
        self.free = ~self.system.structure.node_held
        self.rim = Rim.of(self.system.structure)
        self._kept, self.contents, self._skew = None, None, None

    def _factor_at_rest(self) -> Factor | None:
        """What :meth:`at_rest` kept, where it is still the tangent of this state."""
        kept, self._kept = self._kept, None
        if self.system.contacts or self.system.walls is not None:
            return None  # it is of fewer freedoms
        return kept[1] if kept is not None and self._is_here(kept) else None

    def _is_here(self, kept: tuple[tuple[Floats, ...], Factor]) -> bool:
        """Whether all that the tangent depends on is as it was for a kept factor."""
        return all(map(np.array_equal, kept[0], self._tangent_state()))

    def _tangent_state(self) -> tuple[Floats, ...]:
        """All that the tangent depends on."""
        state = self.system.tangent_state()
        return state if self.contents is None else (*state, self.contents.key())

    def _step(self, position: Floats, energy: float, force: Floats, loads: Floats) -> tuple[Floats, float] | None:
        """One step that lowers the energy: raise the shift until the tangent is definite and backtracking succeeds."""
        at_rest = self._factor_at_rest()
        if self._skew is not None and self.shift == 0.0:
            at_rest = at_rest or self.factorised(indefinite=True)
            found = None if at_rest is None else self._outright(position, at_rest, loads)
            if found is not None:
                return found
        blocks: Floats | None = None
        while True:
            factor: Factor | None
            if at_rest is not None and self.shift == 0.0:
                factor = at_rest if symmetric(at_rest).negative == 0 else None
            else:
                blocks = self.tangent.assemble() if blocks is None else blocks
                factor = self._shifted(blocks, self.shift)
            if factor is not None:
                direction = self._solution(factor, force)
                lower = None if direction is None else self._backtrack(position, energy, force, direction, loads)
                if lower is not None:
                    position, energy, fraction = lower
                    if self.shift > 0.0:
                        position, energy = self._along_soft_mode(factor, position, energy, loads)
                    self._adapt_shift(fraction)
                    return position, energy
            if self.shift >= _LARGEST_SHIFT:
                break
            self.shift = min(max(_FIRST_SHIFT, _SHIFT_FACTOR * self.shift), _LARGEST_SHIFT)
        self._return(position)
        return None

    def _outright(self, position: Floats, factor: Factor, loads: Floats) -> tuple[Floats, float] | None:
        """The exact step, where it lowers the residual: without a potential an indefinite symmetric part is no sign of instability.

        None where the symmetric part is definite, so that the work decides, or where the residual does not fall.
        """
        if symmetric(factor).negative == 0:
            return None
        force = self.free_force()
        direction, size, fraction = self._solution(factor, force), float(np.linalg.norm(force)), 1.0
        if direction is None:
            return None
        while fraction >= _SHORTEST_OUTRIGHT:
            trial = self.system.retract(position, fraction * direction)
            self._return(trial)
            if float(np.linalg.norm(self.free_force())) <= (1.0 - _DECREASE * fraction) * size:
                return trial, self._settled_energy(loads)
            fraction *= 0.5
        self._return(position)
        return None

    def _solution(self, factor: Factor, force: Floats) -> Floats | None:
        """The step that balances a force; None where the factor's solution is refused."""
        direction = factor.solve(force)
        if np.isfinite(direction).all():
            return direction
        self._refusal = factor.refusal
        return None

    def _shifted(self, blocks: Floats, shift: float) -> Factor | None:
        """The tangent with a shift, factorised; None where it is not definite."""
        factor = self.tangent.solver.factorise(blocks, shift * self._stiffness_bound() if shift > 0.0 else None)
        return self._whole(factor, self._skew)

    def _along_soft_mode(self, factor: Factor, position: Floats, energy: float, loads: Floats) -> tuple[Floats, float]:
        """Where the tangent without its shift is indefinite, go on along the softest mode while the energy falls.

        Otherwise the shift lets steps creep along that mode, towards a saddle and away from it.
        """
        mode, self._lowest = self._softest(factor, self.shift, _MODE_ITERATIONS)
        if self._lowest >= 0.0 or self._skew is not None:
            return position, energy
        return self._push(position, energy, mode, loads) or (position, energy)

    def _softest(self, factor: Factor, shift: float, iterations: int) -> tuple[Floats, float]:
        """The mode of lowest curvature, by inverse iteration from the last one, and that curvature in units of the shift."""
        bound = self._stiffness_bound()
        self._mode, value = softest(symmetric(factor), bound, shift, iterations, start=self._mode, free=self.free)
        return self._mode, value

    def _leave_saddle(self, position: Floats, energy: float, loads: Floats) -> tuple[Floats, float] | None:
        """A lower state beside an equilibrium that is unstable; None where the equilibrium is stable (or indifferent).

        Where the last steps needed no shift, the tangent was positive definite already. Otherwise the softest mode is found by
        inverse iteration, and the structure is pushed along it as far as the energy keeps falling. Pressures without a potential
        have no energy that a push could lower.
        """
        self._skew = self.skew()
        if (
            self._skew is not None
            or self.shift == 0.0
            or self._shifted(self.tangent.assemble(), _SMALLEST_SHIFT) is not None
        ):
            return None
        mode = self._softest_mode()
        return None if mode is None else self._push(position, energy, mode, loads)

    def disturb(self) -> None:
        """Move along the softest mode a little, so that what symmetry holds in an unstable equilibrium can leave it."""
        self._skew = None  # that of the symmetric part
        mode = self._softest_mode()
        if mode is not None:
            step = scaled(self.system, mode)
            self._return(self.system.retract(self.system.displacement(), _DISTURBANCE * step))

    def _softest_mode(self) -> Floats | None:
        """The mode of lowest curvature at the present state, from a shift that has just become definite."""
        blocks, shift, factor = self.tangent.assemble(), _SMALLEST_SHIFT, None
        while factor is None and shift <= _LARGEST_SHIFT:
            factor = self._shifted(blocks, shift)
            if factor is None:
                shift *= _SHIFT_FACTOR
        if factor is None:
            return None
        self._mode = None
        return self._softest(factor, shift, _INVERSE_ITERATIONS)[0]

    def _push(self, position: Floats, energy: float, mode: Floats, loads: Floats) -> tuple[Floats, float] | None:
        """The lower state along a mode, either way, as far as the energy keeps falling; None where it rises both ways."""
        step = scaled(self.system, mode)
        best: tuple[Floats, float] | None = None
        for sign in (1.0, -1.0):
            fraction = _FIRST_PUSH
            while fraction <= 1.0:
                trial = self.system.retract(position, sign * fraction * step)
                self.system.set_displacement(trial)
                reached = self._settled_energy(loads)
                if reached >= (energy if best is None else best[1]):
                    break
                best = (trial, reached)
                fraction *= 2.0
        self._return(position if best is None else best[0])
        return best

    def _stiffness_bound(self) -> Floats:
        """(node_count, 3) twice the fictitious masses at free components, the unit of the shift."""
        return np.where(self.free, 2.0 * self.relaxation.masses()[:, None], 0.0)

    def _adapt_shift(self, fraction: float) -> None:
        """Withdraw the shift after a full step, raise it after a short one."""
        if self.shift == 0.0:
            return
        if fraction >= 1.0:
            withdrawn = self.shift / _SHIFT_FACTOR if self.shift > _SMALLEST_SHIFT else 0.0
            self.shift = max(withdrawn, -_MARGIN * self._lowest)
        elif fraction < 0.25:
            self.shift = min(self.shift * _SHIFT_FACTOR, _LARGEST_SHIFT)

    def _backtrack(
        self, position: Floats, energy: float, force: Floats, direction: Floats, loads: Floats
    ) -> tuple[Floats, float, float] | None:
        """The longest of the fractions 1, ½, ¼ … of a step that lowers the energy by a share of what its slope promises."""
        slope = float(np.vdot(force, direction))
        if not (np.isfinite(slope) and slope > 0.0):
            return None
        noise = _ENERGY_NOISE * max(self._energy_size, slope)
        fraction = 1.0
        while fraction >= _SHORTEST:
            trial = self.system.retract(position, fraction * direction)
            self.system.set_displacement(trial)
            reached = self._settled_energy(loads)
            if np.isfinite(reached) and reached <= energy - _DECREASE * fraction * slope + noise:
                best = (trial, reached, fraction)
                gain = (energy - reached) / (fraction * (1.0 - 0.5 * fraction) * slope)
                while gain < _POOR and fraction >= _SHORTEST and energy - reached > noise:
                    fraction *= 0.5
                    trial = self.system.retract(position, fraction * direction)
                    self.system.set_displacement(trial)
                    reached = self._settled_energy(loads)
                    if not reached < best[1] - noise:
                        break
                    best = (trial, reached, fraction)
                self._return(best[0])
                return best
            fraction *= 0.5
        self._return(position)
        return None
