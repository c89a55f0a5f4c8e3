"""Newton's method on the relaxed potential energy: the full-matrix counterpart of relaxation, on the same fields.

Each iteration assembles residual and tangent, factorises, and backtracks on the potential energy along the step. Where the
tangent is not positive definite (flat, slack, buckling) a multiple of the relaxation's fictitious masses is added until it is;
the shift is withdrawn as full steps succeed. With no shift and full steps the convergence is quadratic.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from taichi_membrane.engine.membrane import Membrane
from taichi_membrane.engine.preparation import Floats
from taichi_membrane.engine.relaxation import Progress, Relaxation, SolveRecord
from taichi_membrane.engine.tangent import Pattern, Tangent

# Shifts are multiples of the fictitious stiffness 2 M, which bounds the true one: a shift of 1 makes any tangent definite.
_SMALLEST_SHIFT, _LARGEST_SHIFT = 1e-8, 2.0
_SHIFT_FACTOR = 10.0
# Armijo's share of the predicted decrease, and the shortest step tried before the shift is raised.
_DECREASE, _SHORTEST = 1e-4, 1 / 64
# Energies agree to this share when round-off alone separates them; the residual then decides.
_ENERGY_NOISE = 1e-13
# A diagonal entry below this share of the largest is no stiffness at all (a flat sheet across its plane, a slack node).
_ZERO_DIAGONAL = 1e-14
# Away from an unstable equilibrium: the first push, as a share of the shortest side, and how exactly its direction is found.
_FIRST_PUSH, _INVERSE_ITERATIONS = 1e-3, 12


@dataclass(frozen=True)
class Factor:
    """A factorised symmetric matrix.

    :param negative: number of negative pivots, by Sylvester's law the number of negative eigenvalues.
    """

    solve: Callable[[Floats], Floats]
    negative: int


def factorise(pattern: Pattern, values: Floats, diagonal: Floats | None = None) -> Factor | None:
    """Factorise the matrix with the given lower-triangle values, with ``diagonal`` added; None when it is singular.

    SuperLU in its symmetric mode: minimum degree order of the pattern, diagonal pivots.
    """
    lower = sparse.csc_matrix((values, pattern.row, pattern.column_start), shape=(pattern.size, pattern.size))
    full = lower + sparse.tril(lower, -1).T
    if diagonal is not None:
        full = full + sparse.diags(diagonal)
    pivots = np.abs(full.diagonal())
    if pivots.min(initial=np.inf) <= _ZERO_DIAGONAL * pivots.max(initial=0.0):
        return None  # a node without stiffness; SuperLU would find out, but only after filling the whole matrix
    try:
        factor = linalg.splu(
            full.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # SuperLU's word for an exactly singular matrix
        return None
    pivots = factor.U.diagonal()
    if not np.all(np.isfinite(pivots)):
        return None
    return Factor(solve=factor.solve, negative=int((pivots < 0.0).sum()))


class Newton:
    """Newton's method for one membrane; shares its fields with a relaxation, whose masses scale the shift."""

    def __init__(self, membrane: Membrane, relaxation: Relaxation) -> None:
        self.membrane = membrane
        self.relaxation = relaxation
        self.tangent = Tangent(membrane)
        dof = self.tangent.pattern.node_dof
        self.free: NDArray[np.bool_] = dof >= 0
        self.shift = 0.0

    def compile(self) -> None:
        """Compile the assembly kernels."""
        self.tangent.assemble()

    def solve(
        self,
        *,
        tolerance: float,
        reference: float,
        loads: Floats,
        max_iterations: int,
        report: Callable[[Progress], None] | None = None,
    ) -> SolveRecord:
        """Iterate from the present displacements until the residual is below ``tolerance`` times ``reference``.

        :param loads: (node_count, 3) dead nodal forces, for the potential energy.
        """
        started = time.perf_counter()
        self.shift = 0.0
        position = self.membrane.displacement()
        energy = self.membrane.potential_energy(loads)[0]
        residual, reason, iteration = np.inf, "iteration limit", 0
        for iteration in range(max_iterations + 1):
            force = self.membrane.in_frames(self.membrane.out_of_balance())[self.free]
            residual = float(np.linalg.norm(force)) / reference
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
            if iteration == max_iterations:
                break
            found = self._step(position, energy, force, loads)
            if found is None:
                reason = "no descent"
                break
            position, energy = found
        return SolveRecord(
            converged=reason == "residual",
            reason=reason,
            iterations=iteration,
            residual=residual,
            peaks=0,
            seconds=time.perf_counter() - started,
            method="newton",
        )

    def _step(self, position: Floats, energy: float, force: Floats, loads: Floats) -> tuple[Floats, float] | None:
        """One step that lowers the energy: raise the shift until the tangent is definite and backtracking succeeds."""
        values = self.tangent.assemble()
        bound = self._stiffness_bound()
        while self.shift <= _LARGEST_SHIFT:
            factor = factorise(self.tangent.pattern, values, self.shift * bound if self.shift > 0.0 else None)
            if factor is not None and factor.negative == 0:
                direction = factor.solve(force)
                found = self._backtrack(position, energy, force, direction, loads)
                if found is not None:
                    position, energy, fraction = found
                    self._adapt_shift(fraction)
                    return position, energy
            self.shift = max(_SMALLEST_SHIFT, _SHIFT_FACTOR * self.shift)
        self.membrane.set_displacement(position)
        return None

    def _leave_saddle(self, position: Floats, energy: float, loads: Floats) -> tuple[Floats, float] | None:
        """A lower state beside an equilibrium that is unstable; None where the equilibrium is stable (or indifferent).

        Where the last steps needed no shift, the tangent was positive definite already. Otherwise the softest mode is found by
        inverse iteration, and the structure is pushed along it as far as the energy keeps falling.
        """
        if self.shift == 0.0:
            return None
        values, bound = self.tangent.assemble(), self._stiffness_bound()
        nearly = factorise(self.tangent.pattern, values, _SMALLEST_SHIFT * bound)
        if nearly is None or nearly.negative == 0:
            return None
        mode = self._softest_mode(values, bound)
        step = self._as_displacement(mode / np.abs(mode).max() * self.membrane.geometry.side_length.min())
        best: tuple[Floats, float] | None = None
        for sign in (1.0, -1.0):
            fraction = _FIRST_PUSH
            while fraction <= 1.0:
                trial = position + sign * fraction * step
                self.membrane.set_displacement(trial)
                reached = self.membrane.potential_energy(loads)[0]
                if reached >= (energy if best is None else best[1]):
                    break
                best = (trial, reached)
                fraction *= 2.0
        self.membrane.set_displacement(position if best is None else best[0])
        return best

    def _softest_mode(self, values: Floats, bound: Floats) -> Floats:
        """The mode of lowest (negative) curvature, by inverse iteration at a shift that has just become definite."""
        shift = _SMALLEST_SHIFT
        factor = None
        while shift <= _LARGEST_SHIFT and (factor is None or factor.negative > 0):
            shift *= _SHIFT_FACTOR
            factor = factorise(self.tangent.pattern, values, shift * bound)
        # A fixed start: runs repeat bit by bit.
        mode = np.random.default_rng(0).standard_normal(self.tangent.pattern.size)
        if factor is not None:
            for _ in range(_INVERSE_ITERATIONS):
                mode = factor.solve(bound * mode)
                mode /= np.linalg.norm(mode)
        return mode

    def _stiffness_bound(self) -> Floats:
        """Diagonal 2 M over free degrees of freedom, which bounds the tangent."""
        return 2.0 * np.repeat(self.relaxation.masses(), 3).reshape(-1, 3)[self.free]

    def _as_displacement(self, values: Floats) -> Floats:
        """Values at the free degrees of freedom as nodal displacements (node_count, 3) in x, y, z."""
        local = np.zeros(self.free.shape)
        local[self.free] = values
        return self.membrane.from_frames(local)

    def _adapt_shift(self, fraction: float) -> None:
        """Withdraw the shift after a full step, raise it after a short one."""
        if fraction == 1.0:
            self.shift = self.shift / _SHIFT_FACTOR if self.shift > _SMALLEST_SHIFT else 0.0
        elif fraction < 0.25 and self.shift > 0.0:
            self.shift = min(self.shift * _SHIFT_FACTOR, _LARGEST_SHIFT)

    def _backtrack(
        self, position: Floats, energy: float, force: Floats, direction: Floats, loads: Floats
    ) -> tuple[Floats, float, float] | None:
        """The longest of the fractions 1, ½, ¼ … of a step that lowers the energy by a share of what its slope promises."""
        slope = float(force @ direction)
        if not (np.isfinite(slope) and slope > 0.0):
            return None
        step = self._as_displacement(direction)
        noise = _ENERGY_NOISE * max(abs(energy), slope)
        fraction = 1.0
        while fraction >= _SHORTEST:
            trial = position + fraction * step
            self.membrane.set_displacement(trial)
            reached = self.membrane.potential_energy(loads)[0]
            if np.isfinite(reached) and reached <= energy - _DECREASE * fraction * slope + noise:
                return trial, reached, fraction
            fraction *= 0.5
        self.membrane.set_displacement(position)
        return None
