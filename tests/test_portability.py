"""Engine and renderer on Vulkan and OpenGL, by Mesa's software drivers, against the CPU in double precision.

One process has one back end, so each runs in its own. ``.ci/portability`` installs the drivers and lets none
of these tests be skipped.
"""

from __future__ import annotations

import ctypes.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
REQUIRED = "PORTABILITY_REQUIRED"  # set where a missing driver is a failure and no reason to skip

# A ball that wrinkles under a load at its top: every force, the wrinkling law and both solvers' common kernels take part.
PROGRAM = """
import sys
import numpy as np
import taichi_membrane as tm

arch, precision, out, drawn = sys.argv[1:]
scene = tm.Scene(
    name="ball",
    units={"length": "mm", "force": "N"},
    mesh={"shape": "sphere", "radius": 100.0, "divisions": 4},
    fabric={"E_warp": 12.0, "E_weft": 10.0, "nu": 0.3, "G": 4.0, "thickness": 1.0},
    supports=[
        {"group": "south", "hold": "xyz"}, {"group": "north", "hold": "xy"}, {"group": "x_plus", "normal": (0, 1, 0)},
    ],
    loads={"top": {"group": "north", "direction": (0, 0, -1)}},
    stages=[{"name": "inflate", "pressure": 0.01}, {"name": "press", "loads": {"top": 120.0}}],
    camera={"size": (480, 360)},
    solver={"kind": "relaxation", "tolerance": 1e-5},
)
result = tm.run(scene, arch=arch, precision=precision, out=out, render=drawn == "drawn")
assert result.converged, result.steps[-1].reason
np.savez(
    f"{out}/arrays.npz",
    arch=result.provenance["arch"],
    displacement=[step.displacement for step in result.steps],
    state=[step.elements.state for step in result.steps],
    stress=[step.elements.major_stress for step in result.steps],
    volume=[step.volume for step in result.steps],
)
"""


def _installed(arch: str) -> str | None:
    """What is missing for a back end; None where nothing is."""
    if arch == "vulkan":
        if ctypes.util.find_library("vulkan") is None or not list(
            Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json")
        ):
            return "Mesa's Vulkan software driver is not installed (Debian: mesa-vulkan-drivers libvulkan1)"
    elif ctypes.util.find_library("EGL") is None or not list(Path("/usr/lib").glob("*/dri/swrast_dri.so")):
        return "Mesa's OpenGL software driver is not installed (Debian: libegl1 libgl1-mesa-dri)"
    return None


def _environment(arch: str) -> dict[str, str]:
    """The software driver, even on a machine with a graphics card, and no display."""
    kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    drivers = ":".join(map(str, Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json")))
    chosen = (
        {"VK_ICD_FILENAMES": drivers}
        if arch == "vulkan"
        else {"EGL_PLATFORM": "surfaceless", "LIBGL_ALWAYS_SOFTWARE": "1"}
    )
    return {**kept, **chosen, "PYTHONPATH": str(ROOT)}


def _process(arch: str, precision: str, out: Path, drawn: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, arch, precision, str(out), drawn]
    return subprocess.run(command, env=_environment(arch), capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def on_cpu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the run on the CPU in double precision."""
    out = tmp_path_factory.mktemp("cpu") / "run"
    done = _process("cpu", "f64", out, "drawn")
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(params=["vulkan", "opengl"])
def arch(request: pytest.FixtureRequest) -> str:
    """A back end whose driver is there."""
    missing = _installed(request.param)
    if missing is not None:
        assert REQUIRED not in os.environ, missing
        pytest.skip(missing)
    return str(request.param)


@pytest.mark.portability
def test_a_back_end_gives_the_equilibrium_and_the_picture_of_the_cpu(arch: str, on_cpu: Path, tmp_path: Path) -> None:
    """A driver known to draw wrongly has to be refused, and then still has to find the equilibrium."""
    out = tmp_path / "run"
    done = _process(arch, "f32", out, "drawn")
    drawn = done.returncode == 0
    if not drawn:
        assert re.search(
            rf"arch = '{arch}': this driver draws \d+ of the 1444 samples of a test picture", done.stderr
        ), done.stderr
        assert not out.exists()
        done = _process(arch, "f32", out, "not drawn")
    assert done.returncode == 0, done.stderr
    _assert_same_equilibrium(dict(np.load(out / "arrays.npz")), dict(np.load(on_cpu / "arrays.npz")), arch)
    for number in range(2 if drawn else 0):
        ours, theirs = (_picture(folder / f"step_000{number}.png") for folder in (out, on_cpu))
        assert theirs.std() > 10.0, "not an empty page"
        differs = np.abs(ours - theirs).max(axis=2) > 16
        assert differs.mean() < 0.005, f"{differs.sum()} pixels of {differs.size} differ"


def _assert_same_equilibrium(
    found: dict[str, NDArray[np.float64]], expected: dict[str, NDArray[np.float64]], arch: str
) -> None:
    assert str(found["arch"]) == arch
    size = np.abs(expected["displacement"]).max()
    # Both stop at an out-of-balance force of 1e-5 of the load, which leaves some 1e-4 of the displacements.
    assert np.abs(found["displacement"] - expected["displacement"]).max() < 2e-3 * size
    assert np.abs(found["stress"] - expected["stress"]).max() < 2e-3 * expected["stress"].max()
    assert found["volume"] == pytest.approx(expected["volume"], rel=1e-5)
    assert (found["state"] != expected["state"]).mean() < 0.01
    assert len(np.unique(expected["state"])) > 1, "the case has to wrinkle"


def _picture(path: Path) -> NDArray[np.float64]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64)


@pytest.mark.portability
@pytest.mark.parametrize("missing", ["cuda", "metal", "vulkan", "opengl", "opengl without driver"])
def test_a_missing_back_end_is_an_error_that_names_the_others(missing: str) -> None:
    """The drivers are hidden from the process; Metal is Apple's."""
    missing, _, driver = missing.partition(" ")
    hidden = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json", "CUDA_VISIBLE_DEVICES": ""}
    # Without its list of vendors EGL offers nothing; with Mesa's EGL but no driver below it Taichi crashes.
    hidden |= {"LIBGL_DRIVERS_PATH": "/nowhere"} if driver else {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"}
    program = (
        "import sys\nfrom taichi_membrane.device import runtime\nfrom taichi_membrane.errors import InputError\n"
        "try:\n    print('RUNS', runtime.start(arch=sys.argv[1], precision='f32'))\n"
        "except InputError as error:\n    print(error)\n"
    )
    command = [sys.executable, "-c", program, missing]
    environment = {**os.environ, **hidden, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"arch = '{missing}' is not available on this machine"), done.stdout
    for other in ("cpu", "gpu", "cuda", "vulkan", "metal", "opengl"):
        assert (f"'{other}'" in done.stdout.rpartition("; ")[2]) == (other != missing)
