"""Triangle mesh with named groups: topology, validation, reading, conditions, rigid motions."""

from __future__ import annotations

from taichi_membrane.mesh.surface import Mesh, read_mesh, rigid_motions_left, select, with_groups

__all__ = ["Mesh", "read_mesh", "rigid_motions_left", "select", "with_groups"]
