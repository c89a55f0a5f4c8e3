"""Discs that shrink inside a ring that does not: stress-free strain, hindered by taut and by wrinkled fabric."""

from __future__ import annotations

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Quantity, Solution, solve
from taichi_membrane.mesh import Mesh, with_groups

# So small that the linear theory holds to this share.
_SHRINKAGE = 1e-5
_INNER = 0.5


def shrink() -> Benchmark:
    """A disc of half the radius that shrinks by e: the ring around it is pressed and taut, or held at its rim and wrinkled."""
    taut = closed_forms.shrink_fit(_INNER, 0.3)
    wrinkled = closed_forms.shrink_wrinkled(_INNER)

    def run(size: int) -> Solution:
        values = {}
        for name, nu, law, support in (
            ("taut", 0.3, "none", [{"group": "centre", "hold": "xy"}, {"group": "east", "hold": "y"}]),
            ("wrinkled", 0.0, "tension_field", [{"group": "boundary", "hold": "xy"}]),
        ):
            mesh = _disc(size)
            result = solve(
                {
                    "mesh": {"shape": "given"},
                    "fabric": {"E": 1.0, "nu": nu, "thickness": 1.0, "law": law, "warp": [1.0, 0.0, 0.0]},
                    "supports": [*support, {"group": "all", "hold": "z"}],
                    "pressures": {},
                    "shrinkages": {"cure": {"group": "core", "warp": _SHRINKAGE, "weft": _SHRINKAGE}},
                    "stages": [{"name": "cure", "shrinkages": {"cure": 1.0}}],
                    "solver": {"tolerance": 1e-9},
                },
                mesh,
            )
            step = result.steps[-1]
            seam = mesh.node_groups["seam"]
            outwards = np.einsum("ij,ij->i", step.displacement[seam], mesh.points[seam]) / _INNER
            mean = step.elements.stress[mesh.tri_groups["core"], :2].mean()
            values[f"draw of the seam, {name}"] = -float(outwards.mean()) / (_INNER * _SHRINKAGE)
            values[f"stress in the disc, {name}"] = float(mean) / _SHRINKAGE
        return Solution(values=values)

    fit, field = "shrink fit (Lamé)", "tension field with N r constant, stretched by its disc"
    return Benchmark(
        name="shrink",
        title="Disc that shrinks inside a ring",
        setting="Radii 1/2 and 1, E = 1; the disc shrinks by e = 1e-5. Taut: ν = 0.3, free rim. Wrinkled: ν = 0, held rim.",
        size_label="rings",
        sizes=(8, 16, 32),
        more_sizes=(64,),
        quantities=tuple(
            Quantity(name=f"{what}, {name}", reference=value, source=source, bound=0.01)
            for name, source, (stress, draw) in (("taut", fit, taut), ("wrinkled", field, wrinkled))
            for what, value in (("draw of the seam", draw), ("stress in the disc", stress))
        ),
        run=run,
    )


def _disc(rings: int) -> Mesh:
    """A disc of unit radius whose inner half is the group ``core``, its seam a group of nodes."""
    mesh = shapes.disc(radius=1.0, rings=rings)
    radius = np.linalg.norm(mesh.points, axis=1)
    core = np.flatnonzero(radius[mesh.triangles].mean(axis=1) < _INNER)
    nodes = {"seam": np.flatnonzero(np.isclose(radius, _INNER)), "east": np.array([mesh.points[:, 0].argmax()])}
    return with_groups(mesh, nodes, {"core": core})
