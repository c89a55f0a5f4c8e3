"""Load cases: ramps that each start from the end of a stage, independent of one another, alone or as combinations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from taichi_membrane.scene.base import Finite, Label, Name
from taichi_membrane.scene.stage import Ramp, Stage

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene

# What the factors of a combination multiply, and what is as its cases give it.
_SCALED = ("loads", "motions", "shrinkages", "temperatures", "obstacles")
_AS_GIVEN = ("pressure", "amount", "ambient")


class Case(Ramp):
    """A load case: a ramp from the end of a stage, that no other case changes. Equilibrium is not linear: cases are not added up,
    each is solved.

    ``combine`` makes it a combination: its loads, motions, shrinkages, temperatures and motions of obstacles are the sums of those
    of the named cases, each times its factor; pressures, amounts and pressures outside are as those cases give them, and valves
    shut and joined as of any of them. What the combination gives itself stands in place of that.
    """

    title: Label = ""
    """What it is, for tables."""
    after: Name | None = None
    """Stage at whose end it starts; the last one without it."""
    combine: dict[Name, Finite] = {}
    """Factors of other cases that make up this one."""

    @property
    def key(self) -> str:
        """Where the scene has it, for messages."""
        return f"cases.{self.name}"


class CaseStage(Stage):
    """A case as the stage that it is solved as."""

    @property
    def key(self) -> str:
        """Where the scene has it, for messages."""
        return f"cases.{self.name}"


def stage_of(scene: Scene, case: Case) -> CaseStage:
    """The stage that a case is solved as."""
    named = {one.name: one for one in scene.cases}
    parts = [(named[name], factor) for name, factor in case.combine.items()]
    values = {key: getattr(case, key) for key in Ramp.model_fields}
    for key in _SCALED:
        summed: dict[str, float] = {}
        for one, factor in parts:
            for driver, value in getattr(one, key).items():
                summed[driver] = summed.get(driver, 0.0) + factor * value
        values[key] = summed | values[key]
    for key in _AS_GIVEN:
        values[key] = _merged([*(getattr(one, key) for one, _ in parts), values[key]])
    for key in ("closed", "joined"):
        every = [item for one in (*(part for part, _ in parts), case) for item in getattr(one, key)]
        values[key] = [item for number, item in enumerate(every) if item not in every[:number]]
    return CaseStage.model_construct(**values)


def _merged(given: Iterable[float | dict[str, float] | None]) -> float | dict[str, float] | None:
    """Values by name, later ones before earlier ones; one number stays one."""
    found: float | dict[str, float] | None = None
    for one in given:
        if isinstance(found, dict) and isinstance(one, dict):
            found = found | one
        elif one is not None:
            found = one
    return found


def check(scene: Scene) -> None:
    """Refuse cases of one name, that start from no stage, or that combine what is not there or does not agree.

    :raises ValueError: with the key and what is allowed.
    """
    stages = [stage.name for stage in scene.stages]
    names = [*stages, *(case.name for case in scene.cases)]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise ValueError(f"cases.{name}: another stage or case has the name already")
    for case in scene.cases:
        if case.after is not None and case.after not in stages:
            raise ValueError(
                f"{case.key}.after: {case.after!r} is not a stage of this scene; allowed: {', '.join(stages)}"
            )
        allowed = [one.name for one in scene.cases if not one.combine]
        for name in case.combine:
            if name not in allowed:
                raise ValueError(
                    f"{case.key}.combine: {name!r} is not a case that could be combined; allowed: {', '.join(allowed) or '(none)'}"
                )
        for key in _AS_GIVEN:
            _check_agreement(scene, case, key)


def _check_agreement(scene: Scene, case: Case, key: str) -> None:
    """Refuse a combination of cases that give different pressures, where it does not say which is meant."""
    own = getattr(case, key)
    seen: dict[str, tuple[str, float]] = {}
    for one in scene.cases:
        given = getattr(one, key) if one.name in case.combine else None
        for name, value in (given if isinstance(given, dict) else {"": given}).items():
            if value is None or (own is not None and (not isinstance(own, dict) or name in own)):
                continue
            other, before = seen.setdefault(name, (one.name, value))
            if before != value:
                raise ValueError(
                    f"{case.key}.combine: {key}{f' {name!r}' if name else ''} is {before:g} in {other!r} and {value:g} in "
                    f"{one.name!r}; give the one that is meant: {key} = ..."
                )
