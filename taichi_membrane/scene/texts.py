"""Texts with a unit in a scene as it was written: those whose dimension other entries tell, and what each was converted to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from taichi_membrane.scene import quantity
from taichi_membrane.scene.drivers import DRIVERS, driver_names
from taichi_membrane.scene.messages import item_key
from taichi_membrane.scene.probe import FactorProbe
from taichi_membrane.scene.unit_names import Units
from taichi_membrane.scene.units import probe_unit

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


@dataclass(frozen=True)
class Conversion:
    """A text with a unit, where it stands, and the number that it became with the unit that this is in."""

    key: str
    text: str
    value: float
    unit: str


def units_of(data: Any) -> AbstractContextManager[None]:
    """Converts the texts that are read within to the units that a scene as written names; nothing where it names none."""
    given = data.get("units") if isinstance(data, Mapping) else None
    named = [given.get(key) if isinstance(given, Mapping) else getattr(given, key, None) for key in ("length", "force")]
    length, force = named
    if not all(isinstance(one, str) and one in quantity.UNITS for one in named):
        return nullcontext()  # what is wrong with the units is told where they are read
    return quantity.in_units(str(length), str(force))


def check_dimensions(scene: Scene, data: Any) -> None:
    """Refuse texts that are not of the dimension of the driver or the probe that they are for.

    Names that the scene does not know are left to the checks of references, which come later.

    :param data: the scene as it was written.
    :raises ValueError: both dimensions.
    """
    if not isinstance(data, Mapping):
        return
    for written, stage in (*_pairs(data, "stages", scene.stages), *_pairs(data, "cases", scene.cases)):
        for kind in DRIVERS:
            given, known = written.get(kind.key), kind.allowed(scene)
            for name, text in given.items() if isinstance(given, Mapping) else ():
                if name in known and _has_unit(text):
                    unit = kind.unit(scene.units, known[name])
                    _of_dimension(text, unit, f"{stage.key}.{kind.key}.{name}", f"{kind.name} {name!r}")
    for number, (written, check) in enumerate(_pairs(data, "checks", scene.checks), 1):
        for key in ("reference", "absolute", "at_most", "at_least"):
            if _has_unit(written.get(key)) and _known(scene, check.probe):
                unit = probe_unit(scene, check.probe).partition(" ")[0]  # what follows names a stress's measure
                _of_dimension(written[key], unit, f"checks[{number}].{key}", f"probe {check.probe!r}")


def _pairs(data: Mapping[str, Any], key: str, read: Sequence[Any]) -> Iterator[tuple[Mapping[str, Any], Any]]:
    """The tables of a list as they were written, each with what it was read as."""
    for written, one in zip(data.get(key, ()), read, strict=False):
        yield (written if isinstance(written, Mapping) else {}), one


def _known(scene: Scene, name: str) -> bool:
    """Whether there is such a probe, and what it measures."""
    probe = scene.probes.get(name)
    return probe is not None and (not isinstance(probe, FactorProbe) or probe.of in driver_names(scene))


def _has_unit(value: Any) -> bool:
    """Whether a value is a text with a unit."""
    return isinstance(value, str) and quantity.split(value) is not None


def _of_dimension(text: str, unit: str, key: str, user: str) -> None:
    """Refuse a text of another dimension than a unit's."""
    given, wanted = _dimension(text), quantity.measure(unit).of
    if given != wanted:
        told = f" [{unit}]" if unit else ""
        raise ValueError(
            f"{key}: {text!r} is {quantity.dimension_words(given)}, but {user} takes {quantity.dimension_words(wanted)}{told}"
        )


def _dimension(text: str) -> quantity.Exponents:
    """Exponents of the unit of a text that has one."""
    parts = quantity.split(text)
    assert parts is not None
    return quantity.measure(parts[1]).of


def conversions(scene: BaseModel, data: Mapping[str, Any], units: Units) -> list[Conversion]:
    """What each text with a unit became, in the order of the scene's keys."""
    return list(_converted(scene, data, units, ""))


def _converted(value: Any, written: Any, units: Units, key: str) -> Iterator[Conversion]:
    """Those below a key."""
    if isinstance(written, str):
        if isinstance(value, float) and _has_unit(written):
            yield Conversion(key, written, value, _label(_dimension(written), units))
    elif isinstance(written, Mapping):
        for name, below in written.items():
            held = value.get(name) if isinstance(value, Mapping) else getattr(value, str(name), None)
            yield from _converted(held, below, units, item_key(key, str(name), below))
    elif isinstance(written, list | tuple) and isinstance(value, list | tuple):
        for number, (held, below) in enumerate(zip(value, written, strict=True)):
            yield from _converted(held, below, units, item_key(key, number, below))


def _label(of: quantity.Exponents, units: Units) -> str:
    """Label of the scene's unit of some exponents."""
    length, force = units.length, units.force
    known = {
        "length": length, "length²": units.area, "length³": units.volume, "force": force, "force/length": units.resultant,
        "force/length²": units.stress, "force/length³": f"{force}/{length}³", "force · length": units.energy,
        "length/time²": f"{length}/s²", "degrees": "°", "force · time²/length": f"{force}·s²/{length}",
        "force · time²/length²": f"{force}·s²/{length}²", "force · time²/length³": f"{force}·s²/{length}³",
        "force · time²/length⁴": f"{force}·s²/{length}⁴",
    }  # fmt: skip
    return next((label for name, label in known.items() if quantity.exponents(name) == of), "")
