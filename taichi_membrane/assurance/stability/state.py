"""Extreme states: flat, far from equilibrium, hardly pressed or blown up, slack, compressed, inverted, there and back."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import optimize

from taichi_membrane import shapes
from taichi_membrane.assurance.stability import structures
from taichi_membrane.assurance.stability.case import Problem, Sweep
from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

PEERS = "the other solvers in double precision"
_NU = 0.3


def _sphere(pressure: float) -> Problem:
    """A sphere of 128 triangles: its stretch, with the digits of a small one, over that of the closed form."""
    stretch = closed_forms.sphere_stretch(pressure, 1.0, 1.0, _NU)
    # λ - 1/λ = p R (1 - ν)/(E t): by this the extension of a faint pressure keeps its digits.
    exact = 0.5 * pressure * (1.0 - _NU) if pressure < 1e-6 else stretch - 1.0

    def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
        extension = structures.ball_extension(mesh, steps)
        return {"extension": extension / exact if exact else extension}

    return Problem(
        scene=structures.ball(pressure), mesh=structures.ball_mesh(divisions=6), measure=measure,
        exact={"extension": 1.0 if exact else 0.0},
    )  # fmt: skip


def faint() -> Sweep:
    """A sphere under hardly any pressure, and none."""
    return Sweep(
        name="faint", theme="state", title="Hardly any pressure", parameter="p R/(E t)", problem=_sphere,
        setting="Sphere of 288 triangles. The facets make it a few per cent too stiff or too soft.",
        levels=(1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 0.0), more_levels=(1e-14, 1e-16), floor=1e-12,
        against="exact", source="λ - 1/λ = p R (1 - ν)/(E t)", bound=0.05, required=0.0,
    )  # fmt: skip


def burst() -> Sweep:
    """A sphere blown up far beyond what any fabric stands."""
    return Sweep(
        name="burst", theme="state", title="Enormous pressure", parameter="p R/(E t)", problem=_sphere,
        setting="Sphere of 288 triangles, in one step from rest.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4), more_levels=(1e5, 1e6, 1e8),
        against="exact", source="λ - 1/λ = p R (1 - ν)/(E t)", bound=0.05, required=1e4,
    )  # fmt: skip


def flat() -> Sweep:
    """A cushion of two exactly flat sheets."""

    def problem(level: float) -> Problem:
        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"volume": steps[-1].volume}

        return Problem(
            scene={
                "mesh": {"shape": "cushion", "width": 1.0, "height": 1.0, "along_x": 8, "along_y": 8},
                "fabric": {"E": 1.0, "nu": _NU, "thickness": 1.0},
                "groups": {
                    "x_zero": {"where": "x = 0 within 1e-9"},
                    "y_zero": {"where": "y = 0 within 1e-9"},
                },
                "supports": [
                    {"group": "x_zero", "hold": "x"},
                    {"group": "y_zero", "hold": "y"},
                    {"group": "seam", "hold": "z"},
                ],
                "stages": [{"name": "inflate", "pressure": level}],
            },
            measure=measure,
        )  # fmt: skip

    return Sweep(
        name="flat", theme="state", title="Exactly flat start", parameter="p w/(E t)", problem=problem,
        setting="Square cushion, 8 × 8 cells a sheet, its seam in a plane; the volume in one step from none.",
        levels=(1e0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5), more_levels=(1e-6, 1e-7, 1e-8),
        against="peers", source=PEERS, bound=0.01, required=1e-3,
    )  # fmt: skip


def far() -> Sweep:
    """A tube that starts from a crumpled shape."""

    def problem(level: float) -> Problem:
        mesh = shapes.tube(radius=1.0, length=structures.BEAM_LENGTH, around=12, along=12)
        start = level * np.random.default_rng(0).uniform(-1.0, 1.0, size=mesh.points.shape)
        start[mesh.node_groups["start"]] = 0.0

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"volume": steps[-1].volume}

        scene = structures.beam() | {"stages": [{"name": "inflate", "pressure": structures.BEAM_PRESSURE}]}
        return Problem(scene=scene, start=start, measure=measure)

    return Sweep(
        name="far", theme="state", title="Far from equilibrium", parameter="random displacement/radius", problem=problem,
        setting="Tube under pressure, every node displaced at random before the first step; the side of a triangle is 0.5 radii.",
        levels=(0.0, 1e-3, 1e-2, 1e-1, 0.3, 1.0), more_levels=(3.0, 10.0),
        against="base", source="the start does not matter", bound=0.001, required=0.1,
    )  # fmt: skip


def slack() -> Sweep:
    """A strip far longer than the gap it spans, under ever less pressure: an arc, and slack on the way."""
    share, cells = 0.9, 16

    def problem(level: float) -> Problem:
        mesh = structures.graded_panel(np.linspace(0.0, 1.0, cells + 1), np.linspace(0.0, 0.25, 5))
        # A polygon of equal sides in a circle: chord over length is sin(n φ)/(n sin φ) with 2 φ the angle of one side.
        half = optimize.brentq(lambda a: math.sin(cells * a) / (cells * math.sin(a)) - share, 1e-4, 2.0 / cells)
        rise = (1.0 - math.cos(cells * half)) / (2.0 * cells * math.sin(half))

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            middle = np.abs(mesh.points[:, 0] - 0.5) < 1e-9
            return {"rise": float(steps[-1].displacement[middle, 2].mean()) / rise}

        return Problem(
            scene={
                "mesh": structures.GIVEN,
                "fabric": {"E": 1.0, "nu": 0.0, "thickness": 1.0},
                "supports": [{"group": "x_min", "hold": "xz"}, {"group": "x_max", "hold": "z"}, {"group": "all", "hold": "y"}],
                "motions": {
                    "approach": {"kind": "translation", "group": "x_max", "direction": [share - 1.0, 0.0, 0.0], "hold": "x"}
                },
                "stages": [{"name": "slacken", "pressure": level, "motions": {"approach": 1.0}}],
            },
            mesh=mesh, measure=measure, exact={"rise": 1.0},
        )  # fmt: skip

    return Sweep(
        name="slack", theme="state", title="Slack strip", parameter="p w/(E t)", problem=problem,
        setting="Flat strip, 16 × 4 cells, its ends brought together by a tenth under pressure.",
        levels=(1e-3, 1e-4, 1e-5, 1e-6, 1e-7), more_levels=(1e-8, 1e-9, 1e-10),
        against="exact", source="inextensible polygon in a circle", bound=0.01, required=1e-5,
    )  # fmt: skip


def compressed() -> Sweep:
    """A tube pushed together at its ends without pressure: nothing carries, everything is slack or folded."""

    def problem(level: float) -> Problem:
        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            push = steps[-1].reaction[mesh.node_groups["end"], 0].sum()
            return {"force": float(push), "energy": float(steps[-1].energy or 0.0)}

        return Problem(
            scene={
                "mesh": {"shape": "tube", "radius": 1.0, "length": 2.0, "around": 12, "along": 6, "cap_end": "none"},
                "fabric": {"E": 1.0, "nu": _NU, "thickness": 1.0},
                "supports": [{"group": "start", "hold": "xyz"}],
                "motions": {
                    "push": {"kind": "translation", "group": "end", "direction": [-2.0, 0.0, 0.0]},
                },
                "stages": [{"name": "push", "motions": {"push": level}}],
            },
            measure=measure, exact={"force": 0.0, "energy": 0.0},
        )  # fmt: skip

    return Sweep(
        name="compressed", theme="state", title="Compression only", parameter="shortening/length", problem=problem,
        setting="Open tube without pressure, both rings held, one moved towards the other; force over E t r, energy over E t r².",
        levels=(1e-6, 1e-4, 1e-2, 1e-1, 0.5, 0.9), more_levels=(0.99, 1.5), floor=1.0,
        against="exact", source="a tension field does not resist", bound=1e-4, required=0.1,
    )  # fmt: skip


def inverted() -> Sweep:
    """A shallow dome pushed through: it starts on the wrong side of its rim and has to snap back."""

    def problem(level: float) -> Problem:
        disc = shapes.disc(radius=1.0, rings=6)
        radius = np.hypot(disc.points[:, 0], disc.points[:, 1])
        height = 0.3 * (1.0 - radius**2)
        points = np.column_stack((disc.points[:, :2], height))
        mesh = Mesh.build(points, disc.triangles, disc.node_groups)
        start = np.zeros_like(points)
        start[:, 2] = -2.0 * level * height

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"rise": float(steps[-1].displacement[mesh.node_groups["centre"], 2].mean()) + 0.3}

        return Problem(
            scene={
                "mesh": structures.GIVEN,
                "fabric": {"E": 1.0, "nu": _NU, "thickness": 1.0},
                "supports": [{"group": "rim", "hold": "xyz"}],
                "stages": [{"name": "inflate", "pressure": 1e-3}],
            },
            mesh=mesh, start=start, measure=measure,
        )  # fmt: skip

    return Sweep(
        name="inverted", theme="state", title="Inverted dome", parameter="share of a full inversion", problem=problem,
        setting="Dome of rise 0.3 R over a held rim, p R/(E t) = 1e-3 upwards, started between its own shape (0), flat (0.5) and "
        "inverted (1).",
        levels=(0.0, 0.25, 0.5, 0.75, 1.0), more_levels=(1.5, 2.0),
        against="base", source="the dome blown up from its own shape", bound=0.001, required=1.0,
    )  # fmt: skip


def reversed_load() -> Sweep:
    """The beam loaded step by step and unloaded again: the way back ends where it began."""
    steps = 5

    def problem(level: float) -> Problem:
        scene = structures.beam(share=level, steps=steps)
        scene["stages"].append({"name": "unload", "steps": steps, "loads": {"tip": 0.0}})

        def measure(mesh: Mesh, found: Sequence[StepResult]) -> dict[str, float]:
            inflated, peak, back = found[0], found[steps], found[-1]
            moved = np.linalg.norm(peak.displacement - inflated.displacement)
            strain_energy = abs(inflated.energy or 0.0)
            return {
                "way back": float(np.linalg.norm(back.displacement - inflated.displacement) / moved),
                "drift": abs((back.energy or 0.0) - (inflated.energy or 0.0)) / strain_energy,
            }

        return Problem(scene=scene, measure=measure, exact={"way back": 0.0, "drift": 0.0})

    return Sweep(
        name="reversed_load", theme="state", title="There and back", parameter="peak load/collapse load", problem=problem,
        setting="Beam, loaded at its end in five steps, far into wrinkling, and unloaded in five; displacement and energy that are "
        "left over, relative to those at the peak and at the start.",
        levels=(0.3, 0.6, 0.8, 0.9), more_levels=(0.95, 1.0), floor=1.0,
        against="exact", source="elastic: nothing is left", bound=0.001, required=0.9,
    )  # fmt: skip


def cyclic() -> Sweep:
    """A sphere inflated and let down over and over."""

    def problem(level: float) -> Problem:
        scene = structures.ball(0.5)
        scene["stages"] = [
            {"name": f"{word}_{k}", "pressure": value}
            for k in range(int(level))
            for word, value in (("up", 0.5), ("down", 0.05))
        ]

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            first, last = steps[1], steps[-1]
            change = np.linalg.norm(last.displacement - first.displacement) / np.linalg.norm(first.displacement)
            drift = abs((last.energy or 0.0) - (first.energy or 0.0)) / abs(first.energy or 1.0)
            return {"displacement": float(change), "drift": drift}

        return Problem(
            scene=scene, mesh=structures.ball_mesh(), measure=measure, exact={"displacement": 0.0, "drift": 0.0}
        )

    return Sweep(
        name="cyclic", theme="state", title="Cycles of pressure", parameter="cycles", problem=problem,
        setting="Sphere between p R/(E t) = 0.5 and 0.05; the last state against that after the first cycle.",
        levels=(1.0, 10.0, 100.0), more_levels=(400.0,), floor=1.0,
        against="exact", source="elastic: no drift", bound=1e-4, required=100.0,
    )  # fmt: skip


CASES = (faint, burst, flat, far, slack, compressed, inverted, reversed_load, cyclic)
