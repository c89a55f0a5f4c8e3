"""The page of a run: numbers that decode back, its size, text that stays text, the bundle and its source, the commands."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from run_files import MESH, PROVENANCE, SCENE, a_result, a_run, a_step, a_writer, with_fields
from typer.testing import CliRunner

from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.page.document import page, write_page
from taichi_membrane.page.fields import ELEMENT_FIELDS
from taichi_membrane.page.notebook import show
from taichi_membrane.page.pack import Pack
from taichi_membrane.scene import Scene
from taichi_membrane.shapes import tube
from taichi_membrane.simulation.results import RunResult

ROOT = Path(__file__).resolve().parent.parent
PAGE, VIEWER = ROOT / "taichi_membrane" / "page", ROOT / "viewer"
TYPES = {"u8": np.uint8, "u16": np.uint16, "i16": np.int16, "u32": np.uint32, "f32": np.float32}


class Reader(HTMLParser):
    """Scripts by their id, all element names, attributes, and the text outside of scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: dict[str, str] = {}
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self._open: tuple[str, str] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag in ("script", "style"):
            self._open = (tag, dict(attrs).get("id") or tag)

    def handle_endtag(self, tag: str) -> None:
        if self._open is not None and tag == self._open[0]:
            self._open = None

    def handle_data(self, data: str) -> None:
        if self._open is None:
            self.text += data
        else:
            self.scripts[self._open[1]] = self.scripts.get(self._open[1], "") + data


def decode(block: bytes, entry: dict[str, Any]) -> np.ndarray:
    """An array of the block, by docs/page.md: planes of bytes, sums of differences."""
    width = np.dtype(TYPES[entry["kind"]]).itemsize
    planes = (
        np.frombuffer(block, np.uint8, width * entry["count"], entry["offset"]).reshape(width, -1).astype(np.uint64)
    )
    differences = sum(plane << np.uint64(8 * number) for number, plane in enumerate(planes))
    whole = np.cumsum(differences, dtype=np.uint64).astype(f"<u{width}")
    return whole.view(TYPES[entry["kind"]])


def content(result: RunResult) -> tuple[dict[str, Any], bytes]:
    scripts = Reader(page(result)).scripts
    return json.loads(scripts["head"]), zlib.decompress(base64.b64decode(scripts["data"]))


def run_of(*numbers: int, **changes: Any) -> RunResult:
    return replace(a_result([a_step(number) for number in numbers], Path("runs")), provenance=PROVENANCE, **changes)


@pytest.mark.parametrize("kind", list(TYPES))
def test_an_array_comes_back_bit_for_bit(kind: Any) -> None:
    rng = np.random.default_rng(7)
    pack = Pack()
    values = [rng.integers(0, 256, 8 * n, dtype=np.uint8).view(TYPES[kind])[:n] for n in (1, 33, 0, 4)]
    if kind == "f32":
        values = [np.array([0.0, -0.0, 1e-45, -3.4e38, 1 / 3], np.float32)]
    entries = [pack.add(array, kind) for array in values]
    block = zlib.decompress(base64.b64decode(pack.text()))
    for array, entry in zip(values, entries, strict=True):
        assert decode(block, entry).tobytes() == array.tobytes()


def test_every_number_decodes_within_half_a_level() -> None:
    result = run_of(0, 1, 2)
    head, block = content(result)
    centre = np.array(head["centre"])
    points = decode(block, head["points"]).reshape(3, -1).T + centre
    assert np.abs(points - MESH.points).max() <= 1e-7 * head["radius"]
    assert (decode(block, head["triangles"]).reshape(-1, 3) == MESH.triangles).all()
    for number, step in enumerate(result.steps):
        stored = head["steps"][number]
        assert (decode(block, stored["state"]) == step.elements.state).all()
        for field, known in zip(head["fields"], ELEMENT_FIELDS, strict=True):
            level = (field["high"] - field["low"]) / 65534
            found = field["low"] + level * decode(block, stored["fields"][field["name"]]).astype(float)
            assert np.abs(found - known.read(step)).max() <= 0.5001 * level
            least, most = stored["extremes"][field["name"]]
            assert (least, most) == (known.read(step).argmin(), known.read(step).argmax())
        for vector, values in zip(head["vectors"], (step.displacement, step.reaction), strict=True):
            entry = stored["vectors"][vector["name"]]
            found = entry["scale"] * decode(block, entry["codes"]).reshape(3, -1).T.astype(float)
            kept = values if vector["nodes"] is None else values[decode(block, vector["nodes"])]
            assert np.abs(found - kept).max() <= 0.5001 * entry["scale"]
            assert entry["scale"] == pytest.approx(np.abs(values).max() / 32767)


