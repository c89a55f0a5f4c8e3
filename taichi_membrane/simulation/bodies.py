"""A scene's rigid bodies on the nodes of its mesh, with what holds, moves and loads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import mesh as meshes
from taichi_membrane import scene as scenes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.body import ON_LINE, Body, turned
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import BodyLoad, BodyRotation, BodyTranslation, Scene
from taichi_membrane.simulation.groups import group_nodes

# Of forces that are to come to a resultant: what is left of it.
_EXACT = 1e-9


@dataclass(frozen=True, eq=False)
class PrescribedBody:
    """A body of which motions prescribe something.

    :param shifts: driver, displacement of the centre at factor 1 and components that are prescribed, of each translation.
    :param turns: driver and axis of each rotation, the first comes first.
    """

    body: Body
    shifts: tuple[tuple[str, Floats, tuple[int, ...]], ...]
    turns: tuple[tuple[str, Floats], ...]

    def displaced(self, displacement: Floats, values: Mapping[str, float]) -> Floats:
        """(k, 3) displacement of its nodes with what is prescribed at its value and the rest as in ``displacement``."""
        centre, turn = self.body.pose(displacement)
        for driver, direction, components in self.shifts:
            for c in components:
                centre[c] = self.body.centre[c] + values[driver] * direction[c]
        if self.turns:
            turn = np.eye(3)
            for driver, axis in self.turns:
                turn = turned(np.deg2rad(values[driver]) * axis) @ turn
        return self.body.displaced(centre, turn)


def with_body_groups(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with the nodes of each body as a group of the body's name.

    :raises InputError: no such group, or one of that name that has other nodes.
    """
    for name, body in scene.bodies.items():
        nodes = _nodes(body, mesh, f"bodies.{name}")
        if name not in mesh.node_groups:
            mesh = meshes.with_groups(mesh, {name: nodes})
        elif not np.array_equal(np.sort(mesh.node_groups[name]), np.sort(nodes)):
            raise InputError(
                f"bodies.{name}: the mesh has a node group {name!r} of {len(mesh.node_groups[name])} nodes, the body has "
                f"{len(nodes)}; give the body another name"
            )
    return mesh


def bodies_of(
    scene: Scene, mesh: Mesh, held: NDArray[np.bool_], frame: Floats | None
) -> tuple[tuple[Body, ...], tuple[PrescribedBody, ...]]:
    """The bodies of a scene, and those of which motions prescribe something.

    ``held`` becomes that of their freedoms at their nodes.

    :raises InputError: nodes with supports or motions of their own, or in two bodies; nodes at one place; a centre off the line of
        a mast; what is held and moved as well.
    """
    bodies, prescribed, owner = [], [], np.full(mesh.node_count, -1)
    alone = np.asarray(held.any(axis=1))
    for number, (name, one) in enumerate(scene.bodies.items()):
        key, nodes = f"bodies.{name}", np.asarray(mesh.node_groups[name])
        _check_free(key, nodes, alone)
        shared = nodes[owner[nodes] >= 0]
        if shared.size:
            other = list(scene.bodies)[owner[shared[0]]]
            raise InputError(
                f"{key}: node {shared[0]} is in body {other!r} as well; {len(shared)} such nodes in all. Hinges "
                "between bodies are not implemented: join their nodes by a bar"
            )
        owner[nodes] = number
        body = _made(key, one, mesh, nodes)
        moved = _prescribed(scene, name, body)
        bodies.append(body)
        if moved.shifts or moved.turns:
            prescribed.append(moved)
        _check_mast(key, body)
        held[nodes] = True
        held[list(body.carriers)] = body.held
    return tuple(bodies), tuple(prescribed)


def _nodes(body: scenes.Body, mesh: Mesh, key: str) -> Ints:
    if body.lines is not None:
        return np.unique(mesh.lines[mesh.line_groups[body.lines]])
    assert body.group is not None  # the scene asks for one of them
    return group_nodes(mesh, body.group, f"{key}.group")


def _check_free(key: str, nodes: Ints, alone: NDArray[np.bool_]) -> None:
    """Refuse nodes that something else holds."""
    taken = nodes[alone[nodes]]
    if taken.size:
        raise InputError(
            f"{key}: node {taken[0]} has a support or motion of its own, {len(taken)} of the body's {len(nodes)} in all; "
            "hold the body by its hold and turn_hold, move it by motions of kind 'body_translation' and 'body_rotation', and leave "
            "its nodes out of other groups that are held"
        )


def _made(key: str, one: scenes.Body, mesh: Mesh, nodes: Ints) -> Body:
    """A body with what it holds itself."""
    if len(nodes) < 2:
        raise InputError(f"{key}: a body needs two nodes or more, but its group holds {len(nodes)}")
    points = mesh.points[nodes]
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    if np.linalg.norm(np.ptp(points, axis=0)) <= ON_LINE * size:
        raise InputError(
            f"{key}: its {len(nodes)} nodes lie at one place, which has no rotation; a single node will do"
        )
    centre = points.mean(axis=0) if one.centre is None else np.array(one.centre)
    holds = [["xyz"[c] in (held or "") for c in range(3)] for held in (one.hold, one.turn_hold)]
    body = Body(nodes=nodes, points=points, centre=centre, held=np.array(holds))
    if body.line is not None:
        arm = centre - points[0]
        off = float(np.linalg.norm(arm - (arm @ body.line) * body.line))
        if off > ON_LINE * size:
            raise InputError(
                f"{key}.centre: its nodes lie on a line, and the centre {centre.tolist()} is {off:.3g} off it; a mast's centre "
                "lies on the mast"
            )
    return body


