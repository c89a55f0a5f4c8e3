"""The claims of docs/seed.md: closed forms against printed numbers, and what the scenes say at coarse size."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from taichi_membrane.execution.run import run
from taichi_membrane.scene.file import load_scene

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
study = import_module("seed_study")
theory = import_module("seed_theory")


def test_closed_forms_give_the_numbers_the_seed_prints() -> None:
    """Equations 24 and 25: 2.15 N and 8.6 N, to the printed digits."""
    assert theory.CANTILEVER.collapse_force / 2 == pytest.approx(2.15, abs=0.005)
    assert replace(theory.BEAM, strap=0.0).collapse_force == pytest.approx(8.6, abs=0.05)


@pytest.mark.parametrize(("share", "deflection"), [(0.5, 2.4040), (0.7, 3.6765), (0.9, 8.1934), (0.97, 18.1393)])
def test_wrinkled_cantilever_against_quadrature_over_the_section(share: float, deflection: float) -> None:
    """Values from an independent integration of the no-compression ring (nu = 0.3), printed to 1e-4 mm; trapezoid adds 1e-5."""
    tube = replace(theory.CANTILEVER, poisson=0.3)
    assert tube.deflection(share * tube.collapse_force) == pytest.approx(deflection, rel=5e-5)


def test_a_strap_lowers_the_moment_under_it() -> None:
    """Uniform load over b in mid-span: M = F (L/4 - b/8), and v = F (8 L³ - 4 L b² + b³)/(384 E I) in bending."""
    strap = replace(theory.BEAM, poisson=-0.999999)  # shear made rigid
    point = replace(strap, strap=0.0)
    assert strap.collapse_force / point.collapse_force == pytest.approx(100 / (100 - 6.25))
    bending = (8 * 400**3 - 4 * 400 * 50**2 + 50**3) / (8 * 400**3)
    assert strap.deflection(1.0) / point.deflection(1.0) == pytest.approx(bending, rel=1e-5)


@pytest.mark.parametrize(("feet", "load"), [("pinned", 871.3), ("fixed", 1004.7)])
def test_arch_first_wrinkle(feet: str, load: float) -> None:
    """Against numerical integration of the thin arch with thrust, to the printed digit."""
    assert theory.arch_first_wrinkle(feet) == pytest.approx(load, abs=0.05)


def test_arch_mechanism_is_in_equilibrium() -> None:
    """At the collapse load of the pinned arch crown and haunch carry (π p r² - thrust) r; both written out anew."""
    load, r, big = theory.arch_mechanism("pinned"), 0.4, 6.0
    tension = theory.ARCH_TUBE.collapse_moment / r
    thrust = (0.5 * load * big - tension * r) / (big - r)
    haunch = (0.25 * load**2 + thrust**2) ** 0.5
    assert 0.5 * load * big - thrust * big == pytest.approx((tension - thrust) * r)
    assert (haunch - 0.5 * load) * big == pytest.approx((tension - haunch) * r)


def test_curves_of_the_scenes_are_drawn_over_these_closed_forms() -> None:
    """The numbers in the files are those of the formulas, to the digits written."""
    cases = {
        "seed_fig5_load": lambda y: theory.CANTILEVER.inflated().deflection(y),
        "seed_fig5_pressure": lambda y: replace(theory.CANTILEVER, pressure=y).inflated().deflection(5.0),
        "seed_fig4_load": lambda y: replace(theory.BEAM, strap=0.0).inflated().deflection(y / 2),
        "seed_fig4_pressure": lambda y: replace(theory.BEAM, strap=0.0, pressure=y).inflated().deflection(25.0),
    }
    for name, deflection in cases.items():
        scene = load_scene(ROOT / "scenes" / f"{name}.toml")
        assert scene.curve is not None
        reference = scene.curve.references[0]
        # Loads are written to 1e-4 N; 1e-4 of deflection follows near collapse.
        for x, y in zip(reference.x, reference.y, strict=True):
            assert x == pytest.approx(deflection(y) if y else 0.0, rel=5e-4, abs=1e-4), (name, y)


COARSE_TUBE = ["mesh.around=16", "mesh.along=32"]


@pytest.mark.usefixtures("runtime_cpu")
def test_table_1_depends_on_the_place_of_the_load() -> None:
    """Ring load within 2 % of the printed 14.34 mm (measured 0.2 %); at the cap's pole, r further out, 14 % more by statics."""
    ring, pole = (
        -study.solve(
            "seed_table1", "mesh.around=16", "mesh.along=28", "stages.load.steps=1", f"loads.tip.group={group}"
        )
        .steps[-1]
        .probes["deflection"]
        for group in ("end", "tip")
    )
    assert ring == pytest.approx(14.34, rel=0.02)
    tube = theory.TABLE1.inflated()
    lever = 50.0 * tube.radius * tube.length**2 / 2.0 / (3.141593 * tube.radius**3 * tube.stiffness)
    assert pole - ring == pytest.approx(lever, rel=0.05)  # measured 1 % at 32 around


