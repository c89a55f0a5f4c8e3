"""Pictures: geometry against formulas, categories against element areas, nothing hidden or invented, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_cases import (
    SIZE,
    Floats,
    camera_on,
    cantilever,
    coverage,
    frame_of,
    frame_with_states,
    image_of,
    shaded,
    sheet_mesh,
    sphere_mesh,
    tube_mesh,
)

from taichi_membrane.pictures import raster, render
from taichi_membrane.pictures.camera import VIEWER_DISTANCE, Projection
from taichi_membrane.pictures.furniture import Page
from taichi_membrane.pictures.render import Look, draw_frame, fit_camera
from taichi_membrane.pictures.symbols import draw_loads

pytestmark = pytest.mark.usefixtures("runtime_cpu")


# Coverage


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_sphere_covers_the_area_of_its_silhouette(projection: Projection, radius: float) -> None:
    """Seen from d radii, a sphere looks as large as a disc of radius d / √(d² - 1) at its centre's depth."""
    frame = frame_of(*sphere_mesh(96, radius))
    camera = camera_on(frame, 20.0, 35.0, projection)
    seen = camera.pixels_per_radius
    if projection == "perspective":
        seen *= VIEWER_DISTANCE / np.sqrt(VIEWER_DISTANCE**2 - 1.0)
    # The inscribed polygon of 96 sides lacks 0.07 % of the area; samples add less than 0.05 %.
    assert coverage(frame, camera).sum() == pytest.approx(np.pi * seen**2, rel=1.5e-3)


# Visible surface


def test_nearer_surface_hides_the_farther() -> None:
    """Wrinkled sheet below, taut sheet above: from above only taut is seen, from below only wrinkled backs."""
    low, triangles = sheet_mesh(3, height=-0.5)
    points = np.concatenate((low, sheet_mesh(3, height=0.5)[0]))
    both = np.concatenate((triangles, triangles + len(low))).astype(np.int32)
    taut = np.repeat((-1.0, 1.0), len(triangles))
    frame = frame_with_states(points, both, taut, np.ones(len(both)))
    for projection in ("orthographic", "perspective"):
        above = shaded(frame, camera_on(frame, 0.0, 90.0, projection)).code  # type: ignore[arg-type]
        below = shaded(frame, camera_on(frame, 0.0, -90.0, projection)).code  # type: ignore[arg-type]
        assert set(np.unique(below)) == {raster.BACKGROUND, 1 + raster.BACK_FACE}
        # In perspective the nearer sheet looks larger and covers the other completely.
        assert set(np.unique(above)) == {raster.BACKGROUND, 0}


def test_of_two_coincident_sheets_the_outer_one_is_seen() -> None:
    """A flat cushion before inflation: without a rule rounding would mix both sheets."""
    points, triangles = sheet_mesh(7)
    closed = np.concatenate((triangles, triangles[:, ::-1])).astype(np.int32)
    frame = frame_of(points, closed)
    for elevation in (90.0, 33.0, -20.0):
        code = shaded(frame, camera_on(frame, 17.0, elevation, "perspective")).code
        assert set(np.unique(code)) == {raster.BACKGROUND, 0}


def test_inside_of_an_open_tube_is_darker_and_cooler() -> None:
    frame = frame_of(*tube_mesh())
    pixels = shaded(frame, camera_on(frame, -55.0, 10.0, "perspective"))
    inside, outside = pixels.colour[pixels.code == raster.BACK_FACE], pixels.colour[pixels.code == 0]
    assert len(inside) > 200
    assert inside.mean() < 0.8 * outside.mean()
    red, _, blue = inside.astype(float).mean(axis=0)
    assert blue / red > 1.02


def test_neighbouring_triangles_leave_no_cracks() -> None:
    frame = frame_of(*sphere_mesh(64))
    cover = coverage(frame, camera_on(frame, 11.0, 23.0, "perspective"))
    rows = [np.flatnonzero(row == 1.0) for row in cover]
    assert all((np.diff(row) == 1).all() for row in rows if len(row) > 1)


