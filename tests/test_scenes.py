"""Every shipped scene runs and holds its own checks; single precision agrees with double; the README's program runs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from told import assert_told

from taichi_membrane.execution.run import run
from taichi_membrane.scene.file import load_scene, shipped_scenes

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.usefixtures("runtime_cpu")
@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_shipped_scene_holds_its_checks(name: str) -> None:
    """A scene's references and tolerances stand in the scene itself, with their sources."""
    path = shipped_scenes()[name]
    scene = load_scene(path)
    assert scene.checks, "a shipped scene checks itself"
    result = run(scene, base=path.parent)
    assert result.converged
    assert_told(result)
    assert result.passed, [f"{c.probe}: {c.value} against {c.reference}" for c in result.checks if not c.passed]


PRECISION_CODE = """
import json, sys, taichi_membrane as tm
from pathlib import Path
from taichi_membrane.scene.file import load_scene
scene = load_scene(Path(sys.argv[1]), ["mesh.around=16", "mesh.along=40", "stages.load.steps=2", "checks=[]"])
result = tm.run(scene, precision=sys.argv[2])
assert result.converged, result.steps[-1].reason
print(json.dumps(result.probe("deflection").tolist()))
"""


def test_single_precision_deflects_like_double() -> None:
    """Displacements, not positions, are stored and l² - L² is formed from them: below 1e-3 of the tip deflection.

    Measured 2e-4, all of it from the looser tolerance: at equal tolerance both agree to 2e-5.
    """
    values = []
    for precision in ("f64", "f32"):
        command = [sys.executable, "-c", PRECISION_CODE, str(ROOT / "scenes" / "cantilever.toml"), precision]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        values.append(json.loads(done.stdout.splitlines()[-1]))
    for double, single in list(zip(*values, strict=True))[1:]:
        assert single == pytest.approx(double, rel=1e-3)


def test_readme_program_runs(tmp_path: Path) -> None:
    """The complete program of the README, as printed there."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    programs = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "tm.run(" in block]
    assert len(programs) == 1
    done = subprocess.run(
        [sys.executable, "-c", programs[0]], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "mm" in done.stdout
