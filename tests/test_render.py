"""Pictures: geometry against formulas, categories against element areas, nothing hidden or invented, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from taichi_membrane.errors import InputError
from taichi_membrane.pictures import raster, render
from taichi_membrane.pictures.camera import VIEWER_DISTANCE, Projection
from taichi_membrane.pictures.furniture import Page
from taichi_membrane.pictures.render import Camera, Frame, Look, draw_frame, fit_camera, write_animation
from taichi_membrane.pictures.symbols import draw_loads
from taichi_membrane.pictures.wrinkle_lines import wrinkle_lines

pytestmark = pytest.mark.usefixtures("runtime_cpu")

SIZE = (400, 250)  # small: most of the time goes into pixels
Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def _grid(rows: int, columns: int, *, wrap: bool) -> Ints:
    """Two triangles per cell of a grid of nodes with ``columns`` nodes (wrapped) or ``columns + 1`` nodes a row."""
    width = columns if wrap else columns + 1
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    a, b = i * width + j, (i + 1) * width + j
    c, d = (i + 1) * width + (j + 1) % width, i * width + (j + 1) % width
    return np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)


def _sphere(n: int = 48, radius: float = 1.0) -> tuple[Floats, Ints]:
    """Latitudes and longitudes, outward normals; the poles are rings of coincident nodes."""
    polar, turn = np.linspace(0.0, np.pi, n + 1), np.arange(2 * n) * np.pi / n
    ring = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    points = np.concatenate(
        (np.sin(polar)[:, None, None] * ring, np.tile(np.cos(polar)[:, None, None], (2 * n, 1))), axis=2
    )
    return radius * points.reshape(-1, 3), _grid(n, 2 * n, wrap=True)


def _sheet(n: int, *, height: float = 0.0) -> tuple[Floats, Ints]:
    """Square from -1 to 1 in a plane z = height, normal +z."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, n + 1), np.linspace(-1.0, 1.0, n + 1), indexing="ij")
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, height))), _grid(n, n, wrap=False)


def _tube(along: int = 60, around: int = 48) -> tuple[Floats, Ints]:
    """Open tube along x, length 4, radius 0.5, outward normals."""
    turn = np.arange(around) * 2.0 * np.pi / around
    x = np.repeat(np.linspace(0.0, 4.0, along + 1), around)
    ring = np.tile(0.5 * np.column_stack((np.sin(turn), np.cos(turn))), (along + 1, 1))
    return np.column_stack((x, ring)), np.ascontiguousarray(_grid(along, around, wrap=True))


def _frame(points: Floats, triangles: Ints, **changes: object) -> Frame:
    m = len(triangles)
    plain = Frame(
        points=points, reference=points, triangles=triangles, state=np.zeros(m, np.int8), taut_margin=np.ones(m),
        slack_margin=np.ones(m), wrinkle_direction=np.tile((1.0, 0.0, 0.0), (m, 1)),
    )  # fmt: skip
    return replace(plain, **changes)  # type: ignore[arg-type]


def _with_states(points: Floats, triangles: Ints, taut: Floats, slack: Floats, **changes: object) -> Frame:
    state = np.where(slack < 0, 2, np.where(taut < 0, 1, 0)).astype(np.int8)
    return _frame(points, triangles, state=state, taut_margin=taut, slack_margin=slack, **changes)


def _cantilever() -> Frame:
    """The made-up case of the gallery: a tube with a wrinkled zone at the root's underside and a slack patch in it."""
    points, triangles = _tube(along=90)
    x, y, z = points[triangles].mean(axis=1).T
    turn = np.arctan2(y, -z)
    taut, slack = 0.35 + 0.45 * x - np.cos(turn), 0.3 + 1.1 * x - 0.75 * np.cos(turn)
    bent = points - np.column_stack((0 * points[:, 0], 0 * points[:, 0], 0.04 * points[:, 0] ** 2))
    hoop = np.column_stack((0 * x, np.cos(turn), np.sin(turn)))
    return _with_states(bent, triangles, taut, slack, reference=points, wrinkle_direction=hoop)


