"""Cables in a scene alone, those that slide, and springs: against closed forms, and against the forces' own differences."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from differences import check_components
from test_members import catenary

import taichi_membrane as tm
from taichi_membrane.mechanics.preparation import FabricConstants, Ropes, Springs
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def scene(**changes: Any) -> Scene:
    """Cables beside a panel that is held all over."""
    return Scene.model_validate(
        {
            "name": "cables",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 1, "along_y": 1},
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0, "mass_per_area": 1.0},
            "pressures": {},
            "supports": [{"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}],
            "stages": [{"name": "load", "loads": {"weight": 1.0}}],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            "camera": {"size": [320, 240]},
        }
        | changes
    )


def pulley(ratio: float, EA: float, **changes: Any) -> Scene:
    """A rope over level supports 1 apart, ``ratio`` long, with a pulley of weight 1 a third of the way along."""
    return scene(
        anchors={"left": [0.0, 5.0, 0.0], "right": [1.0, 5.0, 0.0]},
        joints={"pulley": [0.3, 5.0, -0.2]},
        cables={"rope": {"nodes": ["left", "pulley", "right"], "EA": EA, "length": ratio, "sliding": True}},
        loads={"weight": {"group": "pulley", "direction": [0, 0, -1]}},
        probes={
            "force": {"kind": "cable", "cable": "rope"},
            "length": {"kind": "cable", "cable": "rope", "what": "length"},
            "slack": {"kind": "cable", "cable": "rope", "what": "slack"},
            "sag": {"kind": "displacement", "group": "pulley", "component": "z"},
            "side": {"kind": "displacement", "group": "pulley", "component": "x"},
            "left": {"kind": "reaction", "group": "left", "component": "z"},
            "pad": {"kind": "reaction", "group": "pulley", "component": "z"},
        },
        **changes,
    )


@pytest.mark.parametrize(
    ("ratio", "force", "sag"), [(1.05, 1.639824, 0.160078), (1.2, 0.904534, 0.331662), (1.5, 0.670820, 0.559017)]
)
def test_a_frictionless_pulley_hangs_in_the_middle(ratio: float, force: float, sag: float) -> None:
    """T = W/(2 sin a) with cos a = s/l and l = L (1 + T/EA), to round-off; twice the stiffer less the softer is inextensible."""
    found = [tm.run(pulley(ratio, EA)).steps[-1].probes for EA in (1e5, 2e5)]
    for values, EA in zip(found, (1e5, 2e5), strict=True):
        length = ratio * (1.0 + values["force"] / EA)
        assert values["length"] == pytest.approx(length, rel=1e-9)
        assert values["force"] * np.sqrt(1.0 - 1.0 / length**2) == pytest.approx(0.5, rel=1e-9)
        assert values["side"] == pytest.approx(0.2, abs=1e-9)
        assert values["left"] == pytest.approx(0.5, rel=1e-9)
        assert values["slack"] == 0.0
    assert 2.0 * found[1]["force"] - found[0]["force"] == pytest.approx(force, rel=1e-6)
    assert 0.2 - (2.0 * found[1]["sag"] - found[0]["sag"]) == pytest.approx(sag, abs=1e-6)


def test_relaxation_finds_the_pulley_as_well() -> None:
    """By the mass bound alone."""
    solver = {"kind": "relaxation", "tolerance": 1e-9}
    values = tm.run(pulley(1.2, 20.0, solver=solver)).steps[-1].probes
    assert values["force"] == pytest.approx(25.0 / 30.0, rel=1e-7)  # l = 1.25: sin a = 3/5


def test_a_counterweight_hangs_over_a_pulley() -> None:
    """The rope's free end is held along the rope by the one force alone; the other part has it too, whatever its direction."""
    result = tm.run(
        scene(
            anchors={"foot": [0.0, 5.0, 0.0], "wheel": [1.0, 5.0, 1.0]},
            joints={"bucket": [2.0, 5.0, 0.0]},
            cables={"rope": {"nodes": ["foot", "wheel", "bucket"], "EA": 50.0, "sliding": True}},
            loads={"weight": {"group": "bucket", "direction": [0, 0, -2]}},
            probes={
                "force": {"kind": "cable", "cable": "rope"},
                "foot": {"kind": "reaction", "group": "foot", "component": "x"},
                "wheel": {"kind": "reaction", "group": "wheel", "component": "z"},
                "down": {"kind": "displacement", "group": "bucket", "component": "z"},
                "in": {"kind": "displacement", "group": "bucket", "component": "x"},
            },
        )
    )
    step = result.steps[-1]
    assert step.converged, step.reason
    assert step.stable
    found, root = step.probes, np.sqrt(2.0)
    assert found["force"] == pytest.approx(2.0, rel=1e-9)
    assert found["foot"] == pytest.approx(-root, rel=1e-9)
    assert found["wheel"] == pytest.approx(2.0 + root, rel=1e-9)
    assert found["in"] == pytest.approx(-1.0, abs=1e-9)
    assert 1.0 - 1.0 - found["down"] == pytest.approx(2 * root * (1 + 2 / 50) - root - 1.0, rel=1e-9)


