"""Z-buffer rasteriser: triangles to pixels in single precision, on any Taichi back end.

Every pixel has 2 x 2 samples. :meth:`Raster.cover` fills the buffers, :meth:`Raster.shade` reads them. The kernels are
module-level functions of arrays, so that another picture size or another mesh compiles nothing again.
Kernels need real annotations, hence no postponed evaluation here; literals are cast because the default type may be f64.
"""

# mypy: disable-error-code="no-untyped-def, valid-type"

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.device.language import ti

if TYPE_CHECKING:  # a checker sees no types in calls
    F1 = Any
    F2 = Any
    F3 = Any
    I2 = Any
else:
    F1, F2, F3 = (ti.types.ndarray(dtype=ti.f32, ndim=n) for n in (1, 2, 3))
    I2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

BACKGROUND = -1  # in ``code``; else the state (0, 1, 2), plus BACK_FACE where the inside of the surface is seen
BACK_FACE = 4
DEPTH_STEPS = 1 << 24  # nearness 0..1 is kept as an integer: all that f32 resolves, and integer atomics are exact
BACK_BIAS = 64  # steps by which back faces recede: of two coincident sheets the outer one is seen
STRIP = 32  # sample rows per work item, so that one huge triangle is shared between threads
NO_TRIANGLE = 2147483647
LEAP = 0.03  # bounding radii; a larger step in depth between neighbouring samples is the edge of a part in front
TAUT_MARGIN, SLACK_MARGIN, SCALAR, NORMAL, COS_2, SIN_2 = 0, 1, 2, 3, 6, 7  # columns of ``Surface.node``
TAPS = np.array([(dy * r, dx * r) for r in (2, 5, 12) for dy, dx in ((0, 1), (1, 1), (1, 0), (1, -1))], np.int32)
LIGHT = np.array([-0.38, 0.56, 0.74], np.float32) / np.float32(
    1.003
)  # unit; upper left, in front: where readers expect it


@dataclass(frozen=True, kw_only=True)
class Surface:
    """What the raster needs of one surface, all f32 or i32 and contiguous.

    ``screen`` (n, 4): sample x, sample y, nearness (0 farthest to 1 nearest, linear on the screen), perspective weight.
    ``triangles`` (m, 3). ``node`` (n, 8): taut margin, slack margin, scalar (0..1), normal (3), wrinkle direction on the
    screen as cos 2θ, sin 2θ. ``face_normal`` (m, 3). Normals are unit vectors in view axes.
    """

    screen: NDArray[np.float32]
    triangles: NDArray[np.int32]
    node: NDArray[np.float32]
    face_normal: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Paint:
    """How the surface is coloured.

    ``palette`` (3, 3): colours of the states; ``ramp`` (k, 3): colours of the scalar from low to high. ``shown`` says which
    states may appear. ``darkest`` is the brightness of a surface turned away from the light (1 fully lit).
    ``radii_per_nearness`` is the depth, in bounding radii, of the whole nearness range, at least 1e-3 (steps are counted in
    32 bits); ``samples_per_radius`` the scale; ``line`` the width of lines in samples.
    """

    palette: NDArray[np.float32]
    ramp: NDArray[np.float32]
    shown: tuple[bool, bool, bool]
    by_scalar: bool
    border: bool
    darkest: float
    line: int
    radii_per_nearness: float
    samples_per_radius: float


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """A shaded picture, rows from the top: ``colour`` (h, w, 3) uint8; ``code`` (h, w) state plus BACK_FACE where all four
    samples agree, else BACKGROUND; ``direction`` (h, w, 2) cos 2θ, sin 2θ not normalised; ``nearness`` (h, w), negative outside."""

    colour: NDArray[np.uint8]
    code: NDArray[np.int32]
    direction: NDArray[np.float32]
    nearness: NDArray[np.float32]


