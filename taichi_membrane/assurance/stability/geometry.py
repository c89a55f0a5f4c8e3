"""Extreme meshes: slender and tiny triangles, very large and very small structures, far away, badly numbered."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.stability import structures
from taichi_membrane.assurance.stability.case import Problem, Sweep
from taichi_membrane.assurance.stability.structures import Floats
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

_SMALL = 1e-7  # strain at which linear elasticity is right to as much
_LINEAR = "linear displacements (patch test)"
_SHEET = {"E": 1.0, "nu": 0.3, "thickness": 1.0}


def _patch(mesh: Mesh) -> Problem:
    """Equal stresses both ways in a flat mesh: strains, and how far any node is from linear displacements."""

    def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
        along_x, along_y, deviation = structures.patch_strains(mesh, steps)
        exact = _SMALL * (1.0 - 0.3)
        return {"x": along_x / exact, "y": along_y / exact, "linear": 1.0 + deviation}

    return Problem(
        scene=structures.patch_test(_SHEET, (_SMALL, _SMALL)), mesh=mesh, measure=measure,
        exact={"x": 1.0, "y": 1.0, "linear": 1.0},
    )  # fmt: skip


def aspect() -> Sweep:
    """A panel in its plane whose triangles all are long and thin."""

    def problem(level: float) -> Problem:
        lines = np.linspace(0.0, 1.0, 7)
        return _patch(structures.graded_panel(level * lines, lines**0.9))

    return Sweep(
        name="aspect", theme="geometry", title="Aspect ratio", parameter="length/height of triangles",
        setting="Panel in its plane, 6 × 6 cells, equal stresses both ways.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4), more_levels=(1e5, 1e6), problem=problem,
        against="exact", source=_LINEAR, bound=0.01, required=1e4,
    )  # fmt: skip


def strip() -> Sweep:
    """A strip blown up to an arc, its triangles ever longer along the strip."""
    cells = 8

    def problem(level: float) -> Problem:
        across = np.linspace(0.0, 1.0, cells + 1)
        along = np.linspace(0.0, level / cells * 4.0, 5)
        mesh = structures.graded_panel(across, along)

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            rise = steps[-1].displacement[:, 2]
            middle = np.abs(mesh.points[:, 0] - 0.5) < 1e-9
            return {"rise": float(rise[middle].mean()), "uneven": 1.0 + float(np.ptp(rise[middle]))}

        return Problem(
            scene={
                "mesh": structures.GIVEN,
                "fabric": _SHEET,
                "supports": [
                    {"group": "x_min", "hold": "xz"},
                    {"group": "x_max", "hold": "xz"},
                    {"group": "all", "hold": "y"},
                ],
                "stages": [{"name": "inflate", "pressure": 0.01}],
            },
            mesh=mesh, measure=measure,
        )  # fmt: skip

    return Sweep(
        name="strip", theme="geometry", title="Aspect ratio, inflated", parameter="length/height of triangles",
        setting="Flat strip, long edges held, no motion lengthwise, p w/(E t) = 0.01: every triangle is stretched lengthwise.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4), more_levels=(1e5, 1e6), problem=problem,
        against="base", source="plane strain: the same whatever the length", bound=0.001, required=1e4,
    )  # fmt: skip


def sliver() -> Sweep:
    """A row of slivers inside a panel: two grid lines nearly fall together."""

    def problem(level: float) -> Problem:
        x = np.array([0.0, 0.2, 0.4, 0.5, 0.5 + level, 0.8, 1.0])
        return _patch(structures.graded_panel(x, np.linspace(0.0, 1.0, 7)))

    return Sweep(
        name="sliver", theme="geometry", title="Slivers", parameter="width of a column of cells",
        setting="Panel in its plane, 6 × 6 cells, one column narrow, equal stresses both ways.",
        levels=(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6), more_levels=(1e-7, 1e-8, 1e-9), problem=problem,
        against="exact", source=_LINEAR, bound=0.01, required=1e-4,
    )  # fmt: skip


def needle() -> Sweep:
    """Needles on a curved wall: one node of a sphere next to another."""

    def problem(level: float) -> Problem:
        mesh = structures.ball_mesh()
        points = mesh.points.copy()
        # A node off the planes of symmetry, and its neighbour across one edge.
        inner = np.flatnonzero((points > 0.2).all(axis=1))
        first, second = next((a, b) for a, b in mesh.edges() if a in inner and b in inner)
        points[first] = points[second] + level * (points[first] - points[second])
        points[first] /= np.linalg.norm(points[first])
        mesh = Mesh.build(points, mesh.triangles, mesh.node_groups, None, mesh.tri_warp)

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"volume": steps[-1].volume / mesh.enclosed_volume() - 1.0}

        return Problem(scene=structures.ball(0.1), mesh=mesh, measure=measure)

    return Sweep(
        name="needle", theme="geometry", title="Needles on a sphere", parameter="shortest/usual edge",
        setting="Sphere of 128 triangles, one edge shortened, inflated with p R/(E t) = 0.1.",
        levels=(1e0, 1e-1, 1e-2, 1e-3, 1e-4), more_levels=(1e-5, 1e-6, 1e-7), problem=problem,
        against="base", source="the mesh without needles: two triangles in 128 lose their area", bound=0.01, required=1e-3,
    )  # fmt: skip


def grading() -> Sweep:
    """Cells that grow geometrically from one edge of a panel to the other."""

    def problem(level: float) -> Problem:
        steps = np.geomspace(1.0, level, 8)
        lines = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        return _patch(structures.graded_panel(lines, lines))

    return Sweep(
        name="grading", theme="geometry", title="Jumps of edge length", parameter="longest/shortest edge",
        setting="Panel in its plane, 8 × 8 cells that grow geometrically both ways, equal stresses both ways.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4), more_levels=(1e5, 1e6), problem=problem,
        against="exact", source=_LINEAR, bound=0.01, required=1e3,
    )  # fmt: skip


def smallest() -> Sweep:
    """Meshes of one, two and four triangles."""

    def problem(level: float) -> Problem:
        corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]])
        triangles = {
            1: [[0, 1, 2]],
            2: [[0, 1, 2], [0, 2, 3]],
            4: [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        }[int(level)]
        used = np.unique(triangles)
        groups = {
            f"{axis}_{end}": np.flatnonzero(corners[used, c] == value)
            for c, axis in enumerate("xy")
            for end, value in (("min", 0.0), ("max", 1.0))
        }
        scene = structures.patch_test(_SHEET, (_SMALL, _SMALL))
        if (
            level == 1
        ):  # the stress on its slanted edge, too: in all half a side's pull at each free corner, along one axis
            groups |= {"x_max": np.array([1]), "y_max": np.array([2])}
            pulls = {"right": ("x_max", [0.5 * _SMALL, 0.0, 0.0]), "top": ("y_max", [0.0, 0.5 * _SMALL, 0.0])}
            scene["loads"] = {name: {"group": group, "direction": pull} for name, (group, pull) in pulls.items()}
        mesh = Mesh.build(corners[used], np.searchsorted(used, triangles), groups)

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            exact = _SMALL * (1.0 - 0.3)
            moved = steps[-1].displacement
            return {
                "x": float(moved[mesh.node_groups["x_max"], 0].mean()) / exact,
                "y": float(moved[mesh.node_groups["y_max"], 1].mean()) / exact,
            }

        return Problem(scene=scene, mesh=mesh, measure=measure, exact={"x": 1.0, "y": 1.0})

    return Sweep(
        name="smallest", theme="geometry", title="Few triangles", parameter="triangles",
        setting="Square of four triangles and of two, and one triangle alone, in their plane, equal stresses both ways.",
        levels=(4.0, 2.0, 1.0), problem=problem, against="exact", source=_LINEAR, bound=0.01, required=1.0,
    )  # fmt: skip


def small() -> Sweep:
    """A sphere from metres down to nanometres."""
    return _sized("small", "Very small structures", (1e0, 1e-3, 1e-6, 1e-9), (1e-12, 1e-15), 1e-6)


def large() -> Sweep:
    """A sphere from metres up to gigametres."""
    return _sized("large", "Very large structures", (1e0, 1e3, 1e6, 1e9), (1e12, 1e15), 1e6)


def _sized(name: str, title: str, levels: tuple[float, ...], more: tuple[float, ...], required: float) -> Sweep:
    def problem(level: float) -> Problem:
        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"stretch": structures.ball_stretch(mesh, steps)}

        mesh = structures.ball_mesh(radius=level)
        return Problem(scene=structures.ball(0.5, radius=level), mesh=mesh, measure=measure)

    return Sweep(
        name=name, theme="geometry", title=title, parameter="radius [length]",
        setting="Sphere with t = R inflated with p/E = 0.5: all lengths in proportion.",
        levels=levels, more_levels=more, problem=problem,
        against="base", source="scale invariance", bound=1e-4, required=required,
    )  # fmt: skip


def offset() -> Sweep:
    """A sphere ever farther from the origin."""

    def problem(level: float) -> Problem:
        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            return {"stretch": structures.ball_stretch(mesh, steps)}

        return Problem(scene=structures.ball(0.5), mesh=structures.ball_mesh(offset=2.0 * level), measure=measure)

    return Sweep(
        name="offset", theme="geometry", title="Far from the origin", parameter="distance/diameter",
        setting="Sphere inflated with p R/(E t) = 0.5; coordinates keep 16 digits, so at 1e8 diameters the mesh itself has 8.",
        levels=(0.0, 1e2, 1e4, 1e6, 1e8), more_levels=(1e10, 1e12), problem=problem,
        against="base", source="translation invariance", bound=1e-4, required=1e8,
    )  # fmt: skip


def numbering() -> Sweep:
    """The loaded beam with its nodes, triangles and corners in random order."""

    def problem(level: float) -> Problem:
        ordered = shapes.tube(radius=1.0, length=structures.BEAM_LENGTH, around=12, along=12)
        mesh = _shuffled(ordered, int(level)) if level else ordered
        return Problem(scene=structures.beam() | {"mesh": structures.GIVEN}, mesh=mesh, measure=structures.beam_tip)

    return Sweep(
        name="numbering", theme="geometry", title="Random numbering", parameter="seed of the permutation (0: none)",
        setting="Beam, inflated and loaded to 60 % of collapse.",
        levels=(0.0, 1.0, 2.0), more_levels=(3.0, 4.0, 5.0), problem=problem,
        against="base", source="renumbering invariance", bound=1e-3, required=2.0,
    )  # fmt: skip


def _shuffled(mesh: Mesh, seed: int) -> Mesh:
    """The same mesh with nodes, elements and first corners in an order drawn at random."""
    draw = np.random.default_rng(seed)
    new = draw.permutation(mesh.node_count)
    order = draw.permutation(mesh.tri_count)
    points: Floats = np.empty_like(mesh.points)
    points[new] = mesh.points
    first = draw.integers(0, 3, size=mesh.tri_count)
    rows = np.arange(mesh.tri_count)[:, None]
    triangles = new[mesh.triangles[order][rows, (first[:, None] + np.arange(3)) % 3]]
    groups = {name: new[nodes] for name, nodes in mesh.node_groups.items()}
    warp = None if mesh.tri_warp is None else mesh.tri_warp[order]
    return Mesh.build(points, triangles, groups, None, warp)


def turned() -> Sweep:
    """The beam turned to any direction: nothing may depend on the axes."""

    def problem(level: float) -> Problem:
        mesh = shapes.tube(radius=1.0, length=structures.BEAM_LENGTH, around=12, along=12)
        angle = math.radians(level)
        axis = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
        skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        rotation = np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew
        scene = structures.beam() | {"mesh": structures.GIVEN}
        down = rotation @ np.array([0.0, 0.0, -structures.BEAM_COLLAPSE])
        scene["loads"] = {"tip": {"group": "end", "direction": down.tolist()}}

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            moved = steps[-1].displacement[mesh.node_groups["end"]].mean(axis=0)
            return {"tip": float((rotation.T @ moved)[2])}

        assert mesh.tri_warp is not None
        mesh = Mesh.build(mesh.points @ rotation.T, mesh.triangles, mesh.node_groups, None, mesh.tri_warp @ rotation.T)
        return Problem(scene=scene, mesh=mesh, measure=measure)

    return Sweep(
        name="turned", theme="geometry", title="Turned in space", parameter="degrees about (1, 2, 3)",
        setting="Beam, inflated and loaded to 60 % of collapse.",
        levels=(0.0, 1.0, 37.0, 90.0, 180.0), problem=problem,
        against="base", source="rotation invariance", bound=1e-3, required=180.0,
    )  # fmt: skip


CASES = (aspect, strip, sliver, needle, grading, smallest, small, large, offset, numbering, turned)
