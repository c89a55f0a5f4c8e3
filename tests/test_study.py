"""Studies: the grid and its validation, the arithmetic on made-up runs, tables and figure."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.study import runner
from taichi_membrane.study.analyse import Study, analyse, extrapolate, fitted_order, pareto_front
from taichi_membrane.study.figure import draw_study
from taichi_membrane.study.plan import Plan, build_plan, parse_axis
from taichi_membrane.study.runner import Run
from taichi_membrane.study.tables import write_tables

ROOT = Path(__file__).resolve().parent.parent
SPHERE, TUBE = ROOT / "scenes" / "sphere.toml", ROOT / "scenes" / "tube.toml"
ROUND_OFF = 1e-12  # a few operations in double precision, with room


# The grid


def test_axes_are_read() -> None:
    assert parse_axis("mesh.around=16,32").points == (("16",), ("32",))
    tied = parse_axis("mesh.around+mesh.along=16:40, 32:80")
    assert tied.keys == ("mesh.around", "mesh.along")
    assert tied.points == (("16", "40"), ("32", "80"))
    bracketed = parse_axis('mesh.path+fabric.warp="a,b:c":[1,0,0],d:[0,1,0]')
    assert bracketed.points == (('"a,b:c"', "[1,0,0]"), ("d", "[0,1,0]"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("mesh.around", "expected KEY=V1"),
        ("=1,2", "expected KEY=V1"),
        ("a+b=1:2,3", "'3' has 1 values for 2 keys"),
        ("a+b=1:2:3", "'1:2:3' has 3 values for 2 keys"),
        ("a=1,,2", "'' has 0 values for 1 keys"),
        ("a=1,2,1", "'1' is given 2 times"),
    ],
)
def test_bad_axis_is_refused(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        parse_axis(text)


def test_grid_holds_every_combination_and_ties_keys() -> None:
    plan = build_plan(
        TUBE,
        ["mesh.around+mesh.along=8:20,16:40", "solver.kind=newton,hybrid", "precision=f32,f64", "fabric.nu=0.1,0.3"],
        fixed=["mesh.cap_end=flat"],
    )
    assert len(plan.cases) == len({case.identity for case in plan.cases}) == 16
    assert {(case.scene.mesh.around, case.scene.mesh.along) for case in plan.cases} == {(8, 20), (16, 40)}  # type: ignore[union-attr]
    first = plan.cases[0]
    assert first.scene.mesh.cap_end == "flat"  # type: ignore[union-attr]
    assert first.overrides == [
        "mesh.cap_end=flat",
        "mesh.around=8",
        "mesh.along=20",
        "solver.kind=newton",
        "fabric.nu=0.1",
    ]
    assert (first.mesh, first.sequence) == ("mesh.around=8 mesh.along=20", "fabric.nu=0.1")
    assert first.method == "solver.kind=newton precision=f32"
    assert (first.stage, first.step) == ("inflate", 1)
    arguments = runner.command(first, Path("folder"))
    assert "--precision=f32" in arguments
    assert "--set=mesh.along=20" in arguments
    assert not [argument for argument in arguments if argument.startswith("--threads")]


def test_mesh_patterns_are_sequences_of_their_own_and_mesh_files_are_not() -> None:
    plan = build_plan(TUBE, ["mesh.around=8,16", "mesh.pattern=staggered,diagonal", "stages.inflate.steps=1,2"])
    assert {case.sequence for case in plan.cases} == {"mesh.pattern=staggered", "mesh.pattern=diagonal"}
    disc = build_plan(ROOT / "scenes" / "disc.toml", ["mesh.path=meshes/disc.msh"])
    assert disc.cases[0].sequence == ""


def test_what_changes_with_the_mesh_belongs_to_it() -> None:
    """A force that depends on the mesh's polygon opens no sequence of its own; one mesh with two thicknesses does."""
    plan = build_plan(TUBE, ["mesh.around+fabric.thickness=8:1,12:1.1,16:1.2"], reference="extrapolated")
    assert {case.sequence for case in plan.cases} == {""}
    assert [case.mesh for case in plan.cases] == ["mesh.around=8", "mesh.around=12", "mesh.around=16"]
    assert [case.scene.fabric.thickness for case in plan.cases] == [1.0, 1.1, 1.2]  # type: ignore[union-attr]
    apart = build_plan(TUBE, ["mesh.around+fabric.thickness=8:1,8:2"])
    assert [case.sequence for case in apart.cases] == ["fabric.thickness=1", "fabric.thickness=2"]


