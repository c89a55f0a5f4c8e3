"""Partly wrinkled flat membranes: a strip in bending, an annulus with a turned hub."""

from __future__ import annotations

from typing import Any

import numpy as np

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Curve, Quantity, Solution, solve
from taichi_membrane.assurance.verification.shooting import turned_hub


def strip() -> Benchmark:
    """A prestressed strip whose end is turned about a point beyond the wrinkles: half of it, of unit height and length."""
    stiffness, prestress, nu = 1e5, 1.0, 0.3
    band = 0.7  # of the height, at the last step
    curvature = 2.0 * prestress / (stiffness * (1.0 - band) ** 2)
    centre = band + prestress / (stiffness * curvature)  # height of the unstretched fibre
    # Shares of the curvature: the first before wrinkling, the others where the band reaches 0.1, 0.25, 0.4, 0.55 and 0.7.
    shares = [0.04, *(prestress / (stiffness * curvature * (centre - b)) for b in (0.1, 0.25, 0.4, 0.55, band))]
    names = {0: "taut", 2: "a quarter wrinkled", 5: "seven tenths wrinkled"}

    stages = [
        {
            "name": f"bend{number}",
            "loads": {"upper": 1.0, "lower": 1.0},
            "motions": {"end": float(np.rad2deg(np.arcsin(share * curvature)))},
        }
        for number, share in enumerate(shares)
    ]

    def run(size: int) -> Solution:
        result = solve(_strip_scene(size, stiffness, prestress, nu, centre, stages))
        force, moment = result.probe("force"), result.probe("moment")
        values = {f"moment, {word}": moment[step] for step, word in names.items()}
        values["axial force, seven tenths wrinkled"] = force[-1]
        return Solution(values=values, points=(0.5 * stiffness * curvature * np.array(shares) / force, moment / force))

    source = "Stein and Hedgepeth 1961 (strip in bending)"
    exact = [
        closed_forms.wrinkled_strip(share * curvature, share * curvature * (0.5 - centre), prestress, stiffness)
        for share in shares
    ]
    quantities = [
        Quantity(name=f"moment, {word}", reference=exact[step][1], source=source, bound=0.005)
        for step, word in names.items()
    ]
    quantities.append(
        Quantity(name="axial force, seven tenths wrinkled", reference=exact[-1][0], source=source, bound=0.005)
    )
    bands = np.linspace(0.0, 0.75, 60)
    return Benchmark(
        name="strip",
        title="Wrinkled strip in bending",
        setting="Prestress N₀ both ways, E t = 1e5 N₀, ν = 0.3; dead load N₀ on the long edges, the ends turned and stretched.",
        size_label="crossed squares over the height",
        sizes=(8, 16, 32),
        more_sizes=(64, 128),
        quantities=tuple(quantities),
        run=run,
        curve=Curve(
            x_label="E t h² κ / (2 P)",
            y_label="M / (P h)",
            x=np.concatenate(([0.0], 1.0 / (1.0 - bands) ** 2)),
            y=np.concatenate(([0.0], 1.0 / 6.0 + bands / 3.0)),
        ),
    )


def _strip_scene(
    size: int, stiffness: float, prestress: float, nu: float, centre: float, stages: list[dict[str, Any]]
) -> dict[str, Any]:
    """The strip, ``size`` crossed squares high, with its end turned about a point at the height ``centre``."""
    return {
        "mesh": {
            "shape": "panel", "width": 1.0, "height": 1.0, "along_x": size, "along_y": size, "pattern": "crossed",
        },
        "fabric": {"E": stiffness, "nu": nu, "thickness": 1.0, "prestress": [prestress, prestress, 0.0]},
        "groups": {"pin": {"where": "x = 0 within 1e-9 and y = 0.5 within 1e-9"}},
        "supports": [
            {"group": "all", "hold": "z"},
            {"group": "x_min", "hold": "x"},
            {"group": "pin", "hold": "y"},
        ],
        "loads": {
            "upper": {"kind": "line", "group": "y_max", "direction": [0.0, prestress, 0.0]},
            "lower": {"kind": "line", "group": "y_min", "direction": [0.0, -prestress, 0.0]},
        },
        "motions": {
            "end": {
                "kind": "rotation", "group": "x_max", "axis": [0.0, 0.0, -1.0], "through": [1.0, centre, 0.0], "hold": "x",
            }
        },
        "stages": stages,
        "probes": {
            "force": {"kind": "reaction", "group": "x_max", "component": "x"},
            "moment": {"kind": "moment", "group": "x_max", "axis": [0.0, 0.0, -1.0], "through": [1.0, 0.5, 0.0]},
        },
    }  # fmt: skip


def annulus() -> Benchmark:
    """A prestressed annulus between a hub that is turned and a fixed rim."""
    outer, nu, stiffness, prestress = 4.0, 0.3, 1e5, 1.0
    onset = (1.0 + nu) * prestress / stiffness * (1.0 - 1.0 / outer**2)
    turns = (1.0, 2.0, 3.0, 4.0, 5.0)  # over the onset of wrinkling

    def run(size: int) -> Solution:
        result = solve(
            {
                "mesh": {"shape": "annulus", "inner": 1.0, "outer": outer, "around": 4 * size, "rings": size},
                "fabric": {"E": stiffness, "nu": nu, "thickness": 1.0, "prestress": [prestress, prestress, 0.0]},
                "supports": [{"group": "all", "hold": "z"}, {"group": "outer", "hold": "xy"}],
                "motions": {
                    "hub": {
                        "kind": "rotation", "group": "inner", "axis": [0.0, 0.0, 1.0], "through": [0.0, 0.0, 0.0], "hold": "xy",
                    }
                },
                "stages": [
                    {"name": f"turn{number}", "motions": {"hub": float(np.rad2deg(turn * onset))}}
                    for number, turn in enumerate(turns)
                ],
                "probes": {
                    "torque": {"kind": "moment", "group": "inner", "axis": [0.0, 0.0, 1.0], "through": [0.0, 0.0, 0.0]},
                },
            }
        )  # fmt: skip
        torque = result.probe("torque") / (2.0 * np.pi * prestress)
        return Solution(
            values={f"torque at {turns[step]:g} times the onset": torque[step] for step in (0, 1, 4)},
            points=(np.array(turns), torque),
        )

    source = "Stein and Hedgepeth 1961 (turned hub), rim at a finite distance: equilibrium integrated and shot"
    angles = np.linspace(1.0, 5.0, 9)
    torques = turned_hub(list(angles * onset * stiffness / prestress), outer, nu)
    references = dict(zip(angles, torques, strict=True))
    return Benchmark(
        name="annulus",
        title="Annulus with a turned hub",
        setting="Radii 1 and 4, uniform prestress N₀, E t = 1e5 N₀, ν = 0.3; torque over that of the first wrinkle, 2π a² N₀.",
        size_label="rings",
        sizes=(8, 16, 32),
        more_sizes=(64, 128),
        quantities=tuple(
            Quantity(name=f"torque at {turn:g} times the onset", reference=references[turn], source=source, bound=0.005)
            for turn in (1.0, 2.0, 5.0)
        ),
        run=run,
        curve=Curve(
            x_label="angle / that of the first wrinkle",
            y_label="torque / that of the first wrinkle",
            x=np.concatenate(([0.0], angles)),
            y=np.concatenate(([0.0], torques)),
        ),
    )
