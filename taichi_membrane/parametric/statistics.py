"""What the rows of a sweep say together: quantiles, and which setting matters, each with a confidence interval and its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from taichi_membrane.parametric.rows import Row, SweepTable, numeric_inputs
from taichi_membrane.parametric.scatter import base_points

SHARES = (0.05, 0.5, 0.95)
CONFIDENCE = 0.95
_RESAMPLES = (
    1000  # of the bootstrap: its interval's ends scatter by some percent of its width, which is itself an estimate
)
_FEWEST = 4  # pairs; the interval of a rank correlation has 1/√(n - 3)


@dataclass(frozen=True, kw_only=True)
class Quantile:
    """A quantile of a quantity over the runs that count.

    :param low: ends of its confidence interval from order statistics (no distribution assumed); None where too few runs are there
        to bound that side, as are fewer than 59 for the end of a 95 % interval of the 5 % quantile.
    :param counted: runs that it is over, of ``asked``.
    """

    quantity: str
    share: float
    value: float
    low: float | None
    high: float | None
    counted: int
    asked: int


@dataclass(frozen=True, kw_only=True)
class Importance:
    """How much a setting matters for a quantity.

    :param kind: ``first order`` and ``total`` are Sobol' indices (share of the variance due to the setting alone, and with all its
        interactions); ``rank correlation`` is Spearman's, with a sign, where the design has no more to tell.
    :param counted: base points (of a Sobol' index) or runs that it is from, of ``asked``.
    """

    quantity: str
    key: str
    kind: str
    value: float
    low: float
    high: float
    counted: int
    asked: int


def quantiles(table: SweepTable, shares: Sequence[float] = SHARES) -> list[Quantile]:
    """Of every quantity that has a run that counts."""
    found = []
    for quantity in table.quantities:
        values = np.array([value for value in table.values(quantity) if value is not None])
        for share in shares if len(values) else ():
            between: Any = stats.quantile_test(values, p=share).confidence_interval(CONFIDENCE)
            found.append(
                Quantile(
                    quantity=quantity, share=share, value=float(np.quantile(values, share)), low=_finite(between.low),
                    high=_finite(between.high), counted=len(values), asked=len(table.plan.trials),
                )
            )  # fmt: skip
    return found


def importance(table: SweepTable) -> list[Importance]:
    """Sobol' indices where the design was made for them and is complete, else rank correlations."""
    found: list[Importance] = []
    for quantity in table.quantities:
        if table.plan.design == "importance" and table.plan.repeats == 1:
            found += _sobol(table, quantity)
        else:
            found += _ranks(table, quantity)
    return found


def _ranks(table: SweepTable, quantity: str) -> list[Importance]:
    found = []
    values = table.values(quantity)
    counted = [k for k, value in enumerate(values) if value is not None]
    for key in numeric_inputs(table):
        x = [float(table.rows[k].trial.settings[key]) for k in counted]
        y = [value for value in values if value is not None]
        if len(counted) < _FEWEST or len(set(x)) < 2 or len(set(y)) < 2:
            continue
        value = float(stats.spearmanr(x, y).statistic)
        # Fisher's transform; the variance of a rank correlation's is (1 + r²/2)/(n - 3) (Bonett and Wright 2000).
        reach = stats.norm.ppf(0.5 + 0.5 * CONFIDENCE) * math.sqrt((1.0 + 0.5 * value**2) / (len(counted) - 3))
        middle = math.atanh(max(min(value, 1.0 - 1e-15), -1.0 + 1e-15))
        found.append(
            Importance(
                quantity=quantity, key=key, kind="rank correlation", value=value, low=math.tanh(middle - reach),
                high=math.tanh(middle + reach), counted=len(counted), asked=len(table.plan.trials),
            )
        )  # fmt: skip
    return found


def _sobol(table: SweepTable, quantity: str) -> list[Importance]:
    """Indices from the base points whose d + 2 runs all count.

    SciPy's estimator takes a power of two of base points: where some are incomplete, the first so many of the others.
    """
    plan, count = table.plan, len(table.plan.scatters)
    base = base_points(count, len(plan.trials))
    by_number = {row.trial.number: row.value(quantity) for row in table.rows}
    blocks = np.array([by_number.get(number) for number in range(1, len(plan.trials) + 1)], float).reshape(-1, base)
    whole = np.flatnonzero(np.isfinite(blocks).all(axis=0))
    used = 2 ** int(math.log2(len(whole))) if len(whole) else 0
    if used < 2 or np.ptp(blocks[:, whole[:used]]) == 0.0:
        return []
    blocks = blocks[:, whole[:used]]
    function: Any = {"f_A": blocks[0][None], "f_B": blocks[1][None], "f_AB": blocks[2:, None]}
    indices: Any = stats.sobol_indices(func=function, n=used)
    spread = indices.bootstrap(confidence_level=CONFIDENCE, n_resamples=_RESAMPLES)
    return [
        Importance(
            quantity=quantity, key=scatter.key, kind=kind, value=_at(value, k), low=_at(around.confidence_interval.low, k),
            high=_at(around.confidence_interval.high, k), counted=used, asked=base,
        )
        for kind, value, around in (
            ("first order", indices.first_order, spread.first_order), ("total", indices.total_order, spread.total_order),
        )
        for k, scatter in enumerate(plan.scatters)
    ]  # fmt: skip


def _at(values: NDArray[np.float64], k: int) -> float:
    return float(np.atleast_1d(values)[k])


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def apart_counts(rows: Sequence[Row]) -> dict[str, int]:
    """How many rows stand apart for each reason."""
    counts: dict[str, int] = {}
    for row in rows:
        if row.apart:
            counts[row.apart] = counts.get(row.apart, 0) + 1
    return counts