class Raster:
    """Sample buffers of one picture size, kept on the device and reused from frame to frame."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.width, self.height = size
        shape = (2 * self.height, 2 * self.width)
        self._depth, self._owner, self._code = (ti.ndarray(ti.i32, shape) for _ in range(3))

    def cover(self, screen: NDArray[np.float32], triangles: NDArray[np.int32]) -> NDArray[np.int32]:
        """Find the nearest triangle of every sample; returns the number of covered samples (0..4) per pixel, (h, w)."""
        y = screen[:, 1][triangles]
        tallest = float((y.max(axis=1).clip(0, 2 * self.height) - y.min(axis=1).clip(0, 2 * self.height)).max())
        strips = int(tallest) // STRIP + 1
        _clear(self._depth, self._owner)
        for owners in (0, 1):
            _scatter(screen, triangles, strips, owners, self._depth, self._owner)
        count = np.empty((self.height, self.width), np.int32)
        _count(self._depth, count)
        return count

    def shade(self, surface: Surface, paint: Paint) -> Pixels:
        """Colour the samples found by the last :meth:`cover` of the same surface and average them to pixels."""
        samples = (surface.screen, surface.triangles, surface.node)
        _classify(*samples, self._depth, self._owner, self._code, *map(int, paint.shown))
        shape = (self.height, self.width)
        packed, code = np.empty(shape, np.int32), np.empty(shape, np.int32)
        direction, nearness = np.empty((*shape, 2), np.float32), np.empty(shape, np.float32)
        _resolve(
            *samples, surface.face_normal, self._depth, self._owner, self._code,
            paint.palette, paint.ramp, LIGHT, TAPS, int(paint.by_scalar), int(paint.border), paint.line, paint.darkest,
            paint.radii_per_nearness, paint.samples_per_radius, packed, code, direction, nearness,
        )  # fmt: skip
        channels = [(packed >> shift & 255).astype(np.uint8) for shift in (0, 8, 16)]
        return Pixels(colour=np.stack(channels, axis=-1), code=code, direction=direction, nearness=nearness)


@functools.lru_cache(maxsize=1)
def raster_of_size(width: int, height: int) -> Raster:
    """The raster of a picture size; the last one is kept, since all frames of a run have one size."""
    return Raster((width, height))


@ti.func
def _cross(ax, ay, bx, by):
    return ax * by - ay * bx


@ti.func
def _corner_areas(screen: ti.template(), a, b, c, x, y):
    """Barycentric coordinates of a sample times twice the area (sign as in :func:`_double_area`).

    Differences to the sample come first, so that f32 loses nothing on small triangles.
    """
    ax, ay = screen[a, 0] - x, screen[a, 1] - y
    bx, by = screen[b, 0] - x, screen[b, 1] - y
    cx, cy = screen[c, 0] - x, screen[c, 1] - y
    return ti.Vector([_cross(bx, by, cx, cy), _cross(cx, cy, ax, ay), _cross(ax, ay, bx, by)])


@ti.func
def _weights(screen: ti.template(), triangles: ti.template(), t, y, x):
    """Barycentric coordinates, on the surface itself (perspective taken out), of the point that sample (y, x) shows."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    w = _corner_areas(screen, a, b, c, ti.cast(x, ti.f32) + ti.f32(0.5), ti.cast(y, ti.f32) + ti.f32(0.5))
    w = ti.Vector([w[0] * screen[a, 3], w[1] * screen[b, 3], w[2] * screen[c, 3]])
    return w / (w[0] + w[1] + w[2])


@ti.func
def _at(node: ti.template(), column: ti.template(), triangles: ti.template(), t, w):
    """A nodal field interpolated in triangle t."""
    return (
        w[0] * node[triangles[t, 0], column]
        + w[1] * node[triangles[t, 1], column]
        + w[2] * node[triangles[t, 2], column]
    )


@ti.func
def _double_area(screen: ti.template(), a, b, c):
    """Negative when the corners run counter-clockwise as seen (y points down): the front."""
    return _cross(
        screen[b, 0] - screen[a, 0],
        screen[b, 1] - screen[a, 1],
        screen[c, 0] - screen[a, 0],
        screen[c, 1] - screen[a, 1],
    )


