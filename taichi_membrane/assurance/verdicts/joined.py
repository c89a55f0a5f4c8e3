"""Structures of several parts and several loads: guyed beams, rings, a T of seamed sheets, cushions, stages after a collapse."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_membrane import shapes
from taichi_membrane.assurance.stability import structures
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import BEAM_COLLAPSE, BEAM_LENGTH, BEAM_PRESSURE, GIVEN
from taichi_membrane.assurance.verdicts.building import traced
from taichi_membrane.assurance.verdicts.case import Case, holds, limit, nothing
from taichi_membrane.assurance.verdicts.snaps import tent
from taichi_membrane.mesh import Mesh

_STEPS = (1, 3, 10, 40)


def beam_mesh() -> Mesh:
    """The stability sweeps' beam as an object."""
    return shapes.tube(radius=1.0, length=BEAM_LENGTH, around=12, along=12, cap_end="hemisphere")


def beam(
    steps: int,
    mesh: Mesh | None = None,
    loads: Mapping[str, float] | None = None,
    fabric: Mapping[str, Any] | None = None,
    **stage: Any,
) -> Problem:
    """The stability sweeps' beam to 1.5 times π p r³/L, or to other loads: down at its end, sideways there, up at its cap."""
    scene = structures.beam(fabric)
    scene["mesh"] = GIVEN
    size = BEAM_COLLAPSE
    scene["loads"] |= {
        "side": {"group": "end", "direction": [0.0, size, 0.0]},
        "up": {"group": "cap_end", "direction": [0.0, 0.0, size]},
    }
    last = {"name": "load", "steps": steps, "loads": dict(loads or {"tip": 1.5}), "until": "collapse", **stage}
    scene["stages"] = [scene["stages"][0], last]
    return Problem(scene=scene, mesh=beam_mesh() if mesh is None else mesh, measure=nothing)


