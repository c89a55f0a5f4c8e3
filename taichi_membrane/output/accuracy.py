"""What a run says of its own accuracy, in the summary and read back: boundary layers, and estimates of errors."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taichi_membrane.simulation.accuracy import Estimate, Layer, LayerSide, ProbeEstimate, StepEstimate


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


def estimate_record(estimate: Estimate | None) -> dict[str, Any] | None:
    """Estimates for the summary, each with the error that it tells."""
    if estimate is None:
        return None
    steps = [
        {**asdict(step), "probes": {name: {**asdict(one), "error": one.error} for name, one in step.probes.items()}}
        for step in estimate.steps
    ]
    return {**asdict(estimate), "steps": steps}


def estimate_of(record: dict[str, Any] | None) -> Estimate | None:
    """The estimates of a record."""
    if record is None:
        return None
    return Estimate(
        node_count=int(record["node_count"]),
        tri_count=int(record["tri_count"]),
        left_out=tuple(map(str, record["left_out"])),
        steps=tuple(
            StepEstimate(
                number=int(one["number"]),
                stage=str(one["stage"]),
                stage_step=int(one["stage_step"]),
                probes={
                    str(name): ProbeEstimate(value=float(p["value"]), fine=float(p["fine"]), order=float(p["order"]))
                    for name, p in one["probes"].items()
                },
                unknown=str(one["unknown"]),
                iterations=int(one["iterations"]),
            )
            for one in record["steps"]
        ),
    )
