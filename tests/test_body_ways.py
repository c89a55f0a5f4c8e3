"""Rigid bodies with all that goes beside load control: arc length, branches, derivatives, shut gas, pressure without a potential,
single precision, resuming."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from resume_cases import ROOT, environment, run_until
from scipy.optimize import brentq
from test_body_scenes import MAST, hexapod, probed, tube

import taichi_membrane as tm
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def test_arc_length_leads_where_load_control_does() -> None:
    stages = [{"name": "load", "loads": {"push": 1.0}, "control": "arc_length", "steps": 30}]
    followed, loaded = (run(scene, mesh=mesh) for scene, mesh, _ in (hexapod(stages=stages), hexapod()))
    assert followed.converged, followed.steps[-1].reason
    assert followed.steps[-1].solver == "arc length"
    assert np.abs(followed.steps[-1].displacement - loaded.steps[-1].displacement).max() < 1e-8


def test_derivatives_are_those_of_differences() -> None:
    """Of places and mean rotations of the body's nodes with respect to a force with a dead couple."""
    probes = {
        "sink": {"kind": "displacement", "group": "top1", "component": "z"},
        "twist": {"kind": "rotation", "group": "top", "axis": [0, 0, 1], "through": [0, 0, 0]},
    }
    values = {}
    for factor in (0.999, 1.0, 1.001):
        stages = [{"name": "load", "loads": {"push": factor}}]
        scene, mesh, _ = hexapod(probes=probes, derivatives=list(probes), stages=stages)
        values[factor] = run(scene, mesh=mesh).steps[-1]
    for name in probes:
        slope = (values[1.001].probes[name] - values[0.999].probes[name]) / 0.002
        assert values[1.0].derivatives[name]["load.push"] == pytest.approx(slope, rel=1e-5)


def test_an_axial_moment_turns_a_plate_as_its_energy_says() -> None:
    """One freedom: d/dθ of the energy of six bars is the moment; 25 degrees, found by a root in one unknown."""
    bodies = {"plate": {"group": "top", "centre": [0.0, 0.0, 2.0], "hold": "xyz", "turn_hold": "xy"}}
    loads = {"push": {"kind": "body", "body": "plate", "moment": [0, 0, 9.0], "couple": "axial"}}
    scene, mesh, places = hexapod(
        bodies=bodies, loads=loads, derivatives=[], stages=[{"name": "load", "loads": {"push": 1.0}}]
    )
    result = run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    ends = np.repeat(places["top"], 2, axis=0)
    rest = np.linalg.norm(ends - places["feet"], axis=1)

    def moment(angle: float) -> float:
        c, s = np.cos(angle), np.sin(angle)
        now = ends @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        bars = now - places["feet"]
        length = np.linalg.norm(bars, axis=1)
        pull = (50.0 * (length - rest) / rest / length)[:, None] * bars
        return float(np.cross(now, pull)[:, 2].sum())

    angle = brentq(lambda one: moment(one) - 9.0, 0.0, 0.8, xtol=1e-14)
    assert angle > 0.1
    assert np.deg2rad(probed(result, "rotation")) == pytest.approx([0.0, 0.0, angle], abs=1e-9)
    assert probed(result, "moment")[2] == pytest.approx(0.0, abs=1e-9)  # the support has none about the free axis
    again = run(
        scene.model_copy(update={"solver": tm.load_scene("tube").solver.model_copy(update={"kind": "relaxation"})}),
        mesh=mesh,
    )
    assert probed(again, "rotation") == pytest.approx(probed(result, "rotation"), abs=1e-3)


SPRING, SIDE = 50.0, 400.0


def leaning(factor: float) -> tuple[Scene, Mesh]:
    """A mast that may turn about y alone, held by two long bars along x, and by two along y that only large angles strain."""
    patch = np.array([[0.0, 90, 0], [1, 90, 0], [1, 91, 0]])
    far = 1e4
    loose = np.array([[0.0, 0, 0], [0, 0, MAST], [far, 0, MAST], [-far, 0, MAST], [0, 1, MAST], [0, -1, MAST]])
    mesh = Mesh.build(
        patch, [[0, 1, 2]], lines=[[3, 4], [4, 5], [4, 6], [4, 7], [4, 8]],
        line_groups={"mast": [0], "long": [1, 2], "short": [3, 4]}, loose_points=loose,
        loose_groups={"anchors": [5, 6, 7, 8], "top": [4]},
    )  # fmt: skip
    scene = {
        "name": "leaning",
        "units": {"length": "m", "force": "kN"},
        "mesh": {"shape": "given"},
        "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
        "groups": {"patch": {"where": "y > 80"}},
        "supports": [{"group": "patch", "hold": "xyz"}, {"group": "anchors", "hold": "xyz"}],
        "bodies": {"mast": {"lines": "mast", "centre": [0, 0, 0], "hold": "xyz", "turn_hold": "xz"}},
        "cables": {
            "long": {"lines": "long", "EA": 0.5 * SPRING * far, "kind": "bar"},
            "short": {"lines": "short", "EA": SIDE, "kind": "bar"},
        },
        "loads": {"weight": {"group": "top", "direction": [0, 0, -1]}},
        "stages": [{"name": "load", "loads": {"weight": factor * SPRING * MAST}}],
        "probes": {"tilt": {"kind": "body", "body": "mast", "of": "rotation", "component": "magnitude"}},
        "solver": {"kind": "newton", "tolerance": 1e-10},
    }  # fmt: skip
    return Scene.model_validate(scene), mesh


