"""Shapes found for a given stress: a film between rings from a tube, a bubble over a ring."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Quantity, Solution, solve

# Shapes do not depend on the moduli; the fabric takes up with them what the mesh leaves within the surface.
_FABRIC = {"E": 400.0, "nu": 0.3, "thickness": 1.0, "prestress": [1.0, 1.0, 0.0]}
_FORM = {"name": "form", "kind": "form_find"}


def found_film() -> Benchmark:
    """A film between two rings, near the largest distance that it spans, found from a tube."""
    half = 0.6
    neck = closed_forms.catenoid_neck(half)

    def run(size: int) -> Solution:
        mesh = shapes.tube(radius=1.0, length=2.0 * half, around=4 * size, along=size, cap_end="none")
        result = solve(
            {
                "mesh": {"shape": "given"},
                "fabric": _FABRIC,
                "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "hold": "xyz"}],
                "stages": [_FORM],
                "probes": {
                    "neck": {"kind": "radius", "group": "middle", "axis": "x"},
                    "pull": {"kind": "reaction", "group": "end", "component": "x"},
                },
            },
            mesh,
        )
        return Solution(values={"neck radius": result.probe("neck")[-1], "axial force": result.probe("pull")[-1]})

    return Benchmark(
        name="found_film",
        title="Film between rings, found from a tube",
        setting="Two rings of unit radius 1.2 radii apart (a film spans 1.3255 at most), form finding for the uniform stress N₀.",
        size_label="elements along",
        sizes=(8, 16, 32),
        more_sizes=(64,),
        quantities=(
            Quantity(name="neck radius", reference=neck, source="R = c cosh(h/c)", bound=0.005),
            Quantity(name="axial force", reference=2.0 * math.pi * neck, source="2π c N₀", bound=0.005),
        ),
        run=run,
    )


def bubble() -> Benchmark:
    """A bubble over a ring, found from a disc."""
    pressure = 1.6
    radius = 2.0 / pressure
    rise = radius - math.sqrt(radius**2 - 1.0)

    def run(size: int) -> Solution:
        mesh = shapes.disc(radius=1.0, rings=size)
        result = solve(
            {
                "mesh": {"shape": "given"},
                "fabric": _FABRIC | {"warp": [1.0, 0.0, 0.0]},
                "supports": [{"group": "rim", "hold": "xyz"}],
                "stages": [_FORM | {"pressure": pressure}],
            },
            mesh,
        )
        corners = result.mesh.points[mesh.triangles]
        under = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2.0
        return Solution(
            values={
                "rise": float(result.mesh.points[:, 2].max()),
                "volume": float(under @ corners[:, :, 2].mean(axis=1)),
            }
        )

    return Benchmark(
        name="bubble",
        title="Bubble over a ring",
        setting="Form finding for the uniform stress N₀ under p = 1.6 N₀/a over a ring of radius a, from a flat disc.",
        size_label="rings",
        sizes=(8, 16, 32),
        more_sizes=(64,),
        quantities=(
            Quantity(name="rise", reference=rise, source="p R = 2 N₀", bound=0.002),
            Quantity(
                name="volume",
                reference=math.pi * rise**2 * (3.0 * radius - rise) / 3.0,
                source="p R = 2 N₀",
                bound=0.005,
            ),
        ),
        run=run,
    )
