"""Curves: files, determinism, labels that do not collide, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from taichi_membrane.errors import InputError
from taichi_membrane.pictures import plots
from taichi_membrane.pictures.plots import Mark, ReferenceLine, Series, draw_curve

W = np.linspace(0.0, 0.6, 21)
F = 300.0 * np.tanh(W / 0.12)


def _draw(path: Path, **changes: object) -> None:
    what: dict[str, object] = {
        "series": [
            Series(label="computed", x=W, y=F),
            Series(label="theory", x=W[::4], y=0.97 * F[::4], style="reference"),
        ],
        "x_label": "tip deflection [m]",
        "y_label": "tip load [N]",
        "title": "Inflated cantilever, $p$ = 35 kPa",
        "lines": [ReferenceLine(label="collapse load", axis="y", value=306.0)],
        "marks": [Mark(label="first wrinkle", x=float(W[2]), y=float(F[2]))],
    }
    draw_curve(path, **(what | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_same_bytes_twice_and_no_temporary_file(tmp_path: Path, suffix: str) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    _draw(first)
    _draw(second)
    assert first.read_bytes() == second.read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


def test_size_and_colours(tmp_path: Path) -> None:
    _draw(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (round(plots.SIZE[0] * plots.DPI), round(plots.SIZE[1] * plots.DPI))
        pixels = np.asarray(image.convert("RGB"))
    blue = tuple(int(plots.COLOURS[0][k : k + 2], 16) for k in (1, 3, 5))
    assert (pixels == blue).all(axis=2).sum() > 2000  # a curve 5 pixels wide over most of 1400 pixels
    edge = np.concatenate((pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]))
    assert (edge == 255).all()  # nothing is cut off at the edge of the page


def _labels(monkeypatch: pytest.MonkeyPatch, path: Path, **changes: object) -> tuple[list[object], object]:
    """Extents of the labels in the axes, and of the axes."""
    kept: list[plots.Figure] = []
    original = plots._save
    monkeypatch.setattr(plots, "_save", lambda figure, to: (kept.append(figure), original(figure, to)))
    _draw(path, **changes)
    canvas = FigureCanvasAgg(kept[0])
    axes = kept[0].axes[0]
    return [text.get_window_extent(canvas.get_renderer()) for text in axes.texts], axes.get_window_extent()


def test_labels_in_one_place_do_not_overlap(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    marks = [Mark(label=f"mark number {k}", x=0.3, y=290.0 + k) for k in range(4)]
    lines = [ReferenceLine(label=f"load {k}", axis="y", value=300.0 + k) for k in range(3)]
    lines.append(ReferenceLine(label="limit", axis="x", value=0.31))
    extents, frame = _labels(monkeypatch, tmp_path / "a.png", marks=marks, lines=lines)
    assert len(extents) == 8
    for n, one in enumerate(extents):
        assert not any(one.overlaps(other) for other in extents[:n])  # type: ignore[attr-defined]
        assert frame.x0 < one.x0 < one.x1 < frame.x1  # type: ignore[attr-defined]
        assert frame.y0 < one.y0 < one.y1 < frame.y1  # type: ignore[attr-defined]


def test_label_of_a_mark_keeps_off_the_curve(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A straight curve through the mark: the label must lie wholly on one side of it."""
    line = [Series(label="stiff", x=[0.0, 1.0], y=[0.0, 1.0])]
    extents, frame = _labels(
        monkeypatch, tmp_path / "a.png", series=line, lines=(), marks=[Mark(label="middle", x=0.5, y=0.5)]
    )
    box = extents[0]
    slope = frame.height / frame.width  # type: ignore[attr-defined]
    corners = [(x, y) for x in (box.x0, box.x1) for y in (box.y0, box.y1)]  # type: ignore[attr-defined]
    sides = {np.sign((y - frame.y0) - slope * (x - frame.x0)) for x, y in corners}  # type: ignore[attr-defined]
    assert len(sides) == 1


def test_long_names_are_not_cut_off(tmp_path: Path) -> None:
    names = ["a very long name of a series, with its mesh, its law and its tolerance " + str(k) for k in range(3)]
    _draw(tmp_path / "a.png", series=[Series(label=name, x=W, y=F + k) for k, name in enumerate(names)])
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    assert (pixels[:, :4] == 255).all()
    assert (pixels[:, -4:] == 255).all()


@pytest.mark.parametrize(
    "series",
    [
        [Series(label="one point", x=[1.0], y=[2.0])],
        [Series(label="constant", x=[0.0, 1.0], y=[5.0, 5.0])],
        [Series(label="zero", x=[0.0, 0.0], y=[0.0, 0.0])],
        [Series(label="tiny", x=W * 1e-9, y=-F * 1e9)],
        [Series(label="many", x=np.linspace(0, 1, 5000), y=np.sin(np.linspace(0, 50, 5000)))],
    ],
)
def test_unusual_data_are_drawn(tmp_path: Path, series: list[Series]) -> None:
    _draw(tmp_path / "a.png", series=series, lines=(), marks=())
    assert (tmp_path / "a.png").stat().st_size > 5000  # an empty page of this size has less


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"series": []}, "at least one series"),
        ({"series": [Series(label="s", x=[1.0, 2.0], y=[1.0])]}, r"series 's'.*\(2,\) and \(1,\)"),
        ({"series": [Series(label="s", x=[], y=[])]}, "series 's'"),
        ({"series": [Series(label="s", x=[0.0, np.nan], y=[1.0, 2.0])]}, "point 1 is not finite"),
        ({"series": [Series(label="s", x=[0.0], y=[1.0], style="dotted")]}, "computed, reference"),  # type: ignore[arg-type]
        ({"lines": [ReferenceLine(label="l", axis="z", value=1.0)]}, "not one of x, y"),  # type: ignore[arg-type]
        ({"lines": [ReferenceLine(label="l", axis="x", value=np.inf)]}, "line 'l'"),
        ({"marks": [Mark(label="m", x=np.nan, y=1.0)]}, "mark 'm'"),
        ({"title": r"$\frac{1$"}, "typeset"),
        ({"marks": [Mark(label=r"$\frac{1$", x=0.1, y=1.0)]}, "typeset"),
    ],
)
def test_nonsense_is_refused_and_leaves_no_file(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        _draw(tmp_path / "a.png", **changes)
    assert not list(tmp_path.iterdir())


def test_unknown_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.png, \.svg or \.pdf"):
        _draw(tmp_path / "a.jpeg")
