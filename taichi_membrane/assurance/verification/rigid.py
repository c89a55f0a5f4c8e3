"""Rigid bodies: the end plate of an inflated tube, and a mast that guys hold up."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, NoEquilibriumError, Quantity, Solution, solve
from taichi_membrane.mesh import Mesh


def end_plate() -> Benchmark:
    """The inflated cantilever with a rigid plate at its end, on which the pressure and the load act."""
    radius, length, stiffness, nu, pressure = 1.0, 20.0, 1.0, 0.0, 0.1
    load = 1e-5  # 1/160 of the load that wrinkles: the response is linear

    def run(size: int) -> Solution:
        wall = {
            "E": stiffness,
            "nu": nu,
            "thickness": 1.0,
            "prestress": [0.5 * pressure * radius, pressure * radius, 0.0],
        }
        result = solve(
            {
                "mesh": {
                    "shape": "tube", "radius": radius, "length": length, "around": 4 * size, "along": 8 * size,
                    "cap_end": "flat",
                },
                "fabric": wall,
                "supports": [{"group": "start", "hold": "xyz"}],
                "bodies": {"plate": {"group": "cap_end"}},
                "loads": {"tip": {"kind": "body", "body": "plate", "force": [0.0, 0.0, -load]}},
                "stages": [
                    {"name": "inflate", "pressure": pressure},
                    {"name": "bend", "loads": {"tip": 1.0}},
                ],
                "probes": {
                    "pull": {"kind": "reaction", "group": "start", "component": "x"},
                    "tip": {"kind": "body", "body": "plate", "of": "displacement", "component": "z"},
                    "slope": {"kind": "body", "body": "plate", "of": "rotation", "component": "y"},
                },
            }
        )  # fmt: skip
        before, after = result.steps
        return Solution(
            values={
                "pull of the plate": -before.probes["pull"],
                "deflection": (before.probes["tip"] - after.probes["tip"]) / load,
                "slope": math.radians(after.probes["slope"] - before.probes["slope"]) / load,
            }
        )

    shape = {"length": length, "radius": radius, "stiffness": stiffness, "nu": nu, "pressure": pressure}
    source = "Fichter 1966; Le van and Wielgosz 2005"
    beam = "beam theory, which knows nothing of the clamped root ring"
    return Benchmark(
        name="end_plate",
        title="Inflated cantilever with a rigid end plate",
        setting="L = 20 r, p r/(E t) = 0.1 on the inflated shape, ν = 0, root ring clamped, a rigid plate at the end; pull over "
        "E t r, deflection per load in 1/(E t), slope in 1/(E t r).",
        size_label="elements round a quarter",
        sizes=(3, 6, 12),
        more_sizes=(24,),
        quantities=(
            Quantity(
                name="pull of the plate", reference=math.pi * radius**2 * pressure, source="p π r²", bound=0.005
            ),
            Quantity(
                name="deflection", reference=closed_forms.inflated_cantilever(1.0, **shape), source=source, bound=0.005,
                order=None, remark=beam,
            ),
            Quantity(
                name="slope", reference=closed_forms.inflated_slope(1.0, **shape), source=source, bound=0.005, order=None,
                remark=beam,
            ),
        ),
        run=run,
    )  # fmt: skip


def mast() -> Benchmark:
    """A mast on a hinge that guys hold upright, an inverted pendulum: the load at which it falls."""
    height, reach, stiffness, tension = 4.0, 3.0, 1000.0, 20.0
    length = math.hypot(height, reach)
    each = 0.5 * height * reach**2 / length**2 * (stiffness - tension) / length

    def run(size: int) -> Solution:
        angle = 2.0 * np.pi * np.arange(size) / size
        feet = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(size)])
        patch = np.array([[0.0, 90.0, 0.0], [1.0, 90.0, 0.0], [1.0, 91.0, 0.0]])
        mesh = Mesh.build(
            patch, [[0, 1, 2]], lines=[[3, 4], *([4, 5 + k] for k in range(size))],
            line_groups={"mast": [0], "guys": np.arange(1, 1 + size)},
            loose_points=np.vstack([[[0.0, 0.0, 0.0], [0.0, 0.0, height]], feet]),
            loose_groups={"anchors": np.arange(5, 5 + size), "top": [4]},
        )  # fmt: skip
        stages = {
            "fall": {"name": "fall", "loads": {"weight": 1.2 * size * each}, "until": "collapse"},
            "stand": {"name": "stand", "loads": {"weight": 0.5 * size * each}},
        }
        found = {}
        for name, stage in stages.items():
            result = solve(
                {
                    "mesh": {"shape": "given"},
                    "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
                    "groups": {"patch": {"where": "y > 80"}},
                    "supports": [{"group": "patch", "hold": "xyz"}, {"group": "anchors", "hold": "xyz"}],
                    "bodies": {"mast": {"lines": "mast", "centre": [0.0, 0.0, 0.0], "hold": "xyz"}},
                    "cables": {"guys": {"lines": "guys", "EA": stiffness, "prestress": tension}},
                    "loads": {"weight": {"group": "top", "direction": [0.0, 0.0, -1.0]}},
                    "stages": [stage],
                    **({"modes": {"kind": "buckling", "count": 2}} if name == "stand" else {}),
                },
                mesh=mesh,
            )
            found[name] = result.steps[-1]
        limit, modes = found["fall"].limit, found["stand"].modes
        if limit is None or modes is None or not modes.values:
            raise NoEquilibriumError("the mast did not fall, or has no modes")
        return Solution(
            values={
                "load at which it falls": float(np.mean(limit["load.weight"])) / size,
                "load of its lowest mode": 0.5 * each * modes.values[0],
            }
        )

    source = "P = n (L a²/2 l²)(EA/l₀ - T/l): guys against the inverted pendulum"
    return Benchmark(
        name="mast",
        title="Mast on a hinge with guys",
        setting="L = 4, guys from its top to points 3 off its foot, EA = 1000, taut with T = 20; load on its top per guy.",
        size_label="guys",
        sizes=(4, 8, 16),
        more_sizes=(32,),
        quantities=tuple(
            Quantity(name=name, reference=each, source=source, bound=bound, order=None, remark="there is no mesh")
            for name, bound in (("load at which it falls", 1e-3), ("load of its lowest mode", 1e-5))
        ),
        run=run,
    )
