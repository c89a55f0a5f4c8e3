"""Models of a structure in a shape that form finding has found, or is on its way to.

Such a shape is the rest shape of a model. Its elements are under the stress that is asked for, or that was found; cables that are
to have a force get the unstressed length that gives it to them, and all others keep the one that they have in the given mesh.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import mesh as meshes
from taichi_membrane.mechanics.body import Body
from taichi_membrane.mechanics.preparation import Cables, Floats
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.model import Model, build_model
from taichi_membrane.simulation.present import side_forces


def asked(model: Model, points: Floats) -> Model:
    """The model with its nodes at ``points``, under the stresses and forces that the scene gives.

    :raises InputError: a warp direction that is perpendicular to an element there.
    """
    given = model.given or model.structure.mesh
    scene, mesh = model.scene, meshes.placed(given, points)
    moved = build_model(_carried(scene, given, mesh), mesh, model.own_probes)
    structure = moved.structure
    first = model.structure if model.given is None else build_model(scene, given).structure
    forced, forced_ropes = with_force(scene, mesh)
    cables, ropes = structure.cables, structure.ropes
    if cables is not None and first.cables is not None:
        cables = replace(cables, length=np.where(forced, cables.length, first.cables.length))
    if ropes is not None and first.ropes is not None:
        ropes = replace(ropes, length=np.where(forced_ropes, ropes.length, first.ropes.length))
    return replace(moved, scene=scene, structure=replace(structure, cables=cables, ropes=ropes), given=given)


def found(model: Model, points: Floats, stress: Floats, cable_force: Floats) -> Model:
    """The model at rest in a shape that was found.

    :param stress: (tri_count, 3) in fabric axes there.
    :param cable_force: of each straight piece of a cable, in the order of :attr:`.Structure.cable_sides`.
    """
    result = asked(model, points)
    structure, mesh = result.structure, result.structure.mesh
    forced, forced_ropes = with_force(model.scene, mesh)
    own = 0 if structure.cables is None else len(structure.cables.nodes)
    cables, ropes = structure.cables, structure.ropes
    if cables is not None:
        length = _lengths(mesh, structure) / (1.0 + cable_force[:own] / cables.stiffness)
        cables = replace(cables, length=np.where(forced, length, cables.length))
    if ropes is not None:
        first = np.concatenate([[0], np.cumsum(ropes.side_counts)])[:-1]
        ends = mesh.points[ropes.sides]
        whole = np.add.reduceat(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), first)
        length = whole / (1.0 + cable_force[own:][first] / ropes.stiffness)
        ropes = replace(ropes, length=np.where(forced_ropes, length, ropes.length))
    return replace(result, structure=replace(structure, cables=cables, ropes=ropes, tri_prestress=stress))


def soft(model: Model, share: float) -> Model:
    """The model of force densities: stresses refer to its shape, and hardly anything but them resists.

    With the stress σ kept as second Piola–Kirchhoff stress, an element has constant force densities along its sides, as a cable has
    with T/l kept. Both make the energy quadratic. The fabric's moduli are scaled to ``share`` of its stress.
    """
    structure = model.structure
    fabrics = []
    for one in structure.fabrics:
        scale = share * max(one.prestress[:2]) / max(one.e_warp, one.e_weft)
        fabrics.append(replace(one, e_warp=scale * one.e_warp, e_weft=scale * one.e_weft, shear=scale * one.shear))
    cables, ropes = structure.cables, structure.ropes
    forced, forced_ropes = with_force(model.scene, structure.mesh)
    if cables is not None:
        cables = _of_constant_density(cables, structure, forced)
    if ropes is not None:
        force = np.where(forced_ropes, _rope_forces(model.scene), 0.0)
        stretched = ropes.length * (1.0 + force / ropes.stiffness)
        ropes = replace(
            ropes,
            length=stretched,
            stiffness=np.where(forced_ropes, force, ropes.stiffness),
            prestress=np.where(forced_ropes, force, ropes.prestress),
        )
    return replace(model, structure=replace(structure, fabrics=tuple(fabrics), cables=cables, ropes=ropes))


def cauchy(structure: Structure, displacement: Floats, stress: Floats, moved: Structure) -> Floats:
    """(tri_count, 3) the stress in the fabric axes of the deformed shape, force per deformed width over the thickness at rest.

    :param stress: (tri_count, 3) second Piola–Kirchhoff stress in the axes at rest.
    :param moved: the structure with its nodes at the deformed places.
    """
    side, density = side_forces(structure, displacement, stress)
    geometry = moved.geometry
    along, across = np.einsum("iaj,ij->ia", side, geometry.warp), np.einsum("iaj,ij->ia", side, geometry.weft)
    parts = [(density * one * other).sum(axis=1) for one, other in ((along, along), (across, across), (along, across))]
    return np.column_stack(parts) / (geometry.area * structure.thickness)[:, None]


def with_force(scene: Scene, mesh: Mesh) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which elements of cables are to have a force, and which of the cables that slide."""
    _, owner = line_elements(scene, mesh)
    cables = list(scene.cables.values())
    has = np.array([one.force is not None or one.force_density is not None for one in cables], dtype=bool)
    sliding = np.array([one.sliding for one in cables], dtype=bool)
    own = owner[~sliding[owner]] if len(cables) else owner
    return has[own] if len(cables) else np.zeros(0, dtype=bool), has[sliding] if len(cables) else has


def _of_constant_density(cables: Cables, structure: Structure, forced: NDArray[np.bool_]) -> Cables:
    """Cables of which those with a force keep the ratio of force and length that they have in this shape."""
    length = _lengths(structure.mesh, structure)
    force = cables.stiffness * (length - cables.length) / cables.length
    return replace(
        cables,
        length=np.where(forced, length, cables.length),
        stiffness=np.where(forced, force, cables.stiffness),
        prestress=np.where(forced, force, cables.prestress),
    )


def _rope_forces(scene: Scene) -> Floats:
    """Force asked of each sliding cable; 0 where none is."""
    return np.array([one.force or 0.0 for one in scene.cables.values() if one.sliding])


def _lengths(mesh: Mesh, structure: Structure) -> Floats:
    """(n,) distances of the nodes of all cables that do not slide."""
    assert structure.cables is not None
    ends = mesh.points[structure.cables.nodes]
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def _carried(scene: Scene, given: Mesh, mesh: Mesh) -> Scene:
    """The scene with the centres of rigid bodies, where it gives them, carried along to their nodes' places."""
    bodies = {}
    for name, one in scene.bodies.items():
        nodes = given.node_groups[name]
        if one.centre is not None:
            body = Body(
                nodes=nodes, points=given.points[nodes], centre=np.array(one.centre), held=np.zeros((2, 3), bool)
            )
            centre, _ = body.pose(mesh.points - given.points)
            one = one.model_copy(update={"centre": tuple(centre.tolist())})
        bodies[name] = one
    return scene.model_copy(update={"bodies": bodies}) if bodies else scene
