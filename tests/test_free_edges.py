"""Free edges in the wind: a hypar sail, and a flap on a shut box that slides in a slanted plane. Balance, tangent, derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from boxes import Grid

from taichi_membrane import shapes
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.coupled import CoupledFactor
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.rim import SkewFactor
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.model import build_model
from taichi_membrane.simulation.results import StepResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def hypar() -> Mesh:
    """A hyperbolic paraboloid over a square, its lines x = 0 and x = 1 straight."""
    flat = shapes.panel(width=1.0, height=1.0, along_x=5, along_y=5, pattern="crossed")
    x, y = flat.points[:, 0], flat.points[:, 1]
    points = np.column_stack((x, y, 0.25 * (2.0 * x - 1.0) * (2.0 * y - 1.0)))
    groups = {name: members for name, members in flat.node_groups.items() if name not in ("all", "boundary")}
    return Mesh.build(points, flat.triangles, groups)


def sail(wind: float) -> Scene:
    """The sail, held at two opposite sides."""
    return Scene.model_validate(
        {
            "name": "hypar",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabric": {
                "E": 1000.0, "nu": 0.3, "thickness": 0.01, "prestress": [10.0, 10.0, 0.0], "warp": [1, 0, 0], "law": "none",
            },
            "supports": [{"group": group, "hold": "xyz"} for group in ("x_min", "x_max")],
            "pressures": {"wind": {"group": "all"}},
            "stages": [{"name": "blow", "pressure": {"wind": wind}}],
            "probes": {
                "edge": {"kind": "displacement", "group": "y_max", "component": "z"},
                "along": {"kind": "displacement", "group": "y_min", "component": "x"},
                "size": {"kind": "displacement", "group": "y_max", "component": "magnitude"},
            },
            "derivatives": ["edge", "along", "size"],
            "solver": {"kind": "newton", "tolerance": 1e-12},
        }
    )  # fmt: skip


def box_with_flap() -> Mesh:
    """A cube, and from its upper edge at x = 1 a flap to x = 2: element groups box and flap, node groups floor and tip."""
    grid = Grid(2)
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    for origin, first, second in (
        ((0.0, 0.0, 0.0), y, x), (z, x, y), ((0.0, 0.0, 0.0), x, z), (y, z, x), ((0.0, 0.0, 0.0), z, y), (x, y, z),
    ):  # fmt: skip
        grid.add("box", origin, first, second)
    for half in (0.0, 0.5):  # the side that it shares has the box's nodes
        grid.add("flap", (1.0 + half, 0.0, 1.0), (0.5, 0.0, 0.0), y)
    points = np.array(list(grid.number))
    groups = {"floor": np.flatnonzero(points[:, 2] == 0.0), "tip": np.flatnonzero(points[:, 0] == 2.0)}
    groups["side"] = np.flatnonzero((points[:, 0] == 1.5) & (points[:, 1] == 0.0))
    return Mesh.build(points, grid.triangles, groups, grid.groups)


AMBIENT, EXPONENT = 10.0, 1.4


def flap(wind: float) -> Scene:
    """The box blown up and shut, then a gust on the flap, whose tip slides in a plane that neither axes nor the edge lie in."""
    return Scene.model_validate(
        {
            "name": "flap",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given"},
            "fabrics": {
                "box": {"E": 100.0, "nu": 0.3, "thickness": 0.1, "law": "none"},
                "flap": {
                    "E": 100.0, "nu": 0.3, "thickness": 0.02, "prestress": [10.0, 10.0, 0.0], "warp": [1, 0, 0], "law": "none",
                },
            },
            "supports": [{"group": "floor", "hold": "xyz"}, {"group": "tip", "normal": [1.0, 0.3, 0.5]}],
            "pressures": {
                "gas": {"group": "box", "ambient": AMBIENT, "exponent": EXPONENT}, "wind": {"group": "flap"},
            },
            "stages": [
                {"name": "blow", "pressure": {"gas": 0.5, "wind": 0.02}},
                {"name": "gust", "pressure": {"wind": wind}, "closed": ["gas"]},
            ],
            "probes": {
                "side": {"kind": "displacement", "group": "side", "component": "z"},
                "across": {"kind": "displacement", "group": "tip", "component": "y"},
                "gas": {"kind": "volume", "pressure": "gas"},
            },
            "derivatives": ["side", "across", "gas"],
            "solver": {"kind": "newton", "tolerance": 1e-12},
        }
    )  # fmt: skip


WIND = {"sail": 0.5, "flap": 0.05}
KINDS: dict[str, tuple[Callable[[float], Scene], Callable[[], Mesh], str]] = {
    "sail": (sail, hypar, "all"),
    "flap": (flap, box_with_flap, "flap"),
}


def blown(kind: str, wind: float | None = None) -> StepResult:
    """The last load step under a wind."""
    scene, mesh, _ = KINDS[kind]
    result = run(scene(WIND[kind] if wind is None else wind), mesh=mesh())
    assert result.converged, result.steps[-1].reason
    return result.steps[-1]


@pytest.mark.parametrize("kind", list(KINDS))
def test_supports_carry_the_wind_to_round_off(kind: str) -> None:
    """Forces and moments: what the wind does to the deformed cloth, as a closed box pushes itself nowhere, shut or not."""
    step, mesh = blown(kind), KINDS[kind][1]()
    corners = (mesh.points + step.displacement)[mesh.triangles[mesh.tri_groups[KINDS[kind][2]]]]
    push = 0.5 * WIND[kind] * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.abs(step.reaction).sum()
    assert np.abs(push.sum(axis=0)).max() > 1e-3 * size
    assert np.abs(step.reaction.sum(axis=0) + push.sum(axis=0)).max() < 1e-12 * size
    # A third of the push at each corner acts as the whole in the middle.
    moment = np.cross(mesh.points + step.displacement, step.reaction).sum(axis=0)
    moment += np.cross(corners.mean(axis=1), push).sum(axis=0)
    assert np.abs(moment).max() < 1e-12 * size


@pytest.mark.parametrize("kind", list(KINDS))
def test_the_tangent_of_all_terms_is_the_derivative_of_the_forces(kind: str) -> None:
    """At equilibrium, with the gas following its volume, in the axes of slanted supports; without its skew part it is off."""
    scene, mesh, _ = KINDS[kind]
    work = Analysis(build_model(scene(WIND[kind]), mesh()))
    *_, step = work.steps()
    newton = work.newton
    assert newton is not None
    factor = newton.factorised(indefinite=True)
    assert isinstance(factor, SkewFactor)
    assert isinstance(factor.factor, CoupledFactor) == (kind == "flap")
    system, free, u = newton.system, newton.free, step.displacement

    def force_at(displacement: Floats) -> Floats:
        system.set_displacement(displacement)
        if work.equilibrium.filling.contents is not None:
            work.equilibrium.filling.contents.settle()
        return newton.free_force().ravel()

    components, change = np.flatnonzero(free), 1e-6
    unit = np.eye(free.size).reshape(-1, *free.shape)
    exact, differences = np.zeros((2, free.size, free.size))
    for k in components:
        exact[:, k] = factor.times(unit[k]).ravel()
        way = change * system.from_frames(unit[k])
        differences[:, k] = (force_at(u - way) - force_at(u + way)) / (2.0 * change)
    force_at(u)
    part = np.ix_(components, components)
    scale = np.abs(exact[part]).max()
    assert np.abs(differences - exact)[part].max() < 1e-6 * scale
    skew = np.array([factor.skew.times(one).ravel() for one in unit]).T[part]
    assert np.abs(exact[part] - exact[part].T).max() == pytest.approx(2.0 * np.abs(skew).max())
    assert np.abs(differences - exact)[part].max() < 1e-3 * np.abs(skew).max()
    right = np.where(free, np.random.default_rng(0).standard_normal(free.shape), 0.0)
    for matrix, solution in ((exact, factor.solve(right)), (exact.T, factor.solve_transposed(right))):
        assert np.linalg.norm((matrix @ solution.ravel() - right.ravel())[components]) < 1e-9 * np.linalg.norm(right)


@pytest.mark.parametrize("kind", list(KINDS))
def test_derivatives_are_those_of_finite_differences(kind: str) -> None:
    """By the wind: each probe's, by the transposed tangent."""
    step, wind = blown(kind), WIND[kind]
    more, less = (blown(kind, wind * (1.0 + share)) for share in (1e-4, -1e-4))
    for probe, found in step.derivatives.items():
        difference = (more.probes[probe] - less.probes[probe]) / (2e-4 * wind)
        assert found["pressure.wind"] == pytest.approx(difference, rel=1e-6, abs=1e-9), probe
    assert np.abs([of["pressure.wind"] for of in step.derivatives.values()]).min() > 1e-4


