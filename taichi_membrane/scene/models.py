"""What a run is: mesh, fabrics, supports, stages of pressure and loads, probes, checks, camera.

A scene is data: the models below, made in Python or read from TOML by :mod:`taichi_membrane.scene.file`. Reading one runs no code.
All quantities are in the scene's own consistent units (:class:`Units`); pressure is positive along the normals of
counter-clockwise triangles, for a closed body outwards.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from taichi_membrane.names import SideStrain, WrinklingLaw

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Component = Literal["x", "y", "z"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]
Count = Annotated[int, Field(ge=1, le=100_000)]


class Model(BaseModel):
    """A frozen record that refuses keys it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Units(Model):
    """The consistent units all numbers of a scene are in; only labels depend on them."""

    length: Literal["mm", "cm", "m", "in", "ft"]
    force: Literal["N", "kN", "MN", "lbf"]

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
    def area(self) -> str:
        """Label of area."""
        return f"{self.length}²"

    @property
    def energy(self) -> str:
        """Label of force times length."""
        return f"{self.force}·{self.length}"


class TubeShape(Model):
    """A straight tube along +x from 0 to ``length``, with or without caps."""

    shape: Literal["tube"]
    radius: Positive
    length: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    along: Count
    cap_start: Literal["none", "flat", "hemisphere"] = "none"
    cap_end: Literal["none", "flat", "hemisphere"] = "hemisphere"
    pattern: Literal["staggered", "diagonal"] = "staggered"


class ArchShape(Model):
    """A tube along a circular arc in the xz plane, feet on z = 0, open ends."""

    shape: Literal["arch"]
    span: Positive
    radius: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    along: Count
    angle: Annotated[float, Field(gt=0, lt=360)] = 180.0
    pattern: Literal["staggered", "diagonal"] = "staggered"


class CushionShape(Model):
    """Two flat rectangular sheets in z = 0, seamed along their rim."""

    shape: Literal["cushion"]
    width: Positive
    height: Positive
    along_x: Count
    along_y: Count
    pattern: Literal["diagonal", "alternating", "crossed"] = "alternating"


class PanelShape(Model):
    """A flat rectangle in z = 0 with a corner at the origin."""

    shape: Literal["panel"]
    width: Positive
    height: Positive
    along_x: Count
    along_y: Count
    pattern: Literal["diagonal", "alternating", "crossed"] = "diagonal"


class SphereShape(Model):
    """A sphere about the origin: a subdivided octahedron."""

    shape: Literal["sphere"]
    radius: Positive
    divisions: Annotated[int, Field(ge=1, le=3000)]


class DiscShape(Model):
    """A flat disc in z = 0 about the origin; ring k has ``sectors`` · k nodes."""

    shape: Literal["disc"]
    radius: Positive
    rings: Annotated[int, Field(ge=1, le=3000)]
    sectors: Annotated[int, Field(ge=3, le=64)] = 6


class AnnulusShape(Model):
    """A flat ring in z = 0 about the origin, between two radii; nodes in staggered rings of ``around``."""

    shape: Literal["annulus"]
    inner: Positive
    outer: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    rings: Count


class WedgeShape(Model):
    """A sector of a flat disc in z = 0: apex at the origin, from the x axis counter-clockwise over ``angle`` degrees."""

    shape: Literal["wedge"]
    radius: Positive
    angle: Annotated[float, Field(gt=0, le=180)]
    rings: Annotated[int, Field(ge=1, le=3000)]
    around: Count = 1


class GivenMesh(Model):
    """The mesh is handed to :func:`taichi_membrane.simulation.run` as an object."""

    shape: Literal["given"]


class MeshFile(Model):
    """A triangle mesh in any format meshio reads; a relative path is relative to the scene file."""

    shape: Literal["file"] = "file"
    path: Annotated[str, Field(min_length=1)]
    scale: Positive = 1.0


MeshSource = Annotated[
    TubeShape
    | ArchShape
    | CushionShape
    | PanelShape
    | SphereShape
    | DiscShape
    | AnnulusShape
    | WedgeShape
    | MeshFile
    | GivenMesh,
    Field(discriminator="shape"),
]


