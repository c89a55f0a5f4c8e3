"""Boundary layers of a pressurised tube: how far the disturbance of a held or loaded ring reaches, and rings graded to it.

With the axial resultant N = p r/2 and the stiffness E t around the tube, a deflection w of the wall obeys N w'' = E t w/r²: it
decays over l = r √(N/(E t)).
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, select
from taichi_membrane.scene import ArchShape, ElementField, Load, Scene, TubeShape

# Length of the first band over that of the layer.
_FIRST = 0.5
# What bands beside rings must be shorter than, over even ones, to be worth grading.
_WORTH = 0.7


def grade_of(scene: Scene, even: Mesh) -> dict[str, float]:
    """Lengths of the bands beside the rings of a scene's tube or arch, by their names; empty where all are even.

    :param even: its mesh with even bands, and its groups.
    :raises InputError: ``auto`` where the scene does not tell the length of the layer.
    """
    source = scene.mesh
    assert isinstance(source, TubeShape | ArchShape)
    if source.grade is None:
        return {}
    if source.grade != "auto":
        return {name: size for name, size in source.grade.model_dump().items() if size is not None}
    size = _FIRST * layer_length(scene, source.radius)
    middle, length = "middle", source.length if isinstance(source, TubeShape) else 0.0
    if isinstance(source, ArchShape):
        half = np.deg2rad(source.angle) / 2.0
        middle, length = "crown", float(half * source.span / np.sin(half))
    if size >= _WORTH * length / source.along:
        return {}
    return dict.fromkeys((name for name in ("start", middle, "end") if _disturbed(scene, even, name)), size)


def layer_length(scene: Scene, radius: float) -> float:
    """l of a scene's tube at its largest pressure.

    :raises InputError: several fabrics, a thickness by element data, no pressure.
    """
    fabric = scene.fabric
    if fabric is None or scene.fabrics or isinstance(fabric.given_thickness, ElementField):
        raise InputError("mesh.grade = 'auto' needs one fabric of one thickness; give lengths of bands instead")
    given = [stage.pressure for stage in scene.stages]
    tables = [one.values() if isinstance(one, dict) else [one or 0.0] for one in given]
    pressures = [abs(value) for table in tables for value in table]
    if not any(pressures):
        raise InputError("mesh.grade = 'auto' needs a pressure that some stage gives; give lengths of bands instead")
    axial = 0.5 * max(pressures) * radius
    return float(radius * np.sqrt(axial / (fabric.weft_modulus * fabric.given_thickness)))


def _disturbed(scene: Scene, mesh: Mesh, name: str) -> bool:
    """Whether a ring is held, moved or loaded as a whole, or joins a cap."""
    if name not in mesh.node_groups:
        return False
    if f"cap_{name}" in mesh.node_groups:
        return True
    ring = mesh.node_groups[name]
    named = [support.group for support in scene.supports]
    named += [one.group for one in scene.motions.values() if hasattr(one, "group")]
    named += [one.group for one in scene.loads.values() if isinstance(one, Load) and one.kind != "area"]
    named += [body.group for body in scene.bodies.values() if isinstance(body.group, str)]
    chosen = []
    for group in dict.fromkeys(named):
        if group in mesh.node_groups:
            chosen.append(mesh.node_groups[group])
        elif group in scene.groups and scene.groups[group].kind == "nodes":
            chosen.append(select(mesh, scene.groups[group].where, kind="nodes", key=f"groups.{group}.where"))
    chosen = [members for members in chosen if len(members) < mesh.node_count]
    return any(bool(np.isin(ring, members).all()) for members in chosen)
