"""Parametric triangulations: tube, arch, sphere, disc, panel, cushion, annulus, wedge; and of what people build, tents, mattresses,
sails, cones, panels with yarns, bags, balloons, hulls."""

from __future__ import annotations

from taichi_membrane.shapes.bags import airbag, water_tube
from taichi_membrane.shapes.balloons import pumpkin
from taichi_membrane.shapes.cells import mattress
from taichi_membrane.shapes.grid import cushion, panel
from taichi_membrane.shapes.hull import hull
from taichi_membrane.shapes.round import arch, disc, sphere, tube
from taichi_membrane.shapes.sails import cone, hypar
from taichi_membrane.shapes.sector import annulus, wedge
from taichi_membrane.shapes.stitched import drop_stitch
from taichi_membrane.shapes.tent import arch_tent
from taichi_membrane.shapes.true_surface import place_of

__all__ = [
    "airbag",
    "annulus",
    "arch",
    "arch_tent",
    "cone",
    "cushion",
    "disc",
    "drop_stitch",
    "hull",
    "hypar",
    "mattress",
    "panel",
    "place_of",
    "pumpkin",
    "sphere",
    "tube",
    "water_tube",
    "wedge",
]
