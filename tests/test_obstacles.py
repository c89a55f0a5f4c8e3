"""Obstacles: their distances against differences, contact against closed forms, what is said of it, and mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from bodies import closed_body
from scipy.optimize import brentq

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import read_result, resume, run
from taichi_membrane.mechanics.facets import Facets, distances
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

RNG = np.random.default_rng(3)
FRAME = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
FRAME *= np.linalg.det(FRAME)
ICOSAHEDRON = tuple(np.array(part) for part in oracle.icosahedron())
CENTRE = np.array([0.1, 0.2, 0.3])

OBSTACLES: dict[str, dict[str, Any]] = {
    "plane": {"kind": "plane"},
    "sphere": {"kind": "sphere", "size": (0.7,)},
    "pipe": {"kind": "cylinder", "size": (0.7,), "hollow": True},
    "cylinder": {"kind": "cylinder", "size": (0.7,)},
    "drum": {"kind": "drum", "size": (0.7, 0.6), "rounding": 0.2},
    "box": {"kind": "box", "size": (0.7, 0.5, 0.6), "rounding": 0.2},
    "surface": {"kind": "surface", "facets": Facets(0.6 * ICOSAHEDRON[0], ICOSAHEDRON[1])},
    "shell": {"kind": "surface", "facets": Facets(2.0 * ICOSAHEDRON[0], ICOSAHEDRON[1]), "hollow": True, "offset": 0.1},
}


def pressed(name: str) -> System:
    """A closed body whose nodes are all pushed by an obstacle."""
    one = Obstacle(name=name, nodes=np.arange(12), centre=CENTRE, frame=FRAME, **OBSTACLES[name])
    system = System(closed_body(obstacles=(one,)))
    system.contacts[0].set(np.full(12, 3.0), np.full(12, 20.0))
    system.set_displacement(np.random.default_rng(4).normal(size=(12, 3)) * 0.1)
    return system


@pytest.mark.parametrize("name", OBSTACLES)
def test_gradient_and_curvature_of_the_gap_are_those_of_differences(name: str) -> None:
    """Forces against energies, the tangent against forces, and gaps against the normals, along random directions."""
    system = pressed(name)
    tangent, rng, h = Tangent(system), np.random.default_rng(5), 1e-6
    place = system.displacement()
    force, matrix, now = system.out_of_balance(), tangent.matrix(), system.touching()
    assert now.active.all()
    none = np.zeros_like(place)
    for _ in range(4):
        way = rng.normal(size=place.shape)
        seen = []
        for sign in (1.0, -1.0):
            system.set_displacement(place + sign * h * way)
            seen.append((system.potential_energy(none)[0], system.out_of_balance(), system.touching().gap[0]))
        (up, more, far), (down, less, near) = seen
        size = np.linalg.norm(force) * np.linalg.norm(way)
        assert -(up - down) / (2 * h) == pytest.approx(np.vdot(force, way), abs=1e-7 * size)
        answer = -(more - less) / (2 * h)
        product = (matrix @ way.ravel()).reshape(-1, 3)
        assert np.abs(answer - product).max() < 1e-7 * np.abs(product).max()
        assert (far - near) / (2 * h) == pytest.approx(np.einsum("ij,ij->i", now.normal[0], way), abs=1e-7)


def test_hollow_obstacles_stiffen_no_more_than_masses_bound() -> None:
    """The highest eigenvalue of M⁻¹K is at most 4, with the push inside a pipe in K."""
    system = pressed("pipe")
    mass = Relaxation(system).masses()
    matrix = Tangent(system).matrix().toarray() / np.repeat(mass, 3)[:, None]
    assert np.linalg.eigvals(matrix).real.max() <= 4.0


def test_the_nearest_facet_is_that_of_a_search_over_all() -> None:
    """Of a bumpy closed surface, within and without; and the side is that of the winding number."""
    points, triangles = ICOSAHEDRON
    facets = Facets(points * [1.0, 0.5, 0.3], triangles)
    one = Obstacle(name="bump", kind="surface", nodes=np.arange(12), centre=CENTRE, facets=facets)
    system, rng = System(closed_body(obstacles=(one,))), np.random.default_rng(8)
    for _ in range(20):
        places = rng.uniform(-1.0, 1.0, (12, 3)) * [1.1, 0.6, 0.4]
        system.set_displacement(places - system.structure.points)
        gap = system.touching().gap[0]
        every = distances(np.repeat(places, 20, axis=0), np.tile(facets.corners, (12, 1, 1))).reshape(12, 20)
        a, b, c = np.moveaxis(facets.corners[None] - places[:, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(one, axis=-1) for one in (a, b, c))
        volume = np.einsum("nti,nti->nt", a, np.cross(b, c))
        dots = [np.einsum("nti,nti->nt", *pair) for pair in ((a, b), (b, c), (c, a))]
        solid = 2.0 * np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
        inside = np.abs(solid.sum(axis=1)) > 2.0 * np.pi
        assert gap == pytest.approx(np.where(inside, -1.0, 1.0) * every.min(axis=1), abs=1e-12)


RADIUS = 0.3


def film(rings: int, **changes: Any) -> Scene:
    """A taut disc of radius 1, under a tension of 1 that hardly changes, pressed by a sphere."""
    return Scene.model_validate(
        {
            "name": "film",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "disc", "radius": 1.0, "rings": rings},
            "fabric": {"E": 1e-2, "nu": 0.0, "thickness": 1.0, "law": "none", "prestress": [1.0, 1.0, 0.0], "side_strain": "green"},
            "supports": [{"group": "rim", "hold": "xyz"}],
            "pressures": {},
            "obstacles": {
                "ball": {"kind": "sphere", "centre": [0, 0, RADIUS], "radius": RADIUS, "direction": [0, 0, -1]}
            },
            "stages": [{"name": "press", "obstacles": {"ball": 0.2}, "steps": 2}],
            "probes": {
                "force": {"kind": "contact", "obstacle": "ball", "component": "z"},
                "area": {"kind": "contact", "obstacle": "ball", "of": "area"},
                "depth": {"kind": "factor", "of": "obstacle.ball"},
            },
            "solver": {"tolerance": 1e-8},
            **changes,
        }
    )  # fmt: skip


def node_area(result: Any, nodes: Any) -> float:
    """A third of the area of the deformed elements around some nodes."""
    places = (result.mesh.points + result.steps[-1].displacement)[result.mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]), axis=1)
    return float((area * nodes[result.mesh.triangles].sum(axis=1)).sum() / 3.0)


def film_force(depth: float) -> float:
    """A catenoid of neck c that touches the sphere at the angle θ from its pole: F = 2π c, c = R sin² θ by balance there."""

    def deeper(angle: float) -> float:
        c = RADIUS * np.sin(angle) ** 2
        return float(RADIUS * (1 - np.cos(angle)) + c * (np.arccosh(1 / c) - np.arccosh(1 / np.sin(angle))) - depth)

    return float(2 * np.pi * RADIUS * np.sin(brentq(deeper, 1e-4, 1.5)) ** 2)


def test_a_film_pressed_by_a_sphere() -> None:
    """Force within 1 %, falling error; all forces cancel; no node within the sphere; the step is stable, and verified where the
    nodes in contact stay the same."""
    errors, pressures = [], []
    for rings in (8, 16, 32):
        result = run(film(rings))
        assert result.converged, result.steps[-1].reason
        step = result.steps[-1]
        errors.append(abs(-step.probes["force"] / film_force(0.2) - 1.0))
        places = result.mesh.points + step.displacement - [0, 0, RADIUS - 0.2]
        assert np.linalg.norm(places, axis=1).min() > RADIUS - 1e-6
        assert step.stable
        assert step.imbalance < 1e-9
        assert step.balance["contact"][2] == pytest.approx(-step.balance["reactions"][2], rel=1e-9)
        pressure = step.fields["contact_pressure"]
        assert step.probes["area"] == pytest.approx(node_area(result, pressure > 0.0))
        pole = int(np.linalg.norm(result.mesh.points, axis=1).argmin())
        pressures.append(pressure[pole] / (2.0 / RADIUS) - 1.0)  # two curvatures under a tension of 1
    assert errors[2] < 0.01
    assert errors[2] < 0.5 * errors[0]
    assert abs(pressures[2]) < 0.005
    near = run(film(6, stages=[{"name": "press", "obstacles": {"ball": 0.12}, "steps": 4}])).steps
    assert {"contact", "load control"} <= {one.event for step in near for one in step.trace}


def test_relaxation_finds_the_same_contact() -> None:
    newton = run(film(8)).steps[-1]
    relaxed = run(film(8, solver={"kind": "relaxation", "tolerance": 1e-8})).steps[-1]
    assert relaxed.converged, relaxed.reason
    assert relaxed.probes["force"] == pytest.approx(newton.probes["force"], rel=1e-5)
    assert relaxed.stable is None


LENGTH = 0.1


def round_tube(around: int) -> Mesh:
    """A strip of a tube of radius 1 along x."""
    turn = 2 * np.pi * np.arange(around) / around
    section = np.column_stack([np.sin(turn), -np.cos(turn)])
    points = np.concatenate([np.column_stack([np.full(around, x), section]) for x in (0.0, LENGTH)])
    here, n = np.arange(around), around
    after = (here + 1) % n
    halves = [np.column_stack([here, after, n + here]), np.column_stack([after, n + after, n + here])]
    groups = {name: np.flatnonzero(np.abs(points[:, c]) < 1e-9) for name, c in (("middle", 1), ("equator", 2))}
    return Mesh.build(points, np.stack(halves, axis=1).reshape(-1, 3), groups)


def plates(stiffness: float, heights: list[float], steps: int = 2) -> Scene:
    """A tube under a pressure of 1 that plates press to some heights."""
    return Scene.model_validate(
        {
            "name": "plates",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": stiffness, "nu": 0.0, "thickness": 1.0, "law": "none", "side_strain": "engineering"},
            "supports": [
                {"group": "all", "hold": "x"}, {"group": "middle", "hold": "y"}, {"group": "equator", "hold": "z"},
            ],
            "obstacles": {
                "lid": {"kind": "plane", "through": [0, 0, 1], "normal": [0, 0, -1], "direction": [0, 0, -1]},
                "floor": {"kind": "plane", "through": [0, 0, -1], "normal": [0, 0, 1], "direction": [0, 0, 1]},
            },
            "stages": [
                {"name": "blow", "pressure": 1.0},
                *(
                    {"name": f"to_{k}", "obstacles": dict.fromkeys(("lid", "floor"), 1 - height / 2), "steps": steps}
                    for k, height in enumerate(heights)
                ),
            ],
            "probes": {
                "force": {"kind": "contact", "obstacle": "lid", "component": "z"},
                "area": {"kind": "contact", "obstacle": "lid", "of": "area"},
            },
        }
    )  # fmt: skip


@pytest.mark.parametrize(
    ("stiffness", "widths", "bound"),
    [
        (1e4, [0.157080, 0.785398, 1.570796, 2.356194], 0.003),
        (20.0, [0.306305, 0.903208, 1.649336, 2.395464], 0.006),
    ],
)
def test_a_round_tube_pressed_by_plates_that_come_nearer(stiffness: float, widths: list[float], bound: float) -> None:
    """F = p b per length of the stadium at heights of 1.9, 1.5, 1, 0.5 radii: all of the wall slides along the plates. Stable
    throughout; the pressure under the plates is that of the gas; the forces cancel."""
    result = run(plates(stiffness, [1.9, 1.5, 1.0, 0.5]), mesh=round_tube(128))
    assert result.converged, result.steps[-1].reason
    for number, width in enumerate(widths):
        step = next(one for one in result.steps if one.stage == f"to_{number}" and one.stage_step == 2)
        assert -step.probes["force"] / LENGTH == pytest.approx(width, rel=bound)
        assert step.probes["area"] / LENGTH == pytest.approx(
            width, abs=2 * 2 * np.pi / 128
        )  # the nodes at its two ends too
        inner = step.fields["contact_pressure"] > 0.0
        assert np.median(step.fields["contact_pressure"][inner]) == pytest.approx(1.0, rel=1e-3)
        assert step.stable
        assert step.imbalance < 1e-6
        assert set(step.balance) == {"loads", "surface", "reactions", "contact"}


def test_a_flat_surface_of_triangles_is_a_plane() -> None:
    """The same state to round-off, edges and corners of its triangles or not."""
    grid = np.linspace(-1.5, 1.5, 8)
    points = [[x, y, 0.1] for y in grid for x in grid]
    cells = [(k, k + 1, k + 8, k + 9) for k in range(55) if k % 8 < 7]
    triangles = [corner for a, b, c, d in cells for corner in ([a, c, b], [b, c, d])]
    lid = {"kind": "surface", "points": points, "triangles": triangles, "face": "front"}
    plane = {"kind": "plane", "through": [0, 0, 0.1], "normal": [0, 0, -1]}
    found = []
    for obstacle in (lid, plane):
        changes = {"pressures": {"gas": {}}, "stages": [{"name": "blow", "pressure": 1.0, "steps": 2}], "probes": {}}
        found.append(run(film(6, obstacles={"lid": obstacle}, **changes)).steps[-1])
    assert all(step.converged for step in found)
    assert np.abs(found[0].displacement - found[1].displacement).max() < 1e-12
    assert found[0].contact_forces["lid"] == pytest.approx(found[1].contact_forces["lid"], rel=1e-10)
    assert found[1].contact_forces["lid"] > 0.5


@pytest.mark.parametrize("kind", ["box", "drum", "room", "surface"])
def test_other_obstacles_hold_a_film_up(kind: str) -> None:
    """A sheet blown against each: no node beyond it, forces cancel, stable."""
    common = {"centre": [0.1, 0.05, 0.6]}
    one = {
        "box": {"kind": "box", "size": [0.8, 0.6, 1.0], "axis_x": [1, 1, 0], **common},
        "drum": {"kind": "cylinder", "radius": 0.4, "length": 1.0, "axis": [0, 0, 1], **common},
        "room": {"kind": "box", "size": [2.1, 2.1, 0.2], "centre": [0, 0, 0], "inside": True},
        "surface": {"kind": "surface", "points": (0.5 * ICOSAHEDRON[0] + [0.1, 0, 0.6]).tolist(), "offset": 0.02,
                    "triangles": ICOSAHEDRON[1].tolist()},
    }[kind]  # fmt: skip
    changes = {"pressures": {"gas": {}}, "stages": [{"name": "blow", "pressure": 1.5, "steps": 3}], "probes": {}}
    scene = film(10, obstacles={"it": one}, **changes)
    result = run(scene)
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    assert step.contact_forces["it"] > 0.1
    assert step.imbalance < 1e-6
    assert step.stable
    system = System(build_model(scene, build_mesh(scene)).structure)
    system.set_displacement(step.displacement)
    assert system.touching().gap.min() > -2.9e-6  # a millionth of the size, at most


def test_a_run_with_obstacles_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    """To the last bit, and what is read is what was found; a surface of a file is kept with the run."""
    scene = film(5, stages=[{"name": "press", "obstacles": {"ball": 0.2}, "steps": 3}])

    class Stop(Exception):
        pass

    from taichi_membrane.execution.observer import Observer

    class Once(Observer):
        def step_done(self, step: Any) -> None:
            if step.number == 1:
                raise Stop

    whole = run(scene, out=tmp_path / "whole", render=False)
    with pytest.raises(Stop):
        run(scene, out=tmp_path / "part", render=False, observer=Once())
    rest = resume(tmp_path / "part", render=False)
    for one, other in zip(whole.steps, rest.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement)
        assert one.contact_forces == other.contact_forces
        assert one.balance == other.balance
    read = read_result(tmp_path / "whole")
    assert read.steps[-1].imbalance == whole.steps[-1].imbalance
    assert np.array_equal(read.steps[-1].fields["contact_force"], whole.steps[-1].fields["contact_force"])


def test_a_surface_comes_from_a_file(tmp_path: Path) -> None:
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in (0.5 * ICOSAHEDRON[0] + [0, 0, 0.6]))
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in ICOSAHEDRON[1] + 1)
    (tmp_path / "rock.obj").write_text(corners + faces)
    scene = film(4, obstacles={"rock": {"kind": "surface", "path": "rock.obj", "direction": [0, 0, -1]}}, probes={},
                 stages=[{"name": "press", "obstacles": {"rock": 0.2}}])  # fmt: skip
    result = run(scene, base=tmp_path)
    assert result.converged
    assert result.steps[-1].contact_forces["rock"] > 0.0
    kept = result.scene.obstacles["rock"]
    assert (kept.path, len(kept.triangles)) == (None, 20)  # type: ignore[union-attr]


BALL = {"kind": "sphere", "centre": [0, 0, 1], "radius": 1.0}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"obstacles": {"ball": {**BALL, "radius": 0.0}}}, "radius"),
        ({"obstacles": {"ball": {**BALL, "group": "sky"}}, "stages": [{"name": "s"}], "probes": {}}, r"obstacles\.ball\.group"),
        ({"obstacles": {"ball": BALL}, "probes": {}}, r"stages\.press\.obstacles: 'ball' is not a obstacle"),
        ({"obstacles": {"b": {"kind": "box", "centre": [0, 0, 0], "size": [1, 1, 1], "axis_x": [1, 0, 1]}}}, "45 degrees, not 90"),
        ({"obstacles": {"b": {"kind": "box", "centre": [0, 0, 0], "size": [1, 1, 1], "rounding": 0.6}}}, "half the shortest"),
        ({"obstacles": {"s": {"kind": "surface"}}}, "give path, or both points and triangles"),
        (
            {"obstacles": {"s": {"kind": "surface", "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 3]]}}},
            "number 0 names point 3, but there are 3",
        ),
        (
            {"obstacles": {"s": {"kind": "surface", "points": [[0, 0, 0], [1, 0, 0], [2, 0, 0]], "triangles": [[0, 1, 2]]}},
             "stages": [{"name": "s"}], "probes": {}},
            r"obstacles\.s\.triangles: number 0 has no area",
        ),
        ({"planes": {"ball": {"through": [0, 0, 1], "normal": [0, 0, -1]}}}, "planes.ball has the name already"),
        ({"probes": {"f": {"kind": "contact", "obstacle": "bal"}}}, r"probes\.f\.obstacle: 'bal' is not .*allowed: ball"),
        ({"stages": [{"name": "s", "control": "arc_length"}]}, "is not implemented for a scene with obstacles"),
        ({"stages": [{"name": "s", "until": "collapse"}]}, "until = 'collapse' is not implemented for a scene with obstacles"),
        ({"stages": [{"name": "s", "until": "collapse_or_target"}]}, "is not implemented for a scene with obstacles"),
        ({"modes": {"kind": "buckling"}}, "modes is not implemented for a scene with obstacles"),
        ({"derivatives": ["depth"]}, "derivative"),
    ],
)  # fmt: skip
def test_mistakes_are_told(changes: dict[str, Any], told: str) -> None:
    def read() -> None:
        scene = film(3, **changes)
        build_model(scene, build_mesh(scene))

    with pytest.raises((InputError, ValueError), match=told):
        read()


def test_without_obstacles_nothing_is_compiled() -> None:
    scene = film(3, obstacles={}, stages=[{"name": "s"}], probes={})
    structure = build_model(scene, build_mesh(scene)).structure
    names = {name for name, _ in System(structure).fields()}
    assert not any(
        name.startswith(("node_contact", "node_arm", "obstacle_", "plane_", "facet_", "cell_")) for name in names
    )
    assert "contact with obstacles" in structure.features().describe()[1]
