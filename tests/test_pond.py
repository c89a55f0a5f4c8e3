"""Ponding: limits and growth of sags at a held level, and liquids of given volume against closed forms, tangent and energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.special import j0, j1, jn_zeros
from test_rim import modelled
from test_water import LINEAR, ball

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.pond import Pond
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import StepResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

# So soft that slopes of a thousandth leave the tension of 1 per width what it is.
TAUT = {"E": 1e-3, "nu": 0.0, "thickness": 1.0, "law": "none", "prestress": [1.0, 1.0, 0.0]}
WIDTH = 0.1


def sheet(mesh: dict[str, Any], rain: dict[str, Any], value: float, **changes: Any) -> Scene:
    """A taut sheet under a liquid on its top."""
    return Scene.model_validate(
        {
            "name": "sheet",
            "units": {"length": "m", "force": "N"},
            "mesh": mesh,
            "fabric": TAUT,
            "pressures": {},
            "loads": {"rain": {"kind": "water", "face": "front", **rain}},
            "stages": [{"name": "rain", "loads": {"rain": value}}],
            "solver": {"kind": "newton", "tolerance": 1e-9},
            **changes,
        }
    )


def strip(size: int, k: float, volume: float, **changes: Any) -> Scene:
    """Of length 1, bent in one direction only; k² = γ/T."""
    return sheet(
        {"shape": "panel", "width": 1.0, "height": WIDTH, "along_x": size, "along_y": 2},
        {"specific_weight": k**2, "given": "volume"},
        volume,
        **{
            "groups": {
                name: {"where": f"x = {x} within 1e-9"} for name, x in (("left", 0), ("right", 1), ("middle", 0.5))
            },
            "supports": [
                {"group": "left", "hold": "xyz"},
                {"group": "right", "hold": "xyz"},
                {"group": "all", "hold": "y"},
            ],
            "probes": {
                "level": {"kind": "level", "load": "rain"},
                "middle": {"kind": "displacement", "group": "middle", "component": "z"},
            },
            "derivatives": ["middle"],
        }
        | changes,
    )


def strip_exact(k: float, volume: float) -> tuple[float, float]:
    """Level and middle of a strip under a volume per width: T d'' = -γ d of the depth d.

    Up to k = π it is wet all over, d = h cos(k (x - ½))/cos(k/2); beyond, the pond is π/k wide, d = D cos(k (x - ½)), V = 2 D/k,
    and the strip straight beside it.
    """
    if k < np.pi:
        level = volume * k / (2.0 * np.tan(k / 2.0))
        return level, level - level / np.cos(k / 2.0)
    level = -volume * k**2 * (1.0 - np.pi / k) / 4.0
    return level, level - volume * k / 2.0


@pytest.mark.parametrize("k", [1.0, 2.5, 4.0, 6.0])
def test_a_strip_bears_a_volume_of_water_beyond_its_limit_too(k: float) -> None:
    """Level and sag at second order, stable at any γ, and proportional to the volume, which the adjoint knows."""
    volume = 1e-4
    level, middle = strip_exact(k, volume)
    errors = []
    for size in (16, 32):
        step = run(strip(size, k, volume * WIDTH)).steps[-1]
        assert step.converged, step.reason
        assert step.stable
        errors.append([step.probes["level"] / level - 1.0, step.probes["middle"] / middle - 1.0])
        slope = step.derivatives["middle"]["load.rain"] * volume * WIDTH / step.probes["middle"]
        assert slope == pytest.approx(1.0, rel=1e-4)
    assert np.abs(errors[1]).max() < 3e-3
    assert np.log2(np.array(errors[0]) / np.array(errors[1])) == pytest.approx(2.0, abs=0.25)


def test_a_disc_bears_a_volume_of_water_beyond_its_limit_too() -> None:
    """d = D J₀(k r) over the wet part: all of it up to k R = j₀₁, its level h = d(R); beyond, the radius a = j₀₁/k, and a cone of

    logarithms outside: h = -D k a J₁(j₀₁) ln(R/a). V = 2 π r D J₁(k r)/k at its edge.
    """
    first, volume = jn_zeros(0, 1)[0], 1e-4
    for k in (1.5, 4.0):
        edge = min(1.0, first / k)
        deep = volume * k / (2.0 * np.pi * edge * j1(k * edge))
        level = deep * j0(k) if k < first else -deep * k * edge * j1(first) * np.log(1.0 / edge)
        errors = []
        for rings in (8, 16):
            step = run(
                sheet(
                    {"shape": "disc", "radius": 1.0, "rings": rings}, {"specific_weight": k**2, "given": "volume"}, volume,
                    supports=[{"group": "rim", "hold": "xyz"}],
                    probes={
                        "level": {"kind": "level", "load": "rain"},
                        "centre": {"kind": "displacement", "group": "centre", "component": "z"},
                    },
                )
            ).steps[-1]  # fmt: skip
            assert step.converged, step.reason
            errors.append([step.probes["level"] / level - 1.0, step.probes["centre"] / (level - deep) - 1.0])
        assert np.abs(errors[1]).max() < 0.02
        assert np.abs(errors[1]).max() < 0.4 * np.abs(errors[0]).max()


LIMITS: dict[str, tuple[dict[str, Any], list[dict[str, str]], float]] = {
    "strip": ({"shape": "panel", "width": 1.0, "height": 0.1, "along_y": 1}, [{"group": "all", "hold": "y"}], np.pi**2),
    "square": ({"shape": "panel", "width": 1.0, "height": 1.0}, [], 2.0 * np.pi**2),
    "disc": ({"shape": "disc", "radius": 1.0}, [], float(jn_zeros(0, 1)[0] ** 2)),
}


@pytest.mark.parametrize("name", LIMITS)
def test_linear_limits_of_ponding_at_a_held_level(name: str) -> None:
    """The weight at which the tangent of the flat sheet, just wet, becomes singular: π², 2 π², j₀₁² over T/L², at second order."""
    mesh, supports, exact = LIMITS[name]
    errors = []
    for size in (8, 16):
        counts = {"strip": {"along_x": size}, "square": {"along_x": size, "along_y": size}, "disc": {"rings": size}}[
            name
        ]
        edges = {"left": "x = 0 within 1e-9", "right": "x = 1 within 1e-9"} if name == "strip" else {}
        rim = list(edges) or ["rim" if name == "disc" else "boundary"]
        held = [{"group": edge, "hold": "xyz"} for edge in rim]
        scene = sheet(
            mesh | counts, {"specific_weight": 1.0, "floor": [0.0, 0.0, -1.0]}, 1.0, supports=[*held, *supports],
            groups={edge: {"where": where} for edge, where in edges.items()},
        )  # fmt: skip
        work = Analysis(modelled(scene))
        newton = work.newton
        assert newton is not None
        matrices = []
        for level in (0.5, 1.0 + 1e-9):  # all dry, all wet
            newton.system.set_surface_loads(np.array([level]))
            free = np.flatnonzero(newton.free.ravel() & (np.arange(newton.free.size) % 3 == 2))
            matrices.append(newton.tangent.matrix().toarray()[np.ix_(free, free)])
        dry, wet = matrices
        errors.append(eigh(dry, dry - wet, eigvals_only=True)[0] / exact - 1.0)
    assert abs(errors[1]) < 0.012
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


def test_a_sag_grows_towards_the_limit_of_ponding() -> None:
    """Under q, with the water held at the supports: (q/γ) (1/cos(k/2) - 1), near 1/(1 - γ/γ_cr) of the dry one; none beyond π²."""
    q, size = 1e-4, 32
    area = {"push": {"kind": "area", "group": "all", "direction": [0.0, 0.0, -1.0]}}
    sags = []
    for share in (0.3, 0.6, 0.9):
        k = np.pi * np.sqrt(share)
        rain = {"kind": "water", "face": "front", "specific_weight": k**2, "floor": [0.0, 0.0, -0.1]}
        stage = {"name": "rain", "loads": {"rain": 0.1, "push": q}}
        step = run(strip(size, k, 0.0, loads=area | {"rain": rain}, stages=[stage])).steps[-1]
        assert step.converged
        exact = q / k**2 * (1.0 / np.cos(k / 2.0) - 1.0)
        assert -step.probes["middle"] == pytest.approx(exact, rel=0.01)
        sags.append(-step.probes["middle"] / (q / 8.0))
    assert np.array(sags) * (1.0 - np.array([0.3, 0.6, 0.9])) == pytest.approx(1.0, abs=0.04)


def filled(volume: float = 1.9, **changes: Any) -> Scene:
    """A ball held at its foot that holds a volume of water under a slanting level, beside a pressure."""
    water = {"kind": "water", "specific_weight": 0.5, "given": "volume", "up": [0.2, -0.1, 1.0]}
    stage = {"name": "fill", "pressure": 1.0, "loads": {"water": volume}}
    probes = {
        "z": {"kind": "displacement", "group": "north", "component": "z"},
        "level": {"kind": "level", "load": "water"},
    }
    return ball({}, loads={"water": water}, stages=[stage], probes=probes, **changes)


def test_forces_are_the_slope_of_the_energy_and_the_tangent_is_theirs() -> None:
    """Central differences in a crumpled state, the level following; 1e-7 of the largest force; inertia as that of the sum."""
    work = Analysis(build_model(filled(), build_mesh(filled())))
    newton, filling = work.newton, work.equilibrium.filling
    assert newton is not None
    assert filling.contents is not None
    state = LoadState.of(pressure={"inside": 0.3}, load={"water": 1.9})
    rng = np.random.default_rng(0)
    u = np.where(newton.free, 0.05 * rng.standard_normal(newton.free.shape), 0.0)

    def at(displacement: np.ndarray) -> tuple[np.ndarray, float]:
        newton.system.set_displacement(displacement)
        work.equilibrium.press(state)
        energy = newton.system.potential_energy(np.zeros_like(u))[0] + filling.contents.energy()[0]  # type: ignore[union-attr]
        return newton.free_force(), energy

    force, _ = at(u)
    pond = filling.contents.ponds[0]
    assert pond._held(pond.level(u), u)[0] == pytest.approx(1.9, rel=1e-12)
    factor = newton.factorised(indefinite=True)
    assert factor is not None
    for _ in range(3):
        way = np.where(newton.free, rng.standard_normal(u.shape), 0.0)
        step = 1e-4
        energies = [at(u + share * step * way)[1] for share in (-2.0, -1.0, 1.0, 2.0)]
        slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / (12.0 * step)
        assert float(np.vdot(force, way)) == pytest.approx(-slope, abs=1e-7 * np.abs(force).max() * np.sqrt(way.size))
        less, more = at(u - 1e-6 * way)[0], at(u + 1e-6 * way)[0]
        change = (less - more) / 2e-6
        at(u)
        assert np.abs(factor.times(way) - change).max() < 1e-6 * np.abs(change).max()
        assert factor.solve(factor.times(way)) == pytest.approx(way, abs=1e-8)
    components = np.flatnonzero(newton.free.ravel())
    unit = np.eye(newton.free.size)[components].reshape(-1, *u.shape)
    whole = np.array([factor.times(one).ravel()[components] for one in unit])
    assert factor.negative == int((np.linalg.eigvalsh(whole) < 0.0).sum())


def steps_of(scene: Scene) -> tuple[StepResult, ...]:
    result = run(scene)
    assert result.converged, result.steps[-1].reason
    return result.steps


def test_a_volume_and_its_level_are_the_same_state() -> None:
    """The level found is given to another run; derivatives are those of differences; the hybrid and arc length agree."""
    step = steps_of(filled())[-1]
    rise = {"kind": "water", "specific_weight": 0.5, "up": [0.2, -0.1, 1.0], "floor": [0.0, 0.0, -2.0]}
    floor = -2.0 / np.linalg.norm([0.2, -0.1, 1.0])
    stage = {"name": "fill", "pressure": 1.0, "loads": {"water": step.probes["level"] - floor}}
    level = steps_of(ball({}, loads={"water": rise}, stages=[stage]))[-1]
    assert np.abs(level.displacement - step.displacement).max() < 1e-9
    hybrid = steps_of(filled(solver={"kind": "hybrid", "tolerance": 1e-11}))[-1]
    assert np.abs(hybrid.displacement - step.displacement).max() < 1e-9
    more, less = (steps_of(filled(1.9 + change))[-1] for change in (1e-4, -1e-4))
    difference = (more.probes["z"] - less.probes["z"]) / 2e-4
    assert step.derivatives["z"]["load.water"] == pytest.approx(difference, rel=1e-5)
    path = {"name": "more", "loads": {"water": 2.1}, "control": "arc_length", "steps": 20}
    first = {"name": "fill", "pressure": 1.0, "loads": {"water": 1.9}}
    last = steps_of(_staged([first, path]))[-1]
    there = steps_of(_staged([first, {"name": "more", "loads": {"water": 2.1}}]))[-1]
    assert last.drivers["load.water"] == 2.1
    assert np.abs(last.displacement - there.displacement).max() < 1e-9


def _staged(stages: list[dict[str, Any]]) -> Scene:
    data = filled().model_dump(mode="json")
    return Scene.model_validate(data | {"stages": stages, "derivatives": []})


def test_the_level_of_no_and_of_too_much_water() -> None:
    """The lowest place; the wall above a rim of a dish; infinite in a closed ball that holds less."""
    model = modelled(filled())
    pond, still = model.surface.pond("water", 0.0), np.zeros_like(model.structure.points)
    heights = model.structure.points @ pond.one.up
    assert pond.level(still) == pytest.approx(heights.min() - pond.one.floor)
    full = model.structure.mesh.enclosed_volume()
    assert model.surface.pond("water", 0.999 * full).level(still) < heights.max()
    assert model.surface.pond("water", 1.001 * full).level(still) == np.inf
    dish = modelled(strip(8, 1.0, 1e-3))
    assert isinstance(dish.surface.pond("rain", 0.02), Pond)
    assert dish.surface.pond("rain", 0.02).level(np.zeros_like(dish.structure.points)) == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"solver": {"kind": "relaxation"}, "derivatives": []}, r"loads\.rain\.given = 'volume' needs solver\.kind"),
        (
            {"probes": {"h": {"kind": "level", "load": "snow"}}, "derivatives": []},
            r"probes\.h\.load: 'snow' is not a load of kind",
        ),
        (
            {"supports": [{"group": end, "hold": "xyz"} for end in ("left", "right")]},
            r"loads\.rain\.given = 'volume': the rim",
        ),
        ({"modes": {"kind": "buckling"}}, r"modes of liquids of given volume are not implemented: rain"),
    ],
)
def test_bad_ponds_are_named(changes: dict[str, Any], told: str) -> None:
    with pytest.raises((ValueError, InputError), match=told):
        run(strip(4, 1.0, 1e-3, **changes))


def test_a_law_that_is_not_linear_is_no_matter() -> None:
    """The wet ball of the tension field: it converges in few iterations."""
    step = steps_of(filled(fabric=LINEAR | {"law": "tension_field"}))[-1]
    assert step.iterations <= 25
