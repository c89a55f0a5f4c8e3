"""What the families' modules share: problems with their last stage cut anew, and numbers of balance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts.case import Case
from taichi_membrane.assurance.verdicts.oracle import balance
from taichi_membrane.assurance.verdicts.truth import stored
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult


def cut(problem: Problem, steps: int, exact: Mapping[str, float] | None = None, **stage: Any) -> Problem:
    """The problem with so many load steps in its last stage, and other keys of that stage.

    :param exact: numbers in place of the problem's own.
    """
    *before, last = problem.scene["stages"]
    scene = {**problem.scene, "stages": [*before, {**last, "steps": steps, **stage}]}
    return replace(problem, scene=scene, exact=problem.exact if exact is None else exact)


def traced(name: str, **parts: Any) -> Case:
    """A case whose truth is the stored one."""
    return Case(name=name, truth=stored(name), **parts)


def in_balance(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
    """Sums of reactions and of their moments about the mesh's middle, over those of their sizes: zero in a run by motions alone.

    The residual's tolerance is 1e-6 of the reactions' norm; summed over n free nodes it makes at most √n times as much.
    """
    last, middle = steps[-1], mesh.points.mean(axis=0)
    force, moment = balance(mesh.points, last, middle)
    arms = np.linalg.norm(mesh.points + last.displacement - middle, axis=1)
    sizes = np.linalg.norm(last.reaction, axis=1)
    return {
        "forces": float(np.linalg.norm(force) / sizes.sum()),
        "moments": float(np.linalg.norm(moment) / (arms * sizes).sum()),
    }


BALANCED = {"forces": 0.0, "moments": 0.0}
