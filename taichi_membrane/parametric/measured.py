"""A measured curve, and the scene that is computed at exactly its points."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from taichi_membrane.errors import InputError
from taichi_membrane.scene import Scene, Stage
from taichi_membrane.scene.drivers import DRIVERS, driver_names, shut_by, stage_values
from taichi_membrane.scene.messages import not_one_of


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured curve.

    :param quantity: what was raised: ``load.NAME``, ``pressure[.NAME]`` or ``motion.NAME``; ``x`` its values.
    :param y: what was read at each of them, in the probe's unit and sign.
    :param deviation: standard deviation of each reading; None where it is to be estimated from the residuals.
    """

    quantity: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    deviation: tuple[float, ...] | None


def read_measured(path: Path) -> Measured:
    """Read a CSV file: a line of heads (the quantity, anything, and ``sd`` where readings have one), then numbers.

    :raises InputError: it cannot be read or is not that.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    heads = [head.strip() for head in rows[0]] if rows else []
    if len(heads) not in (2, 3) or (len(heads) == 3 and heads[2] != "sd"):
        raise InputError(
            f"{path}: the first line is {','.join(heads)!r}; expected such as load.tip,deflection or load.tip,deflection,sd"
        )
    numbers = [_numbers(path, line, row, len(heads)) for line, row in enumerate(rows[1:], 2)]
    if not numbers:
        raise InputError(f"{path}: there is no reading under the heads")
    x, y, *rest = zip(*numbers, strict=True)
    if rest and min(rest[0]) <= 0.0:
        raise InputError(f"{path}: a standard deviation is {min(rest[0]):g}; all must be positive")
    return Measured(quantity=heads[0], x=x, y=y, deviation=rest[0] if rest else None)


def _numbers(path: Path, line: int, row: list[str], count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, row))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{path}: line {line} is {','.join(row)!r}; expected {count} numbers")
    return numbers


def at_readings(scene: Scene, measured: Measured, stage: str | None, probe: str | None = None) -> Scene:
    """The scene with one stage cut into pieces that end at the readings, so that nothing is interpolated.

    Stages after it, checks, the curve and modes are left out.

    :param stage: the stage that was measured; the last one when None.
    :param probe: one that derivatives are wanted of.
    :raises InputError: the quantity does not change in that stage, or a reading is not on its way.
    """
    names = [one.name for one in scene.stages]
    if stage is not None and stage not in names:
        raise InputError(f"--stage {stage!r}: not a stage of this scene; {not_one_of(stage, names)}")
    place = names.index(stage) if stage is not None else len(names) - 1
    cut = scene.stages[place]
    if cut.control == "arc_length" or cut.until == "collapse" or shut_by(scene, cut) or cut.ambient is not None:
        raise InputError(
            f"stage {cut.name!r} ends where its path does, shuts a chamber or changes ambient; readings need one that raises loads"
        )
    start = _factors(scene, scene.stages[:place])
    end = start | _factors(scene, (cut,))
    quantity = f"pressure.{next(iter(scene.pressures))}" if measured.quantity == "pressure" else measured.quantity
    moving = [name for name in end if end[name] != start.get(name, 0.0)]
    if quantity not in moving:
        raise InputError(f"{quantity!r} does not change in stage {cut.name!r}; {not_one_of(quantity, moving)}")
    low = start.get(quantity, 0.0)
    shares = sorted({(x - low) / (end[quantity] - low) for x in measured.x})
    if shares[0] < 0.0 or (shares[0] == 0.0 and place == 0):
        first = min(measured.x) if end[quantity] > low else max(measured.x)
        raise InputError(f"a reading at {quantity} = {first:g} is not on the way from {low:g} to {end[quantity]:g}")
    pieces: list[Stage] = []
    before = 0.0
    for share in shares:
        if share > 0.0:
            at = {name: start.get(name, 0.0) + share * (end[name] - start.get(name, 0.0)) for name in moving}
            pieces.append(_piece(cut, len(pieces) + 1, at, max(1, round(cut.steps * (share - before)))))
            before = share
    changed = {"stages": [*scene.stages[:place], *pieces], "checks": [], "curve": None, "modes": None}
    return scene.model_copy(update=changed | {"derivatives": [probe] if probe else []})


def reading_steps(scene: Scene, at: Scene, measured: Measured) -> list[str]:
    """The stage of ``at`` whose last step belongs to each reading, in the order of the readings."""
    quantity = f"pressure.{next(iter(scene.pressures))}" if measured.quantity == "pressure" else measured.quantity
    kept = [stage for stage in at.stages if stage in scene.stages]
    pieces = at.stages[len(kept) :]
    low = _factors(scene, kept).get(quantity, 0.0)
    values = [low] * (min(measured.x, key=lambda x: abs(x - low)) == low)
    ends = [*([kept[-1].name] if values else []), *(piece.name for piece in pieces)]
    distinct = sorted(set(measured.x), key=lambda x: abs(x - low))
    return [ends[distinct.index(x)] for x in measured.x]


def _factors(scene: Scene, stages: tuple[Stage, ...] | list[Stage]) -> dict[str, float]:
    """Each factor after the stages that set it; a factor that none sets is zero."""
    found: dict[str, float] = {}
    for stage in stages:
        found |= stage_values(driver_names(scene), stage)
    return found


def _piece(cut: Stage, number: int, at: dict[str, float], steps: int) -> Stage:
    by_kind: dict[str, dict[str, float]] = {kind.name: {} for kind in DRIVERS}
    for key, value in at.items():
        kind, _, name = key.partition(".")
        by_kind[kind][name] = value
    given = {kind.key: by_kind[kind.name] for kind in DRIVERS if by_kind[kind.name]}
    return Stage.model_validate({"name": f"{cut.name}_{number}", "steps": steps, **given})
