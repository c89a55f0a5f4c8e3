"""Snap-through: a tent of one degree of freedom, in closed form, and shallow domes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_membrane import shapes
from taichi_membrane.assurance.stability.case import Problem
from taichi_membrane.assurance.stability.structures import GIVEN
from taichi_membrane.assurance.verdicts.building import traced
from taichi_membrane.assurance.verdicts.case import UNKNOWN, Case, limit, nothing
from taichi_membrane.mesh import Mesh

LINEAR = {"E": 1.0, "nu": 0.0, "thickness": 1.0, "law": "none"}


def tent(sides: int, rise: float, kind: str, **stage: Any) -> Problem:
    """A tent over a polygon of radius 1, its tip guided upright; the load is told as a share of the largest stable one.

    Green's strain of a side triangle is (h² - r²)/(2 s²),
    s its height; so the tip's force is k h (r² - h²)/(2 s⁴) with k the
    fabric's E times volume, largest at h = r/√3. A pressure acts on the tip by a third of the polygon's area,
    deformed or not.

    :param kind: ``force`` on the tip, ``follower`` or ``fixed`` pressure, ``area`` load.
    """
    inner = math.cos(math.pi / sides)
    slant = math.hypot(inner, rise)
    largest = sides * math.sin(math.pi / sides) * slant * rise**3 / (3.0 * math.sqrt(3.0) * slant**4)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rim = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(sides)))
    triangles = np.array([[0, 1 + k, 1 + (k + 1) % sides] for k in range(sides)])
    mesh = Mesh.build(np.vstack([[0.0, 0.0, rise], rim]), triangles, {"tip": [0], "rim": range(1, 1 + sides)})
    plan = 0.5 * sides * math.sin(2.0 * math.pi / sides)
    scene: dict[str, Any] = {
        "mesh": GIVEN,
        "fabric": LINEAR,
        "supports": [{"group": "rim", "hold": "xyz"}, {"group": "tip", "hold": "xy"}],
    }
    share = stage.pop("share")
    if kind in ("follower", "fixed"):
        scene["pressures"] = {"wind": {"kind": kind}}
        stage["pressure"] = -3.0 * largest / plan * share
    else:
        size = largest if kind == "force" else 3.0 * largest / float(mesh.tri_areas().sum())
        scene["loads"] = {"push": {"group": "tip", "direction": [0.0, 0.0, -size]}}
        if kind == "area":
            scene["loads"] = {"push": {"group": "all", "kind": "area", "direction": [0.0, 0.0, -size]}}
        stage["loads"] = {"push": share}
    scene["stages"] = [{"name": "push", **stage}]
    known = {"load.push": 1.0} if "loads" in scene else {"pressure.wind": stage["pressure"] / share}
    return Problem(scene=scene, mesh=mesh, measure=nothing, collapse=known)


def _tents() -> Iterator[Case]:
    for sides, rise, kind, share in (
        (6, 0.1, "force", 2.0), (6, 0.1, "force", 20.0), (6, 0.1, "force", 1000.0), (5, 0.3, "force", 1.5),
        (6, 0.1, "follower", 2.0), (8, 0.2, "follower", 10.0), (6, 0.1, "fixed", 2.0), (7, 0.05, "area", 3.0),
    ):  # fmt: skip

        def problem(
            steps: int, sides: int = sides, rise: float = rise, kind: str = kind, share: float = share
        ) -> Problem:
            return tent(sides, rise, kind, share=share, steps=steps, until="collapse")

        ((name, value),) = problem(1).collapse.items()
        yield Case(
            name=f"tent_{sides}_{rise:g}_{kind}_{share:g}", family="snaps", problem=problem, steps=(1, 3, 10, 64),
            size="small" if (kind, share) in (("force", 2.0), ("follower", 2.0)) else "default",
            truth=limit(name, value, width=0.0, source="closed form", remark="P ~ h (r² - h²)"),
            setting=f"Tent of {sides} sides, rise {rise:g}, {kind} to {share:g} times its largest stable load.",
        )  # fmt: skip

        def followed(
            steps: int, sides: int = sides, rise: float = rise, kind: str = kind, share: float = share
        ) -> Problem:
            return tent(sides, rise, kind, share=share, steps=400 * steps, control="arc_length")

        yield Case(
            name=f"tent_path_{sides}_{rise:g}_{kind}_{share:g}", family="snaps", problem=followed, truth=UNKNOWN, steps=(1,),
            size="default" if share <= 2.0 else "full",
            setting=f"The same by arc length: it ends at {share:g} times that load, hanging.",
        )  # fmt: skip


def dome(
    rise: float, law: str, load: dict[str, float], steps: int, *, kind: str = "follower", needle: bool = False
) -> Problem:
    """A shallow paraboloid over a held circle of radius 1; a negative rise hangs."""
    from taichi_membrane.assurance.verdicts.meshes import with_needle

    disc = shapes.disc(radius=1.0, rings=6)
    height = rise * (1.0 - disc.points[:, 0] ** 2 - disc.points[:, 1] ** 2)
    points = np.column_stack((disc.points[:, :2], height))
    mesh = Mesh.build(points, disc.triangles, {"rim": disc.node_groups["rim"]})
    scene: dict[str, Any] = {
        "mesh": GIVEN,
        "fabric": {"E": 1.0, "nu": 0.3, "thickness": 1.0, "law": law},
        "supports": [{"group": "rim", "hold": "xyz"}],
        "pressures": {"wind": {"kind": kind}},
        "loads": {"snow": {"group": "all", "kind": "area", "direction": [0.0, 0.0, -1.0]}},
        "stages": [{"name": "blow", "steps": steps, "until": "collapse"}],
    }
    if "hold" in load:  # blown up first, then loaded against the pressure
        scene["stages"].insert(0, {"name": "inflate", "pressure": load["hold"]})
    scene["stages"][-1] |= {"pressure": load["pressure"]} if "pressure" in load else {"loads": {"snow": load["snow"]}}
    return Problem(scene=scene, mesh=with_needle(mesh) if needle else mesh, measure=nothing)


def _domes() -> Iterator[Case]:
    for word, rise, law, load, kind, needle in (
        ("pressed", 0.3, "none", {"pressure": -0.05}, "follower", False),
        ("pressed_fixed", 0.3, "none", {"pressure": -0.05}, "fixed", False),
        ("snow", 0.3, "none", {"snow": 0.05}, "follower", False),
        ("inverted", -0.3, "none", {"pressure": 0.05}, "follower", False),
        ("inverted_shallow", -0.1, "none", {"pressure": 0.005}, "follower", False),
        ("inverted_slack", -0.3, "tension_field", {"pressure": 1e-3}, "follower", False),
        ("blown_snow", 0.3, "tension_field", {"hold": 1e-3, "snow": 3e-3}, "follower", False),
        ("blown_needle", 0.3, "tension_field", {"hold": 1e-3, "snow": 3e-3}, "follower", True),
        ("pressed_needle", 0.3, "none", {"pressure": -0.05}, "follower", True),
        ("blown_fails", 0.3, "tension_field", {"hold": 1e-3, "pressure": -1e-3}, "follower", False),
    ):  # fmt: skip

        def problem(
            steps: int,
            rise: float = rise,
            law: str = law,
            load: dict[str, float] = load,
            kind: str = kind,
            needle: bool = needle,
        ) -> Problem:
            return dome(rise, law, load, steps, kind=kind, needle=needle)

        way = ", ".join(f"{key} {value:g}" for key, value in load.items())
        yield traced(
            f"dome_{word}", family="needles" if needle else "snaps", problem=problem, steps=(1, 4, 16), size="default",
            setting=f"Paraboloid of rise {rise:g} on a held rim, {law.replace('_', ' ')}, {kind} pressure: {way}.",
        )  # fmt: skip


def cases() -> Iterator[Case]:
    """All of this family's."""
    yield from _tents()
    yield from _domes()
