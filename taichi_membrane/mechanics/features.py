"""What a structure uses: all that decides what is compiled and allocated for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from taichi_membrane.names import WrinklingLaw

PressureKind = Literal["none", "uniform", "by_chamber", "by_side"]
OffsetPlace = Literal["none", "by_fabric", "by_element"]


@dataclass(frozen=True)
class Variant:
    """One kind of element code: every variant in use is compiled once, none besides."""

    law: WrinklingLaw
    green: bool
    orthotropic: bool


@dataclass(frozen=True, kw_only=True)
class Features:
    """What a scene uses. Each flag decides both a field's allocation and a kernel's branch; nothing else does.

    ``pressure``: ``none``, ``uniform`` (one value on all triangles), ``by_chamber`` (a chamber number per triangle) or ``by_side``
    (one for each side of a triangle).
    ``several_fabrics``: a fabric number per triangle. ``prestress``, ``growth`` (stress-free strain): a strain offset, ``offset``
    says whether for each fabric or each triangle. ``loads``: a load vector per node.
    ``wind``: a pressure per triangle beside those of chambers. ``snow``: a load per plan area of each triangle.
    ``water``: how many liquids.
    ``slanted``: held directions other than x, y, z, with a frame per node. ``cables``: two-node elements. ``ropes``: cables that
    slide over nodes. ``springs``: nodes on springs to the ground. ``obstacles``: of each what is compiled.
    ``walls``: elements that touch each other. ``bodies``: rigid node groups. ``samples``: points of a triangle where strain is
    sampled, more than one with six nodes.
    """

    variants: tuple[Variant, ...]
    several_fabrics: bool
    prestress: bool
    growth: bool
    offset: OffsetPlace
    pressure: PressureKind
    wind: bool
    snow: bool
    water: int
    loads: bool
    slanted: bool
    cables: bool
    ropes: bool
    springs: bool
    obstacles: tuple[tuple[str, bool, bool], ...]
    walls: bool
    bodies: bool
    samples: int = 1

    def describe(self) -> tuple[list[str], list[str]]:
        """Names of what is compiled in and of what is left out."""
        laws = {variant.law for variant in self.variants}
        flags = {
            "wrinkling (tension field)": "tension_field" in laws,
            "wrinkling (clipped stress)": "clip" in laws,
            "orthotropic fabric": any(variant.orthotropic for variant in self.variants),
            "Green side strain": any(variant.green for variant in self.variants),
            "several fabrics": self.several_fabrics,
            "prestress": self.prestress,
            "stress-free strain": self.growth,
            "prestress or stress-free strain by element": self.offset == "by_element",
            "follower pressure": self.pressure != "none",
            "several pressures": self.pressure in ("by_chamber", "by_side"),
            "pressure on both sides": self.pressure == "by_side",
            "wind": self.wind,
            "snow (load per plan area)": self.snow,
            "liquids": self.water > 0,
            "dead loads": self.loads,
            "slanted supports": self.slanted,
            "cables": self.cables,
            "sliding cables": self.ropes,
            "springs to the ground": self.springs,
            "contact with obstacles": bool(self.obstacles),
            "contact of walls with each other": self.walls,
            "friction": any(friction for _, _, friction in self.obstacles),
            "rigid bodies": self.bodies,
            "six-node triangles": self.samples > 1,
        }
        return [name for name, used in flags.items() if used], [name for name, used in flags.items() if not used]
