"""Chambers and sags of given contents: a balloon past its largest pressure, a tube between plates, ponds on a strip and a disc."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Quantity, Solution, solve
from taichi_membrane.mesh import Mesh


def balloon() -> Benchmark:
    """A sphere of a linear fabric by engineering strain, filled by amount of gas to three times its size."""
    ambient, nu, stretches = 1.0, 0.3, (1.5, 3.0)
    source = "p = 2 E t (λ - 1)/((1 - ν) R λ²), largest at λ = 2; p_abs V = p_out A"
    pressures = [closed_forms.balloon_pressure(stretch, nu) for stretch in stretches]

    def run(size: int) -> Solution:
        held = {f"{axis}_zero": f"{axis} = 0 within 1e-9" for axis in "xyz"}
        amounts = [4.0 / 3.0 * math.pi * s**3 * (1.0 + p / ambient) for s, p in zip(stretches, pressures, strict=True)]
        result = solve(
            {
                "mesh": {"shape": "sphere", "radius": 1.0, "divisions": size},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0, "side_strain": "engineering"},
                "groups": {name: {"where": where} for name, where in held.items()},
                "supports": [{"group": name, "hold": name[0]} for name in held],
                "pressures": {"gas": {"ambient": ambient}},
                "stages": [
                    {"name": "half", "amount": amounts[0], "steps": 2},
                    {"name": "full", "amount": amounts[1], "steps": 3},
                ],
                "probes": {"radius": {"kind": "radius", "group": "all", "axis": "centre"}},
            }
        )
        radius, pressure = result.probe("radius"), [step.pressures["gas"] for step in result.steps]
        return Solution(
            values={
                "stretch, before the largest pressure": radius[1],
                "pressure, before the largest": pressure[1],
                "stretch, beyond it": radius[-1],
                "pressure, beyond it": pressure[-1],
            }
        )

    references = [stretches[0], pressures[0], stretches[1], pressures[1]]
    names = [
        "stretch, before the largest pressure",
        "pressure, before the largest",
        "stretch, beyond it",
        "pressure, beyond it",
    ]
    return Benchmark(
        name="balloon",
        title="Balloon filled by amount",
        setting="Linear sphere (engineering strain), ν = 0.3, E t/R equal to the pressure outside, filled to stretches 1.5 and 3.",
        size_label="elements along a quarter of a great circle",
        sizes=(6, 12, 24),
        more_sizes=(48,),
        quantities=tuple(
            Quantity(name=name, reference=reference, source=source, bound=0.01)
            for name, reference in zip(names, references, strict=True)
        ),
        run=run,
    )


def plates() -> Benchmark:
    """A tube full of shut gas, squeezed between frictionless plates to half its diameter."""
    gap, ambient, first = 1.0, 10.0, 1.0
    flat = 0.5 * math.pi * (2.0 - gap)
    # Areas of the free tube and of the stadium.
    pressure = (first + ambient) * math.pi / (flat * gap + 0.25 * math.pi * gap**2) - ambient

    def run(size: int) -> Solution:
        result = solve(plates_scene(gap, first, ambient), squeezed_tube(gap, size))
        step = result.steps[-1]
        return Solution(
            values={
                "pressure": step.pressures["gas"],
                "force per length": step.contact_forces["top"] / TUBE_LENGTH,
                "tension": float(np.median(step.elements.major_resultant[: 2 * size])),
            }
        )

    source = "stadium of an inextensible tube: F = p b, b = π (2 R - h)/2, T = p h/2, p_abs V kept"
    return Benchmark(
        name="plates",
        title="Shut tube between plates",
        setting="Inextensible tube of radius 1 with gas of 1 above 10 outside, pressed to a height of 1 by frictionless planes.",
        size_label="elements around",
        sizes=(40, 80, 160),
        more_sizes=(320,),
        quantities=(
            Quantity(name="pressure", reference=pressure, source=source, bound=0.003),
            Quantity(name="force per length", reference=pressure * flat, source=source, bound=0.003),
            Quantity(name="tension", reference=0.5 * pressure * gap, source=source, bound=0.003),
        ),
        run=run,
    )


TUBE_LENGTH = 0.2


def plates_scene(gap: float, first: float, ambient: float) -> dict[str, Any]:
    """A tube of :func:`squeezed_tube` between its plates with the gas that makes the pressure ``first`` in it when it is round."""
    down = [0.0, 0.0, -1.0]
    return {
        "mesh": {"shape": "given"},
        "fabrics": {
            "wall": {"E": 1e6, "nu": 0.0, "thickness": 1.0, "law": "none"},
            "ends": {"E": 1e-6, "nu": 0.0, "thickness": 1.0, "law": "none"},  # a lid that bears nothing across
        },
        "planes": {
            "floor": {"through": [0.0, 0.0, -0.5 * gap], "normal": [0.0, 0.0, 1.0]},
            "top": {"through": [0.0, 0.0, 0.5 * gap], "normal": down},
        },
        "supports": [
            {"group": "all", "hold": "x"},
            {"group": "middles", "hold": "yz"},
            {"group": "axis", "hold": "y"},
        ],
        "pressures": {"gas": {"ambient": ambient}},
        "stages": [
            {"name": "blow", "pressure": first},
            {"name": "fill", "amount": math.pi * TUBE_LENGTH * (first + ambient) / ambient},
        ],
    }


def squeezed_tube(gap: float, around: int) -> Mesh:
    """A short tube of perimeter 2 π along x with lids, its cross-section a stadium of the height ``gap`` about z = 0.

    What is inextensible and does not resist bending has no shape of its own: the stadium is the round tube, squeezed.
    """
    flat, half = 0.5 * math.pi * (2.0 - gap), 0.5 * math.pi * gap
    section = np.zeros((around, 2))
    for k in range(around):
        side, rest = divmod(2.0 * math.pi * k / around, math.pi)
        turn = 1.0 if side == 0.0 else -1.0
        angle = 2.0 * min(rest, half) / gap
        across = 0.5 * flat + 0.5 * gap * math.sin(angle) - max(rest - half, 0.0)
        section[k] = turn * across, -turn * 0.5 * gap * math.cos(angle)
    rings = [np.column_stack([np.full(around, x), section]) for x in (0.0, TUBE_LENGTH)]
    points = np.concatenate([*rings, [[0.0, 0.0, 0.0], [TUBE_LENGTH, 0.0, 0.0]]])
    n, here = around, np.arange(around)
    following = (here + 1) % n
    halves = np.column_stack([here, following, n + here]), np.column_stack([following, n + following, n + here])
    wall = np.stack(halves, axis=1).reshape(-1, 3)
    lids = [
        np.column_stack([following, here, np.full(n, 2 * n)]),
        np.column_stack([n + here, n + following, np.full(n, 2 * n + 1)]),
    ]
    triangles = np.concatenate([wall, *lids])
    nodes = {"middles": np.array([2 * n, 2 * n + 1]), "axis": np.flatnonzero(np.abs(points[:, 1]) < 1e-9)}
    elements = {"wall": np.arange(2 * n), "ends": np.arange(2 * n, 4 * n)}
    return Mesh.build(points, triangles, nodes, elements)


def pond() -> Benchmark:
    """A volume of water on a taut strip, below and above the weight at which a held level runs away."""
    volume, width, weights = 1e-4, 0.1, (2.5**2, 6.0**2)
    exact = [closed_forms.strip_pond(weight, volume) for weight in weights]

    def run(size: int) -> Solution:
        values: dict[str, float] = {}
        for weight, (above, _) in zip(weights, names, strict=True):
            result = solve(
                {
                    "mesh": {"shape": "panel", "width": 1.0, "height": width, "along_x": size, "along_y": 2},
                    "fabric": {"E": 1e-3, "nu": 0.0, "thickness": 1.0, "law": "none", "prestress": [1.0, 1.0, 0.0]},
                    "groups": {"left": {"where": "x = 0 within 1e-9"}, "right": {"where": "x = 1 within 1e-9"},
                               "middle": {"where": "x = 0.5 within 1e-9"}},
                    "supports": [
                        {"group": "left", "hold": "xyz"}, {"group": "right", "hold": "xyz"}, {"group": "all", "hold": "y"},
                    ],
                    "pressures": {},
                    "loads": {"rain": {"kind": "water", "specific_weight": weight, "given": "volume", "face": "front"}},
                    "stages": [{"name": "rain", "loads": {"rain": volume * width}}],
                    "probes": {"level": {"kind": "level", "load": "rain"},
                               "middle": {"kind": "displacement", "group": "middle", "component": "z"}},
                    "solver": {"tolerance": 1e-9},
                }
            )  # fmt: skip
            last = result.steps[-1].probes
            values |= {f"level, {above}": last["level"], f"sag, {above}": -last["middle"]}
        return Solution(values=values)

    names = (("γ L²/T = 6.25", 0), ("γ L²/T = 36", 1))
    sources = (
        "T d'' = -γ d with d = h at the ends (walls above them)",
        "T d'' = -γ d over a pond π √(T/γ) wide, straight beside it",
    )
    quantities = []
    for (above, k), source in zip(names, sources, strict=True):
        quantities.append(Quantity(name=f"level, {above}", reference=exact[k][0], source=source, bound=0.005))
        quantities.append(Quantity(name=f"sag, {above}", reference=exact[k][1], source=source, bound=0.005))
    return Benchmark(
        name="pond",
        title="A volume of water on a taut strip",
        setting="Weightless strip of span 1 and tension 1 per width under 0.0001 of water per width; a held level runs away at π².",
        size_label="elements along the strip",
        sizes=(16, 32, 64),
        more_sizes=(128,),
        quantities=tuple(quantities),
        run=run,
    )
