"""Numbers with a unit as text: read exactly, of the right dimension, in every key that has one; and shown by ``check``."""

from __future__ import annotations

import copy
import re
import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.scene import Fabric, Scene, Units, quantity, schema
from taichi_membrane.scene.texts import conversions

SCENE = """
name = "tube"
units = { length = "m", force = "kN" }
mesh = { shape = "tube", radius = "250 mm", length = 2.0, around = 8, along = 6 }
fabric = { stiffness_warp = "800 kN/m", stiffness_weft = "600 N/mm", G_t = 10.0, nu = 0.2, mass_per_area = "1050 g/m^2" }
supports = [{ group = "start", hold = "xyz" }]
cables.guy = { nodes = ["post", "peg"], EA = "200 kN", length = "3 m" }
anchors.peg = ["500 cm", 0.0, -1.0]
anchors.post = [2.0, 0.0, 1.0]
loads.tip = { group = "end", direction = [0, 0, -1] }
loads.snow = { kind = "snow" }
probes.drop = { kind = "displacement", group = "end", component = "z" }
probes.tension = { kind = "resultant" }

[[stages]]
name = "inflate"
pressure = "100 mbar"

[[stages]]
name = "load"
loads = { tip = "50 N", snow = "0.4 kPa" }

[[checks]]
probe = "drop"
stage = "load"
reference = "-12 mm"
absolute = 0.1
source = "none"
"""


@pytest.mark.parametrize(
    ("text", "units", "value"),
    [
        ("35 kPa", ("mm", "N"), 0.035),
        ("0.8 mm", ("mm", "N"), 0.8),
        ("0.8mm", ("m", "kN"), 0.0008),
        ("800 kN/m", ("m", "kN"), 800.0),
        ("430 daN/5cm", ("m", "kN"), 86.0),
        ("1050 g/m^2", ("mm", "N"), 1.05e-9),
        ("1050 g/m²", ("m", "N"), 1.05),
        ("9.81 m/s²", ("mm", "N"), 9810.0),
        ("-1.2e1 N·mm", ("m", "N"), -0.012),
        ("2 N*m", ("m", "N"), 2.0),
        ("1 psi", ("in", "lbf"), 1.0),
        ("12 in", ("ft", "lbf"), 1.0),
        ("144 psi", ("ft", "lbf"), 20736.0),
        ("5 L", ("m", "N"), 0.005),
        ("3 mm^-1", ("m", "N"), 3000.0),
        ("30 deg", ("m", "N"), 30.0),
    ],
)
def test_a_text_becomes_the_number_one_would_write(text: str, units: tuple[str, str], value: float) -> None:
    """To the last bit: all factors are fractions."""
    with quantity.in_units(*units):
        assert quantity.converted(text) == value


def test_units_of_the_table_are_those_of_their_definitions() -> None:
    """NIST SP 811, appendix B.9: the factors printed there to seven digits."""
    printed = {
        "lbf": 4.448222, "psi": 6894.757, "psf": 47.88026, "kgf": 9.80665, "inH2O": 249.0889, "oz": 0.02834952, "kip": 4448.222,
    }  # fmt: skip
    for name, value in printed.items():
        assert float(quantity.UNITS[name].size) == pytest.approx(value, rel=2e-7)
    assert quantity.measure("N/mm²") == quantity.UNITS["MPa"] == quantity.measure("MN/m^2")
    assert quantity.measure("kg·m/s²") == quantity.UNITS["N"]
    assert quantity.measure("kN/m/m").of == quantity.UNITS["Pa"].of
    assert quantity.measure("1000L").size == Fraction(1)


@pytest.mark.parametrize(
    ("unit", "told"),
    [
        ("kPaa", "unknown unit 'kPaa'; did you mean 'kPa'? allowed: mm, "),
        ("m/", "'m/' is no unit"),
        ("/m", "'/m' is no unit"),
        ("m²²", "'m²²' is no unit"),
        ("N..m", "'N..m' is no unit"),
    ],
)
def test_what_is_no_unit_is_refused(unit: str, told: str) -> None:
    with pytest.raises(ValueError, match=re.escape(told)):
        quantity.measure(unit)


def test_what_is_no_number_with_a_unit_is_left_alone() -> None:
    for text in ("35", "kPa", "", "1e3", "1e99 mm", f"{'1' * 50} mm", "x" * 200, " 1. "):
        assert quantity.split(text) is None


@pytest.mark.parametrize("model", schema.models(), ids=lambda model: model.__name__)
def test_every_key_with_a_dimension_takes_texts_of_it(model: type[BaseModel]) -> None:
    """The dimension in the brackets of its meaning is that of its number, so that neither is forgotten."""
    named = {one.name for one in vars(quantity).values() if isinstance(one, quantity.Dimension)} - {"", "degrees"}
    for key, field in model.model_fields.items():
        told = set(re.findall(r"\[([^\]]*)\]", schema.meanings(model)[key])) & named
        found = {one.name for one in dimensions((field.annotation, *field.metadata))} - {""}
        if "Literal" not in str(field.annotation):  # a kind that is measured, and not given
            assert told == found, key


def dimensions(annotation: Any) -> list[quantity.Dimension]:
    """All that an annotation holds."""
    if isinstance(annotation, quantity.Dimension):
        return [annotation]
    parts = annotation if isinstance(annotation, tuple) else get_args(annotation)
    parts = (*parts, *getattr(annotation, "__metadata__", ()))
    return [one for part in parts for one in dimensions(part)]


