"""Wind by pressure coefficients: exact forces and shapes, its tangent where it jumps, going on, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import ISOTROPIC, closed_body
from resume_cases import run_until
from run_files import different, outcome
from scipy.optimize import fsolve
from test_rim import modelled
from test_snow import assert_work, crumpled, whole_tangent

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.system import System
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh
from taichi_membrane.simulation.solver_choice import without_potential
from taichi_membrane.simulation.surface_loads import surface_loads_of

pytestmark = pytest.mark.usefixtures("runtime_cpu")

# Potential flow about a sphere: cp = 1 - 9/4 sin² of the angle from the windward side.
ANGLES = np.linspace(0.0, 180.0, 721)
SPHERE = {"direction": [3.0, 0.0, 4.0], "centre": [0.0, 0.0, 0.0]}
FLOW = {"angles": ANGLES.tolist(), "cp": (1.0 - 2.25 * np.sin(np.radians(ANGLES)) ** 2).tolist()}


def ball(wind: dict[str, Any], divisions: int = 3, **changes: Any) -> Scene:
    """A sphere held at its foot, with pressure inside and wind of q = 2."""
    return Scene.model_validate(
        {
            "name": "ball",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "sphere", "radius": 1.0, "divisions": divisions},
            "groups": {
                "foot": {"where": "z < -0.3"},
                "half": {"where": "x > 0", "kind": "elements"},
                "upper": {"where": "z > 0", "kind": "elements"},
                "front": {"where": "x < 0", "kind": "elements"},
            },
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"},
            "supports": [{"group": "foot", "hold": "xyz"}],
            "loads": {"wind": {"kind": "wind", "q": 2.0, **wind}},
            "stages": [{"name": "blow", "pressure": 1.0, "loads": {"wind": 0.2}}],
            "probes": {"x": {"kind": "displacement", "group": "north", "component": "x"}},
            "derivatives": ["x"],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def test_suction_all_round_is_a_pressure_inside() -> None:
    """The same states, energies and derivatives to round-off, from either face; no jump, so that there is a potential."""
    blown = ball({"cp": {"all": -1.0}}, stages=[{"name": "blow", "pressure": 0.6, "loads": {"wind": 0.2}}])
    from_back = ball({"cp": {"all": 1.0}, "face": "back"}, stages=[{"name": "blow", "loads": {"wind": 0.5}}])
    steps = [
        run(scene).steps[-1]
        for scene in (blown, from_back, ball({}, loads={}, stages=[{"name": "a", "pressure": 1.0}]))
    ]
    for step in steps[:2]:
        assert step.converged
        assert np.abs(step.displacement - steps[2].displacement).max() < 1e-12
        assert step.energy == pytest.approx(steps[2].energy, rel=1e-12)
        slope = 2.0 * steps[2].derivatives["x"]["pressure.inside"]
        assert step.derivatives["x"]["load.wind"] == pytest.approx(slope, rel=1e-6, abs=1e-12)
    assert without_potential(modelled(blown)) == ""


def test_the_lift_on_a_hemisphere_in_potential_flow() -> None:
    """11/16 π q R² on its outside and no drag, at second order; the nodal forces of the engine are the same."""
    flow = FLOW | {"direction": [3.0, 0.0, 0.0], "centre": [0.0, 0.0, 0.0], "group": "upper"}
    errors = []
    for divisions in (8, 16, 32):
        scene = ball({"table": flow}, divisions)
        mesh = build_mesh(scene)
        force = surface_loads_of(scene, mesh).at_rest("wind").sum(axis=0)
        errors.append(abs(force[2] / (2.0 * 11.0 / 16.0 * np.pi) - 1.0))
        assert np.abs(force[:2]).max() < 1e-3
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert errors[-1] < 4e-3
    model = modelled(ball({"table": flow}))
    system = System(model.structure)
    system.set_surface_loads(np.array([0.0, 0.7]))
    assert np.abs(system.out_of_balance() - 0.7 * model.surface.at_rest("wind")).max() < 1e-14


def test_no_drag_and_no_lift_on_a_whole_sphere_in_potential_flow() -> None:
    """D'Alembert: the resultant vanishes at second order, on meshes without any symmetry of the flow."""
    errors = []
    for divisions in (8, 16, 32):
        even = build_mesh(ball({"table": FLOW | SPHERE}, divisions))
        moved = even.points + np.array([0.3, 0.2, -0.15])  # denser on one side; back on the sphere
        mesh = Mesh.build(moved / np.linalg.norm(moved, axis=1, keepdims=True), even.triangles)
        scene = ball({"table": {"flow": "potential", **SPHERE}}, groups={}, mesh={"shape": "given"})
        force = surface_loads_of(scene, mesh).at_rest("wind").sum(axis=0)
        errors.append(np.linalg.norm(force) / (2.0 * np.pi))
    assert np.abs(np.log2(np.array(errors[:-1]) / np.array(errors[1:])) - 2.0).max() < 0.1
    assert errors[-1] < 1e-3


