"""What a state is, whatever the run says of it: equilibrium, reactions, stability; from displacements, loads and the tangent."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import linalg as sparse_linalg

from taichi_membrane.assurance.verdicts.case import State
from taichi_membrane.mechanics.preparation import volume_gradient
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.results import StepResult

Floats = NDArray[np.float64]

# Eigenvalues of the tangent scaled to a unit diagonal are known to about its size times the unit round-off, 1e-12 here; slack
# fabric has exact zeros. Below the first negative eigenvalue of a passed limit (1e-4 and more in size) by orders of magnitude.
_NOISE = 1e-9
_DENSE = 3000  # up to so many components eigenvalues are found densely: 2.5 s; above by the signs of a sparse factor's pivots


def place(work: Any, model: Model, step: StepResult) -> None:
    """Put an analysis' membrane into the state of a load step, pressures of shut chambers as told."""
    work.system.set_displacement(step.displacement)
    state = LoadState(step.drivers)
    work.system.set_surface_loads(model.surface_values(state))
    work.system.set_loads(model.nodal_loads(state))


def examine(work: Any, model: Model, step: StepResult, *, potential: bool = True) -> State:
    """The state of one load step, taken anew.

    :param work: an analysis whose membrane holds the model's structure, double precision.
    """
    place(work, model, step)
    force = work.system.in_frames(work.system.out_of_balance())
    held = model.structure.node_held
    reaction = work.system.from_frames(np.where(held, -force, 0.0))
    applied = model.reference_load(LoadState(step.drivers))
    scale = float(np.hypot(applied, work.system.self_stress_norm()))
    tolerance = work.equilibrium.tolerance
    if applied == 0.0 and scale == 0.0:
        scale = float(np.linalg.norm(reaction))
        called = _called_up(work, model, step)
        scale = called if scale <= tolerance * called else scale
    size = float(np.linalg.norm(np.where(held, 0.0, force)))
    largest = float(np.abs(reaction).max())
    differs = float(np.abs(reaction - step.reaction).max())
    return State(
        stage=step.stage,
        stage_step=step.stage_step,
        residual=0.0 if size == 0.0 else size / scale if scale > 0.0 else np.inf,
        tolerance=tolerance,
        reactions=0.0 if differs == 0.0 else differs / largest if largest > 0.0 else np.inf,
        negative=negative_eigenvalues(tangent(work, model, step)) if potential and has_tangent(work) else None,
        told=step.negative_pivots,
    )


def _called_up(work: Any, model: Model, step: StepResult) -> float:
    """2-norm of the forces that a state's motions call up before anything gives way: what no resistance is compared with."""
    moved = model.moved(np.zeros_like(step.displacement), LoadState(step.drivers))
    work.system.set_displacement(moved)
    force = float(np.linalg.norm(work.system.out_of_balance()))
    work.system.set_displacement(step.displacement)
    return force


def has_tangent(work: Any) -> bool:
    """Whether the fabric's law has one."""
    return work.newton is not None


def tangent(work: Any, model: Model, step: StepResult) -> sparse.csr_matrix | Floats:
    """The tangent over free components at the state that the membrane is in; with what the gas in shut chambers adds."""
    free = ~model.structure.node_held.ravel()
    stiffness = work.newton.tangent.matrix()[free][:, free]
    shut = shut_by(model.scene, next(stage for stage in model.scene.stages if stage.name == step.stage))
    if not shut:
        return stiffness
    full: Floats = stiffness.toarray()
    places = model.structure.mesh.points + step.displacement
    for name in shut:
        chamber = model.chambers[model.pressure_names.index(name)]
        corners = model.structure.mesh.triangles[chamber.triangles]
        volume = float(chamber.sign @ np.linalg.det(places[corners] - places.mean(axis=0)) / 6.0)
        gradient = volume_gradient(places, corners, chamber.sign)
        gradient = work.system.in_frames(gradient).ravel()[free]
        gas = model.scene.pressures[name]
        absolute = step.pressures[name] + (gas.ambient or 0.0)
        full += gas.exponent * absolute / volume * np.outer(gradient, gradient)
    return full


def negative_eigenvalues(matrix: sparse.csr_matrix | Floats) -> int:
    """Number of negative eigenvalues of a symmetric matrix, beyond rounding."""
    diagonal = np.abs(matrix.diagonal())
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max()))
    if len(scale) <= _DENSE:
        dense = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
        values = linalg.eigvalsh(scale[:, None] * dense * scale, overwrite_a=True, check_finite=False)
        return int((values < -_NOISE).sum())
    scaled = sparse.diags_array(scale) @ sparse.csc_matrix(matrix) @ sparse.diags_array(scale)
    scaled = sparse.csc_matrix(scaled + _NOISE * sparse.eye_array(len(scale)))
    factor = sparse_linalg.splu(
        scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise ArithmeticError("a pivot left the diagonal: its sign says nothing of the eigenvalues")
    return int((factor.U.diagonal() < 0.0).sum())


def balance(points: Floats, step: StepResult, through: Floats | None = None) -> tuple[Floats, Floats]:
    """Sum of the reactions, and of their moments about a point (the origin), in the deformed state."""
    places = points + step.displacement - (0.0 if through is None else through)
    return step.reaction.sum(axis=0), np.cross(places, step.reaction).sum(axis=0)