def _regrouped(mesh: Mesh, points: Any, triangles: Any, more: Mapping[str, Any] | None = None) -> Mesh:
    """The mesh with other points and triangles, the same groups and some more."""
    groups = {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    return Mesh.build(points, triangles, {**groups, **(more or {})}, None, mesh.tri_warp)


def _renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same mesh, its nodes numbered at random."""
    new = np.random.default_rng(seed).permutation(mesh.node_count).astype(np.int32)
    groups = {name: new[members] for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    return Mesh.build(points, new[mesh.triangles], groups, None, mesh.tri_warp)


def guyed(steps: int, kind: str) -> Problem:
    """The beam with a guy from foot to end above and one below, 0.2 stiff; the lower one goes slack as a cable."""
    mesh = beam_mesh()
    x, z = mesh.points[:, 0], mesh.points[:, 2]
    at = {
        f"{word}_{side}": [int(np.argmax(sign * z - 100.0 * (np.abs(x - place) > 1e-6)))]
        for word, place in (("foot", 0.0), ("end", BEAM_LENGTH))
        for side, sign in (("upper", 1.0), ("lower", -1.0))
    }
    problem = beam(steps, _regrouped(mesh, mesh.points, mesh.triangles, at), {"tip": 6.0})
    scene = dict(problem.scene)
    scene["cables"] = {
        side: {"nodes": [f"foot_{side}", f"end_{side}"], "EA": 0.2, "kind": kind} for side in ("upper", "lower")
    }
    return Problem(scene=scene, mesh=problem.mesh, measure=nothing)


def turned(steps: int) -> Problem:
    """The beam and its load turned in space."""
    mesh, turn = beam_mesh(), Rotation.from_euler("zyx", [37.0, 21.0, -55.0], degrees=True)
    points = mesh.points @ turn.as_matrix().T
    groups = {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    warp = None if mesh.tri_warp is None else mesh.tri_warp @ turn.as_matrix().T
    problem = beam(steps, Mesh.build(points, mesh.triangles, groups, None, warp))
    scene = dict(problem.scene)
    scene["loads"] = {"tip": {"group": "end", "direction": turn.apply([0.0, 0.0, -BEAM_COLLAPSE]).tolist()}}
    return Problem(scene=scene, mesh=problem.mesh, measure=nothing)


def ring(steps: int, lean: float) -> Problem:
    """A ring of radius 4 and tube radius 1, held across one side and pressed together, leaning out of its plane by a share."""
    around, across = 24, 10
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    along, over = 2.0 * np.pi * i / around, 2.0 * np.pi * j / across
    far = 4.0 + np.cos(over)
    points = np.column_stack((far * np.cos(along), far * np.sin(along), np.sin(over)))

    def node(u: int, v: int) -> int:
        return (u % around) * across + v % across

    triangles = []
    for u, v in zip(i.tolist(), j.tolist(), strict=True):
        a, b, c, d = node(u, v), node(u + 1, v), node(u + 1, v + 1), node(u, v + 1)
        triangles += [[a, b, c], [a, c, d]] if (u + v) % 2 else [[a, b, d], [b, c, d]]
    groups = {"pressed": np.flatnonzero(i == 0), "held": np.flatnonzero(i == around // 2)}
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0},
            "supports": [{"group": "held", "hold": "xyz"}],
            "loads": {"pinch": {"group": "pressed", "direction": [-1.0, 0.3 * lean, lean]}},
            "stages": [
                {"name": "inflate", "pressure": BEAM_PRESSURE},
                {"name": "pinch", "steps": steps, "loads": {"pinch": 0.03}, "until": "collapse"},
            ],
        },
        mesh=Mesh.build(points, np.array(triangles), groups),
        measure=nothing,
    )


def tee_mesh(arm: int = 8) -> Mesh:
    """Two flat sheets in the shape of a T, seamed along their rim: squares of half a unit, two wide, cut in four."""
    cells = [(i, j) for i in range(-1 - arm, 1 + arm) for j in range(2)]
    cells += [(i, j) for i in range(-1, 1) for j in range(-arm, 0)]
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    sides: Counter[frozenset[tuple[int, int]]] = Counter()
    for i, j in cells:
        ring_of = [(i + a, j + b) for a, b in corners]
        sides.update(frozenset((ring_of[k], ring_of[(k + 1) % 4])) for k in range(4))
    seam = {place for side, count in sides.items() if count == 1 for place in side}
    places = sorted({place for side in sides for place in side})
    upper = {place: number for number, place in enumerate(places)}
    points = [(0.5 * a, 0.5 * b, 0.0) for a, b in places]
    lower = {}
    for place in places:
        lower[place] = upper[place] if place in seam else len(points)
        if place not in seam:
            points.append((0.5 * place[0], 0.5 * place[1], 0.0))
    triangles = []
    for i, j in cells:
        for sheet, outward in ((upper, 1), (lower, -1)):
            middle = len(points)
            points.append((0.5 * i + 0.25, 0.5 * j + 0.25, 0.0))
            ring_at = [sheet[i + a, j + b] for a, b in corners]
            triangles += [[ring_at[k], ring_at[(k + 1) % 4], middle][::outward] for k in range(4)]
    x, y = np.array(points)[:, 0], np.array(points)[:, 1]
    reach = 0.5 * (arm + 1) - 1e-9
    groups = {"foot": y < -0.5 * arm + 1e-9, "left": x < -reach, "right": x > reach}
    return Mesh.build(points, np.array(triangles), {name: np.flatnonzero(where) for name, where in groups.items()})


def tee(steps: int, left: float, right: float) -> Problem:
    """The T blown up on its foot, the ends of its arms loaded in its plane."""
    return Problem(
        scene={
            "mesh": GIVEN,
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.01},
            "supports": [{"group": "foot", "hold": "xyz"}, *({"group": one, "hold": "z"} for one in ("left", "right"))],
            "loads": {one: {"group": one, "direction": [0.0, -1.0, 0.0]} for one in ("left", "right")},
            "stages": [
                {"name": "inflate", "steps": 2, "pressure": 0.02},
                {"name": "load", "steps": steps, "loads": {"left": left, "right": right}, "until": "collapse"},
            ],
        },
        mesh=tee_mesh(),
        measure=nothing,
    )


def cushion(steps: int, *, pressure: float | None = None, snow: float | None = None) -> Problem:
    """A cushion held along its seam, blown up to 0.1, then brought to another pressure or snowed upon."""
    last = {"pressure": pressure} if pressure is not None else {"loads": {"snow": snow}, "until": "collapse"}
    return Problem(
        scene={
            "mesh": {"shape": "cushion", "width": 1.0, "height": 1.0, "along_x": 6, "along_y": 6, "pattern": "crossed"},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.01},
            "supports": [{"group": "seam", "hold": "xyz"}],
            "loads": {"snow": {"group": "top", "kind": "area", "direction": [0.0, 0.0, -1.0]}},
            "stages": [{"name": "blow", "pressure": 0.1}, {"name": "load", "steps": steps, **last}],
        },
        measure=nothing,
    )


def again(steps: int) -> Problem:
    """The beam pressed to collapse, blown up to twice its pressure in that state, then pressed again."""
    problem = beam(2, loads={"tip": 2.0})
    scene = dict(problem.scene)
    scene["stages"] = [
        *scene["stages"],
        {"name": "more", "pressure": 2.0 * BEAM_PRESSURE},
        {"name": "again", "steps": steps, "loads": {"tip": 3.0}, "until": "collapse"},
    ]
    return Problem(scene=scene, mesh=problem.mesh, measure=nothing)


def there_and_back(steps: int) -> Problem:
    """A tent that has snapped through, pushed back: by symmetry at the opposite of the load at which it snapped."""
    problem = tent(6, 0.1, "force", share=2.0, steps=3, snaps="pass")
    scene = dict(problem.scene)
    scene["stages"] = [*scene["stages"], {"name": "back", "steps": steps, "loads": {"push": -2.0}}]
    return Problem(scene=scene, mesh=problem.mesh, measure=nothing)


def unmoved(steps: int) -> Problem:
    """The beam under a load on its held end, along the path."""
    problem = beam(steps, loads={"tip": 5.0}, control="arc_length", until="target")
    scene = dict(problem.scene)
    scene["loads"] = {"tip": {"group": "start", "direction": [0.0, 0.0, -1.0]}}
    return Problem(scene=scene, mesh=problem.mesh, measure=nothing)


def cases() -> Iterator[Case]:
    """All of this family's."""
    parts: dict[str, Any] = {"family": "joined", "size": "default", "steps": _STEPS}
    for name, problem, setting in (
        ("two_loads", lambda steps: beam(steps, loads={"tip": 1.5, "side": 0.7}), "Beam under two loads across, at 1.5 to 0.7."),
        ("load_and_pressure", lambda steps: beam(steps, loads={"tip": 3.0}, pressure=2.0 * BEAM_PRESSURE),
         "Beam whose load rises to 3 π p r³/L while its pressure doubles."),
        ("turned", turned, "Beam and load turned in space."),
        ("renumbered", lambda steps: beam(steps, _renumbered(beam_mesh(), 1)), "Beam whose nodes are numbered at random."),
        ("guyed_cable", lambda steps: guyed(steps, "cable"), "Beam with a guy above and below, one of which goes slack."),
        ("guyed_bar", lambda steps: guyed(steps, "bar"), "Beam with a bar above and below: it bears four times as much."),
        ("ring", lambda steps: ring(steps, 1e-3), "Ring pressed together, a thousandth out of its plane."),
        ("tee_even", lambda steps: tee(steps, 3e-3, 2.997e-3), "T of seamed sheets, its arms loaded alike but for a thousandth."),
        ("tee_odd", lambda steps: tee(steps, 6e-3, -6e-3), "T of seamed sheets, its arms loaded in opposite directions."),
        ("snow", lambda steps: cushion(steps, snow=0.2), "Cushion under snow of twice its pressure."),
        ("again", again, "Beam pressed to collapse, blown up further there, pressed again."),
    ):  # fmt: skip
        yield traced(f"joined_{name}", problem=problem, setting=setting, **parts)
    shear = {"E_warp": 3.0, "E_weft": 0.3, "nu": 0.5, "G": 0.01, "thickness": 1.0}
    for name, problem, setting in (
        ("leak", lambda steps: beam(steps, loads={"tip": 0.9}, pressure=0.4 * BEAM_PRESSURE),
         "Beam whose load rises while its pressure falls."),
        ("shear", lambda steps: beam(steps, fabric=shear),
         "Beam of a fabric soft in shear: it sways a little, and back, before it collapses."),
    ):  # fmt: skip
        yield traced(f"joined_{name}", problem=problem, setting=setting, family="joined", steps=(1, 10, 40, 80, 200))
    yield Case(
        name="joined_through", problem=lambda steps: cushion(steps, pressure=-0.002), **{**parts, "steps": (1, 3, 10, 40, 51)},
        truth=holds(), setting="Cushion blown up to 0.1, then to -0.002 on the other side of flat and slack.",
    )  # fmt: skip
    yield Case(
        name="joined_back", problem=there_and_back, truth=limit("load.push", -1.0, width=0.0, source="closed form"), **parts,
        setting="Tent that has snapped through, pushed back.",
    )  # fmt: skip
    yield Case(
        name="joined_unmoved", problem=unmoved, truth=holds(), **parts, setting="Beam under a load on its held end, by arc length.",
    )  # fmt: skip
    for off in (-1e-3, -1e-5, 1e-5, 1e-3):

        def near(steps: int, off: float = off) -> Problem:
            return tent(6, 0.1, "force", share=1.0 + off, steps=steps)

        known = holds("closed form") if off < 0.0 else limit("load.push", 1.0, width=0.0, source="closed form")
        yield Case(
            name=f"joined_near_{off:g}", problem=near, truth=known, **parts,
            setting=f"Tent to {math.fabs(off):g} {'below' if off < 0.0 else 'above'} its largest stable load.",
        )  # fmt: skip