SINGLE = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import test_cables
from taichi_membrane.execution.run import run
solver = {"kind": "relaxation", "tolerance": 1e-5}
springs = {"pad": {"group": "pulley", "stiffness": 0.5, "direction": [0, 0, -1], "kind": "tension"}}
one = run(test_cables.pulley(1.2, 20.0, solver=solver), precision="f32").steps[-1]
both = run(test_cables.pulley(1.2, 20.0, solver=solver, springs=springs), precision="f32").steps[-1]
assert one.converged and both.converged
np.savez(sys.argv[2], force=one.probes["force"], held=both.probes["force"], left=both.probes["left"], pad=both.probes["pad"])
"""


def test_single_precision_finds_the_pulley_with_and_without_a_spring(tmp_path: Path) -> None:
    """The spring takes its share of the weight, half its stiffness times how far the pulley goes down."""
    here, file = Path(__file__).parent, tmp_path / "single.npz"
    subprocess.run([sys.executable, "-c", SINGLE, str(here), str(file)], check=True, cwd=here.parent)
    found = np.load(file)
    assert found["force"] == pytest.approx(25.0 / 30.0, rel=1e-4)
    assert 2.0 * found["left"] + found["pad"] == pytest.approx(1.0, rel=1e-4)
    assert 0.01 < found["pad"] < 0.2
    assert found["held"] < found["force"]


def alone(ropes: Ropes | None = None, springs: Springs | None = None) -> System:
    """A soft strip of three triangles with what hangs on its nodes, in a random state."""
    rng = np.random.default_rng(3)
    mesh = Mesh.build(rng.normal(size=(5, 3)), [[0, 1, 2], [1, 3, 2], [3, 4, 2]])
    structure = Structure(
        mesh=mesh,
        fabrics=(FabricConstants(e_warp=0.3, e_weft=0.3, poisson=0.3, shear=0.3 / 2.6, thickness=0.2, law="none"),),
        tri_fabric=np.zeros(3, dtype=np.int32),
        tri_warp=mesh.points[mesh.triangles[:, 1]] - mesh.points[mesh.triangles[:, 0]],
        node_held=np.zeros((5, 3), dtype=bool),
        tri_chamber=np.full(3, -1, dtype=np.int32),
        loads=False,
        ropes=ropes,
        springs=springs,
    )
    system = System(structure)
    system.set_displacement(rng.normal(size=(5, 3)) * 0.3)
    return system


@pytest.mark.parametrize("length", [0.8, 3.0], ids=["taut", "slack"])
def test_forces_of_sliding_cables_come_from_their_energy_and_masses_bound_them(length: float) -> None:
    """An open one, a closed one and one of a single piece; they pass along edges and across them, and share nodes."""
    ropes = Ropes(
        chain=np.array([0, 3, 1, 4, 2, 4, 0, 1, 3]),
        start=np.array([0, 4, 7, 9]),
        closed=np.array([False, True, False]),
        length=length * np.array([6.0, 6.0, 2.0]),
        stiffness=np.array([9.0, 4.0, 2.0]),
        prestress=np.array([0.3, 0.0, -0.1]),
    )
    assert ropes.sides.tolist() == [[0, 3], [3, 1], [1, 4], [2, 4], [4, 0], [0, 2], [1, 3]]
    system = alone(ropes)
    forces = system.cable_forces()
    assert forces.shape == (7,)
    assert (forces[:6] > 0.0).all() == (length < 1.0)
    assert np.ptp(forces[:3]) == 0.0
    check_components(system, to=1e-7)


def test_forces_of_springs_come_from_their_energy_and_masses_bound_them() -> None:
    """Two at one node, and one each that bears tension and compression only, at work or not."""
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(6, 3))
    springs = Springs(
        nodes=np.array([0, 0, 1, 2, 3, 4]),
        stiffness=rng.uniform(1.0, 5.0, 6),
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        kind=np.array([0, 0, 1, -1, 1, -1]),
    )
    system = alone(springs=springs)
    check_components(system, to=1e-7)
    assert system.springs is not None
    u = system.displacement()
    works = np.einsum("ij,ij->i", u[springs.nodes], springs.direction) * springs.kind
    assert (works[2:] > 0.0).any()
    assert (works[2:] < 0.0).any()
    # What the host says of them is what the device sums.
    whole, without = system.out_of_balance(), alone().out_of_balance()
    assert whole - without == pytest.approx(system.springs.forces(u), abs=1e-12)


def hung(parts: int, **changes: Any) -> Scene:
    """An elastic cable 12 long, EA = 300, of weight 1 per length, between anchors 10 apart and 2 below each other."""
    return scene(
        anchors={"high": [0.0, 5.0, 0.0], "low": [10.0, 5.0, -2.0]},
        cables={
            "rope": {"nodes": ["high", "low"], "parts": parts, "length": 12.0, "EA": 300.0, "mass_per_length": 1.0}
        },
        loads={"weight": {"kind": "weight", "g": 1.0}},
        probes={
            "pull": {"kind": "cable", "cable": "rope"},
            "least": {"kind": "cable", "cable": "rope", "reduce": "min"},
            "mean": {"kind": "cable", "cable": "rope", "reduce": "mean"},
            "slack": {"kind": "cable", "cable": "rope", "what": "slack"},
            "length": {"kind": "cable", "cable": "rope", "what": "length"},
            "across": {"kind": "reaction", "group": "high", "component": "x"},
            "up": {"kind": "reaction", "group": "high", "component": "z"},
        },
        **changes,
    )


def test_a_scene_alone_says_an_elastic_catenary() -> None:
    """Forces, present length and shape at second order; anchors bear all of the weight."""
    h, v, place = catenary(12.0, 300.0, 1.0, (10.0, -2.0))
    arc = np.linspace(0.0, 12.0, 20_001)
    tension = np.hypot(h, v - 0.5 * (arc[1:] + arc[:-1]))
    length = float(((1.0 + tension / 300.0) * np.diff(arc)).sum())
    errors = []
    for parts in (8, 16, 32):
        result = tm.run(hung(parts))
        step, mesh = result.steps[-1], result.mesh
        assert step.converged, step.reason
        ends = [mesh.node_groups["high"], mesh.node_groups["rope"], mesh.node_groups["low"]]
        found = (mesh.points + step.displacement)[np.concatenate(ends)][:, [0, 2]]
        exact = place(np.linspace(0.0, 12.0, parts + 1)).T
        errors.append(
            [np.abs(found - exact).max(), abs(-step.probes["across"] / h - 1), abs(step.probes["length"] / length - 1)]
        )
        assert step.probes["least"] <= step.probes["mean"] <= step.probes["pull"]
        assert step.probes["slack"] == 0.0
        assert step.reaction[[ends[0][0], ends[2][0]], 2].sum() == pytest.approx(12.0, rel=1e-9)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert max(errors[-1]) < 2e-3


@pytest.mark.parametrize(("spokes", "share"), [(8, 1.306563), (12, 1.931852), (36, 5.736857)])
def test_a_ring_bears_the_forces_of_its_spokes(spokes: int, share: float) -> None:
    """N = F/(2 sin(π/n)), and the radius at which ring and spokes agree on it."""
    angle = 2.0 * np.pi * np.arange(spokes) / spokes
    places = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) + np.array([0.0, 9.0, 0.0])
    joints = {f"rim{k}": tuple(place) for k, place in enumerate(places)}
    outer = {f"peg{k}": tuple(2.0 * place - np.array([0.0, 9.0, 0.0])) for k, place in enumerate(places)}
    result = tm.run(
        scene(
            anchors=outer,
            joints=joints,
            cables={
                "ring": {"nodes": [*joints, "rim0"], "EA": 400.0, "kind": "bar"},
                **{f"spoke{k}": {"nodes": [f"rim{k}", f"peg{k}"], "EA": 50.0, "prestress": 3.0} for k in range(spokes)},
            },
            loads={},
            stages=[{"name": "load"}],
            probes={
                "ring": {"kind": "cable", "cable": "ring", "reduce": "min"},
                "spoke": {"kind": "cable", "cable": "spoke1"},
                "girth": {"kind": "cable", "cable": "ring", "what": "length"},
            },
        )
    )
    found = result.steps[-1].probes
    assert result.converged, result.steps[-1].reason
    assert found["ring"] / found["spoke"] == pytest.approx(share, abs=5e-7)
    # 400 (ρ - 1) = (3 - 50 (ρ - 1))/(2 sin(π/n)), ρ the radius.
    half = 1.0 / (2.0 * np.sin(np.pi / spokes))
    growth = 3.0 * half / (400.0 + 50.0 * half)
    assert found["girth"] == pytest.approx(2.0 * spokes * np.sin(np.pi / spokes) * (1.0 + growth), rel=1e-9)


def test_a_prestressed_net_sags_as_the_discrete_membrane_does() -> None:
    """Joints of a square net under H per cable and a small load P at each: H times the difference of slopes is P, exactly."""
    count, pull, load = 5, 2.0, 1e-5
    inner = {f"j{a}_{b}": (float(a), 9.0 + b, 0.0) for a in range(1, count + 1) for b in range(1, count + 1)}
    ends = {}
    cables: dict[str, Any] = {}
    for k in range(1, count + 1):
        ends |= {f"w{k}": (0.0, 9.0 + k, 0.0), f"e{k}": (count + 1.0, 9.0 + k, 0.0)}
        ends |= {f"s{k}": (float(k), 9.0, 0.0), f"n{k}": (float(k), 10.0 + count, 0.0)}
        row = [f"j{a}_{k}" for a in range(1, count + 1)]
        column = [f"j{k}_{b}" for b in range(1, count + 1)]
        cables[f"row{k}"] = {"nodes": [f"w{k}", *row, f"e{k}"], "EA": 1.0, "prestress": pull}
        cables[f"column{k}"] = {"nodes": [f"s{k}", *column, f"n{k}"], "EA": 1.0, "prestress": pull}
    result = tm.run(
        scene(
            anchors=ends, joints=inner, cables=cables,
            loads={name: {"group": name, "direction": [0, 0, -1]} for name in inner},
            stages=[{"name": "load", "loads": dict.fromkeys(inner, load)}],
            probes={name: {"kind": "displacement", "group": name, "component": "z"} for name in inner},
        )
    )  # fmt: skip
    assert result.converged, result.steps[-1].reason
    assert result.steps[-1].stable
    # Eigenvectors of the second difference with fixed ends are sines.
    numbers = np.arange(1, count + 1)
    sine = np.sin(np.pi * np.outer(numbers, numbers) / (count + 1)) * np.sqrt(2.0 / (count + 1))
    value = 2.0 - 2.0 * np.cos(np.pi * numbers / (count + 1))
    sag = sine @ ((sine @ np.full((count, count), load / pull) @ sine) / (value[:, None] + value[None, :])) @ sine
    for name in inner:
        a, b = map(int, name[1:].split("_"))
        assert result.steps[-1].probes[name] == pytest.approx(-sag[a - 1, b - 1], rel=1e-7)


def test_springs_to_the_ground_share_a_load_with_their_reactions() -> None:
    """A rigid-like hanging node on springs: displacement k⁻¹ F, reactions -F; what bears compression only lets go."""
    base: dict[str, Any] = {
        "joints": {"pile": [0.0, 5.0, 0.0], "lid": [1.0, 5.0, 0.0]},
        "cables": {"beam": {"nodes": ["pile", "lid"], "EA": 1e3, "kind": "bar"}},
        "springs": {
            "soil": {"group": "pile", "stiffness": [4.0, 5.0, 8.0]},
            "pad": {"group": "lid", "stiffness": 2.0, "direction": [0, 0, 3], "kind": "compression"},
            "side": {"group": "lid", "stiffness": [0.0, 1.0, 0.0]},
        },
        "probes": {
            "pile": {"kind": "displacement", "group": "pile", "component": "z"},
            "lid": {"kind": "displacement", "group": "lid", "component": "z"},
            "ground": {"kind": "reaction", "group": "pile", "component": "z"},
            "pad": {"kind": "reaction", "group": "lid", "component": "z"},
        },
    }
    down = {"loads": {"weight": {"group": "lid", "direction": [0, 0, -1e-3]}}}
    values = tm.run(scene(**base, **down)).steps[-1]
    assert values.converged, values.reason
    assert values.stable
    # All of it goes to the pad, but for the turn of the beam, (1e-3/2)² of its length.
    assert values.probes["lid"] == pytest.approx(-1e-3 / 2.0, rel=1e-5)
    assert values.probes["pad"] == pytest.approx(1e-3, rel=1e-5)
    assert values.probes["ground"] + values.probes["pad"] == pytest.approx(1e-3, rel=1e-9)
    push = {"loads": {"weight": {"group": "pile", "direction": [0, 0, -1.6]}}}
    held = tm.run(scene(**base | {"cables": {"beam": base["cables"]["beam"] | {"EA": 1e-3}}}, **push)).steps[-1]
    assert held.probes["ground"] == pytest.approx(1.6, rel=1e-3)
    assert held.probes["pile"] == pytest.approx(-0.2, rel=1e-3)
