"""How stress entries are judged, bordered and reported, with made-up runs: no mechanics."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from taichi_membrane.assurance.stability import catalogue, report
from taichi_membrane.assurance.stability.bracket import Bracket
from taichi_membrane.assurance.stability.case import CONVERGED, HONEST, WRONG, Entry, Problem, Sweep, border, judge
from taichi_membrane.commands import stress as command
from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.scene import Scene

LEVELS = (1.0, 10.0, 100.0)


def no_problem(level: float) -> Problem:
    raise AssertionError(f"nothing is run at {level}")


def made_up(**changes: Any) -> Sweep:
    """A case whose number has to be 2 within a per cent."""
    parts: dict[str, Any] = {
        "name": "made_up", "theme": "state", "title": "Made up", "setting": "Nothing.", "parameter": "load | none",
        "levels": LEVELS, "problem": no_problem, "against": "exact", "source": "nobody", "bound": 0.01, "required": 10.0,
    }  # fmt: skip
    return Sweep(**(parts | changes))


def entry(level: float = 1.0, **changes: Any) -> Entry:
    """A right result of the default solver."""
    good = Entry(
        case="made_up", level=level, solver="hybrid", precision="f64", converged=True, reason="residual", finite=True,
        iterations=3, seconds=0.1, residual=5e-7, tolerance=1e-6, kept=True, strain=0.1, energy=-1.0, eigenvalue=1.5,
        moved=1e-6, values={"height": 2.0}, exact={"height": 2.0},
    )  # fmt: skip
    return replace(good, **changes)


FAILED: dict[str, Any] = {"converged": False, "reason": "no equilibrium found", "values": {}, "moved": None}


@pytest.mark.parametrize(
    ("changes", "verdict", "why"),
    [
        ({}, CONVERGED, ""),
        ({"values": {"height": 2.019}}, CONVERGED, ""),
        ({"values": {"height": 2.021}}, WRONG, "1.05e-02 from the reference, 0.01 allowed"),
        ({"values": {"height": float("nan")}}, WRONG, "nan from the reference"),
        ({"finite": False}, WRONG, "not finite"),
        ({"finite": False, **FAILED}, WRONG, "not finite"),
        ({"residual": 2.1e-6}, WRONG, "its residual is 2.1e-06"),
        ({"residual": None}, CONVERGED, ""),
        ({"eigenvalue": 4.01}, WRONG, "do not bound the stiffness"),
        ({"eigenvalue": 4.0}, CONVERGED, ""),
        (FAILED, HONEST, "no equilibrium found"),
        ({**FAILED, "reason": ""}, WRONG, "no reason given"),
        ({**FAILED, "kept": False, "residual": 0.1}, WRONG, "the state kept is no equilibrium"),
    ],
)  # fmt: skip
def test_verdicts(changes: dict[str, Any], verdict: str, why: str) -> None:
    (one,) = judge(made_up(), [entry(**changes)])
    assert one.verdict == verdict
    assert why in one.why


@pytest.mark.parametrize(
    ("lower", "upper", "target", "known", "why"),
    [
        (1.0, 1.2, 2.0, None, ""),
        (1.0, 1.0, 2.0, 1.0, ""),
        (1.2, 1.0, 2.0, None, "between 1.2 and 1, on the way to 2: out of order"),
        (1.0, 1.2, 2.0, 1.1, ""),
        (1.0, 1.2, 2.0, 1.200011, ""),  # as near as the residual's tolerance lets it be known
        (1.0, 1.2, 2.0, 1.200013, "but it is at 1.20001"),
        (1.0, 1.2, 2.0, 0.99, "between 1 and 1.2, but it is at 0.99"),
        (1.0, 1.2, 2.0, 1.21, "between 1 and 1.2, but it is at 1.21"),
        (1.2, 1.0, 0.0, 1.1, ""),  # a pressure that falls
        (1.0, 1.2, 0.0, 1.1, "out of order"),
        (1.2, 1.0, 0.0, 1.3, "but it is at 1.3"),
        (float("nan"), 1.2, 2.0, None, "out of order"),
        (1.0, float("nan"), 2.0, 1.1, "out of order"),
    ],
)
def test_a_bracket_of_collapse_is_in_order_and_holds_the_collapse(
    lower: float, upper: float, target: float, known: float | None, why: str
) -> None:
    bracket = Bracket(name="load.tip", lower=lower, upper=upper, target=target, known=known)
    (one,) = judge(made_up(), [entry(**FAILED, brackets=(bracket,))])
    assert one.verdict == (WRONG if why else HONEST)
    assert why in one.why


def test_error_is_relative_to_the_floor_where_the_reference_is_zero() -> None:
    nought = entry(values={"left": 0.02}, exact={"left": 0.0})
    assert judge(made_up(floor=4.0), [nought])[0].error == pytest.approx(0.005)
    assert judge(made_up(floor=1.0), [nought])[0].verdict == WRONG


def test_an_invariance_compares_with_the_first_level_of_the_same_solver() -> None:
    entries = [
        entry(1.0, values={"height": 3.0}),
        entry(10.0, values={"height": 3.01}),
        entry(100.0, values={"height": 5.0}),  # right by the other solver's first level, which is none of its business
        entry(1.0, values={"height": 5.0}, solver="newton"),
        entry(10.0, values={"height": 5.0}, solver="newton"),
    ]
    assert [one.verdict for one in judge(made_up(against="base"), entries)] == [CONVERGED] * 2 + [WRONG] + [
        CONVERGED
    ] * 2


def test_peers_are_the_other_method_in_double_precision() -> None:
    case = made_up(against="peers")
    newton, hybrid = entry(solver="newton", values={"height": 3.0}), entry(values={"height": 3.0})
    relaxed = entry(solver="relaxation", values={"height": 2.0})
    single = entry(solver="relaxation", precision="f32", values={"height": 3.001}, moved=None, eigenvalue=None)
    errors = [one.error for one in judge(case, [newton, hybrid, relaxed, single])]
    # Newton agrees with the hybrid, but that is no independent witness.
    assert errors == [pytest.approx(0.5), pytest.approx(0.5), pytest.approx(1 / 3), pytest.approx(0.001 / 3)]
    assert judge(case, [newton])[0].error is None
    assert judge(case, [newton, hybrid])[0].error == 0.0


def test_another_equilibrium_has_to_be_confirmed() -> None:
    case = made_up(against="peers")
    peer = entry(solver="relaxation", values={"height": 2.0})
    confirmed, moving = (entry(values={"height": 3.0}, moved=moved) for moved in (1e-6, 0.1))
    unknown = entry(values={"height": 3.0}, moved=None)
    verdicts = [judge(case, [one, peer])[0] for one in (confirmed, moving, unknown)]
    assert [one.verdict for one in verdicts] == [CONVERGED, WRONG, WRONG]
    assert "another equilibrium" in verdicts[0].why
    assert judge(made_up(), [confirmed])[0].verdict == WRONG  # an exact reference admits no other


def test_a_documented_fault_is_known_from_its_level_on() -> None:
    case = made_up(known={"hybrid f64": 10.0}, remark="Because.")
    wrong = {"values": {"height": 9.0}}
    judged = judge(
        case, [entry(1.0, **wrong), entry(10.0, **wrong), entry(100.0, **wrong), entry(100.0, solver="newton", **wrong)]
    )
    assert [one.known for one in judged] == [False, True, True, False]


def test_border_is_the_last_level_before_the_first_that_is_not_right() -> None:
    def found(*good: bool) -> tuple[float | None, float | None]:
        entries = [entry(level, **({} if ok else FAILED)) for level, ok in zip(LEVELS, good, strict=False)]
        one = border(LEVELS, judge(made_up(), entries))
        return one.safe, one.breaks

    assert found(True, True, True) == (100.0, None)
    assert found(True, False, True) == (1.0, 10.0)
    assert found(False) == (None, 1.0)
    assert found(True) == (1.0, 10.0)  # the second was never run


def reported(entries: Sequence[Entry], **changes: Any) -> report.SweepReport:
    """A report of the default set."""
    case = made_up(**changes)
    return report.SweepReport(case, case.levels, tuple(judge(case, entries)))


def test_a_default_solver_that_gives_way_early_falls_short() -> None:
    assert not reported([entry(1.0), entry(10.0), entry(100.0, **FAILED)]).short
    assert reported([entry(1.0), entry(10.0, **FAILED)]).short
    assert reported([entry(1.0, **FAILED)]).short
    assert reported([entry(level, solver="newton") for level in LEVELS]).short


def test_report_holds_every_entry(tmp_path: Path) -> None:
    entries = [
        entry(1.0),
        entry(10.0, values={"height": 9.0, "drift": 3e-5}, exact={"height": 2.0}),
        entry(100.0, **FAILED),
    ]
    paths = report.write([reported(entries)], tmp_path / "new")
    assert [path.name for path in paths] == ["stability.md", "stability.csv", "stability.png"]
    text = paths[0].read_text(encoding="utf-8")
    assert "3 entries: 1 converged and right, 1 honest failures, 1 wrong (0 of them documented)." in text
    assert "| made_up | load \\| none | 1; gives way at 10 | nowhere; gives way at 1 |" in text
    assert (
        "| hybrid f64 | 10 | **WRONG** | 3 | 0.10 s | 5.0e-07 | 3.5e+00 | 3.0e-05 | 1.0e-01 | 1.500 | said to be"
        in text
    )
    with paths[1].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["level"], row["verdict"]) for row in rows] == [("1", CONVERGED), ("10", WRONG), ("100", HONEST)]
    assert rows[1]["values"] == "height = 9; drift = 3e-05"
    assert rows[2]["why"] == "no equilibrium found"


def test_picture_shows_each_verdict(tmp_path: Path) -> None:
    def area(entries: Sequence[Entry], verdict: str) -> int:
        report.draw([reported(entries)], tmp_path / "picture.png")
        with Image.open(tmp_path / "picture.png") as picture:
            pixels = np.asarray(picture.convert("RGB"))
        return int((pixels == np.frombuffer(bytes.fromhex(report._COLOUR[verdict][1:]), np.uint8)).all(axis=2).sum())

    for verdict, changes in ((CONVERGED, {}), (HONEST, FAILED), (WRONG, {"finite": False})):
        in_legend = area([], verdict)
        assert in_legend > 0
        assert area([entry(1.0, **changes)], verdict) > in_legend + 200  # a cell is 50 by 30 points


def test_verdicts_differ_in_print_without_colours() -> None:
    colours = [*report._COLOUR.values(), report._NOT_RUN]
    grey = sorted(Image.new("RGB", (1, 1), colour).convert("L").getpixel((0, 0)) for colour in colours)
    assert min(np.diff(grey)) > 20, grey


@pytest.mark.parametrize(
    ("entries", "known", "code", "words"),
    [
        ([entry(1.0), entry(10.0)], {}, 0, "2 entries: 2 converged and right"),
        ([entry(1.0), entry(10.0), entry(100.0, **FAILED)], {}, 0, "1 honest failures"),
        ([entry(1.0), entry(10.0, **FAILED)], {}, 1, "falls short in made_up"),
        ([entry(1.0), entry(10.0), entry(100.0, finite=False)], {}, 1, "WRONG: hybrid f64 at 100: a number that is not finite"),
        ([entry(1.0), entry(10.0), entry(100.0, finite=False)], {"hybrid f64": 100.0}, 0, "1 wrong and documented, 0 wrong"),
    ],
)  # fmt: skip
def test_exit_code(
    entries: list[Entry],
    known: dict[str, float],
    code: int,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(catalogue, "CASES", {"made_up": lambda: made_up(known=known, remark="Because.")})
    monkeypatch.setattr(command, "run_all", lambda names, **_: dict.fromkeys(names, entries))
    result = CliRunner().invoke(app, ["stress", "--out", str(tmp_path)])
    assert result.exit_code == code
    assert words in result.stdout


def test_unknown_case_is_refused() -> None:
    with pytest.raises(InputError, match="no stress case is called 'flatt'; there are warp_weft, "):
        catalogue.chosen(["flatt"])


@pytest.mark.parametrize("name", catalogue.CASES)
def test_cases_are_complete(name: str) -> None:
    case = catalogue.CASES[name]()
    levels = case.swept(full=True)
    assert case.name == name
    assert len(set(levels)) == len(levels)
    assert case.required in case.levels
    assert all(level in levels for level in case.known.values())
    assert bool(case.known) == bool(case.remark)


@pytest.mark.parametrize("name", catalogue.CASES)
def test_every_level_is_a_scene_that_the_program_admits(name: str) -> None:
    case = catalogue.CASES[name]()
    for level in case.swept(full=True):
        data = {"name": "case", "units": {"length": "m", "force": "N"}, **case.problem(level).scene}
        assert Scene.model_validate(data).stages
