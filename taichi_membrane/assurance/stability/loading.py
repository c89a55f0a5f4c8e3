"""Extreme loads: single nodes, collapse and beyond, steps far too large, pressure that fails, moment and torsion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.stability import structures
from taichi_membrane.assurance.stability.case import Problem, Sweep
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

PEERS = "the other solvers in double precision"
_X_AXIS = {"axis": [1.0, 0.0, 0.0], "through": [0.0, 0.0, 0.0]}


def single_node() -> Sweep:
    """All of the load on the one node at the top of the beam's end ring."""

    def problem(level: float) -> Problem:
        scene = structures.beam(share=level)
        scene["groups"] = {"top": {"where": f"x = {structures.BEAM_LENGTH} within 1e-9 and z > 0.99"}}
        scene["loads"] = {"tip": scene["loads"]["tip"] | {"group": "top"}}

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            top = (np.abs(mesh.points[:, 0] - structures.BEAM_LENGTH) < 1e-9) & (mesh.points[:, 2] > 0.99)
            return {"dent": float(steps[-1].displacement[top, 2].mean())}

        return Problem(scene=scene, measure=measure)

    return Sweep(
        name="single_node", theme="load", title="Load on a single node", parameter="load/collapse load", problem=problem,
        setting="Beam, its end load on one node of the ring, pressing down: it dents the fabric.",
        levels=(0.01, 0.1, 0.3, 0.6, 0.8), more_levels=(0.9, 1.0, 2.0, 5.0),
        against="peers", source=PEERS, bound=0.01, required=0.3,
    )  # fmt: skip


def collapse() -> Sweep:
    """A slender tube up to its collapse load, and beyond."""
    length, pressure = 12.0, 1e-3
    largest = 1.049836  # on this mesh, by load steps of 5e-5 and arc length in the last

    def problem(level: float) -> Problem:
        scene = structures.beam()
        scene["mesh"] = {"shape": "tube", "radius": 1.0, "length": length, "around": 12, "along": 24}
        scene["loads"] = {"tip": {"group": "end", "direction": [0.0, 0.0, -math.pi * pressure / length]}}
        scene["stages"] = [{"name": "inflate", "pressure": pressure}, {"name": "load", "loads": {"tip": level}}]
        return Problem(scene=scene, measure=structures.beam_tip, collapse={"load.tip": largest})

    return Sweep(
        name="collapse", theme="load", title="Collapse", parameter="load/π p r³ L⁻¹", problem=problem,
        setting="Tube clamped at one end, L = 12 r, p r/(E t) = 1e-3, its end load in one step. Small steps follow this "
        "mesh's path up to 1.049836: 1.0488 is 0.999 of it. Beyond, a solver may find the fallen tube, or says that there is "
        "nothing; a bracket has to hold that value.",
        levels=(0.5, 0.9, 1.0, 1.04, 1.0488, 1.06, 2.0), more_levels=(10.0, 1000.0),
        against="peers", source=PEERS, bound=0.01, required=1.0,
    )  # fmt: skip


def snap() -> Sweep:
    """A shallow six-sided tent whose tip is pushed down, up to where it snaps through, and beyond: one degree of freedom."""
    sides, rise = 6, 0.1
    inner = math.cos(math.pi / sides)
    slant = math.hypot(inner, rise)
    stiffness = sides * math.sin(math.pi / sides) * slant  # E times the volume of the fabric
    largest = stiffness * rise**3 / (3.0 * math.sqrt(3.0) * slant**4)

    def height(share: float) -> float:
        """The tip's height on the stable branch that the load leads to: a root of h (r² - h²) = P, Green's strain."""
        roots = np.roots([-1.0, 0.0, rise**2, -2.0 * slant**4 / stiffness * share * largest])
        real = roots[np.abs(roots.imag) < 1e-6 * rise].real
        return float(real.max() if share <= 1.0 else real.min())

    def problem(level: float) -> Problem:
        angle = 2.0 * np.pi * np.arange(sides) / sides
        rim = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(sides)))
        triangles = np.array([[0, 1 + k, 1 + (k + 1) % sides] for k in range(sides)])
        mesh = Mesh.build(np.vstack([[0.0, 0.0, rise], rim]), triangles, {"tip": [0], "rim": range(1, 1 + sides)})

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"height": (rise + float(steps[-1].displacement[0, 2])) / rise}

        return Problem(
            scene={
                "mesh": structures.GIVEN,
                "fabric": {"E": 1.0, "nu": 0.0, "thickness": 1.0, "law": "none"},
                "supports": [{"group": "rim", "hold": "xyz"}, {"group": "tip", "hold": "xy"}],
                "loads": {"push": {"group": "tip", "direction": [0.0, 0.0, -largest]}},
                "stages": [{"name": "push", "loads": {"push": level}}],
            },
            mesh=mesh, measure=measure, exact={"height": height(level) / rise}, collapse={"load.push": 1.0},
        )  # fmt: skip

    return Sweep(
        name="snap", theme="load", title="Snap-through", parameter="load/largest stable load", problem=problem,
        setting="Six-sided tent of rise 0.1 R without wrinkling, its tip pushed down in one step; beyond its largest stable load "
        "it hangs, and a solver finds that or brackets the largest load.",
        levels=(0.5, 0.9, 0.99, 0.999, 1.01, 2.0), more_levels=(1.001, 10.0), floor=1.0,
        against="exact", source="P ~ h (r² - h²)", bound=0.01, required=0.999,
    )  # fmt: skip