class Group(Model):
    """A named group chosen by coordinates, such as ``"x = 0 within 1e-6 and z > 3"``."""

    where: str
    kind: Literal["nodes", "elements"] = "nodes"


class Fabric(Model):
    """An isotropic (``E``, ``nu``) or orthotropic (``E_warp``, ``E_weft``, ``nu``, ``G``) fabric.

    ``nu`` is the contraction in weft per extension in warp. ``warp`` is a direction that is projected on each element (default: the
    shape's own), turned by ``warp_angle`` degrees about the normal. ``prestress`` is (warp, weft, shear) force per area.
    """

    E: Positive | None = None
    E_warp: Positive | None = None
    E_weft: Positive | None = None
    nu: Finite
    G: Positive | None = None
    thickness: Positive
    law: WrinklingLaw = "tension_field"
    side_strain: SideStrain = "green"
    warp: Vector | None = None
    warp_angle: Finite = 0.0
    prestress: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _moduli(self) -> Self:
        if self.E is not None:
            extra = [name for name in ("E_warp", "E_weft", "G") if getattr(self, name) is not None]
            if extra:
                raise ValueError(f"E makes an isotropic fabric; leave out {', '.join(extra)}, or leave out E")
        else:
            missing = [name for name in ("E_warp", "E_weft", "G") if getattr(self, name) is None]
            if missing:
                raise ValueError(f"give E, or all of E_warp, E_weft and G ({', '.join(missing)} missing)")
        if not self.nu**2 * self.weft_modulus / self.warp_modulus < 1:
            limit = math.sqrt(self.warp_modulus / self.weft_modulus)
            raise ValueError(
                f"the compliance is not positive definite: nu = {self.nu:g} must lie between {-limit:g} and {limit:g} "
                f"(the square root of E_warp/E_weft)"
            )
        if self.E is not None and self.nu <= -1:
            raise ValueError(f"nu = {self.nu:g} must be above -1")
        return self

    @field_validator("warp")
    @classmethod
    def _direction(cls, value: Vector | None) -> Vector | None:
        if value is not None and not any(value):
            raise ValueError("a direction needs a length above zero")
        return value

    @property
    def warp_modulus(self) -> float:
        """Young's modulus along the warp."""
        return float(self.E if self.E is not None else self.E_warp or 0.0)

    @property
    def weft_modulus(self) -> float:
        """Young's modulus along the weft."""
        return float(self.E if self.E is not None else self.E_weft or 0.0)

    @property
    def shear_modulus(self) -> float:
        """In-plane shear modulus."""
        return float(self.G) if self.G is not None else self.warp_modulus / (2 * (1 + self.nu))


def _distinct(value: str) -> str:
    """Refuse a list of components that names one twice."""
    if len(set(value)) != len(value):
        raise ValueError(f"a component is named twice in {value!r}")
    return value


Components = Annotated[str, Field(pattern=r"^[xyz]{1,3}$"), AfterValidator(_distinct)]


class Support(Model):
    """Displacement components of a node group that are held at zero: some of x, y, z, or the one along ``normal``.

    ``normal`` makes a plane of symmetry of any direction: the nodes slide in it.
    """

    group: str
    hold: Components | None = None
    normal: Vector | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.hold is None) == (self.normal is None):
            raise ValueError("give either hold (some of x, y, z) or normal (a direction)")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal: a direction needs a length above zero")
        return self


class Translation(Model):
    """A prescribed motion: the named components of a node group move by the stage's factor times ``direction``."""

    kind: Literal["translation"]
    group: str
    direction: Vector
    hold: Components = "xyz"


class Rotation(Model):
    """A prescribed motion: a node group turns rigidly by the stage's factor, in degrees, about an axis; finite angles.

    Only the components in ``hold`` are prescribed; the others stay free.
    """

    kind: Literal["rotation"]
    group: str
    axis: Vector
    through: Vector
    hold: Components = "xyz"

    @field_validator("axis")
    @classmethod
    def _axis_has_length(cls, value: Vector) -> Vector:
        if not any(value):
            raise ValueError("a direction needs a length above zero")
        return value


Motion = Annotated[Translation | Rotation, Field(discriminator="kind")]


