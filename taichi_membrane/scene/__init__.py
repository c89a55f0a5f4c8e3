"""What a run is: the scene models, and reading them from TOML."""

from __future__ import annotations

from taichi_membrane.scene.base import (
    Component,
    Vector,
)
from taichi_membrane.scene.drawing import Camera, Curve, CurveLine, CurveReference
from taichi_membrane.scene.element_field import ElementField, WarpSource
from taichi_membrane.scene.fabric import Fabric
from taichi_membrane.scene.growth import Shrinkage, Temperature
from taichi_membrane.scene.loads import AnyLoad, Load, Pressure, SnowLoad, WaterLoad, WeightLoad, WindLoad, WindTable
from taichi_membrane.scene.members import Cable, Plane
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
    "ElementField",
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
    "Shrinkage",
    "SnowLoad",
    "Solver",
    "SphereShape",
    "Stage",
    "StressProbe",
    "Support",
    "Temperature",
    "Translation",
    "TubeShape",
    "Units",
    "Vector",
    "VolumeProbe",
    "WarpSource",
    "WaterLoad",
    "WedgeShape",
    "WeightLoad",
    "WindLoad",
    "WindTable",
]