# Categories


@pytest.mark.parametrize("angle", [0.0, 23.0, 33.0, 45.0, 71.0])
def test_border_between_two_half_planes_is_straight_on_a_coarse_mesh(angle: float) -> None:
    points, triangles = sheet_mesh(9)
    normal = np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle))))
    centroid = points[triangles].mean(axis=1)[:, :2]
    frame = frame_with_states(points, triangles, centroid @ normal - 0.04, np.ones(len(triangles)))
    camera = camera_on(frame, 0.0, 90.0)
    code = shaded(frame, camera).code
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
    frame = cantilever()
    camera = camera_on(frame, 10.0, elevation, size=(800, 500))
    code = shaded(frame, camera).code
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
    points, triangles = sheet_mesh(4)
    m = len(triangles)
    wild = np.random.default_rng(1).normal(size=(2, m))
    frame = frame_of(points, triangles, state=np.full(m, only, np.int8), taut_margin=wild[0], slack_margin=wild[1])
    code = shaded(frame, camera_on(frame, 0.0, 90.0)).code
    assert set(np.unique(code)) == {raster.BACKGROUND, only}


# Whole pictures


def test_picture_has_size_legend_colours_and_no_temporary_file(tmp_path: Path) -> None:
    frame = replace(cantilever(), title="Cantilever", subtitle="load step 3 of 9")
    pixels = image_of(frame, tmp_path / "a.png", Look(size=(800, 500)), camera_on(frame, size=(800, 500)))
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
    frame = cantilever()
    camera = camera_on(frame, 20.0, -35.0)
    pixels = shaded(frame, camera)
    image = image_of(frame, tmp_path / "a.png", Look(size=SIZE, show_directions=False), camera)
    surface = pixels.code >= 0
    assert surface.sum() > 5000
    assert (image[surface] == pixels.colour[surface]).all()


