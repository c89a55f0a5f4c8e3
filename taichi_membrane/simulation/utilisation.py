"""How much of their strength fabrics use: Cauchy resultant × factor on effects / (strength / safety factor)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Scene
from taichi_membrane.simulation.groups import fabric_list, groups_at
from taichi_membrane.simulation.results import RunResult, StepResult

DIRECTIONS = ("warp", "weft", "major")  # those that strengths are given for, and resultants compared in


@dataclass(frozen=True, kw_only=True)
class Utilised:
    """Where a load step uses most of a strength.

    :param value: resultant × ``factor`` / (``strength`` / ``safety``).
    :param direction: of :data:`DIRECTIONS`, in which; ``resultant`` there, Cauchy.
    :param place: middle of the deformed element.
    :param groups: element groups that it belongs to, in words; ``fabric`` the group of its fabric.
    """

    value: float
    element: int
    direction: str
    resultant: float
    factor: float
    strength: float
    safety: float
    place: tuple[float, float, float]
    fabric: str
    groups: str


def strengths(fabric: Fabric) -> tuple[float, float, float]:
    """Strength of a fabric in each of :data:`DIRECTIONS`: infinite where none is given but others are, undefined where none are."""
    if not fabric.has_strength:
        return (np.nan,) * 3
    given = (fabric.strength_warp, fabric.strength_weft, fabric.strength)
    warp, weft, major = (np.inf if one is None else one for one in given)
    return warp, weft, major


def allowed(scene: Scene, tri_fabric: Ints) -> Floats:
    """(m, 3) resultants at which each element's fabric is used up in each of :data:`DIRECTIONS`: strength over safety factor."""
    rows = [
        np.array(strengths(fabric)) / (1.0 if fabric.safety is None else fabric.safety.factor)
        for _, fabric in fabric_list(scene)
    ]
    return np.asarray(np.array(rows)[tri_fabric])


def effect_factor(scene: Scene, stage: str) -> float:
    """The factor on resultants in a stage."""
    return scene.ramp(stage).effect_factor


def largest(scene: Scene, mesh: Mesh, step: StepResult) -> Utilised | None:
    """Where a load step uses most of a strength; None where no fabric has one, or the step is no equilibrium."""
    values = step.fields.get("utilisation")
    if values is None or not step.converged or not np.isfinite(values).any():
        return None
    element = int(np.nanargmax(values))
    group, fabric = _fabric_at(scene, mesh, element)
    safety = 1.0 if fabric.safety is None else fabric.safety.factor
    given = np.array(strengths(fabric))
    acting = np.array([step.fields[f"{name}_resultant"][element] for name in DIRECTIONS])
    chosen = int(np.argmax(acting / given))
    x, y, z = (mesh.points + step.displacement)[mesh.triangles[element]].mean(axis=0).tolist()
    return Utilised(
        value=float(values[element]), element=element, direction=DIRECTIONS[chosen], resultant=float(acting[chosen]),
        factor=effect_factor(scene, step.stage), strength=float(given[chosen]), safety=safety, place=(x, y, z),
        fabric=group, groups=groups_at(mesh, element),
    )  # fmt: skip


def by_stage(result: RunResult) -> dict[str, tuple[StepResult, Utilised]]:
    """The load step of each stage, and of each case that was reached, that uses most of a strength, and where."""
    missed = {name for name, case in result.cases.items() if not case.reached}
    found: dict[str, tuple[StepResult, Utilised]] = {}
    for step, used in _used(result):
        if step.stage in missed:
            continue
        if step.stage not in found or used.value > found[step.stage][1].value:
            found[step.stage] = (step, used)
    return found


def _used(result: RunResult) -> Iterable[tuple[StepResult, Utilised]]:
    for step in result.steps:
        used = largest(result.scene, result.mesh, step)
        if used is not None:
            yield step, used


def _fabric_at(scene: Scene, mesh: Mesh, element: int) -> tuple[str, Fabric]:
    """Group and fabric of an element."""
    fabrics = fabric_list(scene)
    own = [(name, one) for name, one in fabrics if name in scene.fabrics and element in mesh.tri_groups[name]]
    return own[0] if own else fabrics[0]


def words(used: Utilised, scene: Scene) -> str:
    """A utilisation in a line: how much, of what, and where."""
    units = scene.units
    factor = "" if used.factor == 1.0 else f" × {used.factor:g}"
    place = ", ".join(f"{part:.4g}" for part in used.place)
    return (
        f"{used.value:.4g}: {used.direction} resultant {used.resultant:.4g}{factor} over {used.strength:.4g}/{used.safety:g} "
        f"{units.resultant}, fabric of {used.fabric}, element {used.element} {used.groups}, at ({place}) {units.length}"
    )