@ti.func
def _unit(v):
    return v * ti.rsqrt(ti.max(v.dot(v), ti.f32(1e-20)))


@ti.func
def _mix(a, b, t):
    return a + (b - a) * t


@ti.kernel
def _clear(depth: I2, owner: I2):
    for y, x in ti.ndrange(depth.shape[0], depth.shape[1]):
        depth[y, x] = -1
        owner[y, x] = NO_TRIANGLE


@ti.kernel
def _scatter(screen: F2, triangles: I2, strips: ti.i32, owners: ti.i32, depth: I2, owner: I2):
    """One compiled body for both passes (nearest depth, then its triangle), so that both compute the same bits."""
    for t, s in ti.ndrange(triangles.shape[0], strips):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        half, zero = ti.f32(0.5), ti.f32(0.0)
        columns, rows = ti.cast(depth.shape[1], ti.f32), ti.cast(depth.shape[0], ti.f32)
        x_min = ti.min(screen[a, 0], ti.min(screen[b, 0], screen[c, 0]))
        x_max = ti.max(screen[a, 0], ti.max(screen[b, 0], screen[c, 0]))
        y_min = ti.min(screen[a, 1], ti.min(screen[b, 1], screen[c, 1]))
        y_max = ti.max(screen[a, 1], ti.max(screen[b, 1], screen[c, 1]))
        x0 = ti.cast(ti.ceil(ti.max(x_min, zero) - half), ti.i32)
        x1 = ti.cast(ti.floor(ti.min(x_max, columns) - half), ti.i32) + 1
        y0 = ti.cast(ti.ceil(ti.max(y_min, zero) - half), ti.i32) + s * STRIP
        y1 = ti.min(ti.cast(ti.floor(ti.min(y_max, rows) - half), ti.i32) + 1, y0 + STRIP)
        area = _double_area(screen, a, b, c)
        hair = ti.f32(-1e-5) * ti.abs(area)  # neighbours overlap by a hair rather than leave a crack
        lift = 0
        if area < zero:
            lift = BACK_BIAS
        if ti.abs(area) > ti.f32(1e-9):
            for y in range(ti.max(y0, 0), y1):
                entered = 0
                for x in range(ti.max(x0, 0), x1):
                    w = _corner_areas(screen, a, b, c, ti.cast(x, ti.f32) + half, ti.cast(y, ti.f32) + half)
                    if area < zero:
                        w = -w
                    if w.min() < hair:
                        if entered == 1:
                            break
                    else:
                        entered = 1
                        w /= w[0] + w[1] + w[2]
                        near = w[0] * screen[a, 2] + w[1] * screen[b, 2] + w[2] * screen[c, 2]
                        step = ti.max(ti.cast(near * ti.cast(DEPTH_STEPS - BACK_BIAS, ti.f32), ti.i32) + lift, 0)
                        if owners == 0:
                            if step > depth[y, x]:
                                ti.atomic_max(depth[y, x], step)
                        elif depth[y, x] == step:
                            ti.atomic_min(owner[y, x], t)


@ti.kernel
def _count(depth: I2, count: I2):
    for y, x in ti.ndrange(count.shape[0], count.shape[1]):
        n = 0
        for j, i in ti.static(ti.ndrange(2, 2)):
            n += ti.cast(depth[2 * y + j, 2 * x + i] >= 0, ti.i32)
        count[y, x] = n


