"""Values of a scene's probes at one load step, and its checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from taichi_membrane import scene as scenes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.names import STATE_NAMES
from taichi_membrane.scene import Check, Scene
from taichi_membrane.scene.base import LONGEST_NAME, is_name
from taichi_membrane.simulation.drainage import check_rim, drainage
from taichi_membrane.simulation.groups import group_nodes, group_triangles
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.present import node_area
from taichi_membrane.simulation.results import CheckResult, FieldValues, StepResult


def validate(model: Model) -> None:
    """Look up every probe's group, so that a misspelt one fails before the run and not after it.

    :raises InputError: no such group.
    """
    mesh = model.structure.mesh
    for name, probe in model.scene.probes.items():
        key = f"probes.{name}.group"
        if isinstance(probe, scenes.UtilisationProbe):
            _refuse_without_strength(model, group_triangles(mesh, probe.group, key), key)
        elif isinstance(probe, scenes.StressProbe | scenes.ResultantProbe | scenes.AreaProbe):
            elements = group_triangles(mesh, probe.group, key)
            if probe.kind == "resultant" and probe.which in ("warp", "weft", "shear"):
                _refuse_undirected(model, elements, f"probes.{name}.which = {probe.which!r}")
        elif isinstance(probe, scenes.DrainageProbe):
            check_rim(mesh, group_triangles(mesh, probe.group, key), key)
        elif isinstance(probe, scenes.VolumeProbe):
            model.measured(probe)
        elif not isinstance(
            probe,
            scenes.FactorProbe | scenes.BodyProbe | scenes.CableProbe | scenes.AbsoluteProbe | scenes.LevelProbe,
        ):
            group_nodes(mesh, probe.group, key)


def _refuse_without_strength(model: Model, elements: Ints, key: str) -> None:
    """Refuse to measure the utilisation of a fabric that has no strength.

    :raises InputError: with the fabric.
    """
    for number, (group, fabric) in enumerate(model.fabric_names()):
        if not fabric.has_strength and (model.structure.tri_fabric[elements] == number).any():
            raise InputError(
                f"{key}: the fabric of {group} has no strength to compare with; give it strength_warp and strength_weft, or "
                "a group without it"
            )


def _refuse_undirected(model: Model, elements: Ints, key: str) -> None:
    """Refuse to measure along the warp of elements that have none: of an isotropic fabric it may be any direction.

    :raises InputError: with the fabric.
    """
    structure = model.structure
    for number, (group, fabric) in enumerate(model.fabric_names()):
        if structure.mesh.tri_warp is None and fabric.warp is None and (structure.tri_fabric[elements] == number).any():
            raise InputError(f"{key}: neither this mesh nor the fabric of {group} has a warp; give it warp = [x, y, z]")


def validate_own(model: Model) -> None:
    """Refuse probes of one's own that cannot stand beside the scene's.

    :raises InputError: a name that is taken or that no scene would allow; what cannot be called.
    """
    for name, function in model.own_probes.items():
        if name in model.scene.probes:
            raise InputError(f"probes: {name!r} is a probe of the scene already; give another name")
        if not is_name(name):
            raise InputError(
                f"probes: {name!r} is no name: a letter, then letters, digits and _, at most {LONGEST_NAME}"
            )
        if not callable(function):
            raise InputError(f"probes: {name!r} is {function!r}; give a function of the mesh and the load step")


def with_own(model: Model, step: StepResult) -> StepResult:
    """The load step with the values of the probes of one's own.

    :raises InputError: one of them gives no number.
    """
    values = dict(step.probes)
    for name, function in model.own_probes.items():
        value = function(model.structure.mesh, step)
        try:
            values[name] = float(value)
        except (TypeError, ValueError):
            raise InputError(
                f"probes: {name!r} gave {value!r} at {step.stage} {step.stage_step}; a number is needed"
            ) from None
    return replace(step, probes=values)


def evaluate(
    model: Model,
    fields: FieldValues,
    swept: Floats,
    state: LoadState,
    contact: Mapping[str, Floats] | None = None,
    pushes: Mapping[str, Floats] | None = None,
) -> dict[str, float]:
    """Value of every probe of the scene, in its units.

    :param swept: (tri_count,) volume that each triangle has swept since rest.
    :param contact: (n, 3) forces of each plane and obstacle; ``pushes`` (n,) what of them is across it.
    """
    mesh = model.structure.mesh
    displacement, reaction = fields["displacement"], fields["reaction"]
    values: dict[str, float] = {}
    for name, probe in model.scene.probes.items():
        key = f"probes.{name}.group"
        if isinstance(probe, scenes.VolumeProbe):
            triangles, share, rest = model.measured(probe)
            values[name] = rest + float((share * swept[triangles]).sum())
        elif isinstance(probe, scenes.AbsoluteProbe):
            values[name] = state.pressures[probe.pressure] + model.outside(state, probe.pressure)
        elif isinstance(probe, scenes.LevelProbe):
            values[name] = model.surface.level(probe.load, state.loads[probe.load], displacement)
        elif isinstance(probe, scenes.FactorProbe):
            values[name] = state.values[probe.of]
        elif isinstance(probe, scenes.BodyProbe):
            values[name] = _component(of_body(model, probe, displacement, reaction), probe.component)
        elif isinstance(probe, scenes.ContactProbe):
            chosen = group_nodes(mesh, probe.group, key)
            values[name] = _of_contact(
                probe, model, displacement, (contact or {})[probe.obstacle], (pushes or {})[probe.obstacle], chosen
            )
        elif isinstance(probe, scenes.DisplacementProbe):
            mean = displacement[group_nodes(mesh, probe.group, key)].mean(axis=0)
            values[name] = _component(mean, probe.component)
        elif isinstance(probe, scenes.PositionProbe):
            values[name] = _pick(
                (mesh.points + displacement)[group_nodes(mesh, probe.group, key)].mean(axis=0), probe.component
            )
        elif isinstance(probe, scenes.ReactionProbe):
            values[name] = _pick(reaction[group_nodes(mesh, probe.group, key)].sum(axis=0), probe.component)
        elif isinstance(probe, scenes.MomentProbe):
            nodes = group_nodes(mesh, probe.group, key)
            arms = (mesh.points + displacement)[nodes] - np.array(probe.through)
            values[name] = float(np.cross(arms, reaction[nodes]).sum(axis=0) @ _unit(probe.axis))
        elif isinstance(probe, scenes.RotationProbe):
            nodes = group_nodes(mesh, probe.group, key)
            values[name] = _mean_rotation(
                mesh.points[nodes] - np.array(probe.through), displacement[nodes], _unit(probe.axis)
            )
        elif isinstance(probe, scenes.RadiusProbe):
            nodes = group_nodes(mesh, probe.group, key)
            values[name] = _mean_radius((mesh.points + displacement)[nodes], probe.axis)
        elif isinstance(probe, scenes.CableProbe):
            values[name] = _of_cable(probe, model, fields)
        elif isinstance(probe, scenes.DrainageProbe):
            values[name] = drainage(probe, mesh, group_triangles(mesh, probe.group, key), displacement)
        elif isinstance(probe, scenes.UtilisationProbe):
            values[name] = float(fields["utilisation"][group_triangles(mesh, probe.group, key)].max())
        else:
            values[name] = _over_elements(probe, fields, model.structure, group_triangles(mesh, probe.group, key))
    return values


def of_body(model: Model, probe: scenes.BodyProbe, displacement: Floats, reaction: Floats) -> Floats:
    """(3,) what a probe of a rigid body measures, along x, y, z."""
    body = model.structure.bodies[list(model.scene.bodies).index(probe.body)]
    if probe.of == "displacement":
        return body.pose(displacement)[0] - body.centre
    if probe.of == "rotation":
        return np.rad2deg(body.rotation(displacement))
    forces = reaction[body.nodes]
    return forces.sum(axis=0) if probe.of == "force" else np.cross(body.present_arms(displacement), forces).sum(axis=0)


def _component(vector: Floats, component: str) -> float:
    return float(np.linalg.norm(vector)) if component == "magnitude" else _pick(vector, component)


def _pick(vector: Floats, component: str) -> float:
    return float(vector["xyz".index(component)])


def _unit(axis: scenes.Vector) -> Floats:
    return np.array(axis) / np.linalg.norm(axis)


def _mean_rotation(arms: Floats, displacement: Floats, axis: Floats) -> float:
    """Angle in degrees about ``axis`` that carries the arms nearest to their displaced places, in the least-squares sense."""
    before = arms - np.outer(arms @ axis, axis)
    after = arms + displacement - np.outer((arms + displacement) @ axis, axis)
    sine = float((np.cross(before, after) @ axis).sum())
    return float(np.rad2deg(np.arctan2(sine, float((before * after).sum()))))


def _mean_radius(positions: Floats, axis: str) -> float:
    """Mean distance from the middle of the positions, measured across ``axis`` unless that is ``centre``."""
    arms = positions - positions.mean(axis=0)
    if axis != "centre":
        arms[:, "xyz".index(axis)] = 0.0
    return float(np.linalg.norm(arms, axis=1).mean())


def _over_elements(
    probe: scenes.StressProbe | scenes.ResultantProbe | scenes.AreaProbe,
    fields: FieldValues,
    structure: Structure,
    group: Ints,
) -> float:
    weights = structure.mesh.tri_areas()[group]
    if isinstance(probe, scenes.AreaProbe) and structure.samples > 1:
        areas = structure.geometry.area.reshape(-1, structure.samples)[group]
        return float(areas[fields["point_state"][group] == STATE_NAMES.index(probe.state)].sum() / areas.sum())
    if isinstance(probe, scenes.AreaProbe):
        in_state = fields["state"][group] == STATE_NAMES.index(probe.state)
        return float(weights[in_state].sum() / weights.sum())
    stress = _stress(probe, fields, structure)[group]
    if probe.reduce == "mean":
        return float(np.average(stress, weights=weights))
    return float(stress.max() if probe.reduce == "max" else stress.min())


def _stress(probe: scenes.StressProbe | scenes.ResultantProbe, fields: FieldValues, structure: Structure) -> Floats:
    """(m,) the stress or stress resultant that a probe looks at."""
    if isinstance(probe, scenes.StressProbe) or probe.measure == "Cauchy":
        return fields[f"{probe.which}_{probe.kind}"]
    axes = ("warp", "weft", "shear")
    of_area = fields["stress"][:, axes.index(probe.which)] if probe.which in axes else fields[f"{probe.which}_stress"]
    return of_area * structure.thickness


def _of_cable(probe: scenes.CableProbe, model: Model, fields: FieldValues) -> float:
    """Force, length or slack share of a cable."""
    mesh = model.structure.mesh
    nodes, owner = line_elements(model.scene, mesh)
    own = np.flatnonzero(owner == list(model.scene.cables).index(probe.cable))
    ends, force = nodes[own], fields["cable_force"][own]
    at_rest, now = (
        np.linalg.norm(at[ends[:, 1]] - at[ends[:, 0]], axis=1)
        for at in (mesh.points, mesh.points + fields["displacement"])
    )
    if probe.what == "length":
        return float(now.sum())
    if probe.what == "slack":
        return float(at_rest[force == 0.0].sum() / at_rest.sum())
    if probe.reduce == "mean":
        return float(np.average(force, weights=at_rest))
    return float(force.max() if probe.reduce == "max" else force.min())


def _of_contact(
    probe: scenes.ContactProbe, model: Model, displacement: Floats, force: Floats, push: Floats, nodes: Ints
) -> float:
    """Resultant, area, or largest pressure of contact with one obstacle on some nodes."""
    if probe.of == "force":
        return _component(force[nodes].sum(axis=0), probe.component)
    area, push = node_area(model.structure.mesh, displacement)[nodes], push[nodes]
    touched = push > 0.0
    if probe.of == "area":
        return float(area[touched].sum())
    return float(np.max(push[touched] / area[touched], initial=0.0))


def run_checks(scene: Scene, steps: Sequence[StepResult]) -> tuple[CheckResult, ...]:
    """Judge every check of the scene; one whose step was not reached, or did not converge, fails without a value."""
    return tuple(_check(scene, check, steps) for check in scene.checks)


def _check(scene: Scene, check: Check, steps: Sequence[StepResult]) -> CheckResult:
    stage = scene.ramp(check.stage)
    done = [s.stage_step for s in steps if s.stage == check.stage]
    count = max(done, default=0) if stage.may_end_early else stage.steps
    wanted = check.step if check.step > 0 else count + 1 + check.step
    found = [s for s in steps if s.stage == check.stage and s.stage_step == wanted and s.converged]
    relative = check.tolerance is not None
    tolerance = float(check.tolerance if check.tolerance is not None else check.absolute or 0.0)
    value = found[0].probes[check.probe] if found else None
    error = None if value is None else _error(check, value)
    return CheckResult(
        probe=check.probe,
        stage=check.stage,
        step=wanted,
        value=value,
        reference=check.reference,
        error=error,
        tolerance=tolerance,
        relative=relative,
        source=check.source,
        passed=error is not None and (error if check.reference is None else abs(error)) <= tolerance,
        at_most=check.at_most,
        at_least=check.at_least,
    )


def _error(check: Check, value: float) -> float:
    """Of a value against the reference, or by how much it passes the worse of the bounds."""
    if check.reference is not None:
        return (value - check.reference) / (abs(check.reference) if check.tolerance is not None else 1.0)
    above = -np.inf if check.at_most is None else value - check.at_most
    below = -np.inf if check.at_least is None else check.at_least - value
    return float(max(above, below))
