"""A run's pictures as one GIF."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from taichi_membrane.errors import InputError
from taichi_membrane.output.atomic import replacing

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
    palette = _palette(frames)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1000 * frame_seconds)] * len(frames)
    durations[-1] *= LAST_FRAME_FACTOR
    with replacing(path) as temporary:
        indexed[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=indexed[1:],
            duration=durations,
            loop=0,
            optimize=False,
        )


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """256 colours for all frames, lest colours flicker; by the root of their frequency, lest lines and arrows lose theirs."""
    counted: Counter[int] = Counter()
    for frame in frames:
        red, green, blue = np.asarray(frame)[::2, ::2].reshape(-1, 3).astype(np.int64).T
        colours, counts = np.unique(red << 16 | green << 8 | blue, return_counts=True)
        counted.update(dict(zip(colours.tolist(), counts.tolist(), strict=True)))
    colours = np.array(sorted(counted))
    repeated = np.repeat(colours, [max(1, round(counted[colour] ** 0.5)) for colour in colours.tolist()])
    strip = np.stack((repeated >> 16, repeated >> 8 & 255, repeated & 255), axis=-1).astype(np.uint8)
    palette = Image.fromarray(strip[None]).quantize(256, method=Image.Quantize.MEDIANCUT)
    entries = np.array(palette.getpalette(), np.uint8).reshape(-1, 3)
    entries[entries.min(axis=1) > 244] = 255  # the page stays white: Pillow looks colours up in boxes of 4 levels
    palette.putpalette(entries.tobytes())
    return palette
