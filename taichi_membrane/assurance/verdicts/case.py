"""What a verdict case is: a structure on its way to a load, and what is known of that way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

Source = Literal["closed form", "linearised load", "fine arc length", "fine load steps", "mechanics", "unknown"]
Size = Literal["small", "default", "full"]
SIZES: tuple[Size, ...] = ("small", "default", "full")

# A bracket and an interval that holds the truth are both known to the residual's tolerance only.
MARGIN = 1e-5


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What the structure does on its way to the last stage's loads.

    :param kind: ``limit``: its largest stable load is between ``lower`` and ``upper``; ``holds``: there is a stable equilibrium
        all the way; ``open``: nobody knows, and only what holds of any verdict is asked.
    :param name: the value that a limit is told in, such as ``load.tip``.
    :param source: by what it is known; ``remark`` says more.
    """

    kind: Literal["limit", "holds", "open"]
    name: str = ""
    lower: float = 0.0
    upper: float = 0.0
    source: Source
    remark: str = ""

    def __str__(self) -> str:
        if self.kind == "limit":
            return f"{self.name} between {self.lower:.6g} and {self.upper:.6g} ({self.source})"
        return f"{'holds' if self.kind == 'holds' else 'not known'} ({self.source})"


def limit(name: str, value: float, *, width: float, source: Source, remark: str = "") -> Truth:
    """A largest stable load that is known to a share ``width`` of itself, up and down."""
    low, high = sorted((value * (1.0 - width), value * (1.0 + width)))
    return Truth(kind="limit", name=name, lower=low, upper=high, source=source, remark=remark)


def holds(source: Source = "mechanics", remark: str = "") -> Truth:
    """A stable equilibrium at every load of the way."""
    return Truth(kind="holds", source=source, remark=remark)


UNKNOWN = Truth(kind="open", source="unknown")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A structure on its way to its last stage's loads, cut into load steps in several ways that must not matter.

    :param setting: what it is, in a line.
    :param problem: the scene for a number of load steps in its last stage; its ``exact`` numbers are judged where it reaches its
        loads.
    :param steps: numbers of load steps.
    :param size: the smallest set that it belongs to.
    :param allowed: largest error of those numbers.
    :param potential: whether the tangent is symmetric, so that its inertia tells stability.
    :param may_refuse: words that the program's own message has where it does not support what the case holds.
    """

    name: str
    family: str
    setting: str
    problem: Callable[[int], Problem]
    steps: tuple[int, ...]
    truth: Truth
    size: Size = "full"
    allowed: float = 1e-5
    potential: bool = True
    may_refuse: str = ""

    def belongs(self, size: Size) -> bool:
        """Whether the case is run in a set."""
        return SIZES.index(self.size) <= SIZES.index(size)


@dataclass(frozen=True, kw_only=True)
class State:
    """One load step's state, taken anew from its displacements.

    :param residual: out-of-balance forces over the applied ones, of a run by motions alone over the reactions.
    :param tolerance: of the residual.
    :param reactions: largest difference between the reactions told and those that the state has, over the largest of them.
    :param negative: negative eigenvalues of the tangent over free components; None where they tell nothing.
    :param told: what the run says of them.
    """

    stage: str
    stage_step: int
    residual: float
    tolerance: float
    reactions: float
    negative: int | None
    told: int | None


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What one run said of itself, and what its states are.

    :param outcome: how the run says that it ended; empty where it did not run.
    :param passed: what ``RunResult.passed`` says.
    :param reason: the last step's.
    :param limits: bounds of each value at the largest stable load; None where no limit is told.
    :param targets: what the values of those bounds are at the end of the last step's stage.
    :param followed: the last step's stage goes by arc length, where states may be unstable.
    :param at_target: the last step has its stage's loads.
    :param snapped: the run tells of a jump on its way.
    :param states: the last of each stage.
    :param values: the problem's numbers of a run that reached its loads.
    :param refused: the program's message where it did not take the scene.
    :param crashed: the exception that left the program, or what ended its process.
    :param warned: warnings that left it.
    """

    case: str
    steps: int
    outcome: str = ""
    passed: bool = False
    reason: str = ""
    limits: Mapping[str, tuple[float, float]] | None = None
    targets: Mapping[str, float] = field(default_factory=dict)
    followed: bool = False
    at_target: bool = False
    snapped: bool = False
    states: tuple[State, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    exact: Mapping[str, float] = field(default_factory=dict)
    iterations: int = 0
    seconds: float = 0.0
    refused: str = ""
    crashed: str = ""
    warned: tuple[str, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the run says that its last loads are carried."""
        return self.outcome in ("finished", "no collapse") and self.limits is None

    def told(self) -> str:
        """What the run says, in a few words."""
        if self.crashed or self.refused:
            return f"crashed: {self.crashed}" if self.crashed else f"refused: {self.refused}"
        if self.limits is None:
            return f"{self.outcome} ({self.reason})"
        bounds = ", ".join(f"{name} {low:.6g} … {high:.6g}" for name, (low, high) in self.limits.items())
        return f"{self.outcome}: {bounds or 'a limit without bounds'}"


def nothing(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
    """No numbers beside the verdict."""
    return {}
