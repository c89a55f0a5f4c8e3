"""Standing liquids: exact buoyancy, energy and tangent of partly wet surfaces, a filled tube on a plane, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies import ISOTROPIC, closed_body
from test_rim import modelled
from test_snow import assert_work, crumpled, whole_tangent

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.wet import wet_matrices
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh
from taichi_membrane.simulation.solver_choice import without_potential
from taichi_membrane.simulation.surface_loads import surface_loads_of

pytestmark = pytest.mark.usefixtures("runtime_cpu")

LINEAR = {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"}
WET = {"kind": "water", "specific_weight": 0.5, "floor": [0.0, 0.0, -1.2]}


def ball(water: dict[str, Any], divisions: int = 3, **changes: Any) -> Scene:
    """A sphere held at its foot, with pressure inside and a liquid up to its middle."""
    return Scene.model_validate(
        {
            "name": "ball",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "sphere", "radius": 1.0, "divisions": divisions},
            "groups": {
                "foot": {"where": "z < -0.8"},
                "half": {"where": "x > 0", "kind": "elements"},
                "band": {"where": "z < 0.3", "kind": "elements"},
            },
            "fabric": LINEAR,
            "supports": [{"group": "foot", "hold": "xyz"}],
            "loads": {"water": WET | water},
            "stages": [{"name": "fill", "pressure": 1.0, "loads": {"water": 1.25}}],
            "probes": {"z": {"kind": "displacement", "group": "north", "component": "z"}},
            "derivatives": ["z"],
            "solver": {"kind": "newton", "tolerance": 1e-11},
            **changes,
        }
    )


def test_the_wet_part_of_a_triangle_is_integrated_exactly() -> None:
    """Dry, wet and cut triangles against a quadrature of the shape functions where the depth is positive."""
    rng = np.random.default_rng(0)
    depth = np.concatenate([rng.normal(size=(40, 3)), [[1, 0, 0], [0, 0, -1], [0, 1, 1], [0, 0, 0], [1, 1, -1e-9]]])
    found = wet_matrices(depth)
    n = 400
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    below = (i + j < n) * 1.0, (i + j < n - 1) * 1.0  # the two small triangles of each cell
    for matrix, corners in zip(found, depth, strict=True):
        total = np.zeros((3, 3))
        for there, shift in zip(below, (1.0, 2.0), strict=True):
            first, second = (i + shift / 3.0) / n, (j + shift / 3.0) / n
            shapes = np.stack([1.0 - first - second, first, second])
            weight = there * (np.einsum("a,aij->ij", corners, shapes) > 0.0) / n**2 / 2.0
            total += np.einsum("aij,bij,ij->ab", shapes, shapes, weight)
        assert np.abs(matrix - total).max() < 2e-4


def test_buoyancy_is_the_weight_of_what_is_displaced() -> None:
    """Of a crumpled body under a slanting level, its sunk part by tetrahedra; and of a sphere, at second order."""
    up = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])
    scene = ball({"face": "front", "up": [0.2, -0.1, 1.0], "floor": [0.0, 0.0, -2.0]})
    model = modelled(scene)
    system = System(model.structure)
    mesh = model.structure.mesh
    u = 0.1 * np.random.default_rng(0).standard_normal(mesh.points.shape)
    level = 1.7
    depth = level - 2.0 * up[2] - (mesh.points + u) @ up
    system.set_displacement(u)
    system.set_surface_loads(np.array([0.0, 0.0]))
    dry = system.out_of_balance()
    system.set_surface_loads(np.array([0.0, level]))
    force = (system.out_of_balance() - dry).sum(axis=0)
    assert np.abs(force - (force @ up) * up).max() < 1e-13
    # The sunk volume: columns of the wet part of each triangle up to the level.
    corners = (mesh.points + u)[mesh.triangles]
    directed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ up
    wet = wet_matrices(depth[mesh.triangles]).sum(axis=2)
    sunk = -(directed * (wet * depth[mesh.triangles]).sum(axis=1)).sum()
    assert force @ up == pytest.approx(0.5 * sunk, rel=1e-12)
    errors = []
    for divisions in (8, 16, 32):
        sphere = ball({"face": "front", "floor": [0.0, 0.0, -1.0]}, divisions)
        lift = surface_loads_of(sphere, build_mesh(sphere)).at_rest("water", 0.7).sum(axis=0)
        errors.append(abs(lift[2] / (0.5 * np.pi * 0.49 * (3.0 - 0.7) / 3.0) - 1.0))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.15
    assert errors[-1] < 5e-3


@pytest.mark.parametrize("face", ["front", "back"])
def test_forces_are_the_slope_of_the_energy_on_a_closed_surface(face: str) -> None:
    """Central differences to 1e-7 of the liquid's own forces; no skew part, and the same tangent by differences of the forces."""
    scene = ball({"face": face, "up": [0.2, -0.1, 1.0], "floor": [0.0, 0.0, -2.0]}, fabric=LINEAR | {"E": 1e-9})
    newton, u = crumpled(scene, [0.0, 1.9])
    assert newton.skew() is None
    force, loads, step = newton.free_force(), np.zeros_like(u), 1e-4
    for number in np.flatnonzero(newton.free.ravel())[::7]:
        change = np.zeros(u.size)
        change[number] = step
        energies = []
        for factor in (-2.0, -1.0, 1.0, 2.0):
            newton.system.set_displacement(u + factor * change.reshape(u.shape))
            energies.append(newton.system.potential_energy(loads)[0])
        slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / (12.0 * step)
        assert force.ravel()[number] == pytest.approx(-slope, abs=1e-7 * np.abs(force).max())
    newton.system.set_displacement(u)
    whole = newton.tangent.matrix().toarray()
    for number in np.flatnonzero(newton.free.ravel())[::5]:
        change = np.zeros(u.size)
        change[number] = 1e-6
        forces = []
        for sign in (1.0, -1.0):
            newton.system.set_displacement(u + sign * change.reshape(u.shape))
            forces.append(newton.free_force().ravel())
        column = (forces[1] - forces[0]) / 2e-6
        free = newton.free.ravel()
        assert np.abs(column - whole[:, number])[free].max() < 1e-6 * np.abs(whole[np.ix_(free, free)]).max()


