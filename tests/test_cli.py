"""The command line: exit codes, messages, what goes where; real runs of a small sphere."""

from __future__ import annotations

import importlib
import json
import re
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from taichi_membrane.commands.cli import app
from taichi_membrane.device.runtime import Runtime
from taichi_membrane.output.reader import read_run
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import load_scene, shipped_scenes

RUN = importlib.import_module("taichi_membrane.execution.run")  # the package's attribute of that name is the function
ROOT = Path(__file__).resolve().parent.parent
SCENE = """
name = "ball"
title = "Small [bold]ball[/bold]"  # looks like markup of rich, but is text
units = { length = "mm", force = "N" }
mesh = { shape = "sphere", radius = 100.0, divisions = 3 }
fabric = { E = 10.0, nu = 0.3, thickness = 1.0 }
supports = [{ group = "south", hold = "xyz" }, { group = "north", hold = "xy" }, { group = "x_plus", hold = "y" }]
camera = { size = [320, 240] }
solver = { kind = "relaxation" }  # compiles fastest, and fails at will: max_iterations

[[stages]]
name = "inflate"
steps = 2
pressure = 0.002

[probes.radius]
kind = "radius"
group = "equator"
axis = "z"

[probes.foot]
kind = "reaction"
group = "south"
component = "z"

[[checks]]
probe = "radius"
stage = "inflate"
reference = 100.7
tolerance = 0.01
source = "p r²(1 - nu)/(2 E t)"

[[checks]]
probe = "foot"
stage = "inflate"
reference = 0.0
absolute = 1e-3
source = "a closed body's pressure is in equilibrium with itself"
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A small scene in an empty current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.toml").write_text(SCENE, encoding="utf-8")
    return "ball.toml"


def call(*arguments: str) -> Result:
    """The command in this process; errors other than exits are raised."""
    return CliRunner().invoke(app, arguments, catch_exceptions=False)


def call_process(*arguments: str, cwd: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, with no terminal."""
    command = [sys.executable, "-m", "taichi_membrane", *arguments]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin", "HOME": str(cwd), "LC_ALL": "C.UTF-8"}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, encoding="utf-8", timeout=120, check=False, **options
    )


def test_a_good_run_ends_with_0_and_its_files(scene: str, runtime_cpu: Runtime) -> None:
    done = call("run", scene, "--no-render")
    assert done.exit_code == 0, done.stderr
    assert "inflate 2/2" in done.stdout
    assert "2 of 2 checks hold" in done.stdout
    written = " ".join(done.stdout.split())
    assert (
        "wrote renders/ball: summary.json, history.csv, steps.pvd, mesh.vtu, step_0000.vtu … step_0001.vtu" in written
    )
    assert len(read_run(Path("renders/ball")).steps) == 2
    phases = ["reading the mesh …", "starting Taichi …", "compiling kernels …", "solving …"]
    lines = done.stderr.splitlines()
    assert lines[:4] == phases
    assert re.fullmatch(r"inflate 1/2: \d+ iterations, residual \d\.\de-\d\d, 0\.0% wrinkled, \d+\.\d s", lines[4])


def test_a_run_may_write_its_page_too_and_so_may_its_resume(scene: str, runtime_cpu: Runtime) -> None:
    """A page is written whatever the verdict; a run that has ended needs no more than its files."""
    page = Path("renders/ball/report.html")
    done = call("run", scene, "--no-render", "--report", "--set", "checks.1.reference=90")
    assert done.exit_code == 1
    assert "wrote renders/ball/report.html (" in done.stdout
    first = page.read_text(encoding="utf-8")
    assert "1 of 2 checks hold; failing: radius at inflate 2" in first
    page.unlink()
    assert call("run", "--resume", "renders/ball", "--report", "--quiet").stdout.count("wrote") == 0
    assert page.read_text(encoding="utf-8") == first
    assert call("run", scene, "--no-render").exit_code == 0
    assert not page.exists()


