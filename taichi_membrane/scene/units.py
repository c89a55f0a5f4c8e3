"""Units of a scene's named quantities, for column heads and plot labels."""

from __future__ import annotations

import math

from taichi_membrane import fields
from taichi_membrane.scene import FactorProbe, ResultantProbe, Scene, StressProbe, Translation


def probe_unit(scene: Scene, name: str) -> str:
    """Unit of a probe, of a stress with its measure; empty for a share."""
    units, probe = scene.units, scene.probes[name]
    if isinstance(probe, FactorProbe):
        kind, _, factor = probe.of.partition(".")
        if kind == "pressure":
            return units.stress
        return load_unit(scene, factor) if kind == "load" else motion_unit(scene, factor)
    if isinstance(probe, StressProbe | ResultantProbe):
        return fields.named(f"{probe.which}_{probe.kind}").unit_label(units)
    return {
        "displacement": units.length,
        "radius": units.length,
        "reaction": units.force,
        "moment": units.energy,
        "rotation": "°",
        "volume": units.volume,
        "area_share": "",
    }[probe.kind]


def load_unit(scene: Scene, name: str) -> str:
    """Unit of a load's factor; empty where the direction is no unit vector, so that the factor is a mere number."""
    load, units = scene.loads[name], scene.units
    if not math.isclose(math.hypot(*load.direction), 1.0, rel_tol=1e-6):
        return ""
    return units.force + {"total": "", "line": f"/{units.length}", "area": f"/{units.area}"}[load.kind]


def motion_unit(scene: Scene, name: str) -> str:
    """Unit of a motion's factor; empty where a translation's direction is no unit vector."""
    motion = scene.motions[name]
    if not isinstance(motion, Translation):
        return "°"
    return scene.units.length if math.isclose(math.hypot(*motion.direction), 1.0, rel_tol=1e-6) else ""
