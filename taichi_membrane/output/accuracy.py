"""What a run says of its own accuracy, in the summary and read back: boundary layers, estimates of errors, refinement."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taichi_membrane.simulation.accuracy import (
    Adaption,
    Cascade,
    Estimate,
    Layer,
    LayerSide,
    ProbeEstimate,
    Round,
    StepEstimate,
)


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


def adaption_record(adaption: Adaption | None) -> dict[str, Any] | None:
    """What a mesh was refined for, for the summary."""
    return None if adaption is None else {**asdict(adaption), "reached": adaption.reached}


def adaption_of(record: dict[str, Any] | None) -> Adaption | None:
    """What a record says that a mesh was refined for."""
    if record is None:
        return None
    rounds = [
        Round(
            node_count=int(one["node_count"]),
            tri_count=int(one["tri_count"]),
            value=float(one["value"]),
            allowed=float(one["allowed"]),
            error=None if one["error"] is None else float(one["error"]),
            fine=None if one["fine"] is None else float(one["fine"]),
            unknown=str(one["unknown"]),
            layers=tuple(map(str, one["layers"])),
            indicator=float(one["indicator"]),
            iterations=int(one["iterations"]),
            seconds=float(one["seconds"]),
        )
        for one in record["rounds"]
    ]
    return Adaption(
        probe=str(record["probe"]),
        surface=str(record["surface"]),
        rounds=tuple(rounds),
        verdict=record["verdict"],
        told=str(record["told"]),
    )


def cascade_of(record: dict[str, Any] | None) -> Cascade | None:
    """How a record says that a run came from coarse meshes to its own."""
    if record is None:
        return None
    return Cascade(
        elements=tuple(map(int, record["elements"])),
        iterations=tuple(map(int, record["iterations"])),
        seconds=tuple(map(float, record["seconds"])),
        carried=int(record["carried"]),
        reason=str(record["reason"]),
    )
