"""A membrane structure as the engine sees it, the features it uses, and what is derived from it before anything is uploaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.elimination import Elimination, kept_elimination
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import FabricConstants, Floats, Ints, TriangleGeometry
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import WrinklingLaw


@dataclass(frozen=True)
class Variant:
    """One kind of element code: every variant in use is compiled once, none besides."""

    law: WrinklingLaw
    green: bool
    orthotropic: bool


@dataclass(frozen=True, kw_only=True)
class Features:
    """What a scene uses. Each flag decides both a field's allocation and a kernel's branch; nothing else does.

    ``pressure``: ``none``, ``uniform`` (one value on all triangles) or ``by_chamber`` (a chamber number per triangle).
    ``several_fabrics``: a fabric number per triangle. ``prestress``: a strain offset per fabric. ``loads``: a load vector per node.
    ``slanted``: held directions other than x, y, z, with a frame per node.
    """

    variants: tuple[Variant, ...]
    several_fabrics: bool
    prestress: bool
    pressure: Literal["none", "uniform", "by_chamber"]
    loads: bool
    slanted: bool

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
            "follower pressure": self.pressure != "none",
            "several pressures": self.pressure == "by_chamber",
            "dead loads": self.loads,
            "slanted supports": self.slanted,
        }
        return [name for name, used in flags.items() if used], [name for name, used in flags.items() if not used]


@dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """A mesh with its fabrics, supports and the surfaces that pressure acts on; all the engine needs to know.

    :param tri_fabric: (tri_count,) number of each triangle's fabric in ``fabrics``.
    :param tri_warp: (tri_count, 3) warp direction, projected on the element.
    :param node_held: (node_count, 3) True where a displacement component is held or prescribed.
    :param node_frame: (node_count, 3, 3) rows are the axes that ``node_held`` refers to at each node; x, y, z when None.
    :param tri_chamber: (tri_count,) number of the pressure acting on each triangle, -1 for none.
    :param loads: whether dead nodal loads will be given.
    """

    mesh: Mesh
    fabrics: tuple[FabricConstants, ...]
    tri_fabric: Ints
    tri_warp: Floats
    node_held: NDArray[np.bool_]
    tri_chamber: Ints
    loads: bool = True
    node_frame: Floats | None = None

    @property
    def chamber_count(self) -> int:
        """Number of pressures."""
        return int(self.tri_chamber.max()) + 1

    @cached_property
    def geometry(self) -> TriangleGeometry:
        """Geometry of all triangles in their fabric axes."""
        return preparation.triangle_geometry(self.mesh, self.tri_warp)

    @cached_property
    def node_corners(self) -> tuple[Ints, Ints]:
        """The triangle corners at each node; see :func:`preparation.gather_lists`."""
        return preparation.gather_lists(self.mesh.triangles, self.mesh.node_count)

    @cached_property
    def edge_parts(self) -> Ints:
        """The triangle sides along each edge; see :func:`preparation.edge_parts`."""
        return preparation.edge_parts(self.mesh.triangles, self.mesh.edges())

    @cached_property
    def elimination(self) -> Elimination:
        """Symbolic factorisation of the tangent."""
        return kept_elimination(self.mesh.points, self.mesh.edges())

    def prepare(self, *, matrix: bool) -> None:
        """Compute now what the engine will ask for; ``matrix`` with what only a direct solver needs."""
        _ = self.geometry, self.node_corners
        if matrix:
            _ = self.edge_parts, self.elimination.additions, self.elimination.groups, self.elimination.entries

    def features(self) -> Features:
        """What this structure uses."""
        used = [self.fabrics[k] for k in np.unique(self.tri_fabric)]
        variants = tuple(dict.fromkeys(variant_of(fabric) for fabric in used))
        if np.all(self.tri_chamber < 0):
            pressure: Literal["none", "uniform", "by_chamber"] = "none"
        else:
            pressure = "uniform" if np.all(self.tri_chamber == 0) else "by_chamber"
        return Features(
            variants=variants,
            several_fabrics=len(self.fabrics) > 1,
            prestress=any(any(fabric.prestress) for fabric in used),
            pressure=pressure,
            loads=self.loads,
            slanted=self.node_frame is not None,
        )


def variant_of(fabric: FabricConstants) -> Variant:
    """The element code a fabric needs. A linear or clipped law needs no direction search, whatever its moduli."""
    return Variant(
        law=fabric.law,
        green=fabric.side_strain == "green",
        orthotropic=fabric.law == "tension_field" and not fabric.isotropic,
    )
