"""Self-weight: the whole mass and no more, hanging cables and strips in elastic catenaries, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_members import catenary, hanging, rope

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run, summarise
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import load_scene
from taichi_membrane.simulation.masses import nodal_mass
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")

G = 9.81


def tent(**changes: Any) -> Scene:
    """A slanted panel of two fabrics with cables along two edges."""
    return Scene.model_validate(
        {
            "name": "tent",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 3.0, "height": 2.0, "along_x": 6, "along_y": 4},
            "groups": {"half": {"where": "x < 1.5", "kind": "elements"}},
            "fabric": {"E": 1e6, "nu": 0.3, "thickness": 1e-3, "density": 1300.0},
            "fabrics": {"half": {"E": 1e6, "nu": 0.3, "thickness": 2e-3, "mass_per_area": 0.9}},
            "cables": {"edge": {"along": "x_min", "EA": 1e5, "unstressed": 0.99, "mass_per_length": 0.4}},
            "supports": [{"group": "boundary", "hold": "xyz"}],
            "loads": {"own": {"kind": "weight", "g": G, "direction": [0.0, 3.0, -4.0]}},
            "stages": [{"name": "hang", "loads": {"own": 1.0}}],
            "probes": {"down": {"kind": "displacement", "group": "all", "component": "z"}},
            "derivatives": ["down"],
            "solver": {"tolerance": 1e-10},
            **changes,
        }
    )


def test_the_weight_is_mass_times_g_and_the_supports_bear_it() -> None:
    """To round-off; along the direction of gravity, whatever its length; the model knows no more than nodal forces."""
    scene = tent()
    mass = 3.0 * 1300.0 * 1e-3 + 3.0 * 0.9 + 2.0 * 0.99 * 0.4
    force = build_model(scene, build_mesh(scene)).unit_forces["load.own"]
    exact = mass * G * np.array([0.0, 0.6, -0.8])
    assert np.abs(force.sum(axis=0) - exact).max() < 1e-14 * mass * G
    step = run(scene).steps[-1]
    assert step.converged
    assert np.abs(step.reaction.sum(axis=0) + exact).max() < 1e-8 * mass * G
    assert summarise(scene)[0].structure.features().loads


def test_a_corner_of_one_triangle_bears_a_third_of_it() -> None:
    """And the end of a cable half of that."""
    scene = tent()
    mesh = build_mesh(scene)
    mass = nodal_mass(scene, mesh)
    lone = np.flatnonzero(np.bincount(mesh.triangles.ravel(), minlength=mesh.node_count) == 1)
    corner = next(node for node in lone if mesh.points[node, 0] == 0.0)
    assert mass[corner] == pytest.approx(0.9 * 0.125 / 3.0 + 0.4 * 0.99 * 0.25, rel=1e-13)


def test_derivatives_by_the_factor_are_those_of_runs() -> None:
    own = {"kind": "weight", "g": G}
    step, more, less = (
        run(tent(loads={"own": own}, stages=[{"name": "hang", "loads": {"own": factor}}])).steps[-1]
        for factor in (1.0, 1.0001, 0.9999)
    )
    difference = (more.probes["down"] - less.probes["down"]) / 2e-4
    assert step.derivatives["down"]["load.own"] == pytest.approx(difference, rel=1e-5)


def heavy_rope(pieces: int) -> Scene:
    """The rope whose weight is 1 per length, by its mass."""
    cable = {"lines": "rope", "EA": 300.0, "unstressed": 12.0 / float(np.hypot(10.0, 2.0)), "mass_per_length": 0.5}
    return rope(
        pieces,
        fabric={"E": 1.0, "nu": 0.3, "thickness": 1.0, "density": 1.0},
        cables={"rope": cable},
        loads={"weight": {"kind": "weight", "g": 2.0}},
    )


def test_a_heavy_cable_hangs_in_an_elastic_catenary() -> None:
    """Force and shape at second order; to 0.03 % with 64 elements."""
    h, _, place = catenary(12.0, 300.0, 1.0, (10.0, -2.0))
    errors = []
    for pieces in (16, 32, 64):
        result = run(heavy_rope(pieces), mesh=hanging(pieces))
        assert result.converged, result.steps[-1].reason
        step, mesh = result.steps[-1], result.mesh
        nodes = mesh.node_groups["rope"]
        found = (mesh.points + step.displacement)[nodes][:, [0, 2]]
        exact = place(np.linspace(0.0, 12.0, pieces + 1)).T
        errors.append(
            [np.abs(found - exact).max() / np.ptp(exact[:, 1]), abs(abs(step.reaction[nodes[0], 0]) / h - 1.0)]
        )
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert max(errors[-1]) < 3e-4


def strip(pieces: int) -> Scene:
    """A flat strip 10 long, EA = 300, of weight 1 per length, between its held ends."""
    return Scene.model_validate(
        {
            "name": "strip",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 10.0, "height": 0.5, "along_x": pieces, "along_y": 1},
            "fabric": {
                "E": 300.0, "nu": 0.0, "thickness": 2.0, "mass_per_area": 1.0, "law": "none",
                "side_strain": "engineering",
            },
            "supports": [
                {"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}, {"group": "all", "hold": "y"},
            ],
            "loads": {"own": {"kind": "weight", "g": 2.0}},
            "stages": [{"name": "hang", "loads": {"own": 1.0}}],
            "solver": {"tolerance": 1e-9},
        }
    )  # fmt: skip


def test_a_heavy_strip_hangs_in_an_elastic_catenary() -> None:
    """Its weight per width against the cable's closed form; the sag of the middle and the pull at the ends to 0.03 %."""
    h, v, place = catenary(10.0, 300.0, 1.0, (10.0, 0.0))
    assert v == pytest.approx(5.0, rel=1e-9)
    errors = []
    for pieces in (16, 32, 64):
        result = run(strip(pieces))
        assert result.converged, result.steps[-1].reason
        step, mesh = result.steps[-1], result.mesh
        pull = abs(step.reaction[mesh.node_groups["x_min"], 0].sum())
        sag = -step.displacement[:, 2].min()
        errors.append([abs(pull / h - 1.0), abs(sag / -place(5.0)[1] - 1.0)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    assert max(errors[-1]) < 3e-4


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[loads.w]\nkind = 'weight'\ng = 1.0", "fabric.density is missing (or mass_per_area): loads.w needs it"),
        ("[loads.w]\nkind = 'weight'\ng = 0", "loads.w.g: 0 must be above 0"),
        ("[loads.w]\nkind = 'weigt'\ng = 1", "loads.w.kind: 'weigt' is unknown; did you mean 'weight'? allowed: total, line"),
        ("[loads.w]\nkind = 'weight'\ng = 1\ngroup = 'all'", "loads.w.group: unknown key; allowed: kind, g, direction"),
        ("[loads.w]\nkind = 'weight'\ng = 1\ndirection = [0, 0, 0]", "loads.w.direction: a direction needs a length"),
        (
            "[fabrics.all]\nE = 1\nnu = 0\nthickness = 1\ndensity = 2\nmass_per_area = 3",
            "fabrics.all: density = 2 and mass_per_area = 3 both say the mass",
        ),
        ("[cables.c]\nalong = 'all'\nEA = 1\nmass_per_length = -1", "cables.c.mass_per_length: -1 must be at least 0"),
    ],
)  # fmt: skip
def test_bad_input_is_named(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "scene.toml"
    head = """
name = "a"
units = { length = "m", force = "N" }
mesh = { shape = "panel", width = 1, height = 1, along_x = 2, along_y = 2 }
fabric = { E = 1, nu = 0.3, thickness = 1 }
supports = [{ group = "boundary", hold = "xyz" }]
stages = [{ name = "s" }]
"""
    path.write_text(head + text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: {expected}")
