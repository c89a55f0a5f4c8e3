"""Walls that touch each other: forces against energies, two tubes against one on a plane, and what is told and refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import closed_body

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import resume, run
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mechanics.wall_crossing import crossings, passed
from taichi_membrane.mechanics.wall_search import Found, Walls, closest, couples
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation import probes
from taichi_membrane.simulation.model import build_model
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def touching() -> System:
    """A closed body with pairs that touch, and some that do not."""
    mesh = closed_body().mesh
    system = System(closed_body(walls=Walls(mesh, np.arange(mesh.tri_count))))
    rng = np.random.default_rng(2)
    node, tri = np.arange(8), np.zeros(8, dtype=np.int64)
    for k in node:
        tri[k] = next(t for t in rng.permutation(mesh.tri_count) if k not in mesh.triangles[t])
    share, normal = rng.dirichlet(np.ones(3), 8), rng.normal(size=(8, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = Found(node, np.zeros(8, dtype=np.int64), tri, share, normal, np.zeros(8), np.zeros(8))
    assert system.walls is not None
    system.walls.set(found, np.full(8, 3.0), np.zeros(8))
    system.set_displacement(rng.normal(size=(mesh.node_count, 3)) * 0.1)
    return system


def test_forces_are_those_of_a_potential_and_the_tangent_is_theirs() -> None:
    """By differences, with the pattern that contact needs; all contact forces cancel; masses bound the stiffness."""
    system = touching()
    term = system.walls
    assert term is not None
    tangent, rng, h = Tangent(system), np.random.default_rng(5), 1e-6
    tangent.couple(np.unique(couples(term.walls, term.found), axis=0))
    place = system.displacement()
    none = np.zeros_like(place)
    force, matrix, push = system.out_of_balance(), tangent.matrix(), term.pushes()
    assert 0 < (push > 0.0).sum() < 8
    assert np.abs(term.forces().sum(axis=0)).max() < 1e-12 * push.sum()
    for _ in range(4):
        way = rng.normal(size=place.shape)
        seen = []
        for sign in (1.0, -1.0):
            system.set_displacement(place + sign * h * way)
            seen.append((system.potential_energy(none)[0], system.out_of_balance()))
        (up, more), (down, less) = seen
        size = np.linalg.norm(force) * np.linalg.norm(way)
        assert -(up - down) / (2 * h) == pytest.approx(np.vdot(force, way), abs=1e-7 * size)
        product = (matrix @ way.ravel()).reshape(-1, 3)
        assert np.abs(-(more - less) / (2 * h) - product).max() < 1e-7 * np.abs(product).max()
    system.set_displacement(place)
    mass = Relaxation(system).masses()
    assert np.linalg.eigvals(matrix.toarray() / np.repeat(mass, 3)[:, None]).real.max() <= 4.0


def test_the_nearest_point_of_a_triangle() -> None:
    """By the least distance over many points of it."""
    rng = np.random.default_rng(1)
    points, corners = rng.normal(size=(50, 3)), rng.normal(size=(50, 3, 3))
    share, distance = closest(points, corners)
    grid = np.array([(a, b, 60 - a - b) for a in range(61) for b in range(61 - a)]) / 60
    every = np.linalg.norm(points[:, None] - np.einsum("gk,nki->ngi", grid, corners), axis=2).min(axis=1)
    there = np.linalg.norm(points - np.einsum("nk,nki->ni", share, corners), axis=1)
    assert there == pytest.approx(distance, abs=1e-12)
    assert (distance <= every + 1e-12).all()
    assert distance == pytest.approx(every, abs=0.1)
    assert share.sum(axis=1) == pytest.approx(1.0)
    assert share.min() >= 0.0


LENGTH = 0.1


def tube(around: int, height: float) -> tuple[Any, Any]:
    """Points and triangles of a strip of a tube of radius 1 along x, its middle at a height."""
    turn = 2 * np.pi * np.arange(around) / around
    section = np.column_stack([np.sin(turn), height - np.cos(turn)])
    points = np.concatenate([np.column_stack([np.full(around, x), section]) for x in (0.0, LENGTH)])
    here, n = np.arange(around), around
    after = (here + 1) % n
    halves = [np.column_stack([here, after, n + here]), np.column_stack([after, n + after, n + here])]
    return points, np.stack(halves, axis=1).reshape(-1, 3)


def mesh_of(around: int, *, both: bool) -> Mesh:
    """One tube above z = 0, or its mirror image too."""
    points, triangles = tube(around, 1.05)
    groups: dict[str, Any] = {"middle": np.flatnonzero(np.abs(points[:, 1]) < 1e-9)}
    count = len(points)
    if not both:
        return Mesh.build(points, triangles, {**groups, "upper": np.arange(count)})
    points = np.concatenate([points, points * [1, 1, -1]])
    triangles = np.concatenate([triangles, count + triangles[:, ::-1]])
    groups["middle"] = np.concatenate([groups["middle"], count + groups["middle"]])
    return Mesh.build(points, triangles, {**groups, "upper": np.arange(count), "lower": np.arange(count, 2 * count)})


def pressed(*, both: bool, **changes: Any) -> Scene:
    """Tubes under a pressure of 1 that plates press onto each other, or one onto a plane."""
    plates = {"lid": {"kind": "plane", "through": [0, 0, 2.1], "normal": [0, 0, -1], "direction": [0, 0, -1]}}
    if both:
        plates["floor"] = {"kind": "plane", "through": [0, 0, -2.1], "normal": [0, 0, 1], "direction": [0, 0, 1]}
    else:
        plates["floor"] = {"kind": "plane", "through": [0, 0, 0], "normal": [0, 0, 1]}
    moved = dict.fromkeys(plates if both else ["lid"], 0.5)
    return Scene.model_validate(
        {
            "name": "tubes",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 20.0, "nu": 0.0, "thickness": 1.0, "law": "none", "side_strain": "engineering"},
            "supports": [{"group": "all", "hold": "x"}, {"group": "middle", "hold": "y"}],
            "springs": {"soft": {"group": "middle", "stiffness": 1e-3, "direction": [0, 0, 1]}},
            "obstacles": plates,
            **({"contact": {}} if both else {}),
            "stages": [{"name": "blow", "pressure": 1.0}, {"name": "press", "obstacles": moved, "steps": 2}],
            "probes": {
                "force": {"kind": "contact", "obstacle": "lid", "component": "z"},
                "between": {"kind": "contact", "obstacle": "contact" if both else "floor", "group": "upper", "component": "z"},
                "area": {"kind": "contact", "obstacle": "contact" if both else "floor", "group": "upper", "of": "area"},
            },
            "solver": {"tolerance": 1e-9},
            **changes,
        }
    )  # fmt: skip


def test_two_tubes_pressed_together_are_one_on_the_plane_between() -> None:
    """By symmetry: displacements, forces and areas alike, and all that plates push goes through the contact."""
    two = run(pressed(both=True), mesh=mesh_of(48, both=True))
    one = run(pressed(both=False), mesh=mesh_of(48, both=False))
    for result in (one, two):
        assert result.converged, result.steps[-1].reason
    count = one.mesh.node_count
    for step, alone in zip(two.steps, one.steps, strict=True):
        assert np.abs(step.displacement[:count] - alone.displacement).max() < 1e-6
        assert np.abs(step.displacement[count:] * [1, 1, -1] - alone.displacement).max() < 1e-6
    last, alone = two.steps[-1], one.steps[-1]
    assert last.probes["force"] == pytest.approx(alone.probes["force"], rel=1e-6)
    assert last.probes["between"] == pytest.approx(alone.probes["between"], rel=1e-6)
    assert last.probes["area"] == pytest.approx(alone.probes["area"])
    for step in two.steps[1:]:
        assert step.walls["searches"] > 2 * step.walls["patterns"] > 0
        assert step.walls["crossings"] == 0
    assert last.imbalance < 1e-6
    assert last.stable is None


def shifted(around: int, turn: float) -> Mesh:
    """Two tubes, the lower one turned, so that no node meets a node; with fewer elements around."""
    points, triangles = tube(around, 1.05)
    below, others = tube(around - 7, 0.0)
    c, s = np.cos(turn), np.sin(turn)
    below = below @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T - [0, 0, 1.05]
    count, every = len(points), np.concatenate([points, below])
    away = np.abs(every[:, 1]) < 0.06
    groups = {"middle": np.flatnonzero(away), "upper": np.arange(count), "lower": np.arange(count, len(every))}
    return Mesh.build(every, np.concatenate([triangles, count + others]), groups)


def test_unlike_meshes_touch_as_their_tubes_do() -> None:
    """F = p b of a tube that a plate presses, within 3 %; no node has passed; what is pushed is what is pushed back."""
    result = run(pressed(both=True), mesh=shifted(64, 0.02))
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    # Each tube is pressed to a height of 1.6 by a plate and the other tube: the stadium of E t = 20.
    width = np.pi * (1.0 + 0.5 * 1.6 / 20.0) - 0.5 * np.pi * 1.6
    print(step.probes, width * LENGTH, result.steps[-1].iterations)
    assert -step.probes["force"] / LENGTH == pytest.approx(width, rel=0.03)
    assert step.probes["between"] == pytest.approx(-step.probes["force"], rel=0.02)
    assert step.imbalance < 1e-6
    mesh = result.mesh
    count, depth = crossings(Walls(mesh, np.arange(mesh.tri_count)), mesh.points + step.displacement)
    assert depth < 0.05, count


def test_relaxation_finds_the_same() -> None:
    newton = run(pressed(both=True), mesh=mesh_of(24, both=True)).steps[-1]
    relaxed = run(
        pressed(both=True, solver={"kind": "relaxation", "tolerance": 1e-8}), mesh=mesh_of(24, both=True)
    ).steps[-1]
    assert relaxed.converged, relaxed.reason
    assert relaxed.probes["between"] == pytest.approx(newton.probes["between"], rel=1e-4)


class Stop(Exception):
    pass


def test_a_run_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    """To the last bit: what walls touch is part of the state."""
    from taichi_membrane.execution.observer import Observer

    class Once(Observer):
        def step_done(self, step: Any) -> None:
            if step.number == 1:
                raise Stop

    mesh = mesh_of(24, both=True)
    whole = run(pressed(both=True), mesh=mesh, out=tmp_path / "whole", render=False)
    with pytest.raises(Stop):
        run(pressed(both=True), mesh=mesh, out=tmp_path / "part", render=False, observer=Once())
    rest = resume(tmp_path / "part", render=False)
    for one, other in zip(whole.steps, rest.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement)
        assert one.walls == other.walls
        assert one.state.touched is not None
        assert other.state.touched is not None
        assert np.array_equal(one.state.touched.partner, other.state.touched.partner)
        assert np.array_equal(one.state.touched.push, other.state.touched.push)


def bag(**changes: Any) -> Scene:
    """A flat bag of two sheets whose rim is held, under a pressure from above, and held up from inside."""
    return Scene.model_validate(
        {
            "name": "bag",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 100.0, "nu": 0.0, "thickness": 1.0, "law": "none", "prestress": [1.0, 1.0, 0.0], "warp": [1, 0, 0]},
            "supports": [{"group": "rim", "hold": "xyz"}],
            "pressures": {"above": {"group": "upper"}, "below": {"group": "lower"}},
            "contact": {},
            "stages": [{"name": "press", "pressure": {"above": -2.0}, "steps": 2}],
            "probes": {
                "upper": {"kind": "displacement", "group": "top_middle", "component": "z"},
                "lower": {"kind": "displacement", "group": "bottom_middle", "component": "z"},
                "between": {"kind": "contact", "obstacle": "contact", "group": "top", "component": "z"},
            },
            **changes,
        }
    )  # fmt: skip


def bag_mesh(n: int, height: float) -> Mesh:
    """Two square sheets of 1 by 1, joined at their rim, the inner nodes of the upper one by ``height`` above the others."""
    grid = np.linspace(0.0, 1.0, n + 1)
    x, y = (one.ravel() for one in np.meshgrid(grid, grid, indexing="ij"))
    lower = np.column_stack([x, y, np.zeros(len(x))])
    rim = (x == 0.0) | (x == 1.0) | (y == 0.0) | (y == 1.0)
    number = np.arange(len(x))
    above = number.copy()
    above[~rim] = len(x) + np.arange((~rim).sum())
    upper = lower[~rim] + [0.0, 0.0, height]
    i = np.arange(n)
    a = (i[:, None] * (n + 1) + i).ravel()
    cells = np.stack([a, a + n + 1, a + n + 2, a + 1], axis=1)
    across = np.isin(np.arange(n * n), [n - 1, n * (n - 1)])  # no element has its three nodes on the rim
    cells = np.where(across[:, None], np.roll(cells, -1, axis=1), cells)
    flat = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    triangles = np.concatenate([above[flat], flat[:, ::-1]])
    middle = int(np.flatnonzero((x == 0.5) & (y == 0.5))[0])
    nodes = {
        "rim": number[rim], "top": above[~rim], "top_middle": above[[middle]], "bottom_middle": np.array([middle]),
    }  # fmt: skip
    groups = {"upper": np.arange(len(flat)), "lower": len(flat) + np.arange(len(flat))}
    return Mesh.build(np.concatenate([lower, upper]), triangles, nodes, groups)


@pytest.mark.parametrize("height", [0.02, 0.0])
def test_the_walls_of_a_bag_that_is_pressed_flat(height: float) -> None:
    """Apart at rest, or in one plane: both sag as one sheet of twice the stiffness, half of the load goes through the contact."""
    result = run(bag(), mesh=bag_mesh(8, height))
    assert result.converged, result.steps[-1].reason
    step = result.steps[-1]
    print(step.probes, step.iterations)
    assert step.probes["lower"] < -0.01
    assert step.probes["upper"] + height == pytest.approx(step.probes["lower"], abs=1e-5)
    alone = run(
        bag(contact=None, probes={}, stages=[{"name": "press", "pressure": {"above": -1.0}}]), mesh=bag_mesh(8, 0.0)
    )
    assert alone.converged
    if height == 0.0:
        sag = alone.steps[-1].displacement[alone.mesh.node_groups["top_middle"][0], 2]
        assert step.probes["upper"] == pytest.approx(sag, rel=1e-5)


def test_walls_that_have_passed_are_no_result() -> None:
    """Two sheets that stand crosswise at rest, as if they had gone through each other."""
    mesh = bag_mesh(8, 0.02)
    points = mesh.points.copy()
    points[mesh.node_groups["top_middle"][0], 2] = -0.1
    through = Mesh.build(points, mesh.triangles, dict(mesh.node_groups), dict(mesh.tri_groups))
    walls = Walls(through, np.arange(through.tri_count))
    count, depth = crossings(walls, through.points)
    assert count > 3
    assert depth > 0.1
    assert crossings(Walls(mesh, np.arange(mesh.tri_count)), mesh.points) == (0, 0.0)


def sheets(**changes: Any) -> Scene:
    """Two sheets, of which the upper one is moved down by 1."""
    return Scene.model_validate(
        {
            "name": "sheets",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {
                "E": 100.0,
                "nu": 0.0,
                "thickness": 1.0,
                "law": "none",
                "warp": [1, 0, 0],
                "prestress": [1, 1, 0],
            },
            "supports": [{"group": "lower", "hold": "xyz"}],
            "motions": {"fall": {"kind": "translation", "group": "upper", "direction": [0, 0, -1], "hold": "xyz"}},
            "pressures": {},
            "contact": {},
            "stages": [{"name": "fall", "motions": {"fall": 1.0}}],
            "solver": {"max_cuts": 3},
            **changes,
        }
    )


def test_a_step_that_passes_through_is_no_result() -> None:
    """Though at its end no side crosses anything: the nodes' ways tell. What comes near and stays apart is one."""
    points = np.array([[x, y, 0.0] for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0)])
    cells = [(0, 3, 4, 1), (1, 4, 5, 2), (3, 6, 7, 4), (4, 7, 8, 5)]
    flat = np.array([corner for a, b, c, d in cells for corner in ([a, b, c], [a, c, d])])
    every = np.concatenate([points, points + np.array([0.1, 0.05, 0.5])])
    groups = {"lower": np.arange(9), "upper": np.arange(9, 18)}
    mesh = Mesh.build(every, np.concatenate([flat, 9 + flat]), groups)
    moved = np.where(np.arange(18)[:, None] < 9, 0.0, np.array([0.0, 0.0, -1.0]))
    walls = Walls(mesh, np.arange(mesh.tri_count))
    assert crossings(walls, mesh.points + moved) == (0, 0.0)
    assert {4, 9, 13} <= set(passed(walls, mesh.points, mesh.points + moved).tolist())
    assert not len(passed(walls, mesh.points, mesh.points + 0.4 * moved))
    result = run(sheets(), mesh=mesh)
    assert not result.converged
    assert "passed through" in result.steps[-1].reason or "contact forces not found" in result.steps[-1].reason
    near = run(sheets(stages=[{"name": "fall", "motions": {"fall": 0.45}}]), mesh=mesh)
    assert near.converged, near.steps[-1].reason


