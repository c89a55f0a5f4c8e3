"""A model on its mesh cut in four: the same scene, with the same groups, for estimates of errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mesh.quarters import quartered
from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.model import Model, build_model


@dataclass(frozen=True, eq=False)
class Refined:
    """A model cut in four.

    :param prolongation: (nodes, nodes of the coarse model) values at its nodes from those of the coarse model.
    :param left_out: what a comparison of the two does not tell, in words.
    """

    model: Model
    prolongation: scipy.sparse.csr_matrix
    left_out: tuple[str, ...]

    def displacement(self, coarse: Floats) -> Floats:
        """(n, 3) displacements of the coarse model carried over; nodes of rigid bodies move with them."""
        found = np.asarray(self.prolongation @ coarse)
        for body in self.model.structure.bodies:
            found[body.nodes] = body.displaced(*body.pose(found))
        return found


def refined(model: Model) -> Refined:
    """Cut a model in four, new nodes on the shape's true surface where that is known.

    :raises InputError: the scene has what the state of a finer mesh cannot be carried over to, or its mesh cannot be cut.
    """
    scene, mesh = model.scene, model.structure.mesh
    _check(scene, model)
    place = shapes.place_of(scene.mesh.shape, scene.mesh.model_dump())
    left_out: tuple[str, ...] = ()
    if place is None:
        told = "flat elements" if mesh.order == 1 else "six-node elements"
        left_out = (f"the shape at rest, which is that of its {told} on both meshes",)
    try:
        cut = quartered(mesh, place)
        asked = scene.model_copy(update={"derivatives": [], "modes": None, "checks": []})
        return Refined(build_model(asked, cut.mesh, model.own_probes), cut.prolongation, left_out)
    except InputError as error:
        raise InputError(f"estimate: the mesh cut in four cannot be used: {error}") from error


def _check(scene: Scene, model: Model) -> None:
    """Refuse what depends on more than the load state, and what the number of nodes is part of."""
    told = "is not implemented"
    if scene.forms:
        raise InputError(f"estimate: of a scene that finds its form (stages.{scene.stages[0].name}) {told}")
    if scene.contact is not None:
        raise InputError(
            f"estimate: with walls that touch each other (contact) {told}: they depend on the steps before"
        )
    for name, one in {**scene.planes, **scene.obstacles}.items():
        if one.friction:
            raise InputError(f"estimate: with friction ({name}.friction) {told}: it depends on the steps before")
    for stage in scene.ramps:
        for name in shut_by(scene, stage):
            if scene.pressures[name].relief is not None:
                raise InputError(
                    f"estimate: with a relief valve (pressures.{name}.relief) {told}: it depends on the steps before"
                )
    for name, spring in scene.springs.items():
        members = model.structure.mesh.node_groups[spring.group]
        if len(members) > 1:
            raise InputError(
                f"estimate: springs.{name} are at each of {len(members)} nodes of {spring.group!r}, and a finer mesh has more of "
                "them: other supports"
            )
