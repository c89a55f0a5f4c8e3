"""Cables in scenes that have hardly any fabric: a panel held all over stands beside them."""

from __future__ import annotations

import math
from typing import Any

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Quantity, Solution, solve

_BESIDE: dict[str, Any] = {
    "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 1, "along_y": 1},
    "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0, "mass_per_area": 1.0},
    "supports": [{"group": "x_min", "hold": "xyz"}, {"group": "x_max", "hold": "xyz"}],
    "pressures": {},
}
IRVINE, STATICS = "elastic catenary (Irvine 1981)", "T = W/(2 sin a), cos a = s/L"


def catenary() -> Benchmark:
    """An elastic cable under its own weight between two level anchors."""
    span, length, stiffness, weight = 10.0, 10.0, 100.0, 10.0
    thrust, sag = closed_forms.elastic_catenary(span, length, stiffness, weight)

    def run(size: int) -> Solution:
        result = solve(
            {
                **_BESIDE,
                "anchors": {"left": [0, 5, 0], "right": [span, 5, 0]},
                "cables": {
                    "rope": {
                        "nodes": ["left", "right"], "parts": size, "length": length, "EA": stiffness,
                        "mass_per_length": weight / length,
                    }
                },
                "loads": {"weight": {"kind": "weight", "g": 1.0}},
                "stages": [{"name": "hang", "loads": {"weight": 1.0}}],
                "probes": {"pull": {"kind": "reaction", "group": "left", "component": "x"}},
            }
        )  # fmt: skip
        sunk = result.steps[-1].displacement[result.mesh.node_groups["rope"], 2]
        return Solution(values={"horizontal force": -result.probe("pull")[-1], "sag": -float(sunk.min())})

    return Benchmark(
        name="catenary",
        title="Elastic catenary",
        setting="A cable of unstressed length 10, EA = 100 and weight 10 between level anchors 10 apart.",
        size_label="elements",
        sizes=(16, 32, 64),
        more_sizes=(128, 256),
        quantities=(
            Quantity(name="horizontal force", reference=thrust, source=IRVINE, bound=1e-3),
            Quantity(name="sag", reference=sag, source=IRVINE, bound=1e-3),
        ),
        run=run,
    )


def pulley() -> Benchmark:
    """A weight on a pulley that runs on a cable without friction; the stiffer, the nearer to the inextensible one."""
    ratio = 1.2
    slope = math.acos(1.0 / ratio)

    def run(size: int) -> Solution:
        result = solve(
            {
                **_BESIDE,
                "anchors": {"left": [0, 5, 0], "right": [1, 5, 0]},
                "joints": {"pulley": [0.3, 5, -0.3]},
                "cables": {
                    "rope": {"nodes": ["left", "pulley", "right"], "length": ratio, "EA": float(size), "sliding": True}
                },
                "loads": {"weight": {"group": "pulley", "direction": [0, 0, -1]}},
                "stages": [{"name": "hang", "loads": {"weight": 1.0}}],
                "probes": {
                    "force": {"kind": "cable", "cable": "rope"},
                    "sag": {"kind": "displacement", "group": "pulley", "component": "z"},
                },
            }
        )
        return Solution(values={"force": result.probe("force")[-1], "sag": 0.3 - result.probe("sag")[-1]})

    return Benchmark(
        name="pulley",
        title="Frictionless pulley",
        setting="A cable 1.2 long over level anchors 1 apart, a pulley of weight 1 set on it 0.3 from one of them.",
        size_label="EA over the weight",
        sizes=(1000, 2000, 4000),
        more_sizes=(8000, 16000),
        quantities=(
            Quantity(name="force", reference=0.5 / math.sin(slope), source=STATICS, bound=1e-3, order=1.0),
            Quantity(name="sag", reference=0.5 * math.tan(slope), source=STATICS, bound=1e-3, order=1.0),
        ),
        run=run,
    )
