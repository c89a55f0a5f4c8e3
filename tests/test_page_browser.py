"""The page of a run in a real Chromium without network: what a reader's hand does changes what the eye sees."""

from __future__ import annotations

import base64
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import chromium
import numpy as np
import pytest
from run_files import DRIVERS, PROVENANCE, SCENE, a_result, a_step, with_fields

from taichi_membrane.names import SLACK, TAUT, WRINKLED
from taichi_membrane.page.document import write_page
from taichi_membrane.page.notebook import show
from taichi_membrane.pictures.colours import CABLE_RAMP
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import Floats, RunResult, StepResult

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.EXECUTABLE is None, reason="Chromium is missing (Debian: chromium)"),
    pytest.mark.xdist_group("browser"),
]
MESH = a_result([a_step(0)], Path()).mesh
MIDDLES = MESH.points[MESH.triangles].mean(axis=1)


def bent(number: int, lift: float) -> StepResult:
    """The panel lifted along its length; left third slack, middle third wrinkled."""
    step = a_step(
        number,
        limit=None,
        modes=None,
        derivatives={},
        drivers=DRIVERS | {"load.pull": 1.0 + number, "load.wind": 0.0, "load.seam": 0.0},
    )
    displacement = np.zeros_like(MESH.points)
    displacement[:, 2] = lift * MESH.points[:, 0] ** 2
    x = MIDDLES[:, 0]
    state = np.select([x < 1.0, x < 2.0], [SLACK, WRINKLED], TAUT).astype(np.int8)
    direction = np.tile((0.0, 1.0, 0.0), (MESH.tri_count, 1))
    probes = dict.fromkeys(SCENE.probes, 0.0) | {"tip": float(number) ** 2}
    return with_fields(
        replace(step, probes=probes), displacement=displacement, state=state, taut_margin=x - 2.0, slack_margin=x - 1.0,
        major_stress=(1.0 + number) * x, major_direction=direction,
    )  # fmt: skip


def a_bent_run() -> RunResult:
    data = SCENE.model_dump(mode="json") | {
        "camera": {"elevation": 60.0, "azimuth": 0.0},
        "curve": {"x": "tip", "y": "load.pull"},
    }
    steps = [bent(number, 0.1 * number) for number in range(3)]
    return replace(a_result(steps, Path()), scene=Scene.model_validate(data), provenance=PROVENANCE)


