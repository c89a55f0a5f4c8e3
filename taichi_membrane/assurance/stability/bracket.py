"""Whether what a run says of its largest stable load can be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from taichi_membrane.scene import Scene
from taichi_membrane.simulation.load_state import stage_targets
from taichi_membrane.simulation.results import StepResult

# The points of a path are equilibria to the residual's tolerance, and the load that they are found at is no better known.
_MARGIN = 1e-5


@dataclass(frozen=True, kw_only=True)
class Bracket:
    """What a run says of its largest stable load: two values, on the way from where it came to the one that was aimed at.

    :param known: where the largest stable load is; None where nobody knows.
    """

    name: str
    lower: float
    upper: float
    target: float
    known: float | None = None

    def wrong(self) -> str:
        """What cannot be; empty where all is well."""
        onward = 1.0 if self.target >= self.lower else -1.0  # a pressure may fall towards collapse
        said = f"collapse of {self.name} between {self.lower:.6g} and {self.upper:.6g}"
        if not onward * self.lower <= onward * self.upper:
            return f"{said}, on the way to {self.target:.6g}: out of order"
        if self.known is not None:
            margin = _MARGIN * abs(self.known)
            low, high = sorted((self.lower, self.upper))
            if not low - margin <= self.known <= high + margin:
                return f"{said}, but it is at {self.known:.6g}"
        return ""


def brackets(scene: Scene, last: StepResult, known: Mapping[str, float]) -> tuple[Bracket, ...]:
    """The bounds of collapse that a run's last step tells; ``known`` are largest stable values by name."""
    if last.limit is None:
        return ()
    names = [stage.name for stage in scene.stages]
    target = stage_targets(scene)[names.index(last.stage)]
    return tuple(
        Bracket(name=name, lower=lower, upper=upper, target=target.values[name], known=known.get(name))
        for name, (lower, upper) in last.limit.items()
    )
