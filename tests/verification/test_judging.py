"""How cases are judged and reported, with made-up runs: no mechanics."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from taichi_membrane.assurance.verification import catalogue, report
from taichi_membrane.assurance.verification.benchmark import (
    Benchmark,
    NoEquilibriumError,
    Quantity,
    Solution,
    measured_order,
    run_benchmark,
)
from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError


def made_up(order: float = 2.0, share: float = 0.1, fails_at: int = 0) -> Benchmark:
    """A case whose value is 2 (1 + share · size^-order)."""

    def run(size: int) -> Solution:
        if size == fails_at:
            raise NoEquilibriumError("stage load, step 1: lost")
        return Solution(values={"height": 2.0 * (1.0 + share * size**-order)})

    return Benchmark(
        name="made_up", title="Made up", setting="Nothing.", size_label="pieces", sizes=(4, 8, 16), more_sizes=(32,), run=run,
        quantities=(Quantity(name="height", reference=2.0, source="nobody | ever", bound=0.001, order=2.0),),
    )  # fmt: skip


def test_a_right_case_passes() -> None:
    result = run_benchmark(made_up())
    assert result.passed
    assert result.quantities[0].slope == pytest.approx(2.0, abs=1e-9)  # exact power: round-off
    assert result.sizes == (4, 8, 16)


def test_full_adds_meshes() -> None:
    assert run_benchmark(made_up(), full=True).sizes == (4, 8, 16, 32)


def test_a_slow_rate_fails_within_the_bound() -> None:
    one = run_benchmark(made_up(order=1.0, share=0.01)).quantities[0]
    assert (one.within_bound, one.falls_fast_enough) == (True, False)


def test_a_large_error_fails_at_the_right_rate() -> None:
    one = run_benchmark(made_up(share=-0.3)).quantities[0]  # 0.3/16² is 1.2e-3
    assert (one.within_bound, one.falls_fast_enough) == (False, True)


def test_no_equilibrium_fails_and_keeps_the_other_meshes() -> None:
    result = run_benchmark(made_up(fails_at=8))
    assert not result.passed
    assert result.sizes == (4, 16)
    assert "8 pieces: stage load, step 1: lost" in result.failure


def test_a_quantity_without_rate_says_why() -> None:
    with pytest.raises(ValueError, match="say in remark why"):
        Quantity(name="height", reference=1.0, source="nobody", bound=0.1, order=None)


def test_errors_beneath_the_resolution_do_not_count() -> None:
    assert measured_order((4, 8, 16), (1e-2, 2.5e-3, 9e-4), 1e-3) == pytest.approx(2.0)
    assert measured_order((4, 8, 16), (1e-4, 1e-3, 1e-2), 1e-3) is None


def test_report_holds_every_mesh(tmp_path: Path) -> None:
    result = run_benchmark(made_up())
    paths = report.write([result], tmp_path / "new")
    assert [path.name for path in paths] == ["verification.md", "verification.csv", "verification.png"]
    table = paths[0].read_text(encoding="utf-8")
    assert "| made_up | height | 2.00078 | 2 | +0.039 % | 0.1 % | 2.00 (2) | nobody \\| ever |" in table
    with paths[1].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["size"] for row in rows] == ["4", "8", "16"]
    assert float(rows[0]["relative_error"]) == pytest.approx(0.1 / 16.0)
    with Image.open(paths[2]) as picture:
        picture.verify()


def test_command_fails_when_a_case_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "CASES", {"good": made_up, "bad": lambda: made_up(order=1.0)})
    runner = CliRunner()
    good = runner.invoke(app, ["verify", "--only", "good", "--out", str(tmp_path)])
    assert (good.exit_code, good.stdout.splitlines()[-1]) == (0, "1 of 1 cases passed")
    both = runner.invoke(app, ["verify", "--out", str(tmp_path)])
    assert both.exit_code == 1
    assert "FAILS" in both.stdout


def test_unknown_case_is_refused() -> None:
    with pytest.raises(InputError, match="no verification case is called 'spher'; there are sphere, cylinder"):
        catalogue.chosen(["spher"])