def test_it_is_told_and_without_it_nothing_is_compiled() -> None:
    for contact in (None, {}):
        scene = bag(contact=contact, probes={})
        structure = build_model(scene, bag_mesh(4, 0.0)).structure
        told = "contact of walls with each other"
        assert (told in structure.features().describe()[0]) is (contact is not None)
        names = {name for name, _ in System(structure).fields() if name.startswith("wall_")}
        assert bool(names) is (contact is not None)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"contact": {"group": "sky"}}, r"contact\.group: no element group 'sky'"),
        ({"contact": None}, r"probes\.between\.obstacle: 'contact' is not"),
        ({"planes": {"contact": {"through": [0, 0, -1], "normal": [0, 0, 1]}}}, "has the name already"),
        ({"stages": [{"name": "s", "control": "arc_length"}]}, "is not implemented for a scene with contact"),
        ({"stages": [{"name": "s", "until": "collapse"}]}, "is not implemented for a scene with contact"),
        ({"modes": {"kind": "buckling"}}, "modes is not implemented for a scene with contact"),
        ({"derivatives": ["upper"]}, "derivatives is not implemented for a scene with contact"),
        ({"probes": {"p": {"kind": "contact", "obstacle": "contact", "group": "sky"}}}, r"probes\.p\.group"),
    ],
)
def test_mistakes_are_told(changes: dict[str, Any], told: str) -> None:
    with pytest.raises((InputError, ValueError), match=told):
        probes.validate(build_model(bag(**changes), bag_mesh(4, 0.0)))
