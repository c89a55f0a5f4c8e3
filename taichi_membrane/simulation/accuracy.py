"""What is told of a run's errors: layers that its mesh resolves or not, and estimates by a finer mesh."""

from __future__ import annotations

from dataclasses import dataclass, field

from taichi_membrane.names import AdaptVerdict

# Sizes of elements over the length of a layer above which a mesh does not see it.
COARSEST = 2.0


@dataclass(frozen=True, kw_only=True)
class LayerSide:
    """The boundary layer on one side of a line.

    :param side: element group on this side, with a direction where another side lies in the same.
    :param size: median height over the line of the elements beside it, at rest [length].
    :param length: distance over which a disturbance decays [length]; None where it is not known, and ``unknown`` says why.
    """

    side: str
    size: float
    length: float | None
    unknown: str = ""

    @property
    def ratio(self) -> float | None:
        """Size over length; None where that is not known."""
        return None if self.length is None else self.size / self.length if self.length > 0.0 else float("inf")

    @property
    def resolved(self) -> bool | None:
        """Whether elements are short enough to see the layer; None where that is not known."""
        return None if self.ratio is None else self.ratio <= COARSEST


@dataclass(frozen=True, kw_only=True)
class Layer:
    """A line of the mesh beside which the wall is disturbed, and the layers on its sides.

    :param causes: what disturbs it, in words such as ``start held``.
    :param place: mean of its nodes at rest.
    """

    causes: tuple[str, ...]
    edge_count: int
    place: tuple[float, ...]
    sides: tuple[LayerSide, ...]

    @property
    def resolved(self) -> bool | None:
        """Whether the layers of all sides are resolved, as far as they are known; None where none is."""
        known = [side.resolved for side in self.sides if side.resolved is not None]
        return all(known) if known else None


@dataclass(frozen=True, kw_only=True)
class ProbeEstimate:
    """A probe's value at a load step and on the mesh cut in four, and what that tells of its error.

    :param order: power of the size of elements with which the error is taken to fall.
    """

    value: float
    fine: float
    order: float

    @property
    def error(self) -> float:
        """Estimate of ``value`` less the exact one: the difference from ``fine``, times 2^p/(2^p - 1)."""
        factor = 2.0**self.order
        return (self.value - self.fine) * factor / (factor - 1.0)


@dataclass(frozen=True, kw_only=True)
class StepEstimate:
    """Error estimates of one load step.

    :param probes: by name; empty where nothing is known, and ``unknown`` says why.
    :param iterations: of the solution on the fine mesh.
    """

    number: int
    stage: str
    stage_step: int
    probes: dict[str, ProbeEstimate] = field(default_factory=dict)
    unknown: str = ""
    iterations: int = 0


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Error estimates of a run, from load steps solved again on its mesh cut in four.

    :param node_count: of the fine mesh, and ``tri_count`` its elements.
    :param left_out: what the estimates do not contain, in words.
    """

    node_count: int
    tri_count: int
    left_out: tuple[str, ...]
    steps: tuple[StepEstimate, ...]


@dataclass(frozen=True, kw_only=True)
class Round:
    """One mesh of a refinement.

    :param value: of the probe at the last load step; ``allowed`` the error allowed.
    :param error: estimated, as :attr:`ProbeEstimate.error`; None where it is not known, and ``unknown`` says why.
    :param fine: the probe on the mesh cut in four.
    :param layers: what disturbs the lines whose layers the mesh does not resolve.
    :param indicator: sum over elements of what they are thought to contribute: it ranks them, and estimates nothing.
    """

    node_count: int
    tri_count: int
    value: float
    allowed: float
    error: float | None
    fine: float | None
    unknown: str
    layers: tuple[str, ...]
    indicator: float
    iterations: int
    seconds: float

    @property
    def meets(self) -> bool:
        """Whether the estimate meets the tolerance."""
        return self.error is not None and abs(self.error) <= self.allowed


@dataclass(frozen=True, kw_only=True)
class Adaption:
    """What a mesh was refined for, and what became of it.

    :param surface: what new nodes lie on.
    :param verdict: ``reached`` only where the estimate meets the tolerance and layers are resolved; ``told`` says it in words.
    """

    probe: str
    surface: str
    rounds: tuple[Round, ...]
    verdict: AdaptVerdict
    told: str

    @property
    def reached(self) -> bool:
        """Whether the error is as small as was asked for, as far as it can be told."""
        return self.verdict == "reached"


@dataclass(frozen=True, kw_only=True)
class Cascade:
    """How a run came from coarse meshes to its own.

    :param elements: of each mesh, the coarsest first; ``iterations`` and ``seconds`` of all load steps that were solved there.
    :param carried: load steps on the finest mesh that were found from those of the mesh before.
    :param reason: why the others were not, where a state was lost.
    """

    elements: tuple[int, ...]
    iterations: tuple[int, ...]
    seconds: tuple[float, ...]
    carried: int = 0
    reason: str = ""