def test_a_failing_check_ends_with_1_and_says_which(scene: str, runtime_cpu: Runtime) -> None:
    done = call("run", scene, "--no-render", "--set", "checks.1.reference=90")
    assert done.exit_code == 1
    assert re.search(r"^radius +inflate 2 .* FAIL$", done.stdout, re.MULTILINE)
    assert re.search(r"^foot +inflate 2 .* pass$", done.stdout, re.MULTILINE)
    assert "CHECK FAILS: radius at inflate 2: 100." in done.stdout
    assert "reference 90 mm within 1 %: p r²(1 - nu)/(2 E t)" in done.stdout
    assert "1 of 2 checks hold" in done.stdout


def test_a_step_that_does_not_converge_ends_with_3_whatever_the_checks_say(scene: str, runtime_cpu: Runtime) -> None:
    done = call("run", scene, "--no-render", "--set", "solver.max_iterations=3", "--set", "solver.max_cuts=0")
    assert done.exit_code == 3
    assert "NOT CONVERGED: load step 0 (inflate 1/2): no equilibrium found" in done.stdout
    assert "CHECK FAILS: radius at inflate 2: not reached" in done.stdout
    assert "inflate 1/2: NOT CONVERGED, 3 iterations" in done.stderr
    steps = read_run(Path("renders/ball")).steps
    assert [step.converged for step in steps] == [False]


@pytest.mark.parametrize(
    ("changes", "code", "expected"),
    [
        ([], 0, ""),
        (["checks.1.reference=90"], 1, "^CHECK FAILS: radius at inflate 2: .*\n$"),
        (["solver.max_iterations=3", "solver.max_cuts=0", "checks=[]"], 3, "^NOT CONVERGED: load step 0 .*\n$"),
    ],
)
def test_quiet_prints_failures_alone(
    scene: str, runtime_cpu: Runtime, changes: list[str], code: int, expected: str
) -> None:
    done = call("run", scene, "--no-render", "--quiet", *(part for change in changes for part in ("--set", change)))
    assert done.exit_code == code
    assert done.stderr == ""
    assert re.fullmatch(expected, done.stdout) if expected else done.stdout == ""


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "ball.tml"], "error: ball.tml: no such scene file, nor a shipped scene of that name; "),
        (["run", "ball.toml", "--set", "mesh.radus=3"], "error: ball.toml with mesh.radus=3: mesh.radus: unknown key; did"),
        (["run", "ball.toml", "--set", "mesh"], "error: override 'mesh': expected KEY=VALUE, such as mesh.around=64"),
        (["run", "ball.toml", "--set", "supports.1.group=foot"], "error: ball.toml: supports[1].group: no node group 'foot'"),
        (["check", "ball.toml", "--set", "supports=[]"], "error: ball.toml: supports: the structure is free to move: "),
        (["check", "ball.toml", "--set", "probes.radius.group=rim"], "error: ball.toml: probes.radius.group: no node group"),
        (["render", "nowhere"], "error: nowhere: there is no such folder"),
        (["render", "."], "error: .: not the folder of a run: it has no summary.json"),
    ],
)  # fmt: skip
def test_bad_input_ends_with_2_and_one_line(
    scene: str, runtime_cpu: Runtime, arguments: list[str], expected: str
) -> None:
    done = call(*arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1].startswith(expected)
    assert done.stderr.count("error:") == 1
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("out", "expected"),
    [
        (".", "error: .: the output folder holds 'ball.toml' (1 files in all) but no summary.json of an earlier run; "),
        ("ball.toml", "error: ball.toml: the output folder cannot be read: Not a directory"),
    ],
)
def test_a_bad_output_folder_is_told_before_any_work(scene: str, out: str, expected: str) -> None:
    done = call("run", scene, "--out", out)
    assert done.exit_code == 2
    assert done.stderr.startswith(expected)
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"], ["rum"], ["run", "ball.toml", "--arch", "cuba"], ["run", "ball.toml", "--threads", "0"],
        ["render", ".", "--width", "10"], ["render", ".", "--field", "colour"], ["run", "ball.toml", "--nope"],
    ],
)  # fmt: skip
def test_a_usage_error_ends_with_2(scene: str, arguments: list[str]) -> None:
    done = call(*arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert "Usage:" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["verify", "--only", "hencky", "--out", "ball.toml"], "ball.toml: the output folder cannot be made"),
        (["stress", "--only", "smallest", "--out", "ball.toml"], "ball.toml: the output folder cannot be made"),
        (["stress", "--set", "verdicts", "--only", "tubes", "--out", "ball.toml"], "the output folder cannot be made"),
        (["sweep", "ball.toml", "--vary", "mesh.radius=1,2", "--store", "ball.toml"], "--store ball.toml: the folder"),
        (["sweep", "ball.toml", "--vary", "mesh.radius=1:2:10000000"], "10000000 values; at most 1000000"),
        (["fit", "ball.toml", "--to", "m.csv", "--free", ",", "--probe", "radius"], "--free: no setting to find"),
        (
            ["fit", "ball.toml", "--to", "m.csv", "--free", "fabric.E,fabric.E", "--probe", "radius"],
            "--free: fabric.E named more than once",
        ),
        (["run", ""], "the name of the scene is empty"),
        (["check", " "], "the name of the scene is empty"),
    ],
)
def test_what_cannot_be_is_told_before_any_work(scene: str, arguments: list[str], expected: str) -> None:
    Path("m.csv").write_text("pressure,radius\n1,2\n2,3\n3,4\n", encoding="utf-8")
    done = call(*arguments)
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")
    assert expected in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""


