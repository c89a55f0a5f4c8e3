"""Two cubes with a wall between, for six-node triangles."""

from __future__ import annotations

from typing import Any

import numpy as np

from taichi_membrane.mesh import Mesh


def two_boxes() -> Mesh:
    """Two cubes side by side with a wall between, each face cut in eight; normals out of the left one and the right one's rest."""
    points: list[tuple[float, ...]] = []
    triangles: list[list[int]] = []
    members: dict[str, list[int]] = {"left": [], "right": [], "wall": []}

    def number(point: Any) -> int:
        key = tuple(np.round(np.asarray(point, dtype=float), 9).tolist())
        if key not in points:
            points.append(key)
        return points.index(key)

    def face(origin: Any, u: Any, v: Any, name: str) -> None:
        """Normal u × v."""
        o, u, v = (np.asarray(one, dtype=float) for one in (origin, u, v))
        for i in range(2):
            for j in range(2):
                a, b, c, d = (
                    number(o + u * s / 2 + v * t / 2) for s, t in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
                )
                cut = [[a, b, c], [a, c, d]] if (i + j) % 2 == 0 else [[a, b, d], [b, c, d]]
                for corners in cut:
                    members[name].append(len(triangles))
                    triangles.append(corners)

    x, y, z = np.eye(3)
    for name, at in (("left", 0.0), ("right", 1.0)):
        face((at, 0, 0), y, x, name)
        face((at, 0, 1), x, y, name)
        face((at, 0, 0), x, z, name)
        face((at, 1, 0), z, x, name)
    face((0, 0, 0), z, y, "left")
    face((2, 0, 0), y, z, "right")
    face((1, 0, 0), y, z, "wall")
    at = np.array(points)
    on_wall = at[:, 0] == 1.0
    rim = on_wall & (np.abs(at[:, 1:] - 0.5).max(axis=1) == 0.5)
    groups = {
        "floor": np.flatnonzero(at[:, 2] == 0.0),
        "seam": np.flatnonzero(rim),
        "amid_wall": np.flatnonzero(on_wall & ~rim),
    }
    return Mesh.build(at, triangles, groups, members)
