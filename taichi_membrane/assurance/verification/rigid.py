"""Rigid bodies: the end plate of an inflated tube, and a mast that guys hold up."""

from __future__ import annotations

import math

import numpy as np

from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, NoEquilibriumError, Quantity, Solution, solve
from taichi_membrane.mesh import Mesh

_PLATE = {"length": 20.0, "radius": 1.0, "stiffness": 1.0, "nu": 0.0, "pressure": 0.1}
_TIP_LOAD = 1e-5  # 1/160 of the load that wrinkles: the response is linear


def end_plate() -> Benchmark:
    """The inflated cantilever with a rigid plate at its end, on which the pressure and the load act."""
    pull = math.pi * _PLATE["radius"] ** 2 * _PLATE["pressure"]
    deflection = closed_forms.inflated_cantilever(1.0, **_PLATE)
    slope = closed_forms.inflated_slope(1.0, **_PLATE)
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
            Quantity(name="pull of the plate", reference=pull, source="p π r²", bound=0.005),
            Quantity(name="deflection", reference=deflection, source=source, bound=0.005, order=None, remark=beam),
            Quantity(name="slope", reference=slope, source=source, bound=0.005, order=None, remark=beam),
        ),
        run=_bend_with_plate,
    )


def _bend_with_plate(size: int) -> Solution:
    """Inflate the tube, push its plate down, and measure what plate and root do."""
    radius, pressure = _PLATE["radius"], _PLATE["pressure"]
    result = solve(
        {
            "mesh": {
                "shape": "tube", "radius": radius, "length": _PLATE["length"], "around": 4 * size, "along": 8 * size,
                "cap_end": "flat",
            },
            "fabric": {
                "E": _PLATE["stiffness"], "nu": _PLATE["nu"], "thickness": 1.0,
                "prestress": [0.5 * pressure * radius, pressure * radius, 0.0],
            },
            "supports": [{"group": "start", "hold": "xyz"}],
            "bodies": {"plate": {"group": "cap_end"}},
            "loads": {"tip": {"kind": "body", "body": "plate", "force": [0.0, 0.0, -_TIP_LOAD]}},
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
            "deflection": (before.probes["tip"] - after.probes["tip"]) / _TIP_LOAD,
            "slope": math.radians(after.probes["slope"] - before.probes["slope"]) / _TIP_LOAD,
        }
    )


_MAST_HEIGHT, _GUY_REACH, _GUY_STIFFNESS, _GUY_TENSION = 4.0, 3.0, 1000.0, 20.0


def mast() -> Benchmark:
    """A mast on a hinge that guys hold upright, an inverted pendulum: the load at which it falls."""
    source = "P = n (L a²/2 l²)(EA/l₀ - T/l): guys against the inverted pendulum"
    return Benchmark(
        name="mast",
        title="Mast on a hinge with guys",
        setting="L = 4, guys from its top to points 3 off its foot, EA = 1000, taut with T = 20; load on its top per guy.",
        size_label="guys",
        sizes=(4, 8, 16),
        more_sizes=(32,),
        quantities=tuple(
            Quantity(
                name=name,
                reference=_borne_by_a_guy(),
                source=source,
                bound=bound,
                order=None,
                remark="there is no mesh",
            )
            for name, bound in (("load at which it falls", 1e-3), ("load of its lowest mode", 1e-5))
        ),
        run=_load_mast,
    )


def _borne_by_a_guy() -> float:
    """Load on the mast's top for each guy at which it is no longer stable."""
    length = math.hypot(_MAST_HEIGHT, _GUY_REACH)
    return 0.5 * _MAST_HEIGHT * _GUY_REACH**2 / length**2 * (_GUY_STIFFNESS - _GUY_TENSION) / length


def _mast_mesh(guys: int) -> Mesh:
    """Mast and guys as lines, and a held patch of fabric far off, as each mesh has one."""
    angle = 2.0 * np.pi * np.arange(guys) / guys
    feet = np.column_stack([_GUY_REACH * np.cos(angle), _GUY_REACH * np.sin(angle), np.zeros(guys)])
    patch = np.array([[0.0, 90.0, 0.0], [1.0, 90.0, 0.0], [1.0, 91.0, 0.0]])
    return Mesh.build(
        patch, [[0, 1, 2]], lines=[[3, 4], *([4, 5 + k] for k in range(guys))],
        line_groups={"mast": [0], "guys": np.arange(1, 1 + guys)},
        loose_points=np.vstack([[[0.0, 0.0, 0.0], [0.0, 0.0, _MAST_HEIGHT]], feet]),
        loose_groups={"anchors": np.arange(5, 5 + guys), "top": [4]},
    )  # fmt: skip


def _load_mast(guys: int) -> Solution:
    """Load the mast until it falls; and to half of that, for its buckling modes."""
    whole = guys * _borne_by_a_guy()
    stages = {
        "fall": {"name": "fall", "loads": {"weight": 1.2 * whole}, "until": "collapse"},
        "stand": {"name": "stand", "loads": {"weight": 0.5 * whole}},
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
                "cables": {"guys": {"lines": "guys", "EA": _GUY_STIFFNESS, "prestress": _GUY_TENSION}},
                "loads": {"weight": {"group": "top", "direction": [0.0, 0.0, -1.0]}},
                "stages": [stage],
                **({"modes": {"kind": "buckling", "count": 2}} if name == "stand" else {}),
            },
            mesh=_mast_mesh(guys),
        )
        found[name] = result.steps[-1]
    limit, modes = found["fall"].limit, found["stand"].modes
    if limit is None or modes is None or not modes.values:
        raise NoEquilibriumError("the mast did not fall, or has no modes")
    return Solution(
        values={
            "load at which it falls": float(np.mean(limit["load.weight"])) / guys,
            "load of its lowest mode": 0.5 * _borne_by_a_guy() * modes.values[0],
        }
    )
