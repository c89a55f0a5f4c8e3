"""The command ``fit``: settings for which a probe follows a measured curve best."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from taichi_membrane.commands.common import NOT_CONVERGED, SceneArgument, SetForAllOption


def fit(
    scene: SceneArgument,
    to: Annotated[
        Path,
        typer.Option(
            metavar="CSV",
            help="The measured curve: heads such as load.tip,deflection[,sd], then a line for each reading.",
        ),
    ],
    free: Annotated[
        str,
        typer.Option(
            metavar="KEY,KEY=LOW:HIGH,...", help="Settings to find, from where the scene has them; bounds if wanted."
        ),
    ],
    probe: Annotated[str, typer.Option(metavar="NAME", help="The probe that was measured.")],
    stage: Annotated[
        str | None, typer.Option(metavar="NAME", help="The stage that was measured.", show_default="the last one")
    ] = None,
    overrides: SetForAllOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Output folder.", show_default="renders/fit_NAME of the scene")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side, where derivatives are differences.")] = 1,
) -> None:
    """Find the settings for which a probe follows a measured curve best, by least squares.

    Writes fit.json, fit.csv and fit.png. Exit code: 0 found, 2 bad input, 3 no minimum was found or the
    readings do not determine it.
    """
    from taichi_membrane.parametric.fit import fit as find
    from taichi_membrane.scene.file import resolve_scene

    path = resolve_scene(scene)
    directory = out or Path("renders") / f"fit_{path.stem}"
    found = find(
        path, to=to, free=[one for one in free.split(",") if one.strip()], probe=probe, stage=stage, fixed=overrides or (),
        out=directory, jobs=jobs,
    )  # fmt: skip
    if found.converged and found.intervals is not None:
        for key, value in found.values.items():
            low, high = found.intervals[key]
            typer.echo(f"{key} = {value:.6g} (95 %: {low:.6g} to {high:.6g})")
    typer.echo(f"{found.runs} runs; wrote {directory}: {', '.join(file.name for file in found.files)}")
    if not found.converged:
        typer.echo(f"NOT CONVERGED: {found.reason}", err=True)
        raise typer.Exit(NOT_CONVERGED)
