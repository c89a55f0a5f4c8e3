"""Calibration: reading curves, cutting stages at the readings, and settings that come back from synthetic data."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from parametric_cases import tube
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.parametric.fit import fit
from taichi_membrane.parametric.measured import Measured, at_readings, reading_steps
from taichi_membrane.parametric.plan import Conditions, Trial
from taichi_membrane.parametric.pool import LocalPool
from taichi_membrane.parametric.task import packed
from taichi_membrane.scene.file import load_scene

TRUTH = {"fabric.E_warp": 3600.0, "fabric.thickness": 0.112}
NOISE = 0.002  # mm, of deflections up to some tenths


def measured(x: tuple[float, ...], quantity: str = "load.tip") -> Measured:
    return Measured(quantity=quantity, x=x, y=(0.0,) * len(x), deviation=None)


def test_a_stage_is_cut_at_the_readings(tmp_path: Path) -> None:
    scene = load_scene(tube(tmp_path))
    readings = measured((3.0, 0.0, 6.0, 3.0, 1.5))
    cut = at_readings(scene, readings, None)
    assert [stage.name for stage in cut.stages] == ["inflate", "load_1", "load_2", "load_3"]
    assert [stage.loads.get("tip") for stage in cut.stages] == [None, 1.5, 3.0, 6.0]
    assert reading_steps(scene, cut, readings) == ["load_2", "inflate", "load_3", "load_2", "load_1"]
    inflated = at_readings(scene, measured((0.01, 0.035), "pressure"), "inflate")
    assert [stage.pressure for stage in inflated.stages] == [{"inside": pytest.approx(0.01)}, {"inside": 0.035}]


@pytest.mark.parametrize(
    ("curve", "arguments", "told"),
    [
        ("load.tip\n1\n", [], "expected such as load.tip,deflection"),
        ("load.tip,z\n1,x\n", [], "line 2 is '1,x'"),
        ("load.tip,z\n", [], "there is no reading"),
        ("load.tip,z,sd\n1,2,0\n", [], "all must be positive"),
        ("load.top,z\n1,2\n2,3\n", [], "'load.top' does not change in stage 'load'"),
        ("load.tip,z\n-1,2\n2,3\n", [], "a reading at load.tip = -1 is not on the way from 0 to 6"),
        ("load.tip,z\n1,2\n", [], "1 readings cannot tell 1 settings"),
        ("load.tip,z\n1,2\n2,3\n", ["--probe", "deflexion"], "did you mean 'deflection'"),
        ("load.tip,z\n1,2\n2,3\n", ["--free", "fabric.E"], "no number at fabric.E"),
        ("load.tip,z\n1,2\n2,3\n", ["--free", "fabric.nu=0.2:0.4"], "is not between 0.2 and 0.4"),
        ("load.tip,z\n1,2\n2,3\n", ["--stage", "lode"], "did you mean 'load'"),
    ],
)
def test_bad_input_is_told_in_a_line(curve: str, arguments: list[str], told: str, tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text(curve)
    given = {"--free": "fabric.nu", "--probe": "deflection", "--to": str(tmp_path / "curve.csv")}
    given |= dict(zip(arguments[::2], arguments[1::2], strict=True))
    result = CliRunner().invoke(
        app,
        ["fit", str(tube(tmp_path)), *(one for pair in given.items() for one in pair), "--out", str(tmp_path / "out")],
    )
    assert result.exit_code == 2, result.output
    assert told in result.stderr
    assert not (tmp_path / "out").exists()


def synthetic(folder: Path, loads: tuple[float, ...], workers: LocalPool) -> Measured:
    """What the tube with the true settings does, with noise."""
    scene = load_scene(tube(folder), [f"{key}={value}" for key, value in TRUTH.items()])
    cut = at_readings(scene, measured(loads), None)
    trial = Trial(number=1, settings={}, scene=cut, tri_count=0, fingerprint="truth")
    ((_, answer),) = workers.answers([trial], lambda t: packed(t, folder, Conditions(), send_mesh=False))
    assert answer["outcome"] == "finished", answer
    last = {step["stage"]: step["probes"]["deflection"] for step in answer["steps"]}
    noise = np.random.default_rng(11).normal(0.0, NOISE, len(loads))
    values = [last[stage] for stage in reading_steps(scene, cut, measured(loads))]
    return Measured(quantity="load.tip", x=loads, y=tuple((np.array(values) + noise).tolist()), deviation=None)


def test_synthetic_settings_come_back_within_their_intervals(tmp_path: Path) -> None:
    """A modulus by differences with thickness known; then thickness by the adjoint."""
    with LocalPool(jobs=1) as workers:
        readings = synthetic(tmp_path, tuple(np.linspace(0.5, 6.0, 12).tolist()), workers)
        path = tube(tmp_path)
        modulus = fit(
            path,
            to=readings,
            free=["fabric.E_warp"],
            probe="deflection",
            fixed=["fabric.thickness=0.112"],
            out=tmp_path / "E",
            workers=workers,
        )
        assert modulus.converged, modulus.reason
        assert modulus.intervals is not None
        low, high = modulus.intervals["fabric.E_warp"]
        assert low < TRUTH["fabric.E_warp"] < high
        assert high - low < 400.0  # and the interval is a statement: a tenth of the value
        # 11 degrees of freedom: within 42 % in 95 % of all cases.
        assert modulus.deviation[0] == pytest.approx(NOISE, rel=0.5)
        assert modulus.adjoint == ()
        content = json.loads((tmp_path / "E" / "fit.json").read_text())
        assert content["values"] == modulus.values
        assert {file.name for file in modulus.files} == {"fit.json", "fit.csv", "fit.png"}
        thickness = fit(
            path,
            to=readings,
            free=["fabric.thickness"],
            probe="deflection",
            fixed=["fabric.E_warp=3600"],
            workers=workers,
        )
        assert thickness.adjoint == ("fabric.thickness",)
        assert thickness.intervals is not None
        low, high = thickness.intervals["fabric.thickness"]
        assert low < TRUTH["fabric.thickness"] < high
        # The adjoint needs no run for a derivative: fewer runs than the differences took.
        assert thickness.runs < modulus.runs
