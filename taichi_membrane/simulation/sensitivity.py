"""Derivatives of probes with respect to loads, pressures, shrinkages, temperatures and thicknesses by one solve each (adjoint).

With F(u, θ) = 0 the out-of-balance forces and K = -∂F/∂u, a probe g(u) has dg/dθ = a·∂F/∂θ, where Kᵀ a = ∂g/∂u.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taichi_membrane import scene as scenes
from taichi_membrane.algebra.protocol import Factor
from taichi_membrane.algebra.refinement import GOOD
from taichi_membrane.mechanics.preparation import Floats, volume_gradient
from taichi_membrane.mechanics.system import System
from taichi_membrane.simulation.filling import Filling
from taichi_membrane.simulation.groups import group_nodes
from taichi_membrane.simulation.model import Model
from taichi_membrane.solvers.newton import Newton

# Share of the structure's size by which the level of a liquid is changed, and strain by which the stress-free one is; rounding
# leaves 1e-10 of the difference.
_LEVEL_STEP, _STRAIN_STEP = 1e-6, 1e-6


def derivatives(
    model: Model, newton: Newton, factor: Factor, displacement: Floats, filling: Filling
) -> tuple[dict[str, dict[str, float]], str]:
    """Of each probe the scene names, at the state at rest, by drivers such as ``load.NAME`` and by ``thickness[.GROUP]``.

    Of a thickness by element data the parameter is the factor on them: ``thickness[.GROUP].scale``.

    :param filling: what shut chambers and sags hold.
    :return: none, and why, where one of the solutions is not good.
    """
    if not model.scene.derivatives:
        return {}, "the scene asks for none"
    forces = dict(_force_derivatives(model, newton, filling))
    found = {}
    for name in model.scene.derivatives:
        adjoint = adjoint_of(model, newton, factor, name, displacement)
        if adjoint is None:
            return {}, f"{factor.refusal} (more than {GOOD:g} of the gradient of {name} is left)"
        found[name] = {parameter: float(np.vdot(adjoint, force)) for parameter, force in forces.items()}
    return found, ""


def adjoint_of(model: Model, newton: Newton, factor: Factor, name: str, displacement: Floats) -> Floats | None:
    """(node_count, 3) a of a probe, in the axes that supports refer to: what unit forces at the nodes change it by.

    None where the solution is not good; the factor's ``refusal`` says why.
    """
    gradient = newton.system.in_frames(_gradient(model, name, displacement))
    adjoint = factor.solve_transposed(np.where(newton.free, gradient, 0.0), GOOD)
    return adjoint if np.isfinite(adjoint).all() else None


def _force_derivatives(model: Model, newton: Newton, filling: Filling) -> Iterator[tuple[str, Floats]]:
    """∂F/∂θ at free components for each parameter.

    The forces are linear in all but levels and stress-free strain, so that differences are exact.
    """
    system = newton.system

    def at_free(force: Floats) -> Floats:
        return np.where(newton.free, system.in_frames(force), 0.0)

    for driver, unit in model.unit_forces.items():
        axial = np.zeros_like(unit)
        for body, moment in zip(model.structure.bodies, model.unit_moments.get(driver, ()), strict=False):
            axial[body.carriers[1]] = moment / body.radius
        yield driver, at_free(unit) + np.where(newton.free, axial, 0.0)
    present = newton.free_force()
    values = system.surface_loads()
    size = float(np.linalg.norm(np.ptp(model.structure.points, axis=0)))
    levels = model.structure.water_values
    parts: dict[str, Floats] = {}
    for number, driver in enumerate(model.surface_drivers):
        step, changed = np.eye(len(values))[number], []
        if levels.start <= number < levels.stop:
            step = step * (_LEVEL_STEP * size)
        for sign in (1.0, -1.0):
            system.set_surface_loads(values + sign * step)
            changed.append(newton.free_force())
        system.set_surface_loads(values)
        parts[driver] = (changed[0] - changed[1]) / (2.0 * float(step[number]))
    yield from filling.by_drivers(parts)
    yield from ((driver, at_free(force)) for driver, force in _of_growth(model, system))
    for number, (name, fabric) in enumerate(model.fabric_names()):
        if fabric.thickness is None:
            continue  # given per width
        system.scale_thickness(number, 2.0)
        label = "thickness" if len(model.fabric_names()) == 1 else f"thickness.{name}"
        given = fabric.thickness
        if isinstance(given, scenes.ElementField):
            yield f"{label}.scale", (newton.free_force() - present) / given.scale
        else:
            yield label, (newton.free_force() - present) / given
        system.scale_thickness(number, 1.0)


def _of_growth(model: Model, system: System) -> Iterator[tuple[str, Floats]]:
    """∂F/∂θ for each driver of stress-free strain: central differences, as Green's strain is quadratic in it."""
    values = system.growth()
    for number, (driver, extension) in enumerate(model.growth.extension.items()):
        step = np.eye(len(values))[number] * (_STRAIN_STEP / np.abs(extension).max())
        forces = []
        for sign in (1.0, -1.0):
            system.set_growth(values + sign * step)
            forces.append(system.out_of_balance())
        yield driver, (forces[0] - forces[1]) / (2.0 * step[number])
        system.set_growth(values)


def _gradient(model: Model, name: str, displacement: Floats) -> Floats:
    """(node_count, 3) derivative of a probe with respect to the nodal displacements."""
    probe, mesh = model.scene.probes[name], model.structure.mesh
    gradient = np.zeros_like(displacement)
    if isinstance(probe, scenes.VolumeProbe):
        triangles, share, _ = model.measured(probe)
        return volume_gradient(mesh.points + displacement, mesh.cells[triangles], share)
    assert isinstance(
        probe, scenes.DisplacementProbe | scenes.RadiusProbe | scenes.RotationProbe
    )  # the scene allows no other
    nodes = group_nodes(mesh, probe.group, f"probes.{name}.group")
    if isinstance(probe, scenes.DisplacementProbe):
        if probe.component == "magnitude":
            mean = displacement[nodes].mean(axis=0)
            gradient[nodes] = mean / (np.linalg.norm(mean) or 1.0) / len(nodes)
        else:
            gradient[nodes, "xyz".index(probe.component)] = 1.0 / len(nodes)
    elif isinstance(probe, scenes.RadiusProbe):
        positions = (mesh.points + displacement)[nodes]
        arms = positions - positions.mean(axis=0)
        if probe.axis != "centre":
            arms[:, "xyz".index(probe.axis)] = 0.0
        unit = arms / np.linalg.norm(arms, axis=1, keepdims=True) / len(nodes)
        gradient[nodes] = unit - unit.mean(axis=0)
    else:
        gradient[nodes] = _rotation_gradient(
            mesh.points[nodes] - np.array(probe.through), displacement[nodes], np.array(probe.axis)
        )
    return gradient


def _rotation_gradient(arms: Floats, displacement: Floats, axis: Floats) -> Floats:
    """Derivative of the mean rotation, atan2(Σ (b×a)·n, Σ b·a) in degrees: b, a the arms before and after, across the axis n."""
    unit = axis / np.linalg.norm(axis)
    before = arms - np.outer(arms @ unit, unit)
    after = arms + displacement - np.outer((arms + displacement) @ unit, unit)
    sine, cosine = float((np.cross(before, after) @ unit).sum()), float((before * after).sum())
    d_sine, d_cosine = np.cross(unit, before), before
    return np.rad2deg((cosine * d_sine - sine * d_cosine) / (sine**2 + cosine**2))
