"""The kinds of drivers, in one table: what stages ramp, from pressures to motions.

Names such as ``load.tip``, stages, columns, labels, files, derivatives, probes and curves follow the table. A new kind is its
model with a key of :class:`Scene` and one of :class:`Stage`, and one entry here; ``simulation/`` has what it does, such as
dead forces in ``dead_forces.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichi_membrane.scene.support import BodyRotation, Rotation

if TYPE_CHECKING:
    from taichi_membrane.scene.growth import Shrinkage
    from taichi_membrane.scene.loads import AnyLoad, Pressure
    from taichi_membrane.scene.models import Scene, Units
    from taichi_membrane.scene.obstacles import Obstacle
    from taichi_membrane.scene.stage import Stage
    from taichi_membrane.scene.support import Motion


@dataclass(frozen=True, kw_only=True)
class DriverKind:
    """A kind of drivers.

    :param name: begins the names of its drivers: ``load`` of ``load.tip``.
    :param table: the scene's key that defines them, by name.
    :param key: the stage's key that sets their values at its end.
    :param unit: unit of one driver's value; empty for a mere number.
    :param words: what one is, in a line.
    :param scaled: what a value without a unit multiplies, in words; nothing for a mere number.
    :param start: value before the first stage.
    :param possible: whether an entry of the table can have such a driver.
    :param used: whether it has one in a scene, of those that can; a stage that names it is not all that it takes.
    """

    name: str
    table: str
    key: str
    unit: Callable[[Units, Any], str]
    words: Callable[[Any], str]
    scaled: Callable[[Any], str] = lambda _: ""
    start: Callable[[Any], float] = lambda _: 0.0
    possible: Callable[[Any], bool] = lambda _: True
    used: Callable[[Scene, str], bool] = lambda *_: True

    def allowed(self, scene: Scene) -> Mapping[str, Any]:
        """What a stage may name."""
        table: Mapping[str, Any] = getattr(scene, self.table)
        return {name: item for name, item in table.items() if self.possible(item)}

    def defined(self, scene: Scene) -> Mapping[str, Any]:
        """The scene's drivers of this kind, by their bare names."""
        return {name: item for name, item in self.allowed(scene).items() if self.used(scene, name)}

    def asked(self, stage: Stage, names: Iterable[str]) -> dict[str, float]:
        """Values at the stage's end, by bare names; those not in it keep theirs. One number is for all ``names``."""
        given = getattr(stage, self.key)
        return {} if given is None else dict(given) if isinstance(given, Mapping) else dict.fromkeys(names, given)


def _load_unit(units: Units, load: AnyLoad) -> str:
    """Of a load's value; empty where it is the factor of a weight, of a wind, or of a direction that is no unit vector."""
    if load.kind == "snow":
        return f"{units.force}/{units.area}"
    if load.kind == "water":
        return units.length if load.given == "level" else units.volume
    if load.kind in ("weight", "wind", "body") or not math.isclose(
        math.hypot(*(load.towards or ())), 1.0, rel_tol=1e-6
    ):
        return ""
    return units.force + {"total": "", "line": f"/{units.length}", "area": f"/{units.area}"}[load.kind]


def _load_words(load: AnyLoad) -> str:
    """What a load is, in a line."""
    if load.kind == "weight":
        return f"weight of fabrics and cables, g = {load.g:g}"
    if load.kind == "wind":
        return f"wind on the {load.face} of {load.acts_on}, q = {load.q:g}"
    if load.kind == "water":
        told = ", by its volume" if load.given == "volume" else ""
        return f"liquid at the {load.face} of {load.acts_on}, of weight {load.specific_weight:g} per volume{told}"
    return f"{'force and moment' if load.kind == 'body' else load.kind} on {load.acts_on}"


def _load_scaled(load: AnyLoad) -> str:
    """What a load's factor without a unit multiplies."""
    return {"weight": "weight", "wind": "q", "body": "force and moment"}.get(load.kind, "direction")


def _motion_unit(units: Units, motion: Motion | Obstacle) -> str:
    """Of a motion's factor, or of an obstacle's; empty where a translation's direction is no unit vector."""
    if isinstance(motion, Rotation | BodyRotation):
        return "°"
    assert motion.direction is not None  # of obstacles those that move alone have a factor
    return units.length if math.isclose(math.hypot(*motion.direction), 1.0, rel_tol=1e-6) else ""


