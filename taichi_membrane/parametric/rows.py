"""What a trial gave, as a row of the sweep, and which rows may be averaged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from taichi_membrane.errors import InputError
from taichi_membrane.parametric.plan import SweepPlan, Trial
from taichi_membrane.scene.drivers import driver_unit
from taichi_membrane.scene.units import probe_unit

HELD = (
    "interrupted",
    "crashed",
    "refused",
)  # outcomes of trials that a restart does again: the next time may go better


@dataclass(frozen=True, kw_only=True)
class Row:
    """One trial and what came back of it.

    :param outcome: as :class:`RunResult`'s, or ``refused`` (bad input) or ``crashed`` (broke off, or its worker died every time).
    :param passed: whether all checks of the scene hold.
    :param probes: at the last load step that converged, which ``stage`` and ``stage_step`` name.
    :param limit: bounds of each pressure and load at the last largest stable load that was met; None where none was.
    :param negative_eigenvalues: of the tangent at that load step: 0 stable, or, without a potential, no divergence; None where not
        counted.
    :param curve: x and y of the scene's curve.
    :param attempts: how often it was begun; more than 1 where workers died.
    :param memory: MiB held by its worker afterwards.
    :param stored: address of the run's zipped files, where a store was given.
    """

    trial: Trial
    outcome: str
    reason: str = ""
    passed: bool = False
    stage: str | None = None
    stage_step: int | None = None
    probes: dict[str, float | None] = field(default_factory=dict)
    limit: dict[str, list[float]] | None = None
    negative_eigenvalues: int | None = None
    residual: float | None = None
    iterations: int = 0
    curve: list[list[float]] | None = None
    steps: list[dict[str, Any]] = field(default_factory=list)
    provenance: dict[str, Any] = field(default_factory=dict)
    processor_seconds: float = 0.0
    wall_seconds: float = 0.0
    worker: str = ""
    memory: float | None = None
    attempts: int = 1
    stored: str | None = None

    @property
    def apart(self) -> str:
        """Why its values stand apart from those of the others; empty where they may be compared.

        A run that did not go to its end has its probes at another load; an unstable equilibrium, or one behind a collapse that the
        run was to stop at and did not see, is on another branch.
        """
        if self.outcome != "finished":
            return self.outcome
        if self.negative_eigenvalues:
            return "unstable"
        if self.limit is None and any(stage.until == "collapse" for stage in self.trial.scene.stages):
            return "no limit"
        return ""

    def value(self, quantity: str) -> float | None:
        """A probe, or ``limit.load.NAME`` or ``limit.pressure.NAME``: the largest value at which an equilibrium was held.

        None where there is none to be compared with those of other rows. A limit also counts of a run that ended with it before
        its last load.
        """
        kind, _, name = quantity.partition(".")
        if kind == "limit" and quantity not in self.probes:
            met = self.limit if self.outcome == "collapse" or not self.apart else None
            return None if met is None or name not in met else min(met[name], key=abs)
        return None if self.apart else self.probes.get(quantity)


@dataclass(frozen=True, kw_only=True)
class SweepTable:
    """The rows of a sweep that are there, in the order of its plan; all of them unless it was stopped.

    :param directory: where files were written; None when none were.
    """

    plan: SweepPlan
    rows: tuple[Row, ...]
    directory: Path | None = None
    files: tuple[Path, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def complete(self) -> bool:
        """Whether every trial has a row."""
        return len(self.rows) == len(self.plan.trials)

    @property
    def apart(self) -> tuple[Row, ...]:
        """Rows that no mean, quantile or index counts; each one's ``apart`` says why."""
        return tuple(row for row in self.rows if row.apart)

    @cached_property
    def quantities(self) -> tuple[str, ...]:
        """What rows have values of: the probes, then the limits of factors that were being raised when one was met."""
        limits: dict[str, None] = {}
        for row in self.rows:
            for name, (low, high) in (row.limit or {}).items():
                if low != high:
                    limits[f"limit.{name}"] = None
        return (*self.plan.scene.probes, *limits)

    def unit(self, quantity: str) -> str:
        """Unit of a quantity; empty for a share."""
        scene = self.plan.scene
        if quantity in scene.probes:
            return probe_unit(scene, quantity)
        _, kind, name = quantity.split(".", 2)
        return driver_unit(scene, f"{kind}.{name}")

    def values(self, quantity: str) -> list[float | None]:
        """Of every row; None where its run has none that counts.

        :raises InputError: no such quantity.
        """
        if quantity not in self.quantities:
            raise InputError(f"{quantity!r} is not a quantity of this sweep; there are {', '.join(self.quantities)}")
        return [row.value(quantity) for row in self.rows]

    def records(self) -> list[dict[str, Any]]:
        """A dictionary per row with heads as in ``sweep.csv``, units included."""
        return [record(self, row) for row in self.rows]

    def to_pandas(self) -> Any:
        """The rows as a data frame.

        :raises InputError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise InputError("to_pandas needs pandas: install 'taichi-membrane[notebook]'") from None
        return pandas.DataFrame(self.records())


def row_of(trial: Trial, answer: dict[str, Any]) -> Row:
    """The row that an answer makes; its files are not part of it."""
    known = Row.__dataclass_fields__.keys() - {"trial"}
    return Row(trial=trial, **{key: value for key, value in answer.items() if key in known})


def record(table: SweepTable, row: Row) -> dict[str, Any]:
    """A row as flat heads and values.

    Values of a run that stands apart are there, too, as what was found; the column ``apart`` says that they are no results to be
    compared.
    """
    probes = {_head(name, table.unit(name)): row.probes.get(name) for name in table.plan.scene.probes}
    limits: dict[str, float | None] = {}
    for quantity in table.quantities[len(table.plan.scene.probes) :]:
        bounds = (row.limit or {}).get(quantity.removeprefix("limit."))
        for k, end in enumerate(("low", "high")):
            limits[_head(f"{quantity} {end}", table.unit(quantity))] = None if bounds is None else bounds[k]
    return {
        "run": row.trial.number,
        **{key: _plain(value) for key, value in row.trial.settings.items()},
        "triangles": row.trial.tri_count,
        "outcome": row.outcome,
        "apart": row.apart,
        "checks hold": row.passed,
        "stage": row.stage,
        "stage step": row.stage_step,
        **probes,
        **limits,
        "negative eigenvalues": row.negative_eigenvalues,
        "residual": row.residual,
        "iterations": row.iterations,
        "attempts": row.attempts,
        "processor [s]": row.processor_seconds,
        "wall [s]": row.wall_seconds,
        "memory [MiB]": row.memory,
        "worker": row.worker,
        "reason": row.reason,
    }


def numeric_inputs(table: SweepTable) -> Sequence[str]:
    """The varied keys whose values are numbers in every trial."""
    trials = table.plan.trials
    return [key for key in table.plan.inputs if all(isinstance(_plain(t.settings[key]), float) for t in trials)]


def _head(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _plain(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
