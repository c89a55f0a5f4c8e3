"""The animation: frames, their times, refusals."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from taichi_membrane.errors import InputError
from taichi_membrane.pictures.render import write_animation


def _stills(folder: Path, sizes: list[tuple[int, int]]) -> list[Path]:
    paths = []
    for number, size in enumerate(sizes):
        paths.append(folder / f"{number}.png")
        Image.new("RGB", size, (40 * number, 90, 200)).save(paths[-1])
    return paths


def test_animation_has_all_frames_and_holds_the_last(tmp_path: Path) -> None:
    path = tmp_path / "run.gif"
    write_animation(_stills(tmp_path, [(1000, 500)] * 5), path, frame_seconds=0.2)
    with Image.open(path) as gif:
        assert gif.n_frames == 5  # type: ignore[attr-defined]
        assert gif.size == (800, 400)
        durations = []
        for number in range(5):
            gif.seek(number)
            durations.append(gif.info["duration"])
    assert durations[:4] == [200] * 4
    assert durations[4] > 3 * 200
    assert not list(tmp_path.glob(".*"))


def test_animation_keeps_small_pictures_and_equal_frames(tmp_path: Path) -> None:
    stills = _stills(tmp_path, [(300, 200)])
    write_animation(stills * 3, tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as gif:
        assert gif.size == (300, 200)


@pytest.mark.parametrize(
    ("sizes", "seconds", "message"),
    [
        ([], 0.2, "at least one"),
        ([(9, 9), (9, 8)], 0.2, "9 x 8 pixels, but .* 9 x 9"),
        ([(9, 9)], 0.0, "frame_seconds = 0.0"),
    ],
)
def test_impossible_animation_is_refused(
    tmp_path: Path, sizes: list[tuple[int, int]], seconds: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        write_animation(_stills(tmp_path, sizes), tmp_path / "run.gif", frame_seconds=seconds)
    assert not (tmp_path / "run.gif").exists()


def test_animation_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no picture")
    with pytest.raises(InputError, match=r"a\.png"):
        write_animation([tmp_path / "a.png"], tmp_path / "run.gif")
