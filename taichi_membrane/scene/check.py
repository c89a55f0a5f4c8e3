"""What a run is held against: values of probes at load steps."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from taichi_membrane.scene.base import Label, Positive, PositiveQuantity, Quantity, Record


class Check(Record):
    """A probe's value at one load step against a reference, or within bounds; ``step`` counts from 1, or from the stage's end with
    -1 (of a stage that may end early, from the last step done).

    Give ``reference`` with ``tolerance`` (relative to it) or ``absolute``; or ``at_most``, ``at_least`` or both. ``source`` says
    where the reference or the bounds come from.
    """

    probe: str
    """Name of the probe."""
    stage: str
    """Name of the stage."""
    step: int = -1
    """Load step of the stage from 1, or from its end with -1."""
    reference: Quantity | None = None
    """What the value should be."""
    tolerance: Positive | None = None
    """Largest error relative to the reference."""
    absolute: PositiveQuantity | None = None
    """Largest absolute error."""
    at_most: Quantity | None = None
    """Largest value that is well, such as 1 of a utilisation."""
    at_least: Quantity | None = None
    """Least value that is well."""
    source: Annotated[Label, Field(min_length=1)]
    """Where the reference, or the bounds, come from."""

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        bounds = [name for name in ("at_most", "at_least") if getattr(self, name) is not None]
        if (self.reference is None) == (not bounds):
            raise ValueError("give either reference, or at_most, at_least or both")
        if bounds:
            if self.tolerance is not None or self.absolute is not None:
                raise ValueError(f"tolerance and absolute belong to a reference; {' and '.join(bounds)} is kept or not")
            if self.at_most is not None and self.at_least is not None and self.at_least > self.at_most:
                raise ValueError(f"at_least = {self.at_least:g} is above at_most = {self.at_most:g}")
            return self
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("give either tolerance (relative) or absolute")
        if self.tolerance is not None and self.reference == 0:
            raise ValueError("a relative tolerance of a zero reference can never hold; give absolute")
        return self
