"""A load step needs nothing of the one before but its displacements."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from resume_cases import NO_MOTION, SCENE, environment

# No step is handed the state of the one before but by its displacements; compiled once, run once for each step to go on from.
EVERY_STEP = """
import sys
from pathlib import Path
import numpy as np
from run_files import same
from dataclasses import replace
from taichi_membrane.device import runtime
from taichi_membrane.scene.file import load_scene
from taichi_membrane.simulation.model import build_mesh, build_model
runtime.start(precision=sys.argv[2])
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.load_state import unloaded
scene = load_scene(Path(sys.argv[1]), sys.argv[3:])
work = Analysis(build_model(scene, build_mesh(scene)))
if sys.argv[2] == "f32":
    solve, membrane = work.equilibrium.solve, work.system
    def unlucky(*arguments, **options):  # ends with a split that is as good as any, but not the one that set_displacement makes
        record = solve(*arguments, **options)
        for field, sign in ((membrane.node_displacement, 1), (membrane.node_displacement_rest, -1)):
            field.from_numpy((field.to_numpy() + sign * membrane.displacement_quantum).astype("f4"))
        return record
    work.equilibrium.solve = unlucky
whole = [replace(step, seconds=0.0) for step in work.steps()]
assert len(whole) == 5 and whole[-1].converged and whole[-1].probes["wrinkled"] > 0.0, whole[-1].probes
if work.newton is not None:  # a factorised tangent is handed on as well, one that may round or pivot otherwise than a new one
    def kept():
        state, factor = work.newton._kept
        return *state, factor.solve(np.ones_like(state[0]))
    next(work.steps(done=whole[:2]))
    before, work.newton._kept = kept(), None
    work.equilibrium.apply(unloaded(scene))
    work.measure.again(whole[2])
    assert all(np.array_equal(one, other) for one, other in zip(before, kept()))
for last in whole[:-1]:
    rest = [replace(step, seconds=0.0) for step in work.steps(done=whole[: last.number + 1])]
    print(last.number, all(same(a, b) for a, b in zip(whole[last.number + 1:], rest, strict=True)))
"""


@pytest.mark.parametrize("arguments", [("f64",), ("f32", *NO_MOTION)], ids=["f64", "f32"])
def test_a_step_needs_nothing_of_the_one_before_but_its_displacements(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    scene = tmp_path / "beam.toml"
    scene.write_text(SCENE, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", EVERY_STEP, str(scene), *arguments],
        env=environment(tmp_path), capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["0", "True", "1", "True", "2", "True", "3", "True"]