def _camera(
    frame: Frame, azimuth: float = 0.0, elevation: float = 0.0, projection: Projection = "orthographic", size=SIZE
) -> Camera:  # type: ignore[no-untyped-def]
    return fit_camera([frame.points], azimuth=azimuth, elevation=elevation, projection=projection, size=size)


def _cover(frame: Frame, camera: Camera) -> Floats:
    """Share of each pixel the surface covers."""
    screen = camera.project(frame.points)
    samples = render._DepthScale.of(screen, camera).samples(screen)
    return raster.raster_of_size(*camera.size).cover(samples, frame.triangles) / 4.0


def _shade(frame: Frame, camera: Camera, look: Look | None = None) -> raster.Pixels:
    look = look or Look()
    screen = camera.project(frame.points)
    scale = render._DepthScale.of(screen, camera)
    surface = render._surface(frame, camera, scale.samples(screen), render._scalar_levels(frame, look)[1])
    target = raster.raster_of_size(*camera.size)
    target.cover(surface.screen, surface.triangles)
    return target.shade(surface, render._paint(look, render._area_shares(frame), scale, camera))


def _image(frame: Frame, path: Path, look: Look, camera: Camera) -> NDArray[np.uint8]:
    draw_frame(frame, look=look, camera=camera, path=path)
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


# Camera and coverage


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_sphere_covers_the_area_of_its_silhouette(projection: Projection, radius: float) -> None:
    """Seen from d radii, a sphere looks as large as a disc of radius d / √(d² - 1) at its centre's depth."""
    frame = _frame(*_sphere(96, radius))
    camera = _camera(frame, 20.0, 35.0, projection)
    seen = camera.pixels_per_radius
    if projection == "perspective":
        seen *= VIEWER_DISTANCE / np.sqrt(VIEWER_DISTANCE**2 - 1.0)
    # The inscribed polygon of 96 sides lacks 0.07 % of the area; samples add less than 0.05 %.
    assert _cover(frame, camera).sum() == pytest.approx(np.pi * seen**2, rel=1.5e-3)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "axis", "expected"),
    [
        (0.0, 0.0, (1, 0, 0), (1, 0)), (0.0, 0.0, (0, 0, 1), (0, -1)), (90.0, 0.0, (0, 1, 0), (1, 0)),
        (90.0, 0.0, (0, 0, 1), (0, -1)), (0.0, 90.0, (1, 0, 0), (1, 0)), (0.0, 90.0, (0, 1, 0), (0, -1)),
        (180.0, 0.0, (1, 0, 0), (-1, 0)),
    ],
)  # fmt: skip
def test_azimuth_and_elevation_are_as_documented(
    azimuth: float, elevation: float, axis: tuple[int, ...], expected: tuple[int, ...]
) -> None:
    camera = _camera(_frame(*_sphere(8)), azimuth, elevation)
    centre, tip = camera.project(np.array([camera.centre, camera.centre + axis]))
    assert (tip - centre)[:2] / camera.pixels_per_length == pytest.approx(expected, abs=1e-12)


def test_viewer_stands_on_the_negative_y_side_at_azimuth_zero() -> None:
    camera = _camera(_frame(*_sphere(8)))
    near, far = camera.project(np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]))[:, 2]
    assert near < far


def test_seen_direction_is_the_derivative_of_the_projection() -> None:
    rng = np.random.default_rng(5)
    for projection in ("orthographic", "perspective"):
        camera = _camera(_frame(*_sphere(8)), 30.0, 20.0, projection)  # type: ignore[arg-type]
        points, directions = rng.uniform(-0.5, 0.5, (20, 3)), rng.normal(size=(20, 3))
        change = camera.project(points + 1e-5 * directions) - camera.project(points - 1e-5 * directions)
        numeric = change[:, :2] / 2e-5 / camera.pixels_per_length
        assert camera.seen_direction(points, directions) == pytest.approx(numeric, abs=1e-8)  # second-order difference