def test_the_tangent_and_the_work_are_exact_where_the_rim_moves() -> None:
    """Liquid on half the sphere, level with a slant; another on the outside of a band."""
    loads = {
        "water": WET | {"group": "half", "up": [0.2, -0.1, 1.0], "floor": [0.0, 0.0, -2.0]},
        "sea": WET | {"group": "band", "face": "front", "specific_weight": 0.3},
    }
    stage = {"name": "fill", "pressure": 1.0, "loads": {"water": 1.9, "sea": 1.25}}
    newton, u = crumpled(ball({}, loads=loads, stages=[stage], fabric=LINEAR | {"E": 1e-9}), [0.0, 1.9, 1.25])
    whole, differences = whole_tangent(newton, u)
    assert np.abs(differences - whole).max() < 1e-6 * np.abs(whole).max()
    assert_work(newton, u, 0.05, 1e-7, 1e-5)
    stiff, u = crumpled(ball({}, loads=loads, stages=[stage]), [0.6, 1.9, 1.25])
    whole, differences = whole_tangent(stiff, u)
    assert np.abs(differences - whole).max() < 1e-8 * np.abs(whole).max()


def test_equilibrium_derivatives_and_relaxation() -> None:
    """By the level, which forces are not linear in; energy where the surface is closed."""
    stages = [[{"name": "fill", "pressure": 1.0, "loads": {"water": level}}] for level in (1.25, 1.2502, 1.2498)]
    for water, potential in (({}, True), ({"group": "half"}, False)):
        step, more, less = (run(ball(water, stages=stage)).steps[-1] for stage in stages)
        assert step.converged
        assert step.iterations <= 20
        assert (step.energy is not None) == potential
        assert (without_potential(modelled(ball(water))) == "") == potential
        difference = (more.probes["z"] - less.probes["z"]) / 4e-4
        assert step.derivatives["z"]["load.water"] == pytest.approx(difference, rel=1e-5)
        relaxed = run(ball(water, derivatives=[], solver={"kind": "relaxation", "tolerance": 1e-9})).steps[-1]
        assert relaxed.converged
        assert np.abs(relaxed.displacement - step.displacement).max() < 1e-6


