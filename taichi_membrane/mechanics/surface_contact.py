"""A triangulated surface that nodes touch: the signed distance from its nearest point, on the device at every evaluation.

The nearest point lies on a face, where g is the distance from its plane; on an edge, with the curvature 1/d across it; or at a
corner, with 1/d all around; d is the distance from that point. Triangles that can be the nearest are listed by place
(:mod:`facets`). Beyond the rim of an open surface g > 0 on both sides: nothing is held up there. Away from the grid distances may
come out too large.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.contact import ContactTerm
from taichi_membrane.mechanics.nodes import Array, Nodes, fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure

# Where the nearest point lies: on the face, else by the number of the corner, or of the edge opposite it.
_FACE, _CORNER, _EDGE = 0, 1, 4
# So near to a face's own normal (1 - cos) the way to an edge is that from the face.
_SAME = 1e-10


@ti.data_oriented
class SurfaceTerm(ContactTerm):
    """Fields and device code of one surface."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        super().__init__(nodes, structure, number)
        facets = structure.obstacles[number].facets
        assert facets is not None  # else it is no surface
        fp, count, grid = nodes.fp, room(len(facets.triangles)), facets.grid
        self.sign = -1.0 if structure.obstacles[number].hollow else 1.0
        self.node_arm = ti.Vector.field(
            3, fp, shape=room(structure.node_count)
        )  # from the grid's lowest corner at rest
        self.facet_corner = ti.Matrix.field(3, 3, fp, shape=count)  # rows
        self.facet_normal = ti.Vector.field(3, fp, shape=count)
        self.facet_pseudo = ti.Matrix.field(6, 3, fp, shape=count)  # of corners, then of edges
        self.cell_start = ti.field(ti.i32, shape=room(len(grid.start)))
        self.cell_facet = ti.field(ti.i32, shape=room(len(grid.triangles)))
        self.grid_count = ti.Vector.field(3, ti.i32, shape=1)
        self.grid_size = ti.Vector.field(2, fp, shape=1)  # side of a cell, offset

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits, where its nodes do."""
        facets = structure.obstacles[self.number].facets
        if facets is None or not super().accepts(structure):
            return False
        grid = facets.grid
        return (
            len(facets.triangles) <= self.facet_normal.shape[0]
            and len(grid.start) <= self.cell_start.shape[0]
            and len(grid.triangles) <= self.cell_facet.shape[0]
        )

    def upload(self, structure: Structure) -> None:
        """Take over a structure's surface."""
        facets = structure.obstacles[self.number].facets
        assert facets is not None
        grid = self.grid = facets.grid
        self._write(
            (facets.corners - grid.low).astype(self.dtype),
            facets.normals.astype(self.dtype),
            np.concatenate(facets.pseudo_normals, axis=1).astype(self.dtype),
            grid.start.astype(np.int32),
            grid.triangles.astype(np.int32),
        )
        fill(self.grid_count, grid.count[None].astype(np.int32))
        fill(self.grid_size, np.array([[grid.size, structure.obstacles[self.number].offset]], dtype=self.dtype))
        super().upload(structure)

    @ti.kernel
    def _write(self, corner: Array, normal: Array, pseudo: Array, start: Array, facet: Array):
        for i in range(ti.max(normal.shape[0], start.shape[0], facet.shape[0])):
            if i < normal.shape[0]:
                for c in ti.static(range(3)):
                    self.facet_normal[i][c] = normal[i, c]
                    for j in ti.static(range(3)):
                        self.facet_corner[i][j, c] = corner[i, j, c]
                    for j in ti.static(range(6)):
                        self.facet_pseudo[i][j, c] = pseudo[i, j, c]
            if i < start.shape[0]:
                self.cell_start[i] = start[i]
            if i < facet.shape[0]:
                self.cell_facet[i] = facet[i]

    def settle(self, points: Floats, offset: Floats) -> Floats:
        """Places of the nodes at rest; no gaps are needed."""
        fill(self.node_arm, (points - (self.grid.low + offset)).astype(self.dtype))
        return np.zeros(len(points))

    @ti.func
    def nearest(self, place, f):
        """Nearest point of facet ``f``, and where it lies."""
        corner, normal = self.facet_corner[f], self.facet_normal[f]
        found, where = place - normal * (place - corner[0, :]).dot(normal), _FACE
        outside = False
        for k in ti.static(range(3)):
            first, second = corner[k, :], corner[(k + 1) % 3, :]
            outside = outside or (second - first).cross(place - first).dot(normal) < 0.0
        if outside:
            least = ti.cast(0.0, self.fp)
            for k in ti.static(range(3)):
                first = corner[(k + 1) % 3, :]
                along = corner[(k + 2) % 3, :] - first
                share = (place - first).dot(along) / along.dot(along)
                lies = _EDGE + k
                if share <= 0.0:
                    share, lies = ti.cast(0.0, self.fp), _CORNER + (k + 1) % 3
                elif share >= 1.0:
                    share, lies = ti.cast(1.0, self.fp), _CORNER + (k + 2) % 3
                point = first + share * along
                squared = (place - point).dot(place - point)
                if k == 0 or squared < least:
                    least, found, where = squared, point, lies
        return found, where

    @ti.func
    def cell(self, place):
        """Number of the cell of a place, or of the one nearest to it."""
        count = self.grid_count[0]
        number = 0
        for c in ti.static(range(3)):
            along = ti.cast(ti.floor(ti.min(ti.max(place[c] / self.grid_size[0][0], -1.0), 1e6)), ti.i32)
            number = number * count[c] + ti.min(ti.max(along, 0), count[c] - 1)
        return number

    @ti.func
    def distance(self, i):
        """Gap of node ``i``, its gradient and its second derivative."""
        place = self.node_arm[i] + self.displaced(i)
        cell = self.cell(place)
        facet, least, point, where = -1, ti.cast(0.0, self.fp), place, _FACE
        for s in range(self.cell_start[cell], self.cell_start[cell + 1]):
            f = self.cell_facet[s]
            candidate, lies = self.nearest(place, f)
            squared = (place - candidate).dot(place - candidate)
            if facet < 0 or squared < least:
                facet, least, point, where = f, squared, candidate, lies
        normal = self.facet_normal[facet]
        gap = (place - self.facet_corner[facet][0, :]).dot(normal)
        curvature = ti.Matrix.zero(self.fp, 3, 3)
        away = ti.sqrt(least)
        if where != _FACE and away > 0.0:
            direction = (place - point) / away
            pseudo = normal
            for k in ti.static(range(6)):
                if where == _CORNER + k:
                    pseudo = self.facet_pseudo[facet][k, :]
            side = ti.cast(1.0, self.fp)
            rim = pseudo.dot(pseudo) < 0.5
            if rim:
                side = ti.cast(self.sign, self.fp)
            elif direction.dot(pseudo) < 0.0:
                side = -side
            if rim or ti.abs(direction.dot(normal)) < 1.0 - _SAME:
                gap, normal = side * away, side * direction
                curvature = (ti.Matrix.identity(self.fp, 3) - direction.outer_product(direction)) * (side / away)
                for k in ti.static(range(3)):
                    if where == _EDGE + k:
                        along = self.facet_corner[facet][(k + 2) % 3, :] - self.facet_corner[facet][(k + 1) % 3, :]
                        curvature -= along.outer_product(along) * (side / (away * along.dot(along)))
        sign = ti.cast(self.sign, self.fp)
        return sign * gap - self.grid_size[0][1], sign * normal, sign * curvature