def test_potential_flow_is_that_of_its_closed_forms() -> None:
    """A table of the sphere's, dense; on a cylinder the wind's part across the axis, 1 - 4 sin² of it."""
    mesh = build_mesh(ball({"cp": {"all": 1.0}}, 8))
    found = [
        surface_loads_of(ball({"table": one | SPHERE}, 8), mesh).winds["wind"] for one in ({"flow": "potential"}, FLOW)
    ]
    assert np.abs(found[0] - found[1]).max() < 1e-4
    pole = mesh.points[mesh.triangles].mean(axis=1) @ np.array([3.0, 0.0, 4.0]) / 5.0
    assert -found[0][pole.argmin()] == pytest.approx(2.0, abs=0.1)
    tube = {"shape": "tube", "radius": 1.0, "length": 2.0, "around": 16, "along": 4, "cap_end": "none"}
    flow = {"flow": "potential", "direction": [3.0, 4.0, 0.0], "centre": [7.0, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]}
    scene = ball(
        {"table": flow}, mesh=tube, groups={}, supports=[{"group": "start", "hold": "xyz"}], probes={}, derivatives=[]
    )
    mesh = build_mesh(scene)
    y, z = mesh.points[mesh.triangles].mean(axis=1)[:, 1:].T
    exact = -2.0 * 0.8**2 * (1.0 - 4.0 * z**2 / (y**2 + z**2))
    assert np.abs(surface_loads_of(scene, mesh).winds["wind"] - exact).max() < 1e-14


def test_the_drag_on_a_cylinder_is_that_of_its_table() -> None:
    """A lying tube, wind square to it: cp = cos θ gives π q R of drag per length; second order."""
    errors = []
    for around in (16, 32, 64):
        scene = ball(
            {"table": {"angles": ANGLES.tolist(), "cp": np.cos(np.radians(ANGLES)).tolist(), "direction": [5.0, 1.0, 0.0],
                       "centre": [7.0, 0.0, 0.0], "axis": [1.0, 0.0, 0.0], "group": "wall"}},
            mesh={"shape": "tube", "radius": 1.0, "length": 2.0, "around": around, "along": 4},
            groups={}, supports=[{"group": "start", "hold": "xyz"}], probes={}, derivatives=[],
        )  # fmt: skip
        force = surface_loads_of(scene, build_mesh(scene)).at_rest("wind").sum(axis=0)
        assert np.abs(force[[0, 2]]).max() < 1e-12
        errors.append(abs(force[1] / (2.0 * np.pi * 2.0) - 1.0))
    assert np.abs(np.log2(np.array(errors[:-1]) / np.array(errors[1:])) - 2.0).max() < 0.1


def test_the_tangent_and_the_work_are_exact_where_the_wind_jumps() -> None:
    """Along one line, and between all triangles; with pressure inside and snow beside it."""
    table = FLOW | {"direction": [1.0, 0.2, 0.0], "centre": [0.0, 0.0, 0.0]}
    for wind in ({"cp": {"half": -0.7, "all": 0.4}}, {"table": table}):
        loads = {"wind": {"kind": "wind", "q": 2.0, **wind}, "snow": {"kind": "snow", "group": "upper"}}
        newton, u = crumpled(ball(wind, loads=loads, stages=[{"name": "a", "pressure": 1.0, "loads": {"wind": 1, "snow": 1}}]),
                             [1.0, 0.2, 0.3])  # fmt: skip
        whole, differences = whole_tangent(newton, u)
        assert np.abs(differences - whole).max() < 1e-8 * np.abs(whole).max()
        assert_work(newton, u, 0.05, 1e-9, 1e-5)


