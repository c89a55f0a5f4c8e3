"""Fabrics by name: every number says what it is worth, a scene's own numbers come first, and check tells what is assumed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.scene import Fabric, Scene, presets

ROOT = Path(__file__).resolve().parent.parent
SAFETY = {"factor": 5.0, "source": "the user's choice"}
# What presets without sources for it leave to the user.
REST: dict[str, dict[str, Any]] = {
    **{
        f"ptfe-glass-{one}": {"stiffness_warp": 1000.0, "stiffness_weft": 800.0, "G_t": 50.0, "nu": 0.5}
        for one in "abc"
    },
    "etfe-foil": {"thickness": "0.2 mm", "strength": 10.0, "safety": SAFETY},
}


def scene(fabric: dict[str, Any], **units: str) -> Scene:
    """A sheet of a fabric."""
    return Scene.model_validate(
        {
            "name": "sheet", "units": {"length": "m", "force": "kN"} | units,
            "mesh": {"shape": "panel", "width": 3.0, "height": 2.0, "along_x": 3, "along_y": 2}, "fabric": fabric,
            "supports": [{"group": "x_min", "hold": "xyz"}], "stages": [{"name": "one"}],
        }
    )  # fmt: skip


def made(fabric: dict[str, Any], **units: str) -> Fabric:
    found = scene(fabric, **units).fabric
    assert found is not None
    return found


@pytest.mark.parametrize("name", presets.names())
def test_every_preset_is_a_fabric_whose_numbers_have_sources_or_are_assumed(name: str) -> None:
    for key, entry in presets.entries(name).items():
        assert entry.kind in presets.KINDS, key
        assert bool(entry.source) == (entry.kind != "assumed"), key
    assert presets.title(name)
    fabric = made({"preset": name, "safety": SAFETY, **REST.get(name, {})})
    assert fabric.has_strength
    assert fabric.has_mass
    kept = {key: value for key, value in REST.get(name, {}).items() if key not in ("strength", "safety")}
    bare = made({"preset": name, **kept})
    assert not bare.has_strength  # nothing is compared without a safety factor of the user's


def test_numbers_are_those_of_the_file_in_the_units_of_the_scene() -> None:
    fabric = made({"preset": "pvc-pes-ii", "safety": SAFETY})
    assert (fabric.strength_warp, fabric.stiffness_warp, fabric.mass_per_area) == (86.0, 1000.0, 0.00105)
    again = made({"preset": "pvc-pes-ii", "safety": SAFETY}, length="mm", force="N")
    assert (again.strength_warp, again.mass_per_area) == (86.0, 1.05e-9)
    assert fabric.strength_source.startswith("preset pvc-pes-ii, sheet: data sheet of a PVC-coated polyester")
    whole = scene({"preset": "pvc-pes-ii", "safety": SAFETY})
    assert Scene.model_validate(whole.model_dump(mode="json")) == whole


def test_own_numbers_come_first() -> None:
    own = made(
        {
            "preset": "pvc-pes-iii",
            "stiffness_warp": 900.0,
            "strength_warp": 99.0,
            "strength_weft": 88.0,
            "safety": SAFETY,
        }
    )
    assert (own.stiffness_warp, own.stiffness_weft, own.strength_warp) == (900.0, 1000.0, 99.0)
    assert own.strength_source == ""
    by_area = made({"preset": "pvc-pes-iii", "E_warp": 1e6, "E_weft": 1e6, "G": 1e4, "thickness": "0.8 mm"})
    assert not by_area.per_width
    assert (by_area.nu, by_area.mass_per_area) == (0.2, 0.00105)
    foil = made({"preset": "etfe-foil", "thickness": "0.2 mm", "mass_per_area": "350 g/m²"})
    assert (foil.E, foil.density, foil.mass_per_area) == (1.1e6, None, 0.00035)


def test_what_a_preset_lacks_is_asked_for() -> None:
    with pytest.raises(ValidationError, match="preset: 'pvc-pes-6' is unknown; did you mean 'pvc-pes-"):
        made({"preset": "pvc-pes-6"})
    with pytest.raises(ValidationError, match="thickness is missing; or give the fabric per width"):
        made({"preset": "ptfe-glass-b", "nu": 0.5})
    with pytest.raises(ValidationError, match="thickness is missing"):
        made({"preset": "etfe-foil"})
    with pytest.raises(ValidationError, match="has a unit, which only a scene can convert"):
        Fabric(preset="pvc-pes-iii")  # type: ignore[call-arg]


def test_check_tells_sources_and_what_is_assumed() -> None:
    shown = CliRunner().invoke(app, ["check", "tent_cases"], env={"COLUMNS": "250"})
    assert shown.exit_code == 0, shown.output
    text = " ".join(shown.stdout.split())
    assert (
        "fabrics.arches: stiffness_warp = 1246 kN/m (measured, PVC-coated polyester 1300 dtex P2/2: uniaxial tests"
        in text
    )
    assert "fabrics.arches: G_t = 15 kN/m (assumed: without a source)" in text
    assert "fabrics.skin: strength_warp = 430 daN/5cm (sheet, data sheet" in text
    assert "fabrics.skin: stiffness_warp = " not in text  # the scene's own
    assert re.search(r"strength 86/86 kN/m \(preset pvc-pes-ii, sheet: [^;]*\) over safety 5", text)


def test_the_schema_lists_them() -> None:
    from taichi_membrane.scene import schema

    fabric = schema.schema()["$defs"]["Fabric"]
    assert "pvc-pes-iii" in str(fabric["properties"]["preset"])
    assert "required" not in fabric
    assert "`pvc-pes-iii`" in (ROOT / "docs/scene.md").read_text("utf-8")
    assert tm.load_scene("tent_cases").fabrics["arches"].stiffness_weft == 1058.0