def test_a_mast_leans_along_the_stable_branch_beyond_its_critical_load() -> None:
    """P = k L bifurcates; the side bars' energy, of fourth order, makes the branch stable. Its angle by a root in one unknown."""
    scene, mesh = leaning(1.1)
    result = run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    last = result.steps[-1]
    assert last.stable
    assert [one.event for one in last.trace][:1] == ["bifurcation"]
    assert last.trace[0].share == pytest.approx(1.0 / 1.1, abs=2e-3)

    def energy(angle: float) -> float:
        x, z, far = MAST * np.sin(angle), MAST * (1.0 - np.cos(angle)), 1e4
        long = sum((np.hypot(far - sign * x, z) - far) ** 2 for sign in (1.0, -1.0))
        short = 2.0 * (np.sqrt(1.0 + x**2 + z**2) - 1.0) ** 2
        return 0.25 * SPRING * long + 0.5 * SIDE * short - 1.1 * SPRING * MAST * z

    def slope(angle: float) -> float:
        return (energy(angle + 1e-4) - energy(angle - 1e-4)) / 2e-4

    angle = brentq(slope, 0.005, 0.5, xtol=1e-14)
    assert np.deg2rad(last.probes["tilt"]) == pytest.approx(angle, rel=1e-5)


def in_differences(equilibrium: Equilibrium, chosen: Any) -> tuple[Any, Any]:
    """The factor's product, and differences of the forces on the freedoms along steps, for freedoms (node, component)."""
    system, newton = equilibrium.system, equilibrium.newton
    assert newton is not None
    factor = newton.factorised(indefinite=True)
    assert factor is not None
    u, products, differences, step = system.displacement(), [], [], 1e-6
    for node, c in chosen:
        direction = np.zeros_like(u)
        direction[node, c] = 1.0
        products.append(factor.times(direction))
        forces = []
        for sign in (1.0, -1.0):
            system.set_displacement(system.retract(u, sign * step * direction))
            if newton.contents is not None:
                newton.contents.settle()
            forces.append(newton.free_force())
        system.set_displacement(u)
        differences.append((forces[1] - forces[0]) / (2 * step))
    return np.array(products), np.array(differences)


@pytest.mark.parametrize("shut", [False, True])
def test_the_whole_tangent_is_that_of_differences(shut: bool) -> None:
    """With shut gas; and without the plate's fabric, so that pressure ends at the body's rim and has no potential."""
    around = {
        "shape": "tube",
        "radius": 1.0,
        "length": 2.0,
        "around": 6,
        "along": 4,
        "cap_end": "flat" if shut else "none",
    }
    cap_start = {"cap_start": "flat"} if shut else {}
    scene = tube(
        mesh={**around, **cap_start}, bodies={"plate": {"group": "cap_end" if shut else "end"}},
        fabric={"E": 1.0, "nu": 0.3, "thickness": 1.0, "law": "none"}, pressures={"inside": {"ambient": 0.1}},
        stages=[{"name": "inflate", "pressure": 0.01, "loads": {"push": 1e-3}},
                {"name": "shut", "closed": ["inside"] if shut else []}],
    )  # fmt: skip
    model = build_model(scene, build_mesh(scene))
    equilibrium = Equilibrium(model)
    state = LoadState({**model.unloaded.values, "pressure.inside": 0.01, "load.push": 1e-3})
    assert equilibrium.solve(state, None).converged
    if shut:
        state = equilibrium.settled(state)
        equilibrium.shut(scene.stages[1])
        equilibrium.press(state)
        assert equilibrium.filling.contents is not None
        assert len(equilibrium.filling.contents.rank_one()) == 1
    else:
        assert equilibrium.newton is not None
        assert equilibrium.newton.skew() is not None
    spin = model.structure.bodies[0].carriers
    chosen = [(node, c) for node in (*spin, int(model.structure.mesh.node_groups["middle"][0])) for c in range(3)]
    products, differences = in_differences(equilibrium, chosen)
    assert np.abs(products - differences).max() < 1e-7 * np.abs(products).max()


def test_single_precision_relaxes_to_the_same_place(tmp_path: Path) -> None:
    program = tmp_path / "single.py"
    program.write_text(
        "import sys\n"
        f"sys.path.insert(0, {str(ROOT / 'tests')!r})\n"
        "import numpy as np, taichi_membrane as tm\n"
        "from test_body_scenes import hexapod\n"
        "scene, mesh, _ = hexapod(solver={'kind': 'relaxation', 'tolerance': 1e-5})\n"
        "result = tm.run(scene, mesh=mesh, precision='f32', render=False)\n"
        "assert result.converged, result.steps[-1].reason\n"
        "np.save('single.npy', result.steps[-1].displacement)\n"
    )
    done = subprocess.run(
        [sys.executable, program], cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    scene, mesh, _ = hexapod()
    assert np.abs(np.load(tmp_path / "single.npy") - run(scene, mesh=mesh).steps[-1].displacement).max() < 1e-4


def test_a_run_goes_on_with_its_bodies_where_they_were(tmp_path: Path) -> None:
    """Poses are those of the nodes: bit by bit the same as a run that was not stopped."""
    scene = tube(
        motions={"turn": {"kind": "body_rotation", "body": "plate", "axis": [0, 1, 0]}},
        stages=[{"name": "inflate", "pressure": 0.01}, {"name": "turn", "motions": {"turn": 20.0}, "steps": 3}],
        loads={},
    )  # fmt: skip
    whole = tm.run(scene, out=tmp_path / "whole", render=False)
    part = tmp_path / "part"

    run_until(1, scene, out=part, render=False)
    resumed = tm.resume(part)
    assert len(resumed.steps) == len(whole.steps) == 4
    for one, other in zip(resumed.steps, whole.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement)
    assert whole.steps[-1].probes["turn"] == pytest.approx(20.0, rel=1e-12)
