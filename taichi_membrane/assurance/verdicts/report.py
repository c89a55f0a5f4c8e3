"""The verdict report: counts by family, every fault, all runs as CSV, and a picture of brackets against the truth."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from taichi_membrane.assurance.verdicts.case import Case, Finding, Truth
from taichi_membrane.assurance.verdicts.judge import KINDS, Fault, dependent, faults
from taichi_membrane.output.atomic import replacing
from taichi_membrane.pictures.plots import FONT, INK

COMMAND = "taichi-membrane stress --set verdicts"
_DPI = 130
_RIGHT, _WRONG = "#2f7f6b", "#8c1d2f"
_LONGEST = 200  # characters of a message in a table; the CSV has all


@dataclass(frozen=True)
class CaseReport:
    """A case with its runs and what is wrong with each."""

    case: Case
    findings: tuple[Finding, ...]
    wrong: tuple[tuple[Fault, ...], ...]

    @property
    def silent(self) -> int:
        """Runs that gave no verdict, and said why."""
        return sum(not (one.reached or one.limits is not None or one.refused or one.crashed) for one in self.findings)


def judged(case: Case, findings: Sequence[Finding]) -> CaseReport:
    """All runs of a case, judged one by one and against each other."""
    across = dependent(findings)
    wrong = [
        (*faults(case, one), *((across[number],) if number in across else ())) for number, one in enumerate(findings)
    ]
    return CaseReport(case, tuple(findings), tuple(wrong))


def counts(reports: Sequence[CaseReport]) -> Counter[str]:
    """Number of runs with each kind of fault."""
    return Counter(kind for one in reports for run in one.wrong for kind in {fault.kind for fault in run})


def write(reports: Sequence[CaseReport], directory: Path, arguments: str) -> list[Path]:
    """Write ``verdicts.md``, ``.csv`` and, where a limit is known, ``.png`` into the directory; returns their paths.

    :param arguments: what the command was given beside the set.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths = [directory / f"verdicts.{suffix}" for suffix in ("md", "csv")]
    for path, text in zip(paths, (markdown(reports, arguments), comma_separated(reports)), strict=True):
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    if _drawn(reports):
        paths.append(directory / "verdicts.png")
        with replacing(paths[-1]) as temporary:
            draw(reports, temporary)
    return paths


def _row(name: str, reports: Sequence[CaseReport]) -> list[str]:
    findings, count = [run for one in reports for run in one.findings], counts(reports)
    known = sum(len(one.findings) for one in reports if one.case.truth.kind != "open")
    return [
        name,
        str(len(reports)),
        str(len(findings)),
        str(known),
        *(str(count[kind]) for kind in KINDS),
        str(sum(one.silent for one in reports)),
        str(sum(bool(run.refused) for run in findings)),
        str(sum(run.iterations for run in findings)),
        f"{sum(run.seconds for run in findings):.0f} s",
    ]


def summary(reports: Sequence[CaseReport]) -> list[list[str]]:
    """The table of counts: heads, a row per family, and all together."""
    heads = ["family", "cases", "runs", "of known truth", *KINDS, "no verdict", "refused", "iterations", "time"]
    families = dict.fromkeys(one.case.family for one in reports)
    rows = [_row(name, [one for one in reports if one.case.family == name]) for name in families]
    return [heads, *rows, _row("all", reports)]


def markdown(reports: Sequence[CaseReport], arguments: str) -> str:
    """The page."""
    sources = Counter(one.case.truth.source for one in reports)
    parts = [
        "# Verdicts: whether what a run says of itself is true",
        "",
        f"Made by `{f'{COMMAND} {arguments}'.strip()}`; do not edit. Every case is run in several numbers of load steps, which "
        "must not matter. A run's states are examined anew: residual, reactions, and the eigenvalues of the tangent. A fault is "
        "counted once a run and kind. *No verdict*: the run says that it did not converge, and why.",
        "",
        "Truths by source: " + ", ".join(f"{count} {source}" for source, count in sources.most_common()) + ".",
        "",
        *_table(summary(reports)),
        "",
        *(["![Brackets of the largest stable load over the truth](verdicts.png)", ""] if _drawn(reports) else []),
        "## What was wrong",
        "",
        *_faults(reports),
        "",
        "## Cases",
        "",
        *_table([["case", "what", "steps", "truth", "said"], *(_case_row(one) for one in reports)]),
    ]
    return "\n".join(parts) + "\n"


