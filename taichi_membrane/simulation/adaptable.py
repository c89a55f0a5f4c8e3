"""What a mesh can be refined unevenly for, and what has to stay even."""

from __future__ import annotations

import numpy as np

from taichi_membrane import scene as scenes
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Load
from taichi_membrane.scene.adapt import adapt_of
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.refined import own_surface, refuse, true_surface


def check(model: Model) -> None:
    """Refuse what a mesh cannot be refined for.

    :raises InputError: a state that is not carried over, loads or a probe that an uneven mesh would change.
    """
    asked, scene, mesh = adapt_of(model.scene), model.scene, model.structure.mesh
    assert asked is not None
    refuse(model, "mesh.adapt")
    told = "are those of a surface, which refinement makes uneven"
    for name, load in scene.loads.items():
        if isinstance(load, Load) and load.kind == "total" and load.spread == "equal" and _is_surface(mesh, load.group):
            raise InputError(
                f"mesh.adapt: loads.{name} is spread in equal shares over nodes of {load.group!r} that {told}; use spread = 'area'"
            )
    group = getattr(scene.probes[asked.probe], "group", None)
    if group is not None and _is_surface(mesh, group):
        raise InputError(
            f"mesh.adapt.probe: {asked.probe!r} is the mean over nodes of {group!r} that {told}; choose nodes apart or along a line"
        )


def _is_surface(mesh: Mesh, group: str) -> bool:
    """Whether all corners of some triangle are in a node group."""
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[mesh.node_groups.get(group, [])] = True
    return bool(inside[mesh.triangles].all(axis=1).any())


def even_groups(model: Model) -> list[str]:
    """Node groups along lines whose nodes count alike."""
    scene, mesh = model.scene, model.structure.mesh
    named = [load.group for load in scene.loads.values() if isinstance(load, Load) and load.kind == "total"]
    means = scenes.DisplacementProbe | scenes.PositionProbe | scenes.RadiusProbe | scenes.RotationProbe
    named += [probe.group for probe in scene.probes.values() if isinstance(probe, means)]
    return [name for name in dict.fromkeys(named) if name in mesh.node_groups and not _is_surface(mesh, name)]


def surface_words(model: Model) -> str:
    """What new nodes lie on."""
    return (
        "the true surface of the shape" if true_surface(model) is not None else f"the mesh's own {own_surface(model)}"
    )
