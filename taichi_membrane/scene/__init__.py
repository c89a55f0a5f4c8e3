"""What a run is: the scene models, and reading them from TOML."""

from __future__ import annotations

from taichi_membrane.scene.base import (
    Component,
    Vector,
)
from taichi_membrane.scene.drawing import Camera, Curve, CurveLine, CurveReference
from taichi_membrane.scene.fabric import Fabric
from taichi_membrane.scene.loads import AnyLoad, Load, Pressure, SnowLoad, WaterLoad, WeightLoad, WindLoad, WindTable
from taichi_membrane.scene.members import Cable, Plane, Spring
from taichi_membrane.scene.mesh_source import (
    AnnulusShape,
    ArchShape,
    CushionShape,
    DiscShape,
    GivenMesh,
    MeshFile,
    MeshSource,
    PanelShape,
    SphereShape,
    TubeShape,
    WedgeShape,
)
from taichi_membrane.scene.models import Check, Group, Scene, Units
from taichi_membrane.scene.probe import (
    AreaProbe,
    CableProbe,
    DisplacementProbe,
    FactorProbe,
    MomentProbe,
    Probe,
    RadiusProbe,
    ReactionProbe,
    ResultantProbe,
    RotationProbe,
    StressProbe,
    VolumeProbe,
)
from taichi_membrane.scene.solver import Modes, Solver
from taichi_membrane.scene.stage import Stage
from taichi_membrane.scene.support import (
    Components,
    Motion,
    Rotation,
    Support,
    Translation,
)

__all__ = [
    "AnnulusShape",
    "AnyLoad",
    "ArchShape",
    "AreaProbe",
    "Cable",
    "CableProbe",
    "Camera",
    "Check",
    "Component",
    "Components",
    "Curve",
    "CurveLine",
    "CurveReference",
    "CushionShape",
    "DiscShape",
    "DisplacementProbe",
    "Fabric",
    "FactorProbe",
    "GivenMesh",
    "Group",
    "Load",
    "MeshFile",
    "MeshSource",
    "Modes",
    "MomentProbe",
    "Motion",
    "PanelShape",
    "Plane",
    "Pressure",
    "Probe",
    "RadiusProbe",
    "ReactionProbe",
    "ResultantProbe",
    "Rotation",
    "RotationProbe",
    "Scene",
    "SnowLoad",
    "Solver",
    "SphereShape",
    "Spring",
    "Stage",
    "StressProbe",
    "Support",
    "Translation",
    "TubeShape",
    "Units",
    "Vector",
    "VolumeProbe",
    "WaterLoad",
    "WedgeShape",
    "WeightLoad",
    "WindLoad",
    "WindTable",
]