@pytest.mark.parametrize("size", [(400, 250), (1600, 1000), (500, 900)])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_object_is_large_and_keeps_clear_of_the_furniture(projection: Projection, size: tuple[int, int]) -> None:
    for points in (_sphere(24)[0], _tube()[0], _sheet(6)[0]):
        camera = fit_camera([points], azimuth=25.0, elevation=20.0, projection=projection, size=size)
        x, y, _ = camera.project(points).T
        unit = render.furniture_scale(size)
        assert x.min() > 40 * unit
        assert x.max() < size[0] - 40 * unit
        assert y.min() > 108 * unit
        assert y.max() < size[1] - 40 * unit
        right, top = x > size[0] - 415 * unit, y < 255 * unit
        assert not (right & top).any()  # the legend
        fills = max(np.ptp(x) / size[0], np.ptp(y) / (size[1] - 160 * unit))
        assert fills > 0.6  # a coarse bound: how large it can be depends on its outline


def test_one_camera_shows_all_point_sets() -> None:
    points = _sphere(8)[0]
    both = fit_camera(iter([points, points + 4.0]), azimuth=0.0, elevation=0.0, projection="perspective", size=SIZE)
    pixels = both.project(np.concatenate((points, points + 4.0)))[:, :2]
    assert pixels.min() > 0
    assert (pixels.max(axis=0) < SIZE).all()


# Visible surface


def test_nearer_surface_hides_the_farther() -> None:
    """Wrinkled sheet below, taut sheet above: from above only taut is seen, from below only wrinkled backs."""
    low, triangles = _sheet(3, height=-0.5)
    points = np.concatenate((low, _sheet(3, height=0.5)[0]))
    both = np.concatenate((triangles, triangles + len(low))).astype(np.int32)
    taut = np.repeat((-1.0, 1.0), len(triangles))
    frame = _with_states(points, both, taut, np.ones(len(both)))
    for projection in ("orthographic", "perspective"):
        above = _shade(frame, _camera(frame, 0.0, 90.0, projection)).code  # type: ignore[arg-type]
        below = _shade(frame, _camera(frame, 0.0, -90.0, projection)).code  # type: ignore[arg-type]
        assert set(np.unique(below)) == {raster.BACKGROUND, 1 + raster.BACK_FACE}
        # In perspective the nearer sheet looks larger and covers the other completely.
        assert set(np.unique(above)) == {raster.BACKGROUND, 0}


def test_of_two_coincident_sheets_the_outer_one_is_seen() -> None:
    """A flat cushion before inflation: without a rule rounding would mix both sheets."""
    points, triangles = _sheet(7)
    closed = np.concatenate((triangles, triangles[:, ::-1])).astype(np.int32)
    frame = _frame(points, closed)
    for elevation in (90.0, 33.0, -20.0):
        code = _shade(frame, _camera(frame, 17.0, elevation, "perspective")).code
        assert set(np.unique(code)) == {raster.BACKGROUND, 0}


def test_inside_of_an_open_tube_is_darker_and_cooler() -> None:
    frame = _frame(*_tube())
    pixels = _shade(frame, _camera(frame, -55.0, 10.0, "perspective"))
    inside, outside = pixels.colour[pixels.code == raster.BACK_FACE], pixels.colour[pixels.code == 0]
    assert len(inside) > 200
    assert inside.mean() < 0.8 * outside.mean()
    red, _, blue = inside.astype(float).mean(axis=0)
    assert blue / red > 1.02


def test_neighbouring_triangles_leave_no_cracks() -> None:
    frame = _frame(*_sphere(64))
    cover = _cover(frame, _camera(frame, 11.0, 23.0, "perspective"))
    rows = [np.flatnonzero(row == 1.0) for row in cover]
    assert all((np.diff(row) == 1).all() for row in rows if len(row) > 1)


# Categories


@pytest.mark.parametrize("angle", [0.0, 23.0, 33.0, 45.0, 71.0])
def test_border_between_two_half_planes_is_straight_on_a_coarse_mesh(angle: float) -> None:
    points, triangles = _sheet(9)
    normal = np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle))))
    centroid = points[triangles].mean(axis=1)[:, :2]
    frame = _with_states(points, triangles, centroid @ normal - 0.04, np.ones(len(triangles)))
    camera = _camera(frame, 0.0, 90.0)
    code = _shade(frame, camera).code
    y, x = np.nonzero(np.isin(code, (0, 1)))
    flat = (np.column_stack((x + 0.5, y + 0.5)) - camera.principal) / camera.pixels_per_length * (1.0, -1.0)
    signed = (flat @ normal - 0.04) * camera.pixels_per_length  # distance to the true border in pixels
    taut = code[y, x] == 0
    # Inside, linear margins are reproduced exactly: half a pixel's diagonal. At the rim, where nodes have elements on one
    # side only, less than a tenth of a cell of 22 pixels. Rows of triangles would err by half a cell everywhere.
    inner = np.abs(flat).max(axis=1) < 0.75
    for error in (signed[~taut & inner].max(), -signed[taut & inner].min()):
        assert error < 0.71
    for error in (signed[~taut].max(), -signed[taut].min()):
        assert error < 2.0


