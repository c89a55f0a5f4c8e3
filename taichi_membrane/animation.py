"""A run's pictures as one GIF."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from taichi_membrane.errors import InputError

WIDEST = 800  # pixels; a GIF has no interframe compression worth the name
LAST_FRAME_FACTOR = 6  # the last frame is what the reader wants to study


def write_animation(pngs: Sequence[Path], path: Path, *, frame_seconds: float = 0.25) -> None:
    """Write the pictures in order as an endless GIF, atomically, at most 800 pixels wide, the last one shown longer.

    :param frame_seconds: duration of a frame; GIF knows hundredths of a second, at least 0.02.
    :raises InputError: no pictures, pictures of different sizes, a duration out of range, or a file that is no picture.
    """
    if not pngs:
        raise InputError(f"{path}: an animation needs at least one picture")
    if not 0.02 <= frame_seconds <= 60.0:
        raise InputError(f"frame_seconds = {frame_seconds} must lie between 0.02 and 60 seconds")
    frames: list[Image.Image] = []
    first: tuple[int, int] | None = None
    for png in pngs:
        try:
            with Image.open(png) as image:
                picture = image.convert("RGB")
        except OSError as error:
            raise InputError(f"{png}: not a picture that can be read: {error}") from error
        first = first or picture.size
        if picture.size != first:
            sizes = f"{picture.width} x {picture.height} pixels, but {pngs[0]} has {first[0]} x {first[1]}"
            raise InputError(f"{png}: {sizes}; all frames need one size")
        width = min(WIDEST, picture.width)
        picture = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
        frames.append(picture)
    # One palette from all frames: colours must not flicker from frame to frame.
    small = (max(1, frames[0].width // 2), max(1, frames[0].height // 2))
    strip = Image.new("RGB", (small[0], small[1] * len(frames)))
    for number, frame in enumerate(frames):
        strip.paste(frame.resize(small, Image.Resampling.NEAREST), (0, number * small[1]))
    palette = strip.quantize(256, method=Image.Quantize.MEDIANCUT)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1000 * frame_seconds)] * len(frames)
    durations[-1] *= LAST_FRAME_FACTOR
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        indexed[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=indexed[1:],
            duration=durations,
            loop=0,
            optimize=False,
        )
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