def test_a_run_without_a_terminal_prints_plain_lines_of_80_columns(scene: str, tmp_path: Path) -> None:
    """A process of its own: pictures too, so that whatever Taichi or meshio might print would be seen."""
    done = call_process("run", scene, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for text in (done.stdout, done.stderr):
        assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", text)
        assert max(map(len, text.splitlines())) <= 80
    assert done.stdout.startswith("step  stage ")
    assert "[Taichi]" not in done.stdout
    assert "drawing …" in done.stderr
    names = {path.name for path in (tmp_path / "renders" / "ball").iterdir()}
    assert {"step_0000.png", "step_0001.png", "animation.gif"} <= names
    assert set(json.loads((tmp_path / "renders/ball/summary.json").read_text("utf-8"))["files"]) == names


def test_a_finished_run_is_drawn_again_with_what_is_asked_changed(scene: str, tmp_path: Path) -> None:
    assert call_process("run", scene, "--no-render", "--out", "out", cwd=tmp_path).returncode == 0
    done = call_process("render", "out", "--field", "displacement", "--width", "250", "--no-outline", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "wrote out: step_0000.png … step_0001.png, animation.gif\n"
    picture = (tmp_path / "out" / "step_0000.png").read_bytes()
    size = int.from_bytes(picture[16:20], "big"), int.from_bytes(picture[20:24], "big")
    assert size == (250, 240)  # the height is the scene's


def test_the_camera_is_the_scenes_with_the_given_options_replaced(
    scene: str, runtime_cpu: Runtime, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {}

    def redraw(directory: Path, *, camera: Any, out: Path, observer: Any) -> list[Path]:
        asked.update(camera.model_dump())
        return []

    assert call("run", scene, "--no-render", "--set", "camera.azimuth=11").exit_code == 0
    monkeypatch.setattr(RUN, "redraw", redraw)
    options = ["--elevation", "-5", "--projection", "orthographic", "--height", "199", "--supports", "--no-loads"]
    options += ["--magnify", "4"]
    assert call("render", "renders/ball", *options).exit_code == 0
    assert asked == {
        "field": "state", "azimuth": 11.0, "elevation": -5.0, "projection": "orthographic", "size": (320, 199),
        "outline": True, "loads": False, "supports": True, "directions": True, "magnify": 4.0,
    }  # fmt: skip
    done = call("render", "renders/ball", "--azimuth", "nan")
    assert (done.exit_code, done.stderr) == (2, "error: camera: azimuth: nan must be a finite number\n")


def test_ctrl_c_ends_with_130_and_keeps_the_steps_that_were_done(scene: str, tmp_path: Path) -> None:
    # Far more steps than can be done before the signal; each is written as it ends.
    command = [sys.executable, "-m", "taichi_membrane", "run", scene, "--no-render", "--set", "stages.1.steps=5000"]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin", "HOME": str(tmp_path), "LC_ALL": "C.UTF-8"}
    with subprocess.Popen(
        [*command, "--set", "checks=[]"], cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line.startswith("inflate 3/5000"):
                process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
    kept = re.fullmatch(r"interrupted: (\d+) load steps are kept in renders/ball\n", lines[-1])
    assert kept
    assert not any("Traceback" in line for line in lines)
    folder = tmp_path / "renders" / "ball"
    # A signal between a step's end and its report leaves one step more than was reported.
    assert 3 <= int(kept[1]) <= len(read_run(folder).steps) <= int(kept[1]) + 1
    assert json.loads((folder / "summary.json").read_text("utf-8"))["complete"] is False
    assert not list(folder.glob(".*"))


def test_ctrl_c_before_the_first_step_says_that_nothing_is_kept(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(RUN, "run", interrupted)
    done = call("run", scene)
    assert (done.exit_code, done.stdout, done.stderr) == (130, "", "interrupted: no load step was finished\n")
    monkeypatch.setattr(RUN, "summarise", interrupted)
    done = call("check", scene)
    assert (done.exit_code, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_check_tells_sizes_groups_units_and_features(scene: str) -> None:
    done = call("check", scene, "--set", "mesh.divisions=2")
    assert done.exit_code == 0
    text = " ".join(done.stdout.split())
    for part in (
        "scene ball: Small [bold]ball[/bold] units mm, N, stress and pressure in MPa",
        "mesh sphere: 18 nodes, 32 elements, area ",
        "closed, volume ",
        " mm³ nodes all: 18, ",
        "north: 1",
        "elements all: 32",
        "fabric all: E = 10 MPa, nu = 0.3, thickness 1 mm, wrinkling law tension_field",
        "support south: xyz held north: xy held",
        "pressure inside: follower, on all",
        "stage inflate: 2 steps, pressure inside to 0.002 MPa",
        "probes radius, foot checks 2",
        "compiled in wrinkling (tension field), Green side strain, follower pressure",
        "left out wrinkling (clipped stress), orthotropic fabric",
    ):
        assert part in text
    assert max(map(len, done.stdout.splitlines())) <= 80


def test_a_relative_mesh_path_starts_at_the_scene_file(scene: str, runtime_cpu: Runtime) -> None:
    """The current folder is another one than that of the shipped scene and its mesh."""
    done = call("check", "disc")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "file: " in done.stdout
    brief = ("--set", "solver={kind='relaxation', max_iterations=1, max_cuts=0}")
    assert call("run", "disc", "--no-render", *brief).exit_code == 3


def test_scenes_are_listed_with_their_titles() -> None:
    done = call("scenes")
    assert done.exit_code == 0
    names = [line.split()[0] for line in done.stdout.splitlines()]
    assert names == list(shipped_scenes())
    assert load_scene(shipped_scenes()["cantilever"]).title in done.stdout


def test_schema_is_json_schema_of_a_scene() -> None:
    done = call("schema")
    assert done.exit_code == 0
    schema = json.loads(done.stdout)
    assert schema["title"] == "Scene"
    assert "stages" in schema["required"]


def test_version_is_that_of_the_package() -> None:
    done = call("--version")
    assert (done.exit_code, done.stdout) == (0, f"taichi-membrane {version('taichi-membrane')}\n")


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["check", "ball.toml"], ["scenes"]])
def test_commands_that_run_nothing_do_not_import_taichi_or_matplotlib(
    scene: str, tmp_path: Path, arguments: list[str]
) -> None:
    script = (
        "import sys\nfrom taichi_membrane.commands.cli import app\n"
        f"code = app({arguments!r}, standalone_mode=False)\n"
        "print('loaded:', *({'taichi', 'matplotlib'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == "loaded:\n"
    assert done.stdout


def test_the_schema_names_every_key_of_a_scene() -> None:
    assert set(json.loads(call("schema").stdout)["properties"]) == set(Scene.model_fields)
