"""A model on a finer mesh made of its own, by cutting triangles in four or by bisecting some: the same scene and groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mesh.bisection import bisected
from taichi_membrane.mesh.finer import Finer
from taichi_membrane.mesh.middles import Place
from taichi_membrane.mesh.quarters import quartered
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.model import Model, build_model


@dataclass(frozen=True, eq=False)
class Refined:
    """A model on a finer mesh.

    :param prolongation: (nodes, nodes of the coarse model) values at its nodes from those of the coarse model.
    :param left_out: what a comparison of the two does not tell, in words.
    """

    model: Model
    prolongation: sparse.csr_matrix
    left_out: tuple[str, ...]

    def displacement(self, coarse: Floats) -> Floats:
        """(n, 3) displacements of the coarse model carried over; nodes of rigid bodies move with them."""
        found = np.asarray(self.prolongation @ coarse)
        for body in self.model.structure.bodies:
            found[body.nodes] = body.displaced(*body.pose(found))
        return found


def refined(model: Model, what: str = "estimate") -> Refined:
    """Cut a model in four, new nodes on the shape's true surface where that is known.

    :param what: what asks for it; begins messages.
    :raises InputError: the scene has what the state of a finer mesh cannot be carried over to, or its mesh cannot be cut.
    """
    refuse(model, what)
    return _made(model, lambda place: quartered(model.structure.mesh, place), f"{what}: the mesh cut in four")


def locally_refined(model: Model, marked: NDArray[np.bool_], even: Sequence[str]) -> Refined:
    """Bisect marked triangles twice, new nodes on the shape's true surface where that is known.

    :param even: node groups whose edges are cut together.
    :raises InputError: the mesh cannot be cut so.
    """
    mesh = model.structure.mesh
    return _made(model, lambda place: bisected(mesh, marked, place, times=2, even=even), "mesh.adapt: the refined mesh")


def true_surface(model: Model) -> Place | None:
    """Where the true surface of a model's shape has new nodes; None where it is not known."""
    return shapes.place_of(model.scene.mesh.shape, model.scene.mesh.model_dump())


def own_surface(model: Model) -> str:
    """What a shape at rest is taken to be whose true surface is not known."""
    return "flat elements" if model.structure.mesh.order == 1 else "six-node elements"


def _made(model: Model, cut: Callable[[Place | None], Finer], what: str) -> Refined:
    """The model on a finer mesh, without what only its own run is asked for."""
    place = true_surface(model)
    left_out: tuple[str, ...] = ()
    if place is None:
        left_out = (f"the shape at rest, which is that of its {own_surface(model)} on both meshes",)
    try:
        finer = cut(place)
        asked = model.scene.model_copy(update={"derivatives": [], "modes": None, "checks": []})
        return Refined(build_model(asked, finer.mesh, model.own_probes), finer.prolongation, left_out)
    except InputError as error:
        raise InputError(f"{what} cannot be used: {error}") from error


def refuse(model: Model, what: str) -> None:
    """Refuse what depends on more than the load state, and what the number of nodes is part of.

    :param what: what asks for a finer mesh; begins the message.
    :raises InputError: the scene has some of that.
    """
    scene, told = model.scene, "is not implemented"
    if scene.forms:
        raise InputError(f"{what}: of a scene that finds its form (stages.{scene.stages[0].name}) {told}")
    if scene.contact is not None:
        raise InputError(f"{what}: with walls that touch each other (contact) {told}: they depend on the steps before")
    for name, one in {**scene.planes, **scene.obstacles}.items():
        if one.friction:
            raise InputError(f"{what}: with friction ({name}.friction) {told}: it depends on the steps before")
    for stage in scene.ramps:
        for name in shut_by(scene, stage):
            if scene.pressures[name].relief is not None:
                raise InputError(
                    f"{what}: with a relief valve (pressures.{name}.relief) {told}: it depends on the steps before"
                )
    for name, spring in scene.springs.items():
        members = model.structure.mesh.node_groups[spring.group]
        if len(members) > 1:
            raise InputError(
                f"{what}: springs.{name} are at each of {len(members)} nodes of {spring.group!r}, and a finer mesh has more of "
                "them: other supports"
            )
