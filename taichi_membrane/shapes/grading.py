"""Where rings lie: even, or denser at rings beside which a boundary layer lies.

Bands grow from such a ring by the factor g = :data:`GROWTH` until they are even: n of them reach d = h (gⁿ - 1)/(g - 1), so that
dd/dn = ln g (h/(g - 1) + d) is the size of bands at a distance d.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.shapes.arguments import check_name

Floats = NDArray[np.float64]

# Each band is so many times as long as the one before it; up to 1.5 the layer's error stays that of its first bands.
GROWTH = 1.45
_SAMPLES = 4001


def positions(length: float, pitch: float, first: float | None, last: float | None) -> Floats:
    """(k,) places of rings from 0 to ``length``, bands no longer than about ``pitch``.

    :param first, last: sizes of the bands beside the first and the last ring; None where these are even.
    """
    along = np.linspace(0.0, length, _SAMPLES)
    if first is not None or last is not None:
        # Denser where sizes are small, so that the sum below is good to a small share of a band.
        even = np.linspace(0.0, 1.0, _SAMPLES)
        along = length * (even - np.sin(2.0 * np.pi * even) / (2.0 * np.pi))
    size = np.full(_SAMPLES, pitch)
    for start, distance in ((first, along), (last, length - along)):
        if start is not None:
            size = np.minimum(size, np.log(GROWTH) * (start / (GROWTH - 1.0) + distance))
    density = 0.5 * (1.0 / size[1:] + 1.0 / size[:-1]) * np.diff(along)
    number = np.concatenate([[0.0], np.cumsum(density)])
    count = max(round(number[-1]), 1)
    places = np.interp(np.arange(count + 1) * (number[-1] / count), number, along)
    places[0], places[-1] = 0.0, length
    return places


def ring_places(
    where: str, length: float, along: int, grade: Mapping[str, float] | None, names: tuple[str, str, str], pattern: str
) -> Floats:
    """(k,) places of rings from 0 to ``length``: ``along`` even bands, or by a grade no longer ones.

    :param grade: sizes of the bands beside rings, by ``names`` of the first, the middle and the last ring.
    :raises InputError: another name, a size that is not above 0 and below that of even bands, rings that are turned.
    """
    if not grade:
        return length * np.arange(along + 1) / along
    if pattern == "staggered":
        raise InputError(
            f"{where}: grade needs pattern = 'diagonal' or 'alternating': triangles of short bands between rings turned by half a "
            "pitch ('staggered') stand across the surface"
        )
    pitch = length / along
    for name, size in grade.items():
        check_name(where, "grade", name, names)
        if not 0.0 < size < pitch:
            raise InputError(
                f"{where}: grade.{name} = {size:g} must be above 0 and below the length of even bands, {pitch:g}; it is the length "
                "of the bands beside that ring"
            )
    first, middle, last = (grade.get(name) for name in names)
    if middle is None and first != last:
        return positions(length, pitch, first, last)
    half = positions(0.5 * length, pitch, first, middle)
    other = half if first == last else positions(0.5 * length, pitch, last, middle)
    return np.concatenate([half, length - other[-2::-1]])
