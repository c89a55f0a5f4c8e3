"""Strength and its utilisation against hand calculation, where they are told, and checks by inequality."""

from __future__ import annotations

import io
import json
import re
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from rich.console import Console
from run_files import a_step
from stretched import out, pulled

import taichi_membrane as tm
from taichi_membrane.commands import printing
from taichi_membrane.commands.model_printing import print_model
from taichi_membrane.execution.run import read_result, summarise
from taichi_membrane.output.tables import check_columns
from taichi_membrane.page.document import page
from taichi_membrane.scene import Check, Fabric, Scene, Stage
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation import utilisation
from taichi_membrane.simulation.probes import run_checks
from taichi_membrane.simulation.results import RunResult

K, NU, WIDTH, HEIGHT = 500.0, 0.3, 3.0, 2.0
STRETCH = (1.02, 1.015)
SAFETY = {"factor": 5.0, "source": "the user's choice"}
STRONG = {"stiffness": K, "nu": NU, "strength_warp": "86 kN/m", "strength_weft": 60.0, "safety": SAFETY}
BARE = {"stiffness": K, "nu": NU}
FOIL = {
    "stiffness": K,
    "nu": NU,
    "strength": 40.0,
    "strength_source": "a sheet",
    "safety": {"factor": 2.0, "source": "mine"},
}


def sheet(fabric: dict[str, Any] = STRONG, **changes: Any) -> Scene:
    """A sheet of several fabrics of one stiffness, stretched alike everywhere: bare on its right end, a foil beside it."""
    base = pulled(WIDTH, HEIGHT)
    return Scene.model_validate(
        base
        | {
            "name": "sheet",
            "units": {"length": "m", "force": "kN"},
            "mesh": base["mesh"] | {"along_x": 6, "along_y": 2},
            "groups": {
                "bare": {"kind": "elements", "where": "x > 2"},
                "foil": {"kind": "elements", "where": "x > 1 and x < 2"},
                "strong": {"kind": "elements", "where": "x < 1"},
            },
            "fabric": fabric,
            "fabrics": {"bare": BARE, "foil": FOIL},
            "stages": [
                {
                    "name": "pull", "effect_factor": 1.5,
                    "motions": out(WIDTH, HEIGHT, STRETCH),
                },
                {"name": "rest"},
            ],
            "probes": {
                "used": {"kind": "utilisation", "group": "strong"},
                "foil": {"kind": "utilisation", "group": "foil"},
            },
            "checks": [
                {"probe": "used", "stage": "rest", "at_most": 1.0, "source": "strength over safety"},
                {"probe": "used", "stage": "pull", "at_most": 1.0, "at_least": 0.0, "source": "strength over safety"},
            ],
            "solver": {"tolerance": 1e-10},
            "camera": {"field": "utilisation", "size": [320, 240]},
        }
        | changes
    )  # fmt: skip


def by_hand() -> np.ndarray[Any, Any]:
    """Cauchy resultants along x and y of a St Venant-Kirchhoff sheet: S λ over the other stretch."""
    strain = 0.5 * (np.array(STRETCH) ** 2 - 1.0)
    stress = K / (1.0 - NU**2) * (strain + NU * strain[::-1])
    return np.asarray(stress * np.array(STRETCH) / np.array(STRETCH[::-1]))


