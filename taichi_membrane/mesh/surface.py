"""Triangle mesh with named groups: topology, orientation, validation, reading any meshio format.

Corner order is counter-clockwise seen from the positive side; pressure is positive along that normal, so the normals of
an inflated closed body point outwards. Lengths are in any one unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import check
from taichi_membrane.mesh.conditions import select
from taichi_membrane.mesh.read import read_parts
from taichi_membrane.mesh.repair import HINT, mend
from taichi_membrane.mesh.rigid import rigid_motions_left
from taichi_membrane.mesh.topology import EdgeTable, edge_table, node_parts

__all__ = ["Mesh", "read_mesh", "rigid_motions_left", "select", "with_groups"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulated surface in its unstressed shape. Make it with :meth:`build`; all arrays are read-only.

    :param points: (node_count, 3) unstressed positions [length].
    :param triangles: (tri_count, 3) node numbers, counter-clockwise seen from the positive side.
    :param node_groups: named sorted node numbers; "all" always, "boundary" when the surface has an edge.
    :param tri_groups: named sorted element numbers; "all" always.
    :param tri_warp: (tri_count, 3) unit vectors along the warp yarns, in the element's plane, or None when unknown.
    :param mended: what was repaired when the mesh was built, a line for each kind of fault.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    node_groups: Mapping[str, NDArray[np.int32]]
    tri_groups: Mapping[str, NDArray[np.int32]]
    tri_warp: NDArray[np.float64] | None = None
    mended: tuple[str, ...] = ()

    @classmethod
    def build(
        cls,
        points: ArrayLike,
        triangles: ArrayLike,
        node_groups: Mapping[str, ArrayLike] | None = None,
        tri_groups: Mapping[str, ArrayLike] | None = None,
        tri_warp: ArrayLike | None = None,
        *,
        where: str = "mesh",
        repair: bool = False,
    ) -> Mesh:
        """Convert, check and freeze a mesh; add the groups "all" and "boundary" (unless one of that name is given).

        :param tri_warp: (tri_count, 3) directions of any length; each is projected on its element and made unit.
        :param where: the file or key the data came from; begins every message.
        :param repair: first join nodes at one place on free edges, leave out unused nodes, orient neighbours alike and
            closed bodies outwards; ``mended`` says what was done. Warp directions keep their elements.
        :raises InputError: wrong shapes, coordinates that are not finite, node numbers out of range, degenerate or
            duplicate elements, unused nodes, edges of three elements, neighbours of opposite orientation, a closed
            body that is inside out, an empty group or one with numbers out of range.
        """
        xyz = check.as_points(points, where)
        corners = check.as_triangles(triangles, len(xyz), where)
        node_members = check.as_groups(node_groups or {}, len(xyz), "node", where)
        mended: tuple[str, ...] = ()
        if repair:
            done = mend(xyz, corners, node_members)
            xyz, corners, mended = done.points, done.triangles, done.told
            node_members = check.as_groups(done.node_groups, len(xyz), "node", where)
        hint = "" if repair else HINT
        area_vector = check.area_vectors(xyz, corners)
        tri_area = np.linalg.norm(area_vector, axis=1)
        check.check_elements(xyz, corners, tri_area, where, hint)
        table = edge_table(corners, len(xyz))
        check.check_edges(corners, table, where, hint)
        check.check_bodies(xyz, corners, table, tri_area, where, hint)
        nodes = {"all": check.frozen(np.arange(len(xyz), dtype=np.int32))}
        boundary = table.nodes[table.tri_count == 1]
        if boundary.size:
            nodes["boundary"] = check.frozen(check.sorted_unique(boundary.ravel()))
        elements = {"all": check.frozen(np.arange(len(corners), dtype=np.int32))}
        mesh = cls(
            check.frozen(xyz),
            check.frozen(corners),
            nodes | node_members,
            elements | check.as_groups(tri_groups or {}, len(corners), "element", where),
            None if tri_warp is None else check.frozen(check.as_warp(tri_warp, area_vector, where)),
            mended,
        )
        mesh.__dict__["_edges"] = table  # the cached property, already computed here
        return mesh

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def tri_count(self) -> int:
        """Number of triangle elements."""
        return len(self.triangles)

    @cached_property
    def _edges(self) -> EdgeTable:
        return edge_table(self.triangles, self.node_count)

    def edges(self) -> NDArray[np.int32]:
        """Return the unique edges (edge_count, 2), lower node number first, sorted."""
        return self._edges.nodes

    def boundary_edges(self) -> NDArray[np.int32]:
        """Return the edges of only one triangle (n, 2), directed as that triangle runs along them."""
        single = self._edges.half_edges[self._edges.start[self._edges.tri_count == 1]]
        triangle, corner = np.divmod(single, 3)
        return np.column_stack((self.triangles[triangle, corner], self.triangles[triangle, (corner + 1) % 3]))

    @property
    def is_closed(self) -> bool:
        """True when every edge has two triangles, so that the surface encloses a volume."""
        return bool((self._edges.tri_count == 2).all())

    def tri_areas(self) -> NDArray[np.float64]:
        """Return the element areas (tri_count,) [length²]."""
        return np.linalg.norm(check.area_vectors(self.points, self.triangles), axis=1)

    def tri_normals(self) -> NDArray[np.float64]:
        """Return the unit normals (tri_count, 3) on the positive side of the elements."""
        vector = check.area_vectors(self.points, self.triangles)
        return vector / np.linalg.norm(vector, axis=1, keepdims=True)

    def enclosed_volume(self) -> float:
        """Return the volume enclosed by the closed surface [length³], positive with outward normals.

        :raises InputError: the surface is open.
        """
        if not self.is_closed:
            raise InputError(f"an open surface encloses no volume: {len(self.boundary_edges())} edges are free")
        return float(check.part_volumes(self.points, self.triangles, np.zeros(self.node_count, dtype=np.int32))[0])

    def components(self) -> NDArray[np.int32]:
        """Return one label per node (node_count,), from 0: nodes joined by triangles share it."""
        return node_parts(self._edges.nodes, self.node_count)[1]


def read_mesh(path: str | Path, *, repair: bool = False, scale: float = 1.0) -> Mesh:
    """Read a triangle mesh from a file of any format meshio knows (gmsh, vtk, vtu, stl, obj, ply, Abaqus, …).

    Nodes that no triangle uses are dropped. Groups come from gmsh physical groups and from named cell and point sets;
    named lines and vertices become node groups, a group of triangles also gives a node group of its name.

    :param repair: mend what can be mended; see :meth:`Mesh.build`.
    :param scale: factor on all coordinates.
    :raises InputError: the file is missing, unreadable or of unknown format, holds cells other than triangles, lines
        and vertices, or fails a check of :meth:`Mesh.build`.
    """
    parts = read_parts(Path(path))
    points = scale * parts.points
    return Mesh.build(points, parts.triangles, parts.node_groups, parts.tri_groups, where=str(path), repair=repair)


def with_groups(
    mesh: Mesh,
    nodes: Mapping[str, ArrayLike] | None = None,
    triangles: Mapping[str, ArrayLike] | None = None,
    *,
    where: str = "groups",
) -> Mesh:
    """Return the mesh with more named groups of nodes and of elements.

    :raises InputError: a name is taken, a group is empty, or a number is out of range.
    """
    new_nodes = check.as_groups(nodes or {}, mesh.node_count, "node", where)
    new_elements = check.as_groups(triangles or {}, mesh.tri_count, "element", where)
    for kind, new, old in (("node", new_nodes, mesh.node_groups), ("element", new_elements, mesh.tri_groups)):
        for name in new:
            if name in old:
                raise InputError(f"{where}: {kind} group '{name}' exists already, with {len(old[name])} members")
    out = replace(mesh, node_groups={**mesh.node_groups, **new_nodes}, tri_groups={**mesh.tri_groups, **new_elements})
    out.__dict__["_edges"] = mesh._edges  # same triangles: no need to sort them again
    return out
