"""A fabric given per width: the same structure without a thickness, whose stresses are forces per width; and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import taichi_membrane as tm
from taichi_membrane import fields
from taichi_membrane.execution.run import read_result
from taichi_membrane.page.document import page
from taichi_membrane.scene import Fabric, Scene
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.results import RunResult

RADIUS, PRESSURE = 25.0, 0.8
AREA = {"E_warp": 400.0, "E_weft": 200.0, "G": 20.0, "thickness": 0.5, "prestress": (6.0, 4.0, 0.0), "density": 2e-9}
WIDTH = {
    "stiffness_warp": 200.0, "stiffness_weft": "100 kN/m", "G_t": 10.0, "pretension": ("3 kN/m", 2.0, 0.0),
    "mass_per_area": "1 kg/m²",
}  # fmt: skip
ALONG = {"warp": "axial", "weft": "hoop"}


def tube(fabric: dict[str, Any], **changes: Any) -> Scene:
    """A closed tube, its warp along it, stretched by some fifth around it."""
    mean = {"group": "belly", "reduce": "mean"}
    return Scene.model_validate(
        {
            "name": "tube",
            "units": {"length": "mm", "force": "N"},
            "mesh": {
                "shape": "tube", "radius": RADIUS, "length": 200.0, "around": 32, "along": 24, "cap_start": "hemisphere",
                "cap_end": "hemisphere",
            },
            "groups": {
                "belly": {"kind": "elements", "where": "x > 75 and x < 125"},
                "mid_top": {"where": "x = 100 within 1e-6 and y = 0 within 1e-6"},
                "mid_side": {"where": "x = 100 within 1e-6 and z = 0 within 1e-6"},
                "before": {"where": "x > 74 and x < 76"},
                "behind": {"where": "x > 124 and x < 126"},
            },
            "fabric": {"nu": 0.1, **fabric},
            "supports": [
                {"group": "middle", "hold": "x"}, {"group": "mid_top", "hold": "y"}, {"group": "mid_side", "hold": "z"},
            ],
            "stages": [{"name": "inflate", "pressure": PRESSURE}],
            "probes": {
                **{name: {"kind": "resultant", "which": which, **mean} for which, name in ALONG.items()},
                **{
                    f"{name}_pk2": {"kind": "resultant", "which": which, "measure": "PK2", **mean}
                    for which, name in ALONG.items()
                },
                "shear": {"kind": "resultant", "which": "shear", **mean},
                "largest_pk2": {"kind": "resultant", "measure": "PK2", **mean},
                "stress": {"kind": "stress", **mean},
                "radius": {"kind": "radius", "group": "middle", "axis": "x"},
                "start": {"kind": "position", "group": "before", "component": "x"},
                "end": {"kind": "position", "group": "behind", "component": "x"},
            },
            "derivatives": ["radius"],
            "solver": {"tolerance": 1e-10},
        }
        | changes
    )  # fmt: skip


@pytest.fixture(scope="module")
def runs(runtime_cpu: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunResult]:
    """The tube given by area and by width."""
    folder = tmp_path_factory.mktemp("runs")
    given = {"area": tube(AREA), "width": tube(WIDTH)}
    return {name: tm.run(scene, out=folder / name, render=False) for name, scene in given.items()}


def test_the_structure_is_the_same(runs: dict[str, RunResult]) -> None:
    by_area, by_width = (runs[name].steps[-1] for name in ("area", "width"))
    assert by_area.converged
    assert by_width.converged
    assert by_width.displacement == pytest.approx(by_area.displacement, rel=1e-9, abs=1e-9 * RADIUS)
    for name in ("major_resultant", "minor_resultant", "warp_resultant", "weft_resultant"):
        assert by_width.fields[name] == pytest.approx(by_area.fields[name], rel=1e-8)
    for name in ("axial", "hoop", "axial_pk2", "hoop_pk2", "largest_pk2"):
        assert by_width.probes[name] == pytest.approx(by_area.probes[name], rel=1e-9)
    # Its stress is per width: that of the other one times its thickness.
    assert by_width.probes["stress"] == pytest.approx(0.5 * by_area.probes["stress"], rel=1e-9)
    assert by_width.elements.stress == pytest.approx(0.5 * by_area.elements.stress, rel=1e-8, abs=1e-8)


def test_resultants_are_those_of_a_closed_tube(runs: dict[str, RunResult]) -> None:
    """Cauchy: p r around and p r/2 along, r the present radius. Second Piola-Kirchhoff: p R λ along the stretch λ, and
    p R λ_t²/(2 λ) along it; at a stretch of a quarter they differ by as much."""
    found = runs["width"].steps[-1].probes
    around = found["radius"] / RADIUS
    along = (found["end"] - found["start"]) / 50.0
    assert 1.15 < around < 1.3
    assert found["hoop"] == pytest.approx(PRESSURE * found["radius"], rel=6e-3)
    assert found["axial"] == pytest.approx(PRESSURE * found["radius"] / 2.0, rel=6e-3)
    assert found["hoop_pk2"] == pytest.approx(PRESSURE * RADIUS * along, rel=6e-3)
    assert found["axial_pk2"] == pytest.approx(PRESSURE * RADIUS * around**2 / (2.0 * along), rel=6e-3)
    assert found["largest_pk2"] == pytest.approx(found["hoop_pk2"], rel=1e-3)
    assert abs(found["shear"]) < 1e-3 * found["hoop"]
    assert found["hoop"] > 1.1 * found["hoop_pk2"]


def test_derivatives_ask_for_a_thickness_only_where_there_is_one(runs: dict[str, RunResult]) -> None:
    by_area, by_width = (runs[name].steps[-1].derivatives["radius"] for name in ("area", "width"))
    assert set(by_area) - set(by_width) == {"thickness"}
    assert by_width["pressure.inside"] == pytest.approx(by_area["pressure.inside"], rel=1e-7)


def test_labels_files_and_the_page_say_per_width(runs: dict[str, RunResult]) -> None:
    scene = runs["width"].scene
    assert scene.per_width
    assert fields.named("major_stress").label(scene.field_units) == "major stress resultant [kN/m PK2]"
    assert fields.named("contact_pressure").unit_label(scene.field_units) == "MPa"
    units = {name: probe_unit(scene, name) for name in ("stress", "hoop", "hoop_pk2")}
    assert units == {"stress": "kN/m PK2", "hoop": "kN/m Cauchy", "hoop_pk2": "kN/m PK2"}
    assert probe_unit(runs["area"].scene, "stress") == "MPa PK2"
    folder = runs["width"].directory
    assert folder is not None
    notes = json.loads((folder / "summary.json").read_text("utf-8"))["fields"]
    assert (notes["stress"]["unit"], notes["stress"]["meaning"]) == ("kN/m", "stress resultant in fabric axes")
    assert notes["weft_resultant"]["arrays"] == ["weft_resultant_cauchy"]
    text = page(runs["width"])
    assert "stiffness warp [kN/m]" in text
    assert re.search(r"largest resultant</dt><dd>\S+ kN/m Cauchy", text)
    saved = read_result(folder)
    assert np.array_equal(saved.steps[-1].elements.weft_resultant, runs["width"].steps[-1].elements.weft_resultant)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"thickness": 0.5},
            "stiffness_warp and stiffness_weft and G_t are per width, and thickness would need a thickness",
        ),
        ({"E_warp": 3.0}, "are per width, and E_warp would need a thickness; leave out the one or the other"),
        ({"density": 1e-9}, "and density would need a thickness"),
        ({"prestress": (1.0, 1.0, 0.0)}, "and prestress would need a thickness"),
        ({"G_t": None}, "give stiffness, or all of stiffness_warp, stiffness_weft and G_t (G_t missing)"),
        ({"stiffness": 5.0}, "stiffness makes an isotropic fabric; leave out stiffness_warp, stiffness_weft, G_t"),
        ({"nu": 2.0}, "(the square root of stiffness_warp/stiffness_weft)"),
    ],
)
def test_what_a_fabric_per_width_does_not_have_is_refused(changes: dict[str, Any], told: str) -> None:
    given = {"stiffness_warp": 200.0, "stiffness_weft": 100.0, "G_t": 10.0, "nu": 0.1} | changes
    with pytest.raises(ValidationError, match=re.escape(told)):
        Fabric(**given)


def test_a_thickness_and_a_pretension_are_asked_for_where_they_belong(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="thickness is missing; or give the fabric per width: stiffness, or "):
        Fabric(E=4.0, nu=0.1)
    with pytest.raises(ValidationError, match="pretension is for a fabric given per width; give prestress"):
        Fabric(E=4.0, nu=0.1, thickness=1.0, pretension=(1.0, 1.0, 0.0))
    assert Fabric(stiffness=4.0, nu=0.25).shear_modulus == 4.0 / 2.5
    both = {"fabrics": {"belly": {"nu": 0.1, **AREA}}}
    with pytest.raises(
        ValidationError, match=re.escape("fabric is given per width and fabrics.belly with a thickness")
    ):
        tube(WIDTH, **both)
    with pytest.raises(ValidationError, match=r"fabric\.mass_per_area is missing: loads\.own needs it"):
        tube({**WIDTH, "mass_per_area": None}, loads={"own": {"kind": "weight", "g": 9.81}})


def test_a_resultant_along_no_warp_is_not_measured() -> None:
    sheet = tm.Mesh.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    asked = {
        "name": "bare", "units": {"length": "m", "force": "N"}, "mesh": {"shape": "given"},
        "fabric": {"stiffness": 1.0, "nu": 0.3}, "supports": [{"group": "all", "hold": "xyz"}],
        "stages": [{"name": "one", "pressure": 0.0}], "probes": {"n": {"kind": "resultant", "which": "weft"}},
    }  # fmt: skip
    told = r"probes.n.which = 'weft': neither this mesh nor the fabric of all has a warp; give it warp = \[x, y, z\]"
    with pytest.raises(tm.InputError, match=told):
        tm.run(Scene.model_validate(asked), mesh=sheet)
