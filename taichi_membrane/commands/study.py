"""The command ``study``: error against run time over a grid of settings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichi_membrane.commands.common import NOT_CONVERGED, SceneArgument, SetForAllOption

if TYPE_CHECKING:
    from taichi_membrane.study.plan import Plan
    from taichi_membrane.study.runner import Run


def study(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=V1,V2,...",
            help="Values of a key of the scene, or of precision, arch, threads. KEY+KEY=V1:W1,V2:W2 changes keys together; "
            "what changes with a key of the mesh belongs to the mesh. "
            "May be repeated: all combinations are run.",
        ),
    ],
    reference: Annotated[
        str,
        typer.Option(
            metavar="VALUE|PROBE=VALUE,…|finest|extrapolated|check",
            help="What errors are measured against. A limit is extrapolated where the observed order is that of the elements.",
        ),
    ] = "finest",
    probe: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Measure this probe only. May be repeated.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(metavar="STAGE:STEP", help="Load step that is measured.", show_default="the last one"),
    ] = None,
    overrides: SetForAllOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output folder.", show_default="renders/study_NAME of the scene")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side; more than one disturb each other's times.")] = 1,
    budget: Annotated[
        float | None, typer.Option(min=1.0, metavar="SECONDS", help="Time for a run.", show_default="no limit")
    ] = None,
) -> None:
    """Measure error against run time over a grid of settings.

    Each combination runs in a fresh process; one that is done already is not run again. Writes study.csv, study.json, study.md and
    study.png. Exit code: 0 all runs converged, 2 bad input (found before anything runs), 3 a run gave no result.
    """
    from taichi_membrane.output.lock import sole_writer
    from taichi_membrane.scene.file import resolve_scene
    from taichi_membrane.study.plan import build_plan
    from taichi_membrane.study.runner import check_folder, run_all

    path = resolve_scene(scene)
    plan = build_plan(path, vary, fixed=overrides or (), probes=probe or (), at=at, reference=reference)
    directory = out or Path("renders") / f"study_{plan.cases[0].scene.name}"
    check_folder(directory)
    total, ended = len(plan.cases), 0

    def told(run: Run, reused: bool) -> None:
        nonlocal ended
        ended += 1
        typer.echo(f"[{ended}/{total}] {run.case.label}: {_verdict(run, reused=reused)}", err=True)

    with sole_writer(directory, "study"):
        runs = run_all(plan, directory, jobs=jobs, budget=budget, told=told)
        _report(plan, runs, directory)
    if any(run.status != "converged" for run in runs):
        raise typer.Exit(NOT_CONVERGED)


def _report(plan: Plan, runs: Sequence[Run], directory: Path) -> None:
    """Write tables and figure; print references and orders."""
    from taichi_membrane.study.analyse import analyse
    from taichi_membrane.study.figure import draw_study
    from taichi_membrane.study.tables import convergence_text, title, write_tables

    found = analyse(plan, runs)
    files = write_tables(found, directory)
    draw_study(found, directory / "study.png")
    for item in found.convergences:
        typer.echo(f"{title(item, plan.unit(item.probe))}: {convergence_text(item)}")
    typer.echo(f"wrote {directory}: {', '.join(file.name for file in [*files, directory / 'study.png'])}")


def _verdict(run: Run, *, reused: bool) -> str:
    """How a run ended, in a line."""
    when = " (done before)" if reused else ""
    if run.status != "converged":
        return f"{run.status.upper()}: {run.reason}{when}"
    return f"{run.iterations} iterations, set-up + solve {run.cost:.2f} s, {run.wall_seconds:.1f} s in all{when}"