def test_only_held_nodes_keep_a_support_force() -> None:
    held = np.array([1, 4])
    reaction = np.zeros((MESH.node_count, 3))
    reaction[held] = (1.0, -2.0, 3.0)
    result = a_result([with_fields(a_step(0), reaction=reaction)], Path("runs"))
    head, block = content(result)
    assert decode(block, head["vectors"][1]["nodes"]).tolist() == held.tolist()


def test_what_is_not_finite_has_a_code_of_its_own() -> None:
    stress = a_step(0).elements.major_stress.copy()
    stress[3] = np.nan
    broken = with_fields(a_step(0, converged=False), major_stress=stress)
    head, block = content(a_result([broken], Path("runs")))
    codes = decode(block, head["steps"][0]["fields"]["major_stress"])
    assert np.flatnonzero(codes == 65535).tolist() == [3]
    assert {one["name"]: one["high"] for one in head["fields"]}["major_stress"] == np.nanmax(stress)


def test_wrinkle_directions_are_angles_from_the_first_side() -> None:
    """A flat element, not moved: the direction at 30 degrees from its first side, either way round."""
    step = a_step(0)
    corners = MESH.points[MESH.triangles]
    side = corners[:, 1] - corners[:, 0]
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, corners[:, 2] - corners[:, 0])
    across = np.cross(up / np.linalg.norm(up, axis=1)[:, None], side)
    direction = np.cos(np.pi / 6) * side + np.sin(np.pi / 6) * across
    direction[::2] *= -1.0
    still = with_fields(
        step,
        displacement=np.zeros_like(step.displacement),
        state=np.ones(MESH.tri_count, np.int8),
        major_direction=direction,
    )
    head, block = content(a_result([still], Path("runs")))
    assert set(decode(block, head["steps"][0]["direction"]).tolist()) == {round(256 / 6)}


def test_a_margin_keeps_its_sign_however_small() -> None:
    margin = np.full(MESH.tri_count, 1.0)
    margin[MESH.triangles.max(axis=1) == MESH.node_count - 1] = -1e-9  # all elements at the last node
    others = (MESH.triangles != MESH.node_count - 1).all(axis=1)
    assert others.any()
    step = with_fields(a_step(0), taut_margin=margin)
    head, block = content(a_result([step], Path("runs")))
    assert decode(block, head["steps"][0]["taut_margin"])[-1] < 0


def large_run() -> RunResult:
    """20 steps of 20 000 triangles with smooth fields and the unevenness of a mesh in the fourth digit."""
    mesh = tube(radius=25.0, length=400.0, around=50, along=200)
    rng = np.random.default_rng(0)
    middles = mesh.points[mesh.triangles].mean(axis=1)
    shape = np.stack([np.sin(middles @ rng.normal(size=3) / 60.0) for _ in range(9)], axis=1)
    steps = []
    for number in range(20):
        fields = (1.0 + 0.1 * number) * shape * (1.0 + 1e-4 * rng.normal(size=shape.shape))
        wave = np.sin(mesh.points[:, 0] / 50.0)
        elements = {
            "strain": fields[:, :3], "stress": fields[:, 3:6], "state": (fields[:, 6] > 0.5).astype(np.int8),
            "fold_strain": fields[:, 6], "taut_margin": fields[:, 6], "slack_margin": fields[:, 7], "major_stress": fields[:, 7],
            "minor_stress": fields[:, 8], "major_direction": rng.normal(size=(mesh.tri_count, 3)),
        }  # fmt: skip
        displacement = wave[:, None] * rng.normal(size=3) + 1e-4 * rng.normal(size=mesh.points.shape)
        reaction = np.where(mesh.points[:, :1] == 0.0, 1.0, 0.0) * displacement
        steps.append(
            with_fields(
                a_step(number, modes=None, derivatives={}), displacement=displacement, reaction=reaction, **elements
            )
        )
    scene = Scene.model_validate(
        SCENE.model_dump(mode="json")
        | {"supports": [{"group": "start", "hold": "xyz"}], "loads": {}, "probes": {}, "curve": None}
        | {"stages": [{"name": "load", "steps": 20, "pressure": 1.0}]}
    )
    bare = [
        replace(step, drivers={"pressure.inside": step.pressures["inside"]}, probes={}, derivatives={})
        for step in steps
    ]
    return RunResult(
        scene=scene, mesh=mesh, steps=tuple(bare), checks=(), seconds={}, provenance=PROVENANCE, outcome="finished"
    )


