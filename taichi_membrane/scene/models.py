"""What a run is: mesh, fabrics, supports, stages of pressure and loads, probes, checks, camera.

A scene is data: the models of this folder, made in Python or read from TOML by :mod:`taichi_membrane.scene.file`. Reading one
runs no code. All quantities are in the scene's own consistent units (:class:`Units`); pressure is positive along the normals of
counter-clockwise triangles, for a closed body outwards.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichi_membrane import fields
from taichi_membrane.scene import drivers
from taichi_membrane.scene.base import MOST, Finite, Label, Name, Positive, Record
from taichi_membrane.scene.drawing import Camera, Curve
from taichi_membrane.scene.element_field import ElementField
from taichi_membrane.scene.fabric import Fabric
from taichi_membrane.scene.growth import Shrinkage, Temperature
from taichi_membrane.scene.loads import AnyLoad, Pressure, SnowLoad, WeightLoad
from taichi_membrane.scene.members import Cable, Plane
from taichi_membrane.scene.mesh_source import MeshSource
from taichi_membrane.scene.probe import FactorProbe, Probe
from taichi_membrane.scene.solver import Modes, Solver
from taichi_membrane.scene.stage import Stage
from taichi_membrane.scene.support import Motion, Support

DIFFERENTIABLE = ("displacement", "radius", "rotation", "volume")  # kinds of probes that derivatives exist for
_FEW = Field(max_length=MOST)


class Units(Record):
    """The consistent units all numbers of a scene are in; only labels depend on them."""

    length: Literal["mm", "cm", "m", "in", "ft"]
    """Unit of every length."""
    force: Literal["N", "kN", "MN", "lbf"]
    """Unit of every force; stress and pressure are force per length²."""

    @property
    def stress(self) -> str:
        """Label of force per area."""
        return {("mm", "N"): "MPa", ("m", "N"): "Pa", ("m", "kN"): "kPa", ("m", "MN"): "MPa", ("in", "lbf"): "psi"}.get(
            (self.length, self.force), f"{self.force}/{self.length}²"
        )

    @property
    def volume(self) -> str:
        """Label of volume."""
        return f"{self.length}³"

    @property
    def resultant(self) -> str:
        """Label of force per width."""
        return f"{self.force}/{self.length}"

    @property
    def area(self) -> str:
        """Label of area."""
        return f"{self.length}²"

    @property
    def energy(self) -> str:
        """Label of force times length."""
        return f"{self.force}·{self.length}"


class Group(Record):
    """A named group chosen by coordinates, such as ``"x = 0 within 1e-6 and z > 3"``."""

    where: Annotated[str, Field(max_length=1000)]
    """Condition on coordinates, such as ``x = 0 within 1e-6 and z > 3``; elements belong by their centroid."""
    kind: Literal["nodes", "elements"] = "nodes"
    """Whether it names nodes or elements."""


class Check(Record):
    """A probe's value at one load step against a reference; ``step`` counts from 1, or from the stage's end with -1 (of a stage
    that may end early, from the last step done).

    Give ``tolerance`` (relative to the reference) or ``absolute``. ``source`` says where the reference comes from.
    """

    probe: str
    """Name of the probe."""
    stage: str
    """Name of the stage."""
    step: int = -1
    """Load step of the stage from 1, or from its end with -1."""
    reference: Finite
    """What the value should be."""
    tolerance: Positive | None = None
    """Largest error relative to the reference."""
    absolute: Positive | None = None
    """Largest absolute error."""
    source: Annotated[Label, Field(min_length=1)]
    """Where the reference comes from."""

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("give either tolerance (relative) or absolute")
        if self.tolerance is not None and self.reference == 0:
            raise ValueError("a relative tolerance of a zero reference can never hold; give absolute")
        return self


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
    planes: Annotated[dict[Name, Plane], Field(max_length=8)] = {}
    """Planes that nodes touch and do not pass, by name."""
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

    @model_validator(mode="after")
    def _references(self) -> Self:
        names = [stage.name for stage in self.stages]
        if len(set(names)) != len(names):
            raise ValueError(f"stages: two stages have one name: {', '.join(names)}")
        for stage in self.stages:
            self._check_closed(stage)
            if stage.control == "arc_length" and self.solver.kind == "relaxation":
                raise ValueError(f"stages.{stage.name}.control = 'arc_length' needs solver.kind 'hybrid' or 'newton'")
            for kind in drivers.DRIVERS:
                for name in kind.asked(stage, ()):
                    _known(name, kind.defined(self), f"stages.{stage.name}.{kind.key}", f"a {kind.name}")
            if isinstance(stage.pressure, float) and len(self.pressures) != 1:
                raise ValueError(
                    f"stages.{stage.name}.pressure is one number, but there are {len(self.pressures)} pressures "
                    f"({', '.join(self.pressures)}); name them: pressure = {{ {next(iter(self.pressures), 'inside')} = ... }}"
                )
        for number, check in enumerate(self.checks, 1):
            _known(check.probe, self.probes, f"checks[{number}].probe", "a probe")
            _known(check.stage, names, f"checks[{number}].stage", "a stage")
            steps = next(stage.steps for stage in self.stages if stage.name == check.stage)
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
        self._check_snow()
        self._check_expansion()
        self.check_picture(self.camera.field)
        if self.modes is not None and self.modes.stage is not None:
            _known(self.modes.stage, names, "modes.stage", "a stage")
        if (self.modes is not None or self.derivatives) and self.solver.kind == "relaxation":
            raise ValueError("modes and derivatives need the tangent of solver.kind 'hybrid' or 'newton'")
        self._check_planes()
        if self.curve is not None:
            allowed = [*self.probes, "volume", "pressure", *drivers.driver_names(self)]
            _known(self.curve.x, allowed, "curve.x", "a quantity")
            _known(self.curve.y, allowed, "curve.y", "a quantity")
            if self.curve.stage is not None:
                _known(self.curve.stage, names, "curve.stage", "a stage")
        for name, probe in self.probes.items():
            if isinstance(probe, FactorProbe):
                _known(probe.of, drivers.driver_names(self), f"probes.{name}.of", "a factor")
        if self.fabric is None and not self.fabrics:
            raise ValueError("fabric: a scene needs [fabric], or [fabrics.GROUP] for each element group")
        return self

    @property
    def extra_fields(self) -> tuple[str, ...]:
        """Names of the optional fields that its runs have: what differs from element to element, and stress-free strain."""
        fabrics = [*self.fabrics.values(), *([] if self.fabric is None else [self.fabric])]
        has = {
            "thickness": any(isinstance(one.thickness, ElementField) for one in fabrics),
            "prestress": any(isinstance(one.prestress, ElementField) for one in fabrics),
            "free_strain": bool(self.shrinkages or self.temperatures),
        }
        return tuple(name for name, there in has.items() if there)

    def check_picture(self, name: str) -> None:
        """Refuse a field that pictures can show, but not of this scene."""
        if fields.named(name).optional and name not in self.extra_fields:
            needs = {"thickness": "a thickness by element data", "prestress": "a prestress by element data"}
            raise ValueError(
                f"camera.field: {name!r} needs {needs.get(name, 'shrinkages or temperatures')} in the scene"
            )

    def _check_masses(self, user: str) -> None:
        """Refuse a fabric without a mass."""
        for name, fabric in {"fabric": self.fabric, **{f"fabrics.{n}": f for n, f in self.fabrics.items()}}.items():
            if fabric is not None and not fabric.has_mass:
                raise ValueError(f"{name}.density is missing (or mass_per_area): {user} needs it")

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
        fabrics = [*self.fabrics.values(), *([] if self.fabric is None else [self.fabric])]
        if self.temperatures and not any(any(fabric.expansion) for fabric in fabrics):
            name = next(iter(self.temperatures))
            raise ValueError(f"temperatures.{name}: no fabric has an expansion; give fabric.expansion = [warp, weft]")

    def _check_planes(self) -> None:
        """Refuse what takes the tangent in contact for that of the structure: it holds springs, where the planes are rigid."""
        if self.planes:
            told = "is not implemented for a scene with planes"
            if self.derivatives or self.modes is not None:
                raise ValueError(f"{'derivatives' if self.derivatives else 'modes'} {told}")
            for stage in self.stages:
                if stage.control == "arc_length" or stage.until in ("collapse", "collapse_or_target"):
                    key = "control = 'arc_length'" if stage.control == "arc_length" else f"until = {stage.until!r}"
                    raise ValueError(f"stages.{stage.name}.{key} {told}")

    def _check_closed(self, stage: Stage) -> None:
        """Refuse a stage that shuts a valve it cannot shut."""
        for name in stage.closed:
            key = f"stages.{stage.name}.closed"
            _known(name, self.pressures, key, "a pressure")
            if self.pressures[name].ambient is None or self.pressures[name].kind != "follower":
                raise ValueError(f"{key}: pressures.{name} needs ambient, and kind 'follower', to follow its volume")
            if stage.pressure is not None and (not isinstance(stage.pressure, dict) or name in stage.pressure):
                raise ValueError(f"{key}: pressure {name!r} cannot be shut and set in one stage")
            if self.solver.kind == "relaxation":
                raise ValueError(f"{key}: a shut chamber needs solver.kind 'hybrid' or 'newton'")
            if self.modes is not None and self.modes.stage in (None, stage.name):
                raise ValueError(
                    f"{key}: modes of shut chambers are not implemented; name another stage in modes.stage"
                )


def _known(name: str, allowed: object, key: str, noun: str) -> None:
    """Refuse a name that is not among the allowed ones, and list them."""
    names = list(allowed)  # type: ignore[call-overload]
    if name not in names:
        raise ValueError(
            f"{key}: {name!r} is not {noun} of this scene; allowed: {', '.join(names) or '(none defined)'}"
        )
