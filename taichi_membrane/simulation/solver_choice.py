"""Which solver a run uses: the scene's, or relaxation alone where Newton cannot work."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from taichi_membrane.device import runtime
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.rim import Rim
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.load_state import ramp_targets
from taichi_membrane.simulation.model import Model

_GIB = 2.0**30


@dataclass(frozen=True)
class SolverChoice:
    """What finds equilibrium, and why it is not what the scene asks for (empty where it is)."""

    kind: str
    reason: str = ""


def chosen_solver(model: Model) -> SolverChoice:
    """The solver a run uses.

    :raises InputError: the scene insists on Newton (``newton``, modes, derivatives, shut chambers, arc length) where it cannot
        work: in single precision, with the clipped law, or where its factor does not fit in memory.
    """
    scene = model.scene
    kind = scene.solver.kind
    hindrance = _hindrance(model)
    if kind == "newton" and hindrance:
        raise InputError(
            f"solver.kind = 'newton': {hindrance}; use 'relaxation', or 'hybrid', which then relaxes alone"
        )
    if hindrance:
        if scene.modes is not None or scene.derivatives:
            raise InputError(f"modes and derivatives need Newton's tangent: {hindrance}")
        for stage in scene.ramps:
            if shut_by(scene, stage):
                key = "closed" if stage.closed else "amount"
                raise InputError(f"{stage.key}.{key} needs Newton: {hindrance}")
            if stage.control == "arc_length":
                raise InputError(f"{stage.key}.control = 'arc_length' needs Newton: {hindrance}; use 'load'")
        for name in model.surface.volumes:
            raise InputError(f"loads.{name}.given = 'volume' needs Newton: {hindrance}")
    if scene.modes is not None and model.surface.volumes:
        raise InputError(f"modes of liquids of given volume are not implemented: {', '.join(model.surface.volumes)}")
    if scene.modes is not None and without_potential(model):
        raise InputError(
            f"modes.kind = '{scene.modes.kind}' needs a symmetric tangent, and loads on the surface have no potential here: "
            f"{without_potential(model)}"
        )
    return SolverChoice("relaxation", hindrance) if hindrance and kind != "relaxation" else SolverChoice(kind)


def without_potential(model: Model) -> str:
    """Where loads on the surface have no potential at the end of a stage; nothing where they always have one."""
    rim = Rim.of(model.structure)
    for stage, state in ramp_targets(model.scene):
        found = rim.at(model.surface_values(state), np.zeros_like(model.structure.points))
        if found is not None:
            return f"{stage.key.replace('s.', ' ')}, {'; '.join(part.told for part in found.parts)}"
    return ""


def _hindrance(model: Model) -> str:
    """Why Newton cannot work, or nothing."""
    if runtime.current().precision == "f32":
        return "it needs precision f64, not f32"
    if any(fabric.law == "clip" for fabric in model.structure.fabrics):
        return "the law 'clip' has no energy and no symmetric tangent"
    if model.scene.solver.kind == "relaxation":
        return ""
    needed, allowed = model.structure.elimination.memory() / _GIB, _allowed_memory(model)
    if needed > allowed:
        return (
            f"factorising the tangent of {model.structure.mesh.node_count} nodes takes {needed:.3g} GiB, "
            f"and it may take {allowed:.3g} GiB (solver.memory, or what the machine has)"
        )
    return ""


def _allowed_memory(model: Model) -> float:
    """GiB that factors may take: what the scene allows, else the machine's memory where that can be asked for."""
    if model.scene.solver.memory is not None:
        return model.scene.solver.memory
    if {"SC_PHYS_PAGES", "SC_PAGE_SIZE"} <= getattr(os, "sysconf_names", {}).keys():
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / _GIB
    return float("inf")
