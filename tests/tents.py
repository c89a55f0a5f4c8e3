"""Structures whose whole path is known in closed form: tents, sheets that bulge, and both beside one another.

A tent's tip is guided and its rim held, so that at the share ζ of its rise it bears λ = (3√3/2) ζ (1 - ζ²) of its limit, at
ζ = 1/√3. Tents that stand beside one another under one load bear it each for itself: their compliances add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_membrane.execution.run import run
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import RunResult, StepResult

SIDES, RADIUS, THICKNESS = 6, 10.0, 0.1
INNER = RADIUS * float(np.cos(np.pi / SIDES))


def modulus(limit: float, rise: float) -> float:
    """E of a tent that bears no more than ``limit``."""
    slant = float(np.hypot(INNER, rise))
    volume = SIDES * THICKNESS * RADIUS * float(np.sin(np.pi / SIDES)) * slant
    return limit * 3.0 * float(np.sqrt(3.0)) * slant**4 / (volume * rise**3)


def borne(height: float) -> float:
    """Load over the limit at a share of the rise."""
    return 1.5 * float(np.sqrt(3.0)) * height * (1.0 - height**2)


def softened_to(share: float) -> float:
    """Load over the limit at which the tent has this share of its first stiffness, dλ/dζ ~ 3 ζ² - 1."""
    return borne(float(np.sqrt((1.0 + 2.0 * share) / 3.0)))


def height_at(load: float, *, beyond: bool = False) -> float:
    """Stable share of the rise at a load over the limit: before the snap, or ``beyond`` it."""
    roots = np.roots([-1.5 * np.sqrt(3.0), 0.0, 1.5 * np.sqrt(3.0), -load])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    return float(real[0] if beyond else real[-1])


class Parts:
    """A mesh put together from tents, sheets and held points; each part is an element group and a fabric of its own."""

    def __init__(self) -> None:
        self.points: list[Any] = []
        self.triangles: list[Any] = []
        self.groups: dict[str, list[int]] = {"held": []}
        self.elements: dict[str, list[int]] = {}
        self.scene: dict[str, Any] = {
            "name": "parts",
            "units": {"length": "mm", "force": "N"},
            "mesh": {"shape": "given"},
            "fabrics": {},
            "supports": [{"group": "held", "hold": "xyz"}],
            "loads": {},
            "probes": {},
        }

    def tent(self, name: str, limit: float, rise: float, at: Sequence[float] = (0.0, 0.0, 0.0)) -> Parts:
        """A tent with a load on its tip, both of this name, and a probe of how far it sinks."""
        angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
        rim = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0.0 * angle])
        fan = [[0, 1 + k, 1 + (k + 1) % SIDES] for k in range(SIDES)]
        first = self._part(name, np.vstack([[[0.0, 0.0, rise]], rim]) + at, fan, {"E": modulus(limit, rise)})
        self.groups[name] = [first]
        self.groups["held"] += range(first + 1, first + 1 + SIDES)
        self.scene["supports"].append({"group": name, "hold": "xy"})
        self.scene["loads"][name] = {"group": name, "direction": [0.0, 0.0, -1.0]}
        self.scene["probes"][name] = {"kind": "displacement", "group": name, "component": "z"}
        return self

    def sheet(self, name: str, prestress: float, at: Sequence[float] = (0.0, 0.0, 0.0)) -> Parts:
        """A square of four prestressed triangles, pushed together by a load of its name; a probe tells how its centre bulges."""
        square = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [5, 5, 0]]) + np.asarray(at)
        fabric = {"E": 1000.0, "prestress": [prestress, prestress, 0.0], "warp": [1.0, 0.0, 0.0]}
        first = self._part(name, square, [[4, k, (k + 1) % 4] for k in range(4)], fabric)
        self.groups["held"] += [first, first + 3]
        self.groups |= {name: [first + 1, first + 2], f"{name}_centre": [first + 4]}
        self.scene["supports"].append({"group": name, "hold": "yz"})
        self.scene["loads"][name] = {"group": name, "direction": [-1.0, 0.0, 0.0]}
        self.scene["probes"][name] = {"kind": "displacement", "group": f"{name}_centre", "component": "z"}
        return self

    def anchor(self, at: Sequence[float], *, held: bool = True) -> Parts:
        """A point to tie something to; ``frame`` is the triangle that it belongs to."""
        first = self._part(
            "frame", np.array([[0, 0, 0], [0, 9, 0], [0, 0, 9]]) + np.asarray(at), [[0, 1, 2]], {"E": 1.0}
        )
        self.groups |= {"anchor": [first], "frame": [first, first + 1, first + 2]}
        if held:
            self.groups["held"] += self.groups["frame"]
        return self

    def tie(self, EA: float, unstressed: float = 1.0, **more: Any) -> Parts:
        """A cable from ``tent`` to ``anchor``."""
        self.scene["cables"] = {"tie": {"nodes": ["tent", "anchor"], "EA": EA, "unstressed": unstressed, **more}}
        return self

    def run(self, *stages: dict[str, Any], **more: Any) -> RunResult:
        """Run it; each stage gets a name."""
        observer = more.pop("observer", None)
        scene = self.scene | {"stages": [{"name": f"stage{k}", **stage} for k, stage in enumerate(stages)]} | more
        mesh = Mesh.build(np.vstack(self.points), np.vstack(self.triangles), self.groups, self.elements)
        return run(Scene.model_validate(scene), mesh=mesh, observer=observer)

    def _part(self, name: str, points: Any, triangles: Any, fabric: dict[str, Any]) -> int:
        first, before = sum(map(len, self.points)), sum(map(len, self.triangles))
        self.points.append(points)
        self.triangles.append(np.array(triangles) + first)
        self.elements[name] = list(range(before, before + len(triangles)))
        self.scene["fabrics"][name] = {"nu": 0.0, "thickness": THICKNESS, "law": "none"} | fabric
        return first


def tent(limit: float = 1.0, rise: float = 1.0) -> Parts:
    """One tent."""
    return Parts().tent("tent", limit, rise)


def loads(**values: float) -> dict[str, Any]:
    """A stage to these loads."""
    return {"loads": values}


def events(step: StepResult) -> list[str]:
    return [one.event for one in step.trace]


def softened(prestress: Sequence[float], end: float, **stage: Any) -> RunResult:
    """Sheets beside a tent just below its limit of 1 N, so that the path is followed; both loads rise by the same to ``end``."""
    parts, mid = Parts().tent("tent", 1.0, 1.0, at=(0.0, 50.0, 0.0)), softened_to(0.05)
    for k, one in enumerate(prestress):
        parts.sheet(f"sheet{k}", one, at=(20.0 * k, 0.0, 0.0))

    def to(load: float) -> dict[str, Any]:
        return loads(tent=load, **{f"sheet{k}": load - 1e-3 for k in range(len(prestress))})

    return parts.run(to(1e-3), to(mid), to(end) | stage)


def bulge(prestress: float, load: float) -> float:
    """How far one sheet bulges at a load, alone, in small steps from where it is flat."""
    result = (
        Parts()
        .sheet("sheet", prestress)
        .run(loads(sheet=0.0), loads(sheet=0.99 * prestress), loads(sheet=load) | {"steps": 10})
    )
    assert result.outcome == "finished"
    return abs(result.steps[-1].probes["sheet"])


def pulled(stiffness: float, distance: float, steps: int = 1, **more: Any) -> RunResult:
    """A tent whose tip is pulled down by a bar to a frame that moves down."""
    parts = tent().anchor((0.0, 0.0, -100.0), held=False).tie(EA=stiffness * 101.0, kind="bar")
    parts.scene["motions"] = {"pull": {"kind": "translation", "group": "frame", "direction": [0.0, 0.0, -1.0]}}
    return parts.run({"motions": {"pull": distance}, "steps": steps}, **more)
