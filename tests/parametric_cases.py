"""A small tube that bends, for tests of sweeps and fits: linear enough to be foretold, quick enough to be run many times."""

from __future__ import annotations

from pathlib import Path

TUBE = """
name = "stub"
units = { length = "mm", force = "N" }
[mesh]
shape = "tube"
radius = 25.0
length = 100.0
around = 8
along = 6
cap_end = "flat"
[fabric]
E_warp = 4000.0
E_weft = 4000.0
nu = 0.1
G = 1000.0
thickness = 0.1
[[supports]]
group = "start"
hold = "xyz"
[loads.tip]
group = "end"
direction = [0.0, 0.0, -1.0]
[[stages]]
name = "inflate"
pressure = 0.035
[[stages]]
name = "load"
steps = 2
loads = { tip = 6.0 }
[probes.deflection]
kind = "displacement"
group = "end"
component = "z"
[probes.root]
kind = "reaction"
group = "start"
component = "z"
[curve]
x = "deflection"
y = "load.tip"
x_scale = -1.0
"""


def tube(folder: Path) -> Path:
    """The scene file of the tube."""
    path = folder / "stub.toml"
    path.write_text(TUBE)
    return path
