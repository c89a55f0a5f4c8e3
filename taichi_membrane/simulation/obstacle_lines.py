"""Lines by which pictures show obstacles: rims and a net on what is flat or round, sharp edges of triangulated surfaces."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.obstacles import obstacles_of

# Parts of a net across a plane and around an axis; points of a circle; how far lines go beyond the structure, in its sizes.
_PARTS, _AROUND, _ROUND, _BEYOND = 8, 12, 48, 0.1
# Cosine of the angle at an edge of a surface that is drawn.
_SHARP = 0.94


def obstacle_lines(scene: Scene, mesh: Mesh, values: Mapping[str, float], box: tuple[Floats, Floats]) -> list[Floats]:
    """Polylines (k, 3) of a scene's planes and obstacles where their motions have brought them.

    :param values: of the motions, by name.
    :param box: lowest and highest coordinates of the structure; what is larger is drawn near it only.
    """
    if not scene.touchable:
        return []
    centre, reach = 0.5 * (box[0] + box[1]), 0.5 * (1.0 + _BEYOND) * float(np.linalg.norm(box[1] - box[0]))
    found: list[Floats] = []
    for one in obstacles_of(scene, mesh):
        offset = values.get(one.name, 0.0) * one.motion
        for line in _LINES[one.kind](one, centre - offset, reach):
            found += _near(line + offset, centre, 1.5 * reach)
    return found


def _near(line: Floats, centre: Floats, reach: float) -> list[Floats]:
    """The pieces of a line within a distance of the structure."""
    inside = np.concatenate([[False], np.linalg.norm(line - centre, axis=1) <= reach, [False]]).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(inside) == 1), np.flatnonzero(np.diff(inside) == -1)
    return [line[a:b] for a, b in zip(begins.tolist(), ends.tolist(), strict=True) if b - a > 1]


def _plane(one: Obstacle, centre: Floats, reach: float) -> list[Floats]:
    normal = one.frame[2]
    middle = centre - ((centre - one.centre) @ normal) * normal
    ticks, fine = np.linspace(-reach, reach, _PARTS + 1), np.linspace(-reach, reach, _ROUND + 1)
    u, v = 0.6 * one.frame[:2]
    return [middle + fine[:, None] * a + tick * b for a, b in ((u, v), (v, u)) for tick in ticks]


def _ring(angles: Floats, radius: float, height: float) -> Floats:
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), height)])


def _round(one: Obstacle, heights: Floats, radii: Floats, ring: Floats, ring_radius: Floats) -> list[Floats]:
    """A body of revolution: lines along it at ``heights``, rings at those of ``ring``."""
    turns, fine = 2 * np.pi * np.arange(_AROUND) / _AROUND, np.linspace(0.0, 2 * np.pi, _ROUND + 1)
    along = [np.column_stack([radii * np.cos(turn), radii * np.sin(turn), heights]) for turn in turns]
    rings = [_ring(fine, radius, height) for height, radius in zip(ring, ring_radius, strict=True)]
    return [line @ one.frame + one.centre for line in [*along, *rings]]


def _sphere(one: Obstacle, _centre: Floats, _reach: float) -> list[Floats]:
    angle, ring = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _ROUND), np.pi * np.arange(-3, 4) / 8
    radius = one.size[0]
    return _round(
        one, radius * np.sin(angle), radius * np.cos(angle), radius * np.sin(ring), radius * np.cos(ring)
    )  # fmt: skip


def _cylinder(one: Obstacle, centre: Floats, reach: float) -> list[Floats]:
    middle = float((centre - one.centre) @ one.frame[2])
    heights, ring = (middle + np.linspace(-reach, reach, count + 1) for count in (_ROUND, _PARTS))
    return _round(one, heights, np.full(len(heights), one.size[0]), ring, np.full(len(ring), one.size[0]))


def _drum(one: Obstacle, _centre: Floats, _reach: float) -> list[Floats]:
    radius, half = one.size[:2]
    ends = np.array([-half, half])
    return _round(one, np.linspace(-half, half, _ROUND), np.full(_ROUND, radius), ends, np.full(2, radius))


def _box(one: Obstacle, _centre: Floats, _reach: float) -> list[Floats]:
    found = []
    for axis in range(3):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            line = np.zeros((_ROUND, 3))
            line[:, axis] = np.linspace(-one.size[axis], one.size[axis], _ROUND)
            for other, sign in zip([k for k in range(3) if k != axis], signs, strict=True):
                line[:, other] = sign * one.size[other]
            found.append(line @ one.frame + one.centre)
    return found


def _surface(one: Obstacle, _centre: Floats, _reach: float) -> list[Floats]:
    assert one.facets is not None
    facets = one.facets
    sides = np.sort(np.stack([facets.triangles, np.roll(facets.triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, where, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    normals = np.zeros((len(edges), 3))
    np.add.at(normals, where.ravel(), np.repeat(facets.normals, 3, axis=0))
    # Two unit normals at an angle add up to 2 cos of half of it.
    smooth = (count == 2) & (np.linalg.norm(normals, axis=1) > 2.0 * np.sqrt(0.5 * (1.0 + _SHARP)))
    drawn = edges if smooth.all() else edges[~smooth]
    first, second = (facets.points[drawn[:, k]] for k in range(2))
    return list(np.linspace(first, second, 8, axis=1))


_LINES = {"plane": _plane, "sphere": _sphere, "cylinder": _cylinder, "drum": _drum, "box": _box, "surface": _surface}
