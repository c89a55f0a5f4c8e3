"""What a run is held against: values of probes at load steps."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import Label, Positive, Quantity, Record


class Check(Record):
    """A probe's value at one load step against a reference; ``step`` counts from 1, or from the stage's end with -1 (of a stage
    that may end early, from the last step done).

    Give ``tolerance`` (relative to the reference) or ``absolute``. ``source`` says where the reference comes from.
    """

    probe: str
    """Name of the probe."""
    stage: str
    """Name of the stage."""
    step: int = -1
    """Load step of the stage from 1, or from its end with -1."""
    reference: Quantity
    """What the value should be."""
    tolerance: Positive | None = None
    """Largest error relative to the reference."""
    absolute: Positive | None = None
    """Largest absolute error."""
    source: Annotated[Label, Field(min_length=1)]
    """Where the reference comes from."""

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("give either tolerance (relative) or absolute")
        if self.tolerance is not None and self.reference == 0:
            raise ValueError("a relative tolerance of a zero reference can never hold; give absolute")
        return self