def _faults(reports: Sequence[CaseReport]) -> list[str]:
    rows = [
        [one.case.name, str(run.steps), fault.kind, _short(fault.why)]
        for one in reports
        for run, wrong in zip(one.findings, one.wrong, strict=True)
        for fault in wrong
    ]
    return _table([["case", "steps", "fault", "what"], *rows]) if rows else ["Nothing."]


def _case_row(one: CaseReport) -> list[str]:
    said = dict.fromkeys(_short(run.told()) for run in one.findings)
    steps = ", ".join(str(run.steps) for run in one.findings)
    return [one.case.name, one.case.setting, steps, str(one.case.truth), "; ".join(said)]


def _table(lines: Sequence[Sequence[str]]) -> list[str]:
    whole = [list(lines[0]), ["---"] * len(lines[0]), *map(list, lines[1:])]
    return ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |" for line in whole]


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def comma_separated(reports: Sequence[CaseReport]) -> str:
    """Every run, one row each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            "family", "case", "steps", "truth", "truth_name", "truth_lower", "truth_upper", "source", "outcome", "passed", "told",
            "lower", "upper", "residual", "negative", "told_negative", "iterations", "seconds", "faults", "why", "warnings",
        ]
    )  # fmt: skip
    for one in reports:
        truth = one.case.truth
        for run, wrong in zip(one.findings, one.wrong, strict=True):
            lower, upper = (run.limits or {}).get(truth.name, ("", ""))
            state = run.states[-1] if run.states else None
            writer.writerow(
                [
                    one.case.family, one.case.name, run.steps, truth.kind, truth.name, truth.lower,
                    truth.upper, truth.source,
                    run.outcome, run.passed, run.told(), lower, upper, state and state.residual, state and state.negative,
                    state and state.told, run.iterations, f"{run.seconds:.2f}", "; ".join(fault.kind for fault in wrong),
                    "; ".join(fault.why for fault in wrong), "; ".join(run.warned),
                ]
            )  # fmt: skip
    return text.getvalue()


def _drawn(reports: Sequence[CaseReport]) -> list[tuple[CaseReport, int]]:
    """Runs whose bracket can be drawn over a known limit."""
    return [
        (one, number)
        for one in reports
        for number, run in enumerate(one.findings)
        if _closed(one.case.truth) and one.case.truth.name in (run.limits or {})
    ]


def _closed(truth: Truth) -> bool:
    """Whether a limit is known from both sides."""
    return truth.kind == "limit" and math.isfinite(truth.upper - truth.lower)


def draw(reports: Sequence[CaseReport], path: Path) -> None:
    """Middles of the brackets over the middle of the truth, less one: a point per run, those that are wrong in red."""
    figure = Figure(figsize=(9.0, 3.4), dpi=_DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    rows = list(dict.fromkeys(one.case.name for one, _ in _drawn(reports)))
    for one, number in _drawn(reports):
        truth, run = one.case.truth, one.findings[number]
        assert run.limits is not None
        middle, known = sum(run.limits[truth.name]) / 2.0, 0.5 * (truth.lower + truth.upper)
        wrong = bool(one.wrong[number])
        axes.plot(
            rows.index(one.case.name),
            middle / known - 1.0,
            "x" if wrong else "o",
            ms=3.5,
            color=_WRONG if wrong else _RIGHT,
        )
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set_yscale("symlog", linthresh=1e-4)
    axes.set_xlabel("case", fontsize=FONT["label"])
    axes.set_ylabel("bracket / truth − 1", fontsize=FONT["label"])
    axes.set_xticks([])
    figure.savefig(path, format="png")
