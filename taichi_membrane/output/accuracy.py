"""What a run says of its own accuracy, in the summary and read back: boundary layers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taichi_membrane.simulation.results import Layer, LayerSide


def layer_record(layer: Layer) -> dict[str, Any]:
    """A line beside which the wall is disturbed, for the summary."""
    sides = [{**asdict(side), "ratio": side.ratio, "resolved": side.resolved} for side in layer.sides]
    return {**asdict(layer), "sides": sides, "resolved": layer.resolved}


def layer_of(record: dict[str, Any]) -> Layer:
    """The line of a record."""
    return Layer(
        causes=tuple(map(str, record["causes"])),
        edge_count=int(record["edge_count"]),
        place=tuple(map(float, record["place"])),
        sides=tuple(
            LayerSide(
                side=str(one["side"]),
                size=float(one["size"]),
                length=None if one["length"] is None else float(one["length"]),
                unknown=str(one["unknown"]),
            )
            for one in record["sides"]
        ),
    )