def test_border_is_exact_in_perspective() -> None:
    """Attributes linear on a strongly inclined plane; interpolating on the screen instead would bend the border."""
    points = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    screen_camera = fit_camera([points], azimuth=0.0, elevation=15.0, projection="perspective", size=SIZE)
    projected = screen_camera.project(points)
    node = np.zeros((4, 8), np.float32)
    node[:, raster.TAUT_MARGIN] = points[:, 1]  # the border is the line y = 0
    node[:, raster.SLACK_MARGIN] = 1.0
    node[:, raster.NORMAL + 2] = 1.0
    scale = render._DepthScale.of(projected, screen_camera)
    surface = raster.Surface(
        screen=scale.samples(projected),
        triangles=triangles,
        node=node,
        face_normal=np.tile(np.float32((0, 0, 1)), (2, 1)),
    )
    target = raster.raster_of_size(*SIZE)
    target.cover(surface.screen, surface.triangles)
    code = target.shade(surface, render._paint(Look(), (0.5, 0.5, 0.0), scale, screen_camera)).code
    border = screen_camera.project(np.array([[0.0, 0.0, 0.0]]))[0, 1]
    rows = np.arange(SIZE[1])[:, None] + 0.5
    assert not ((code == 0) & (rows > border + 0.5)).any()  # y > 0 is farther away: above the border in the picture
    assert not ((code == 1) & (rows < border - 0.5)).any()


@pytest.mark.parametrize("elevation", [-90.0, -40.0])
def test_pixel_shares_agree_with_element_shares(elevation: float) -> None:
    """Orthographic: projected element areas, of the elements that face the viewer, are what pixels should show."""
    frame = _cantilever()
    camera = _camera(frame, 10.0, elevation, size=(800, 500))
    code = _shade(frame, camera).code
    vectors = render._area_vectors(frame.points, frame.triangles).T @ camera.axes[2]
    facing = vectors > 0
    for state in (0, 1, 2):
        by_element = vectors[facing & (frame.state == state)].sum() / vectors[facing].sum()
        by_pixel = (code == state).sum() / (np.isin(code, (0, 1, 2))).sum()
        # One row of elements (1/48 of the girth, less towards the limb) on either side of the border is the
        # resolution of the element shares themselves.
        assert by_pixel == pytest.approx(by_element, abs=0.012)
        assert by_element > 0.01


@pytest.mark.parametrize("only", [0, 1, 2])
def test_a_state_without_elements_is_never_shown(only: int) -> None:
    """Margins that contradict the states: the picture follows the legend."""
    points, triangles = _sheet(4)
    m = len(triangles)
    wild = np.random.default_rng(1).normal(size=(2, m))
    frame = _frame(points, triangles, state=np.full(m, only, np.int8), taut_margin=wild[0], slack_margin=wild[1])
    code = _shade(frame, _camera(frame, 0.0, 90.0)).code
    assert set(np.unique(code)) == {raster.BACKGROUND, only}


# Wrinkle lines


def _lines(frame: Frame, camera: Camera) -> tuple[list[Floats], raster.Pixels]:
    pixels = _shade(frame, camera)
    zone = np.where(pixels.code % raster.BACK_FACE == 1, pixels.code + 1, 0).astype(np.int32)
    zone[pixels.code < 0] = 0
    lines = wrinkle_lines(zone, pixels.direction, pixels.nearness, spacing=9.0, longest=80.0, clearance=2, jump=0.1)
    return lines, pixels


