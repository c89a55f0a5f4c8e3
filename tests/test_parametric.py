"""Sweeps: plans, points of designs, statistics on made-up rows, tables and pictures. Nothing is solved here."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from parametric_cases import tube
from PIL import Image
from scipy import stats
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.parametric import sweep as sweeping
from taichi_membrane.parametric.figures import draw_sweep
from taichi_membrane.parametric.journal import write_tables
from taichi_membrane.parametric.plan import SweepPlan, build_sweep
from taichi_membrane.parametric.rows import Row, SweepTable
from taichi_membrane.parametric.scatter import draw, parse_scatter
from taichi_membrane.parametric.statistics import importance, quantiles
from taichi_membrane.parametric.summary import summary
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import load_scene

WARP, THICKNESS = "fabric.E_warp=normal:4000:5%", "fabric.thickness=uniform:0.09:0.11"


# Plans


def test_grid_ranges_and_keys_that_go_together(tmp_path: Path) -> None:
    vary = ["stages.inflate.pressure=0.02:0.04:3", "mesh.around+mesh.along=8:6,10:8"]
    plan = build_sweep(
        tube(tmp_path), vary=vary, tie=["fabric.E_weft=0.5*stages.inflate.pressure"], fixed=["fabric.nu=0.2"]
    )
    assert [trial.settings["stages.inflate.pressure"] for trial in plan.trials[::2]] == ["0.02", "0.03", "0.04"]
    assert {(t.scene.mesh.around, t.scene.mesh.along) for t in plan.trials} == {(8, 6), (10, 8)}  # type: ignore[union-attr]
    assert [t.scene.fabric.E_weft for t in plan.trials[::2]] == [0.01, 0.015, 0.02]  # type: ignore[union-attr]
    assert {t.scene.fabric.nu for t in plan.trials} == {0.2}  # type: ignore[union-attr]
    assert len({trial.fingerprint for trial in plan.trials}) == 6
    assert plan.trials[1].tri_count > plan.trials[0].tri_count


def test_every_point_of_the_grid_gets_all_drawn_points(tmp_path: Path) -> None:
    plan = build_sweep(tube(tmp_path), vary=["mesh.around=8,10"], sample=[WARP], runs=5, seed=3)
    drawn = [trial.settings["fabric.E_warp"] for trial in plan.trials]
    assert len(drawn) == 10
    assert drawn[:5] == drawn[5:]
    again = build_sweep(load_scene(tube(tmp_path)), vary=["mesh.around=8,10"], sample=[WARP], runs=5, seed=3)
    assert [trial.settings for trial in again.trials] == [trial.settings for trial in plan.trials]


def test_table_of_the_users_own(tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("mesh.around, fabric.nu\n8,0.1\n\n10,0.2\n")
    plan = build_sweep(tube(tmp_path), table=tmp_path / "runs.csv")
    assert [dict(trial.settings) for trial in plan.trials] == [
        {"mesh.around": "8", "fabric.nu": "0.1"},
        {"mesh.around": "10", "fabric.nu": "0.2"},
    ]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "nothing to vary"),
        (["--vary", "mesh.around"], "expected KEY=V1"),
        (["--vary", "mesh.around=8,x"], "must be a whole number"),
        (["--vary", "mesh.around=8:8:3"], "different ends"),
        (["--vary", "mesh.arround=8,9"], "did you mean"),
        (["--vary", "supports.1.group=start,nowhere", "--vary", "mesh.around=nine"], "mesh.around"),
        (["--sample", "fabric.nu"], "expected KEY=normal"),
        (["--sample", "fabric.nu=gamma:1:2"], "'gamma' is no distribution"),
        (["--sample", "fabric.nu=normal:1"], "two numbers, not 1"),
        (["--sample", "fabric.nu=normal:1:0"], "must be positive"),
        (["--sample", "fabric.nu=uniform:2:1"], "is empty"),
        (["--sample", "fabric.nu=lognormal:-1:1"], "is positive"),
        (["--sample", "fabric.nu=uniform:0.1:x"], "'x' is not a number"),
        (["--sample", "fabric.nu=uniform:0:0.2", "--vary", "fabric.nu=0.1,0.2"], "fabric.nu: given 2 times"),
        (["--sample", "fabric.nu=uniform:0:0.2", "--runs", "12", "--design", "sobol"], "powers of two, such as 16"),
        (["--sample", "fabric.nu=uniform:0:0.2", "--runs", "5", "--design", "importance"], "needs 6 runs"),
        (["--vary", "mesh.around=8,9", "--tie", "mesh.along=mesh.radius"], "'mesh.radius' is not varied"),
        (["--vary", "mesh.around=8,9", "--tie", "mesh.along"], "expected KEY=OTHER"),
        (["--vary", "mesh.around=8,9", "--tie", "mesh.around=mesh.around"], "has values of its own"),
        (["--vary", "mesh.around=8,9", "--set", "mesh.around=8"], "mesh.around: given 2 times"),
        (["--table", "missing.csv"], "cannot be read"),
        (["--table", "missing.csv", "--vary", "mesh.around=8,9"], "leave out --vary"),
    ],
)
def test_bad_input_ends_before_anything_runs(
    arguments: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweeping, "run_sweep", lambda *_, **__: pytest.fail("a sweep with bad input was started"))
    result = CliRunner().invoke(app, ["sweep", str(tube(tmp_path)), *arguments, "--out", str(tmp_path / "out")])
    assert result.exit_code == 2, result.output
    assert told in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    plan = build_sweep(tube(tmp_path), vary=["mesh.around=8,9"])
    with pytest.raises(InputError, match="but no earlier sweep"):
        sweeping.run_sweep(plan, out=tmp_path)


# Points


def test_distributions_have_their_mean_and_deviation() -> None:
    share = (np.arange(20_000) + 0.5) / 20_000
    for text, mean, deviation in [
        ("a=normal:4000:5%", 4000.0, 200.0),
        ("a=lognormal:3:0.6", 3.0, 0.6),
        ("a=uniform:2:5", 3.5, 3.0 / math.sqrt(12.0)),
    ]:
        values = parse_scatter(text).quantile(share)
        # The tails beyond the outermost points are missing: of a normal distribution 4e-4 of the deviation.
        assert (values.mean(), values.std()) == (pytest.approx(mean, rel=1e-3), pytest.approx(deviation, rel=1e-3))


def test_latin_hypercube_fills_every_layer() -> None:
    points = np.array(draw([parse_scatter("a=uniform:0:1"), parse_scatter("b=uniform:0:1")], "latin", 50, 7))
    for column in points.T:
        assert sorted((50 * column).astype(int)) == list(range(50))
    assert draw([parse_scatter("a=uniform:0:1")], "latin", 9, 7) != draw(
        [parse_scatter("a=uniform:0:1")], "latin", 9, 8
    )


def test_importance_points_change_one_column_at_a_time() -> None:
    scatters = [parse_scatter(f"{name}=uniform:0:1") for name in "abc"]
    points = np.array(draw(scatters, "importance", 45, 1)).reshape(5, 8, 3)  # 8 base points for 3 settings: 40 runs
    a, b = points[0], points[1]
    for i in range(3):
        assert (points[2 + i][:, i] == b[:, i]).all()
        assert (np.delete(points[2 + i], i, axis=1) == np.delete(a, i, axis=1)).all()


# Statistics


def made_up(plan: SweepPlan, *, apart: int = 0, outcome: str = "collapse") -> SweepTable:
    """Rows whose deflection is 3 a + b of the first two settings' standard values; the last ``apart`` have none that
    counts.
    """
    rows = []
    for trial in plan.trials:
        a = (float(trial.settings["fabric.E_warp"]) - 4000.0) / 200.0
        b = (float(trial.settings["fabric.thickness"]) - 0.1) / 0.01 * math.sqrt(3.0)
        missing = trial.number > len(plan.trials) - apart
        rows.append(
            Row(
                trial=trial, outcome=outcome if missing else "finished", reason="no equilibrium" if missing else "",
                probes={"deflection": 1e9 if missing else 3.0 * a + b, "root": 6.0},
                curve=[[0.0, 1.0, 2.0 + 0.1 * a], [0.0, 1.0, 2.0 + b]],
            )
        )  # fmt: skip
    return SweepTable(plan=plan, rows=tuple(rows))


def test_quantiles_say_how_many_runs_they_are_over(tmp_path: Path) -> None:
    plan = build_sweep(tube(tmp_path), sample=[WARP, THICKNESS], runs=200, seed=5)
    low, middle, high = (one for one in quantiles(made_up(plan)) if one.quantity == "deflection")
    assert middle.low is not None
    assert middle.high is not None
    assert middle.low < middle.value < middle.high
    # Of 200 independent runs ranks 86 and 115 bound the median; the latin hypercube's are more even still.
    values = sorted(made_up(plan).values("deflection"))  # type: ignore[type-var]
    assert (middle.low, middle.high) == (values[85], values[114])
    assert low.value < middle.value < high.value
    fewer = next(one for one in quantiles(made_up(plan, apart=160)) if one.quantity == "deflection")
    assert (fewer.counted, fewer.asked, fewer.low) == (40, 200, None)
    assert fewer.value < 1e6  # what stands apart is in no quantile
    assert "**40 of 200**" in summary(made_up(plan, apart=160))
    assert "160 stand apart: 160 collapse" in summary(made_up(plan, apart=160))


def test_sobol_indices_of_a_sum(tmp_path: Path) -> None:
    """Of 3 a + b, with variances 9 and 1, the shares are 0.9 and 0.1, alone and with all interactions."""
    plan = build_sweep(tube(tmp_path), sample=[WARP, THICKNESS], runs=1024, design="importance")
    found = {(one.key, one.kind): one for one in importance(made_up(plan)) if one.quantity == "deflection"}
    for kind in ("first order", "total"):
        for key, share in (("fabric.E_warp", 0.9), ("fabric.thickness", 0.1)):
            one = found[key, kind]
            # 256 base points: the interval is some hundredths wide.
            assert one.low < one.value < one.high
            assert one.value == pytest.approx(share, abs=0.05)
            assert (one.counted, one.asked) == (256, 256)
    fewer = [one for one in importance(made_up(plan, apart=100)) if one.quantity == "deflection"]
    assert {(one.counted, one.asked) for one in fewer} == {(128, 256)}
    assert max(one.value for one in fewer) < 1.2


def test_rank_correlations_of_a_sum(tmp_path: Path) -> None:
    plan = build_sweep(tube(tmp_path), sample=[WARP, THICKNESS], runs=60, seed=2)
    found = {one.key: one for one in importance(made_up(plan)) if one.quantity == "deflection"}
    assert found["fabric.E_warp"].low > found["fabric.thickness"].high
    expected = (
        stats.pearsonr([0.0, 1.0], [0.0, 1.0]).statistic * 3.0 / math.sqrt(10.0)
    )  # of values; ranks differ by hundredths
    assert found["fabric.E_warp"].value == pytest.approx(expected, abs=0.05)
    assert not [one for one in importance(made_up(plan)) if one.quantity == "root"]  # it never changes


def test_rows_that_are_no_result_count_nowhere(tmp_path: Path) -> None:
    plan = build_sweep(tube(tmp_path), sample=[WARP, THICKNESS], runs=4)
    row = made_up(plan).rows[0]
    assert row.apart == ""
    assert replace(row, negative_eigenvalues=1).apart == "unstable"
    limit = {"load.tip": [4.0, 4.1], "pressure.inside": [0.035, 0.035]}
    stopped = replace(row, outcome="collapse", limit=limit)
    assert (stopped.value("deflection"), stopped.value("limit.load.tip")) == (None, 4.0)
    assert replace(row, outcome="refused").value("deflection") is None
    to_collapse = build_sweep(tube(tmp_path), vary=["fabric.nu=0.1,0.2"], fixed=["stages.load.until=collapse"]).trials[
        0
    ]
    assert replace(row, trial=to_collapse).apart == "no limit"
    assert replace(row, trial=to_collapse, limit=limit).apart == ""
    table = SweepTable(plan=plan, rows=(row, stopped))
    assert table.quantities == ("deflection", "root", "limit.load.tip")
    assert [one["limit.load.tip high [N]"] for one in table.records()] == [None, 4.1]
    with pytest.raises(InputError, match="not a quantity"):
        table.values("deflexion")


def test_tables_and_pictures(tmp_path: Path) -> None:
    table = made_up(build_sweep(tube(tmp_path), sample=[WARP, THICKNESS], runs=30, seed=1), apart=4)
    write_tables(table, tmp_path)
    with (tmp_path / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 30
    assert rows[0]["deflection [mm]"] == repr(table.rows[0].probes["deflection"])
    assert [row["apart"] for row in rows] == [""] * 26 + ["collapse"] * 4
    content = json.loads((tmp_path / "sweep.json").read_text())
    assert (content["asked"], content["done"], len(content["apart"])) == (30, 30, 4)
    assert content["quantities"] == {"deflection": "mm", "root": "N"}
    pictures = draw_sweep(table, tmp_path)
    assert [path.name for path in pictures] == ["scatter.png", "curves.png", "tornado.png"]
    for path in pictures:
        with Image.open(path) as image:
            assert len(image.convert("RGB").resize((60, 40)).getcolors(2400) or []) > 10  # not blank


def test_a_scene_without_a_mesh_of_its_own_is_refused(tmp_path: Path) -> None:
    data = load_scene(tube(tmp_path)).model_dump(mode="json") | {"mesh": {"shape": "given"}}
    with pytest.raises(InputError, match="save the mesh"):
        build_sweep(Scene.model_validate(data), vary=["fabric.nu=0.1,0.2"])
