"""Units of a scene's named quantities, for column heads and plot labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_membrane import fields
from taichi_membrane.scene.drivers import driver_unit
from taichi_membrane.scene.probe import (
    BodyProbe,
    CableProbe,
    ContactProbe,
    DrainageProbe,
    FactorProbe,
    ResultantProbe,
    StressProbe,
)

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


def probe_unit(scene: Scene, name: str) -> str:
    """Unit of a probe, of a stress with its measure; empty for a share."""
    units, probe = scene.units, scene.probes[name]
    if isinstance(probe, FactorProbe):
        return driver_unit(scene, probe.of)
    if isinstance(probe, ResultantProbe) and probe.measure == "PK2":
        return f"{units.resultant} PK2"
    if isinstance(probe, StressProbe | ResultantProbe):
        return fields.named(f"{probe.which}_{probe.kind}").unit_label(scene.field_units)
    if isinstance(probe, CableProbe):
        return {"force": units.force, "length": units.length, "slack": ""}[probe.what]
    kind = probe.of if isinstance(probe, BodyProbe | ContactProbe | DrainageProbe) else probe.kind
    return {
        "displacement": units.length,
        "position": units.length,
        "radius": units.length,
        "reaction": units.force,
        "force": units.force,
        "moment": units.energy,
        "rotation": "°",
        "slope": "°",
        "depth": units.length,
        "volume": units.volume,
        "absolute_pressure": units.stress,
        "level": units.length,
        "area_share": "",
        "utilisation": "",
        "area": units.area,
        "pressure": units.stress,
    }[kind]
