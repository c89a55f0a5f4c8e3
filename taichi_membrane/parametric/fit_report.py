"""Writes what a calibration found: ``fit.json``, ``fit.csv`` and ``fit.png``."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from taichi_membrane.errors import InputError
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.curve import quantity_label
from taichi_membrane.output.lock import LOCK
from taichi_membrane.parametric.fit import CONFIDENCE, FitResult
from taichi_membrane.parametric.plan import VERSIONED
from taichi_membrane.pictures.plots import COLOURS, DPI, FONT, GREY, INK, rule

_RESULT = "fit.json"


def check_fit_folder(directory: Path) -> None:
    """Make sure that a fit may write here.

    :raises InputError: the folder holds files, but no fit; or it is no folder.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: the output folder is a file")
    held = sorted(path.name for path in directory.iterdir() if path.name != LOCK) if directory.is_dir() else []
    if held and _RESULT not in held:
        raise InputError(
            f"{directory}: the output folder holds {held[0]!r} but no earlier fit; give an empty or new one"
        )


def write_fit(found: FitResult, directory: Path) -> FitResult:
    """Write the files, each whole or not at all; of a fit that failed on the way only what there is to say.

    :raises InputError: one of them cannot be written.
    """
    files = [directory / _RESULT]
    with replacing(files[0]) as temporary:
        temporary.write_text(_json(found), encoding="utf-8", newline="\n")
    if found.computed:
        files += [directory / "fit.csv", directory / "fit.png"]
        with replacing(files[1]) as temporary:
            temporary.write_text(_csv(found), encoding="utf-8", newline="\n")
        _draw(found, files[2])
    return replace(found, directory=directory, files=tuple(files))


def _json(found: FitResult) -> str:
    content = {
        "format": "taichi_membrane fit",
        "format_version": 1,
        "scene": found.scene.name,
        "versions": {name: metadata.version(name) for name in VERSIONED},
        "probe": found.probe,
        "converged": found.converged,
        "reason": found.reason,
        "free": [{"key": one.key, "start": one.start} for one in found.free],
        "values": found.values,
        "confidence": CONFIDENCE,
        "intervals": found.intervals,
        "covariance": None if found.covariance is None else found.covariance.tolist(),
        "adjoint": list(found.adjoint),
        "runs": found.runs,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _csv(found: FitResult) -> str:
    lines = [f"{found.measured.quantity},measured,computed,residual,sd"]
    columns = (found.measured.x, found.measured.y, found.computed, found.residuals.tolist(), found.deviation)
    lines += [",".join(map(repr, row)) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def _draw(found: FitResult, path: Path) -> None:
    """Readings and computed curve; below, the residuals in standard deviations of a reading."""
    figure = Figure(figsize=(7.0, 6.0), dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.07))
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    order = np.argsort(found.measured.x)
    x, y = np.array(found.measured.x)[order], np.array(found.measured.y)[order]
    computed, deviation = np.array(found.computed)[order], np.array(found.deviation)[order]
    top.errorbar(
        x, y, yerr=deviation if found.measured.deviation else None, fmt="d", ms=5.0, mfc="white", mec=GREY, ecolor=GREY, mew=1.1,
        label="measured", zorder=3,
    )  # fmt: skip
    top.plot(x, computed, "-o", color=COLOURS[0], lw=1.8, ms=4.0, label="computed", zorder=4)
    top.set_ylabel(quantity_label(found.scene, found.probe), fontsize=FONT["label"], color=INK)
    head = found.scene.title or found.scene.name
    top.set_title(
        f"{head}: fit{'' if found.converged else ' (NOT CONVERGED)'}",
        fontsize=FONT["title"],
        fontweight="bold",
        loc="left",
        color=INK,
    )
    bottom.axhline(0.0, color=INK, lw=0.8)
    bottom.vlines(x, 0.0, (computed - y) / deviation, color=COLOURS[0], lw=1.2, zorder=3)
    bottom.plot(x, (computed - y) / deviation, "o", color=COLOURS[0], ms=4.5, zorder=4)
    bottom.set_ylabel("residual / sd", fontsize=FONT["label"], color=INK)
    bottom.set_xlabel(quantity_label(found.scene, found.measured.quantity), fontsize=FONT["label"], color=INK)
    for axes in (top, bottom):
        rule(axes)
    top.legend(frameon=False, fontsize=FONT["small"])
    with replacing(path) as temporary, matplotlib.rc_context({"svg.hashsalt": "taichi-membrane"}):
        figure.savefig(temporary, format="png", dpi=DPI, metadata={"Software": None})
