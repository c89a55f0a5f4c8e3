"""What touches rigid obstacles: a tube between plates that come nearer, tubes of liquid on the ground, a strip round a drum."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Quantity, Solution, solve
from taichi_membrane.assurance.verification.shooting import pressed_between
from taichi_membrane.mesh import Mesh

# Of strips that stand for what is infinite along it.
_LENGTH, _SHORT = 0.1, 0.02
_NO_ORDER = "the last node in contact jumps by an element"


def pressed() -> Benchmark:
    """An elastic tube under a pressure that is held, pressed by frictionless plates to four heights."""
    stiffness, heights = 20.0, (1.9, 1.5, 1.0, 0.5)
    widths = [math.pi * (1.0 + 0.5 * height / stiffness) - 0.5 * math.pi * height for height in heights]

    def run(size: int) -> Solution:
        plates = {
            name: {"kind": "plane", "through": [0, 0, z], "normal": [0, 0, -z], "direction": [0, 0, -z]}
            for name, z in (("lid", 1.0), ("floor", -1.0))
        }
        result = solve(
            {
                "mesh": {"shape": "given"},
                "fabric": {"E": stiffness, "nu": 0.0, "thickness": 1.0, "law": "none", "side_strain": "engineering"},
                "supports": [
                    {"group": "all", "hold": "x"}, {"group": "middle", "hold": "y"}, {"group": "equator", "hold": "z"},
                ],
                "obstacles": plates,
                "stages": [
                    {"name": "blow", "pressure": 1.0},
                    *(
                        {"name": f"to_{k}", "obstacles": dict.fromkeys(plates, 1.0 - 0.5 * height), "steps": 2}
                        for k, height in enumerate(heights)
                    ),
                ],
                "probes": {"force": {"kind": "contact", "obstacle": "lid", "component": "z"}},
            },
            _ring(size),
        )  # fmt: skip
        ends = {step.stage: -step.probes["force"] / _LENGTH for step in result.steps}
        return Solution(values={_at(height): ends[f"to_{k}"] for k, height in enumerate(heights)})

    source = "stadium of a tube with T = E t (λ - 1): T = p h/2, F = p b, b = (perimeter - π h)/2"
    return Benchmark(
        name="pressed",
        title="Elastic tube between plates",
        setting="Tube of radius 1, E t = 20 p R, pressure held, frictionless plates moved together; force per length.",
        size_label="elements around",
        sizes=(32, 64, 128),
        more_sizes=(256,),
        quantities=tuple(
            Quantity(name=_at(height), reference=width, source=source, bound=0.006, order=None, remark=_NO_ORDER)
            for height, width in zip(heights, widths, strict=True)
        ),
        run=run,
    )  # fmt: skip


def _at(height: float) -> str:
    return f"force at {height:g} radii"


def _ring(around: int) -> Mesh:
    """A strip of a tube of radius 1 along x."""
    turn = 2 * np.pi * np.arange(around) / around
    section = np.column_stack([np.sin(turn), -np.cos(turn)])
    points = np.concatenate([np.column_stack([np.full(around, x), section]) for x in (0.0, _LENGTH)])
    here, n = np.arange(around), around
    after = (here + 1) % n
    halves = [np.column_stack([here, after, n + here]), np.column_stack([after, n + after, n + here])]
    groups = {name: np.flatnonzero(np.abs(points[:, c]) < 1e-9) for name, c in (("middle", 1), ("equator", 2))}
    return Mesh.build(points, np.stack(halves, axis=1).reshape(-1, 3), groups)


def filled_tube() -> Benchmark:
    """A weightless tube of liquid on the ground, filled higher and higher."""
    heads = (0.1, 0.25, 0.5, 1.0, 2.0)
    exact = [closed_forms.filled_tube(head) for head in heads]
    levels = [height * (1.0 + head) for head, (height, _, _) in zip(heads, exact, strict=True)]

    def run(size: int) -> Solution:
        radius = 0.5 / math.pi
        result = solve(
            {
                "mesh": {"shape": "tube", "radius": radius, "length": _SHORT, "around": size, "along": 1,
                         "cap_start": "none", "cap_end": "none"},
                "groups": {"bottom": {"where": f"z < {-0.999 * radius}"}, "top": {"where": f"z > {0.999 * radius}"}},
                "fabric": {"E": 1e4, "nu": 0.0, "thickness": 0.1, "law": "none"},
                "planes": {"floor": {"through": [0.0, 0.0, -radius], "normal": [0.0, 0.0, 1.0]}},
                "supports": [
                    {"group": "all", "hold": "x"}, {"group": "bottom", "hold": "xy"}, {"group": "top", "hold": "xy"},
                ],
                "loads": {"water": {"kind": "water", "specific_weight": 1.0, "floor": [0.0, 0.0, -radius]}},
                "stages": [
                    {"name": "blow", "pressure": 1.0},
                    {"name": "fill", "pressure": 0.0, "loads": {"water": levels[-1]}, "steps": 4},
                    *({"name": f"head_{k}", "loads": {"water": levels[k]}} for k in reversed(range(len(heads) - 1))),
                ],
                "probes": {"crown": {"kind": "displacement", "group": "top", "component": "z"},
                           "bears": {"kind": "contact", "obstacle": "floor", "component": "z"}},
            }
        )  # fmt: skip
        ends = {step.stage: step for step in result.steps}
        values: dict[str, float] = {}
        for k, (head, level) in enumerate(zip(heads, levels, strict=True)):
            step = ends[f"head_{k}" if k < len(heads) - 1 else "fill"]
            height, tension, width = _names(head)
            values[height] = 2.0 * radius + step.probes["crown"]
            # The elements beside the two nodes that are held across share it unevenly.
            values[tension] = float(np.median(step.elements.major_resultant))
            values[width] = step.probes["bears"] / (_SHORT * level)
        return Solution(values=values)

    source = "T dθ/ds = γ y of a weightless section: T = γ H (2 y₀ + H)/4, contact width A/y₁ (elliptic integrals)"
    quantities = [
        Quantity(name=name, reference=value, source=source, bound=0.005, order=None, remark=_NO_ORDER)
        for head, values in zip(heads, exact, strict=True)
        for name, value in zip(_names(head), values, strict=True)
    ]
    return Benchmark(
        name="filled_tube",
        title="Tubes of liquid on the ground",
        setting="Weightless inextensible tube of perimeter 1 on a smooth plane, full of a liquid, γ = 1, at five heads.",
        size_label="elements around",
        sizes=(48, 96, 192),
        more_sizes=(384,),
        quantities=tuple(quantities),
        run=run,
    )


def _names(head: float) -> tuple[str, str, str]:
    """Of the quantities at a head."""
    return (
        f"height, y₀/H = {head:g}",
        f"tension, y₀/H = {head:g}",
        f"force over pressure at the ground, y₀/H = {head:g}",
    )


def pressed_sphere() -> Benchmark:
    """A sphere blown up by a quarter and pressed by frictionless plates to its first size less a quarter."""
    nu, load, gap = 0.3, 0.63, 1.5
    exact = pressed_between(load, nu, gap)

    def run(size: int) -> Solution:
        held = {f"{axis}_zero": f"{axis} = 0 within 1e-9" for axis in "xyz"}
        plates = {
            name: {"kind": "plane", "through": [0, 0, 1.5 * z], "normal": [0, 0, -z], "direction": [0, 0, -z]}
            for name, z in (("lid", 1.0), ("floor", -1.0))
        }
        result = solve(
            {
                "mesh": {"shape": "sphere", "radius": 1.0, "divisions": size},
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0, "side_strain": "green"},
                "groups": {name: {"where": where} for name, where in held.items()},
                "supports": [{"group": name, "hold": name[0]} for name in held],
                "obstacles": plates,
                "stages": [
                    {"name": "blow", "pressure": load, "steps": 2},
                    {"name": "press", "obstacles": dict.fromkeys(plates, 1.5 - 0.5 * gap), "steps": 2},
                ],
                "probes": {
                    "force": {"kind": "contact", "obstacle": "lid", "component": "z"},
                    "radius": {"kind": "radius", "group": "z_zero", "axis": "z"},
                    "volume": {"kind": "volume"},
                },
            }
        )
        last = result.steps[-1].probes
        return Solution(values={"force": -last["force"], "radius": last["radius"], "volume": last["volume"]})

    source = "rotationally symmetric tension field, flat under the plates, by shooting; F = p π a²"
    quantities = (("force", exact.force), ("radius", exact.radius), ("volume", exact.volume))
    return Benchmark(
        name="pressed_sphere",
        title="Sphere between plates",
        setting="St Venant-Kirchhoff sphere, ν = 0.3, p R/(E t) = 0.63 (free stretch 1.25), pressed to a height of 1.5 R.",
        size_label="elements along a quarter of a great circle",
        sizes=(6, 12, 24),
        more_sizes=(48,),
        quantities=tuple(
            Quantity(name=name, reference=value, source=source, bound=0.01, order=None, remark=_NO_ORDER)
            for name, value in quantities
        ),
        run=run,
    )


def capstan() -> Benchmark:
    """A strip over half a drum with friction, drawn until all of it slips."""
    frictions = (0.2, 0.5)

    def run(size: int) -> Solution:
        values = {}
        for friction in frictions:
            drum = {"kind": "cylinder", "centre": [0, 0, 0], "axis": [0, 1, 0], "radius": 1.0, "friction": friction}
            result = solve(
                {
                    "mesh": {"shape": "given"},
                    "fabric": {"E": 1e5, "nu": 0.0, "thickness": 1.0, "law": "none"},
                    "supports": [{"group": "all", "hold": "y"}, {"group": "slack", "hold": "x"}],
                    "obstacles": {"drum": drum},
                    "pressures": {},
                    "loads": {"hold": {"group": "slack", "direction": [0, 0, -1]}},
                    "motions": {"pull": {"kind": "translation", "group": "pulled", "direction": [0, 0, -1], "hold": "xz"}},
                    "stages": [
                        {"name": "tighten", "loads": {"hold": 1.0}}, {"name": "pull", "motions": {"pull": 0.02}, "steps": 2},
                    ],
                    "probes": {"pulled": {"kind": "reaction", "group": "pulled", "component": "z"}},
                    "solver": {"tolerance": 1e-8},
                },
                _strip(size),
            )  # fmt: skip
            values[f"force, μ = {friction:g}"] = -result.steps[-1].probes["pulled"]
        return Solution(values=values)

    source = "exp(μ φ) over an angle φ = π (Euler, Eytelwein)"
    return Benchmark(
        name="capstan",
        title="Strip round a drum, with friction",
        setting="Strip over half a cylinder, held by a force of 1 at one end and drawn at the other until all of it slips.",
        size_label="elements along the half circle",
        sizes=(16, 32, 64),
        more_sizes=(128,),
        quantities=tuple(
            Quantity(name=f"force, μ = {friction:g}", reference=math.exp(friction * math.pi), source=source, bound=5e-4)
            for friction in frictions
        ),
        run=run,
    )


def _strip(parts: int) -> Mesh:
    """A strip over the upper half of a cylinder of radius 1 along y, with straight ends that hang down, of two lengths."""
    angle, ends = np.pi * np.arange(parts + 1) / parts, np.array([0.1, 0.2])
    x = np.concatenate([np.full(2, 1.0), np.cos(angle), np.full(2, -1.0)])
    z = np.concatenate([-2.0 * ends[::-1], np.sin(angle), -ends])
    n = len(x)
    points = np.concatenate([np.column_stack([x, np.full(n, y), z]) for y in (0.0, _LENGTH)])
    here = np.arange(n - 1)
    halves = [np.column_stack([here, here + 1, n + here]), np.column_stack([here + 1, n + here + 1, n + here])]
    return Mesh.build(
        points, np.concatenate(halves), {"slack": np.array([0, n]), "pulled": np.array([n - 1, 2 * n - 1])}
    )