@pytest.mark.usefixtures("runtime_cpu")
def test_taut_stress_carried_to_the_root_gives_the_theoretical_first_wrinkle() -> None:
    """Within 3 % (the issue's bound; measured 1 % at 16 around, 0.1 % at 48) of π p r³/(2 L) with inflated dimensions."""
    result = study.solve("seed_fig5_load", *COARSE_TUBE, "stages.load.steps=1", "stages.load.loads={tip=1.0}")
    carried = study.carried_onset(result, theory.CANTILEVER, result.steps[-1], 1.0)
    assert carried == pytest.approx(theory.CANTILEVER.inflated().collapse_force / 2, rel=0.03)


@pytest.mark.usefixtures("runtime_cpu")
def test_beam_theory_after_wrinkling_needs_a_slender_tube() -> None:
    """Softer than Comer-Levy at 0.8 of collapse: 20 % at L = 8 r, 1 % at L = 32 r on fine meshes; here at least four times."""
    softer = []
    for length, along in ((200.0, 16), (800.0, 64)):
        tube = replace(theory.CANTILEVER, length=length)
        force = 0.8 * tube.collapse_force
        result = study.solve(
            "seed_fig5_load",
            "mesh.around=24",
            f"mesh.along={2 * along}",
            f"mesh.length={length}",
            "stages.load.steps=4",
            f"stages.load.loads={{tip={force}}}",
        )
        softer.append(-result.steps[-1].probes["deflection"] / tube.inflated().deflection(force) - 1.0)
    assert softer[0] > 0.12
    assert 0.0 < softer[1] < 0.25 * softer[0]


@pytest.mark.usefixtures("runtime_cpu")
def test_strap_wrinkles_as_beam_theory_says_and_a_node_far_too_early() -> None:
    """Strap: within 3 % of its beam theory (measured 0.1 %). One node: below a third of it, on any mesh (measured 0.1 to 0.2)."""
    devices = study.devices()
    onsets = {}
    for name in ("strap, 50 mm", "one node, 24 × 72"):
        loads = "stages.load.loads={centre=10.308}"
        result = study.solve("seed_fig4_load", *devices[name], "mesh.around=24", "stages.load.steps=12", loads)
        onsets[name] = study.onset(result, "centre", 25.0, 0)
    expected = theory.BEAM.inflated().collapse_force
    assert onsets["strap, 50 mm"] == pytest.approx(expected, rel=0.03)
    assert onsets["one node, 24 × 72"] < expected / 3


@pytest.mark.usefixtures("runtime_cpu")
def test_arch_wrinkles_near_the_seeds_600_newtons_under_a_patch_on_stiff_fabric() -> None:
    """On 24 × 96: ring 1043 N, above thin-arch theory (887 N extrapolated); stiff patch 567 N; the hinges stay in equilibrium."""
    onsets = {}
    for name in ("ring", "patch_stiff"):
        result = study.solve(f"seed_arch_{name}")
        onsets[name] = study.onset(result, "crown", 0.4, 2)
        # 1e-6 of the pressure's nodal forces, some 20 N a node on 4600 nodes, is far below the 0.01 N allowed here.
        assert max(abs(step.probes["hinge"]) for step in result.steps) < 0.01
    assert onsets["ring"] > 871.3
    assert 500.0 < onsets["patch_stiff"] < 650.0


@pytest.mark.usefixtures("runtime_cpu")
def test_a_coarse_arch_inflates_from_almost_no_pressure() -> None:
    """No path is lost at first, where loads are a thousandth of the step's and feet that do not fit the polygon pull at the hinges.

    That was once told as collapse at 2.44 Pa.
    """
    scene = load_scene(
        ROOT / "scenes" / "seed_arch_ring.toml",
        ["mesh.around=12", "mesh.along=48", "solver.tolerance=1e-5", "checks=[]"],
    )
    result = run(scene.model_copy(update={"stages": scene.stages[:1], "curve": None}))
    assert (result.outcome, [step.converged for step in result.steps]) == ("finished", [True])
    assert result.steps[0].probes["deflection"] == pytest.approx(0.0178, abs=0.006)