def test_lines_stay_in_the_wrinkled_zone_and_run_along_the_wrinkles() -> None:
    frame = _cantilever()
    camera = _camera(frame, 20.0, -35.0, "perspective", size=(800, 500))
    lines, pixels = _lines(frame, camera)
    assert len(lines) > 15
    for line in lines:
        x, y = line.astype(int).T
        assert (pixels.code[y, x] == 1).all()
    # Circumferential on the tube means: the position along the axis hardly changes along a line.
    depth = camera.project(frame.points)
    for line in lines:
        ends = [int(np.argmin(np.hypot(*(depth[:, :2] - end).T) + 30.0 * depth[:, 2])) for end in (line[0], line[-1])]
        assert abs(frame.reference[ends[0], 0] - frame.reference[ends[1], 0]) < 0.14  # nearest nodes: pitch 0.044, bent


def test_lines_keep_their_distance() -> None:
    lines, _ = _lines(_cantilever(), _camera(_cantilever(), 20.0, -35.0, size=(800, 500)))
    for n, line in enumerate(lines):
        for other in lines[:n]:
            gap = np.hypot(*(line[:, None] - other[None]).transpose(2, 0, 1)).min()
            assert gap > 0.5 * 9.0 - 3.5  # half the spacing, less what a map of cells of 2 pixels loses


def test_lines_of_a_uniform_field_are_one_spacing_apart() -> None:
    zone = np.zeros((240, 300), np.int32)
    zone[20:220, 30:270] = 1
    direction = np.zeros((240, 300, 2), np.float32)
    direction[..., 0] = 1.0  # θ = 0
    lines = wrinkle_lines(
        zone, direction, np.zeros((240, 300), np.float32), spacing=20.0, longest=1000.0, clearance=3, jump=0.1
    )
    heights = np.sort([line[:, 1].mean() for line in lines])
    gaps = np.diff(heights)
    assert gaps.min() > 20.0 - 4.0  # cells of 2 pixels
    assert gaps.max() < 2.0 * 20.0  # and none is missing
    for line in lines:
        assert np.ptp(line[:, 1]) < 1e-9
        assert line[:, 0].min() == pytest.approx(33.0, abs=2.0)  # a step of 2 pixels
        assert line[:, 0].max() == pytest.approx(267.0, abs=2.0)


def test_direction_of_slack_elements_is_not_used() -> None:
    frame = _cantilever()
    camera = _camera(frame, 20.0, -35.0)
    wild = frame.wrinkle_direction.copy()
    wild[frame.state == 2] = (1.0, 0.0, 0.0)
    other = _shade(replace(frame, wrinkle_direction=wild), camera)
    assert (frame.state == 2).sum() > 50
    assert (other.direction == _shade(frame, camera).direction).all()


def test_drawn_glyphs_touch_only_wrinkled_pixels(tmp_path: Path) -> None:
    frame = _cantilever()
    camera = _camera(frame, 20.0, -35.0, size=(800, 500))
    with_lines = _image(frame, tmp_path / "a.png", Look(size=(800, 500)), camera)
    without = _image(frame, tmp_path / "b.png", Look(size=(800, 500), show_directions=False), camera)
    changed = (with_lines != without).any(axis=2)
    changed[:150, 550:] = False  # the legend's row
    assert changed.sum() > 500
    assert (_shade(frame, camera).code[changed] == 1).all()


# Whole pictures


def test_picture_has_size_legend_colours_and_no_temporary_file(tmp_path: Path) -> None:
    frame = replace(_cantilever(), title="Cantilever", subtitle="load step 3 of 9")
    pixels = _image(frame, tmp_path / "a.png", Look(size=(800, 500)), _camera(frame, size=(800, 500)))
    assert pixels.shape == (500, 800, 3)
    legend = pixels[:150, 560:]
    for colour in np.round(render.PALETTE * 255).astype(int):
        assert (
            np.abs(legend.astype(int) - colour).max(axis=2) <= 1
        ).sum() > 80  # a box of 19 x 10 pixels, less its edge
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    edge = np.concatenate((pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]))
    assert (edge == 255).all()  # nothing runs off the page