def _pressed(pressure: Pressure) -> str:
    """What a pressure acts on, in words."""
    against = f", against the normals of {_joined(pressure.against)}" if pressure.against else ""
    return f"on {_joined(pressure.group)}{against}"


def _shrinkage_words(item: Shrinkage) -> str:
    """How much shrinks, in words."""
    return f"of {_joined(item.group)}, by {item.warp:g} in warp and {item.weft:g} in weft"


def _joined(groups: str | list[str]) -> str:
    return groups if isinstance(groups, str) else ", ".join(groups)


def _holds_gas(pressure: Pressure) -> bool:
    """Whether a stage can shut its valve."""
    return pressure.kind == "follower" and pressure.ambient is not None


def shut_by(scene: Scene, stage: Stage) -> list[str]:
    """Names of the pressures whose valve a stage shuts, in the scene's order."""
    amounts = kind_named("amount").asked(stage, scene.pressures)
    return [name for name in scene.pressures if name in stage.closed or name in amounts]


DRIVERS: tuple[DriverKind, ...] = (
    DriverKind(
        name="pressure", table="pressures", key="pressure", unit=lambda units, _: units.stress,
        words=lambda item: f"{item.kind}, {_pressed(item)}",
    ),
    DriverKind(
        name="amount", table="pressures", key="amount", unit=lambda units, _: units.volume,
        words=lambda item: f"of gas, as its volume at {item.ambient:g}", possible=_holds_gas,
        used=lambda scene, name: any(name in shut_by(scene, stage) for stage in scene.ramps),
    ),
    DriverKind(
        name="ambient", table="pressures", key="ambient", unit=lambda units, _: units.stress,
        words=lambda item: f"{item.ambient:g} at first", start=lambda item: item.ambient, possible=_holds_gas,
        used=lambda scene, _: any(stage.ambient is not None for stage in scene.ramps),
    ),
    DriverKind(
        name="load", table="loads", key="loads", unit=_load_unit, words=_load_words, scaled=_load_scaled,
    ),
    DriverKind(
        name="motion", table="motions", key="motions", unit=_motion_unit,
        words=lambda item: f"{item.kind} of {item.group} in {item.hold}",
    ),
    DriverKind(
        name="shrinkage", table="shrinkages", key="shrinkages", unit=lambda *_: "", words=_shrinkage_words,
        scaled=lambda _: "shrinkage",
    ),
    DriverKind(
        name="temperature", table="temperatures", key="temperatures", unit=lambda *_: "K",
        words=lambda item: f"of {_joined(item.group)}",
    ),
    DriverKind(
        name="obstacle", table="obstacles", key="obstacles", unit=_motion_unit,
        words=lambda item: f"{item.kind}, for {item.group}, moved along {list(item.direction)}{friction_words(item.friction)}",
        possible=lambda item: item.direction is not None,
    ),
)  # fmt: skip


def friction_words(coefficient: float) -> str:
    """Friction of an obstacle, in words; nothing where there is none."""
    return f", friction {coefficient:g}" if coefficient else ", without friction"


def driver_names(scene: Scene) -> list[str]:
    """All drivers of a scene, such as ``load.tip``."""
    return [f"{kind.name}.{name}" for kind in DRIVERS for name in kind.defined(scene)]


def driver_unit(scene: Scene, driver: str) -> str:
    """Unit of a driver's value; empty for a mere number."""
    kind, _, name = driver.partition(".")
    entry = kind_named(kind)
    return entry.unit(scene.units, entry.defined(scene)[name])


def kind_named(name: str) -> DriverKind:
    """The entry of a kind."""
    return next(kind for kind in DRIVERS if kind.name == name)


def stage_values(names: Iterable[str], stage: Stage) -> dict[str, float]:
    """What a stage sets, by driver, given the names of all drivers."""
    bare: dict[str, list[str]] = {kind.name: [] for kind in DRIVERS}
    for driver in names:
        kind, _, name = driver.partition(".")
        bare[kind].append(name)
    return {
        f"{kind.name}.{name}": value for kind in DRIVERS for name, value in kind.asked(stage, bare[kind.name]).items()
    }


def driver_label(scene: Scene, driver: str) -> str:
    """Unit of a driver's value, or what the value multiplies."""
    unit = driver_unit(scene, driver)
    kind, _, name = driver.partition(".")
    entry = kind_named(kind)
    scaled = entry.scaled(entry.defined(scene)[name])
    return f"× {scaled}" if scaled and not unit else unit
