"""The run that tests stop and go on with."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

import taichi_membrane as tm
from taichi_membrane.execution.observer import Silent
from taichi_membrane.simulation.results import StepResult

ROOT = Path(__file__).resolve().parent.parent
# Inflated, then bent and pushed until it wrinkles: Newton in double precision, relaxation in single.
SCENE = """
name = "beam"
units = { length = "mm", force = "N" }
mesh = { shape = "tube", radius = 25, length = 100, around = 8, along = 6, cap_end = "flat" }
fabric = { E_warp = 4000, E_weft = 2500, nu = 0.1, G = 150, thickness = 0.1 }
supports = [{ group = "start", hold = "xyz" }]
loads = { side = { group = "end", direction = [0, -1, 0] } }
motions = { push = { kind = "translation", group = "end", hold = "z", direction = [0, 0, -1] } }
camera = { size = [320, 240] }
curve = { x = "deflection", y = "load.side" }

[[stages]]
name = "inflate"
pressure = 0.03
steps = 2

[[stages]]
name = "load"
steps = 3
loads = { side = 2.0 }
motions = { push = 2.0 }

[probes]
deflection = { kind = "displacement", group = "end", component = "y" }
wrinkled = { kind = "area_share" }

[[checks]]
probe = "deflection"
stage = "load"
reference = 0.0
absolute = 50.0
source = "the tube is still there"
"""
# A motion sets the displacements anew at every step, which would hide what single precision has beside their sum.
NO_MOTION = ("motions={}", "stages.load.motions={}")
RELAXATION = ("--set=solver.kind=relaxation",)  # compiles fastest


def environment(cwd: Path) -> dict[str, str]:
    """Of a process of its own: kernels are compiled once for all of them."""
    tests = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    own = {"PYTHONPATH": tests, "PATH": "/usr/bin", "HOME": str(cwd), "LC_ALL": "C.UTF-8"}
    return own | {key: value for key, value in os.environ.items() if key == "TI_OFFLINE_CACHE_FILE_PATH"}


class _Impatient(Silent):
    """Stops a run after a step."""

    def __init__(self, last: int) -> None:
        self.last = last

    def step_done(self, step: StepResult) -> None:
        """Stop."""
        if step.number == self.last:
            raise KeyboardInterrupt


def run_until(last: int, scene: tm.Scene, **options: Any) -> None:
    """Run a scene and stop it after a step, as Ctrl-C does."""
    with pytest.raises(KeyboardInterrupt):
        tm.run(scene, observer=_Impatient(last), **options)