def test_surface_is_drawn_pixel_by_pixel_as_shaded(tmp_path: Path) -> None:
    frame = _cantilever()
    camera = _camera(frame, 20.0, -35.0)
    pixels = _shade(frame, camera)
    image = _image(frame, tmp_path / "a.png", Look(size=SIZE, show_directions=False), camera)
    surface = pixels.code >= 0
    assert surface.sum() > 5000
    assert (image[surface] == pixels.colour[surface]).all()


def test_same_frame_gives_the_same_bytes(tmp_path: Path) -> None:
    frame = replace(
        _cantilever(), supports=np.arange(48, dtype=np.int32), scalar=_cantilever().points[:, 2], scalar_label="z [m]",
        arrows=((np.array([4.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), "F = 1 N"),),
    )  # fmt: skip
    camera = _camera(frame, 30.0, 15.0, "perspective")
    for field in ("state", "scalar"):
        look = Look(field=field, size=SIZE, show_outline=True)  # type: ignore[arg-type]
        first = _image(frame, tmp_path / "a.png", look, camera)
        second = _image(frame, tmp_path / "b.png", look, camera)
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
        assert first.shape == second.shape


@pytest.mark.parametrize("per_node", [True, False])
def test_scalar_colours_follow_the_ramp(per_node: bool) -> None:
    """A flat sheet seen face on: the ramp's colours in their places, times one brightness."""
    points, triangles = _sheet(20)
    scalar = points[:, 0] if per_node else points[triangles].mean(axis=1)[:, 0]
    frame = _frame(points, triangles, scalar=scalar, scalar_label="x [m]")
    camera = _camera(frame, 0.0, 90.0)
    pixels = _shade(frame, camera, Look(field="scalar"))
    row = int(camera.principal[1])
    at = np.flatnonzero(pixels.code[row] == 0)[4:-4]  # clear of the silhouette's line
    x = (at + 0.5 - camera.principal[0]) / camera.pixels_per_length
    level = (x - scalar.min()) / np.ptp(scalar) * (len(render.RAMP) - 1)
    expected = np.column_stack([np.interp(level, np.arange(len(render.RAMP)), column) for column in render.RAMP.T])
    bright = np.linalg.norm(pixels.colour[row, at], axis=1) / np.linalg.norm(255.0 * expected, axis=1)
    assert bright.min() > 0.8
    assert bright.max() <= 1.005
    # One brightness everywhere on a flat sheet: 8-bit rounding is 1 of 60 on the darkest colour.
    assert pixels.colour[row, at] == pytest.approx(255.0 * expected * bright.mean(), abs=2.0)


def test_fixed_range_means_the_same_colour_in_every_frame() -> None:
    points, triangles = _sheet(4)
    look = Look(field="scalar", scalar_range=(0.0, 10.0))
    colours = []
    for others in (3.0, 9.0):
        scalar = np.full(len(points), 3.0)
        scalar[:5] = others
        frame = _frame(points, triangles, scalar=scalar)
        camera = _camera(frame, 0.0, 90.0)
        x, y = camera.project(points[-7:-6])[0, :2].astype(int)
        colours.append(_shade(frame, camera, look).colour[y, x])
    assert (colours[0] == colours[1]).all()


def test_hidden_supports_are_faint_and_loads_are_drawn(tmp_path: Path) -> None:
    frame = _cantilever()
    camera = _camera(frame, 40.0, 10.0)
    look = Look(size=SIZE, show_directions=False)
    plain = _image(frame, tmp_path / "a.png", look, camera)
    arrow = (np.array([4.0, 0.0, -0.6]), np.array([0.0, 0.0, -1.0]), "F")
    loaded = _image(replace(frame, arrows=(arrow,)), tmp_path / "b.png", look, camera)
    held = _image(replace(frame, supports=np.arange(48, dtype=np.int32)), tmp_path / "c.png", look, camera)
    assert (plain != loaded).any()
    assert (plain != held).any()
    end_on = (np.array([4.0, 0.0, 0.0]), camera.axes[2], "F")
    assert (plain != _image(replace(frame, arrows=(end_on,)), tmp_path / "d.png", look, camera)).any()


@pytest.mark.parametrize("count", [1, 90])
def test_label_of_loads_hits_neither_arrows_nor_other_text(count: int) -> None:
    """Loads on top of a tube whose upper edge is near the title."""
    camera = _camera(_cantilever())
    page = Page(np.full((SIZE[1], SIZE[0], 3), 255, np.uint8), camera)
    page.title("A title that is long enough to reach over", "and a subtitle")
    origins = [np.array([0.5 + 3.0 * k / count, 0.0, 0.5]) for k in range(count)]
    arrows = [(origin, np.array([0.0, 0.0, -1.0]), "F = 12 N") for origin in origins]
    draw_loads(page, arrows, np.zeros((SIZE[1], SIZE[0]), bool))
    boxes = page._taken
    assert len(boxes) >= 4  # title, subtitle, arrows, label; of arrows that would touch, some are left out
    assert not any(boxes[-1].overlaps(other) for other in boxes[:-1])
    assert boxes[-1].x0 >= 0
    assert boxes[-1].x1 <= SIZE[0]
    assert len(boxes) < 50


def test_outline_of_the_undeformed_shape_lies_on_its_silhouette() -> None:
    frame = _frame(*_sphere(64))
    camera = _camera(frame)
    lines = render._outline(frame, camera, raster.raster_of_size(*SIZE))
    assert len(lines) == 1
    distance = np.hypot(*(lines[0] - camera.principal).T)
    assert distance == pytest.approx(np.full(len(distance), camera.pixels_per_radius), abs=1.0)  # half-covered pixels


def test_same_kernels_serve_all_sizes_and_meshes(tmp_path: Path) -> None:
    """Another size or mesh must not compile again: a run has many frames."""
    frame = _cantilever()
    _image(frame, tmp_path / "a.png", Look(size=SIZE), _camera(frame))
    kernels = (raster._clear, raster._scatter, raster._count, raster._classify, raster._resolve)
    before = [len(kernel._primal.compiled_kernels) for kernel in kernels]
    other = _frame(*_sphere(9))
    _image(other, tmp_path / "b.png", Look(size=(320, 200)), _camera(other, size=(320, 200)))
    assert before == [len(kernel._primal.compiled_kernels) for kernel in kernels]
    assert min(before) == 1


# Animation


def _stills(folder: Path, sizes: list[tuple[int, int]]) -> list[Path]:
    paths = []
    for number, size in enumerate(sizes):
        paths.append(folder / f"{number}.png")
        Image.new("RGB", size, (40 * number, 90, 200)).save(paths[-1])
    return paths


def test_animation_has_all_frames_and_holds_the_last(tmp_path: Path) -> None:
    path = tmp_path / "run.gif"
    write_animation(_stills(tmp_path, [(1000, 500)] * 5), path, frame_seconds=0.2)
    with Image.open(path) as gif:
        assert gif.n_frames == 5  # type: ignore[attr-defined]
        assert gif.size == (800, 400)
        durations = []
        for number in range(5):
            gif.seek(number)
            durations.append(gif.info["duration"])
    assert durations[:4] == [200] * 4
    assert durations[4] > 3 * 200
    assert not list(tmp_path.glob(".*"))


def test_animation_keeps_small_pictures_and_equal_frames(tmp_path: Path) -> None:
    stills = _stills(tmp_path, [(300, 200)])
    write_animation(stills * 3, tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as gif:
        assert gif.size == (300, 200)


@pytest.mark.parametrize(
    ("sizes", "seconds", "message"),
    [
        ([], 0.2, "at least one"),
        ([(9, 9), (9, 8)], 0.2, "9 x 8 pixels, but .* 9 x 9"),
        ([(9, 9)], 0.0, "frame_seconds = 0.0"),
    ],
)
def test_impossible_animation_is_refused(
    tmp_path: Path, sizes: list[tuple[int, int]], seconds: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        write_animation(_stills(tmp_path, sizes), tmp_path / "run.gif", frame_seconds=seconds)
    assert not (tmp_path / "run.gif").exists()


def test_animation_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no picture")
    with pytest.raises(InputError, match=r"a\.png"):
        write_animation([tmp_path / "a.png"], tmp_path / "run.gif")


# Nonsense


def _nan_at(values: Floats, index: int) -> Floats:
    values = values.astype(np.float64)
    values[index] = np.nan
    return values


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (lambda f: {"points": _nan_at(f.points, 7)}, "points of node 7 is not finite"),
        (lambda f: {"reference": _nan_at(f.reference, 3)}, "reference of node 3"),
        (lambda f: {"taut_margin": _nan_at(f.taut_margin, 5)}, "taut_margin of element 5"),
        (lambda f: {"slack_margin": f.slack_margin[:-1]}, "slack_margin must have the shape"),
        (lambda f: {"triangles": f.triangles + 1}, "but there are 25 points"),
        (lambda f: {"triangles": f.triangles[:0]}, "triangles must have the shape"),
        (lambda f: {"state": np.full_like(f.state, 3)}, "allowed are 0 taut"),
        (lambda f: {"supports": (99,)}, "supports name nodes 99 to 99"),
        (lambda f: {"arrows": ((np.zeros(3), np.zeros(3), "F"),)}, "arrow 0"),
        (lambda f: {"scalar": None}, "has no scalar"),
        (lambda f: {"scalar": np.ones(4)}, "scalar must have the shape"),
        (lambda f: {"scalar": _nan_at(f.taut_margin, 2)}, "scalar of element 2"),
        (lambda f: {"title": r"$\frac{1$"}, "typeset"),
    ],
)
def test_nonsense_is_refused_and_leaves_no_file(tmp_path: Path, changes, message: str) -> None:  # type: ignore[no-untyped-def]
    frame = _frame(*_sheet(4), scalar=np.ones(25))
    camera = _camera(frame, 0.0, 40.0)
    with pytest.raises(ValueError, match=message):
        draw_frame(replace(frame, **changes(frame)), look=Look(field="scalar"), camera=camera, path=tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_range_upside_down_is_refused(tmp_path: Path) -> None:
    frame = _frame(*_sheet(2), scalar=np.ones(9))
    with pytest.raises(ValueError, match="low < high"):
        draw_frame(
            frame,
            look=Look(field="scalar", scalar_range=(1.0, 1.0)),
            camera=_camera(frame, 0.0, 40.0),
            path=tmp_path / "a.png",
        )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"projection": "fisheye"}, "perspective, orthographic"),
        ({"elevation": 91.0}, "elevation = 91.0"),
        ({"azimuth": np.nan}, "azimuth = nan"),
        ({"size": (20, 10)}, "size = 20 x 10"),
        ({"size": (90000, 900)}, "size = 90000 x 900"),
        ({"point_sets": []}, "no points"),
        ({"point_sets": [np.zeros((4, 3))]}, "one place"),
        ({"point_sets": [np.ones((4, 3)), np.array([[0, 0, 0], [0, np.inf, 0]])]}, "point set 1: node 1 is not finite"),
        ({"point_sets": [np.ones((4, 2))]}, r"shape \(n, 3\)"),
    ],
)
def test_impossible_camera_is_refused(changes: dict[str, object], message: str) -> None:
    view: dict[str, object] = {"azimuth": 0.0, "elevation": 0.0, "projection": "perspective", "size": SIZE}
    view["point_sets"] = [_sphere(4)[0]]
    view |= changes
    with pytest.raises(ValueError, match=message):
        fit_camera(view.pop("point_sets"), **view)  # type: ignore[arg-type]


def test_point_behind_the_viewer_is_refused() -> None:
    camera = _camera(_frame(*_sphere(8)), projection="perspective")
    with pytest.raises(ValueError, match="node 1 lies behind the viewer"):
        camera.project(np.array([[0.0, 0.0, 0.0], [0.0, -5.0, 0.0]]))


@pytest.mark.parametrize(
    "scalar", [np.zeros(25), np.full(25, 7e9), np.full(25, -1e-9), np.linspace(1.0, 1.0 + 1e-15, 25)]
)
def test_constant_scalar_and_collapsed_elements_are_drawn(tmp_path: Path, scalar: Floats) -> None:
    points, triangles = _sheet(4)
    points = points.copy()
    points[1] = points[0]  # two elements without area
    frame = _frame(points, triangles, scalar=scalar, scalar_label="constant")
    pixels = _image(frame, tmp_path / "a.png", Look(field="scalar", size=SIZE), _camera(frame, 0.0, 60.0))
    assert (pixels[120:130, 190:210] < 255).any()