@pytest.mark.parametrize("water", [{}, {"group": "half"}])
def test_the_level_is_followed_by_arc_length(water: dict[str, Any]) -> None:
    """To the same state as under load control, with a potential and without."""
    start = {"name": "fill", "pressure": 1.0, "loads": {"water": 0.6}}
    rise = {"name": "rise", "loads": {"water": 1.25}}
    path = run(ball(water, stages=[start, rise | {"control": "arc_length", "steps": 30}], derivatives=[]))
    assert path.converged
    last = path.steps[-1]
    assert last.drivers["load.water"] == 1.25
    there = run(ball(water, stages=[start, rise], derivatives=[])).steps[-1]
    assert np.abs(last.displacement - there.displacement).max() < 1e-9


def tube(around: int, **changes: Any) -> Scene:
    """A ring of perimeter 1 and E t = 200 on a plane, blown up and then filled, to the level of twice the final height."""
    radius = 0.5 / np.pi
    return Scene.model_validate(
        {
            "name": "tube",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": radius, "length": 0.05, "around": around, "along": 1,
                     "cap_start": "none", "cap_end": "none"},
            "groups": {"bottom": {"where": f"z < {-0.999 * radius}"}, "top": {"where": f"z > {0.999 * radius}"}},
            "fabric": {"E": 2000.0, "nu": 0.0, "thickness": 0.1, "law": "none"},
            "planes": {"floor": {"through": [0.0, 0.0, -radius], "normal": [0.0, 0.0, 1.0]}},
            "supports": [{"group": "all", "hold": "x"}, {"group": "bottom", "hold": "xyz"}, {"group": "top", "hold": "xy"}],
            "loads": {"water": {"kind": "water", "specific_weight": 1.0, "floor": [0.0, 0.0, -radius]}},
            "stages": [
                {"name": "blow", "pressure": 0.4},
                {"name": "fill", "pressure": 0.0, "loads": {"water": 0.528844}, "steps": 4},
            ],
            "probes": {"crown": {"kind": "displacement", "group": "top", "component": "z"}},
            **changes,
        }
    )  # fmt: skip


def test_a_filled_tube_on_a_plane() -> None:
    """Crown at half the level of an inextensible weightless tube: height 0.264422, tension γ H (2 y0 + H)/4 = 0.0524391 for y0 = H.

    The plane bears the liquid's weight, its area times γ: 0.0765. Tension: the middle value, as the elements beside the one node
    that is held on the plane share it unevenly.
    """
    errors = []
    for around in (48, 96):
        result = run(tube(around))
        assert result.converged, result.steps[-1].reason
        step = result.steps[-1]
        height = 1.0 / np.pi + step.probes["crown"]
        borne = (step.contact_forces["floor"] + step.reaction[:, 2].sum()) / 0.05
        tension = float(np.median(step.elements.major_resultant))
        errors.append(np.abs([height / 0.264422 - 1, tension / 0.0524391 - 1, borne / 0.0765 - 1]))
    assert errors[0].max() < 2e-3
    assert errors[1].max() < 3e-4


def test_without_liquid_nothing_is_compiled() -> None:
    dry = modelled(ball({}, stages=[{"name": "fill", "pressure": 1.0}])).structure
    for structure in (closed_body(ISOTROPIC), dry):
        assert not {name for name, _ in System(structure).fields()} & {"tri_water", "water_level"}
        assert "liquids" in structure.features().describe()[1]
    assert {"tri_water", "water_level"} <= {name for name, _ in System(modelled(ball({})).structure).fields()}


@pytest.mark.parametrize(
    ("water", "expected"),
    [
        (
            {"floor": [0.0, 0.0, 0.5]},
            r"loads\.water\.floor: at height 0\.5, but elements of the group go down to -1 and would",
        ),
        ({"specific_weight": 0.0}, r"loads\.water\.water\.specific_weight"),
        ({"group": "sea"}, r"loads\.water\.group: no element group 'sea' in this mesh; allowed: all, half"),
        ({"face": "inside"}, r"loads\.water\.water\.face"),
        ({"level": 3.0}, r"loads\.water\.water\.level"),
    ],
)
def test_bad_water_is_named(water: dict[str, Any], expected: str) -> None:
    with pytest.raises((ValueError, InputError), match=expected):
        modelled(ball(water))