def test_equilibrium_and_derivatives_where_the_wind_jumps() -> None:
    scenes = [ball({"cp": {"half": -0.7, "front": 0.4}}, stages=[{"name": "a", "pressure": 1.0, "loads": {"wind": f}}])
              for f in (0.2, 0.2002, 0.1998)]  # fmt: skip
    step, more, less = (run(scene).steps[-1] for scene in scenes)
    assert step.converged
    assert step.iterations <= 12
    assert step.energy is None
    difference = (more.probes["x"] - less.probes["x"]) / 4e-4
    assert step.derivatives["x"]["load.wind"] == pytest.approx(difference, rel=1e-6)
    assert without_potential(modelled(scenes[0])).startswith("stage a, ")


def strip(pieces: int) -> Scene:
    """A flat strip 10 long, of stiffness 300 per width, in suction 3 on its first four and 1 on its other six."""
    return Scene.model_validate(
        {
            "name": "strip",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 10.0, "height": 0.5, "along_x": pieces, "along_y": 1},
            "groups": {"first": {"where": "x < 4", "kind": "elements"}},
            "fabric": {"E": 300.0, "nu": 0.0, "thickness": 1.0, "law": "none", "side_strain": "engineering"},
            "supports": [
                {"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}, {"group": "all", "hold": "y"},
            ],
            "loads": {"gust": {"kind": "wind", "q": 2.0, "cp": {"first": -1.5, "all": -0.5}}},
            "stages": [{"name": "blow", "loads": {"gust": 1.0}}],
            "solver": {"tolerance": 1e-10},
        }
    )  # fmt: skip


def test_a_strip_in_two_suctions_hangs_in_two_arcs() -> None:
    """One tension T, arcs of radius T/p of the stretched lengths with a common tangent: T and both parts of the pull; 0.03 %."""
    pressure, length = np.array([3.0, 1.0]), np.array([4.0, 6.0])

    def chord(q: Any) -> Any:
        tension, angle = q
        turn = length * (1.0 + tension / 300.0) * pressure / tension
        ends = angle - np.concatenate([[0.0], np.cumsum(turn)])
        radius = tension / pressure
        along = (radius * (np.sin(ends[:-1]) - np.sin(ends[1:]))).sum()
        up = (radius * (np.cos(ends[1:]) - np.cos(ends[:-1]))).sum()
        return np.array([along - 10.0, up])

    tension, angle = fsolve(chord, [15.0, 0.5], xtol=1e-13)
    exact = tension * np.array([np.cos(angle), np.sin(angle)])
    errors = []
    for pieces in (20, 40, 80):
        result = run(strip(pieces))
        assert result.converged, result.steps[-1].reason
        held = result.steps[-1].reaction[result.mesh.node_groups["x_min"]].sum(axis=0)
        errors.append(np.abs(-held[[0, 2]] / 0.5 / exact - 1.0))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert errors[-1].max() < 3e-4


def test_where_no_wind_blows_nothing_is_compiled() -> None:
    calm = modelled(ball({"cp": {"all": 1.0}}, stages=[{"name": "blow", "pressure": 1.0}])).structure
    for structure in (closed_body(ISOTROPIC), calm):
        assert "tri_wind" not in {name for name, _ in System(structure).fields()}
        assert "wind" in structure.features().describe()[1]
    windy = modelled(ball({"cp": {"all": 1.0}}, stages=[{"name": "blow", "loads": {"wind": 1.0}}])).structure
    assert {name for name, _ in System(windy).fields()} & {"tri_wind", "chamber_pressure", "tri_snow"} == {"tri_wind"}


