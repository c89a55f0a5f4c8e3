"""A box of two chambers with an inner wall, as a mesh with groups: sixteen edges, at n = 4, of three elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh import Mesh

Vector = tuple[float, float, float]


class Grid:
    """Rectangles of n × n squares that share the nodes of their edges."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.number: dict[Vector, int] = {}
        self.triangles: list[tuple[int, int, int]] = []
        self.groups: dict[str, list[int]] = {}

    def add(self, group: str, origin: Vector, first: Vector, second: Vector) -> None:
        """A rectangle whose normal is first × second."""
        steps = np.arange(self.n + 1) / self.n
        places = np.array(origin) + steps[:, None, None] * np.array(first) + steps[:, None] * np.array(second)
        at = [[self._node(place) for place in row] for row in places]
        for i in range(self.n):
            for j in range(self.n):
                a, b, c, d = at[i][j], at[i + 1][j], at[i + 1][j + 1], at[i][j + 1]
                pair = ((a, b, c), (a, c, d)) if (i + j) % 2 else ((a, b, d), (b, c, d))
                members = self.groups.setdefault(group, [])
                members += [len(self.triangles), len(self.triangles) + 1]
                self.triangles += pair

    def _node(self, place: NDArray[np.float64]) -> int:
        x, y, z = (round(float(v), 9) for v in place)
        return self.number.setdefault((x, y, z), len(self.number))


def two_cells(n: int, *, turned: bool = False) -> Mesh:
    """A box 2 × 1 × 1 with a wall at x = 1: element groups a and b of the outer faces, wall; node group floor.

    The wall's normal points along x, from a into b, or the other way round where ``turned``.
    """
    grid = Grid(n)
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    for cell, start in (("a", 0.0), ("b", 1.0)):
        corner = (start, 0.0, 0.0)
        grid.add(cell, corner, y, x)
        grid.add(cell, (start, 0.0, 1.0), x, y)
        grid.add(cell, corner, x, z)
        grid.add(cell, (start, 1.0, 0.0), z, x)
    grid.add("a", (0.0, 0.0, 0.0), z, y)
    grid.add("b", (2.0, 0.0, 0.0), y, z)
    grid.add("wall", x, y, z)
    points = np.array(list(grid.number))
    if turned:
        grid.triangles = [
            (a, c, b) if t in grid.groups["wall"] else (a, b, c) for t, (a, b, c) in enumerate(grid.triangles)
        ]
    return Mesh.build(points, grid.triangles, {"floor": np.flatnonzero(points[:, 2] == 0.0)}, grid.groups)
