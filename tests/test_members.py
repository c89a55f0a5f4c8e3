"""Cables and planes: against closed forms, and against the forces' own differences."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from differences import check_components
from scipy.optimize import fsolve

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.preparation import Cables, FabricConstants
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def hanging(pieces: int) -> Mesh:
    """A chain of lines from (0, 0, 0) to (10, 0, -2) beside a small patch that has nothing to do with it."""
    patch = np.array([[0.0, 5, 0], [1, 5, 0], [1, 6, 0], [0, 6, 0]])
    chain = np.linspace([0.0, 0, 0], [10, 0, -2], pieces + 1)
    ends = 4 + np.column_stack([np.arange(pieces), np.arange(1, pieces + 1)])
    return Mesh.build(
        patch, [[0, 1, 2], [0, 2, 3]], lines=ends, line_groups={"rope": np.arange(pieces)}, loose_points=chain,
        loose_groups={"ends": [4, 4 + pieces], "inner": np.arange(5, 4 + pieces), "rope": np.arange(4, 5 + pieces)},
    )  # fmt: skip


def rope(pieces: int, **changes: Any) -> Scene:
    """A cable 12 long, EA = 300, of weight 1 per length, between points 10.198 apart."""
    length = 12.0
    return Scene.model_validate(
        {
            "name": "rope",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
            "supports": [{"group": "patch", "hold": "xyz"}, {"group": "ends", "hold": "xyz"}],
            "groups": {"patch": {"where": "y > 4"}},
            "cables": {"rope": {"lines": "rope", "EA": 300.0, "unstressed": length / np.hypot(10.0, 2.0)}},
            "loads": {
                "weight": {"group": "inner", "direction": [0, 0, -length * (pieces - 1) / pieces], "spread": "equal"}
            },
            "stages": [{"name": "hang", "loads": {"weight": 1.0}}],
            "solver": {"kind": "newton", "tolerance": 1e-10},
            **changes,
        }
    )


def catenary(length: float, stiffness: float, weight: float, span: tuple[float, float]) -> Any:
    """Horizontal force H, vertical force V at the first end, and the place of a point of arc length s.

    H. M. Irvine, Cable Structures (1981): the elastic catenary.
    """

    def place(h: float, v: float, s: Any) -> Any:
        rest = v - weight * s
        x = h * s / stiffness + h / weight * (np.arcsinh(v / h) - np.arcsinh(rest / h))
        z = weight * s / stiffness * (v / weight - s / 2) + h / weight * (np.hypot(1, v / h) - np.hypot(1, rest / h))
        return np.array([x, -z])

    h, v = fsolve(lambda q: place(*q, length) - span, [0.5 * weight * length, 0.5 * weight * length], xtol=1e-13)
    return float(h), float(v), lambda s: place(h, v, s)


def test_a_cable_of_its_own_nodes_hangs_in_an_elastic_catenary() -> None:
    """Shape and force against the closed form, at second order; from slack and straight."""
    h, _, place = catenary(12.0, 300.0, 1.0, (10.0, -2.0))
    errors = []
    for pieces in (8, 16, 32):
        result = run(rope(pieces), mesh=hanging(pieces))
        assert result.converged, result.steps[-1].reason
        step, mesh = result.steps[-1], result.mesh
        nodes = mesh.node_groups["rope"]
        found = (mesh.points + step.displacement)[nodes][:, [0, 2]]
        exact = place(np.linspace(0.0, 12.0, pieces + 1)).T
        errors.append([np.abs(found - exact).max(), abs(abs(step.reaction[nodes[0], 0]) / h - 1.0)])
        pull = np.linalg.norm(step.reaction[nodes[0]])
        assert step.cable_forces[0] == pytest.approx(pull, rel=1e-8)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert max(errors[-1]) < 2e-3


def crossed(*, bars: bool) -> System:
    """Three triangles with cables along edges and across them, in a random state in which some are in compression."""
    rng = np.random.default_rng(0)
    mesh = Mesh.build(rng.normal(size=(5, 3)), [[0, 1, 2], [1, 3, 2], [3, 4, 2]])
    nodes = np.array([[0, 1], [3, 0], [4, 1], [2, 3], [0, 4]], dtype=np.int32)
    distance = np.linalg.norm(mesh.points[nodes[:, 1]] - mesh.points[nodes[:, 0]], axis=1)
    structure = Structure(
        mesh=mesh,
        fabrics=(FabricConstants(e_warp=3.0, e_weft=3.0, poisson=0.3, shear=3.0 / 2.6, thickness=0.2, law="none"),),
        tri_fabric=np.zeros(3, dtype=np.int32),
        tri_warp=mesh.points[mesh.triangles[:, 1]] - mesh.points[mesh.triangles[:, 0]],
        node_held=np.zeros((5, 3), dtype=bool),
        tri_chamber=np.full(3, -1, dtype=np.int32),
        loads=False,
        cables=Cables(
            nodes=nodes,
            length=distance * rng.uniform(0.7, 1.3, 5),
            stiffness=rng.uniform(1.0, 9.0, 5),
            prestress=rng.uniform(-0.5, 0.5, 5),
            bar=np.full(5, bars),
        ),
    )
    system = System(structure)
    system.set_displacement(rng.normal(size=(5, 3)) * 0.3)
    return system


@pytest.mark.parametrize("bars", [False, True])
def test_cable_forces_come_from_their_energy_the_tangent_from_the_forces_and_masses_bound_it(bars: bool) -> None:
    """Central differences, with slack cables or compressed bars among them, and pairs that share an edge with triangles."""
    system = crossed(bars=bars)
    assert system.cables is not None
    forces = system.cables.forces()
    assert (forces > 0.0).any()
    assert (forces < 0.0).any() if bars else (forces == 0.0).any()
    check_components(system, to=1e-8)


def strip(*, precision_tolerance: float = 1e-10, kind: str = "newton", **changes: Any) -> Scene:
    """A strip 1 long under a tension of 0.1 per width, blown against a plane 0.005 above it.

    As z" = -p/T, it leaves the supports in a parabola that touches the plane at a = √(2 T h/p) = 1/4; p (1 - 2 a) is then left to
    the plane, for each width. Slopes of 0.04 and the stretch that comes with them change that by a thousandth.
    """
    return Scene.model_validate(
        {
            "name": "strip",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 0.25, "along_x": 16, "along_y": 2},
            "fabric": {"E": 100.0, "nu": 0.0, "thickness": 0.01, "prestress": [10.0, 10.0, 0.0], "warp": [1, 0, 0]},
            "supports": [
                {"group": "x_min", "hold": "xz"},
                {"group": "x_max", "hold": "xz"},
                {"group": "all", "hold": "y"},
            ],
            "planes": {"lid": {"through": [0.0, 0.0, 0.005], "normal": [0, 0, -2.0]}},
            "stages": [{"name": "blow", "pressure": 0.016, "steps": 2}],
            "probes": {"top": {"kind": "displacement", "group": "all", "component": "z"}},
            "solver": {"kind": kind, "tolerance": precision_tolerance},
            **changes,
        }
    )


def test_a_strip_lies_against_a_plane_as_far_as_the_closed_form_says() -> None:
    """Contact force, no node beyond the plane, balance; Newton and relaxation alike, and from the state of a stopped run."""
    result = run(strip())
    assert result.converged, result.steps[-1].reason
    step, mesh = result.steps[-1], result.mesh
    pressing = 0.016 * 0.25
    assert step.contact_forces["lid"] == pytest.approx(0.5 * pressing, rel=5e-3)
    assert step.displacement[:, 2].max() < 0.005 + 1e-9
    touching = step.displacement[:, 2] > 0.005 - 1e-9
    assert np.abs(mesh.points[touching, 0] - 0.5).max() == pytest.approx(0.25, abs=1 / 16)
    # The plane under the displaced strip is as wide as the strip, so that pressure's vertical sum is p times its area.
    assert step.reaction[:, 2].sum() - step.contact_forces["lid"] + pressing == pytest.approx(0.0, abs=1e-9 * pressing)
    relaxed = run(strip(kind="relaxation", precision_tolerance=1e-8))
    assert relaxed.converged, relaxed.steps[-1].reason
    assert np.abs(relaxed.steps[-1].displacement - step.displacement).max() < 1e-6 * 0.005


SINGLE = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import test_members
from taichi_membrane.execution.run import run
steps = [run(test_members.strip(kind="relaxation", precision_tolerance=3e-5), precision="f32").steps[-1]]
np.savez(sys.argv[2], displacement=steps[0].displacement, force=steps[0].contact_forces["lid"], ok=steps[0].converged)
"""