def test_fingerprint_follows_what_changes_numbers(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "scenes", tmp_path / "scenes")
    scene, mesh = tmp_path / "scenes" / "disc.toml", tmp_path / "scenes" / "meshes" / "disc.msh"

    def fingerprint() -> str:
        return build_plan(scene, ["precision=f64"]).cases[0].fingerprint

    before = fingerprint()
    text = scene.read_text()
    scene.write_text(text.replace("title =", "title = 'another' #", 1))
    assert fingerprint() == before
    mesh.write_text(mesh.read_text() + "\n")
    assert fingerprint() != before


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--vary", "mesh.divisions=2,3", "--vary", "mesh.rings=2"], "mesh.rings: unknown key"),
        (["--vary", "mesh.divisions=2,zero"], "mesh.divisions: must be a whole number, not 'zero'"),
        (["--vary", "fabric.nu=0.3,1.2"], "compliance is not positive definite"),
        (["--vary", "precision=f16"], "precision: 'f16' is unknown"),
        (["--vary", "threads=0"], "threads: '0' must be a whole number"),
        (["--vary", "precision=f32", "--set", "precision=f64"], "precision: set or varied 2 times"),
        (["--vary", "precision=f64", "--set", "mesh.divisions"], "expected KEY=VALUE"),
        (["--vary", "precision=f64", "--probe", "radios"], "did you mean 'radius'"),
        (["--vary", "precision=f64", "--at", "large:5"], "has 4 steps"),
        (["--vary", "precision=f64", "--at", "huge:1"], "'huge' is not a stage"),
        (["--vary", "precision=f64", "--reference", "110"], "needs one --probe, not 3"),
        (["--vary", "precision=f64", "--reference", "nan", "--probe", "radius"], "must be a finite number"),
        (["--vary", "precision=f64", "--reference", "radius=110"], "no value for volume, stress"),
        (["--vary", "precision=f64", "--reference", "radios=110"], "'radios' is not measured"),
        (["--vary", "precision=f64", "--reference", "radius=inf", "--probe", "radius"], "'inf' is no finite number"),
        (["--vary", "precision=f64", "--reference", "exact"], "neither a number nor a known word"),
        (["--vary", "precision=f64", "--reference", "check", "--at", "large:1"], "no check of any probe"),
        (["--vary", "precision=f64", "--reference", "check", "--probe", "volume"], "no check of probe 'volume'"),
        (["--vary", "mesh.divisions=2,3", "--reference", "extrapolated"], "needs 3 meshes at least, not 2"),
        (["--vary", "supports.3.group=x_plus,nowhere"], "nowhere"),
    ],
)
def test_bad_input_ends_before_anything_runs(
    arguments: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "run_all", lambda *_, **__: pytest.fail("a study with bad input was started"))
    result = CliRunner().invoke(app, ["study", str(SPHERE), *arguments, "--out", str(tmp_path / "out")])
    assert result.exit_code == 2, result.output
    assert told in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    result = CliRunner().invoke(app, ["study", str(SPHERE), "--vary", "precision=f64", "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert "thesis.tex" in result.stderr


# Arithmetic


def test_pareto_front_keeps_what_nothing_beats() -> None:
    cost, error = [1.0, 2.0, 3.0, 4.0, 2.0, 5.0], [0.5, 0.1, 0.2, 0.01, 0.1, 0.01]
    assert pareto_front(cost, error) == [True, True, False, True, True, False]
    assert pareto_front([], []) == []


def test_fitted_order_of_a_power_law() -> None:
    sizes = [0.4, 0.25, 0.1]
    assert fitted_order(sizes, [3.0 * size**1.7 for size in sizes]) == pytest.approx(1.7, abs=ROUND_OFF)
    assert fitted_order([0.4, 0.2], [0.1, 0.0]) is None
    assert fitted_order([0.4, 0.4], [0.1, 0.2]) is None


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 3.3])
@pytest.mark.parametrize("slope", [5.0, -5.0])
def test_extrapolation_of_a_power_law(order: float, slope: float) -> None:
    sizes = [0.7, 0.4, 0.3, 0.1]  # ratios differ, and the first does not count
    values = [9.0, *(2.0 + slope * size**order for size in sizes[1:])]
    found = extrapolate(sizes, values)
    assert found.order == pytest.approx(order, abs=1e-9)  # the root is found to 1e-12, from values that cancel
    assert found.value == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ([1.0, 2.0], "needs 3 meshes"),
        ([1.0, 2.0, 1.5], "up and down"),
        ([1.0, 2.0, 2.0], "the same value"),
        ([1.0, 2.0, 4.0], "do not shrink"),
        ([1.0, 2.0, 2.0 + 1e-9], "order above 20"),
    ],
)
def test_values_without_a_limit_are_not_extrapolated(values: list[float], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        extrapolate([0.4, 0.2, 0.1][: len(values)], values)


def made_up(plan: Plan, value: Callable[[Run], float]) -> list[Run]:
    """Runs that all converged, the cost growing with the number of the case."""
    runs = []
    for number, case in enumerate(plan.cases, 1):
        run = Run(
            case=case, status="converged", reason="", probes={}, residual=1e-9, iterations=3,
            seconds={"setup": 0.5, "compile": 9.0, "solve": float(number)},
            wall_seconds=20.0, peak_memory=200.0, jobs=1,
        )  # fmt: skip
        runs.append(replace(run, probes={"radius": value(run)}))
    return runs


def with_errors(run: Run) -> float:
    """100, plus a discretisation error of second order, plus an iteration error of the tolerance's size."""
    return 100.0 + 30.0 * run.case.size**2 + (run.case.scene.solver.tolerance or 0.0)


def study_of(reference: str, *vary: str) -> tuple[Plan, list[Run], Study]:
    axes = vary or ("mesh.divisions=2,4,8", "solver.tolerance=1e-2,1e-6")
    plan = build_plan(SPHERE, axes, probes=["radius"], reference=reference)
    runs = made_up(plan, with_errors)
    return plan, runs, analyse(plan, runs)


def test_iteration_and_discretisation_errors_are_separate() -> None:
    _, runs, study = study_of("100")
    for run, row in zip(runs, study.rows, strict=True):
        best = 100.0 + 30.0 * run.case.size**2 + 1e-6
        assert row.discretisation_error == pytest.approx((best - 100.0) / 100.0, rel=1e-9)  # cancellation of 100
        assert row.iteration_error == pytest.approx((run.probes["radius"] - best) / best, abs=ROUND_OFF)
        assert row.error == pytest.approx((run.probes["radius"] - 100.0) / 100.0, rel=1e-9)
    (convergence,) = study.convergences
    # The iteration error of 1e-6 is 2e-5 of the smallest discretisation error, and shifts the slope by about as much.
    assert convergence.fitted_order == convergence.observed_order == pytest.approx(2.0, abs=2e-5)
    assert convergence.extrapolation is not None
    assert convergence.extrapolation.value == pytest.approx(100.0 + 1e-6, abs=1e-9)
    # Case 2 has the tight tolerance but costs more than case 1 on the same mesh: both are on the front.
    assert [row.pareto for row in study.rows] == [True] * 6


def test_finest_reference_gives_no_error_on_its_own_mesh() -> None:
    _, runs, study = study_of("finest")
    best = runs[-1].probes["radius"]
    (convergence,) = study.convergences
    assert convergence.reference == best
    assert convergence.observed_order == pytest.approx(2.0, abs=1e-9)  # all values carry the same iteration error
    assert convergence.fitted_order is not None
    assert convergence.fitted_order > 2.2  # errors 15/16 and 3/16 of the coarsest's instead of 1 and 1/4
    assert [row.error is None for row in study.rows] == [False] * 4 + [True] * 2
    assert [row.iteration_error is None for row in study.rows] == [False] * 6
    assert not any(row.pareto for row in study.rows[4:])
    _, _, single = study_of("finest", "solver.tolerance=1e-2,1e-6")
    assert single.rows[0].error == single.rows[0].iteration_error > 0  # type: ignore[operator]
    assert single.rows[1].error == 0


def test_double_precision_beats_a_tight_tolerance() -> None:
    plan = build_plan(SPHERE, ["mesh.divisions=2,3", "precision=f32,f64"], probes=["radius"])
    runs = [
        replace(run, residual=1e-12 if run.case.settings["precision"] == "f32" else 1e-6)
        for run in made_up(plan, with_errors)
    ]
    study = analyse(plan, runs)
    assert {point.run.case.settings["precision"] for point in study.convergences[0].meshes} == {"f64"}


def test_what_did_not_converge_never_counts() -> None:
    plan, runs, _ = study_of("finest")
    failed = [
        replace(run, status="not converged", probes={}) if run.case.tri_count == runs[-1].case.tri_count else run
        for run in runs
    ]
    study = analyse(plan, failed)
    assert study.convergences[0].reference == runs[3].probes["radius"]  # the finest mesh that has a result
    assert [row.value is None for row in study.rows] == [False] * 4 + [True] * 2
    assert all(row.error is None and not row.pareto for row in study.rows[4:])
    nothing = analyse(plan, [replace(run, probes={}) for run in runs])
    assert (nothing.convergences[0].reference, nothing.convergences[0].origin) == (None, "no run converged")


def test_each_sequence_has_its_own_reference() -> None:
    plan, _, study = study_of("finest", "mesh.divisions=2,3", "fabric.thickness=1,2")
    assert [item.sequence for item in study.convergences] == ["fabric.thickness=1", "fabric.thickness=2"]
    _, _, checked = study_of("check", "mesh.divisions=2,3")
    assert (checked.convergences[0].reference, checked.convergences[0].origin) == (110.0, "check of the scene")
    assert len(plan.cases) == 4


def test_elements_are_sequences_of_their_own_beside_given_references() -> None:
    axes = ["mesh.order+mesh.divisions=1:4,1:8,2:2,2:4", "mesh.points=3,6"]
    plan = build_plan(SPHERE, axes, probes=["radius", "volume"], reference="radius=110, volume=5.5e6")
    assert [case.sequence for case in plan.cases[:2]] == ["mesh.order=1 mesh.points=3", "mesh.order=1 mesh.points=6"]
    assert plan.reference == {"radius": 110.0, "volume": 5.5e6}
    runs = [replace(run, probes={"radius": 109.0, "volume": 5.4e6}) for run in made_up(plan, lambda _: 0.0)]
    study = analyse(plan, runs)
    assert {(item.probe, item.reference, item.origin) for item in study.convergences} == {
        ("radius", 110.0, "given"), ("volume", 5.5e6, "given"),
    }  # fmt: skip
    assert [row.error for row in study.rows if row.probe == "radius"] == pytest.approx([1.0 / 110.0] * 8)
    # All are as exact, on one front: the first takes the least time, and with a limit of its own each sequence has such a run.
    assert [row.pareto for row in study.rows if row.probe == "radius"] == [True] + [False] * 7
    _, _, apart = study_of("finest", "mesh.order=1,2", "mesh.divisions=2,3,4")
    assert sum(row.pareto for row in apart.rows) == 4


@pytest.mark.parametrize(
    ("order", "degree", "told"),
    [
        (0.98, 1, "order 0.98; a limit is told of orders from 1.5 to 2.5"),
        (2.0, 1, ""),
        (2.0, 2, "from 2.5 to 4.5 with six-node"),
        (3.9, 2, ""),
    ],
)
@pytest.mark.parametrize("reference", ["finest", "extrapolated"])
def test_no_limit_is_told_of_an_order_that_is_not_the_elements(
    order: float, degree: int, told: str, reference: str
) -> None:
    axes = ["mesh.divisions=2,4,8"]
    plan = build_plan(SPHERE, axes, fixed=[f"mesh.order={degree}"], probes=["radius"], reference=reference)
    study = analyse(plan, made_up(plan, lambda run: 100.0 + 30.0 * run.case.size**order))
    (found,) = study.convergences
    assert (found.extrapolation is None) == bool(told)
    assert told in found.no_extrapolation
    if reference == "finest":
        assert found.observed_order == pytest.approx(order)
    elif told:
        assert (found.reference, found.meshes[0].error) == (None, None)
        assert found.origin == f"no limit: {found.no_extrapolation}"
    else:
        assert found.reference == pytest.approx(100.0)


def test_extrapolated_reference_is_the_limit() -> None:
    _, _, study = study_of("extrapolated")
    assert study.convergences[0].reference == pytest.approx(100.0 + 1e-6, abs=1e-9)
    assert "observed order 2.00" in study.convergences[0].origin


def test_tables_and_figure(tmp_path: Path) -> None:
    plan, runs, _ = study_of("finest")
    runs[1] = replace(runs[1], status="over budget", reason="ended after 9 s", probes={})
    runs[3] = replace(runs[3], probes={"radius": 103.0})  # worse than the run before it, which takes less time
    study = analyse(plan, runs)
    write_tables(study, tmp_path)
    with (tmp_path / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["converged", "over budget", *["converged"] * 4]
    assert [row["mesh.divisions"] for row in rows] == ["2", "2", "4", "4", "8", "8"]
    assert (float(rows[0]["value"]), rows[1]["value"]) == (runs[0].probes["radius"], "")
    assert float(rows[2]["solve_s"]) == 3.0
    content = json.loads((tmp_path / "study.json").read_text())
    assert content["convergence"][0]["fitted_order"] == study.convergences[0].fitted_order
    assert len(content["runs"]) == len(content["measurements"]) == 6
    text = (tmp_path / "study.md").read_text()
    assert "**over budget**" in text
    assert "over budget: ended after 9 s" in text
    assert text.count("★") == 2
    draw_study(study, tmp_path / "study.png")
    draw_study(analyse(plan, [replace(run, probes={}) for run in runs]), tmp_path / "empty.png")
    with Image.open(tmp_path / "study.png") as picture, Image.open(tmp_path / "empty.png") as empty:
        assert picture.size == empty.size
        assert picture.size[0] > 2000  # three panels: the tolerance was varied
        assert picture.tobytes() != empty.tobytes()
    assert not list(tmp_path.glob(".*.tmp"))
