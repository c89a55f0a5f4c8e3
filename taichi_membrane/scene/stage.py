"""A stage: a ramp of pressures, loads and motions in load steps, or the search for a shape of given stress."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import Finite, Name, Positive, PositiveStress, PositiveVolume, Quantity, Record, Stress


class Ramp(Record):
    """What stages and load cases have alike: values at the end, and the load steps that lead there."""

    name: Name
    """Name that checks, curves and results use."""
    steps: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of equal load steps; by arc length the most steps."""
    pressure: Stress | dict[Name, Stress] | None = None
    """Pressure at the stage's end [force/length²]: one number where the scene has one pressure, else a table by name."""
    amount: PositiveVolume | dict[Name, PositiveVolume] | None = None
    """Amount of gas at the stage's end, as its volume at the pressure ``ambient`` of its chamber [length³]: one number or by name.
    The valve is shut but for what it lets in or out."""
    ambient: PositiveStress | dict[Name, PositiveStress] | None = None
    """Absolute pressure outside at the stage's end [force/length²]: one number for all chambers that have one, or by name."""
    loads: dict[Name, Quantity] = {}
    """Factor of each load at the stage's end; what is not named keeps its value."""
    motions: dict[Name, Quantity] = {}
    """Factor of each motion at the stage's end."""
    shrinkages: dict[Name, Finite] = {}
    """Factor of each shrinkage at the stage's end."""
    temperatures: dict[Name, Finite] = {}
    """Change of each temperature at the stage's end [degrees of the fabrics' ``expansion``]."""
    obstacles: dict[Name, Quantity] = {}
    """Factor of the motion of each obstacle at the stage's end, on its ``direction``."""
    snaps: Literal["stop", "pass"] = "stop"
    """At a maximum of the load: ``stop`` there, as collapse; ``pass`` goes on from a stable state beyond the jump, and tells it."""
    effect_factor: Positive = 1.0
    """Factor on the resultants in ``utilisation``: a partial factor on effects, where loads are not raised by it before."""
    closed: list[Name] = []
    """Pressures whose valve is shut during the stage: they follow their volume."""
    joined: list[Annotated[list[Name], Field(min_length=2)]] = []
    """Lists of pressures whose shut chambers a tube joins during the stage: one gas of one pressure."""

    @property
    def key(self) -> str:
        """Where the scene has it, for messages."""
        return f"stages.{self.name}"


class Stage(Ramp):
    """A ramp, in ``steps`` equal load steps, from the state before to the given pressures, load and motion factors.

    What is not named keeps its value. ``until = "collapse"``: the stage is meant to meet its largest stable load on the way; the
    run then goes on to the next stage from there. ``control = "arc_length"`` follows the equilibrium path in at most ``steps``
    steps, through limit points, until the stage's values are reached; needs Newton, and no motion that changes. ``closed`` names
    pressures whose valve is shut from the stage's start to its end: they follow their volume. ``amount`` shuts it too, and ramps
    the amount of gas.

    ``kind = "form_find"``, of the first stage only, finds the shape in which the fabrics have their ``prestress`` and cables their
    ``force`` or ``force_density``, at the stage's pressures and loads, whatever the stiffness; other cables and bars keep their
    unstressed lengths. The shape found is the rest shape of all that follows: displacements are counted from it, and
    probes and groups keep their nodes and elements. Warp directions are projected on it anew. Cables get the unstressed length that
    gives them their force.
    """

    kind: Literal["load", "form_find"] = "load"
    """``load`` ramps what acts, ``form_find`` finds the rest shape."""
    stress_tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    """How far stresses and forces of the shape found may be from those given, relative to the largest of each fabric; 0.02 without
    it. For ``form_find``."""
    control: Literal["load", "arc_length"] = "load"
    """``load`` raises the loads step by step, ``arc_length`` follows the equilibrium path through limit points."""
    until: Literal["target", "collapse", "collapse_or_target", "steps"] = "target"
    """What ends the stage well: its ``target``; its largest stable load on the way (``collapse``); either
    (``collapse_or_target``); by arc length also the last of its ``steps``."""

    @property
    def may_end_early(self) -> bool:
        """Whether the number of load steps done may be below ``steps`` in a run that went well."""
        return self.control == "arc_length" or self.until != "target"

    @model_validator(mode="after")
    def _form_find(self) -> Self:
        if self.kind == "load":
            if self.stress_tolerance is not None:
                raise ValueError("stress_tolerance is for kind = 'form_find'")
            return self
        fixed = {"motions", "amount", "ambient", "closed", "joined", "control", "until", "snaps", "steps"}
        extra = sorted(key for key in fixed if getattr(self, key) != type(self).model_fields[key].default)
        if extra:
            raise ValueError(f"kind = 'form_find' takes pressure and loads, all at once; leave out {', '.join(extra)}")
        return self

    @model_validator(mode="after")
    def _arc_length(self) -> Self:
        if self.control == "arc_length":
            if self.motions:
                raise ValueError("control = 'arc_length' follows pressures and loads; leave out motions")
            if self.until in ("collapse", "collapse_or_target"):
                raise ValueError(f"control = 'arc_length' goes on past collapse; leave out until = {self.until!r}")
            if self.snaps == "pass":
                raise ValueError("control = 'arc_length' follows the path and does not snap; leave out snaps")
        elif self.until == "steps":
            raise ValueError("until = 'steps' is for control = 'arc_length'; load control takes all its steps")
        return self
