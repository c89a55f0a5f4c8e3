"""What a run is: mesh, fabrics, supports, stages of pressure and loads, probes, checks, camera.

A scene is data: the models below, made in Python or read from TOML by :mod:`taichi_membrane.scene.file`. Reading one runs no code.
All quantities are in the scene's own consistent units (:class:`Units`); pressure is positive along the normals of
counter-clockwise triangles, for a closed body outwards.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from taichi_membrane.names import SideStrain, WrinklingLaw
from taichi_membrane.scene.base import MOST, Direction, Finite, GroupName, Label, Name, Positive, Record, Vector
from taichi_membrane.scene.mesh_source import MeshSource
from taichi_membrane.scene.probe import FactorProbe, Probe
from taichi_membrane.scene.support import Motion, Support

_DIFFERENTIABLE = ("displacement", "radius", "rotation", "volume")  # kinds of probes that derivatives exist for
_FEW = Field(max_length=MOST)
LARGEST_PICTURE = 8192 * 4320  # pixels; drawing takes about 150 bytes for each


class Units(Record):
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


class Group(Record):
    """A named group chosen by coordinates, such as ``"x = 0 within 1e-6 and z > 3"``."""

    where: Annotated[str, Field(max_length=1000)]
    kind: Literal["nodes", "elements"] = "nodes"


class Fabric(Record):
    """An isotropic (``E``, ``nu``) or orthotropic (``E_warp``, ``E_weft``, ``nu``, ``G``) fabric.

    ``nu`` is the contraction in weft per extension in warp. ``warp`` is a direction that is projected on each element (default: the
    shape's own), turned by ``warp_angle`` degrees about the normal. ``prestress`` is (warp, weft, shear) force per area.
    ``density`` is mass per volume, in force · time² / length⁴; only vibration modes need it.
    """

    E: Positive | None = None
    E_warp: Positive | None = None
    E_weft: Positive | None = None
    nu: Finite
    G: Positive | None = None
    thickness: Positive
    law: WrinklingLaw = "tension_field"
    side_strain: SideStrain = "green"
    warp: Direction | None = None
    warp_angle: Finite = 0.0
    prestress: Vector = (0.0, 0.0, 0.0)
    density: Positive | None = None

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


class Pressure(Record):
    """A surface that pressure acts on, by element group.

    ``follower`` pressure stays normal to the moving surface; ``fixed`` keeps direction and size of the unstressed shape. Pressures
    are above ``ambient``, the absolute pressure outside, which only stages that shut the valve (``closed``) need; the gas then
    keeps p_abs Vⁿ with n = ``exponent``: 1 at constant temperature, 1.4 for air that exchanges no heat.
    """

    group: GroupName = "all"
    kind: Literal["follower", "fixed"] = "follower"
    ambient: Positive | None = None
    exponent: Annotated[float, Field(ge=1, le=2)] = 1.0


class Load(Record):
    """A dead load of unit factor; stages multiply it.

    ``kind``: ``total`` spreads a force over the nodes of a group, ``line`` is force per length along the mesh edges whose both
    ends are in the node group, ``area`` is force per area of an element group. ``direction`` need not be a unit vector.
    ``spread`` of a total: ``equal`` shares, or by the length of ``edges`` or the ``area`` that belongs to each node.
    """

    group: GroupName
    direction: Direction
    kind: Literal["total", "line", "area"] = "total"
    spread: Literal["equal", "edges", "area"] = "equal"


class Stage(Record):
    """A ramp, in ``steps`` equal load steps, from the state before to the given pressures, load and motion factors.

    What is not named keeps its value. ``until = "collapse"``: the stage is meant to meet its largest stable load on the way; the
    run then goes on to the next stage from there. ``control = "arc_length"`` follows the equilibrium path in at most ``steps``
    steps, through limit points, until the stage's values are reached; needs Newton, and no motion that changes. ``closed`` names
    pressures whose valve is shut from the stage's start to its end: they follow their volume.
    """

    name: Name
    steps: Annotated[int, Field(ge=1, le=10_000)] = 1
    pressure: Finite | dict[Name, Finite] | None = None
    loads: dict[Name, Finite] = {}
    motions: dict[Name, Finite] = {}
    control: Literal["load", "arc_length"] = "load"
    until: Literal["target", "collapse"] = "target"
    closed: list[Name] = []

    @property
    def may_end_early(self) -> bool:
        """Whether the number of load steps done may be below ``steps`` in a run that went well."""
        return self.control == "arc_length" or self.until == "collapse"

    @model_validator(mode="after")
    def _arc_length(self) -> Self:
        if self.control == "arc_length":
            if self.motions:
                raise ValueError("control = 'arc_length' follows pressures and loads; leave out motions")
            if self.until == "collapse":
                raise ValueError("control = 'arc_length' goes on past collapse; leave out until = 'collapse'")
        return self


class Check(Record):
    """A probe's value at one load step against a reference; ``step`` counts from 1, or from the stage's end with -1 (of a stage
    that may end early, from the last step done).

    Give ``tolerance`` (relative to the reference) or ``absolute``. ``source`` says where the reference comes from.
    """

    probe: str
    stage: str
    step: int = -1
    reference: Finite
    tolerance: Positive | None = None
    absolute: Positive | None = None
    source: Annotated[Label, Field(min_length=1)]

    @model_validator(mode="after")
    def _one_tolerance(self) -> Self:
        if (self.tolerance is None) == (self.absolute is None):
            raise ValueError("give either tolerance (relative) or absolute")
        if self.tolerance is not None and self.reference == 0:
            raise ValueError("a relative tolerance of a zero reference can never hold; give absolute")
        return self


class Camera(Record):
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

    @field_validator("size")
    @classmethod
    def _not_too_large(cls, value: tuple[int, int]) -> tuple[int, int]:
        if value[0] * value[1] > LARGEST_PICTURE:
            raise ValueError(
                f"{value[0]} × {value[1]} = {value[0] * value[1]} pixels, at most {LARGEST_PICTURE} are allowed"
            )
        return value


class CurveLine(Record):
    """A line across the curve plot at a value of x or of y."""

    label: Label
    axis: Literal["x", "y"]
    value: Finite


class CurveReference(Record):
    """A reference curve, drawn beside the computed one."""

    label: Label
    x: list[Finite]
    y: list[Finite]

    @model_validator(mode="after")
    def _same_length(self) -> Self:
        if len(self.x) != len(self.y):
            raise ValueError(f"len(x) = {len(self.x)}, but len(y) = {len(self.y)}")
        return self


class Curve(Record):
    """What ``curve.png`` plots on each axis: a probe, ``pressure[.NAME]``, ``load.NAME``, ``motion.NAME`` or ``volume``.

    ``stage`` limits it to one stage (with the state before it as first point). ``x_scale`` and ``y_scale`` multiply, say -1 for a
    deflection that is negative along z.
    """

    x: str
    y: str
    stage: str | None = None
    x_scale: Finite = 1.0
    y_scale: Finite = 1.0
    x_label: Label | None = None
    y_label: Label | None = None
    lines: list[CurveLine] = []
    references: list[CurveReference] = []


class Solver(Record):
    """How equilibrium is found.

    ``tolerance``: 2-norm of the out-of-balance forces on free degrees of freedom over that of the applied forces, pressure
    included; by default 1e-6 in double precision, 3e-6 in single. ``max_iterations`` limits relaxation per solve. ``max_cuts``:
    how often a load step that fails is halved. ``stability``: count the negative eigenvalues of the tangent at every load step
    (with Newton; it costs a factorisation where the next step changes a pressure). ``memory``: GiB that a factor may take, by
    default what the machine has; above it the hybrid relaxes alone. ``kind``: ``newton`` on the relaxed energy,
    ``relaxation`` (any back end and precision, any law), or ``hybrid``, which lets relaxation take over where Newton does not get
    on. Where load control finds no equilibrium, both Newton kinds follow the path by arc length to it, or to collapse.
    """

    kind: Literal["hybrid", "newton", "relaxation"] = "hybrid"
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    max_iterations: Annotated[int, Field(ge=1, le=1_000_000_000)] = 200_000
    max_cuts: Annotated[int, Field(ge=0, le=20)] = 4
    stability: bool = True
    memory: Annotated[float, Field(gt=0, le=1e6)] | None = None


class Modes(Record):
    """Modes computed at every load step of a stage (of all stages when None), Newton only.

    ``vibration``: lowest frequencies about the present state, in vacuo. ``buckling``: nearest loads at which the tangent,
    extrapolated linearly along the stage's course, becomes singular.
    """

    kind: Literal["vibration", "buckling"]
    count: Annotated[int, Field(ge=1, le=100)] = 4
    stage: str | None = None


class Scene(Record):
    """Everything a run needs."""

    name: Name
    title: Label = ""
    description: str = ""
    units: Units
    mesh: MeshSource
    groups: Annotated[dict[Name, Group], _FEW] = {}
    fabric: Fabric | None = None
    fabrics: Annotated[dict[Name, Fabric], _FEW] = {}
    supports: Annotated[list[Support], _FEW] = []
    pressures: Annotated[dict[Name, Pressure], _FEW] = {"inside": Pressure()}
    loads: Annotated[dict[Name, Load], _FEW] = {}
    motions: Annotated[dict[Name, Motion], _FEW] = {}
    stages: Annotated[list[Stage], Field(min_length=1, max_length=MOST)]
    probes: Annotated[dict[Name, Probe], _FEW] = {}
    checks: Annotated[list[Check], _FEW] = []
    derivatives: Annotated[list[Name], _FEW] = []
    modes: Modes | None = None
    curve: Curve | None = None
    camera: Camera = Camera()
    solver: Solver = Solver()

    @model_validator(mode="after")
    def _references(self) -> Self:
        names = [stage.name for stage in self.stages]
        if len(set(names)) != len(names):
            raise ValueError(f"stages: two stages have one name: {', '.join(names)}")
        for stage in self.stages:
            self._check_closed(stage)
            if stage.control == "arc_length" and self.solver.kind == "relaxation":
                raise ValueError(f"stages.{stage.name}.control = 'arc_length' needs solver.kind 'hybrid' or 'newton'")
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
        for number, probe_name in enumerate(self.derivatives, 1):
            _known(probe_name, self.probes, f"derivatives[{number}]", "a probe")
            if self.probes[probe_name].kind not in _DIFFERENTIABLE:
                raise ValueError(
                    f"derivatives[{number}]: probe {probe_name!r} is of kind {self.probes[probe_name].kind!r}; "
                    f"derivatives exist for {', '.join(_DIFFERENTIABLE)}"
                )
        if self.modes is not None and self.modes.kind == "vibration":
            for name, fabric in {"fabric": self.fabric, **{f"fabrics.{n}": f for n, f in self.fabrics.items()}}.items():
                if fabric is not None and fabric.density is None:
                    raise ValueError(f"{name}.density is missing: modes.kind = 'vibration' needs it")
        if self.modes is not None and self.modes.stage is not None:
            _known(self.modes.stage, names, "modes.stage", "a stage")
        if (self.modes is not None or self.derivatives) and self.solver.kind == "relaxation":
            raise ValueError("modes and derivatives need the tangent of solver.kind 'hybrid' or 'newton'")
        if self.curve is not None:
            allowed = [*self.probes, "volume", "pressure", *(f"pressure.{p}" for p in self.pressures)]
            allowed += [f"load.{name}" for name in self.loads] + [f"motion.{name}" for name in self.motions]
            _known(self.curve.x, allowed, "curve.x", "a quantity")
            _known(self.curve.y, allowed, "curve.y", "a quantity")
            if self.curve.stage is not None:
                _known(self.curve.stage, names, "curve.stage", "a stage")
        for name, probe in self.probes.items():
            if isinstance(probe, FactorProbe):
                factors = [f"load.{one}" for one in self.loads] + [f"motion.{one}" for one in self.motions]
                _known(
                    probe.of,
                    [*factors, *(f"pressure.{one}" for one in self.pressures)],
                    f"probes.{name}.of",
                    "a factor",
                )
        if self.fabric is None and not self.fabrics:
            raise ValueError("fabric: a scene needs [fabric], or [fabrics.GROUP] for each element group")
        return self

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