def test_the_shut_gas_keeps_its_law_beside_a_free_rim() -> None:
    """p_abs Vⁿ, while a gust on the flap squeezes the box; nothing is called stable, and no derivative by the gas is told."""
    first, last = run(flap(WIND["flap"]), mesh=box_with_flap()).steps
    kept = [(step.pressures["gas"] + AMBIENT) * step.probes["gas"] ** EXPONENT for step in (first, last)]
    assert kept[1] == pytest.approx(kept[0], rel=1e-12)
    assert abs(last.pressures["gas"] / first.pressures["gas"] - 1.0) > 1e-4
    assert (last.stable, last.negative_pivots, last.energy) == (None, 0, None)
    assert "pressure.gas" in first.derivatives["side"]
    assert "pressure.gas" not in last.derivatives["side"]


def normal(step: StepResult, along: tuple[float, float, float]) -> Any:
    """Largest displacement of the tip along a direction."""
    tip = box_with_flap().node_groups["tip"]
    return np.abs(step.displacement[tip] @ np.array(along)).max()


def test_a_slanted_plane_is_not_left() -> None:
    """The tip moves in it, and its support pushes across it alone."""
    step = blown("flap")
    across = np.array([1.0, 0.3, 0.5]) / np.sqrt(1.34)
    assert normal(step, tuple(across)) < 1e-14
    assert normal(step, (0.0, 1.0, 0.0)) > 1e-4
    force = step.reaction[box_with_flap().node_groups["tip"]]
    assert np.abs(np.cross(force, across)).max() < 1e-12 * np.abs(force).max()