def test_same_frame_gives_the_same_bytes(tmp_path: Path) -> None:
    frame = replace(
        cantilever(), supports=np.arange(48, dtype=np.int32), scalar=cantilever().points[:, 2], scalar_label="z [m]",
        arrows=((np.array([4.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), "F = 1 N"),),
    )  # fmt: skip
    camera = camera_on(frame, 30.0, 15.0, "perspective")
    for field in ("state", "scalar"):
        look = Look(field=field, size=SIZE, show_outline=True)  # type: ignore[arg-type]
        first = image_of(frame, tmp_path / "a.png", look, camera)
        second = image_of(frame, tmp_path / "b.png", look, camera)
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
        assert first.shape == second.shape


@pytest.mark.parametrize("per_node", [True, False])
def test_scalar_colours_follow_the_ramp(per_node: bool) -> None:
    """A flat sheet seen face on: the ramp's colours in their places, times one brightness."""
    points, triangles = sheet_mesh(20)
    scalar = points[:, 0] if per_node else points[triangles].mean(axis=1)[:, 0]
    frame = frame_of(points, triangles, scalar=scalar, scalar_label="x [m]")
    camera = camera_on(frame, 0.0, 90.0)
    pixels = shaded(frame, camera, Look(field="scalar"))
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
    points, triangles = sheet_mesh(4)
    look = Look(field="scalar", scalar_range=(0.0, 10.0))
    colours = []
    for others in (3.0, 9.0):
        scalar = np.full(len(points), 3.0)
        scalar[:5] = others
        frame = frame_of(points, triangles, scalar=scalar)
        camera = camera_on(frame, 0.0, 90.0)
        x, y = camera.project(points[-7:-6])[0, :2].astype(int)
        colours.append(shaded(frame, camera, look).colour[y, x])
    assert (colours[0] == colours[1]).all()


def test_hidden_supports_are_faint_and_loads_are_drawn(tmp_path: Path) -> None:
    frame = cantilever()
    camera = camera_on(frame, 40.0, 10.0)
    look = Look(size=SIZE, show_directions=False)
    plain = image_of(frame, tmp_path / "a.png", look, camera)
    arrow = (np.array([4.0, 0.0, -0.6]), np.array([0.0, 0.0, -1.0]), "F")
    loaded = image_of(replace(frame, arrows=(arrow,)), tmp_path / "b.png", look, camera)
    held = image_of(replace(frame, supports=np.arange(48, dtype=np.int32)), tmp_path / "c.png", look, camera)
    assert (plain != loaded).any()
    assert (plain != held).any()
    end_on = (np.array([4.0, 0.0, 0.0]), camera.axes[2], "F")
    assert (plain != image_of(replace(frame, arrows=(end_on,)), tmp_path / "d.png", look, camera)).any()


@pytest.mark.parametrize("count", [1, 90])
def test_label_of_loads_hits_neither_arrows_nor_other_text(count: int) -> None:
    """Loads on top of a tube whose upper edge is near the title."""
    camera = camera_on(cantilever())
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
    frame = frame_of(*sphere_mesh(64))
    camera = camera_on(frame)
    look = Look(size=SIZE, show_outline=True)
    lines = render.undeformed_outline(frame, look=look, camera=camera)
    assert not render.undeformed_outline(frame, look=replace(look, show_outline=False), camera=camera)
    assert len(lines) == 1
    distance = np.hypot(*(lines[0] - camera.principal).T)
    assert distance == pytest.approx(np.full(len(distance), camera.pixels_per_radius), abs=1.0)  # half-covered pixels


def test_same_kernels_serve_all_sizes_and_meshes(tmp_path: Path) -> None:
    """Another size or mesh must not compile again: a run has many frames."""
    frame = cantilever()
    image_of(frame, tmp_path / "a.png", Look(size=SIZE), camera_on(frame))
    kernels = (raster._clear, raster._scatter, raster._count, raster._classify, raster._resolve)
    before = [len(kernel._primal.compiled_kernels) for kernel in kernels]
    other = frame_of(*sphere_mesh(9))
    image_of(other, tmp_path / "b.png", Look(size=(320, 200)), camera_on(other, size=(320, 200)))
    assert before == [len(kernel._primal.compiled_kernels) for kernel in kernels]
    assert min(before) == 1


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
    frame = frame_of(*sheet_mesh(4), scalar=np.ones(25))
    camera = camera_on(frame, 0.0, 40.0)
    with pytest.raises(ValueError, match=message):
        draw_frame(replace(frame, **changes(frame)), look=Look(field="scalar"), camera=camera, path=tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_range_upside_down_is_refused(tmp_path: Path) -> None:
    frame = frame_of(*sheet_mesh(2), scalar=np.ones(9))
    with pytest.raises(ValueError, match="low < high"):
        draw_frame(
            frame,
            look=Look(field="scalar", scalar_range=(1.0, 1.0)),
            camera=camera_on(frame, 0.0, 40.0),
            path=tmp_path / "a.png",
        )


@pytest.mark.parametrize(
    "scalar", [np.zeros(25), np.full(25, 7e9), np.full(25, -1e-9), np.linspace(1.0, 1.0 + 1e-15, 25)]
)
def test_constant_scalar_and_collapsed_elements_are_drawn(tmp_path: Path, scalar: Floats) -> None:
    points, triangles = sheet_mesh(4)
    points = points.copy()
    points[1] = points[0]  # two elements without area
    frame = frame_of(points, triangles, scalar=scalar, scalar_label="constant")
    pixels = image_of(frame, tmp_path / "a.png", Look(field="scalar", size=SIZE), camera_on(frame, 0.0, 60.0))
    assert (pixels[120:130, 190:210] < 255).any()