@ti.kernel
def _classify(
    screen: F2, triangles: I2, node: F2, depth: I2, owner: I2, code: I2, taut: ti.i32, wrinkled: ti.i32, slack: ti.i32
):
    """The state of every sample from the interpolated margins: borders are smooth curves, not rows of triangles."""
    for y, x in ti.ndrange(depth.shape[0], depth.shape[1]):
        state = BACKGROUND
        if depth[y, x] >= 0:
            t = owner[y, x]
            w = _weights(screen, triangles, t, y, x)
            taut_margin = _at(node, TAUT_MARGIN, triangles, t, w)
            slack_margin = _at(node, SLACK_MARGIN, triangles, t, w)
            if slack != 0 and (slack_margin < 0 or taut + wrinkled == 0):
                state = 2
            elif wrinkled != 0 and (taut_margin < 0 or taut == 0):
                state = 1
            else:
                state = 0
            if _double_area(screen, triangles[t, 0], triangles[t, 1], triangles[t, 2]) > 0:
                state += BACK_FACE
        code[y, x] = state


@ti.func
def _normal(triangles: ti.template(), node: ti.template(), face_normal: ti.template(), t, w):
    """Interpolated unit normal that faces the viewer; at a crease each triangle keeps its own."""
    flat = ti.Vector([face_normal[t, 0], face_normal[t, 1], face_normal[t, 2]])
    n = flat * ti.f32(0.0)
    for k in ti.static(range(3)):
        i = triangles[t, k]
        smooth = ti.Vector([node[i, NORMAL], node[i, NORMAL + 1], node[i, NORMAL + 2]])
        if smooth.dot(flat) < ti.f32(0.85):  # more than 32°
            smooth = flat
        n += w[k] * smooth
    n = _unit(n)
    if n[2] < 0:
        n = -n
    return n


@ti.func
def _cavity(depth: ti.template(), taps: ti.template(), y, x, radii_per_step, samples_per_radius, unit):
    """Ambient occlusion 0..0.5 from pairs of opposite samples: planes cancel out, hollows are nearer on both sides."""
    here = depth[y, x]
    total = ti.f32(0.0)
    for tap in range(taps.shape[0]):
        dy, dx = taps[tap, 0] * unit, taps[tap, 1] * unit
        reach = ti.max(ti.abs(dx), ti.abs(dy))
        limit = ti.cast(reach, ti.f32) / samples_per_radius
        both = ti.f32(0.0)
        for side in range(2):
            j = y + (1 - 2 * side) * dy
            i = x + (1 - 2 * side) * dx
            rise = -limit
            if 0 <= j < depth.shape[0] and 0 <= i < depth.shape[1] and depth[j, i] >= 0:
                rise = ti.cast(depth[j, i] - here, ti.f32) * radii_per_step
            both += ti.max(-limit, ti.min(limit, rise))
        total += ti.max(ti.f32(0.0), both) / limit
    return ti.min(ti.f32(0.5), ti.f32(0.5) * total / ti.cast(taps.shape[0], ti.f32))


@ti.func
def _line_here(depth: ti.template(), code: ti.template(), y, x, line, jump):
    """2 on a silhouette or rim, 1 on the border between two states, else 0; the nearer surface carries the line."""
    kind = 0
    here, own = depth[y, x], code[y, x]
    for k in range(4):
        dy, dx = 0, 0
        if k < 2:
            dx = line * (1 - 2 * k)
        else:
            dy = line * (5 - 2 * k)
        j, i, p, q = y + dy, x + dx, y - dy, x - dx
        if 0 <= j < depth.shape[0] and 0 <= i < depth.shape[1]:
            other = depth[j, i]
            slope = 0
            if 0 <= p < depth.shape[0] and 0 <= q < depth.shape[1] and depth[p, q] >= 0:
                slope = ti.max(0, depth[p, q] - here)
            same_side = own // BACK_FACE == code[j, i] // BACK_FACE
            if other < 0 or here - other - slope > jump or (here >= other and not same_side):
                kind = 2
            elif own != code[j, i] and same_side:
                kind = ti.max(kind, 1)
    return kind


