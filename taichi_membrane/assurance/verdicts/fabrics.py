"""Other fabrics, shut chambers, line loads, slanted supports: the same beam in other clothes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from scipy.spatial.transform import Rotation

from taichi_membrane import shapes
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.verdicts.building import traced
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case, nothing
from taichi_membrane.assurance.verdicts.tubes import FABRIC, LENGTH, beam, collapse_load, tube_mesh
from taichi_membrane.mesh import Mesh

_P, _R = 0.05, 27.0
FABRICS: Mapping[str, Mapping[str, Any]] = {
    "orthotropic": {"E_warp": 4000.0, "E_weft": 2000.0, "nu": 0.15, "G": 150.0, "thickness": 0.1},
    "across": {"E_warp": 1500.0, "E_weft": 5000.0, "nu": 0.05, "G": 300.0, "thickness": 0.1, "warp_angle": 30.0},
    "engineering": {**FABRIC, "side_strain": "engineering"},
    "soft": {"E": 300.0, "nu": 0.3, "thickness": 0.1},
    "none": {**FABRIC, "law": "none"},
    "clip": {**FABRIC, "law": "clip"},
}


def _clothes() -> Iterator[Case]:
    for word, fabric in FABRICS.items():

        def problem(steps: int, fabric: Mapping[str, Any] = fabric) -> Problem:
            return beam(tube_mesh(_R), _P, _R, steps, fabric=fabric)

        parts: dict[str, Any] = {
            "family": "fabrics", "problem": problem, "size": "default",
            "setting": f"Cantilever of radius 27 under 0.05, fabric {word}.",
            "steps": (1, 4, 14) if word != "clip" else (1, 4),
        }  # fmt: skip
        yield (
            Case(name=f"fabric_{word}", truth=UNKNOWN, **parts) if word == "clip" else traced(f"fabric_{word}", **parts)
        )


def shut_beam(steps: int, ambient: float, exponent: float) -> Problem:
    """The cantilever whose valve is shut before it is loaded."""
    problem = beam(tube_mesh(_R), _P, _R, steps)
    scene: dict[str, Any] = dict(problem.scene)
    mesh = shapes.tube(radius=_R, length=LENGTH, around=12, along=30, cap_start="flat", cap_end="hemisphere")
    scene["pressures"] = {"inside": {"ambient": ambient, "exponent": exponent}}
    scene["stages"][-1] |= {"closed": ["inside"]}
    return Problem(scene=scene, mesh=mesh, measure=nothing)


def line_loaded(steps: int, needle: bool = False) -> Problem:
    """A cantilever under a line load along its top, a share of what folds it at its root."""
    mesh = shapes.tube(radius=_R, length=LENGTH, around=12, along=30, cap_end="hemisphere", pattern="diagonal")
    scene: dict[str, Any] = dict(beam(mesh, _P, _R, steps).scene)
    load = 2.0 * collapse_load(_P, _R) / LENGTH  # its resultant acts at half the length
    scene["groups"] = {"ridge": {"where": f"z > {_R - 1e-6}"}}
    scene["loads"] = {"tip": {"group": "ridge", "kind": "line", "direction": [0.0, 0.0, -load]}}
    return Problem(scene=scene, mesh=mesh, measure=nothing)


def guided(steps: int, angle: float) -> Problem:
    """A cantilever turned about the vertical, whose end ring slides in the vertical plane of its axis."""
    straight = tube_mesh(_R)
    turn = Rotation.from_euler("z", angle, degrees=True)
    groups = {name: members for name, members in straight.node_groups.items() if name not in ("all", "boundary")}
    mesh = Mesh.build(straight.points @ turn.as_matrix().T, straight.triangles, groups)
    scene: dict[str, Any] = dict(beam(mesh, _P, _R, steps).scene)
    scene["supports"] = [*scene["supports"], {"group": "end", "normal": turn.apply([0.0, 1.0, 0.0]).tolist()}]
    return Problem(scene=scene, mesh=mesh, measure=nothing)


def _others() -> Iterator[Case]:
    for ambient, exponent in ((0.1, 1.0), (0.1, 1.4), (1.0, 1.0)):

        def shut(steps: int, ambient: float = ambient, exponent: float = exponent) -> Problem:
            return shut_beam(steps, ambient, exponent)

        yield Case(
            name=f"shut_{ambient:g}_{exponent:g}", family="fabrics", problem=shut, truth=UNKNOWN,
            steps=(1, 4, 14), size="default",
            setting=f"Cantilever with its valve shut, {ambient:g} outside, exponent {exponent:g}.",
        )  # fmt: skip
    yield traced(
        "line_load", family="fabrics", problem=line_loaded, steps=(1, 4, 14), size="default",
        setting="Cantilever under a line load along its top, to 1.4 of what folds it at its root by theory.",
    )  # fmt: skip
    for angle in (45.0, 20.0):

        def slanted(steps: int, angle: float = angle) -> Problem:
            return guided(steps, angle)

        yield traced(
            f"guided_{angle:g}", family="fabrics", problem=slanted, steps=(1, 4, 14), size="default",
            setting=f"Cantilever turned by {angle:g} degrees, its end guided in the vertical plane of its axis.",
        )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _clothes()
    yield from _others()
