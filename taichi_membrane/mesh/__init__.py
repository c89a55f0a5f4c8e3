"""Triangle mesh with named groups: topology, validation, reading and writing files, conditions, rigid motions."""

from __future__ import annotations

from taichi_membrane.mesh.conditions import select
from taichi_membrane.mesh.files import read_mesh
from taichi_membrane.mesh.line_nodes import with_added_nodes, with_line_nodes
from taichi_membrane.mesh.placed import placed
from taichi_membrane.mesh.rigid import Clamp, rigid_motions_left
from taichi_membrane.mesh.surface import Mesh, with_groups

__all__ = [
    "Clamp",
    "Mesh",
    "placed",
    "read_mesh",
    "rigid_motions_left",
    "select",
    "with_added_nodes",
    "with_groups",
    "with_line_nodes",
]