def _check_mast(key: str, body: Body) -> None:
    """Refuse a mast that may only turn about itself, which no node feels."""
    free = ~body.held[1]
    if body.line is not None and free.sum() == 1 and np.abs(body.line[free][0]) > 1.0 - ON_LINE:
        raise InputError(
            f"{key}.turn_hold: its nodes lie on a line, and it may turn about that alone, which moves none; hold 'xyz'"
        )


def _prescribed(scene: Scene, name: str, body: Body) -> PrescribedBody:
    """What motions prescribe of a body, which holds it from now on.

    :raises InputError: held already.
    """
    shifts, turns, turn_held = [], [], body.held[1].any()
    for motion_name, motion in scene.motions.items():
        key, driver = f"motions.{motion_name}", f"motion.{motion_name}"
        if isinstance(motion, BodyTranslation) and motion.body == name:
            components = tuple("xyz".index(c) for c in motion.hold)
            taken = [c for c in components if body.held[0, c]]
            if taken:
                raise InputError(
                    f"{key}: displacement {'xyz'[taken[0]]} of body {name!r} is already held by it or moved by another motion"
                )
            body.held[0, list(components)] = True
            shifts.append((driver, np.array(motion.direction), components))
        elif isinstance(motion, BodyRotation) and motion.body == name:
            if turn_held:
                raise InputError(
                    f"{key}: bodies.{name}.turn_hold holds rotations that the motion prescribes; leave it out"
                )
            body.held[1] = True
            turns.append((driver, np.array(motion.axis) / np.linalg.norm(motion.axis)))
    return PrescribedBody(body, tuple(shifts), tuple(turns))


# ---- loads


def body_forces(scene: Scene, mesh: Mesh, name: str, load: BodyLoad) -> Floats | None:
    """(n, 3) the least dead nodal forces that come to a force at a point of a body and to a dead moment, at factor 1.

    The force's first moments about its point vanish, all nine, so that it stays there however the body turns.

    :raises InputError: a point off the plane or line of the body's nodes; a moment about a mast itself.
    """
    nodes = np.asarray(mesh.node_groups[load.body])
    key, arms = f"loads.{name}", mesh.points[nodes]
    middle = arms.mean(axis=0)
    arms = arms - middle
    size = float(np.abs(arms).max())
    at = load.at or scene.bodies[load.body].centre
    if any(load.force):
        offset = (np.zeros(3) if at is None else np.array(at) - middle) / size
        rows = np.vstack([np.ones(len(nodes)), arms.T / size])
        share = np.linalg.lstsq(rows, np.array([1.0, *offset]), rcond=_EXACT)[0]
        if np.abs(rows @ share - [1.0, *offset]).max() > _EXACT * (1.0 + np.abs(offset).max()):
            raise InputError(
                f"{key}.at: the force acts at {list(at or ())}, off the plane or line that the nodes of body {load.body!r} lie in; "
                "name a point in it, and a moment beside"
            )
        force = share[:, None] * np.array(load.force)
    else:
        force = np.zeros_like(arms)
    if any(load.moment) and load.couple == "dead":
        moment = np.array(load.moment)
        inertia = (arms**2).sum() * np.eye(3) - arms.T @ arms
        couple = np.cross(np.linalg.lstsq(inertia, moment, rcond=_EXACT)[0], arms)
        left = np.linalg.norm(np.cross(arms, couple).sum(axis=0) - moment)
        if left > _EXACT * np.linalg.norm(moment):
            raise InputError(
                f"{key}.moment: {list(load.moment)} has a part about the line of body {load.body!r}, which none can bear"
            )
        force = force + couple
    total = np.zeros((mesh.node_count, 3))
    total[nodes] = force
    return total


def moments_of(scene: Scene, bodies: Sequence[Body]) -> dict[str, Floats]:
    """(bodies, 3) moments about fixed axes at value 1 of each driver that has some.

    :raises InputError: the axis is not the only one that the body may turn about.
    """
    found = {}
    for name, load in scene.loads.items():
        if isinstance(load, BodyLoad) and load.couple == "axial" and any(load.moment):
            number = list(scene.bodies).index(load.body)
            free, moment = ~bodies[number].held[1], np.array(load.moment)
            across = np.linalg.norm(moment[~free])
            if free.sum() != 1 or across > _EXACT * np.linalg.norm(moment):
                axes = " and ".join(axis for axis, one in zip("xyz", free, strict=True) if one) or "none"
                raise InputError(
                    f"loads.{name}.couple = 'axial': body {load.body!r} may turn about {axes}. A moment that keeps its direction "
                    "has a potential only about the one axis that is free: hold the others by turn_hold, or take couple = 'dead'"
                )
            unit = np.zeros((len(bodies), 3))
            unit[number] = np.where(free, moment, 0.0)
            found[f"load.{name}"] = unit
    return found
