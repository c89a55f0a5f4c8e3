"""Minimal surfaces: membranes under uniform prestress, like soap films."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import interpolate

from taichi_membrane import shapes
from taichi_membrane.assurance.verification import closed_forms
from taichi_membrane.assurance.verification.benchmark import Benchmark, Curve, Floats, Quantity, Solution, solve
from taichi_membrane.mesh import Mesh
from taichi_membrane.shapes.rings import wall_triangles

# A soft fabric: its stiffness, a tenth of the prestress, hardly hinders the nodes, which have to find the film's shape.
FILM = {"E": 0.1, "nu": 0.0, "thickness": 1.0, "prestress": [1.0, 1.0, 0.0]}


def catenoid() -> Benchmark:
    """A film between two coaxial rings; the mesh starts on the exact surface, and moves by the error of its facets."""
    half = 0.5
    neck = closed_forms.catenoid_neck(half)

    def run(size: int) -> Solution:
        mesh = _catenoid_mesh(neck, half, size)
        result = solve(
            {
                "mesh": {"shape": "given"},
                "fabric": FILM,
                "supports": [{"group": "left", "hold": "xyz"}, {"group": "right", "hold": "xyz"}],
                "stages": [{"name": "relax"}],
                "probes": {
                    "neck": {"kind": "radius", "group": "neck", "axis": "x"},
                    "pull": {"kind": "reaction", "group": "right", "component": "x"},
                },
            },
            mesh,
        )
        place = mesh.points + result.steps[-1].displacement
        return Solution(
            values={"neck radius": result.probe("neck")[-1], "axial force": result.probe("pull")[-1]},
            points=(place[:, 0], np.hypot(place[:, 1], place[:, 2])),
        )

    x = np.linspace(-half, half, 60)
    return Benchmark(
        name="catenoid",
        title="Catenoid",
        setting="Two rings of unit radius one radius apart, uniform isotropic prestress N₀, E t = 0.1 N₀.",
        size_label="elements along",
        sizes=(8, 16, 32),
        more_sizes=(64, 128),
        quantities=(
            Quantity(name="neck radius", reference=neck, source="R = c cosh(h/c)", bound=0.005),
            Quantity(name="axial force", reference=2.0 * math.pi * neck, source="2π c N₀", bound=0.005),
        ),
        run=run,
        curve=Curve(x_label="x / R", y_label="radius / R", x=x, y=neck * np.cosh(x / neck)),
    )


def _catenoid_mesh(neck: float, half: float, along: int) -> Mesh:
    """Rings at equal distances along the axis, which makes all elements of one shape, as the parameters are conformal."""
    around = 4 * along
    axial = np.linspace(-half, half, along + 1)[:, None]
    angle = 2.0 * np.pi * (np.arange(around)[None, :] + 0.5 * (np.arange(along + 1)[:, None] % 2)) / around
    radius = neck * np.cosh(axial / neck)
    points = np.stack([axial + 0.0 * angle, -radius * np.sin(angle), radius * np.cos(angle)], axis=2).reshape(-1, 3)
    triangles = wall_triangles(around=around, along=along, pattern="staggered", first_phase=0)
    ring = np.arange(around)
    groups = {"left": ring, "right": along * around + ring, "neck": along // 2 * around + ring}
    return Mesh.build(points, triangles, groups, None, np.tile([1.0, 0.0, 0.0], (len(triangles), 1)))


def scherk() -> Benchmark:
    """A patch of Scherk's saddle with its boundary held, started on the exact surface like the catenoid."""

    def height(x: Floats, y: Floats) -> Floats:
        return np.asarray(np.log(np.cos(x) / np.cos(y)))

    def run(size: int) -> Solution:
        mesh = _saddle(size, height)
        place = mesh.points + _relaxed(mesh)
        probe = np.flatnonzero(np.hypot(mesh.points[:, 0] - 0.5, mesh.points[:, 1]) < 1e-9)
        return Solution(values={"height at (0.5, 0)": float(place[probe[0], 2]), "area": _area(mesh, place)})

    return Benchmark(
        name="scherk",
        title="Scherk's saddle",
        setting="z = ln(cos x/cos y) over a square of side 2, boundary held, uniform isotropic prestress N₀, E t = 0.1 N₀.",
        size_label="crossed squares along a side",
        sizes=(8, 16, 32),
        more_sizes=(64,),
        quantities=(
            Quantity(
                name="height at (0.5, 0)", reference=math.log(math.cos(0.5)), source="Scherk's surface", bound=0.005
            ),
            Quantity(name="area", reference=closed_forms.scherk_area(1.0), source="Scherk's surface", bound=0.005),
        ),
        run=run,
    )


def hypar() -> Benchmark:
    """The film in a skew quadrilateral of four edges of a tetrahedron, found from the ruled hypar z = x y."""
    rounds = 2  # each resets the rest shape to the last one found

    def run(size: int) -> Solution:
        mesh = _saddle(size, lambda x, y: x * y)
        for _ in range(rounds):
            mesh = Mesh.build(mesh.points + _relaxed(mesh), mesh.triangles, {"rim": mesh.node_groups["rim"]})
        diagonal = np.flatnonzero(np.abs(mesh.points[:, 0] - mesh.points[:, 1]) < 1e-6)
        place = mesh.points[diagonal[np.argsort(mesh.points[diagonal, 0])]]
        return Solution(
            values={
                "height at (0.5, 0.5)": float(interpolate.CubicSpline(place[:, 0], place[:, 2])(0.5)),
                "area": _area(mesh, mesh.points),
            }
        )

    return Benchmark(
        name="hypar",
        title="Film in a skew quadrilateral",
        setting="Straight edges joining (±1, ±1, z = x y), uniform isotropic prestress N₀, E t = 0.1 N₀; the shape is found from "
        "the hypar by two runs, each prestressing the last shape anew.",
        size_label="crossed squares along a side",
        sizes=(4, 8, 16),
        more_sizes=(32,),
        quantities=(
            Quantity(
                name="height at (0.5, 0.5)",
                reference=0.22357957,
                source="finite elements of the minimal-surface problem, extrapolated",
                bound=0.005,
                resolution=4e-4,  # two runs end this near to the fixed point, five to 1e-5
            ),
            Quantity(
                name="area", reference=closed_forms.tetrahedral_film_area(), source="Schwarz' D surface", bound=0.005
            ),
        ),
        run=run,
    )


def _saddle(size: int, height: Callable[[Floats, Floats], Floats]) -> Mesh:
    """A square of side 2 about the origin, raised to the given height."""
    flat = shapes.panel(width=2.0, height=2.0, along_x=size, along_y=size, pattern="crossed")
    x, y = flat.points[:, 0] - 1.0, flat.points[:, 1] - 1.0
    return Mesh.build(np.column_stack((x, y, height(x, y))), flat.triangles, {"rim": flat.node_groups["boundary"]})


def _relaxed(mesh: Mesh) -> Floats:
    """Displacements of the film with its rim held."""
    result = solve(
        {
            "mesh": {"shape": "given"},
            "fabric": FILM | {"warp": [1.0, 0.0, 0.0]},
            "supports": [{"group": "rim", "hold": "xyz"}],
            "stages": [{"name": "relax"}],
        },
        mesh,
    )
    return result.steps[-1].displacement


def _area(mesh: Mesh, place: Floats) -> float:
    """Area of the mesh with its nodes at the given places."""
    first, second, third = (place[mesh.triangles[:, corner]] for corner in range(3))
    return float(0.5 * np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())