def large_steps() -> Sweep:
    """Pressure and load at once, in ever fewer steps."""

    def problem(level: float) -> Problem:
        scene = structures.beam()
        scene["stages"] = [
            {
                "name": "all", "steps": int(level), "pressure": structures.BEAM_PRESSURE, "loads": {"tip": 0.8},
            }
        ]  # fmt: skip
        return Problem(scene=scene, measure=structures.beam_tip)

    return Sweep(
        name="large_steps", theme="load", title="Steps too large", parameter="steps", problem=problem,
        setting="Beam, pressure and 80 % of the collapse load rising together from nothing.",
        levels=(100.0, 30.0, 10.0, 3.0, 1.0),
        against="base", source="a hundred steps: an elastic state knows no path", bound=0.001, required=1.0,
    )  # fmt: skip


def failing_pressure() -> Sweep:
    """The loaded beam loses its pressure."""
    share = 0.4

    def problem(level: float) -> Problem:
        scene = structures.beam(share=share)
        scene["stages"].append({"name": "leak", "steps": 4, "pressure": level * share * structures.BEAM_PRESSURE})
        return Problem(scene=scene, measure=structures.beam_tip)

    return Sweep(
        name="failing_pressure", theme="load", title="Pressure that fails",
        parameter="pressure/pressure of collapse", problem=problem,
        setting="Beam at 40 % of its collapse load, the pressure let off in four steps; below 1 it folds and hangs.",
        levels=(2.0, 1.5, 1.2, 1.1, 1.05, 0.95, 0.5), more_levels=(0.1, 0.0),
        against="peers", source=PEERS, bound=0.01, required=1.2,
    )  # fmt: skip


def torsion() -> Sweep:
    """A tube turned until every triangle is wrinkled."""
    radius, length, pressure, nu = 1.0, 3.0, 1e-3, 0.3
    limit = math.sqrt(2.0) * math.pi * pressure * radius**3
    onset = limit / (2.0 * math.pi * radius**3 / (2.0 * (1.0 + nu))) * length

    def problem(level: float) -> Problem:
        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            last = steps[-1]
            wrinkled = float((last.elements.state != 0).mean())
            return {"torque": last.probes["torque"] / limit, "wrinkled": wrinkled}

        exact = {"torque": min(level, 1.0)}
        return Problem(
            scene={
                "mesh": {
                    "shape": "tube", "radius": radius, "length": length, "around": 16, "along": 12, "cap_end": "none",
                },
                "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0},
                "supports": [{"group": "start", "hold": "xyz"}],
                "motions": {"turn": {"kind": "rotation", "group": "end", **_X_AXIS, "hold": "yz"}},
                "loads": {
                    "lid": {"group": "end", "direction": [math.pi * radius**2 * pressure, 0.0, 0.0], "spread": "edges"}
                },
                "stages": [
                    {"name": "inflate", "pressure": pressure, "loads": {"lid": 1.0}},
                    {"name": "turn", "motions": {"turn": math.degrees(level * onset / radius)}},
                ],
                "probes": {"torque": {"kind": "moment", "group": "end", **_X_AXIS}},
            },
            measure=measure, exact=exact,
        )  # fmt: skip

    return Sweep(
        name="torsion", theme="load", title="Torsion", parameter="turn/turn at the wrinkling torque", problem=problem,
        setting="Tube 16 around, its ends held round, p r/(E t) = 1e-3, turned in one step.",
        levels=(0.5, 1.0, 2.0, 5.0, 10.0, 20.0), more_levels=(50.0, 100.0, 200.0),
        against="peers", source=PEERS, bound=0.01, required=10.0,
    )  # fmt: skip


def moment() -> Sweep:
    """A tube bent by a couple at its end, up to and beyond the moment at which it is wrinkled all over."""

    def problem(level: float) -> Problem:
        scene = structures.beam()
        mesh = shapes.tube(radius=1.0, length=structures.BEAM_LENGTH, around=12, along=12)
        ring = mesh.node_groups["end"]
        height = mesh.points[ring, 2]
        upper, lower = ring[height > 1e-9], ring[height < -1e-9]
        arm = mesh.points[upper, 2].mean() - mesh.points[lower, 2].mean()
        force = math.pi * structures.BEAM_PRESSURE / arm
        scene["mesh"] = structures.GIVEN
        scene["loads"] = {
            "pull": {"group": "upper", "direction": [force, 0.0, 0.0]},
            "push": {"group": "lower", "direction": [-force, 0.0, 0.0]},
        }
        scene["stages"][1] = {"name": "bend", "loads": {"pull": level, "push": level}}
        groups = {**mesh.node_groups, "upper": upper, "lower": lower}
        mesh = Mesh.build(mesh.points, mesh.triangles, groups, None, mesh.tri_warp)
        return Problem(scene=scene, mesh=mesh, measure=structures.beam_tip)

    return Sweep(
        name="moment", theme="load", title="Bending moment", parameter="moment/π p r³", problem=problem,
        setting="Beam bent by forces along its axis, pulling at the upper half of its end ring and pushing at the lower; they keep "
        "their direction. Arc length finds the largest stable moment of this mesh at 0.867; beyond, the end may jump to where the "
        "arm is short enough.",
        levels=(0.5, 0.7, 0.8, 0.86, 0.9, 1.1, 2.0), more_levels=(10.0, 100.0),
        against="peers", source=PEERS, bound=0.01, required=0.8,
    )  # fmt: skip


CASES = (single_node, collapse, snap, large_steps, failing_pressure, torsion, moment)