@ti.func
def _surface_colour(
    triangles: ti.template(), node: ti.template(), face_normal: ti.template(), palette: ti.template(),
    ramp: ti.template(), light: ti.template(), by_scalar, darkest, t, w, code
):  # fmt: skip
    """State or scalar colour, lit; the inside of the surface darker and cooler."""
    state = code % BACK_FACE
    colour = ti.Vector([palette[state, 0], palette[state, 1], palette[state, 2]])
    if by_scalar != 0:
        last = ramp.shape[0] - 1
        place = _at(node, SCALAR, triangles, t, w) * ti.cast(last, ti.f32)
        place = ti.max(ti.f32(0.0), ti.min(ti.cast(last, ti.f32), place))
        r = ti.min(ti.cast(place, ti.i32), last - 1)
        for k in ti.static(range(3)):
            colour[k] = _mix(ramp[r, k], ramp[r + 1, k], place - ti.cast(r, ti.f32))
    if code >= BACK_FACE:
        inside = ti.Vector([ti.f32(0.24), ti.f32(0.30), ti.f32(0.40)])
        colour = _mix(colour * ti.f32(0.8), inside, ti.f32(0.35))
    n = _normal(triangles, node, face_normal, t, w)
    facing = n[0] * light[0] + n[1] * light[1] + n[2] * light[2]
    return colour * _mix(darkest, ti.f32(1.0), ti.f32(0.5) + ti.f32(0.5) * facing)


@ti.kernel
def _resolve(
    screen: F2, triangles: I2, node: F2, face_normal: F2, depth: I2, owner: I2, code: I2, palette: F2, ramp: F2, light: F1,
    taps: I2, by_scalar: ti.i32, border: ti.i32, line: ti.i32, darkest: ti.f32, radii_per_nearness: ti.f32,
    samples_per_radius: ti.f32, packed: I2, pixel_code: I2, direction: F3, nearness: F2,
):  # fmt: skip
    for y, x in ti.ndrange(packed.shape[0], packed.shape[1]):
        radii_per_step = radii_per_nearness / ti.cast(DEPTH_STEPS, ti.f32)
        jump = ti.cast(ti.f32(LEAP) / radii_per_step, ti.i32)
        white = ti.Vector([ti.f32(1.0), ti.f32(1.0), ti.f32(1.0)])
        ink = ti.Vector([ti.f32(0.10), ti.f32(0.12), ti.f32(0.16)])
        total, base = white * ti.f32(0.0), white
        agreed, nearest, lit = code[2 * y, 2 * x], -1, 0
        for k in range(1, 4):
            if code[2 * y + k // 2, 2 * x + k % 2] != agreed:
                agreed = BACKGROUND
        direction[y, x, 0] = ti.f32(0.0)
        direction[y, x, 1] = ti.f32(0.0)
        for k in range(4):
            j, i = 2 * y + k // 2, 2 * x + k % 2
            nearest = ti.max(nearest, depth[j, i])
            colour = white
            if depth[j, i] >= 0:
                if lit == 0 or agreed == BACKGROUND:  # one shading serves a pixel whose samples show the same thing
                    lit = 1
                    t = owner[j, i]
                    w = _weights(screen, triangles, t, j, i)
                    base = _surface_colour(
                        triangles, node, face_normal, palette, ramp, light, by_scalar, darkest, t, w, code[j, i]
                    )
                    base *= ti.f32(1.0) - _cavity(depth, taps, j, i, radii_per_step, samples_per_radius, line)
                    direction[y, x, 0] = _at(node, COS_2, triangles, t, w)
                    direction[y, x, 1] = _at(node, SIN_2, triangles, t, w)
                colour = base
                kind = _line_here(depth, code, j, i, line, jump)
                if kind == 2:
                    colour = _mix(colour, ink, ti.f32(0.85))
                elif kind == 1 and border != 0:
                    colour = _mix(colour, ink, ti.f32(0.55))
            total += colour
        level = ti.cast(total * ti.f32(0.25 * 255.0) + ti.f32(0.5), ti.i32)
        packed[y, x] = level[0] | level[1] << 8 | level[2] << 16
        pixel_code[y, x] = agreed
        nearness[y, x] = ti.cast(nearest, ti.f32) / ti.cast(DEPTH_STEPS, ti.f32)
