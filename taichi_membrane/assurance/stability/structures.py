"""The small structures that the stress cases vary, as scene data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import shapes
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

Floats = NDArray[np.float64]
Data = dict[str, Any]

GIVEN = {"shape": "given"}
# Beam: a tube of radius 1 with one end clamped and a hemisphere at the other.
BEAM_LENGTH, BEAM_PRESSURE, BEAM_STIFFNESS = 4.0, 0.01, 1.0
BEAM_COLLAPSE = math.pi * BEAM_PRESSURE / BEAM_LENGTH  # Comer and Levy: π p r³/L


def beam(fabric: Mapping[str, Any] | None = None, *, share: float = 0.6, steps: int = 1) -> Data:
    """The beam inflated to p r/(E t) = 0.01, then loaded at its end with a share of its collapse load."""
    return {
        "mesh": {"shape": "tube", "radius": 1.0, "length": BEAM_LENGTH, "around": 12, "along": 12},
        "fabric": fabric or {"E": BEAM_STIFFNESS, "nu": 0.3, "thickness": 1.0},
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": [0.0, 0.0, -BEAM_COLLAPSE]}},
        "stages": [
            {"name": "inflate", "pressure": BEAM_PRESSURE},
            {"name": "load", "steps": steps, "loads": {"tip": share}},
        ],
    }


def beam_tip(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
    """Deflection of the beam's end ring over its radius."""
    return {"tip": float(steps[-1].displacement[mesh.node_groups["end"], 2].mean())}


def ball(pressure: float, *, radius: float = 1.0, fabric: Mapping[str, Any] | None = None) -> Data:
    """A sphere under pressure, held by its planes of symmetry; E t = radius, so that p alone decides the stretch."""
    return {
        "mesh": GIVEN,
        "fabric": fabric or {"E": 1.0, "nu": 0.3, "thickness": radius},
        "supports": [{"group": f"{axis}_zero", "hold": axis} for axis in "xyz"],
        "stages": [{"name": "inflate", "pressure": pressure}],
    }


def ball_mesh(radius: float = 1.0, offset: float = 0.0, divisions: int = 4) -> Mesh:
    """A sphere of 128 triangles with its planes of symmetry as groups, moved by ``offset`` along each axis."""
    mesh = shapes.sphere(radius=1.0, divisions=divisions)
    planes = {f"{axis}_zero": np.flatnonzero(np.abs(mesh.points[:, c]) < 1e-9) for c, axis in enumerate("xyz")}
    return Mesh.build(radius * mesh.points + offset, mesh.triangles, planes, None, mesh.tri_warp)


def ball_stretch(mesh: Mesh, steps: Sequence[StepResult]) -> float:
    """Mean radius of the deformed sphere over that at rest."""
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    rest = mesh.points - middle
    return float(np.linalg.norm(rest + steps[-1].displacement, axis=1).mean() / np.linalg.norm(rest, axis=1).mean())


def ball_extension(mesh: Mesh, steps: Sequence[StepResult]) -> float:
    """Mean radial displacement over the radius: the stretch less one, with all its digits."""
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    rest = mesh.points - middle
    return float((rest * steps[-1].displacement).sum() / (rest * rest).sum())


def graded_panel(x: Floats, y: Floats) -> Mesh:
    """A flat panel whose grid lines are at the given coordinates, from 0 up; diagonals alternate."""
    unit = shapes.panel(width=1.0, height=1.0, along_x=len(x) - 1, along_y=len(y) - 1, pattern="alternating")
    columns = np.rint(unit.points[:, 0] * (len(x) - 1)).astype(int)
    rows = np.rint(unit.points[:, 1] * (len(y) - 1)).astype(int)
    points = np.column_stack((x[columns], y[rows], np.zeros(len(columns))))
    warp = np.tile([1.0, 0.0, 0.0], (unit.tri_count, 1))
    return Mesh.build(points, unit.triangles, unit.node_groups, None, warp)


def patch_test(fabric: Mapping[str, Any], stress: Sequence[float], thickness: float = 1.0) -> Data:
    """A flat panel in its plane under uniform normal stresses along x and y: linear displacements on any mesh."""
    resultant = [one * thickness for one in stress]
    return {
        "mesh": GIVEN,
        "fabric": fabric,
        "supports": [
            {"group": "all", "hold": "z"},
            {"group": "x_min", "hold": "x"},
            {"group": "y_min", "hold": "y"},
        ],
        "loads": {
            "right": {"group": "x_max", "kind": "line", "direction": [resultant[0], 0.0, 0.0]},
            "top": {"group": "y_max", "kind": "line", "direction": [0.0, resultant[1], 0.0]},
        },
        "stages": [{"name": "pull", "loads": {"right": 1.0, "top": 1.0}}],
    }


def patch_strains(mesh: Mesh, steps: Sequence[StepResult]) -> tuple[float, float, float]:
    """Mean strain along x and along y, and the largest deviation of any node from linear displacements over the panel's."""
    moved, size = steps[-1].displacement, np.ptp(mesh.points, axis=0)
    ends = [moved[mesh.node_groups[f"{axis}_max"], c].mean() for c, axis in enumerate("xy")]
    linear = np.column_stack((mesh.points[:, 0] / size[0] * ends[0], mesh.points[:, 1] / size[1] * ends[1]))
    deviation = float(np.abs(moved[:, :2] - linear).max(axis=0).max() / max(map(abs, ends)))
    return float(ends[0] / size[0]), float(ends[1] / size[1]), deviation
