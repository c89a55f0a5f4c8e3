"""Rigid bodies in scenes: end plates, plates on bars and guyed masts, against exact results; and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

RADIUS, PRESSURE = 1.0, 0.01


def tube(**changes: Any) -> Scene:
    """A tube of length 6 clamped at its start, with a rigid plate at its end."""
    return Scene.model_validate(
        {
            "name": "plate",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": RADIUS, "length": 6.0, "around": 12, "along": 12, "cap_end": "flat"},
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
            "supports": [{"group": "start", "hold": "xyz"}],
            "bodies": {"plate": {"group": "cap_end"}},
            "loads": {"push": {"kind": "body", "body": "plate", "force": [0, 0, -1], "moment": [0.0, 0.5, 0.0]}},
            "stages": [
                {"name": "inflate", "pressure": PRESSURE},
                {"name": "bend", "loads": {"push": 1e-3}},
            ],
            "probes": {
                "pull": {"kind": "reaction", "group": "start", "component": "x"},
                "shear": {"kind": "reaction", "group": "start", "component": "z"},
                "moment": {"kind": "moment", "group": "start", "axis": [0, 1, 0], "through": [0, 0, 0]},
                "turn": {"kind": "body", "body": "plate", "of": "rotation", "component": "y"},
                "sink": {"kind": "body", "body": "plate", "of": "displacement", "component": "z"},
                "free": {"kind": "body", "body": "plate", "of": "force", "component": "magnitude"},
            },
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def end_area() -> float:
    """Of the polygon that the rim of the end is."""
    return 6.0 * np.sin(2.0 * np.pi / 12.0) * RADIUS**2


def test_a_plate_is_pulled_by_pressure_times_area_and_hands_on_force_and_moment() -> None:
    """All in balance on the deformed shape, to the residual."""
    result = run(tube())
    assert result.converged, result.steps[-1].reason
    inflated, bent = result.steps
    assert inflated.probes["pull"] == pytest.approx(-PRESSURE * end_area(), rel=1e-9)
    assert bent.probes["shear"] == pytest.approx(1e-3, rel=1e-9)
    assert bent.probes["turn"] > 0.1
    assert bent.probes["free"] < 1e-14
    # However the tube bends, its pressure lacks what the start's disc would bear, a force through that one's middle. What acts at
    # the plate follows from its pose: the force at its middle, and dead forces across its nodes' present arms.
    nodes, mesh = result.mesh.node_groups["plate"], result.mesh
    rest = mesh.points[nodes] - mesh.points[nodes].mean(axis=0)
    places = (mesh.points + bent.displacement)[nodes]
    inertia = (rest**2).sum() * np.eye(3) - rest.T @ rest
    couple = np.cross(np.linalg.solve(inertia, [0.0, 0.5e-3, 0.0]), rest)
    middle = places.mean(axis=0)
    moment = np.cross(middle, [0.0, 0.0, -1e-3]) + np.cross(places - middle, couple).sum(axis=0)
    assert bent.probes["moment"] == pytest.approx(-moment[1], rel=1e-9)
    assert moment[1] > 1.1e-3 * 6.0 * 0.9


def hexapod(**changes: Any) -> tuple[Scene, Mesh, dict[str, Any]]:
    """A rigid triangle on six bars from random feet."""
    rng = np.random.default_rng(5)
    top = np.array([[1.0, 0, 2], [-0.5, 0.8, 2.1], [-0.5, -0.9, 1.8]])
    feet = np.column_stack([2.0 * np.cos(np.arange(6)), 2.0 * np.sin(np.arange(6)), 0.2 * rng.normal(size=6)])
    patch = np.array([[0.0, 9, 0], [1, 9, 0], [1, 10, 0]])
    bars = {f"bar{k}": {"nodes": [f"foot{k}", f"top{k // 2}"], "EA": 50.0, "kind": "bar"} for k in range(6)}
    mesh = Mesh.build(
        np.vstack([patch, top, feet]), [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]],
        node_groups={"top": [3, 4, 5], **{f"top{k}": [3 + k] for k in range(3)}, **{f"foot{k}": [6 + k] for k in range(6)}},
    )  # fmt: skip
    scene = {
        "name": "hexapod",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "given"},
        "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
        "groups": {"ground": {"where": "z < 1.5"}},
        "supports": [{"group": "ground", "hold": "xyz"}],
        "bodies": {"plate": {"group": "top", "centre": [0.0, 0.0, 2.0]}},
        "cables": bars,
        "stages": [{"name": "load", "loads": {"push": 1.0}, "steps": 2}],
        "loads": {
            "push": {
                "kind": "body", "body": "plate", "force": [3.0, 1.0, -3.0], "at": [1.0, 0.0, 2.0], "moment": [0.7, -1.0, 4.0],
            }
        },
        "probes": {
            f"{of}_{c}": {"kind": "body", "body": "plate", "of": of, "component": c}
            for of in ("displacement", "rotation", "force", "moment") for c in "xyz"
        },
        "solver": {"kind": "newton", "tolerance": 1e-11},
        **changes,
    }  # fmt: skip
    return Scene.model_validate(scene), mesh, {"top": top, "feet": feet}


def probed(result: RunResult, of: str) -> Any:
    return np.array([result.steps[-1].probes[f"{of}_{c}"] for c in "xyz"])


def test_a_plate_on_six_bars_goes_where_its_energy_is_least() -> None:
    """Six freedoms minimised by SciPy, bars and dead forces written out anew; rotations of 20 degrees."""
    scene, mesh, places = hexapod()
    result = run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    centre, top = np.array([0.0, 0.0, 2.0]), places["top"]
    ends = np.repeat(top, 2, axis=0)
    rest = np.linalg.norm(ends - places["feet"], axis=1)
    arms = top - top.mean(axis=0)
    inertia = (arms**2).sum() * np.eye(3) - arms.T @ arms
    couple = np.cross(np.linalg.solve(inertia, [0.7, -1.0, 4.0]), arms)

    def energy(q: Any) -> float:
        turn = Rotation.from_rotvec(q[3:])
        now = centre + q[:3] + turn.apply(top - centre)
        length = np.linalg.norm(np.repeat(now, 2, axis=0) - places["feet"], axis=1)
        stored = 0.5 * 50.0 * ((length - rest) ** 2 / rest).sum()
        return float(stored - (now - top)[0] @ [3.0, 1.0, -3.0] - (couple * (now - top)).sum())

    found = minimize(energy, np.zeros(6), method="BFGS", options={"gtol": 1e-9}).x
    assert np.linalg.norm(found[3:]) > np.deg2rad(10.0)
    assert np.abs(probed(result, "displacement") - found[:3]).max() < 2e-7
    assert np.abs(np.deg2rad(probed(result, "rotation")) - found[3:]).max() < 2e-7
    assert result.steps[-1].energy == pytest.approx(energy(found), rel=1e-12)


def test_relaxation_finds_the_same_place() -> None:
    newton, relaxed = (
        run(scene, mesh=mesh)
        for scene, mesh, _ in (hexapod(), hexapod(solver={"kind": "relaxation", "tolerance": 1e-9}))
    )
    assert relaxed.converged, relaxed.steps[-1].reason
    assert np.abs(newton.steps[-1].displacement - relaxed.steps[-1].displacement).max() < 1e-7


def test_a_plate_turned_about_two_axes_comes_back_and_its_moments_are_those_of_the_energy() -> None:
    """The work of the prescribed rotation's moment is the energy; what holds the plate is in no node's way."""
    turns = {
        f"turn_{c}": {"kind": "body_rotation", "body": "plate", "axis": [float(c == a) for a in "xyz"]} for c in "xy"
    }
    stages = [
        {"name": "over", "motions": {"turn_x": 40.0}, "steps": 2},
        {"name": "across", "motions": {"turn_y": -50.0}, "steps": 2},
        {"name": "nearly", "motions": {"turn_y": -50.1}},
        {"name": "back", "motions": {"turn_x": 0.0, "turn_y": 0.0}, "steps": 3},
    ]
    scene, mesh, _ = hexapod(motions=turns, stages=stages, loads={})
    result = run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    assert np.abs(result.steps[-1].displacement).max() < 1e-9
    assert result.steps[-1].energy == pytest.approx(0.0, abs=1e-12 * result.steps[3].energy)
    turned, further = result.steps[3], result.steps[4]
    expected = Rotation.from_rotvec([0, np.deg2rad(-50.0), 0]) * Rotation.from_rotvec([np.deg2rad(40.0), 0, 0])
    found = np.deg2rad([turned.probes[f"rotation_{c}"] for c in "xyz"])
    assert np.abs(found - expected.as_rotvec()).max() < 1e-12
    assert max(abs(turned.probes[f"force_{c}"]) for c in "xyz") < 1e-9  # the centre is free
    mean = 0.5 * (turned.probes["moment_y"] + further.probes["moment_y"])
    assert further.energy - turned.energy == pytest.approx(mean * np.deg2rad(-0.1), rel=1e-5)


MAST, REACH, EA, TENSION = 4.0, 3.0, 1000.0, 20.0


def guyed(**changes: Any) -> tuple[Scene, Mesh]:
    """A mast on a hinge, held up by four guys that are taut, under a load on its top."""
    patch = np.array([[0.0, 90, 0], [1, 90, 0], [1, 91, 0]])
    loose = np.array([[0.0, 0, 0], [0, 0, MAST], [REACH, 0, 0], [-REACH, 0, 0], [0, REACH, 0], [0, -REACH, 0]])
    lines = [[3, 4], *([4, 5 + k] for k in range(4))]
    mesh = Mesh.build(
        patch, [[0, 1, 2]], lines=lines, line_groups={"mast": [0], "guys": [1, 2, 3, 4]}, loose_points=loose,
        loose_groups={"anchors": [5, 6, 7, 8], "top": [4]},
    )  # fmt: skip
    scene = {
        "name": "guyed",
        "units": {"length": "m", "force": "kN"},
        "mesh": {"shape": "given"},
        "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
        "groups": {"patch": {"where": "y > 80"}},
        "supports": [{"group": "patch", "hold": "xyz"}, {"group": "anchors", "hold": "xyz"}],
        "bodies": {"mast": {"lines": "mast", "centre": [0, 0, 0], "hold": "xyz"}},
        "cables": {"guys": {"lines": "guys", "EA": EA, "prestress": TENSION}},
        "loads": {"weight": {"group": "top", "direction": [0, 0, -1]}},
        "stages": [{"name": "load", "loads": {"weight": 0.9 * critical()}, "steps": 2}],
        "probes": {
            "foot": {"kind": "body", "body": "mast", "of": "force", "component": "z"},
            "tilt": {"kind": "body", "body": "mast", "of": "rotation", "component": "magnitude"},
        },
        "solver": {"kind": "newton"},
        **changes,
    }  # fmt: skip
    return Scene.model_validate(scene), mesh


def critical() -> float:
    """P = 2 (L a²/l²) (EA/l₀ - T/l): stiffness of four guys at the top against the inverted pendulum of load and guys."""
    length = np.hypot(MAST, REACH)
    return float(2.0 * MAST * REACH**2 / length**2 * (EA - TENSION) / length)


def test_a_guyed_mast_stands_up_to_its_critical_load_and_no_further() -> None:
    scene, mesh = guyed()
    result = run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    last = result.steps[-1]
    assert last.stable
    assert last.probes["tilt"] < 1e-9
    assert last.probes["foot"] == pytest.approx(
        0.9 * critical() + 4.0 * TENSION * MAST / np.hypot(MAST, REACH), rel=1e-9
    )
    stages = [{"name": "load", "loads": {"weight": 1.2 * critical()}, "steps": 3, "until": "collapse"}]
    scene, mesh = guyed(stages=stages)
    limit = run(scene, mesh=mesh).steps[-1].limit
    assert limit is not None
    low, high = limit["load.weight"]
    assert low <= critical() * (1.0 + 1e-6)
    assert high >= critical() * (1.0 - 1e-6)
    assert high - low < 3e-3 * critical()


def test_a_mast_with_a_node_that_nothing_is_at_leans_alike_by_both_solvers() -> None:
    """Under a side load; its lines go through a point of its own, which carries nothing."""
    patch = np.array([[0.0, 90, 0], [1, 90, 0], [1, 91, 0]])
    loose = np.array(
        [[0, 0, 0], [0, 0, MAST], [0, 0, 1.0], [REACH, 0, 0], [-REACH, 0, 0], [0, REACH, 0], [0, -REACH, 0]]
    )
    mesh = Mesh.build(
        patch, [[0, 1, 2]], lines=[[3, 5], [5, 4], *([4, 6 + k] for k in range(4))],
        line_groups={"mast": [0, 1], "guys": [2, 3, 4, 5]}, loose_points=loose,
        loose_groups={"anchors": [6, 7, 8, 9], "top": [4]},
    )  # fmt: skip
    loads = {"side": {"group": "top", "direction": [1.0, 0.5, -2.0]}}
    found = []
    for kind in ("newton", "relaxation"):
        scene, _ = guyed(
            loads=loads, stages=[{"name": "lean", "loads": {"side": 20.0}}], solver={"kind": kind, "tolerance": 1e-8}
        )
        result = run(scene, mesh=mesh)
        assert result.converged, result.steps[-1].reason
        found.append(result.steps[-1].probes["tilt"])
    assert found[0] > 0.5
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_buckling_modes_of_the_mast_meet_its_critical_load() -> None:
    """Linear in the load: extrapolation is exact."""
    scene, mesh = guyed(
        modes={"kind": "buckling", "count": 3}, stages=[{"name": "load", "loads": {"weight": 0.5 * critical()}}]
    )
    modes = run(scene, mesh=mesh).steps[-1].modes
    assert modes is not None
    assert modes.values == pytest.approx((2.0, 2.0), rel=1e-6)
    assert len(modes.values) == 2  # a turn about the mast itself is none
    assert np.linalg.norm(modes.shapes, axis=(1, 2)) == pytest.approx(1.0, rel=1e-6)  # of the top alone


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bodies": {"plate": {"group": "nowhere"}}}, "bodies.plate.group: no node group 'nowhere'"),
        ({"bodies": {"plate": {"group": "start"}}}, "12 of the body's 12 in all; hold the body by its hold and turn_hold"),
        ({"bodies": {"plate": {"group": "tip"}}}, "bodies.plate: a body needs two nodes or more, but its group holds 1"),
        ({"bodies": {"plate": {"group": "cap_end"}, "rim": {"group": "end"}}}, "bodies.rim: node .* is in body 'plate' as well"),
        ({"bodies": {"plate": {"group": "cap_end"}, "middle": {"group": "end"}}}, "the mesh has a node group 'middle' of 12 nodes"),
        ({"bodies": {"plate": {"group": "cap_end", "turn_hold": "x"}}}, "finite rotations about two axes make one about the third"),
        ({"bodies": {"plate": {"group": "cap_end", "lines": "rope"}}}, "give either group .* or lines"),
        ({"loads": {"push": {"kind": "body", "body": "late", "force": [0, 0, 1]}}}, "loads.push.body: .*'late'.*plate"),
        ({"loads": {"push": {"kind": "body", "body": "plate"}}}, "give a force or a moment other than zero"),
        (
            {"loads": {"push": {"kind": "body", "body": "plate", "moment": [1, 0, 0], "couple": "axial"}}},
            "body 'plate' may turn about x and y and z",
        ),
        (
            {"loads": {"push": {"kind": "body", "body": "plate", "force": [1, 0, 0], "at": [9, 0, 0]}}},
            "loads.push.at: the force acts at .* off the plane",
        ),
        (
            {
                "bodies": {"plate": {"group": "cap_end", "turn_hold": "xyz"}},
                "motions": {"turn": {"kind": "body_rotation", "body": "plate", "axis": [1, 0, 0]}},
            },
            "bodies.plate.turn_hold holds rotations that the motion prescribes",
        ),
        (
            {
                "bodies": {"plate": {"group": "cap_end", "hold": "xz"}},
                "motions": {"shift": {"kind": "body_translation", "body": "plate", "direction": [1, 0, 0], "hold": "yz"}},
            },
            "motions.shift: displacement z of body 'plate' is already held",
        ),
        ({"planes": {"floor": {"through": [0, 0, -2], "normal": [0, 0, 1]}}}, "contact is not implemented for a scene with bodies"),
    ],
)  # fmt: skip
def test_mistakes_get_one_clear_message(changes: dict[str, Any], words: str) -> None:
    def work() -> None:
        scene = tube(**changes)
        build_model(scene, build_mesh(scene))

    with pytest.raises((InputError, ValueError), match=words):
        work()
