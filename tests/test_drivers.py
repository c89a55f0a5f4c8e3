"""The table of drivers: an entry is all that stages, results, files, derivatives, probes and curves need of a new kind."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field
from run_files import same

import taichi_membrane as tm
from taichi_membrane.execution.run import summarise
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mesh import Mesh
from taichi_membrane.output import reader
from taichi_membrane.output.tables import step_columns
from taichi_membrane.scene import Scene, Stage, drivers
from taichi_membrane.scene.base import Record
from taichi_membrane.scene.drivers import DriverKind, driver_names, driver_unit, stage_values
from taichi_membrane.simulation import dead_forces
from taichi_membrane.simulation.load_state import Course, LoadState, stage_targets, unloaded

pytestmark = pytest.mark.usefixtures("runtime_cpu")


class Wind(Record):
    """Dynamic pressure along z on every element."""

    factor: float = 1.0


class WindyStage(Stage):
    winds: dict[str, float] = Field(default_factory=dict)


class WindyScene(Scene):
    winds: dict[str, Wind] = Field(default_factory=dict)
    stages: list[WindyStage]  # type: ignore[assignment]


def blow(scene: Scene, mesh: Mesh, name: str, wind: Wind) -> Floats:
    return wind.factor * preparation.nodal_pressure(mesh, np.ones(mesh.tri_count))


WIND = DriverKind(
    name="wind", table="winds", key="winds", unit=lambda units, _: units.stress, words=lambda item: f"by {item.factor}"
)

SHEET = {
    "name": "sheet",
    "units": {"length": "m", "force": "N"},
    "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 4, "along_y": 4},
    "fabric": {"E": 1e5, "nu": 0.3, "thickness": 0.01},
    "supports": [{"group": "boundary", "hold": "xyz"}],
    "pressures": {"push": {"kind": "fixed"}},
    "probes": {
        "rise": {"kind": "displacement", "group": "all", "component": "z"},
    },
    "derivatives": ["rise"],
    "solver": {"tolerance": 1e-10},
}


def sheet(kind: str) -> Scene:
    """Blown at by wind, or pushed by a fixed pressure: the same thing by another name."""
    driver = {"wind": "wind.gust", "pressure": "pressure.push"}[kind]
    aim = {"winds": {"gust": 20.0}} if kind == "wind" else {"pressure": 20.0}
    content = SHEET | {"stages": [{"name": "up", "steps": 2} | aim], "curve": {"x": driver, "y": "rise"}}
    content["probes"] = SHEET["probes"] | {"of": {"kind": "factor", "of": driver}}  # type: ignore[operator]
    if kind == "wind":
        return WindyScene.model_validate(content | {"winds": {"gust": {}}})
    return Scene.model_validate(content)


def test_a_new_kind_goes_everywhere_that_a_pressure_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And to the same numbers, as it acts like one."""
    as_pressure = tm.run(sheet("pressure"))
    monkeypatch.setattr(drivers, "DRIVERS", (*drivers.DRIVERS, WIND))
    monkeypatch.setattr(dead_forces, "DEAD_FORCES", {**dead_forces.DEAD_FORCES, "wind": blow})
    monkeypatch.setattr(reader, "Scene", WindyScene)
    scene = sheet("wind")
    assert driver_names(scene) == ["pressure.push", "wind.gust"]
    assert driver_unit(scene, "wind.gust") == "Pa"
    result = tm.run(scene, out=tmp_path / "out", render=False)
    assert result.converged
    for step, other in zip(result.steps, as_pressure.steps, strict=True):
        assert same(step.displacement, other.displacement)
        assert step.drivers["wind.gust"] == other.drivers["pressure.push"] == step.probes["of"]
        assert step.derivatives["rise"]["wind.gust"] == other.derivatives["rise"]["pressure.push"] != 0.0
    with (tmp_path / "out/history.csv").open(encoding="utf-8") as file:
        assert [float(row["wind.gust [Pa]"]) for row in csv.DictReader(file)] == [10.0, 20.0]
    assert json.loads((tmp_path / "out/summary.json").read_text("utf-8"))["steps"][1]["drivers"]["wind.gust"] == 20.0
    saved = reader.read_run(tmp_path / "out")
    assert [step.drivers for step in saved.steps] == [step.drivers for step in result.steps]
    assert [step.quantity("wind.gust") for step in result.steps] == [10.0, 20.0]
    assert "gust [Pa]" in [column.header for column in step_columns(scene, result.steps)]
    with pytest.raises(ValueError, match=r"stages\.up\.winds: 'squall' is not a wind of this scene; allowed: gust"):
        WindyScene.model_validate(scene.model_dump() | {"stages": [{"name": "up", "winds": {"squall": 1.0}}]})
    assert summarise(scene)[0].unit_forces.keys() == {"wind.gust"}


def test_a_course_mixes_every_driver_and_stages_keep_what_they_do_not_name() -> None:
    content = SHEET | {
        "loads": {"a": {"group": "all", "direction": [0, 0, 1]}, "b": {"group": "all", "direction": [0, 0, 2]}},
        "stages": [{"name": "one", "pressure": 4.0, "loads": {"a": 1.0}}, {"name": "two", "loads": {"b": 3.0}}],
    }
    scene = Scene.model_validate(content)
    assert unloaded(scene).values == {"pressure.push": 0.0, "load.a": 0.0, "load.b": 0.0}
    one, two = stage_targets(scene)
    assert one.values == {"pressure.push": 4.0, "load.a": 1.0, "load.b": 0.0}
    assert (two.pressures, two.loads, two.motions) == ({"push": 4.0}, {"a": 1.0, "b": 3.0}, {})
    assert two == LoadState.of(pressure={"push": 4.0}, load={"a": 1.0, "b": 3.0})
    assert Course(one, two).at(0.25).values == {"pressure.push": 4.0, "load.a": 1.0, "load.b": 0.75}
    assert Course(one, two).at(1.0) is two
    assert stage_values(two.values, scene.stages[0]) == {"pressure.push": 4.0, "load.a": 1.0}
    assert [driver_unit(scene, name) for name in two.values] == ["Pa", "N", ""]
