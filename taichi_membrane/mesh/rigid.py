"""Finds the rigid motions that the supports of a mesh leave free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh.topology import node_parts

if TYPE_CHECKING:
    from taichi_membrane.mesh import Mesh

# Singular values of the scaled modes lie between about 1 and the held patch's share of the body's size; round-off of
# the coordinates is 1e-16. A support of one part in 1e9 of the size holds nothing that matters.
RANK_TOLERANCE = 1e-9
# Two directions nearer than this are the same in words.
SAME_DIRECTION = 1e-6


class Clamp(NamedTuple):
    """A rigid part: one of its nodes, a point of it, and which displacements of that and rotations, (2, 3), are held."""

    node: int
    point: NDArray[np.float64]
    held: NDArray[np.bool_]


def rigid_motions_left(
    mesh: Mesh,
    node_fixed: NDArray[np.bool_],
    node_frame: NDArray[np.float64] | None = None,
    ties: NDArray[np.integer[Any]] | None = None,
    clamps: Sequence[Clamp] = (),
) -> list[str]:
    """Describe in words every rigid motion the held degrees of freedom do not prevent, for each connected part.

    :param node_fixed: (node_count, 3) True where a displacement component is prescribed.
    :param node_frame: (node_count, 3, 3) rows are each node's own axes, which ``node_fixed`` then refers to; x, y, z when None.
    :param ties: (n, 2) nodes that something beside the triangles joins; how a chain of them can move in itself is not told,
        nor how a part of ties alone can turn: what is hung up swings, and its load decides where.
    :param clamps: what is held of rigid parts, beside single nodes.
    :return: for example ``translation along x`` or ``rotation about z through (0, 0, 0)``; empty when all is held.
    :raises InputError: ``node_fixed`` has another shape.
    """
    fixed = np.asarray(node_fixed, dtype=bool)
    if fixed.shape != mesh.points.shape:
        raise InputError(f"node_fixed must have shape {mesh.points.shape}, got {fixed.shape}")
    edges = mesh.edges() if ties is None else np.concatenate((mesh.edges(), ties)).astype(np.int32)
    label = node_parts(edges, mesh.node_count)[1]
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(label))[:-1])
    told: list[str] = []
    in_triangle = np.zeros(mesh.node_count, dtype=bool)
    in_triangle[mesh.triangles] = True
    for nodes in parts:
        which = "" if len(parts) == 1 else f" of the part with node {nodes[0]} ({len(nodes)} nodes)"
        frames = np.eye(3)[None] if node_frame is None else node_frame[nodes]
        here = [one for one in clamps if label[one.node] == label[nodes[0]]]
        turns = bool(here) or bool(in_triangle[nodes].any())
        told += [f"{motion}{which}" for motion in _motions(mesh.points[nodes], fixed[nodes], frames, here, turns=turns)]
    return told


def _motions(
    points: NDArray[np.float64],
    fixed: NDArray[np.bool_],
    frames: NDArray[np.float64],
    clamps: Sequence[Clamp],
    *,
    turns: bool,
) -> list[str]:
    held = fixed.any(axis=1)
    pinned = np.array([*points[held], *(one.point for one in clamps if one.held.any())])
    frames = np.broadcast_to(frames, (len(points), 3, 3))
    # Rotations are taken about the middle of the held nodes, so that a pinned node is named as it is.
    origin = pinned.mean(axis=0) if len(pinned) else points.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    rows = [_held_modes((points[held] - origin) / size, fixed[held], frames[held])]
    for one in clamps:
        rows += [
            _held_modes((one.point - origin)[None] / size, one.held[:1], np.eye(3)[None]),
            np.eye(6)[3:][one.held[1]],
        ]
    free = _null_space(np.concatenate(rows))
    free = _that_move((points - origin) / size, free)
    translations = free @ _null_space(free[3:])
    told = [f"translation along {_direction(t)}" for t in _readable_basis(translations[:3])]
    for axis in _readable_basis(free[3:]) if turns else ():
        # The least motion with this rotation: it holds no part of the free translations.
        motion = free @ np.linalg.lstsq(free[3:], axis, rcond=RANK_TOLERANCE)[0]
        told.append(_rotation(motion[:3] * size, axis, origin, size))
    return told


def _that_move(arms: NDArray[np.float64], free: NDArray[np.float64]) -> NDArray[np.float64]:
    """The motions (6, k) less those that move no node: a straight chain does not turn about itself."""
    if not free.shape[1] or np.linalg.matrix_rank(arms - arms[0], tol=RANK_TOLERANCE) > 1:
        return free
    all_modes = _held_modes(arms, np.ones_like(arms, dtype=bool), np.broadcast_to(np.eye(3), (len(arms), 3, 3)))
    _, values, right = np.linalg.svd(np.linalg.qr(all_modes, mode="r") @ free)
    return free @ right[: int((values > RANK_TOLERANCE).sum())].T


def _held_modes(
    arms: NDArray[np.float64], fixed: NDArray[np.bool_], frames: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the six rigid modes (3 translations, 3 rotations, scaled) at the held degrees of freedom, (n, 6)."""
    modes = np.zeros((len(arms), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return np.einsum("nij,njk->nik", frames, modes)[fixed]


def _null_space(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    columns = matrix.shape[1]
    if 0 in matrix.shape:
        return np.eye(columns)
    # The triangular factor has the same null space and at most as many rows as columns, however many are held.
    _, values, right = np.linalg.svd(np.linalg.qr(matrix, mode="r"))
    rank = int((values > RANK_TOLERANCE).sum())
    return right[rank:].T


def _column_space(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    if 0 in matrix.shape:
        return np.zeros((3, 0))
    left, values, _ = np.linalg.svd(matrix)
    return left[:, : int((values > RANK_TOLERANCE).sum())]


def _readable_basis(space: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return unit vectors that span the columns of ``space`` (3, k): coordinate axes first where they lie in it."""
    space = _column_space(space)
    basis: list[NDArray[np.float64]] = []
    for axis in np.eye(3):
        if np.linalg.norm(axis - space @ (space.T @ axis)) < SAME_DIRECTION:
            basis.append(axis)
    for vector in space.T:
        rest = vector - sum((b * (b @ vector) for b in basis), np.zeros(3))
        if len(basis) < space.shape[1] and np.linalg.norm(rest) > SAME_DIRECTION:
            basis.append(rest / np.linalg.norm(rest))
    return basis


def _direction(vector: NDArray[np.float64]) -> str:
    largest = int(np.argmax(np.abs(vector)))
    unit = vector * np.sign(vector[largest]) / np.linalg.norm(vector)
    if 1.0 - unit[largest] < SAME_DIRECTION:
        return "xyz"[largest]
    return _listed(unit, 1.0)


def _rotation(shift: NDArray[np.float64], axis: NDArray[np.float64], origin: NDArray[np.float64], size: float) -> str:
    # Velocity shift + axis x (point - origin) size/size: the axis passes where the shift across it is cancelled.
    through = origin + np.cross(axis, shift)
    pitch = float(shift @ axis)
    words = f"rotation about {_direction(axis)} through {_listed(through, size)}"
    if abs(pitch) > SAME_DIRECTION * size:
        words += f" with an advance of {abs(pitch):.4g} per radian along it"
    return words


def _listed(vector: NDArray[np.float64], size: float) -> str:
    # Rounding noise far below the body's size would read as numbers like 3e-17.
    shown = np.where(np.abs(vector) < SAME_DIRECTION * size, 0.0, vector)
    return "(" + ", ".join(f"{v:.4g}" for v in shown) + ")"
