"""What stages may do with the gas of chambers and with liquids of given volume."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from taichi_membrane.scene.drivers import kind_named, shut_by
from taichi_membrane.scene.loads import WaterLoad

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene
    from taichi_membrane.scene.stage import Stage

# What chambers that a tube joins have alike, as one gas fills them.
_ALIKE = ("ambient", "exponent", "relief")


def check(scene: Scene) -> None:
    """Refuse reliefs without a pressure outside, and stages that shut, fill or join what they cannot.

    :raises ValueError: with the key and what is allowed.
    """
    for name, pressure in scene.pressures.items():
        if pressure.relief is not None and (pressure.ambient is None or pressure.kind != "follower"):
            raise ValueError(f"pressures.{name}.relief is for shut chambers: it needs ambient, and kind 'follower'")
    for stage in scene.ramps:
        _check_values(scene, stage)
        for name in shut_by(scene, stage):
            _check_shut(scene, stage, name)
        _check_joined(scene, stage)
    if scene.solver.kind == "relaxation":
        for name, load in scene.loads.items():
            if isinstance(load, WaterLoad) and load.given == "volume":
                raise ValueError(f"loads.{name}.given = 'volume' needs solver.kind 'hybrid' or 'newton'")


def _check_values(scene: Scene, stage: Stage) -> None:
    """Refuse numbers that are not told which chamber they are of, a gas that is not possible, a pressure above its relief."""
    for key in ("pressure", "amount"):
        if isinstance(getattr(stage, key), float) and len(scene.pressures) != 1:
            raise ValueError(
                f"{stage.key}.{key} is one number, but there are {len(scene.pressures)} pressures "
                f"({', '.join(scene.pressures)}); name them: {key} = {{ {next(iter(scene.pressures), 'inside')} = ... }}"
            )
    amounts = kind_named("amount").asked(stage, scene.pressures)
    _check_gases(scene, f"{stage.key}.closed", stage.closed)
    _check_gases(scene, f"{stage.key}.amount", amounts)
    _check_gases(scene, f"{stage.key}.ambient", kind_named("ambient").asked(stage, ()))
    if isinstance(stage.ambient, float) and not kind_named("ambient").allowed(scene):
        raise ValueError(f"{stage.key}.ambient: no pressure of this scene has ambient, which it needs")
    for name, value in kind_named("pressure").asked(stage, scene.pressures).items():
        relief = scene.pressures[name].relief if name in scene.pressures else None
        if relief is not None and value > relief:
            raise ValueError(f"{stage.key}.pressure: {value:g}, but pressures.{name}.relief opens at {relief:g}")


def _check_gases(scene: Scene, key: str, names: Iterable[str]) -> None:
    """Refuse names that are not those of chambers with a pressure outside."""
    for name in names:
        if name not in scene.pressures:
            told = ", ".join(scene.pressures) or "(none defined)"
            raise ValueError(f"{key}: {name!r} is not a pressure of this scene; allowed: {told}")
        if name not in kind_named("amount").allowed(scene):
            raise ValueError(f"{key}: pressures.{name} needs ambient, and kind 'follower', to follow its volume")


def _check_shut(scene: Scene, stage: Stage, name: str) -> None:
    """Refuse a stage that shuts a valve and sets the pressure behind it, or asks for what is not there with a shut one."""
    amounts = kind_named("amount").asked(stage, scene.pressures)
    key = f"{stage.key}.{'amount' if name in amounts else 'closed'}"
    if name in stage.closed and name in amounts:
        raise ValueError(f"{key} shuts the valve of {name!r} already; leave it out of closed")
    if name in kind_named("pressure").asked(stage, scene.pressures):
        raise ValueError(f"{key}: pressure {name!r} cannot be shut and set in one stage")
    if scene.solver.kind == "relaxation":
        raise ValueError(f"{key}: a shut chamber needs solver.kind 'hybrid' or 'newton'")
    if scene.modes is not None and scene.modes.stage in (None, stage.name):
        raise ValueError(f"{key}: modes of shut chambers are not implemented; name another stage in modes.stage")


def _check_joined(scene: Scene, stage: Stage) -> None:
    """Refuse a tube between chambers that are not shut, or whose gases are not alike."""
    shut, taken = shut_by(scene, stage), list[str]()
    for tube in stage.joined:
        key = f"{stage.key}.joined"
        for name in tube:
            if name not in shut:
                told = ", ".join(shut) or "(none; name them in closed or amount)"
                raise ValueError(f"{key}: {name!r} is not a pressure that the stage shuts; allowed: {told}")
            if name in taken:
                raise ValueError(f"{key}: {name!r} stands in it twice")
            taken.append(name)
            for quality in _ALIKE:
                first, other = (getattr(scene.pressures[one], quality) for one in (tube[0], name))
                if first != other:
                    raise ValueError(
                        f"{key}: one gas fills {tube[0]!r} and {name!r}, but their {quality} is {first} and {other}"
                    )
