"""What a run is: mesh, fabrics, supports, stages of pressure and loads, probes, checks, camera.

A scene is data: the models of this folder, made in Python or read from TOML by :mod:`taichi_membrane.scene.file`. Reading one
runs no code. All quantities are in the scene's own consistent units (:class:`Units`); pressure is positive along the normals of
counter-clockwise triangles, for a closed body outwards.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, model_validator

from taichi_membrane import fields
from taichi_membrane.scene import adapt, case, combination, drivers, forming, order, texts, valves
from taichi_membrane.scene.base import MOST, Label, Name, Place, Record
from taichi_membrane.scene.case import Case
from taichi_membrane.scene.check import Check
from taichi_membrane.scene.combination import Combinations
from taichi_membrane.scene.drawing import Camera, Curve
from taichi_membrane.scene.element_field import ElementField
from taichi_membrane.scene.fabric import Fabric
from taichi_membrane.scene.growth import Shrinkage, Temperature
from taichi_membrane.scene.loads import AnyLoad, BodyLoad, Pressure, SnowLoad, WaterLoad, WeightLoad
from taichi_membrane.scene.members import Cable, Plane, Spring
from taichi_membrane.scene.mesh_source import MeshSource
from taichi_membrane.scene.obstacles import WALLS, Obstacle, WallContact
from taichi_membrane.scene.probe import (
    DIFFERENTIABLE,
    AbsoluteProbe,
    BodyProbe,
    CableProbe,
    ContactProbe,
    FactorProbe,
    LevelProbe,
    Probe,
)
from taichi_membrane.scene.solver import Modes, Solver
from taichi_membrane.scene.stage import Stage
from taichi_membrane.scene.support import Body, BodyRotation, BodyTranslation, Motion, Support
from taichi_membrane.scene.unit_names import FieldUnits, Units

_FEW = Field(max_length=MOST)


class Group(Record):
    """A named group chosen by coordinates, such as ``"x = 0 within 1e-6 and z > 3"``."""

    where: Annotated[str, Field(max_length=1000)]
    """Condition on coordinates, such as ``x = 0 within 1e-6 and z > 3``; elements belong by their centroid."""
    kind: Literal["nodes", "elements"] = "nodes"
    """Whether it names nodes or elements."""


class Scene(Record):
    """Everything a run needs."""

    name: Name
    """Name of the scene, and of its output folder."""
    title: Label = ""
    """Title of pictures and tables."""
    description: str = ""
    """What it is about, for the reader of the file."""
    units: Units
    """The consistent units of all its numbers."""
    mesh: MeshSource
    """Parametric shape, file, or ``given`` as an object."""
    groups: Annotated[dict[Name, Group], _FEW] = {}
    """Groups chosen by coordinates, beside those of the mesh."""
    fabric: Fabric | None = None
    """Fabric of all elements that no entry of ``fabrics`` names."""
    fabrics: Annotated[dict[Name, Fabric], _FEW] = {}
    """Fabric of each element group."""
    cables: Annotated[dict[Name, Cable], _FEW] = {}
    """Cables and bars by name."""
    anchors: Annotated[dict[Name, Place], _FEW] = {}
    """Points of the ground that cables end at [length], each a node group of its name, held in x, y and z."""
    joints: Annotated[dict[Name, Place], _FEW] = {}
    """Free points where cables meet [length], such as pulleys, each a node group of its name."""
    springs: Annotated[dict[Name, Spring], _FEW] = {}
    """Springs from nodes to the ground, by name."""
    planes: Annotated[dict[Name, Plane], Field(max_length=8)] = {}
    """Planes that nodes touch and do not pass, by name."""
    obstacles: Annotated[dict[Name, Obstacle], Field(max_length=8)] = {}
    """Spheres, cylinders, boxes, surfaces and planes that nodes touch and do not pass, and that stages may move, by name."""
    contact: WallContact | None = None
    """Which walls touch each other; without it they pass through each other."""
    bodies: Annotated[dict[Name, Body], _FEW] = {}
    """Node groups that move as rigid bodies, by name."""
    supports: Annotated[list[Support], _FEW] = []
    """What is held."""
    pressures: Annotated[dict[Name, Pressure], _FEW] = {"inside": Pressure()}
    """Pressures by name; without any, one named ``inside`` on all elements."""
    loads: Annotated[dict[Name, AnyLoad], _FEW] = {}
    """Loads of unit factor by name."""
    motions: Annotated[dict[Name, Motion], _FEW] = {}
    """Prescribed motions of unit factor by name."""
    shrinkages: Annotated[dict[Name, Shrinkage], _FEW] = {}
    """Shrinkages of unit factor by name."""
    temperatures: Annotated[dict[Name, Temperature], _FEW] = {}
    """Changes of temperature by name."""
    stages: Annotated[list[Stage], Field(min_length=1, max_length=MOST)]
    """Ramps of pressures, loads and motions, one after another."""
    cases: Annotated[list[Case], _FEW] = []
    """Load cases, each from the end of a stage and independent of one another."""
    combinations: Annotated[list[Combinations], _FEW] = []
    """Rules that make load cases of others; once read, their cases stand in ``cases``."""
    probes: Annotated[dict[Name, Probe], _FEW] = {}
    """What is measured at every load step, by name."""
    checks: Annotated[list[Check], _FEW] = []
    """Probe values against references."""
    derivatives: Annotated[list[Name], _FEW] = []
    """Probes to differentiate with respect to each load, pressure and thickness."""
    modes: Modes | None = None
    """Vibration or buckling modes to compute."""
    curve: Curve | None = None
    """What ``curve.png`` plots."""
    camera: Camera = Camera()
    """How pictures look."""
    solver: Solver = Solver()
    """How equilibrium is found."""

    @model_validator(mode="wrap")
    @classmethod
    def _in_its_units(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Convert texts with a unit, such as ``"35 kPa"``."""
        with texts.units_of(data):
            scene = handler(data)
        texts.check_dimensions(scene, data)
        return scene

    @model_validator(mode="after")
    def _references(self) -> Self:
        names = [stage.name for stage in self.stages]
        if len(set(names)) != len(names):
            raise ValueError(f"stages: two stages have one name: {', '.join(names)}")
        combination.expand(self)
        case.check(self)
        names += [one.name for one in self.cases]
        forming.check(self)
        valves.check(self)
        for stage in self.ramps:
            if stage.control == "arc_length" and self.solver.kind == "relaxation":
                raise ValueError(f"{stage.key}.control = 'arc_length' needs solver.kind 'hybrid' or 'newton'")
            for kind in drivers.DRIVERS:
                for name in kind.asked(stage, ()):
                    _known(name, kind.allowed(self), f"{stage.key}.{kind.key}", f"a {kind.name}")
        for number, check in enumerate(self.checks, 1):
            _known(check.probe, self.probes, f"checks[{number}].probe", "a probe")
            _known(check.stage, names, f"checks[{number}].stage", "a stage or case" if self.cases else "a stage")
            steps = self.ramp(check.stage).steps
            if not (1 <= check.step <= steps or -steps <= check.step <= -1):
                raise ValueError(f"checks[{number}].step = {check.step}, but stage {check.stage!r} has {steps} steps")
        for number, probe_name in enumerate(self.derivatives, 1):
            _known(probe_name, self.probes, f"derivatives[{number}]", "a probe")
            if self.probes[probe_name].kind not in DIFFERENTIABLE:
                raise ValueError(
                    f"derivatives[{number}]: probe {probe_name!r} is of kind {self.probes[probe_name].kind!r}; "
                    f"derivatives exist for {', '.join(DIFFERENTIABLE)}"
                )
        if self.modes is not None and self.modes.kind == "vibration":
            self._check_masses("modes.kind = 'vibration'")
        for load_name, load in self.loads.items():
            if isinstance(load, WeightLoad):
                self._check_masses(f"loads.{load_name}")
        self._check_fabrics()
        self._check_snow()
        self._check_expansion()
        self.check_picture(self.camera.field)
        if self.modes is not None and self.modes.stage is not None:
            _known(self.modes.stage, names, "modes.stage", "a stage")
        if (self.modes is not None or self.derivatives) and self.solver.kind == "relaxation":
            raise ValueError("modes and derivatives need the tangent of solver.kind 'hybrid' or 'newton'")
        self._check_contact()
        self._check_cable_points()
        self._check_bodies()
        if self.curve is not None:
            allowed = [*self.probes, "volume", "pressure", *drivers.driver_names(self)]
            _known(self.curve.x, allowed, "curve.x", "a quantity")
            _known(self.curve.y, allowed, "curve.y", "a quantity")
            if self.curve.stage is not None:
                _known(self.curve.stage, names, "curve.stage", "a stage")
        for name, probe in self.probes.items():
            if isinstance(probe, FactorProbe):
                _known(probe.of, drivers.driver_names(self), f"probes.{name}.of", "a factor")
            elif isinstance(probe, CableProbe):
                _known(probe.cable, self.cables, f"probes.{name}.cable", "a cable")
            elif isinstance(probe, AbsoluteProbe):
                gases = drivers.kind_named("amount").allowed(self)
                _known(probe.pressure, gases, f"probes.{name}.pressure", "a follower pressure with ambient")
            elif isinstance(probe, LevelProbe):
                waters = [key for key, load in self.loads.items() if isinstance(load, WaterLoad)]
                _known(probe.load, waters, f"probes.{name}.load", "a load of kind 'water'")
        if self.fabric is None and not self.fabrics:
            raise ValueError("fabric: a scene needs [fabric], or [fabrics.GROUP] for each element group")
        return self

    @model_validator(mode="after")
    def _six_nodes(self) -> Self:
        order.check(self)
        adapt.check(self)
        return self

    @property
    def ramps(self) -> list[Stage]:
        """The stages, and after them the cases as the stages that they are solved as."""
        return [*self.stages, *(case.stage_of(self, one) for one in self.cases)]

    def without_cases(self) -> Scene:
        """The stages alone, with what belongs to them."""
        if not self.cases:
            return self
        names = [stage.name for stage in self.stages]
        curve = self.curve if self.curve is None or self.curve.stage in (None, *names) else None
        modes = self.modes if self.modes is None or self.modes.stage in (None, *names) else None
        checks = [check for check in self.checks if check.stage in names]
        return self.model_copy(update={"cases": [], "checks": checks, "curve": curve, "modes": modes})

    def start_of(self, one: Case) -> str:
        """Name of the stage at whose end a case starts."""
        return one.after or self.stages[-1].name

    def before(self, ramp: Stage) -> list[Stage]:
        """The stages that lead to the start of a stage or case."""
        names = [stage.name for stage in self.stages]
        if ramp.name in names:
            return self.stages[: names.index(ramp.name)]
        one = next(one for one in self.cases if one.name == ramp.name)
        return self.stages[: names.index(self.start_of(one)) + 1]

    def ramp(self, name: str) -> Stage:
        """The stage or case of a name."""
        return next(one for one in self.ramps if one.name == name)

    @property
    def order(self) -> int:
        """1 where the mesh has three-node triangles, 2 where six-node ones."""
        return getattr(self.mesh, "order", 1)

    @property
    def samples(self) -> int:
        """Points of each triangle at which strain is sampled."""
        return getattr(self.mesh, "points", 1) if self.order == 2 else 1

    @property
    def extra_fields(self) -> tuple[str, ...]:
        """Names of the optional fields that its runs have: what differs by element, stress-free strain, contact."""
        fabrics = self._fabrics.values()
        has = {
            "thickness": any(isinstance(one.thickness, ElementField) for one in fabrics),
            "prestress": any(isinstance(one.given_prestress, ElementField) for one in fabrics),
            "utilisation": any(one.has_strength for one in fabrics),
            "free_strain": bool(self.shrinkages or self.temperatures),
            "contact_force": bool(self.touchable),
            "contact_pressure": bool(self.touchable),
            **dict.fromkeys(fields.AT_POINTS, self.order == 2),
        }
        return tuple(name for name, there in has.items() if there)

    def check_picture(self, name: str) -> None:
        """Refuse a field that pictures can show, but not of this scene."""
        if fields.named(name).optional and name not in self.extra_fields:
            needs = {
                "thickness": "a thickness by element data", "prestress": "a prestress by element data",
                "free_strain": "shrinkages or temperatures", "utilisation": "a fabric with a strength",
            }  # fmt: skip
            raise ValueError(f"camera.field: {name!r} needs {needs.get(name, 'planes or obstacles')} in the scene")

    @property
    def per_width(self) -> bool:
        """Whether its fabrics are given by forces per width, so that their stresses are per width as well."""
        return any(one.per_width for one in self._fabrics.values())

    @property
    def field_units(self) -> FieldUnits:
        """Labels of the units of its fields."""
        return FieldUnits(self.units, self.per_width)

    @property
    def _fabrics(self) -> dict[str, Fabric]:
        """All fabrics, by their keys."""
        default = {} if self.fabric is None else {"fabric": self.fabric}
        return default | {f"fabrics.{name}": one for name, one in self.fabrics.items()}

    def _check_fabrics(self) -> None:
        """Refuse fabrics of which some have a thickness and some are given per width."""
        ways: dict[bool, str] = {}
        for key, fabric in self._fabrics.items():
            ways.setdefault(fabric.per_width, key)
        if len(ways) == 2:
            raise ValueError(
                f"{ways[True]} is given per width and {ways[False]} with a thickness, so that their stresses are not of one kind; "
                "give all fabrics in one way: per width E times thickness is stiffness"
            )

    def _check_masses(self, user: str) -> None:
        """Refuse a fabric without a mass."""
        for name, fabric in self._fabrics.items():
            if not fabric.has_mass:
                key = "mass_per_area is missing" if fabric.per_width else "density is missing (or mass_per_area)"
                raise ValueError(f"{name}.{key}: {user} needs it")

    def _check_snow(self) -> None:
        """Refuse loads per plan area of two directions."""
        found = [(name, load.direction) for name, load in self.loads.items() if isinstance(load, SnowLoad)]
        for name, direction in found[1:]:
            sizes = [math.hypot(*vector) for vector in (found[0][1], direction)]
            unit = [
                [part / size for part in vector] for vector, size in zip((found[0][1], direction), sizes, strict=True)
            ]
            if math.dist(*unit) > 1e-12:
                raise ValueError(
                    f"loads.{name}.direction = {list(direction)}, but loads.{found[0][0]}.direction = {list(found[0][1])}; "
                    "all loads per plan area of a scene have one direction"
                )

    def _check_expansion(self) -> None:
        """Refuse a temperature that nothing answers to."""
        fabrics = self._fabrics.values()
        if self.temperatures and not any(any(fabric.expansion) for fabric in fabrics):
            name = next(iter(self.temperatures))
            raise ValueError(f"temperatures.{name}: no fabric has an expansion; give fabric.expansion = [warp, weft]")

    def _check_contact(self) -> None:
        """Refuse what takes the tangent in contact for that of the structure: it holds springs, where obstacles are rigid."""
        for name in self.obstacles:
            if name in self.planes:
                raise ValueError(f"obstacles.{name}: planes.{name} has the name already")
        for table in ("planes", "obstacles"):
            if self.contact is not None and WALLS in getattr(self, table):
                raise ValueError(f"{table}.{WALLS}: contact of walls with each other has the name already")
        for name, probe in self.probes.items():
            if isinstance(probe, ContactProbe):
                _known(probe.obstacle, self.touchable, f"probes.{name}.obstacle", "a plane or an obstacle")
        if self.touchable:
            told = f"is not implemented for a scene with {self._touched_words}"
            if self.derivatives or self.modes is not None:
                raise ValueError(f"{'derivatives' if self.derivatives else 'modes'} {told}")
            for stage in self.stages:
                if stage.control == "arc_length" or stage.until in ("collapse", "collapse_or_target"):
                    key = "control = 'arc_length'" if stage.control == "arc_length" else f"until = {stage.until!r}"
                    raise ValueError(f"{stage.key}.{key} {told}")

    def _check_cable_points(self) -> None:
        """Refuse points of cables that no cable uses, and a name that two have."""
        for table, points in (("anchors", self.anchors), ("joints", self.joints)):
            for name in points:
                if table == "joints" and name in self.anchors:
                    raise ValueError(f"joints.{name}: anchors.{name} has the name already")
                if not any(name in (cable.nodes or ()) for cable in self.cables.values()):
                    raise ValueError(f"{table}.{name}: no cable has it among its nodes")

    def _check_bodies(self) -> None:
        """Refuse bodies that are not there, and what is not implemented with them."""
        for table in ("loads", "motions", "probes"):
            for name, item in getattr(self, table).items():
                if isinstance(item, BodyLoad | BodyTranslation | BodyRotation | BodyProbe):
                    _known(item.body, self.bodies, f"{table}.{name}.body", "a body")
        if self.bodies:
            told = "is not implemented for a scene with bodies"
            if self.touchable:
                raise ValueError(f"{self._touched_words}: contact {told}")
            if self.modes is not None and self.modes.kind == "vibration":
                raise ValueError(f"modes.kind = 'vibration' {told}, which have no masses")

    @property
    def _touched_words(self) -> str:
        return "planes" if self.planes else "obstacles" if self.obstacles else WALLS

    @property
    def forms(self) -> bool:
        """Whether the rest shape is found by the first stage."""
        return self.stages[0].kind == "form_find"

    @property
    def touchable(self) -> list[str]:
        """Names of all planes and obstacles, in the order in which results have them; last that of walls that touch each other."""
        return [*self.planes, *self.obstacles, *([] if self.contact is None else [WALLS])]

    @property
    def holding(self) -> list[tuple[str, str]]:
        """Group of nodes and what is held or prescribed, in words, of each support, body and motion."""
        found = [
            (one.group, f"held in {one.hold}" if one.hold else f"held along {one.normal}") for one in self.supports
        ]
        found += [(name, f"rigid, held {one.told}") for name, one in self.bodies.items() if one.told]
        found += [(one.group, f"motion {name}: {one.kind} in {one.hold}") for name, one in self.motions.items()]
        found += [(name, "anchor: held in xyz") for name in self.anchors]
        unit = f"{self.units.force}/{self.units.length}"
        return found + [(one.group, f"spring {name}: {one.stiffness} {unit}") for name, one in self.springs.items()]


def _known(name: str, allowed: object, key: str, noun: str) -> None:
    """Refuse a name that is not among the allowed ones, and list them."""
    names = list(allowed)  # type: ignore[call-overload]
    if name not in names:
        raise ValueError(
            f"{key}: {name!r} is not {noun} of this scene; allowed: {', '.join(names) or '(none defined)'}"
        )
