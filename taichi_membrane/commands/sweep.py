"""The command ``sweep``: many runs of one scene with changed settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from taichi_membrane.commands.common import NOT_CONVERGED, ArchOption, PrecisionOption, SceneArgument, SetForAllOption

VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=V1,V2,...|KEY=FIRST:LAST:COUNT",
        help="Values of a key; all combinations are run. KEY+KEY=V1:W1,V2:W2 changes keys together. May be repeated.",
    ),
]
SampleOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=normal:MEAN:SD",
        help="Draw a key from normal:MEAN:SD, lognormal:MEAN:SD (SD also as 5%) or uniform:LOW:HIGH. May be repeated.",
    ),
]


def sweep(
    scene: SceneArgument,
    vary: VaryOption = None,
    sample: SampleOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Points drawn.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The same seed draws the same points.")] = 0,
    design: Annotated[
        Literal["latin", "sobol", "importance"],
        typer.Option(help="Latin hypercube, Sobol' points, or points for first-order and total importance."),
    ] = "latin",
    table: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Keys as heads and a run in every row, in place of the above.")
    ] = None,
    tie: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=[FACTOR*]OTHER", help="A key that follows one that is varied or drawn. May be repeated."
        ),
    ] = None,
    overrides: SetForAllOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output folder.", show_default="renders/sweep_NAME of the scene")
    ] = None,
    arch: ArchOption = "cpu",
    precision: PrecisionOption = "f64",
    threads: Annotated[int, typer.Option(min=1, help="CPU threads of each run.")] = 1,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes.", show_default="all cores")] = None,
    cluster: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS|local", help="Run on the workers of a Dask scheduler, tcp://HOST:8786."),
    ] = None,
    files: Annotated[bool, typer.Option("--files", help="Keep the files of every run, in runs/.")] = False,
    store: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Workers put each run's files here, zipped: a folder, or s3://..."),
    ] = None,
) -> None:
    """Run a scene many times with changed settings; one that is done already is not run again.

    Writes sweep.csv (a row as each run ends), sweep.json, sweep.md and pictures. Exit code: 0 every run counts, 2 bad input (found
    before anything runs), 3 some run stands apart: it gave no result that may be compared with the others, and the row says why.
    """
    from taichi_membrane.parametric.plan import Conditions, build_sweep
    from taichi_membrane.parametric.progress import told_by_bar
    from taichi_membrane.parametric.summary import counts
    from taichi_membrane.parametric.sweep import run_sweep

    plan = build_sweep(
        scene, vary=vary or (), sample=sample or (), table=table, tie=tie or (), fixed=overrides or (), runs=runs, seed=seed,
        design=design, conditions=Conditions(arch=arch, precision=precision, threads=threads),
    )  # fmt: skip
    directory = out or Path("renders") / f"sweep_{plan.scene.name}"
    with told_by_bar(len(plan.trials)) as told:
        found = run_sweep(plan, out=directory, jobs=jobs, cluster=cluster, store=store, files=files, told=told)
    typer.echo(counts(found))
    typer.echo(f"wrote {directory}: {', '.join(file.name for file in found.files)}")
    if found.apart:
        raise typer.Exit(NOT_CONVERGED)
