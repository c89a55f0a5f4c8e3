"""A scene's planes and obstacles on its mesh, and the surfaces that it reads from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane import mesh as meshes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.facets import Facets
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.wall_search import Walls
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import (
    BoxObstacle,
    CylinderObstacle,
    PlaneObstacle,
    Scene,
    SphereObstacle,
    SurfaceObstacle,
)
from taichi_membrane.simulation.groups import group_nodes, group_triangles

# Radius of edges over the shortest side, where the scene gives none.
_ROUNDING = 0.05
# Least area of a facet over the square of the surface's size.
_NO_AREA = 1e-16


def with_surfaces(scene: Scene, base: Path | None) -> Scene:
    """The scene with the surfaces of its obstacles in place of the files that they come from, so that it needs no file.

    :param base: folder that relative paths start from; the current one when None.
    :raises InputError: a file that cannot be read.
    """
    found = {}
    for name, one in scene.obstacles.items():
        if isinstance(one, SurfaceObstacle) and one.path is not None:
            mesh = meshes.read_mesh((base or Path()) / one.path, scale=one.scale)
            data = one.model_dump() | {"path": None, "scale": 1.0}
            found[name] = data | {"points": mesh.points.tolist(), "triangles": mesh.flat_triangles.tolist()}
    if not found:
        return scene
    return scene.model_copy(
        update={"obstacles": scene.obstacles | {k: SurfaceObstacle.model_validate(v) for k, v in found.items()}}
    )


def obstacles_of(scene: Scene, mesh: Mesh) -> tuple[Obstacle, ...]:
    """The planes of a scene, then its obstacles; a hollow box, or the ends of a hollow cylinder, as planes.

    :raises InputError: unknown groups, a surface with a triangle without area.
    """
    scene = with_surfaces(scene, None)
    found = [
        Obstacle(
            name=name,
            kind="plane",
            nodes=group_nodes(mesh, plane.group, f"planes.{name}.group"),
            centre=np.array(plane.through),
            frame=_frame(plane.normal),
            friction=plane.friction,
        )
        for name, plane in scene.planes.items()
    ]
    for name, one in scene.obstacles.items():
        common: dict[str, Any] = {
            "name": name,
            "nodes": group_nodes(mesh, one.group, f"obstacles.{name}.group"),
            "motion": np.array(one.direction or (0.0, 0.0, 0.0)),
            "friction": one.friction,
        }
        if isinstance(one, PlaneObstacle):
            found.append(Obstacle(kind="plane", centre=np.array(one.through), frame=_frame(one.normal), **common))
        elif isinstance(one, SphereObstacle):
            found.append(
                Obstacle(kind="sphere", centre=np.array(one.centre), size=(one.radius,), hollow=one.inside, **common)
            )
        elif isinstance(one, CylinderObstacle):
            found += _cylinder(one, common)
        elif isinstance(one, BoxObstacle):
            found += _box(one, common)
        else:
            facets = _facets(one, f"obstacles.{name}")
            found.append(
                Obstacle(
                    kind="surface", centre=facets.points.mean(axis=0), hollow=one.face == "back", facets=facets,
                    offset=one.offset, **common,
                )
            )  # fmt: skip
    return tuple(found)


def walls_of(scene: Scene, mesh: Mesh) -> Walls | None:
    """Elements that touch each other; None where none do.

    :raises InputError: unknown groups.
    """
    if scene.contact is None:
        return None
    names = [scene.contact.group] if isinstance(scene.contact.group, str) else scene.contact.group
    chosen = [group_triangles(mesh, name, "contact.group") for name in names]
    return Walls(mesh, np.unique(np.concatenate(chosen)))


def _cylinder(one: CylinderObstacle, common: dict[str, Any]) -> list[Obstacle]:
    centre, frame = np.array(one.centre), _frame(one.axis)
    if one.length is None or one.inside:
        wall = Obstacle(kind="cylinder", centre=centre, frame=frame, size=(one.radius,), hollow=one.inside, **common)
        return [wall, *([] if one.length is None else _walls(centre, frame[2:], [one.length], common))]
    rounding = one.rounding or _ROUNDING * min(one.radius, one.length)
    size = (one.radius, 0.5 * one.length)
    return [Obstacle(kind="drum", centre=centre, frame=frame, size=size, rounding=rounding, **common)]


def _box(one: BoxObstacle, common: dict[str, Any]) -> list[Obstacle]:
    x, z = (np.array(axis) / np.linalg.norm(axis) for axis in (one.axis_x, one.axis_z))
    z = z - (z @ x) * x
    z /= np.linalg.norm(z)
    frame, centre = np.stack([x, np.cross(z, x), z]), np.array(one.centre)
    if one.inside:
        return _walls(centre, frame, list(one.size), common)
    rounding, size = one.rounding or _ROUNDING * min(one.size), tuple(0.5 * side for side in one.size)
    return [Obstacle(kind="box", centre=centre, frame=frame, size=size, rounding=rounding, **common)]


def _walls(centre: Floats, axes: Floats, lengths: list[float], common: dict[str, Any]) -> list[Obstacle]:
    """Planes at both ends of each axis, facing each other."""
    return [
        Obstacle(kind="plane", centre=centre - sign * 0.5 * length * axis, frame=_frame(sign * axis), **common)
        for axis, length in zip(axes, lengths, strict=True)
        for sign in (1.0, -1.0)
    ]


def _facets(one: SurfaceObstacle, key: str) -> Facets:
    points, triangles = np.array(one.points, dtype=float), np.array(one.triangles, dtype=np.int64)
    used, triangles = np.unique(triangles, return_inverse=True)
    facets = Facets(points[used], triangles.reshape(-1, 3))
    sides = facets.corners[:, 1:] - facets.corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    flat = np.flatnonzero(area <= _NO_AREA * float((np.ptp(facets.points, axis=0) ** 2).sum()))
    if flat.size:
        raise InputError(f"{key}.triangles: number {flat[0]} has no area, {flat.size} such triangles in all")
    return facets


def _frame(axis: Any) -> Floats:
    """(3, 3) unit vectors as rows, right-handed, the last one along an axis."""
    last = np.array(axis, dtype=float) / np.linalg.norm(axis)
    first = np.cross(np.eye(3)[int(np.abs(last).argmin())], last)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(last, first), last])
