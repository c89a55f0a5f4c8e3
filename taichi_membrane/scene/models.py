"""What a run is: mesh, fabrics, supports, stages of pressure and loads, probes, checks, camera.

A scene is data: the models below, made in Python or read from TOML by :mod:`taichi_membrane.scene.file`. Reading one runs no code.
All quantities are in the scene's own consistent units (:class:`Units`); pressure is positive along the normals of
counter-clockwise triangles, for a closed body outwards.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from taichi_membrane import fields
from taichi_membrane.names import SideStrain, WrinklingLaw
from taichi_membrane.scene import drivers
from taichi_membrane.scene.base import (
    MOST,
    AllowedNames,
    Direction,
    Finite,
    GroupName,
    Label,
    Name,
    Positive,
    Record,
    Vector,
)
from taichi_membrane.scene.members import Cable, Plane
from taichi_membrane.scene.mesh_source import MeshSource
from taichi_membrane.scene.probe import FactorProbe, Probe
from taichi_membrane.scene.support import Motion, Support

DIFFERENTIABLE = ("displacement", "radius", "rotation", "volume")  # kinds of probes that derivatives exist for
_FEW = Field(max_length=MOST)
LARGEST_PICTURE = 8192 * 4320  # pixels; drawing takes about 150 bytes for each


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


class Fabric(Record):
    """An isotropic (``E``, ``nu``) or orthotropic (``E_warp``, ``E_weft``, ``nu``, ``G``) fabric.

    ``nu`` is the contraction in weft per extension in warp. ``warp`` is a direction that is projected on each element (default: the
    shape's own), turned by ``warp_angle`` degrees about the normal. ``prestress`` is (warp, weft, shear) force per area.
    ``density`` is mass per volume, in force · time² / length⁴; only vibration modes need it.
    """

    E: Positive | None = None
    """Young's modulus of an isotropic fabric [force/length²]; leave out for an orthotropic one."""
    E_warp: Positive | None = None
    """Young's modulus along the warp [force/length²]."""
    E_weft: Positive | None = None
    """Young's modulus along the weft [force/length²]."""
    nu: Finite
    """Poisson's ratio: contraction in weft per extension in warp."""
    G: Positive | None = None
    """Shear modulus of an orthotropic fabric [force/length²]."""
    thickness: Positive
    """Thickness [length]; stress times thickness is the resultant."""
    law: WrinklingLaw = "tension_field"
    """What compression does: ``tension_field`` wrinkles, ``clip`` (of the seed) has no energy, ``none`` bears it."""
    side_strain: SideStrain = "green"
    """Strain of a side: ``green``, or ``engineering`` as in the seed paper."""
    warp: Direction | None = None
    """Direction that is projected on each element as its warp; without it the shape's own."""
    warp_angle: Finite = 0.0
    """Turns the warp about the normal [degrees]."""
    prestress: Vector = (0.0, 0.0, 0.0)
    """Stress (warp, weft, shear) in the unstressed shape [force/length²]."""
    density: Positive | None = None
    """Mass per volume [force · time²/length⁴], for vibration modes alone."""

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
    """A surface that pressure acts on, by element groups.

    It acts along the normals of ``group`` and against those of ``against``. A wall between two chambers, whose normals point from
    one into the other, is in ``group`` of the first and in ``against`` of the second.
    ``follower`` pressure stays normal to the moving surface; ``fixed`` keeps direction and size of the unstressed shape. Pressures
    are above ``ambient``, the absolute pressure outside, which only stages that shut the valve (``closed``) need; the gas then
    keeps p_abs Vⁿ with n = ``exponent``: 1 at constant temperature, 1.4 for air that exchanges no heat.
    """

    group: GroupName | Annotated[list[GroupName], _FEW] = "all"
    """Element groups along whose normals it acts; ``all`` is every element."""
    against: GroupName | Annotated[list[GroupName], _FEW] = []
    """Element groups against whose normals it acts: walls whose normals point into the chamber."""
    kind: Literal["follower", "fixed"] = "follower"
    """``follower`` stays normal to the moving surface, ``fixed`` keeps direction and size of the unstressed shape."""
    ambient: Positive | None = None
    """Absolute pressure outside [force/length²], for stages that shut the valve."""
    exponent: Annotated[float, Field(ge=1, le=2)] = 1.0
    """Exponent n of p_abs Vⁿ in a shut chamber: 1 isothermal, 1.4 adiabatic air."""


class Load(Record):
    """A dead load of unit factor; stages multiply it.

    ``kind``: ``total`` spreads a force over the nodes of a group, ``line`` is force per length along the mesh edges whose both
    ends are in the node group, ``area`` is force per area of an element group. ``direction`` need not be a unit vector.
    ``spread`` of a total: ``equal`` shares, or by the length of ``edges`` or the ``area`` that belongs to each node.
    """

    group: GroupName
    """Node group (``total``, ``line``) or element group (``area``) that it acts on."""
    direction: Direction
    """Direction of the force; its length multiplies the factor."""
    kind: Literal["total", "line", "area"] = "total"
    """``total`` force over nodes, ``line`` force per length of edges, ``area`` force per area."""
    spread: Literal["equal", "edges", "area"] = "equal"
    """How a total is shared out: ``equal``, or by the length of ``edges`` or the ``area`` of each node."""


class Stage(Record):
    """A ramp, in ``steps`` equal load steps, from the state before to the given pressures, load and motion factors.

    What is not named keeps its value. ``until = "collapse"``: the stage is meant to meet its largest stable load on the way; the
    run then goes on to the next stage from there. ``control = "arc_length"`` follows the equilibrium path in at most ``steps``
    steps, through limit points, until the stage's values are reached; needs Newton, and no motion that changes. ``closed`` names
    pressures whose valve is shut from the stage's start to its end: they follow their volume.
    """

    name: Name
    """Name that checks, curves and results use."""
    steps: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of equal load steps; by arc length the most steps."""
    pressure: Finite | dict[Name, Finite] | None = None
    """Pressure at the stage's end [force/length²]: one number where the scene has one pressure, else a table by name."""
    loads: dict[Name, Finite] = {}
    """Factor of each load at the stage's end; what is not named keeps its value."""
    motions: dict[Name, Finite] = {}
    """Factor of each motion at the stage's end."""
    control: Literal["load", "arc_length"] = "load"
    """``load`` raises the loads step by step, ``arc_length`` follows the equilibrium path through limit points."""
    until: Literal["target", "collapse", "collapse_or_target", "steps"] = "target"
    """What ends the stage well: its ``target``; its largest stable load on the way (``collapse``); either
    (``collapse_or_target``); by arc length also the last of its ``steps``."""
    snaps: Literal["stop", "pass"] = "stop"
    """At a maximum of the load: ``stop`` there, as collapse; ``pass`` goes on from a stable state beyond the jump, and tells it."""
    closed: list[Name] = []
    """Pressures whose valve is shut during the stage: they follow their volume."""

    @property
    def may_end_early(self) -> bool:
        """Whether the number of load steps done may be below ``steps`` in a run that went well."""
        return self.control == "arc_length" or self.until != "target"

    @model_validator(mode="after")
    def _arc_length(self) -> Self:
        if self.control == "arc_length":
            if self.motions:
                raise ValueError("control = 'arc_length' follows pressures and loads; leave out motions")
            if self.until in ("collapse", "collapse_or_target"):
                raise ValueError(f"control = 'arc_length' goes on past collapse; leave out until = {self.until!r}")
            if self.snaps == "pass":
                raise ValueError("control = 'arc_length' follows the path and does not snap; leave out snaps")
        elif self.until == "steps":
            raise ValueError("until = 'steps' is for control = 'arc_length'; load control takes all its steps")
        return self


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


def _drawn(name: str) -> str:
    """Refuse what no picture can show."""
    if name not in fields.drawn():
        raise ValueError(f"pictures cannot show {name!r}; allowed: {', '.join(fields.drawn())}")
    return name


class Camera(Record):
    """How the pictures look; one camera and one colour range serve all steps of a run."""

    field: Annotated[str, AfterValidator(_drawn), AllowedNames(fields.drawn)] = "state"
    """What the colours show: wrinkling states, or a field by a colour scale."""
    azimuth: Finite = -60.0
    """Where the camera stands, about z [degrees]."""
    elevation: Annotated[float, Field(ge=-90, le=90)] = 20.0
    """Height above the xy plane [degrees]."""
    projection: Literal["perspective", "orthographic"] = "perspective"
    """Perspective or orthographic."""
    size: tuple[Annotated[int, Field(ge=240, le=8192)], Annotated[int, Field(ge=160, le=8192)]] = (1600, 1000)
    """Width and height [pixels]."""
    outline: bool = True
    """Draw the unstressed shape."""
    loads: bool = True
    """Draw arrows at loads."""
    supports: bool = False
    """Draw marks at supports."""
    directions: bool = True
    """Draw lines along wrinkles."""

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
    """What is written at the line."""
    axis: Literal["x", "y"]
    """Axis whose value it marks."""
    value: Finite
    """Value on that axis."""


class CurveReference(Record):
    """A reference curve, drawn beside the computed one."""

    label: Label
    """What the legend says."""
    x: list[Finite]
    """Values along x."""
    y: list[Finite]
    """Values along y, as many."""

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
    """Quantity along x."""
    y: str
    """Quantity along y."""
    stage: str | None = None
    """Stage it is limited to; all stages without it."""
    x_scale: Finite = 1.0
    """Factor on x."""
    y_scale: Finite = 1.0
    """Factor on y, say -1 for a deflection along -z."""
    x_label: Label | None = None
    """Text at the x axis; made from name and unit without it."""
    y_label: Label | None = None
    """Text at the y axis."""
    lines: list[CurveLine] = []
    """Lines across the plot."""
    references: list[CurveReference] = []
    """Curves to compare with."""


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
    """``newton``, ``relaxation``, or ``hybrid``: Newton, with relaxation where it does not get on."""
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Out-of-balance over acting forces at which a state is an equilibrium; 1e-6, in single precision 3e-6."""
    max_iterations: Annotated[int, Field(ge=1, le=1_000_000_000)] = 200_000
    """Most iterations of relaxation in one solve."""
    max_cuts: Annotated[int, Field(ge=0, le=20)] = 4
    """How often a load step that fails is halved."""
    stability: bool = True
    """Count negative eigenvalues of the tangent at every load step."""
    memory: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Memory that a factor may take [GiB]; what the machine has without it."""


class Modes(Record):
    """Modes computed at every load step of a stage (of all stages when None), Newton only.

    ``vibration``: lowest frequencies about the present state, in vacuo. ``buckling``: nearest loads at which the tangent,
    extrapolated linearly along the stage's course, becomes singular.
    """

    kind: Literal["vibration", "buckling"]
    """``vibration`` about the present state, or linearised ``buckling``."""
    count: Annotated[int, Field(ge=1, le=100)] = 4
    """How many."""
    stage: str | None = None
    """Stage at whose load steps they are computed; all without it."""


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
    loads: Annotated[dict[Name, Load], _FEW] = {}
    """Dead loads of unit factor by name."""
    motions: Annotated[dict[Name, Motion], _FEW] = {}
    """Prescribed motions of unit factor by name."""
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
            for name, fabric in {"fabric": self.fabric, **{f"fabrics.{n}": f for n, f in self.fabrics.items()}}.items():
                if fabric is not None and fabric.density is None:
                    raise ValueError(f"{name}.density is missing: modes.kind = 'vibration' needs it")
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

    def _check_planes(self) -> None:
        """Refuse what takes the tangent in contact for that of the structure: it holds springs, where the planes are rigid."""
        if self.planes:
            told = "is not implemented for a scene with planes"
            if self.derivatives or self.modes is not None:
                raise ValueError(f"{'derivatives' if self.derivatives else 'modes'} {told}")
            for stage in self.stages:
                if stage.control == "arc_length" or stage.until == "collapse":
                    key = "control = 'arc_length'" if stage.control == "arc_length" else "until = 'collapse'"
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
