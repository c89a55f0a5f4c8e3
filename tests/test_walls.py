"""Any number of triangles at an edge: a box of two chambers with an inner wall, and what is refused there."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from boxes import two_cells

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_model
from taichi_membrane.simulation.results import StepResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

BOTH: dict[str, Any] = {"a": {"group": ["a", "wall"]}, "b": {"group": "b", "against": "wall"}}
TURNED: dict[str, Any] = {"a": {"group": "a", "against": "wall"}, "b": {"group": ["b", "wall"]}}


def box(pressures: dict[str, Any] = BOTH, **changes: Any) -> Scene:
    """The box, its floor held, under 0.5 in chamber a and 0.2 in b."""
    return Scene.model_validate(
        {
            "name": "box",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
            "supports": [{"group": "floor", "hold": "xyz"}],
            "pressures": pressures,
            "stages": [{"name": "blow", "pressure": {"a": 0.5, "b": 0.2}}],
            "probes": {
                "a": {"kind": "volume", "pressure": "a"},
                "b": {"kind": "volume", "pressure": "b"},
                "all": {"kind": "volume"},
            },
            "derivatives": ["a", "b"],
            "solver": {"kind": "newton", "tolerance": 1e-12},
            **changes,
        }
    )


@pytest.fixture(scope="module")
def blown(runtime_cpu: None) -> StepResult:
    """The box at rest under its two pressures."""
    return run(box(), mesh=two_cells(4)).steps[-1]


def test_a_box_with_an_inner_wall_balances_to_round_off(blown: StepResult) -> None:
    """A closed surface pushes itself nowhere, so that the supports' forces and moments cancel, whatever the wall carries."""
    assert blown.converged
    assert blown.negative_pivots == 0
    mesh = two_cells(4)
    size = np.abs(blown.reaction).sum()
    moment = np.cross(mesh.points + blown.displacement, blown.reaction).sum(axis=0)
    assert np.abs(blown.reaction.sum(axis=0)).max() < 1e-13 * size
    assert np.abs(moment).max() < 1e-12 * size
    # The wall gives way from the higher pressure to the lower one.
    middle = np.argmin(np.linalg.norm(mesh.points - [1.0, 0.5, 0.5], axis=1))
    assert blown.displacement[middle, 0] > 0.05


def test_what_one_pressure_does_to_the_other_volume_is_mutual(blown: StepResult) -> None:
    """∂V_a/∂p_b = ∂V_b/∂p_a, as the two pressures have one potential: by adjoints, each on its own right-hand side."""
    mutual = blown.derivatives["a"]["pressure.b"], blown.derivatives["b"]["pressure.a"]
    assert mutual[0] < 0.0
    assert mutual[0] == pytest.approx(mutual[1], rel=1e-10)
    assert blown.probes["a"] + blown.probes["b"] == pytest.approx(blown.probes["all"], rel=1e-14)
    more, less = (
        run(box(stages=[{"name": "s", "pressure": {"a": 0.5, "b": 0.2 + change}}]), mesh=two_cells(4)).steps[-1]
        for change in (1e-4, -1e-4)
    )
    assert (more.probes["a"] - less.probes["a"]) / 2e-4 == pytest.approx(mutual[0], rel=1e-6)


def test_the_side_that_a_wall_faces_does_not_matter(blown: StepResult) -> None:
    """The same box with its wall turned over and named the other way round; relaxation finds the same state as Newton."""
    turned = run(
        box(TURNED, solver={"kind": "relaxation", "tolerance": 1e-10}, derivatives=[]), mesh=two_cells(4, turned=True)
    )
    assert turned.converged
    assert np.abs(turned.steps[-1].displacement - blown.displacement).max() < 1e-6


