"""Parametric triangulations: tube, arch, sphere, disc, panel, cushion, annulus, wedge; tents on arches, mattresses."""

from __future__ import annotations

from taichi_membrane.shapes.cells import mattress
from taichi_membrane.shapes.grid import cushion, panel
from taichi_membrane.shapes.round import arch, disc, sphere, tube
from taichi_membrane.shapes.sector import annulus, wedge
from taichi_membrane.shapes.tent import arch_tent

__all__ = ["annulus", "arch", "arch_tent", "cushion", "disc", "mattress", "panel", "sphere", "tube", "wedge"]
