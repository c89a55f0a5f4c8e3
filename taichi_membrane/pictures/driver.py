"""Finds out before a run whether the graphics driver draws right."""

from __future__ import annotations

import numpy as np

from taichi_membrane.device import runtime
from taichi_membrane.errors import InputError
from taichi_membrane.pictures.raster import Raster

# Legs of right-angled triangles, in samples: loops of many lengths run side by side.
LEGS = np.array([2, 5, 9, 14, 20, 27, 3, 33])


def check_driver() -> None:
    """Draw a test picture whose number of covered samples is known.

    :raises InputError: samples are missing. Vulkan in Mesa 22.3.6 (Debian 12) loses atomic operations in loops whose length
        varies, without a word.
    """
    left = np.array([2.5, 10.5, 20.5, 34.5, 54.5, 80.5, 110.5, 2.5])
    low = np.full(len(LEGS), 2.5)
    low[-1] = 45.5  # the largest one is below the row of the others
    corners = [(left, low), (left + LEGS, low), (left, low + LEGS)]
    screen = np.stack([np.column_stack((x, y, np.full(len(LEGS), 0.5))) for x, y in corners], axis=1)
    triangles = np.arange(3 * len(LEGS), dtype=np.int32).reshape(-1, 3)
    found = int(Raster((64, 48)).cover(screen.reshape(-1, 3).astype(np.float32), triangles).sum())
    # Sides run through samples, and those count.
    expected = int(((LEGS + 1) * (LEGS + 2) // 2).sum())
    if found != expected:
        arch = runtime.current().arch
        raise InputError(
            f"arch = {arch!r}: this driver draws {found} of the {expected} samples of a test picture (Mesa 22 loses atomic "
            "operations); take a newer driver, or run with --no-render and draw with 'taichi-membrane render', on the CPU"
        )