def test_the_tangent_with_pressures_on_both_sides_is_the_derivative_of_the_forces() -> None:
    """Central differences in a crumpled state, without wrinkling, whose kinks would spoil them."""
    fabric = {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"}
    model = build_model(box(fabric=fabric), two_cells(2))
    system = System(model.structure)
    free = ~model.structure.node_held
    u = np.random.default_rng(0).normal(size=free.shape) * 0.03 * free
    system.set_surface_loads(np.array([0.7, 0.2]))
    system.set_displacement(u)
    matrix = Tangent(system).matrix().toarray()[np.ix_(free.ravel(), free.ravel())]
    assert np.abs(matrix - matrix.T).max() < 1e-13 * np.abs(matrix).max()
    step, differences = 1e-6, np.zeros_like(matrix)
    for column, (node, axis) in enumerate(np.argwhere(free)):
        forces = []
        for sign in (1.0, -1.0):
            moved = u.copy()
            moved[node, axis] += sign * step
            system.set_displacement(moved)
            forces.append(system.out_of_balance()[free])
        differences[:, column] = (forces[1] - forces[0]) / (2 * step)
    assert np.abs(differences - matrix).max() < 1e-8 * np.abs(matrix).max()


@pytest.mark.parametrize(
    ("pressures", "told"),
    [
        (
            {"a": {"group": "all"}, "b": {"group": "b", "against": "wall"}},
            "elements, the first is 32, overlap with pressure 'a', which already lies behind",
        ),
        (
            {"a": {"group": ["a", "b", "wall"]}, "b": {"kind": "fixed"}},
            r"elements .*\(in a\).*\(in wall\).* from \(1\.0, 0\.0, .*enclose",
        ),
        (TURNED, r"pressures\.a: .*do not enclose one side; 8 such"),
        (
            {"a": {"group": "a", "against": "wal"}, "b": {"group": "b"}},
            r"pressures\.a\.against: no element group 'wal'.* wall",
        ),
    ],
)
def test_surfaces_that_bound_no_chamber_are_refused_with_place_and_groups(pressures: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError) as caught:
        build_model(box(pressures, derivatives=[], probes={}), two_cells(2))
    assert re.search(told, str(caught.value)), caught.value


AMBIENT, EXPONENT = 10.0, 1.4
SHUT: dict[str, Any] = {
    name: {**surfaces, "ambient": AMBIENT, "exponent": EXPONENT} for name, surfaces in BOTH.items()
} | {"outside": {"group": "b", "kind": "fixed"}}  # on the faces of b, from without


def squeezed(a: float, b: float, outside: float) -> tuple[StepResult, StepResult]:
    """The box blown up, then shut in both chambers and squeezed from without at b alone: the steps before and after."""
    stages = [
        {"name": "blow", "pressure": {"a": a, "b": b}},
        {"name": "squeeze", "pressure": {"outside": -outside}, "closed": ["a", "b"]},
    ]
    first, last = run(box(SHUT, stages=stages, derivatives=["a", "b"]), mesh=two_cells(4)).steps
    assert first.converged
    assert last.converged, last.reason
    return first, last


def wall_forces(step: StepResult, a: float, b: float) -> tuple[Floats, Floats]:
    """At nodes inside the wall, at a state: what pressures ``a`` and ``b`` do to them, and ∂V_a/∂x of the wall alone."""
    mesh = two_cells(4)
    model = build_model(box(SHUT), mesh)
    system = System(model.structure)
    system.set_displacement(step.displacement)
    forces = []
    for pressures in ((a, b), (0.0, 0.0)):
        system.set_surface_loads(model.surface_values(LoadState.of(pressure={"a": pressures[0], "b": pressures[1]})))
        forces.append(system.out_of_balance())
    triangles = mesh.triangles[mesh.tri_groups["wall"]]
    outer = np.concatenate([mesh.triangles[mesh.tri_groups[name]].ravel() for name in "ab"])
    inside = np.setdiff1d(triangles, outer)
    assert len(inside) == 9
    corners = (mesh.points + step.displacement)[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6.0
    gradient = np.zeros_like(mesh.points)
    np.add.at(gradient, triangles, area[:, None, :])
    return (forces[0] - forces[1])[inside], gradient[inside]


def test_a_wall_bears_the_difference_of_its_sides(blown: StepResult) -> None:
    """On a deformed wall: nothing where both sides have one pressure, (p_a - p_b) times its area vectors else."""
    size = 0.5 * np.abs(wall_forces(blown, 0.0, 0.0)[1]).max()
    alike, gradient = wall_forces(blown, 0.5, 0.5)
    assert np.abs(alike).max() < 1e-14
    assert size > 1e-3
    for a, b in ((0.5, 0.2), (0.2, 0.5), (0.0, 0.3)):
        push = wall_forces(blown, a, b)[0]
        assert np.abs(push - (a - b) * gradient).max() < 1e-13


def test_shut_chambers_side_by_side_keep_their_own_gas() -> None:
    """Each p_abs Vⁿ; the wall, flat under one pressure, gives way to the chamber that is not squeezed, as far as p_b - p_a pushes.

    What the wall carries is what balances its own tension: the forces without any pressure at its nodes.
    """
    first, last = squeezed(0.4, 0.4, 0.5)
    middle = np.argmin(np.linalg.norm(two_cells(4).points - [1.0, 0.5, 0.5], axis=1))
    assert abs(first.displacement[middle, 0]) < 1e-10
    assert last.pressures["b"] > last.pressures["a"] > 0.4
    assert last.displacement[middle, 0] < -1e-3
    for name in "ab":
        kept = [(step.pressures[name] + AMBIENT) * step.probes[name] ** EXPONENT for step in (first, last)]
        assert kept[1] == pytest.approx(kept[0], rel=1e-11)
    pushed, gradient = wall_forces(last, last.pressures["a"], last.pressures["b"])
    assert np.abs(pushed - (last.pressures["a"] - last.pressures["b"]) * gradient).max() < 1e-13
    model = build_model(box(SHUT), two_cells(4))
    system = System(model.structure)
    system.set_displacement(last.displacement)
    mesh = model.structure.mesh
    inside = np.setdiff1d(
        mesh.triangles[mesh.tri_groups["wall"]],
        np.concatenate([mesh.triangles[mesh.tri_groups[name]].ravel() for name in "ab"]),
    )
    tension = system.out_of_balance()[inside]
    assert np.abs(tension + pushed).max() < 1e-10 * np.abs(pushed).max()
    assert (last.stable, last.energy is not None) == (True, True)


def test_derivatives_with_both_chambers_shut_are_those_of_finite_differences() -> None:
    """By the pressure from without: volumes of both chambers, through the gas of both."""
    _, last = squeezed(0.5, 0.2, 0.5)
    (_, more), (_, less) = (squeezed(0.5, 0.2, 0.5 * (1.0 + share)) for share in (1e-4, -1e-4))
    for name in "ab":
        difference = -(more.probes[name] - less.probes[name]) / 1e-4
        assert last.derivatives[name]["pressure.outside"] == pytest.approx(difference, rel=1e-6)
        assert abs(difference) > 1e-3
    assert set(last.derivatives["a"]) & {"pressure.a", "pressure.b"} == set()