def test_a_plane_is_met_in_single_precision(tmp_path: Path) -> None:
    """Gaps read both parts of a displacement."""
    here, file = Path(__file__).parent, tmp_path / "single.npz"
    subprocess.run([sys.executable, "-c", SINGLE, str(here), str(file)], check=True, cwd=here.parent)
    found = np.load(file)
    assert found["ok"]
    assert found["force"] == pytest.approx(0.5 * 0.016 * 0.25, rel=1e-2)
    assert found["displacement"][:, 2].max() < 0.005 * (1 + 1e-4)


def test_without_cables_and_planes_there_is_no_field_of_theirs() -> None:
    """And ``check`` lists them as left out; with them, as compiled in."""
    names = ("cables", "sliding cables", "springs to the ground", "contact with obstacles")
    plain = build_model(strip(planes={}), build_mesh(strip(planes={}))).structure
    fields = {name for name, _ in System(plain).fields()}
    assert not any(name.startswith(("cable_", "rope_", "spring_", "plane_", "node_contact")) for name in fields)
    assert set(names) <= set(plain.features().describe()[1])
    lines = {
        "edge": {"along": "x_max", "EA": 5.0},
        "tie": {"nodes": ["corner_00", "corner_11"], "EA": 5.0, "kind": "bar"},
        "rope": {"nodes": ["corner_00", "corner_10", "corner_11"], "EA": 5.0, "sliding": True},
    }
    springs = {"pad": {"group": "x_max", "stiffness": [1.0, 0.0, 0.0]}}
    both = build_model(strip(cables=lines, springs=springs), build_mesh(strip())).structure
    assert any(name.startswith("rope_") for name, _ in System(both).fields())
    assert set(names) <= set(both.features().describe()[0])
    assert both.cables is not None
    assert len(both.cables.nodes) == 3
    assert both.cables.bar.tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"cables": {"c": {"along": "x_max", "nodes": ["a", "b"], "EA": 1.0}}}, "give one of along, lines and nodes"),
        ({"cables": {"c": {"along": "rim", "EA": 1.0}}}, r"cables\.c\.along: no node group 'rim'"),
        ({"cables": {"c": {"lines": "rope", "EA": 1.0}}}, r"cables\.c\.lines: no group of lines 'rope'.*\(none\)"),
        ({"cables": {"c": {"nodes": ["x_min", "corner_11"], "EA": 1.0}}}, r"'x_min' holds 3 nodes; each must hold one"),
        ({"planes": {"p": {"through": [0, 0, 1], "normal": [0, 0, 0]}}}, "a direction needs a length"),
        ({"derivatives": ["top"]}, "derivatives is not implemented for a scene with planes"),
        (
            {"stages": [{"name": "s", "control": "arc_length"}]},
            "arc_length' is not implemented for a scene with planes",
        ),
        *(
            (
                {"stages": [{"name": "s", "until": until}]},
                f"until = '{until}' is not implemented for a scene with planes",
            )
            for until in ("collapse", "collapse_or_target")
        ),
    ],
)
def test_bad_cables_and_planes_are_refused(changes: dict[str, Any], told: str) -> None:
    def read() -> None:
        scene = strip(**changes)
        build_model(scene, build_mesh(scene))

    with pytest.raises((InputError, ValueError), match=told):
        read()