@pytest.fixture(scope="module")
def run(runtime_cpu: Any, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """The sheet, with files and pictures."""
    return tm.run(sheet(), out=tmp_path_factory.mktemp("sheet") / "run")


def test_utilisation_is_what_the_hand_computes(run: RunResult) -> None:
    assert run.converged
    n_x, n_y = by_hand()
    strong = max(n_x / (86.0 / 5.0), n_y / (60.0 / 5.0))
    assert strong == n_y / 12.0  # the weft governs, though its resultant is the smaller one
    assert n_y < n_x
    pull, rest = run.steps
    assert rest.probes["used"] == pytest.approx(strong, rel=1e-9)
    assert rest.probes["foil"] == pytest.approx(n_x / 20.0, rel=1e-9)
    assert pull.probes["used"] == pytest.approx(1.5 * strong, rel=1e-9)
    values = rest.elements.utilisation
    groups = run.mesh.tri_groups
    assert np.isnan(values[groups["bare"]]).all()
    assert values[groups["strong"]] == pytest.approx(np.full(len(groups["strong"]), strong), rel=1e-9)


def test_the_place_of_the_largest_is_told(run: RunResult) -> None:
    _, n_y = by_hand()
    used = utilisation.largest(run.scene, run.mesh, run.steps[0])
    assert used is not None
    assert (used.direction, used.strength, used.safety, used.factor) == ("weft", 60.0, 5.0, 1.5)
    assert (used.fabric, used.groups) == ("all", "in strong")
    assert used.resultant == pytest.approx(n_y, rel=1e-9)
    assert used.value == pytest.approx(1.5 * n_y / 12.0, rel=1e-9)
    assert used.place[0] < 1.02
    told = utilisation.words(used, run.scene)
    assert re.match(r"\S+: weft resultant \S+ × 1.5 over 60/5 kN/m, fabric of all, element \d+ in strong, at \(", told)


def test_files_the_page_and_the_terminal_tell_it(run: RunResult) -> None:
    assert run.directory is not None
    summary = json.loads((run.directory / "summary.json").read_text("utf-8"))
    record = summary["steps"][0]["utilisation"]
    assert record["direction"] == "weft"
    assert record["value"] == pytest.approx(run.steps[0].probes["used"], rel=1e-12)
    assert summary["fields"]["utilisation"]["unit"] == ""
    saved = read_result(run.directory)
    assert np.array_equal(saved.steps[1].elements.utilisation, run.steps[1].elements.utilisation, equal_nan=True)
    assert (run.directory / "step_0001.png").is_file()
    assert "largest utilisation" in page(run)
    said = io.StringIO()
    printing.print_run(Console(file=said, width=250), run)
    assert re.search(r"utilised +most in pull, load step 0: \S+: weft resultant", said.getvalue())
    assert probe_unit(run.scene, "used") == ""


def test_check_tells_strength_with_its_sources() -> None:
    said = io.StringIO()
    print_model(Console(file=said, width=300), *summarise(sheet()))
    assert "strength 86/60 kN/m (no source given) over safety 5 (the user's choice)" in said.getvalue()
    assert "strength 40 kN/m (a sheet) over safety 2 (mine)" in said.getvalue()


def test_checks_by_inequality(run: RunResult) -> None:
    rest, pull = run.checks
    used = run.steps[0].probes["used"]
    assert used > 1.0
    assert rest.passed == (used / 1.5 <= 1.0)
    assert not pull.passed
    assert pull.error == pytest.approx(used - 1.0)
    assert (pull.reference, pull.at_most, pull.at_least) == (None, 1.0, 0.0)
    columns = {column.header: column.cells for column in check_columns(run.scene, run.checks)}
    assert columns["reference"] == ["≤ 1", "≥ 0, ≤ 1"]
    assert columns["tolerance"] == ["-", "-"]
    said = io.StringIO()
    printing.print_failed_checks(Console(file=said, width=250), run)
    assert re.search(
        r"CHECK FAILS: used at pull 1: \S+ \(error \+\S+\), ≥ 0, ≤ 1: strength over safety", said.getvalue()
    )


@pytest.mark.parametrize(
    ("bounds", "value", "error"),
    [
        ({"at_most": 2.0}, 2.0, 0.0),
        ({"at_most": 2.0}, 2.5, 0.5),
        ({"at_least": -2.0}, -2.5, 0.5),
        ({"at_least": -2.0}, 7.0, -9.0),
        ({"at_least": -1.0, "at_most": 1.0}, 0.75, -0.25),
        ({"at_least": -1.0, "at_most": 1.0}, -1.25, 0.25),
        ({"at_most": 1.0}, float("nan"), None),
    ],
)
def test_a_bound_is_kept_or_passed_by_so_much(bounds: dict[str, float], value: float, error: float | None) -> None:
    scene = sheet(checks=[{"probe": "used", "stage": "rest", "source": "s", **bounds}])
    step = a_step(1, stage="rest", stage_step=1, probes={"used": value})
    (found,) = run_checks(scene, [step])
    assert found.passed == (error is not None and error <= 0.0)
    if error is not None:
        assert found.error == pytest.approx(error)
    (unreached,) = run_checks(scene, [])
    assert not unreached.passed
    assert unreached.value is None


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "give either reference, or at_most, at_least or both"),
        ({"reference": 1.0, "at_most": 2.0, "absolute": 1.0}, "give either reference, or at_most, at_least or both"),
        ({"at_most": 2.0, "tolerance": 0.1}, "tolerance and absolute belong to a reference; at_most is kept or not"),
        ({"at_most": 1.0, "at_least": 2.0}, "at_least = 2 is above at_most = 1"),
        ({"reference": 1.0}, "give either tolerance (relative) or absolute"),
    ],
)
def test_bounds_and_references_are_not_mixed(given: dict[str, float], told: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(told)):
        Check(probe="used", stage="rest", source="s", **given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"strength_warp": 1.0, "safety": SAFETY},
            "give strength, or both strength_warp and strength_weft; given are: strength_warp",
        ),
        ({"strength": 1.0, "strength_warp": 1.0, "safety": SAFETY}, "given are: strength, strength_warp"),
        ({"strength": 1.0}, "strength needs a safety factor to be compared with: give safety = { factor = ..., source"),
        ({"safety": SAFETY}, "safety and strength_source are for a fabric with a strength"),
        ({"strength": 1.0, "safety": {"factor": 0.5, "source": "x"}}, "Input should be greater than or equal to 1"),
        ({"strength": 1.0, "safety": {"factor": 2.0, "source": ""}}, "at least 1 item"),
    ],
)
def test_a_strength_is_whole_and_has_a_safety_factor_with_a_source(given: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(told)):
        Fabric(stiffness=K, nu=NU, **given)


def test_what_has_no_strength_has_no_utilisation() -> None:
    with pytest.raises(
        tm.InputError, match=re.escape("probes.used.group: the fabric of bare has no strength to compare with")
    ):
        summarise(sheet(probes={"used": {"kind": "utilisation"}}, checks=[]))
    plain = {"fabric": BARE, "fabrics": {}, "probes": {}, "checks": []}
    with pytest.raises(ValidationError, match=re.escape("camera.field: 'utilisation' needs a fabric with a strength")):
        Scene.model_validate({**sheet().model_dump(), **plain})
    bare = Scene.model_validate({**sheet().model_dump(), **plain, "camera": {}})
    assert "utilisation" not in bare.extra_fields
    assert Stage(name="one").effect_factor == 1.0
