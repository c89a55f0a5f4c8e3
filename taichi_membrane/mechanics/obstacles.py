"""Spheres, cylinders and boxes that nodes touch: their signed distances, which are exact with gradient and curvature.

In the obstacle's axes y = Q (x - c):

- a sphere or an infinite cylinder of radius R has g = ρ - R, ρ the distance from its centre or axis, n = y/ρ and curvature 1/ρ
  across n, along the axis none;
- a box with edges of radius r is a smaller box dilated by r: q = |y| - (a - r), w = <q>, g = |w| - r. Over a face one w is
  positive, over an edge two, at a corner three: plane, cylinder, sphere, with one normal where they meet;
- a cylinder with ends is the same in the plane of ρ and height.

Nearer to the middle than all rounded edges, where no node should be, the nearest face decides. For hollow ones g changes its sign.
"""

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.contact import ContactTerm
from taichi_membrane.mechanics.nodes import Array, Nodes, room
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class _Turned(ContactTerm):
    """What has axes of its own."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        super().__init__(nodes, structure, number)
        self.sign = -1.0 if structure.obstacles[number].hollow else 1.0
        self.node_arm = ti.Vector.field(
            3, nodes.fp, shape=room(structure.node_count)
        )  # from the centre at rest, in its axes
        self.obstacle_frame = ti.Matrix.field(3, 3, nodes.fp, shape=1)
        self.obstacle_size = ti.Vector.field(4, nodes.fp, shape=1)  # sizes, then the radius of edges

    def settle(self, points: Floats, offset: Floats) -> Floats:
        """(node_count,) distances at rest; writes places, axes and sizes."""
        one: Obstacle = self.obstacle
        arm = (points - (one.centre + offset)) @ one.frame.T
        size = np.array([*one.size, *[0.0] * (3 - len(one.size)), one.rounding])
        self._write(arm.astype(self.dtype), one.frame.astype(self.dtype), size.astype(self.dtype))
        across = arm if one.kind == "sphere" else arm[:, :2]
        return np.asarray(np.linalg.norm(across, axis=1) - one.size[0])

    @ti.kernel
    def _write(self, arm: Array, frame: Array, size: Array):
        for i in range(arm.shape[0]):
            for c in ti.static(range(3)):
                self.node_arm[i][c] = arm[i, c]
            if i == 0:
                for c in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        self.obstacle_frame[0][c, j] = frame[c, j]
                for c in ti.static(range(4)):
                    self.obstacle_size[0][c] = size[c]

    @ti.func
    def turned_back(self, gap, normal, curvature):
        """The three in x, y, z, seen from the side where the structure is."""
        frame = self.obstacle_frame[0]
        sign = ti.cast(self.sign, self.fp)
        return sign * gap, sign * (frame.transpose() @ normal), sign * (frame.transpose() @ curvature @ frame)


@ti.data_oriented
class RoundTerm(_Turned):
    """A sphere, or an infinite cylinder."""

    def __init__(self, nodes: Nodes, structure: Structure, number: int) -> None:
        super().__init__(nodes, structure, number)
        self.is_sphere = structure.obstacles[number].kind == "sphere"

    @ti.func
    def distance(self, i):
        """Gap of node ``i``, its gradient and its second derivative."""
        arm, moved = self.node_arm[i], self.obstacle_frame[0] @ self.displaced(i)
        across = ti.Matrix.identity(self.fp, 3)
        if ti.static(not self.is_sphere):
            arm[2], moved[2], across[2, 2] = 0.0, 0.0, 0.0
        place = arm + moved
        before, after = arm.norm(), ti.max(place.norm(), ti.cast(1e-30, self.fp))
        # The change of the distance without cancellation.
        gap = self.node_contact[i][0] + (2.0 * arm + moved).dot(moved) / (before + after)
        normal = place / after
        return self.turned_back(gap, normal, (across - normal.outer_product(normal)) / after)


@ti.data_oriented
class BoxTerm(_Turned):
    """A box with rounded edges."""

    @ti.func
    def distance(self, i):
        """Gap of node ``i``, its gradient and its second derivative."""
        place = self.node_arm[i] + self.obstacle_frame[0] @ self.displaced(i)
        size = self.obstacle_size[0]
        beyond = ti.Vector.zero(self.fp, 3)
        side = ti.Vector.zero(self.fp, 3)
        for c in ti.static(range(3)):
            side[c] = ti.select(place[c] < 0.0, ti.cast(-1.0, self.fp), ti.cast(1.0, self.fp))
            beyond[c] = ti.abs(place[c]) - (size[c] - size[3])
        gap = beyond.max()
        normal = ti.Vector.zero(self.fp, 3)
        curvature = ti.Matrix.zero(self.fp, 3, 3)
        if gap > 0.0:
            out = ti.max(beyond, ti.cast(0.0, self.fp))
            gap = out.norm()
            normal = side * out / gap
            for c in ti.static(range(3)):
                curvature[c, c] = ti.select(out[c] > 0.0, 1.0 / gap, ti.cast(0.0, self.fp))
            curvature -= normal.outer_product(normal) / gap
        else:
            found = False
            for c in ti.static(range(3)):
                if beyond[c] == gap and not found:
                    normal[c] = side[c]
                    found = True
        return self.turned_back(gap - size[3], normal, curvature)


@ti.data_oriented
class DrumTerm(_Turned):
    """A cylinder with ends, its edges rounded."""

    @ti.func
    def distance(self, i):
        """Gap of node ``i``, its gradient and its second derivative."""
        place = self.node_arm[i] + self.obstacle_frame[0] @ self.displaced(i)
        size = self.obstacle_size[0]
        radius = ti.max(ti.sqrt(place[0] ** 2 + place[1] ** 2), ti.cast(1e-30, self.fp))
        outward = ti.Vector([place[0] / radius, place[1] / radius, ti.cast(0.0, self.fp)])
        around = ti.Vector([-outward[1], outward[0], ti.cast(0.0, self.fp)])
        along = ti.Vector([0.0, 0.0, 1.0], self.fp)
        if place[2] < 0.0:
            along = -along
        over_wall, over_end = radius - (size[0] - size[3]), ti.abs(place[2]) - (size[1] - size[3])
        gap = ti.max(over_wall, over_end)
        towards = ti.Vector([ti.cast(1.0, self.fp), ti.cast(0.0, self.fp)])  # outward and along
        bend = ti.cast(0.0, self.fp)  # curvature in the plane of the axis
        if gap > 0.0:
            out = ti.Vector([ti.max(over_wall, ti.cast(0.0, self.fp)), ti.max(over_end, ti.cast(0.0, self.fp))])
            gap = out.norm()
            towards = out / gap
            bend = ti.select(out.min() > 0.0, 1.0 / gap, ti.cast(0.0, self.fp))
        elif over_end > over_wall:
            towards = ti.Vector([ti.cast(0.0, self.fp), ti.cast(1.0, self.fp)])
        normal = towards[0] * outward + towards[1] * along
        across = towards[1] * outward - towards[0] * along
        curvature = bend * across.outer_product(across) + towards[0] / radius * around.outer_product(around)
        return self.turned_back(gap - size[3], normal, curvature)
