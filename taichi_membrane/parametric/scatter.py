"""Scatter of a setting: distributions, and points drawn from several of them at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from taichi_membrane.errors import InputError
from taichi_membrane.scene.messages import not_one_of

Design = Literal["latin", "sobol", "importance"]
_FORMS = {"normal": "MEAN:SD", "lognormal": "MEAN:SD", "uniform": "LOW:HIGH"}


@dataclass(frozen=True)
class Scatter:
    """Distribution of one setting.

    :param first: mean, or the lower end of a uniform one; ``second`` its standard deviation, or the upper end.
    """

    key: str
    kind: str
    first: float
    second: float

    def quantile(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values below which the given shares (0 to 1) of the distribution lie."""
        if self.kind == "uniform":
            return self.first + share * (self.second - self.first)
        if self.kind == "normal":
            return np.asarray(stats.norm.ppf(share, self.first, self.second))
        # Mean m and deviation s of the variable itself: its logarithm has variance ln(1 + s²/m²) and mean ln m less half of that.
        variance = math.log1p((self.second / self.first) ** 2)
        return np.exp(stats.norm.ppf(share, math.log(self.first) - 0.5 * variance, math.sqrt(variance)))


def parse_scatter(text: str) -> Scatter:
    """Read ``KEY=normal:MEAN:SD``, ``KEY=lognormal:MEAN:SD`` (SD also as ``5%`` of the mean) or ``KEY=uniform:LOW:HIGH``.

    :raises InputError: not of that form; a deviation that is not positive; an empty range.
    """
    key, sign, rest = (part.strip() for part in text.partition("="))
    kind, *numbers = (part.strip() for part in rest.split(":"))
    where = f"--sample {text!r}"
    if not sign or not key:
        raise InputError(f"{where}: expected KEY=normal:MEAN:SD or KEY=uniform:LOW:HIGH")
    if kind not in _FORMS:
        raise InputError(f"{where}: {kind!r} is no distribution; {not_one_of(kind, list(_FORMS))}")
    if len(numbers) != 2:
        raise InputError(f"{where}: {kind} takes {_FORMS[kind]}, two numbers, not {len(numbers)}")
    first = _number(numbers[0], where)
    share = numbers[1].endswith("%") and kind != "uniform"
    second = _number(numbers[1].removesuffix("%"), where) * (abs(first) / 100.0 if share else 1.0)
    if kind == "uniform" and not first < second:
        raise InputError(f"{where}: the range from {first:g} to {second:g} is empty")
    if kind != "uniform" and not second > 0.0:
        raise InputError(f"{where}: the standard deviation is {second:g}; it must be positive")
    if kind == "lognormal" and not first > 0.0:
        raise InputError(f"{where}: the mean is {first:g}; that of a lognormal distribution is positive")
    return Scatter(key, kind, first, second)


def draw(scatters: Sequence[Scatter], design: Design, runs: int, seed: int) -> list[tuple[float, ...]]:
    """Points (one value per distribution) of a design; the same seed gives the same points.

    ``latin``: a Latin hypercube of ``runs`` points. ``sobol``: scrambled Sobol' points, a power of two of them. ``importance``:
    what first-order and total indices need (Saltelli 2010): with d distributions N points A, N points B, and for each i the points
    A with column i from B, N being the largest power of two with N (d + 2) ≤ ``runs``; in that order.

    :raises InputError: too few runs, or not a power of two where one is needed.
    """
    if design not in get_args(Design):
        raise InputError(f"--design {design!r}: {not_one_of(design, get_args(Design))}")
    if runs < 1:
        raise InputError(f"--runs {runs}: at least 1")
    count, rng = len(scatters), np.random.default_rng(seed)
    if design == "latin":
        shares = stats.qmc.LatinHypercube(count, seed=rng).random(runs)
    elif design == "sobol":
        if runs & (runs - 1):
            near = 2 ** round(math.log2(runs))
            raise InputError(f"--runs {runs}: Sobol' points come in powers of two, such as {near}")
        shares = _sobol(count, runs, rng)
    else:
        base = base_points(count, runs)
        both = _sobol(2 * count, base, rng)
        a, b = both[:, :count], both[:, count:]
        mixed = [np.where(np.arange(count) == i, b, a) for i in range(count)]
        shares = np.concatenate([a, b, *mixed])
    columns = [one.quantile(shares[:, i]) for i, one in enumerate(scatters)]
    return [tuple(map(float, point)) for point in zip(*columns, strict=True)]


def base_points(count: int, runs: int) -> int:
    """Base points N of the design ``importance`` with ``count`` distributions.

    :raises InputError: fewer runs than two base points need.
    """
    base = 2 ** int(math.log2(max(runs // (count + 2), 1)))
    if base < 2:
        raise InputError(f"--runs {runs}: importance of {count} settings needs {2 * (count + 2)} runs at least")
    return base


def _sobol(dimensions: int, points: int, rng: np.random.Generator) -> NDArray[np.float64]:
    return np.asarray(stats.qmc.Sobol(dimensions, seed=rng).random_base2(round(math.log2(points))))


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: {text!r} is not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{where}: {text!r} is not finite")
    return value