def test_twenty_steps_of_twenty_thousand_triangles_fit_in_ten_megabytes(tmp_path: Path) -> None:
    result = large_run()
    assert result.mesh.tri_count >= 20_000
    assert write_page(result, tmp_path / "page.html") == (tmp_path / "page.html").stat().st_size < 10_000_000


EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"' <!--"


def test_names_stay_text() -> None:
    """Scene, groups, sources, reasons and versions may hold anything; none of it becomes an element or ends a script."""
    scene = SCENE.model_copy(update={"title": EVIL, "description": EVIL})
    mesh = replace(MESH, node_groups={**MESH.node_groups, EVIL: np.array([0, 1], np.int32)})
    plain = run_of(0, 1, 2)
    checks = tuple(replace(check, source=EVIL) for check in plain.checks)
    steps = (*plain.steps[:2], replace(plain.steps[2], converged=False, reason=EVIL, solver=EVIL))
    evil = replace(
        plain, scene=scene, mesh=mesh, checks=checks, steps=steps, provenance={EVIL: EVIL}, seconds={EVIL: 1.0}
    )
    read, before = Reader(page(evil)), Reader(page(plain))
    assert read.text.count("alert(2)") >= 7
    assert read.tags.count("script") == before.tags.count("script") == 3
    assert "img" not in read.tags
    assert not [name for name, _ in read.attributes if name.startswith("on")]
    assert json.loads(read.scripts["head"])["node_groups"][-1]["name"] == EVIL
    assert read.scripts["script"] == before.scripts["script"]


def test_the_policy_names_what_may_run_and_lets_nothing_out() -> None:
    read = Reader(page(run_of(0)))
    policy = next(value for _, value in read.attributes if value and value.startswith("default-src"))
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    digest = base64.b64encode(hashlib.sha256(read.scripts["script"].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}';" in policy
    assert not [value for name, value in read.attributes if name in ("src", "href")]


def test_labels_and_language_are_there() -> None:
    """Every control has a label or text of its own, and pictures say what they show."""
    text = page(run_of(0))
    read = Reader(text)
    assert ("lang", "en") in read.attributes
    for control in re.findall(r'<(?:input|select)[^>]*id="([\w-]+)"', text):
        assert re.search(rf'<label[^>]*>(?:(?!</label>).)*id="{control}"', text, re.DOTALL), control
    assert len(re.findall(r'<(?:canvas|svg)[^>]*(?:aria-label="[^"]+"|aria-hidden="true")', text)) == 3
    assert re.search(r'<button[^>]*id="play"[^>]*>\w+', text)


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        ("finished", "Finished:"),
        ("collapse", "Collapse:"),
        ("not converged", "Not converged:"),
        ("interrupted", "Interrupted:"),
    ],
)
def test_the_verdict_comes_first(outcome: Any, words: str) -> None:
    steps = (a_step(0), a_step(1, converged=False, reason="residual stalls at 3e-2", limit=None))
    text = Reader(page(replace(run_of(0), steps=steps, outcome=outcome))).text
    assert text.index(words) < text.index("Step 1 (load 2): residual stalls at 3e-2") < text.index("Load steps")
    assert "0 of 1 checks hold; failing: tip at load 3" in text


def test_support_forces_are_summed_by_group() -> None:
    result = run_of(2)
    text = Reader(page(result)).text
    total = result.steps[0].reaction[MESH.node_groups["x_min"]].sum(axis=0)
    for value in total:
        assert f"{value:.5g}" in text