class Pressure(Model):
    """A surface that pressure acts on, by element group.

    ``follower`` pressure stays normal to the moving surface; ``fixed`` keeps direction and size of the unstressed shape.
    """

    group: str = "all"
    kind: Literal["follower", "fixed"] = "follower"


class Load(Model):
    """A dead load of unit factor; stages multiply it.

    ``kind``: ``total`` spreads a force over the nodes of a group, ``line`` is force per length along the mesh edges whose both
    ends are in the node group, ``area`` is force per area of an element group. ``direction`` need not be a unit vector.
    ``spread`` of a total: ``equal`` shares, or by the length of ``edges`` or the ``area`` that belongs to each node.
    """

    group: str
    direction: Vector
    kind: Literal["total", "line", "area"] = "total"
    spread: Literal["equal", "edges", "area"] = "equal"


class Stage(Model):
    """A ramp, in ``steps`` equal load steps, from the state before to the given pressures, load and motion factors.

    What is not named keeps its value.
    """

    name: Name
    steps: Annotated[int, Field(ge=1, le=10_000)] = 1
    pressure: Finite | dict[Name, Finite] | None = None
    loads: dict[Name, Finite] = {}
    motions: dict[Name, Finite] = {}


class DisplacementProbe(Model):
    """Mean displacement of a node group along x, y, z, or its ``magnitude``."""

    kind: Literal["displacement"]
    group: str
    component: Literal["x", "y", "z", "magnitude"]


class ReactionProbe(Model):
    """Sum of the support forces on a node group."""

    kind: Literal["reaction"]
    group: str
    component: Component


class MomentProbe(Model):
    """Moment of the support forces on a node group about an axis through a point, right-handed, on the deformed shape."""

    kind: Literal["moment"]
    group: str
    axis: Vector
    through: Vector


class RotationProbe(Model):
    """Mean rotation, in degrees, of a node group about an axis through a point: least squares over its nodes."""

    kind: Literal["rotation"]
    group: str
    axis: Vector
    through: Vector


class RadiusProbe(Model):
    """Mean distance of a node group's deformed positions from an axis (through the group's middle), or from that middle."""

    kind: Literal["radius"]
    group: str
    axis: Component | Literal["centre"]


class VolumeProbe(Model):
    """Volume enclosed by a closed body; for an open one, the volume swept since rest."""

    kind: Literal["volume"]


class StressProbe(Model):
    """Extreme or area-mean principal stress of an element group."""

    kind: Literal["stress"]
    group: str = "all"
    which: Literal["major", "minor"] = "major"
    reduce: Literal["max", "min", "mean"] = "max"


class AreaProbe(Model):
    """Share (0 to 1) of an element group's area that is in a state."""

    kind: Literal["area_share"]
    group: str = "all"
    state: Literal["taut", "wrinkled", "slack"] = "wrinkled"


Probe = Annotated[
    DisplacementProbe
    | ReactionProbe
    | MomentProbe
    | RotationProbe
    | RadiusProbe
    | VolumeProbe
    | StressProbe
    | AreaProbe,
    Field(discriminator="kind"),
]


class Check(Model):
    """A probe's value at one load step against a reference; ``step`` counts from 1, or from the stage's end with -1.

    Give ``tolerance`` (relative to the reference) or ``absolute``. ``source`` says where the reference comes from.
    """

    probe: str
    stage: str
    step: int = -1
    reference: Finite
    tolerance: Positive | None = None
    absolute: Positive | None = None
    source: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("give either tolerance (relative) or absolute")
        if self.tolerance is not None and self.reference == 0:
            raise ValueError("a relative tolerance of a zero reference can never hold; give absolute")
        return self


class Camera(Model):
    """How the pictures look; one camera and one colour range serve all steps of a run."""

    field: Literal["state", "fold_strain", "major_stress", "displacement"] = "state"
    azimuth: Finite = -60.0
    elevation: Annotated[float, Field(ge=-90, le=90)] = 20.0
    projection: Literal["perspective", "orthographic"] = "perspective"
    size: tuple[Annotated[int, Field(ge=240, le=8192)], Annotated[int, Field(ge=160, le=8192)]] = (1600, 1000)
    outline: bool = True
    loads: bool = True
    supports: bool = False
    directions: bool = True


