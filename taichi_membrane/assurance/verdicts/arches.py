"""Arches loaded at the crown: the symmetric path sways before it has its maximum."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts.building import traced
from taichi_membrane.assurance.verdicts.case import Case, nothing

SPAN, RADIUS, PRESSURE = 12.0, 0.4, 1e4
FABRIC = {"E": 5e8, "nu": 0.3, "thickness": 1e-3}


def arch(around: int, along: int, steps: int, reach: float, *, pinned: bool) -> Problem:
    """A semicircular arch on pinned or clamped feet; ``reach`` is the load round its crown."""
    scene: dict[str, Any] = {
        "mesh": {"shape": "arch", "span": SPAN, "radius": RADIUS, "around": around, "along": along},
        "fabric": FABRIC,
        "loads": {"crown": {"group": "crown", "direction": [0.0, 0.0, -1.0]}},
        "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "hold": "xyz"}],
    }
    inflated: dict[str, float] = {}
    loaded: dict[str, float] = {}
    if pinned:
        # A foot ring keeps its plan and turns; the gas on the missing lids and half the load act on it.
        scene["groups"] = {
            "feet": {"where": "z < 1e-6"},
            "front": {"where": f"z < 1e-6 and y < {-0.99 * RADIUS}"},
            "back": {"where": f"z < 1e-6 and y > {0.99 * RADIUS}"},
        }
        scene["supports"] = [
            {"group": "feet", "hold": "xy"},
            *({"group": group, "hold": "z"} for group in ("front", "back")),
        ]
        for foot in ("start", "end"):
            scene["loads"][foot] = {"group": foot, "direction": [0.0, 0.0, 1.0], "spread": "edges"}
            lid = 0.5 * around * RADIUS**2 * math.sin(2.0 * math.pi / around)
            inflated[foot], loaded[foot] = -PRESSURE * lid, -PRESSURE * lid + 0.5 * reach
    scene["stages"] = [
        {"name": "inflate", "pressure": PRESSURE, "loads": inflated},
        {"name": "load", "steps": steps, "loads": {"crown": reach, **loaded}, "until": "collapse"},
    ]
    return Problem(scene=scene, measure=nothing)


def cases() -> Iterator[Case]:
    """All of this family's."""
    for word, pinned, reach in (("pinned", True, 2600.0), ("clamped", False, 4000.0), ("pinned_below", True, 900.0)):
        for around, along in ((12, 32), (12, 48)):

            def problem(
                steps: int, around: int = around, along: int = along, reach: float = reach, pinned: bool = pinned
            ) -> Problem:
                return arch(around, along, steps, reach, pinned=pinned)

            yield traced(
                f"arch_{word}_{along}",
                family="arches",
                problem=problem,
                steps=(1, 3, 6),
                size="default" if along == 32 else "full",
                setting=f"Arch of 12 m span, {around} × {along}, {word.split('_')[0]} feet, crown load to {reach:g} N.",
            )