def test_a_state_that_is_no_equilibrium_gives_no_result() -> None:
    far = with_fields(a_step(1, converged=False, limit=None), displacement=1e6 * a_step(1).displacement)
    text = Reader(page(replace(run_of(0), steps=(a_step(0), far)))).text
    facts = text[text.index("largest displacement") : text.index("largest resultant")]
    assert "step 0" in facts


def test_bundle_is_made_of_its_source() -> None:
    """``npm ci --ignore-scripts && npm run build`` in viewer/ mends this one."""
    bundle = (PAGE / "viewer.js").read_text(encoding="utf-8")
    seal, _, code = bundle.partition("\n")
    found = re.fullmatch(r"/\* sources ([0-9a-f]{64}) code ([0-9a-f]{64}) \*/", seal)
    assert found is not None
    names = sorted(path.name for path in (VIEWER / "src").iterdir())
    sources = [VIEWER / "src" / name for name in names] + [
        VIEWER / name for name in ("build.mjs", "package.json", "package-lock.json")
    ]
    assert hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest() == found[1], "source has changed"
    assert hashlib.sha256(code.encode()).hexdigest() == found[2], "bundle has been changed by hand"
    assert "</script" not in code
    assert "<!--" not in code


@pytest.mark.skipif(
    shutil.which("node") is None or not (VIEWER / "node_modules" / "esbuild").is_dir(),
    reason="node or esbuild is missing",
)
def test_building_again_gives_the_same_bundle(tmp_path: Path) -> None:
    copy = tmp_path / "viewer"
    shutil.copytree(VIEWER, copy, symlinks=True)
    (tmp_path / "taichi_membrane" / "page").mkdir(parents=True)
    subprocess.run(["node", "build.mjs"], cwd=copy, check=True)
    for name in ("viewer.js", "THREE-LICENSE"):
        assert (tmp_path / "taichi_membrane" / "page" / name).read_bytes() == (PAGE / name).read_bytes()


def test_three_s_notice_is_on_the_page() -> None:
    assert "three.js authors" in Reader(page(run_of(0))).text


def call(*arguments: str) -> Any:
    return CliRunner().invoke(app, arguments, catch_exceptions=False)


def test_the_command_writes_the_page_of_a_run(tmp_path: Path) -> None:
    a_run(tmp_path / "run", [a_step(0), a_step(1), a_step(2)])
    answer = call("report", str(tmp_path / "run"))
    assert answer.exit_code == 0
    assert re.fullmatch(
        r"wrote \S*report\.html \(\d+\.\d MB\)\n", answer.stdout.replace("\n", "", answer.stdout.count("\n") - 1)
    )
    assert "Finished:" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_a_run_that_was_stopped_is_shown_as_such(tmp_path: Path) -> None:
    writer = a_writer(tmp_path / "run")
    writer.write_step(a_step(0), {})
    assert call("report", str(tmp_path / "run")).exit_code == 0
    assert "Interrupted:" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_what_is_no_run_or_has_no_steps_is_told(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    a_writer(tmp_path / "empty")
    for name, words in {
        "missing": "there is no such folder",
        "other": "not the folder of a run: it has no summary.json",
        "empty": "this run has no load steps to show",
    }.items():
        answer = call("report", str(tmp_path / name))
        assert answer.exit_code == 2
        assert answer.stderr == f"error: {tmp_path / name}: {words}\n"
        assert not (tmp_path / name / "report.html").exists()


def test_a_new_run_removes_the_page_of_the_one_before(tmp_path: Path) -> None:
    a_run(tmp_path, [a_step(0)])
    call("report", str(tmp_path))
    a_writer(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_a_page_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no folder"):
        write_page(run_of(0), tmp_path / "nowhere" / "page.html")


def test_a_notebook_gets_the_page_in_a_sandbox_of_bounded_size() -> None:
    result = run_of(0)
    shown = Reader(show(result, height=500)._repr_html_())
    assert shown.tags == ["iframe"]
    attributes = dict(shown.attributes)
    assert attributes["sandbox"] == "allow-scripts"
    assert attributes["srcdoc"] == page(result)
    assert "height: 500px" in (attributes["style"] or "")
    assert len(repr(show(result))) < 80
    with pytest.raises(InputError, match=r"show: the page has 0\.\d MB, above limit = 0\.01"):
        show(result, limit=0.01)
