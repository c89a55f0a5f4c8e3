"""The values of all drivers (pressures, loads, motions) at one instant, and how stages ramp them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.scene import Scene, Stage, drivers
from taichi_membrane.scene.drivers import stage_values


def of_kind(values: Mapping[str, float], kind: str) -> dict[str, float]:
    """The values of one kind of drivers by their bare names: of ``load.tip``, ``tip``."""
    return {
        name: value for (head, _, name), value in ((key.partition("."), v) for key, v in values.items()) if head == kind
    }


@dataclass(frozen=True)
class LoadState:
    """Values of all drivers at one instant, by names such as ``load.tip``."""

    values: Mapping[str, float]

    @classmethod
    def of(cls, **kinds: Mapping[str, float]) -> LoadState:
        """From the values of each kind by bare names: ``of(pressure={"inside": 0.03}, load={"tip": 10.0})``."""
        return cls({f"{kind}.{name}": value for kind, named in kinds.items() for name, value in named.items()})

    @property
    def pressures(self) -> dict[str, float]:
        """Value of each pressure."""
        return of_kind(self.values, "pressure")

    @property
    def loads(self) -> dict[str, float]:
        """Factor of each load."""
        return of_kind(self.values, "load")

    @property
    def motions(self) -> dict[str, float]:
        """Factor of each motion."""
        return of_kind(self.values, "motion")

    @property
    def obstacles(self) -> dict[str, float]:
        """Factor of the motion of each obstacle that moves."""
        return of_kind(self.values, "obstacle")

    def toward(self, other: LoadState, fraction: float) -> LoadState:
        """The state at a fraction of the way to another one, or beyond it; exactly the other one at 1."""
        if fraction == 1.0:
            return other
        return LoadState({name: was + fraction * (other.values[name] - was) for name, was in self.values.items()})

    def change(self, other: LoadState) -> Floats:
        """The change of all values to another state, in a fixed order."""
        return np.array([other.values[name] - was for name, was in self.values.items()])


@dataclass(frozen=True)
class Course:
    """The straight way that a stage takes from one load state to another."""

    start: LoadState
    target: LoadState

    def at(self, share: float) -> LoadState:
        """The state at a share of the way."""
        return self.start.toward(self.target, share)

    def changing(self) -> list[str]:
        """The drivers whose value changes along it."""
        return [name for name, value in self.start.values.items() if value != self.target.values[name]]


def unloaded(scene: Scene) -> LoadState:
    """The state before the first stage; amounts of gas, which the mesh decides, are left at zero."""
    kinds = drivers.DRIVERS
    return LoadState(
        {f"{kind.name}.{name}": kind.start(item) for kind in kinds for name, item in kind.defined(scene).items()}
    )


def stage_target(before: LoadState, stage: Stage) -> LoadState:
    """State at a stage's end: what the stage does not name keeps its value."""
    return LoadState({**before.values, **stage_values(before.values, stage)})


def stage_targets(scene: Scene) -> list[LoadState]:
    """States at the ends of all stages."""
    targets = [unloaded(scene)]
    for stage in scene.stages:
        targets.append(stage_target(targets[-1], stage))
    return targets[1:]


def ramp_targets(scene: Scene) -> list[tuple[Stage, LoadState]]:
    """The stages and cases, each with the state at its end."""
    found = list(zip(scene.stages, stage_targets(scene), strict=True))
    ends = {stage.name: state for stage, state in found}
    cases = [(scene.ramp(case.name), ends[scene.start_of(case)]) for case in scene.cases]
    return found + [(stage, stage_target(start, stage)) for stage, start in cases]