def read() -> Scene:
    return Scene.model_validate(tomllib.loads(SCENE))


def test_a_scene_in_texts_is_the_scene_in_numbers() -> None:
    scene = read()
    assert scene.mesh.radius == 0.25  # type: ignore[union-attr]
    assert scene.fabric is not None
    assert (scene.fabric.stiffness_warp, scene.fabric.stiffness_weft) == (800.0, 600.0)
    assert scene.fabric.mass_per_area == 0.00105
    assert scene.anchors["peg"] == (5.0, 0.0, -1.0)
    assert scene.stages[0].pressure == 10.0
    assert scene.stages[1].loads == {"tip": 0.05, "snow": 0.4}
    assert scene.checks[0].reference == -0.012
    assert Scene.model_validate(scene.model_dump(mode="json")) == scene
    assert Scene(**tomllib.loads(SCENE)) == scene  # as in Python


def test_each_text_is_told_with_what_it_became() -> None:
    data = tomllib.loads(SCENE)
    before = copy.deepcopy(data)
    told = [f"{one.key}: {one.text} = {one.value:g} {one.unit}" for one in conversions(read(), data, read().units)]
    assert data == before
    assert told == [
        "mesh.radius: 250 mm = 0.25 m",
        "fabric.stiffness_warp: 800 kN/m = 800 kN/m",
        "fabric.stiffness_weft: 600 N/mm = 600 kN/m",
        "fabric.mass_per_area: 1050 g/m^2 = 0.00105 kN·s²/m³",
        "cables.guy.EA: 200 kN = 200 kN",
        "cables.guy.length: 3 m = 3 m",
        "anchors.peg[1]: 500 cm = 5 m",
        "stages.inflate.pressure: 100 mbar = 10 kPa",
        "stages.load.loads.tip: 50 N = 0.05 kN",
        "stages.load.loads.snow: 0.4 kPa = 0.4 kPa",
        "checks[1].reference: -12 mm = -0.012 m",
    ]


def test_check_shows_units_conversions_and_stiffness_per_width(tmp_path: Path) -> None:
    file = tmp_path / "tube.toml"
    file.write_text(SCENE)
    given = ["check", str(file), "--set", "stages.inflate.pressure=50 mbar"]
    shown = CliRunner().invoke(app, given, env={"COLUMNS": "160"})
    assert shown.exit_code == 0, shown.output
    text = " ".join(shown.stdout.split())
    assert "units m, kN, stress and pressure in kPa, force per width in kN/m" in text
    assert "stages.inflate.pressure: 50 mbar is 5 kPa" in text
    assert "fabric.stiffness_weft: 600 N/mm is 600 kN/m" in text
    assert "800 kN/m is" not in text  # nothing became of it
    assert "4 with the scene's own units, as written" in text
    assert "stiffness_warp = 800, stiffness_weft = 600, G_t = 10 kN/m, nu = 0.2, wrinkling law tension_field" in text
    assert "thickness" not in text


@pytest.mark.parametrize(
    ("change", "to", "told"),
    [
        (
            'pressure = "100 mbar"', 'pressure = "100 mm"',
            "stages.inflate.pressure: '100 mm' is a length, but a pressure or stress [force/length²] is needed",
        ),
        ('tip = "50 N"', 'tip = "50 m"', "stages.load.loads.tip: '50 m' is a length, but load 'tip' takes a force [kN]"),
        (
            'snow = "0.4 kPa"', 'snow = "0.4 kN"',
            "stages.load.loads.snow: '0.4 kN' is a force, but load 'snow' takes a pressure or stress [kN/m²]",
        ),
        ("[0, 0, -1]", "[0, 0, -2]", "stages.load.loads.tip: '50 N' is a force, but load 'tip' takes a mere number"),
        ('"-12 mm"', '"-12 N"', "checks[1].reference: '-12 N' is a force, but probe 'drop' takes a length [m]"),
        ('probe = "drop"', 'probe = "tension"', "'-12 mm' is a length, but probe 'tension' takes a force per length [kN/m]"),
        ('probe = "drop"', 'probe = "nix"', "checks[1].probe: 'nix' is not a probe of this scene"),
        ('radius = "250 mm"', 'radius = "-250 mm"', "mesh.radius: -0.25 must be above 0"),
        ('"500 cm"', '"500 kg"', "anchors.peg[1]: '500 kg' is a mass, but a length [length] is needed"),
    ],
)  # fmt: skip
def test_a_unit_of_another_dimension_is_refused_with_both(tmp_path: Path, change: str, to: str, told: str) -> None:
    assert change in SCENE
    file = tmp_path / "tube.toml"
    file.write_text(SCENE.replace(change, to))
    with pytest.raises(tm.InputError, match=re.escape(told)):
        tm.load_scene(file)


def test_alone_in_python_a_text_has_no_scene_to_convert_it() -> None:
    with pytest.raises(ValidationError, match="has a unit, which only a scene can convert"):
        Fabric(stiffness="800 kN/m", nu=0.3)  # type: ignore[arg-type]
    assert Units(length="mm", force="N").resultant == Units(length="m", force="kN").resultant == "kN/m"
    assert Units(length="in", force="lbf").resultant == "lbf/in"