RUN = a_bent_run()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Browser]:
    started = chromium.Browser(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


@pytest.fixture
def tab(browser: chromium.Browser, tmp_path: Path) -> Iterator[chromium.Browser]:
    """The page, freshly opened; nothing may complain, and nothing but the file is asked for."""
    write_page(RUN, tmp_path / "page.html")
    browser.complaints.clear()
    browser.requests.clear()
    browser.size(1400, 900)
    browser.open(tmp_path / "page.html")
    yield browser
    browser.value("0")  # hear what is left
    assert not browser.complaints
    assert browser.requests == [(tmp_path / "page.html").resolve().as_uri()]


def changed(before: Floats, after: Floats) -> float:
    """Share of pixels that differ visibly."""
    return float((np.abs(before - after).max(axis=2) > 24).mean()) if before.shape == after.shape else 1.0


def like(pixels: Floats, colour: tuple[int, int, int]) -> float:
    """Share of pixels near to a colour's hue, whatever the light."""
    shade = pixels / np.linalg.norm(pixels, axis=2, keepdims=True).clip(1)
    return float((shade @ (np.array(colour) / np.linalg.norm(colour)) > 0.997).mean())


def test_states_are_seen_where_they_are(tab: chromium.Browser) -> None:
    """Slack on the left, wrinkled in the middle: by colour and by place; and no wrinkle lines but where it is wrinkled."""
    pixels = tab.view()
    thirds = np.array_split(pixels[:, (pixels < 200).any(axis=2).any(axis=0)], 3, axis=1)
    orange, red = (242, 153, 41), (107, 18, 56)
    assert like(thirds[1], orange) > 0.2 > 20 * like(thirds[2], orange)
    assert like(thirds[0], red) > 0.2 > 20 * like(thirds[2], red)
    assert tab.value("viewer.marks.lineCount") > 0
    tab.click("#directions")
    assert tab.value("viewer.marks.lineCount") == 0
    assert 0.0 < changed(pixels, tab.view()) < 0.2


def test_cables_have_the_colours_of_their_forces(browser: chromium.Browser, tmp_path: Path) -> None:
    """One of the largest force, and one that goes slack in the last step; the legend tells the range."""
    data = RUN.scene.model_dump(mode="json") | {
        "cables": {
            "tie": {"nodes": ["corner_00", "corner_11"], "EA": 1.0},
            "stay": {"nodes": ["corner_10", "corner_01"], "EA": 1.0},
        }
    }
    steps = tuple(with_fields(one, cable_force=np.array([5.0, 2.0 - number])) for number, one in enumerate(RUN.steps))
    write_page(replace(RUN, scene=Scene.model_validate(data), steps=steps), tmp_path / "page.html")
    browser.complaints.clear()
    browser.open(tmp_path / "page.html")
    assert browser.value("viewer.marks.cables.count") == 2
    ramp = np.rint(255 * CABLE_RAMP).astype(int)
    colours = [[browser.value(f"viewer.marks.cables.colour({step}, {k})") for k in range(2)] for step in range(3)]
    assert colours[2] == [ramp[-1].tolist(), [115, 115, 115]]
    assert colours[1][1] == ramp[0].tolist()
    assert colours[0][1] == ramp[round(0.25 * 255)].tolist()
    told = browser.value("document.querySelector('#legend .cables').textContent")
    assert told == "cables: 1 to 5 N, slack cable"
    assert not browser.complaints


def test_the_slider_moves_the_membrane(tab: chromium.Browser) -> None:
    last = tab.view()
    tab.click("#step", across=0.02)
    assert tab.value("viewer.step") == 0
    first = tab.view()
    assert changed(last, first) > 0.02
    assert tab.value("document.getElementById('step-words').textContent").startswith("step 0: load 1/3, pull = 1")
    assert tab.value("document.querySelector('#steps tr.present').dataset.step") == "0"


def test_the_slider_obeys_the_keyboard(tab: chromium.Browser) -> None:
    tab.value("document.getElementById('step').focus()")
    seen = []
    for key in ("ArrowLeft", "ArrowLeft", "ArrowLeft", "ArrowRight", "End", "Home"):
        tab.key(key)
        seen.append(tab.value("viewer.time"))
    assert seen == [1, 0, 0, 1, 2, 0]


def test_every_field_can_be_shown(tab: chromium.Browser) -> None:
    keys = tab.value("Array.from(document.getElementById('field').options, (one) => one.value)")
    assert len(keys) == 1 + 14 + 8
    pictures = []
    for key in keys:
        tab.choose("field", key)
        pictures.append(tab.view())
        title = tab.value("document.getElementById('field').selectedOptions[0].textContent")
        assert key == "state" or tab.value("document.querySelector('#legend .name').textContent") == title
    assert changed(pictures[0], pictures[1]) > 0.05
    assert changed(pictures[1], pictures[4]) > 0.05


def test_colour_bar_has_its_numbers_and_leads_to_the_extremes(tab: chromium.Browser) -> None:
    tab.choose("field", "major_stress")
    stress = [step.elements.major_stress for step in RUN.steps]
    ticks = tab.value("Array.from(document.querySelectorAll('.ticks span'), (one) => Number(one.textContent))")
    assert ticks == pytest.approx(np.linspace(min(s.min() for s in stress), max(s.max() for s in stress), 5), rel=1e-4)
    tab.choose("span", "step")
    ticks = tab.value("Array.from(document.querySelectorAll('.ticks span'), (one) => Number(one.textContent))")
    assert ticks == pytest.approx(np.linspace(stress[2].min(), stress[2].max(), 5), rel=1e-4)
    tab.click("#legend button:nth-of-type(2)")
    assert tab.value("viewer.picked.element") == int(stress[2].argmax())


def test_a_click_shows_the_numbers_of_an_element_and_a_node(tab: chromium.Browser) -> None:
    tab.click("#view")
    element, node = tab.value("[viewer.picked.element, viewer.picked.node]")
    assert node in MESH.triangles[element]
    # What is in the middle of the view is not far from the middle of the panel.
    assert np.linalg.norm(MIDDLES[element, :2] - MESH.points[:, :2].mean(axis=0)) < 1.0
    rows = dict(
        tab.value(
            "Array.from(document.querySelectorAll('#numbers tr'), (row) => [row.cells[0].textContent, row.cells[1].textContent])"
        )
    )
    stress = RUN.steps[2].elements.major_stress
    assert float(rows["major stress"].split()[0]) == pytest.approx(stress[element], abs=np.ptp(stress) / 6e4)
    assert rows["major stress"].endswith(" MPa")
    assert rows["state"] == ("taut", "wrinkled", "slack")[RUN.steps[2].elements.state[element]]
    lift = RUN.steps[2].displacement[node, 2]
    assert float(rows["displacement, z"].split()[0].replace("−", "-")) == pytest.approx(lift, abs=1e-3)
    tab.click("#view", across=0.02, down=0.5)  # beside the membrane
    assert tab.value("viewer.picked.element") is None


def test_a_number_may_be_typed(tab: chromium.Browser) -> None:
    before = tab.view()
    tab.choose("element", "3")
    assert tab.value("document.querySelector('#numbers caption').textContent") == "Element 3"
    assert changed(before, tab.view()) > 0.0
    tab.choose("element", str(MESH.tri_count))  # there is none
    assert tab.value("document.querySelector('#numbers caption')") is None


def test_curve_and_steps_lead_to_a_step_and_follow_it(tab: chromium.Browser) -> None:
    tab.click("#curve [data-step='1']")
    assert tab.value("viewer.time") == 1

    def place(mark: str) -> list[float]:
        return list(
            tab.value(
                f"(({{cx, cy}}) => [cx.baseVal.value, cy.baseVal.value])(document.querySelector('#curve {mark}'))"
            )
        )

    assert place(".present") == place('[data-step="1"]')
    tab.value("viewer.go(1.5)")
    between = np.mean([place(f'[data-step="{step}"]') for step in (1, 2)], axis=0)
    assert place(".present") == pytest.approx(between)
    tab.click("#steps tbody tr:first-child")
    assert tab.value("viewer.time") == 0
    labels = tab.value("Array.from(document.querySelectorAll('#curve text'), (one) => one.textContent)")
    assert {"tip [mm]", "load pull [N]"} <= set(labels)


def test_play_goes_through_all_times_between(tab: chromium.Browser) -> None:
    tab.click("#play")
    tab.wait("viewer.time > 0 && viewer.time < 2 && viewer.time % 1 !== 0")
    tab.wait("!viewer.playing")
    assert tab.value("viewer.time") == 2
    tab.value("viewer.go(0.5)")
    half, nodes = tab.value("Array.from(viewer.run.positions)"), MESH.node_count
    rest = tab.value("Array.from(viewer.run.rest)")
    moved = (np.array(half) - rest).reshape(nodes, 3)
    expected = 0.5 * (RUN.steps[0].displacement + RUN.steps[1].displacement)
    assert moved == pytest.approx(expected, abs=1e-4)


def test_keys_turn_the_view(tab: chromium.Browser) -> None:
    tab.value("document.getElementById('view').focus()")
    before = tab.view()
    tab.key("ArrowRight")
    turned = tab.view()
    assert changed(before, turned) > 0.0
    tab.key("Home")
    assert changed(before, tab.view()) == 0.0


def test_displacements_can_be_exaggerated(tab: chromium.Browser) -> None:
    tab.choose("exaggeration", "10")
    moved = np.array(tab.value("Array.from(viewer.run.positions)")) - tab.value("Array.from(viewer.run.rest)")
    assert moved.reshape(-1, 3) == pytest.approx(10 * RUN.steps[2].displacement, abs=1e-2)


def test_loads_and_supports_can_be_hidden(tab: chromium.Browser) -> None:
    labels = "Array.from(document.querySelectorAll('#over .load'), (one) => one.textContent)"
    assert tab.value(labels) == ["pull 3 N"]
    for box in ("loads", "supports"):
        before = tab.view()
        tab.click(f"#{box}")
        assert changed(before, tab.view()) > 0.0
    assert tab.value(labels) == []


def test_it_can_be_printed(tab: chromium.Browser) -> None:
    pdf = base64.b64decode(tab.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])
    assert pdf.startswith(b"%PDF")
    assert 1 <= pdf.count(b"/Type /Page\n") + pdf.count(b"/Type/Page/") <= 4


