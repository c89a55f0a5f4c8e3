"""A sheet that two of its edges stretch alike everywhere: strains that hands can calculate."""

from __future__ import annotations

from typing import Any


def pulled(width: float, height: float) -> dict[str, Any]:
    """Supports and motions of a panel whose edges ``x_max`` and ``y_max`` move out as ``wide`` and ``high``."""
    held = (("x_min", "x"), ("y_min", "y"), ("all", "z"))
    moved = (("wide", "x_max", [1, 0, 0], "x"), ("high", "y_max", [0, 1, 0], "y"))
    return {
        "mesh": {"shape": "panel", "width": width, "height": height},
        "supports": [{"group": group, "hold": hold} for group, hold in held],
        "motions": {
            name: {"kind": "translation", "group": group, "direction": way, "hold": hold}
            for name, group, way, hold in moved
        },
        "pressures": {},
    }


def out(width: float, height: float, stretch: tuple[float, float]) -> dict[str, float]:
    """Values of the two motions at these stretches."""
    return {"wide": (stretch[0] - 1) * width, "high": (stretch[1] - 1) * height}
