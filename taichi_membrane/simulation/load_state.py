"""The values of all pressures, loads and motions at one instant, and how stages ramp them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.scene import Scene, Stage


@dataclass(frozen=True)
class LoadState:
    """Values of all pressures, load factors and motion factors at one instant."""

    pressures: dict[str, float]
    loads: dict[str, float]
    motions: dict[str, float]

    def toward(self, other: LoadState, fraction: float) -> LoadState:
        """The state at a fraction of the way to another one, or beyond it; exactly the other one at 1."""
        if fraction == 1.0:
            return other

        def mix(a: dict[str, float], b: dict[str, float]) -> dict[str, float]:
            return {name: a[name] + fraction * (b[name] - a[name]) for name in a}

        return LoadState(
            mix(self.pressures, other.pressures), mix(self.loads, other.loads), mix(self.motions, other.motions)
        )

    def change(self, other: LoadState) -> Floats:
        """The change of all values to another state, in a fixed order."""
        return np.subtract(other._values(), self._values())

    def _values(self) -> list[float]:
        return [*self.pressures.values(), *self.loads.values(), *self.motions.values()]


@dataclass(frozen=True)
class Course:
    """The straight way that a stage takes from one load state to another."""

    start: LoadState
    target: LoadState

    def at(self, share: float) -> LoadState:
        """The state at a share of the way."""
        return self.start.toward(self.target, share)


def unloaded(scene: Scene) -> LoadState:
    """The state before the first stage."""
    return LoadState(*(dict.fromkeys(names, 0.0) for names in (scene.pressures, scene.loads, scene.motions)))


def stage_target(before: LoadState, stage: Stage) -> LoadState:
    """State at a stage's end: what the stage does not name keeps its value."""
    pressures = dict(before.pressures)
    if isinstance(stage.pressure, dict):
        pressures.update(stage.pressure)
    elif stage.pressure is not None:
        pressures.update(dict.fromkeys(pressures, stage.pressure))
    return LoadState(pressures, {**before.loads, **stage.loads}, {**before.motions, **stage.motions})


def stage_targets(scene: Scene) -> list[LoadState]:
    """States at the ends of all stages."""
    targets = [unloaded(scene)]
    for stage in scene.stages:
        targets.append(stage_target(targets[-1], stage))
    return targets[1:]