def test_a_narrow_window_is_enough(tab: chromium.Browser) -> None:
    tab.size(420, 800)
    assert tab.value("document.documentElement.scrollWidth") <= 420


def open_notebook(browser: chromium.Browser, folder: Path, frame: str) -> None:
    """A page that does no more than hold the frame of a run."""
    (folder / "notebook.html").write_text(f"<!doctype html><body>{frame}", encoding="utf-8")
    browser.complaints.clear()
    browser.size(1400, 900)
    browser.call("Page.navigate", url=(folder / "notebook.html").as_uri())
    browser.wait("location.pathname.endsWith('notebook.html') && document.readyState === 'complete'")


def the_wrinkled_third_appears(browser: chromium.Browser) -> None:
    until = time.monotonic() + 60.0
    while (share := like(np.asarray(browser.picture(), dtype=int)[350:, :900], (242, 153, 41))) < 0.01:
        assert time.monotonic() < until, f"{share:.2%} of the picture is orange"
        time.sleep(0.2)
    assert not browser.complaints


def test_it_works_in_the_sandbox_of_a_notebook(browser: chromium.Browser, tmp_path: Path) -> None:
    open_notebook(browser, tmp_path, show(RUN)._repr_html_())
    the_wrinkled_third_appears(browser)


def test_it_works_in_a_frame_that_is_shown_after_its_run_has_been_read(
    browser: chromium.Browser, tmp_path: Path
) -> None:
    """Frames have no size in a folded cell, nor (at times) in the first moments of their life."""
    frame = show(RUN)._repr_html_().replace('sandbox="allow-scripts" ', "")  # so that its state can be asked for
    open_notebook(browser, tmp_path, f'<div id="cell" style="display: none">{frame}</div>')
    browser.wait("frames[0].document.body?.dataset.ready === 'yes'")
    assert browser.value("frames[0].innerWidth") == 0
    browser.value("document.getElementById('cell').style.display = 'block'")
    the_wrinkled_third_appears(browser)
