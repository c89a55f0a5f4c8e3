"""Lowest vibration modes, and linearised buckling modes, of a structure at rest; scipy's Lanczos on the tangent stiffness."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.scene import Modes
from taichi_membrane.simulation.results import ModeResult
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import Path

# Share of the way to a stage's target over which the change of the tangent is measured, for linearised buckling.
_CHANGE = 1e-4
# Up to so many degrees of freedom dense algebra is as fast, and finds all modes.
_DENSE = 30


def vibration(newton: Newton, factor: Factor, mass: Floats, asked: Modes) -> ModeResult:
    """Small vibrations in vacuo about the present state: K φ = ω² M φ; the values are frequencies ω/2π.

    A negative value stands for an unstable mode, whose growth rate over 2π it is.

    :raises ArithmeticError: the tangent is singular to round-off.
    """
    free = newton.free.ravel()
    stiffness, masses = _free_matrix(newton), scipy.sparse.diags(np.repeat(mass, 3)[free])
    squared, shapes, missing = _eigenpairs(
        stiffness, masses, asked.count, largest=False, sigma=0.0, OPinv=_inverse(newton, factor), which="LM"
    )
    values = np.sign(squared) * np.sqrt(np.abs(squared)) / (2.0 * np.pi)
    return ModeResult(kind="vibration", values=tuple(values.tolist()), shapes=_shapes(newton, shapes), missing=missing)


def buckling(path: Path, position: Floats, present: float, factor: Factor, asked: Modes) -> ModeResult:
    """Shares of the way to a stage's target at which the tangent becomes singular, extrapolated linearly: (K + μ K') φ = 0.

    K' is the change of the tangent with the share, by central differences along the path's own direction. The values are
    ``present`` + μ; only those ahead are given.

    :raises ArithmeticError: the tangent is singular to round-off.
    """
    newton, system = path.newton, path.newton.system
    tangent = path.tangent(factor, present)
    if not np.isfinite(tangent).all():
        raise ArithmeticError(factor.refusal)
    change = []
    for sign in (1.0, -1.0):
        system.set_displacement(system.retract(position, sign * _CHANGE * tangent))
        path.apply(present + sign * _CHANGE)
        change.append(_free_matrix(newton))
    system.set_displacement(position)
    path.apply(present)
    stiffness = _free_matrix(newton)
    softening = (change[1] - change[0]) / (2.0 * _CHANGE)
    inverse, shapes, missing = _eigenpairs(
        softening, stiffness, asked.count, largest=True, Minv=_inverse(newton, factor), which="LA"
    )
    ahead = inverse > 0.0
    values = tuple((present + 1.0 / inverse[ahead]).tolist())
    if not ahead.all():
        told = f"{len(values)} of the {len(inverse)} found are ahead of the present load"
        missing = f"{missing}; {told}" if missing else told
    return ModeResult(kind="buckling", values=values, shapes=_shapes(newton, shapes[:, ahead]), missing=missing)


def _eigenpairs(matrix: Any, weight: Any, count: int, *, largest: bool, **lanczos: Any) -> tuple[Floats, Floats, str]:
    """Lowest, or largest first, eigenpairs of A φ = μ B φ, and why there are fewer than asked: by Lanczos, and for a few degrees
    of freedom by dense algebra."""
    size, missing = matrix.shape[0], ""
    if size <= max(_DENSE, count + 1):
        values, vectors = scipy.linalg.eigh(matrix.toarray(), weight.toarray())
        if size < count:
            missing = f"{size} of {count} modes: there are no more degrees of freedom"
    else:
        try:
            values, vectors = scipy.sparse.linalg.eigsh(matrix, k=count, M=weight, v0=_start(size), **lanczos)
        except scipy.sparse.linalg.ArpackNoConvergence as error:
            values, vectors = error.eigenvalues, error.eigenvectors
            missing = f"{len(values)} of {count} modes converged"
    order = np.argsort(-values if largest else values)[:count]
    return values[order], vectors[:, order], missing


def _free_matrix(newton: Newton) -> Any:
    """The present tangent over free components."""
    free = newton.free.ravel()
    return newton.tangent.matrix()[free][:, free]


def _inverse(newton: Newton, factor: Factor) -> scipy.sparse.linalg.LinearOperator:
    """Solution with the factorised tangent over free components."""
    free = newton.free

    def solve(vector: Floats) -> Floats:
        right = np.zeros(free.shape)
        right[free] = vector.ravel()
        solution = factor.solve(right)[free]
        if not np.isfinite(solution).all():
            raise ArithmeticError(factor.refusal)
        return solution

    size = int(free.sum())
    return scipy.sparse.linalg.LinearOperator((size, size), matvec=solve, dtype=np.float64)


def _start(size: int) -> Floats:
    """A fixed start vector: runs repeat bit by bit."""
    return np.random.default_rng(0).standard_normal(size)


def _shapes(newton: Newton, vectors: Floats) -> Floats:
    """(count, node_count, 3) mode shapes in x, y, z, the largest displacement of each being 1."""
    shapes = np.zeros((vectors.shape[1], *newton.free.shape))
    for shape, vector in zip(shapes, vectors.T, strict=True):
        shape[newton.free] = vector
        shape[:] = newton.system.from_frames(shape)
        largest = shape.ravel()[np.abs(shape).argmax()]
        shape /= largest
    return shapes