class CurveLine(Model):
    """A line across the curve plot at a value of x or of y."""

    label: str
    axis: Literal["x", "y"]
    value: Finite


class CurveReference(Model):
    """A reference curve, drawn beside the computed one."""

    label: str
    x: list[Finite]
    y: list[Finite]

    @model_validator(mode="after")
    def _same_length(self) -> Self:
        if len(self.x) != len(self.y):
            raise ValueError(f"len(x) = {len(self.x)}, but len(y) = {len(self.y)}")
        return self


class Curve(Model):
    """What ``curve.png`` plots on each axis: a probe, ``pressure[.NAME]``, ``load.NAME``, ``motion.NAME`` or ``volume``.

    ``stage`` limits it to one stage (with the state before it as first point). ``x_scale`` and ``y_scale`` multiply, say -1 for a
    deflection that is negative along z.
    """

    x: str
    y: str
    stage: str | None = None
    x_scale: Finite = 1.0
    y_scale: Finite = 1.0
    x_label: str | None = None
    y_label: str | None = None
    lines: list[CurveLine] = []
    references: list[CurveReference] = []


class Solver(Model):
    """How equilibrium is found.

    ``tolerance``: 2-norm of the out-of-balance forces on free degrees of freedom over that of the applied forces, pressure
    included; by default 1e-6 in double precision, 3e-6 in single. ``max_iterations`` limits relaxation per solve. ``max_cuts``:
    how often a load step that fails is halved. ``kind``: ``newton`` on the relaxed energy, ``relaxation`` (any back end and
    precision, any law), or ``hybrid``, which lets relaxation take over where Newton does not get on.
    """

    kind: Literal["hybrid", "newton", "relaxation"] = "hybrid"
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    max_iterations: Annotated[int, Field(ge=1)] = 200_000
    max_cuts: Annotated[int, Field(ge=0, le=20)] = 4


class Scene(Model):
    """Everything a run needs."""

    name: Name
    title: str = ""
    description: str = ""
    units: Units
    mesh: MeshSource
    groups: dict[Name, Group] = {}
    fabric: Fabric | None = None
    fabrics: dict[Name, Fabric] = {}
    supports: list[Support] = []
    pressures: dict[Name, Pressure] = {"inside": Pressure()}
    loads: dict[Name, Load] = {}
    motions: dict[Name, Motion] = {}
    stages: Annotated[list[Stage], Field(min_length=1)]
    probes: dict[Name, Probe] = {}
    checks: list[Check] = []
    curve: Curve | None = None
    camera: Camera = Camera()
    solver: Solver = Solver()

    @model_validator(mode="after")
    def _references(self) -> Self:
        names = [stage.name for stage in self.stages]
        if len(set(names)) != len(names):
            raise ValueError(f"stages: two stages have one name: {', '.join(names)}")
        for stage in self.stages:
            for load in stage.loads:
                _known(load, self.loads, f"stages.{stage.name}.loads", "a load")
            for motion in stage.motions:
                _known(motion, self.motions, f"stages.{stage.name}.motions", "a motion")
            for pressure in stage.pressure if isinstance(stage.pressure, dict) else ():
                _known(pressure, self.pressures, f"stages.{stage.name}.pressure", "a pressure")
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
        if self.curve is not None:
            allowed = [*self.probes, "volume", "pressure", *(f"pressure.{p}" for p in self.pressures)]
            allowed += [f"load.{name}" for name in self.loads] + [f"motion.{name}" for name in self.motions]
            _known(self.curve.x, allowed, "curve.x", "a quantity")
            _known(self.curve.y, allowed, "curve.y", "a quantity")
            if self.curve.stage is not None:
                _known(self.curve.stage, names, "curve.stage", "a stage")
        if self.fabric is None and not self.fabrics:
            raise ValueError("fabric: a scene needs [fabric], or [fabrics.GROUP] for each element group")
        return self


def _known(name: str, allowed: object, key: str, noun: str) -> None:
    """Refuse a name that is not among the allowed ones, and list them."""
    names = list(allowed)  # type: ignore[call-overload]
    if name not in names:
        raise ValueError(
            f"{key}: {name!r} is not {noun} of this scene; allowed: {', '.join(names) or '(none defined)'}"
        )
