"""Tents and mattresses at work: balance of forces on the deformed shape, a body that a plane alone bears, what is told of them."""

from __future__ import annotations

import numpy as np
import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.survey import survey
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import load_scene, shipped_scenes
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import StepResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def shipped(name: str, *changes: str) -> Scene:
    return load_scene(shipped_scenes()[name], [*changes, "checks=[]"])


def outward(mesh: Mesh, step: StepResult, group: str) -> np.ndarray:
    """(n, 3) area vectors of an element group on the deformed shape."""
    a, b, c = np.moveaxis((mesh.points + step.displacement)[mesh.triangles[mesh.tri_groups[group]]], 1, 0)
    return np.cross(b - a, c - a) / 2


def test_supports_of_a_tent_bear_weight_snow_and_wind_to_round_off() -> None:
    """Snow on the present plan area and wind along the present normals, summed here from the displacements alone."""
    small = ("mesh.around=8", "mesh.along=16", "mesh.across=4", "mesh.seam=45", "stages.snow.steps=1")
    result = run(shipped("tent", *small, "stages.wind.steps=1"))
    assert result.converged, result.steps[-1].reason
    mesh, (_, snow, wind) = result.mesh, result.steps
    areas = mesh.tri_areas()
    mass = 1.05 * areas[mesh.tri_groups["arches"]].sum() + 0.65 * areas[mesh.tri_groups["skin"]].sum()
    weight = np.array([0.0, 0.0, -9.81 * mass])
    lying = np.array([0.0, 0.0, -300.0 * np.maximum(outward(mesh, snow, "skin")[:, 2], 0.0).sum()])
    cp = {"windward": 0.6, "roof": -0.9, "leeward": -0.4}
    blowing = -sum(250.0 * value * outward(mesh, wind, zone).sum(axis=0) for zone, value in cp.items())
    for step, load in ((snow, lying), (wind, blowing)):
        # The residual that is left, 1e-6 of all forces, those of the pressure in the arches included.
        assert step.reaction.sum(axis=0) == pytest.approx(-(weight + load), abs=1e-6 * 50e3 * 30)
    assert snow.probes["guy_windward"] == pytest.approx(snow.probes["guy_leeward"], rel=1e-6)
    assert wind.probes["guy_windward"] > wind.probes["guy_leeward"]


def test_the_survey_of_a_tent_leaves_out_the_ends_of_its_guys() -> None:
    scene = shipped("tent")
    bodies = survey(build_mesh(scene)).bodies
    assert len(bodies) == 1
    assert bodies[0].volume is None


def bed() -> Scene:
    """Four cells of the shipped mattress, one of which has less pressure when it is lain on."""
    scene = shipped("mattress").model_dump(exclude_unset=True)
    scene["mesh"] |= {"cells_x": 4, "along_y": 10, "up": 2, "width": 0.4}
    scene["groups"]["lain_on"]["where"] = "z > 0.124 and x > -0.1 and x < 0.1 and y > -0.4 and y < 0.4"
    scene["pressures"] = {name: scene["pressures"][name] for name in ("p1", "p2", "p3", "p4")}
    scene["stages"] = [
        {"name": "inflate", "pressure": dict.fromkeys(("p1", "p2", "p3", "p4"), 3000.0), "loads": {"weight": 1.0}},
        {"name": "lie", "pressure": {"p4": 2000.0}, "loads": {"person": 400.0}},
    ]
    scene["probes"] = {f"v{k}": {"kind": "volume", "pressure": f"p{k}"} for k in range(1, 5)}
    return Scene.model_validate(scene)


def test_a_mattress_rests_on_the_ground_by_its_weight_alone() -> None:
    """Nothing holds it vertically but the plane: that bears the weight and what lies on it, and no node is below."""
    scene = bed()
    result = run(scene)
    assert result.converged, result.steps[-1].reason
    mesh, (blown, lain) = result.mesh, result.steps
    weight = 0.4 * 9.81 * mesh.tri_areas().sum()
    on_top = 400.0 * mesh.tri_areas()[mesh.tri_groups["lain_on"]].sum()
    assert blown.contact_forces["ground"] == pytest.approx(weight, rel=1e-6)
    assert lain.contact_forces["ground"] == pytest.approx(weight + on_top, rel=1e-6)
    assert (mesh.points + lain.displacement)[:, 2].min() > -1e-9
    assert blown.probes["v1"] == pytest.approx(blown.probes["v4"], rel=1e-6)
    assert lain.probes["v4"] < 0.999 * lain.probes["v1"]


def test_a_plane_that_nothing_touches_holds_nothing() -> None:
    scene = bed()
    above = scene.model_copy(
        update={"planes": {"ground": scene.planes["ground"].model_copy(update={"through": (0, 0, -1)})}}
    )
    with pytest.raises(
        InputError, match=r"the structure is free to move: translation along z; .*planes hold what touches them"
    ):
        build_model(above, build_mesh(above))