def test_a_stopped_run_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    """Weight, snow, wind and water in one run, its columns named with their units."""

    loads = {
        "own": {"kind": "weight", "g": 9.81},
        "snow": {"kind": "snow"},
        "wind": {"kind": "wind", "q": 2.0, "cp": {"half": -0.7, "front": 0.4}},
        "water": {"kind": "water", "specific_weight": 0.1, "floor": [0.0, 0.0, -1.0]},
    }
    stages = [
        {"name": "inflate", "pressure": 1.0, "loads": {"own": 1.0}},
        {"name": "winter", "steps": 2, "loads": {"snow": 0.1, "wind": 0.2}},
        {"name": "storm", "loads": {"snow": 0.0, "wind": 0.3, "water": 0.9}},
    ]
    fabric = {"E": 100.0, "nu": 0.3, "thickness": 0.1, "mass_per_area": 0.01}
    scene = ball({}, loads=loads, stages=stages, fabric=fabric, camera={"size": [320, 240]})
    whole = run(scene, out=tmp_path / "whole", render=True)
    assert whole.converged
    header = (tmp_path / "whole/history.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert {"load.own", "load.snow [N/m²]", "load.wind", "load.water [m]"} <= set(header)
    run_until(1, scene, out=tmp_path / "part", render=True)
    tm.resume(tmp_path / "part")
    assert different(outcome(tmp_path / "whole"), outcome(tmp_path / "part")) == []


@pytest.mark.parametrize(
    ("wind", "expected"),
    [
        ({}, r"give either cp, a coefficient for each element group or their field, or table"),
        ({"cp": {"all": 1.0}, "table": FLOW | {"direction": [1, 0, 0], "centre": [0, 0, 0]}}, r"give either cp"),
        ({"cp": {"half": 0.8, "upper": -0.4}},
         r"loads\.wind\.cp: element \d+ \(and \d+ others\) has 0\.8 by group 'half' and -0\.4 by group 'upper'"),
        ({"cp": {"roof": 1.0}}, r"loads\.wind\.cp: no element group 'roof' in this mesh; allowed: all, half"),
        ({"cp": {"all": 1.0}, "face": "outside"}, r"Input should be 'front' or 'back'"),
        ({"table": {"angles": [0, 90], "cp": [1], "direction": [1, 0, 0], "centre": [0, 0, 0]}}, r"at least 2 items"),
        ({"table": {"direction": [1, 0, 0], "centre": [0, 0, 0]}}, r"give either angles with cp, or flow = 'potential'"),
        ({"table": FLOW | {"flow": "potential", "direction": [1, 0, 0], "centre": [0, 0, 0]}}, r"give either angles with cp"),
        ({"table": {"flow": "real", "direction": [1, 0, 0], "centre": [0, 0, 0]}}, r"Input should be 'potential'"),
        ({"cp": {"field": "cp"}}, r"loads\.wind\.cp\.field: no element data 'cp' in this mesh; allowed: \(none;"),
        ({"table": {"angles": [0, 90, 180], "cp": [1, 0], "direction": [1, 0, 0], "centre": [0, 0, 0]}},
         r"3 angles, but 2 values of cp"),
        ({"table": {"angles": [0, 90, 90], "cp": [1, 0, 1], "direction": [1, 0, 0], "centre": [0, 0, 0]}},
         r"angles must ascend, but 90 follows 90"),
        ({"table": {"angles": [0, 90], "cp": [1, 0], "direction": [1, 0, 0], "centre": [0, 0, 0]}},
         r"loads\.wind\.table\.angles: they go from 0 to 90, but element \d+ \(and \d+ others\) is at \d+\.\d+ degrees"),
        ({"table": {"angles": [0, 180], "cp": [1, 0], "direction": [1, 0, 0], "centre": [0, 0, 0], "axis": [2, 0, 0]}},
         r"table: the wind blows along the axis: direction = \[1\.0, 0\.0, 0\.0\], axis = \[2\.0, 0\.0, 0\.0\]"),
    ],
)  # fmt: skip
def test_bad_wind_is_named(wind: dict[str, Any], expected: str) -> None:
    with pytest.raises((ValueError, InputError), match=expected):
        modelled(ball(wind))
