"""Parametric triangulations: tube, arch, sphere, disc, panel, cushion, annulus, wedge."""

from __future__ import annotations

from taichi_membrane.shapes.grid import cushion, panel
from taichi_membrane.shapes.round import arch, disc, sphere, tube
from taichi_membrane.shapes.sector import annulus, wedge

__all__ = ["annulus", "arch", "cushion", "disc", "panel", "sphere", "tube", "wedge"]
