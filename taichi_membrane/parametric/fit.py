"""Calibration: settings of a scene for which a probe follows a measured curve best, by least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from taichi_membrane.errors import InputError
from taichi_membrane.parametric.measured import Measured, at_readings, read_measured, reading_steps
from taichi_membrane.parametric.plan import Conditions, Trial
from taichi_membrane.parametric.pool import LocalPool
from taichi_membrane.parametric.rows import Row, row_of
from taichi_membrane.parametric.task import packed
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import read_data, resolve_scene, value_at, with_overrides
from taichi_membrane.scene.messages import not_one_of
from taichi_membrane.scene.probe import DIFFERENTIABLE

Floats = NDArray[np.float64]
CONFIDENCE = 0.95
_TOLERANCE = 1e-6  # of a run in double precision where the scene gives none: what its numbers are known to


@dataclass(frozen=True, kw_only=True)
class Free:
    """A setting that is looked for, within bounds, from where the scene has it."""

    key: str
    start: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class FitResult:
    """What a calibration found.

    :param converged: whether the search came to its end at a minimum that the readings determine; ``reason`` says how it ended.
        Values of one that did not are no result.
    :param values: of each free setting; ``covariance`` theirs (n, n), ``intervals`` their confidence intervals at 95 %: both
        linearised at the minimum, and None where the readings do not tell the settings apart.
    :param computed: the probe at each reading; ``deviation`` of a reading, given or estimated from the residuals.
    :param adjoint: settings whose derivatives came with the run; those of the others are differences of two runs.
    """

    scene: Scene
    probe: str
    measured: Measured
    free: tuple[Free, ...]
    converged: bool
    reason: str
    values: dict[str, float]
    covariance: Floats | None
    intervals: dict[str, tuple[float, float]] | None
    computed: tuple[float, ...]
    deviation: tuple[float, ...]
    adjoint: tuple[str, ...]
    runs: int
    directory: Path | None = None
    files: tuple[Path, ...] = ()

    @property
    def residuals(self) -> Floats:
        """Computed less measured."""
        return np.array(self.computed) - np.array(self.measured.y)


class _NoEquilibrium(Exception):
    """A run on the way gave no value at some reading."""


def fit(
    scene: Scene | Path | str,
    *,
    to: Path | Measured,
    free: Sequence[str],
    probe: str,
    stage: str | None = None,
    fixed: Sequence[str] = (),
    out: Path | None = None,
    base: Path | None = None,
    jobs: int = 1,
    most: int = 50,
    workers: LocalPool | None = None,
) -> FitResult:
    """Find the settings for which a probe follows a measured curve best.

    :param to: the measured curve or its CSV file; see :func:`read_measured`.
    :param free: keys, each with bounds if wanted: ``fabric.E_warp`` or ``fabric.E_warp=1000:8000``. What starts positive stays so.
    :param stage: the stage that was measured; the last one when None.
    :param jobs: runs side by side where derivatives are differences.
    :param most: steps of the search.
    :param workers: a pool to run on, kept for the next fit; one of its own when None.
    :raises InputError: bad input; fewer readings than free settings; another process at work in ``out``.
    """
    measured = to if isinstance(to, Measured) else read_measured(to)
    search = _Search(scene, measured, free, probe, stage, fixed, base)
    if out is None:
        return search.run(workers, jobs, most, None)
    from taichi_membrane.output.lock import sole_writer
    from taichi_membrane.parametric.fit_report import check_fit_folder, write_fit

    check_fit_folder(out)
    with sole_writer(out):
        found = search.run(workers, jobs, most, out)
        return write_fit(found, out)


class _Search:
    """The problem of a fit: residuals and their derivatives as functions of the settings over their starts."""

    def __init__(
        self, scene: Scene | Path | str, measured: Measured, free: Sequence[str], probe: str, stage: str | None,
        fixed: Sequence[str], base: Path | None,
    ) -> None:  # fmt: skip
        if isinstance(scene, Scene):
            self.source, self.data, self.base = scene.name, scene.model_dump(mode="json"), base or Path()
        else:
            path = resolve_scene(scene) if isinstance(scene, str) else scene
            self.source, self.data, self.base = str(path), read_data(path), base or path.parent
        self.fixed, self.measured, self.probe, self.stage = tuple(fixed), measured, probe, stage
        plain = with_overrides(self.source, self.data, self.fixed)
        self.scene = plain
        if probe not in plain.probes:
            raise InputError(
                f"--probe {probe!r}: not a probe of {self.source}; {not_one_of(probe, list(plain.probes))}"
            )
        dumped = plain.model_dump(mode="json")
        if not free:
            raise InputError("--free: no setting to find is named")
        self.free = tuple(_free(text, self.source, dumped) for text in free)
        twice = sorted({one.key for one in self.free if sum(other.key == one.key for other in self.free) > 1})
        if twice:
            raise InputError(f"--free: {', '.join(twice)} named more than once")
        if len(measured.x) <= len(self.free):
            raise InputError(
                f"{len(measured.x)} readings cannot tell {len(self.free)} settings and an error; more are needed"
            )
        at_readings(plain, measured, stage)  # what does not fit together is told before anything runs
        self.by_adjoint = self._adjoint(plain)
        self.scale = np.array([one.start or 1.0 for one in self.free])
        # Values are known to the tolerance t, a difference over h to t/h, and it is h off the tangent: least where h = √t.
        self.step = math.sqrt(plain.solver.tolerance or _TOLERANCE)
        self.runs = 0
        self._known: dict[bytes, Row] = {}

    def _adjoint(self, scene: Scene) -> dict[int, str]:
        """Free settings whose derivative a run gives, by its name there."""
        if scene.probes[self.probe].kind not in DIFFERENTIABLE or scene.solver.kind == "relaxation":
            return {}
        found = {}
        for number, one in enumerate(self.free):
            name = _parameter(scene, one.key, self.stage or scene.stages[-1].name)
            if name is not None:
                found[number] = name
        return found

    def run(self, workers: LocalPool | None, jobs: int, most: int, out: Path | None) -> FitResult:
        """Search from the start."""
        low = np.array([one.low for one in self.free]) / self.scale
        high = np.array([one.high for one in self.free]) / self.scale
        low, high = np.minimum(low, high), np.maximum(low, high)
        start = np.array([one.start for one in self.free]) / self.scale
        with LocalPool(jobs=jobs) if workers is None else nullcontext(workers) as self._pool:
            try:
                found: Any = optimize.least_squares(
                    self._residuals, start, jac=self._jacobian, bounds=(low, high), xtol=self.step**2, max_nfev=most
                )
            except _NoEquilibrium as failure:
                return self._failed(str(failure), out)
            jacobian = self._jacobian(found.x)
            computed = self._computed(found.x)
        return self._result(found, jacobian, computed, out)

    def _residuals(self, x: Floats) -> Floats:
        return (self._computed(x) - np.array(self.measured.y)) / np.array(self.measured.deviation or 1.0)

    def _computed(self, x: Floats) -> Floats:
        return np.array([step["probes"][self.probe] for step in self._steps(self._rows([x])[0])])

    def _jacobian(self, x: Floats) -> Floats:
        """Of the residuals by the scaled settings."""
        steps = self._steps(self._rows([x])[0])
        columns: list[Floats | None] = [None] * len(x)
        for number, name in self.by_adjoint.items():
            derivatives = [step["derivatives"].get(self.probe, {}).get(name) for step in steps]
            if None not in derivatives:
                columns[number] = np.array(derivatives) * self.scale[number]
        missing = [number for number, column in enumerate(columns) if column is None]
        ends = [self._stepped(x, number) for number in missing]
        here = np.array([step["probes"][self.probe] for step in steps])
        for number, end, row in zip(missing, ends, self._rows(ends), strict=True):
            there = np.array([step["probes"][self.probe] for step in self._steps(row)])
            columns[number] = (there - here) / (end[number] - x[number])
        return np.column_stack(columns) / np.array(self.measured.deviation or 1.0).reshape(-1, 1)  # type: ignore[arg-type]

    def _stepped(self, x: Floats, number: int) -> Floats:
        """The settings with one of them a little away, on the side where there is room."""
        end, one = x.copy(), self.free[number]
        step = self.step * (abs(x[number]) or 1.0)
        end[number] += step if (x[number] + step) * self.scale[number] <= one.high else -step
        return end

    def _rows(self, points: Sequence[Floats]) -> list[Row]:
        """Runs at the points that have none yet, side by side."""
        new = {x.tobytes(): x for x in points if x.tobytes() not in self._known}
        trials = [self._trial(number, x) for number, x in enumerate(new.values(), 1)]
        keys = list(new)
        self.runs += len(trials)
        how = Conditions()
        if trials:
            for trial, answer in self._pool.answers(
                trials, lambda trial: packed(trial, self.base, how, send_mesh=False)
            ):
                self._known[keys[trial.number - 1]] = row_of(trial, answer)
        return [self._known[x.tobytes()] for x in points]

    def _trial(self, number: int, x: Floats) -> Trial:
        settings = {one.key: repr(float(value)) for one, value in zip(self.free, x * self.scale, strict=True)}
        scene = with_overrides(
            self.source, self.data, [*self.fixed, *(f"{key}={value}" for key, value in settings.items())]
        )
        cut = at_readings(scene, self.measured, self.stage, self.probe if self.by_adjoint else None)
        return Trial(number=number, settings=settings, scene=cut, tri_count=0, fingerprint=str(number))

    def _steps(self, row: Row) -> list[dict[str, Any]]:
        """The load step at each reading.

        :raises _NoEquilibrium: the run ended before the last one, or on another branch.
        """
        if row.apart:
            raise _NoEquilibrium(
                f"the run with {row.trial.label} gave no value at every reading: {row.apart}: {row.reason}"
            )
        last = {step["stage"]: step for step in row.steps}
        return [last[stage] for stage in reading_steps(self.scene, row.trial.scene, self.measured)]

    def _failed(self, reason: str, out: Path | None) -> FitResult:
        return FitResult(
            scene=self.scene, probe=self.probe, measured=self.measured, free=self.free, converged=False, reason=reason, values={},
            covariance=None, intervals=None, computed=(), deviation=(), adjoint=(), runs=self.runs, directory=out,
        )  # fmt: skip

    def _result(self, found: Any, jacobian: Floats, computed: Floats, out: Path | None) -> FitResult:
        m, n = jacobian.shape
        # Columns are known to the step of the differences: a combination of settings that changes less than that is not seen.
        columns = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian / np.where(columns > 0.0, columns, 1.0)
        determined = bool((np.linalg.svd(scaled, compute_uv=False).min() > self.step) and columns.min() > 0.0)
        values = found.x * self.scale
        keys = [one.key for one in self.free]
        variance = 1.0 if self.measured.deviation else float(2.0 * found.cost) / (m - n)
        covariance: Any = None
        intervals = None
        if determined:
            covariance = variance * np.linalg.inv(jacobian.T @ jacobian) * np.outer(self.scale, self.scale)
            factor = (
                stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)
                if self.measured.deviation
                else stats.t.ppf(0.5 + 0.5 * CONFIDENCE, m - n)
            )
            reach = float(factor) * np.sqrt(np.diag(covariance))
            intervals = {key: (v - r, v + r) for key, v, r in zip(keys, values.tolist(), reach.tolist(), strict=True)}
        reason = str(found.message) if determined else f"the readings do not tell {' and '.join(keys)} apart"
        return FitResult(
            scene=self.scene, probe=self.probe, measured=self.measured, free=self.free,
            converged=bool(found.status > 0) and determined, reason=reason, values=dict(zip(keys, values.tolist(), strict=True)),
            covariance=covariance, intervals=intervals, computed=tuple(computed.tolist()),
            deviation=self.measured.deviation or (math.sqrt(variance),) * m,
            adjoint=tuple(keys[number] for number in self.by_adjoint), runs=self.runs, directory=out,
        )  # fmt: skip


def _free(text: str, source: str, data: dict[str, Any]) -> Free:
    """Read ``KEY`` or ``KEY=LOW:HIGH``."""
    key, sign, rest = (part.strip() for part in text.partition("="))
    start = value_at(source, data, key)
    if not isinstance(start, int | float) or isinstance(start, bool):
        raise InputError(
            f"--free {text!r}: {source} has no number at {key} to start from; give one with --set {key}=..."
        )
    low, high = (0.0, math.inf) if start > 0.0 else (-math.inf, math.inf)
    if sign:
        try:
            low, high = map(float, rest.split(":"))
        except ValueError:
            raise InputError(f"--free {text!r}: expected KEY or KEY=LOW:HIGH") from None
    if not low < start < high:
        raise InputError(f"--free {text!r}: the start, {start:g}, is not between {low:g} and {high:g}")
    return Free(key=key, start=float(start), low=low, high=high)


def _parameter(scene: Scene, key: str, stage: str) -> str | None:
    """The name that a run's derivatives have for a setting; None where they have none."""
    parts = key.split(".")
    if parts == ["fabric", "thickness"] and not scene.fabrics:
        return "thickness"
    if len(parts) == 3 and (parts[0], parts[2]) == ("fabrics", "thickness"):
        return f"thickness.{parts[1]}" if scene.fabric is not None or len(scene.fabrics) > 1 else "thickness"
    if len(parts) in (3, 4) and (parts[0], parts[2]) == ("stages", "pressure"):
        name = parts[3] if len(parts) == 4 else next(iter(scene.pressures))
        names = [one.name for one in scene.stages]
        if parts[1] not in names:
            return None
        later = scene.stages[names.index(parts[1]) + 1 : names.index(stage) + 1]
        # A pressure that changes again, or is the one that is raised, is no longer what this key says.
        kept = all(one.pressure is None and not one.closed and one.amount is None for one in later)
        return f"pressure.{name}" if later and kept else None
    return None
