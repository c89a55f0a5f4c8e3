"""A closed body of random shape, under several fabrics."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle

from taichi_membrane.mechanics.preparation import FabricConstants
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh import Mesh

ISOTROPIC = FabricConstants(e_warp=1.0, e_weft=1.0, poisson=0.3, shear=1 / 2.6, thickness=1.0, law="none")
ORTHOTROPIC = FabricConstants(e_warp=2.0, e_weft=0.3, poisson=0.4, shear=0.05, thickness=1.0)


def closed_body(
    fabric: FabricConstants = ORTHOTROPIC, *, scale: float = 1.0, offset: float = 0.0, **parts: Any
) -> Structure:
    """An irregular body under one pressure; its coordinates are multiples of 2⁻²⁰, so that offsets by 2²⁰ are exact."""
    rng = np.random.default_rng(21)
    base, triangles = oracle.icosahedron()
    points = np.round((base * [1.0, 1.3, 0.8] + rng.uniform(-0.1, 0.1, base.shape)) * 2**20) / 2**20
    given = {
        "mesh": Mesh.build(points * scale + offset, triangles),
        "fabrics": (fabric,),
        "tri_fabric": np.zeros(20, dtype=np.int32),
        "tri_warp": rng.normal(size=(20, 3)),
        "node_held": np.zeros((12, 3), dtype=bool),
        "tri_chamber": np.zeros(20, dtype=np.int32),
        "loads": False,
    }
    return Structure(**{**given, **parts})


def law(name: str, **changes: Any) -> FabricConstants:
    """The isotropic fabric under another law."""
    return FabricConstants(**{**vars(ISOTROPIC), "law": name, **changes})
