"""Shrinkage and temperature: the law's stress where they are hindered, none where they are free; forces, tangents, derivatives."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import ISOTROPIC, ORTHOTROPIC, closed_body, law
from resume_cases import run_until
from run_files import different, outcome
from test_rim import crumpled, modelled

import taichi_membrane as tm
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run, summarise
from taichi_membrane.mechanics.nodes import room
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.parametric.measured import Measured, at_readings, reading_steps
from taichi_membrane.scene import Scene, Stage

pytestmark = pytest.mark.usefixtures("runtime_cpu")

E_WARP, E_WEFT, NU, G = 1000.0, 600.0, 0.2, 50.0
FABRIC = {
    "E_warp": E_WARP, "E_weft": E_WEFT, "nu": NU, "G": G, "thickness": 0.5, "warp": [1.0, 0.0, 0.0],
    "expansion": [1e-4, 2.5e-4],
}  # fmt: skip
STIFFNESS = np.array([[E_WARP, NU * E_WEFT], [NU * E_WEFT, E_WEFT]]) / (1.0 - NU**2 * E_WEFT / E_WARP)
CORNER = [{"group": "x_min", "hold": "x"}, {"group": "y_min", "hold": "y"}, {"group": "all", "hold": "z"}]


def square(**changes: Any) -> Scene:
    """A square of side 2, its rim held unless supports are given."""
    content = {
        "name": "square",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "panel", "width": 2.0, "height": 2.0, "along_x": 4, "along_y": 4},
        "fabric": FABRIC,
        "supports": [{"group": "boundary", "hold": "xyz"}, {"group": "all", "hold": "z"}],
        "pressures": {},
        "shrinkages": {"cure": {"warp": 0.01, "weft": 0.02}},
        "temperatures": {"sun": {}},
        "stages": [{"name": "cure", "shrinkages": {"cure": 1.0}}],
        "solver": {"kind": "newton", "tolerance": 1e-12},
        **changes,
    }
    return Scene.model_validate(content)


@pytest.mark.parametrize("kind", ["newton", "relaxation"])
@pytest.mark.parametrize("side_strain", ["green", "engineering"])
def test_a_held_square_that_shrinks_is_stressed_by_its_law(side_strain: str, kind: str) -> None:
    """To round-off: the strain of the hindered extension through the stiffness, by turns of fabric axes as well."""
    extension = np.array([-0.01, -0.02])
    free = extension + 0.5 * extension**2 if side_strain == "green" else extension
    for warp in ([1.0, 0.0, 0.0], [2.0, 3.0, 0.0]):
        fabric = {**FABRIC, "side_strain": side_strain, "warp": warp}
        step = run(square(fabric=fabric, solver={"kind": kind, "tolerance": 1e-9})).steps[-1]
        assert step.converged
        exact = np.append(STIFFNESS @ -free, 0.0)
        assert np.abs(step.elements.stress - exact).max() < 1e-12 * exact.max()
        assert np.abs(step.displacement).max() < 1e-15
        assert step.energy == pytest.approx(4.0 * 0.5 * 0.5 * exact[:2] @ -free, rel=1e-12)


@pytest.mark.parametrize("kind", ["newton", "relaxation"])
def test_a_free_square_grows_without_stress(kind: str) -> None:
    """Its length by exactly the extension in warp and weft, with Green's strain; no stress but the residual's, and stable."""
    stages = [
        {"name": "noon", "steps": 2, "temperatures": {"sun": 200.0}},
        {"name": "night", "temperatures": {"sun": -40.0}},
    ]
    result = run(
        square(
            stages=stages, supports=CORNER, fabric={**FABRIC, "law": "none"}, solver={"kind": kind, "tolerance": 1e-10}
        )
    )
    for step, degrees in zip(result.steps, (100.0, 200.0, -40.0), strict=True):
        assert step.converged
        assert step.drivers["temperature.sun"] == degrees
        growth = degrees * np.array([1e-4, 2.5e-4, 0.0])
        assert np.abs(step.displacement - growth * result.mesh.points).max() < 1e-9
        assert np.abs(step.elements.stress).max() < 1e-6
    if kind == "newton":
        assert result.steps[-1].stable


def test_a_held_square_that_grows_goes_slack_and_one_that_grows_one_way_wrinkles() -> None:
    """Slack: no stress, and the growth is in its folds. Wrinkled: uniaxial stress of the shrinking side alone."""
    step = run(square(stages=[{"name": "noon", "temperatures": {"sun": 50.0}}], solver={})).steps[-1]
    assert step.converged
    assert (step.elements.state == 2).all()
    assert not step.elements.stress.any()
    assert step.elements.fold_strain == pytest.approx(0.0125 + 0.5 * 0.0125**2, rel=1e-9)
    both = {"one": {"warp": 0.01, "weft": -0.02}}
    stages = [{"name": "cure", "shrinkages": {"one": 1.0}}]
    step = run(square(shrinkages=both, temperatures={}, stages=stages, solver={})).steps[-1]
    assert step.converged
    assert (step.elements.state == 1).all()
    exact = np.array([E_WARP * (0.01 - 0.5 * 0.01**2), 0.0, 0.0])
    assert np.abs(step.elements.stress - exact).max() < 1e-8


def grown(fabrics: tuple[Any, ...], **parts: Any) -> Structure:
    """A closed body of two fabrics with two drivers of stress-free strain."""
    rng = np.random.default_rng(4)
    return closed_body(
        ISOTROPIC, fabrics=fabrics, tri_fabric=np.repeat(np.array([0, 1], dtype=np.int32), 10),
        growth=rng.normal(size=(20, 2, 2)), tri_prestress=0.05 * rng.normal(size=(20, 3)), **parts,
    )  # fmt: skip


@pytest.mark.parametrize("side_strain", ["green", "engineering"])
@pytest.mark.parametrize("kind", ["none", "tension_field"])
def test_forces_are_minus_the_gradient_of_the_energy(kind: str, side_strain: str) -> None:
    """At random states of isotropic and orthotropic fabric, taut, wrinkled and slack; central differences."""
    fabrics = (
        law(kind, side_strain=side_strain),
        law(kind, **{**vars(ORTHOTROPIC), "law": kind, "side_strain": side_strain}),
    )
    system, rng = System(grown(fabrics)), np.random.default_rng(5)
    system.set_surface_loads(np.array([0.1]))
    seen = set()
    for values in ([0.0, 0.0], [0.1, -0.05], [-0.3, 0.2]):
        system.set_growth(np.array(values))
        position, way = 0.1 * rng.normal(size=(12, 3)), rng.normal(size=(12, 3))
        step, energies = 1e-5, []
        for sign in (1.0, -1.0):
            system.set_displacement(position + sign * step * way)
            energies.append(system.potential_energy(np.zeros((12, 3)))[0])
        system.set_displacement(position)
        work = float(np.vdot(system.out_of_balance(), way))
        assert -(energies[0] - energies[1]) / (2.0 * step) == pytest.approx(work, rel=1e-7)
        seen |= set(system.element_state().state.tolist())
    assert seen == ({0} if kind == "none" else {0, 1, 2})


def test_the_tangent_is_that_of_the_forces() -> None:
    loads = {"loads": {}, "stages": [{"name": "a", "shrinkages": {"cure": 2.0}, "temperatures": {"sun": 80.0}}]}
    mesh = {"shape": "sphere", "radius": 1.0, "divisions": 2}
    supports = [{"group": "foot", "hold": "xyz"}]
    groups = {"foot": {"where": "z < -0.3"}}
    newton, u = crumpled(square(mesh=mesh, supports=supports, groups=groups, **loads), [])
    newton.system.set_growth(np.array([2.0, 80.0]))
    whole = newton.tangent.matrix().toarray()
    free, step = np.flatnonzero(newton.free.ravel()), 1e-6
    differences = np.zeros_like(whole)
    for k in free:
        forces = []
        for sign in (1.0, -1.0):
            newton.system.set_displacement(u + sign * step * np.eye(u.size)[k].reshape(u.shape))
            forces.append(newton.free_force().ravel())
        differences[:, k] = (forces[1] - forces[0]) / (2 * step)
    newton.system.set_displacement(u)
    inner = np.ix_(free, free)
    assert np.abs(differences - whole)[inner].max() < 1e-8 * np.abs(whole).max()
    newton.system.set_growth(np.zeros(2))
    assert np.abs(newton.tangent.matrix().toarray() - whole)[inner].max() > 1e-3 * np.abs(whole).max()


def test_a_factor_kept_at_rest_is_not_that_of_another_growth() -> None:
    """Where nothing moved and no load changed, shrinkage or warmth alone makes another tangent."""
    stages = [{"name": "blow", "pressure": 5.0, "shrinkages": {"cure": 0.3}, "temperatures": {"sun": 20.0}}]
    held = [{"group": "boundary", "hold": "xyz"}]
    newton, _ = crumpled(square(supports=held, pressures={"wind": {}}, loads={}, stages=stages), [5.0])
    force = np.where(newton.free, np.random.default_rng(2).normal(size=newton.free.shape), 0.0)
    for values in ([0.0, 0.0], [0.3, 0.0], [0.3, 20.0]):
        newton.system.set_growth(np.array(values))
        factor = newton.at_rest()
        assert factor is not None
        assert newton.at_rest() is factor
        left = newton.tangent.matrix() @ factor.solve(force).ravel() - force.ravel()
        assert np.linalg.norm(left[newton.free.ravel()]) < 1e-9 * np.linalg.norm(force)


def tent(cure: float, sun: float, **changes: Any) -> Scene:
    """A square under pressure whose fabric shrinks and warms: taut and wrinkled parts."""
    changed = {"steps": 2, "shrinkages": {"cure": cure}, "temperatures": {"sun": sun}}
    return square(
        supports=[{"group": "boundary", "hold": "xyz"}],
        pressures={"wind": {}},
        stages=[{"name": "blow", "pressure": 5.0}, {"name": "cure", **changed}],
        probes={"rise": {"kind": "displacement", "group": "all", "component": "z"}},
        derivatives=[] if "solver" in changes else ["rise"],
        temperatures={"sun": {"group": "left"}},
        groups={"left": {"where": "x < 1", "kind": "elements"}},
        **changes,
    )


def test_derivatives_by_shrinkage_and_temperature_are_those_of_differences() -> None:
    base = run(tent(0.3, 20.0)).steps[-1]
    assert base.converged
    for driver, h, ends in (
        ("shrinkage.cure", 1e-3, [(0.301, 20.0), (0.299, 20.0)]),
        ("temperature.sun", 1e-2, [(0.3, 20.01), (0.3, 19.99)]),
    ):
        more, less = (run(tent(*one)).steps[-1].probes["rise"] for one in ends)
        assert base.derivatives["rise"][driver] == pytest.approx((more - less) / (2.0 * h), rel=1e-5)
        assert base.derivatives["rise"][driver] != 0.0


def test_both_solvers_find_one_state() -> None:
    newton, relaxed = (
        run(tent(0.3, 20.0, solver={"kind": kind, "tolerance": 1e-9})) for kind in ("newton", "relaxation")
    )
    assert newton.converged
    assert relaxed.converged
    assert np.abs(newton.steps[-1].displacement - relaxed.steps[-1].displacement).max() < 1e-7


def test_warmth_buckles_a_prestressed_sheet_where_its_tension_ends() -> None:
    """Exact: N = t (σ₀ - E α T/(1 - ν)) of an isotropic sheet held at its rim is zero, and so is all stiffness out of its plane."""
    fabric = {"E": 800.0, "nu": 0.25, "thickness": 0.5, "law": "none", "side_strain": "engineering", "expansion": [1e-4, 1e-4],
              "prestress": [4.0, 4.0, 0.0]}  # fmt: skip
    result = run(
        square(
            fabric=fabric, supports=[{"group": "boundary", "hold": "xyz"}], modes={"kind": "buckling", "count": 3},
            stages=[{"name": "noon", "temperatures": {"sun": 10.0}}],
        )
    )  # fmt: skip
    assert result.converged
    critical = 4.0 * (1.0 - 0.25) / (800.0 * 1e-4)
    (step,) = result.steps
    assert step.modes is not None
    assert np.array(step.modes.values) * 10.0 == pytest.approx(critical, rel=1e-6)
    assert step.stable
    beyond = square(fabric=fabric, supports=[{"group": "boundary", "hold": "xyz"}],
                    stages=[{"name": "noon", "steps": 4, "temperatures": {"sun": 60.0}}])  # fmt: skip
    steps = run(beyond).steps
    assert [step.converged for step in steps[:2]] == [True, True]
    assert all(step.stable for step in steps if step.converged and step.limit is None)


def test_arc_length_and_readings_follow_a_temperature() -> None:
    """The path by arc length ends where load control does; a measured curve over a temperature is cut at its readings."""
    ends = [{"name": "blow", "pressure": 5.0}, {"name": "warm", "steps": 20, "temperatures": {"sun": 40.0}}]
    controlled, walked = (
        run(tent(0.0, 0.0).model_copy(update={"stages": tuple(map(Stage.model_validate, stages))}))
        for stages in (ends, [ends[0], ends[1] | {"control": "arc_length"}])
    )
    assert walked.converged
    assert walked.steps[-1].drivers["temperature.sun"] == 40.0
    assert np.abs(controlled.steps[-1].displacement - walked.steps[-1].displacement).max() < 1e-9
    scene = tent(0.0, 0.0).model_copy(update={"stages": list(map(Stage.model_validate, ends))})
    curve = Measured(quantity="temperature.sun", x=(10.0, 30.0), y=(0.0, 0.0), deviation=None)
    cut = at_readings(scene, curve, None)
    assert [stage.temperatures for stage in cut.stages[1:]] == [{"sun": 10.0}, {"sun": 30.0}]
    assert reading_steps(scene, cut, curve) == ["warm_1", "warm_2"]


def test_single_precision_agrees() -> None:
    """In a process of its own, as one has one precision: the law's stress to its digits, and a wrinkled tent's rise."""
    program = (
        "import sys, json, taichi_membrane as tm\n"
        "scenes = [tm.Scene.model_validate(one) for one in json.load(sys.stdin)]\n"
        "for scene in scenes:\n"
        "    step = tm.run(scene, precision='f32').steps[-1]\n"
        "    assert step.converged, step.reason\n"
        "    print(step.elements.stress.max(), step.displacement[:, 2].max())\n"
    )
    scenes = [square(solver={}), tent(0.3, 20.0, solver={})]
    given = json.dumps([scene.model_dump(mode="json") for scene in scenes])
    done = subprocess.run([sys.executable, "-c", program], input=given, capture_output=True, text=True, check=True)
    for line, scene in zip(done.stdout.splitlines()[-2:], scenes, strict=True):
        step = run(scene).steps[-1]
        stress, rise = map(float, line.split())
        assert stress == pytest.approx(step.elements.stress.max(), rel=1e-4)
        assert rise == pytest.approx(step.displacement[:, 2].max(), rel=1e-4, abs=1e-6)


def test_a_stopped_run_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    whole = run(tent(0.3, 20.0), out=tmp_path / "whole", render=False)
    assert whole.converged
    header = (tmp_path / "whole/history.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert {"shrinkage.cure", "temperature.sun [K]"} <= set(header)
    run_until(1, tent(0.3, 20.0), out=tmp_path / "part", render=False)
    tm.resume(tmp_path / "part")
    assert different(outcome(tmp_path / "whole"), outcome(tmp_path / "part")) == []


def test_what_shrinks_nowhere_costs_nothing_and_what_does_a_vector_for_each_element() -> None:
    plain = square(stages=[{"name": "still", "shrinkages": {"cure": 0.0}}])
    _, _, left_out = summarise(plain)
    assert "stress-free strain" in left_out
    systems = [System(modelled(scene).structure) for scene in (plain, square())]
    names = [{name for name, _ in system.fields()} for system in systems]
    assert names[1] - names[0] == {"tri_offset"}
    assert systems[1].bytes_allocated() - systems[0].bytes_allocated() == 24 * room(systems[0].tri_count)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"shrinkages": {"cure": {}}}, r"shrinkages\.cure\s+Value error, give warp, weft, or both"),
        ({"shrinkages": {"cure": {"group": "roof", "warp": 0.1}}}, r"shrinkages\.cure\.group: no element group 'roof' in this"),
        ({"fabric": {**FABRIC, "expansion": [0.0, 0.0]}}, r"temperatures\.sun: no fabric has an expansion; give fabric\.expansion"),
        ({"stages": [{"name": "a", "shrinkages": {"cur": 1.0}}]}, r"'cur' is not a shrinkage of this scene; allowed: cure"),
        ({"stages": [{"name": "a", "shrinkages": {"cure": 60.0}}]},
         r"stages\.a: element \d+ loses 120 % of its length along the weft; nothing would be left"),
        ({"fabric": {key: value for key, value in FABRIC.items() if key != "warp"},
          "mesh": {"shape": "file", "path": "square.obj"}}, r"this mesh has no warp direction of its own; give warp"),
    ],
)  # fmt: skip
def test_bad_shrinkage_is_named(
    changes: dict[str, Any], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("square.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n", encoding="utf-8")
    with pytest.raises((ValueError, InputError), match=expected):
        modelled(square(**changes))
