"""Coulomb friction: forces against energies, a sheet that sticks and slips on a plane, a strip round a cylinder, what is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import closed_body

from taichi_membrane.execution.run import resume, run
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def rubbed() -> System:
    """A closed body whose nodes are all pushed by a sphere, some of which stick and some slip."""
    one = Obstacle(
        name="ball", kind="sphere", nodes=np.arange(12), centre=np.array([0.1, 0.2, 0.3]), size=(0.7,), friction=0.3
    )
    system = System(closed_body(obstacles=(one,)))
    rng = np.random.default_rng(7)
    system.contacts[0].set(np.full(12, 3.0), np.full(12, 20.0))
    system.set_displacement(rng.normal(size=(12, 3)) * 0.1)
    normal = system.touching().normal[0]
    rub = system.frictions[0]
    rub.keep(rng.normal(size=(12, 3)) * 0.1, rng.normal(size=(12, 3)))
    rub.set(normal, rub.carried, np.linspace(0.0, 12.0, 12))
    return system


def test_forces_are_those_of_a_potential_and_the_tangent_is_theirs() -> None:
    """By differences along random directions, with nodes that stick and nodes that slip; no force exceeds its limit."""
    system = rubbed()
    tangent, rng, h = Tangent(system), np.random.default_rng(5), 1e-6
    place, none = system.displacement(), np.zeros((12, 3))
    force, matrix, rub = system.out_of_balance(), tangent.matrix(), system.touching().friction[0]
    size, limit = np.linalg.norm(rub, axis=1), 0.3 * np.linspace(0.0, 12.0, 12)
    slips = size > (1.0 - 1e-12) * limit
    assert 0 < slips.sum() < 12
    assert (size <= limit * (1.0 + 1e-12)).all()
    for _ in range(4):
        way = rng.normal(size=place.shape)
        seen = []
        for sign in (1.0, -1.0):
            system.set_displacement(place + sign * h * way)
            seen.append((system.potential_energy(none)[0], system.out_of_balance()))
        (up, more), (down, less) = seen
        assert -(up - down) / (2 * h) == pytest.approx(
            np.vdot(force, way), abs=1e-7 * np.linalg.norm(force) * np.linalg.norm(way)
        )
        product = (matrix @ way.ravel()).reshape(-1, 3)
        assert np.abs(-(more - less) / (2 * h) - product).max() < 1e-7 * np.abs(product).max()


WEIGHT, FRICTION = 3.0, 0.4


def sheet(stages: list[dict[str, Any]], **changes: Any) -> Scene:
    """A sheet of 1 by 1 under a dead load of 3 on a plane, moved by its side at x = 0."""
    return Scene.model_validate(
        {
            "name": "sheet",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 4, "along_y": 4},
            "fabric": {"E": 100.0, "nu": 0.0, "thickness": 1.0, "law": "none"},
            "groups": {"side": {"where": "x = 0 within 1e-9"}},
            "planes": {"ground": {"through": [0, 0, 0], "normal": [0, 0, 1], "friction": FRICTION}},
            "pressures": {},
            "loads": {"down": {"group": "all", "direction": [0, 0, -1]}},
            "motions": {"pull": {"kind": "translation", "group": "side", "direction": [1, 0, 0], "hold": "xy"}},
            "stages": stages,
            "probes": {
                "drag": {"kind": "contact", "obstacle": "ground", "component": "x"},
                "push": {"kind": "contact", "obstacle": "ground", "component": "z"},
                "held": {"kind": "reaction", "group": "side", "component": "x"},
                "far": {"kind": "displacement", "group": "all", "component": "x"},
            },
            **changes,
        }
    )  # fmt: skip


PULLED: list[dict[str, Any]] = [
    {"name": "lay", "loads": {"down": WEIGHT}},
    {"name": "pull", "motions": {"pull": -0.5}, "steps": 2},
    {"name": "back", "motions": {"pull": -0.4}, "steps": 2},
]


@pytest.mark.parametrize("kind", ["hybrid", "relaxation"])
def test_a_sheet_that_slips_on_a_plane(kind: str) -> None:
    """Its drag is μ N against the motion, both ways; forces cancel; nothing is told of stability."""
    result = run(sheet(PULLED, solver={"kind": kind, "tolerance": 1e-9}))
    assert result.converged, result.steps[-1].reason
    for step in result.steps:
        assert step.imbalance < 1e-7
        assert step.stable is None
        assert step.energy is None
        assert step.probes["push"] == pytest.approx(WEIGHT, rel=1e-7)
    assert result.steps[0].probes["drag"] == pytest.approx(0.0, abs=1e-7)
    for step, sign in ((result.steps[2], 1.0), (result.steps[4], -1.0)):
        assert step.probes["drag"] == pytest.approx(sign * FRICTION * WEIGHT, rel=1e-6)
        assert step.probes["held"] == pytest.approx(-sign * FRICTION * WEIGHT, rel=1e-6)


WIDTH, TAIL = 0.1, 0.2


def strip(parts: int) -> Mesh:
    """A strip over the upper half of a cylinder of radius 1 along y, with straight ends that hang down."""
    angle = np.pi * np.arange(parts + 1) / parts
    ends = TAIL * np.arange(1, 3) / 2
    x = np.concatenate([np.full(2, 1.0), np.cos(angle), np.full(2, -1.0)])
    z = np.concatenate([-2.0 * ends[::-1], np.sin(angle), -ends])
    n = len(x)
    points = np.concatenate([np.column_stack([x, np.full(n, y), z]) for y in (0.0, WIDTH)])
    here = np.arange(n - 1)
    halves = [np.column_stack([here, here + 1, n + here]), np.column_stack([here + 1, n + here + 1, n + here])]
    groups = {"slack": np.array([0, n]), "pulled": np.array([n - 1, 2 * n - 1])}
    return Mesh.build(points, np.concatenate(halves), groups)


def capstan(friction: float) -> Scene:
    return Scene.model_validate(
        {
            "name": "capstan",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 1e5, "nu": 0.0, "thickness": 1.0, "law": "none"},
            "supports": [{"group": "all", "hold": "y"}, {"group": "slack", "hold": "x"}],
            "obstacles": {
                "drum": {"kind": "cylinder", "centre": [0, 0, 0], "axis": [0, 1, 0], "radius": 1.0, "friction": friction}
            },
            "pressures": {},
            "loads": {"hold": {"group": "slack", "direction": [0, 0, -1]}},
            "motions": {"pull": {"kind": "translation", "group": "pulled", "direction": [0, 0, -1], "hold": "xz"}},
            "stages": [{"name": "tighten", "loads": {"hold": 1.0}}, {"name": "pull", "motions": {"pull": 0.02}, "steps": 2}],
            "probes": {"pulled": {"kind": "reaction", "group": "pulled", "component": "z"}},
            "solver": {"tolerance": 1e-8},
        }
    )  # fmt: skip


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_strip_round_a_cylinder(friction: float) -> None:
    """The force is exp(μ π) times that at the other end, to second order in the turn at a node."""
    errors = []
    for parts in (16, 32):
        step = run(capstan(friction), mesh=strip(parts)).steps[-1]
        assert step.converged, step.reason
        errors.append(-step.probes["pulled"] / np.exp(friction * np.pi) - 1.0)
        assert step.imbalance < 1e-6
    assert abs(errors[1]) < 1e-3
    assert abs(errors[1]) < 0.3 * abs(errors[0])


def test_a_sheet_that_sticks_stays_where_friction_has_left_it() -> None:
    """T² / (2 f E A) at the end of a bar on a ground that bears f per length, half of it when T is gone; the far end stays."""
    pull = {"down": {"group": "all", "direction": [0, 0, -1]}, "tug": {"group": "side", "direction": [-1, 0, 0]}}
    stages = [
        {"name": "lay", "loads": {"down": WEIGHT}},
        {"name": "tug", "loads": {"tug": 0.5 * FRICTION * WEIGHT}},
        {"name": "let_go", "loads": {"tug": 0.0}},
    ]
    supports = [{"group": "side", "hold": "y"}]
    fine = {"shape": "panel", "width": 1.0, "height": 0.1, "along_x": 60, "along_y": 1}
    changes = {"mesh": fine, "fabric": {"E": 1e4, "nu": 0.0, "thickness": 1.0, "law": "none"}, "supports": supports}
    result = run(sheet(stages, loads=pull, motions={}, probes={}, solver={"tolerance": 1e-9}, **changes))
    assert result.converged, result.steps[-1].reason
    far = result.mesh.points[:, 0] > 1.0 - 1e-9
    near = result.mesh.points[:, 0] < 1e-9
    tugged, free = (step.displacement[:, 0] for step in result.steps[1:])
    assert np.abs(tugged[far]).max() < 1e-9
    slipped = (0.5 * FRICTION * WEIGHT) ** 2 / (2.0 * FRICTION * WEIGHT * 1e4 * 0.1)
    assert tugged[near].mean() == pytest.approx(-slipped, rel=0.02)
    assert free[near].mean() == pytest.approx(-0.5 * slipped, rel=0.02)
    assert result.steps[2].balance["contact"][0] == pytest.approx(0.0, abs=1e-7)


def test_more_than_friction_bears_is_no_equilibrium() -> None:
    pull = {"down": {"group": "all", "direction": [0, 0, -1]}, "tug": {"group": "side", "direction": [-1, 0, 0]}}
    for share, holds in ((0.99, True), (1.01, False)):
        stages = [
            {"name": "lay", "loads": {"down": WEIGHT}},
            {"name": "tug", "loads": {"tug": share * FRICTION * WEIGHT}},
        ]
        settings = {"kind": "newton", "max_cuts": 0}
        result = run(
            sheet(stages, loads=pull, motions={}, supports=[{"group": "side", "hold": "y"}], probes={}, solver=settings)
        )
        assert result.converged is holds


def test_it_does_not_matter_which_of_the_two_moves() -> None:
    """A sheet drawn over a plane, and a plane under a held sheet."""
    drawn = run(sheet(PULLED[:2], solver={"tolerance": 1e-9})).steps[-1]
    ground = {"kind": "plane", "through": [0, 0, 0], "normal": [0, 0, 1], "direction": [1, 0, 0], "friction": FRICTION}
    stages = [PULLED[0], {"name": "pull", "obstacles": {"ground": 0.5}, "steps": 2}]
    held = run(
        sheet(stages, planes={}, obstacles={"ground": ground}, motions={}, supports=[{"group": "side", "hold": "xy"}],
              solver={"tolerance": 1e-9})
    ).steps[-1]  # fmt: skip
    assert held.displacement == pytest.approx(drawn.displacement + np.array([0.5, 0.0, 0.0]), abs=1e-8)
    assert held.probes["drag"] == pytest.approx(drawn.probes["drag"], rel=1e-6)


class Stop(Exception):
    pass


@pytest.mark.parametrize("kind", ["hybrid", "relaxation"])
def test_a_run_with_friction_goes_on_where_it_was_stopped(kind: str, tmp_path: Path) -> None:
    """To the last bit: the forces that friction left are part of the state."""
    from taichi_membrane.execution.observer import Observer

    class Once(Observer):
        def step_done(self, step: Any) -> None:
            if step.number == 1:
                raise Stop

    scene = sheet(PULLED, solver={"kind": kind})
    whole = run(scene, out=tmp_path / "whole", render=False)
    with pytest.raises(Stop):
        run(scene, out=tmp_path / "part", render=False, observer=Once())
    rest = resume(tmp_path / "part", render=False)
    for one, other in zip(whole.steps, rest.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement)
        assert all(map(np.array_equal, one.state.friction, other.state.friction))
        assert one.balance == other.balance
    assert np.linalg.norm(whole.steps[1].state.friction[0]) > 0.0


def test_friction_is_told_and_without_it_nothing_is_compiled() -> None:
    names = {}
    for friction in (0.0, 0.3):
        scene = sheet(PULLED, planes={"ground": {"through": [0, 0, 0], "normal": [0, 0, 1], "friction": friction}})
        structure = build_model(scene, build_mesh(scene)).structure
        assert ("friction" in structure.features().describe()[0]) is (friction > 0.0)
        names[friction] = {name for name, _ in System(structure).fields() if name.startswith("friction_")}
    assert not names[0.0]
    assert names[0.3] == {"friction_normal", "friction_multiplier", "friction_limit", "friction_anchor"}
    with pytest.raises(ValueError, match=r"friction"):
        sheet(PULLED, planes={"ground": {"through": [0, 0, 0], "normal": [0, 0, 1], "friction": -0.1}})
