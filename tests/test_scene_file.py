"""Scene files: overrides, and one clear message for each kind of mistake."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.scene import file as scene_file
from taichi_membrane.scene.file import load_scene, resolve_scene, shipped_scenes

SCENE = """
name = "strip"
units = { length = "mm", force = "N" }
mesh = { shape = "panel", width = 10.0, height = 5.0, along_x = 4, along_y = 2 }
fabric = { E = 100.0, nu = 0.3, thickness = 0.5 }

[[supports]]
group = "x_min"
hold = "xyz"

[loads.pull]
group = "x_max"
direction = [1.0, 0.0, 0.0]

[[stages]]
name = "stretch"
steps = 2
loads = { pull = 3.0 }

[[stages]]
name = "inflate"
pressure = 0.1

[probes.tip]
kind = "displacement"
group = "x_max"
component = "x"

[[checks]]
probe = "tip"
stage = "stretch"
reference = 1.0
tolerance = 0.1
source = "bar"
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A good scene file."""
    file = tmp_path / "strip.toml"
    file.write_text(SCENE, encoding="utf-8")
    return file


def message(path: Path, *overrides: str) -> str:
    """The one message of a scene that is refused."""
    with pytest.raises(InputError) as caught:
        load_scene(path, overrides)
    text = str(caught.value)
    assert "\n" not in text
    for noise in ("pydantic", "https://", "Value error", "validation error", "input_value"):
        assert noise not in text
    return text


def test_a_good_file_is_the_scene_it_says(path: Path) -> None:
    scene = load_scene(path)
    assert (scene.name, scene.mesh.shape, scene.stages[0].loads) == ("strip", "panel", {"pull": 3.0})


def test_overrides_reach_tables_lists_by_name_and_by_number_and_make_missing_tables(path: Path) -> None:
    scene = load_scene(
        path,
        [
            "mesh.along_x=8",
            "fabric.law=clip",  # not a TOML value: a text
            "stages.stretch.steps=5",
            "stages.2.pressure=-0.25",
            "checks[1].reference=2.5",
            "solver.tolerance=1e-8",
            "camera.size=[640, 480]",
            "camera.size.2=400",
            "title='a=b'",
        ],
    )
    assert scene.mesh.model_dump()["along_x"] == 8
    assert scene.fabric is not None
    assert scene.fabric.law == "clip"
    assert scene.stages[0].steps == 5
    assert scene.stages[1].pressure == -0.25
    assert scene.checks[0].reference == 2.5
    assert scene.solver.tolerance == 1e-8
    assert scene.camera.size == (640, 400)
    assert scene.title == "a=b"


def test_a_mesh_with_a_path_is_a_file_without_its_shape(path: Path) -> None:
    named = load_scene(path, ["mesh={path='sheet.obj', scale=2.0}"]).mesh
    assert named == load_scene(path, ["mesh={shape='file', path='sheet.obj', scale=2.0}"]).mesh
    assert (named.shape, named.scale) == ("file", 2.0)
    with pytest.raises(InputError, match=r"mesh.size: unknown key"):
        load_scene(path, ["mesh={path='sheet.obj', size=2.0}"])


def test_a_later_override_wins_and_a_line_break_smuggles_nothing_in(path: Path) -> None:
    scene = load_scene(path, ["title=one", 'title="two"\nname = "other"'])
    assert scene.name == "strip"
    assert scene.title == '"two"\nname = "other"'


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("fabric.thicknes=1", "fabric.thicknes: unknown key; did you mean 'thickness'? allowed: preset, E, "),
        ("mesh.shape=tueb", "mesh.shape: 'tueb' is unknown; did you mean 'tube'? allowed: tube, arch, cushion, panel,"),
        ("mesh={width=1}", "mesh.shape: missing; allowed: tube, arch, cushion, panel, sphere, disc, annulus, wedge, arch_tent,"),
        ("mesh.width=-3", "mesh.width: -3 must be above 0"),
        ("mesh.along_x=2.5", "mesh.along_x: must be a whole number, not 2.5"),
        ("mesh.radius=1", "mesh.radius: unknown key; allowed: shape, width, height, along_x, along_y, pattern"),
        ("mesh=3", "mesh: must be a table, not 3"),
        ("fabric.E=nan", "fabric.E: nan must be a finite number"),
        ("fabric.E=true", None),
        ("fabric.G=1", "fabric: E makes an isotropic fabric; leave out G, or leave out E"),
        ("fabric.warp=[1, 2]", "fabric.warp[3]: missing"),
        ("fabric.warp=[1, 2, 3, 4]", "fabric.warp: 4 items, but at most 3 are allowed"),
        ("fabric.warp=[0, 0, 0]", "fabric.warp: a direction needs a length above zero"),
        ("units.length=km", "units.length: 'km' is unknown; did you mean 'm'? allowed: mm, cm, m, in, ft"),
        ("stages=[]", "stages: 0 items, but at least 1 are needed"),
        ("stages.stretch.steps=0", "stages.stretch.steps: 0 must be at least 1"),
        ("stages.stretch.pressure=high", "stages.stretch.pressure: must be a number, not 'high'"),
        ("stages.2.pressure={inside='x'}", "stages.inflate.pressure.inside: must be a number, not 'x'"),
        ("stages.2.pressure={outside=1}", "stages.inflate.pressure: 'outside' is not a pressure of this scene; allowed: inside"),
        ("stages.stretch.name='a b'", "stages[1].name: 'a b' does not match the pattern"),
        ("supports.1.hold=xq", "supports[1].hold: 'xq' does not match the pattern ^[xyz]{1,3}$"),
        ("supports.1.hold=xx", "supports[1].hold: a component is named twice in 'xx'"),
        ("loads.pull.grup=end", "loads.pull.grup: unknown key; did you mean 'group'? allowed: kind, group, direction, spread"),
        ("loads.pull.kind=point", "loads.pull.kind: 'point' is unknown; allowed: total, line, area"),
        ("probes.tip.kind=displacment", "probes.tip.kind: 'displacment' is unknown; did you mean 'displacement'?"),
        ("probes.tip.component=w", "probes.tip.component: 'w' is unknown; allowed: x, y, z, magnitude"),
        ("probes.tip={group='x_max'}", "probes.tip.kind: missing; allowed: displacement, position, reaction, moment, rotation,"),
        ("checks.1.probe=tap", "checks[1].probe: 'tap' is not a probe of this scene; allowed: tip"),
        ("checks.1.step=3", "checks[1].step = 3, but stage 'stretch' has 2 steps"),
        ("checks.1.absolute=1", "checks[1]: give either tolerance (relative) or absolute"),
        ("checks=[{probe='tip'}]", "checks[1].stage: missing; checks[1].source: missing"),
        ("camera.outline=maybe", "camera.outline: must be true or false, not 'maybe'"),
        ("camera.elevation=91", "camera.elevation: 91 must be at most 90"),
        ("supports={a=1}", "supports: must be a list, not a table"),
        ("title=[1]", "title: must be a text, not a list"),
        (f"units.force={'x' * 500}", f"units.force: '{'x' * 59}… is unknown; allowed: N, kN, MN, lbf"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_key_and_what_is_allowed(path: Path, override: str, expected: str | None) -> None:
    if expected is None:  # true is 1 to pydantic; accepted, and listed here so that a change is noticed
        assert load_scene(path, [override])
        return
    assert message(path, override).startswith(f"{path} with {override}: {expected}")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("mesh.along_x", "override 'mesh.along_x': expected KEY=VALUE, such as mesh.around=64"),
        ("=3", "override '=3': expected KEY=VALUE"),
        ("mesh..x=3", "override 'mesh..x=3': expected KEY=VALUE"),
        ("mesh.width.x=3", "mesh.width is 10.0, neither a table nor a list"),
        ("stages.3.steps=1", "stages has no item '3'; allowed: 1 to 2, stretch, inflate"),
        ("stages.0.steps=1", "stages has no item '0'; allowed: 1 to 2, stretch, inflate"),
        ("stages.strech.steps=1", "stages has no item 'strech'; allowed: 1 to 2, stretch, inflate"),
        ("stages.²=1", "stages has no item '²'"),
        ("camera.size[1]=1", "camera.size: must be a list, not a table"),
    ],
)
def test_an_override_that_leads_nowhere_is_refused(path: Path, override: str, expected: str) -> None:
    assert expected in message(path, override)


def test_a_misspelt_key_is_told_before_the_key_it_leaves_missing(path: Path) -> None:
    path.write_text(SCENE.replace("thickness", "thicknes").replace("nu = 0.3", "nu = 'a'"), encoding="utf-8")
    assert message(path).startswith(f"{path}: fabric.thicknes: unknown key; did you mean 'thickness'?")
    # The missing thickness is the same mistake, so only nu is left to be told.
    assert message(path).endswith("; fabric.nu: must be a number, not 'a'")


def test_of_a_great_many_mistakes_the_first_ones_are_told_and_the_others_counted(path: Path) -> None:
    keys = ", ".join(f"k{number} = {{ kind = 'x' }}" for number in range(30))
    said = message(path, f"probes={{ {keys} }}")
    assert said.count("'x' is unknown") >= 7  # of eight, one of which may fall where the message is shortened
    assert said.endswith("(and 22 more)")


def test_the_file_is_blamed_for_its_own_mistakes_even_with_overrides(path: Path) -> None:
    path.write_text(SCENE.replace('hold = "xyz"', 'hold = "xyq"'), encoding="utf-8")
    assert message(path, "mesh.along_x=3").startswith(f"{path}: supports[1].hold")


def test_a_scene_without_fabric_is_refused_with_the_key(path: Path) -> None:
    path.write_text(re.sub("fabric = .*", "", SCENE), encoding="utf-8")
    assert message(path) == f"{path}: fabric: a scene needs [fabric], or [fabrics.GROUP] for each element group"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"name = 'a'\nunits = [\n", "not valid TOML: Invalid value (at end of document)"),
        (b"name = 'a'\nx == 3\n", "not valid TOML: Invalid value (at line 2, column 4)"),
        (b"name = 'a'\nname = 'b'\n", "not valid TOML: Cannot overwrite a value (at line 2, column 11)"),
        (b"name = 'a'\ntitle = '\xff'\n", "line 2 is not UTF-8 text: byte 0xff at offset 20"),
        (b"x = " + b"[" * 5000, "nested too deeply"),
        (b"#" * (scene_file.LARGEST_FILE + 1), "1000001 bytes are too many for a scene; 1000000 at most"),
        (b"", "name: missing; units: missing; mesh: missing; stages: missing"),
    ],
)
def test_a_file_that_is_no_toml_is_refused(tmp_path: Path, content: bytes, expected: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    assert message(file).startswith(f"{file}: ")
    assert expected in message(file)


def test_a_byte_order_mark_is_no_mistake(path: Path) -> None:
    path.write_bytes(b"\xef\xbb\xbf" + SCENE.encode())
    assert load_scene(path).name == "strip"


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert message(tmp_path / "none.toml") == f"{tmp_path / 'none.toml'}: there is no such scene file"
    assert message(tmp_path) == f"{tmp_path}: a scene file is needed, this is a folder"


def test_every_shipped_scene_loads_and_is_named_as_its_file() -> None:
    shipped = shipped_scenes()
    assert "cantilever" in shipped
    for name, file in shipped.items():
        scene = load_scene(file)
        assert scene.name == name
        assert scene.title


def test_a_scene_is_found_by_path_and_by_shipped_name(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(path.parent)
    assert resolve_scene("strip.toml") == Path("strip.toml")
    (path.parent / "cantilever").mkdir()  # a folder of that name, such as an earlier run's, does not hide the scene
    assert resolve_scene("cantilever") == shipped_scenes()["cantilever"]
    with pytest.raises(InputError, match=r"^cantilver: no such scene file, .* did you mean 'cantilever'"):
        resolve_scene("cantilver")
    (path.parent / "folder").mkdir()
    with pytest.raises(InputError, match=r"^folder: a scene file is needed, this is a folder$"):
        resolve_scene("folder")
