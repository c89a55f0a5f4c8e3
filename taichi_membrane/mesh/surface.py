"""Triangle mesh with named groups: topology, orientation, validation.

Corner order is counter-clockwise seen from the positive side; pressure is positive along that normal, so the normals of
an inflated closed body point outwards. Lengths are in any one unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import check, quadratic
from taichi_membrane.mesh.cracks import Tolerance, check_seams
from taichi_membrane.mesh.middles import as_middles, check_shape, edge_middles, pieces
from taichi_membrane.mesh.repair import HINT, mend
from taichi_membrane.mesh.topology import EdgeTable, edge_table, node_parts, sorted_unique


def _no_points() -> NDArray[np.float64]:
    return check.frozen(np.empty((0, 3)))


def _no_lines() -> NDArray[np.int32]:
    return check.frozen(np.empty((0, 2), dtype=np.int32))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulated surface in its unstressed shape. Make it with :meth:`build`; all arrays are read-only.

    :param points: (node_count, 3) unstressed positions [length].
    :param triangles: (tri_count, 3) node numbers, counter-clockwise seen from the positive side.
    :param node_groups: named sorted node numbers; "all" always, "boundary" when the surface has an edge.
    :param tri_groups: named sorted element numbers; "all" always.
    :param tri_warp: (tri_count, 3) unit vectors along the warp yarns, in the element's plane, or None when unknown.
    :param mended: what was repaired when the mesh was built, a line for each kind of fault.
    :param loose_points: (k, 3) points that no triangle uses: ends of cables, points named in a file. Node ``node_count + i`` is the
        i-th of them wherever node numbers may mean them: in ``lines`` and ``loose_groups``.
    :param loose_groups: named sorted numbers of loose points. A group of nodes that are in part loose is in both tables.
    :param lines: (line_count, 2) node numbers of line elements, such as cables.
    :param line_groups: named sorted numbers of lines.
    :param notes: what a file says that is not carried over, and what was decided when it was read, a line each.
    :param tri_fields: numbers of the elements, (tri_count,) or (tri_count, k), by name; scenes may take thickness, prestress, warp
        directions and pressure coefficients from them.
    :param tri_middle: (tri_count, 3) nodes amid the side opposite each corner of six-node triangles; None of three-node triangles.
    :param tolerance: how near nodes of free edges are one, by the digits of the coordinates [length].
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    node_groups: Mapping[str, NDArray[np.int32]]
    tri_groups: Mapping[str, NDArray[np.int32]]
    tri_warp: NDArray[np.float64] | None = None
    mended: tuple[str, ...] = ()
    loose_points: NDArray[np.float64] = field(default_factory=_no_points)
    loose_groups: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    lines: NDArray[np.int32] = field(default_factory=_no_lines)
    line_groups: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    tolerance: float = 0.0
    tri_fields: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    tri_middle: NDArray[np.int32] | None = None

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
        open_seams: bool = False,
        join: float | None = None,
        digit: float | None = None,
        lines: ArrayLike | None = None,
        line_groups: Mapping[str, ArrayLike] | None = None,
        loose_points: ArrayLike | None = None,
        loose_groups: Mapping[str, ArrayLike] | None = None,
        notes: Sequence[str] = (),
        tri_fields: Mapping[str, ArrayLike] | None = None,
        tri_middle: ArrayLike | None = None,
    ) -> Mesh:
        """Convert, check and freeze a mesh; add the groups "all" and "boundary" (unless one of that name is given).

        :param tri_warp: (tri_count, 3) directions of any length; each is projected on its element and made unit.
        :param where: the file or key the data came from; begins every message.
        :param repair: first mend what can be (:mod:`.repair`); ``mended`` says what was done. Elements keep their data.
        :param open_seams: free edges that lie on each other stay apart, as slits; without it they are refused, or joined by repair.
        :param join, digit: repair joins nodes of free edges up to the first [length]; without it by the coordinates' last digit.
        :param lines, line_groups, loose_points, loose_groups, notes, tri_fields, tri_middle: as the fields of those names.
        :raises InputError: wrong shapes, coordinates that are not finite, numbers out of range, degenerate or duplicate elements,
            unused or repeated nodes, opposite orientation, free edges that nearly coincide, folds, a body inside out, empty groups.
        """
        xyz = check.as_points(points, where)
        corners = check.as_triangles(triangles, len(xyz), where)
        node_members = check.as_groups(node_groups or {}, len(xyz), "node", where)
        loose = check.as_loose(loose_points, lines, line_groups, loose_groups, len(xyz), where)
        tolerance = _tolerance(xyz, corners, digit, join, where)
        mended: tuple[str, ...] = ()
        middles = as_middles(tri_middle, corners, len(xyz), where, repair=repair)
        if repair:
            done = mend(xyz, corners, node_members, None if open_seams else tolerance.same)
            loose = loose.renumbered(done.new_number, len(done.points), where)
            xyz, corners, mended = done.points, done.triangles, done.told
            node_members = check.as_groups(done.node_groups, len(xyz), "node", where)
        area_vector, table = _checked(xyz, corners, where, repair, None if open_seams else tolerance, middles)
        mesh = cls(
            check.frozen(xyz),
            check.frozen(corners),
            _given_groups(len(xyz), table, middles, where) | node_members,
            _all(len(corners)) | check.as_groups(tri_groups or {}, len(corners), "element", where),
            None if tri_warp is None else check.frozen(check.as_warp(tri_warp, area_vector, where)),
            mended,
            *loose.parts,
            tuple(notes),
            tolerance.same,
            check.as_fields(tri_fields or {}, len(corners), where),
            middles,
        )
        mesh.__dict__["_edges"] = table  # already computed here
        return mesh

    @classmethod
    def from_object(
        cls,
        thing: Any,
        *,
        repair: bool = False,
        scale: float = 1.0,
        open_seams: bool = False,
        join: float | None = None,
    ) -> Mesh:
        """Convert a mesh of meshio, trimesh or pyvista; options are those of :func:`taichi_membrane.read_mesh`.

        :raises InputError: another kind of object, cells that have no place in a mesh of triangles, or a fault of the mesh.
        """
        from taichi_membrane.mesh.files import from_object

        return from_object(thing, repair=repair, scale=scale, open_seams=open_seams, join=join)

    def save(self, path: str | Path) -> None:
        """Write the mesh so that it is read back the same: groups, lines, loose points; directions and element data in .vtu alone.

        The file extension says how: .vtu, .inp, .msh or .stl.

        :raises InputError: another extension, something the format cannot say, or a file that cannot be written.
        """
        from taichi_membrane.mesh.files import save

        save(self, Path(path))

    def __repr__(self) -> str:
        """One line, without the arrays."""
        groups = ", ".join(name for name in (*self.node_groups, *self.tri_groups) if name != "all")
        return f"Mesh({self.node_count} nodes, {self.tri_count} elements of order {self.order}; groups: {groups or 'none'})"

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def tri_count(self) -> int:
        """Number of triangle elements."""
        return len(self.triangles)

    @property
    def order(self) -> int:
        """1 with three-node triangles, 2 with six-node ones."""
        return 1 if self.tri_middle is None else 2

    @property
    def cells(self) -> NDArray[np.int32]:
        """(tri_count, 3 or 6) all nodes of each triangle: its corners, then those amid the sides opposite them."""
        return self.triangles if self.tri_middle is None else self._cells

    @cached_property
    def _cells(self) -> NDArray[np.int32]:
        assert self.tri_middle is not None
        return check.frozen(np.concatenate([self.triangles, self.tri_middle], axis=1))

    @cached_property
    def edge_middles(self) -> NDArray[np.int32]:
        """(edge_count,) the node amid each edge of :attr:`edge_table`, of six-node triangles."""
        assert self.tri_middle is not None
        return edge_middles(self.tri_middle, self._edges, "mesh")

    @cached_property
    def flat_triangles(self) -> NDArray[np.int32]:
        """(n, 3) flat triangles between neighbouring nodes, for drawing: the elements, or four of each six-node one in turn."""
        return self.triangles if self.tri_middle is None else quadratic.quarters(self.cells).astype(np.int32)

    @cached_property
    def _edges(self) -> EdgeTable:
        return edge_table(self.triangles, self.node_count)

    @property
    def edge_table(self) -> EdgeTable:
        """The unique edges and the half-edges along each."""
        return self._edges

    def edges(self) -> NDArray[np.int32]:
        """Return the unique edges (edge_count, 2), lower node number first, sorted; of six-node triangles both halves of each."""
        return self._edges.nodes if self.tri_middle is None else pieces(self._edges, self.edge_middles)

    def boundary_edges(self) -> NDArray[np.int32]:
        """Return the edges of only one triangle (n, 2), directed as that triangle runs along them."""
        single = self._edges.half_edges[self._edges.start[self._edges.tri_count == 1]]
        triangle, corner = np.divmod(single, 3)
        return np.column_stack((self.triangles[triangle, corner], self.triangles[triangle, (corner + 1) % 3]))

    def junction_edges(self) -> NDArray[np.int32]:
        """Return the edges of more than two triangles (n, 2), where walls meet; lower node number first."""
        return self._edges.nodes[self._edges.tri_count > 2]

    @property
    def is_closed(self) -> bool:
        """True when every edge has two triangles, so that the surface encloses a volume."""
        return bool((self._edges.tri_count == 2).all())

    def tri_areas(self) -> NDArray[np.float64]:
        """Return the element areas (tri_count,) [length²]."""
        if self.tri_middle is not None:
            return quadratic.areas(self.points, self.cells)
        return np.linalg.norm(check.area_vectors(self.points, self.triangles), axis=1)

    def tri_area_vectors(self) -> NDArray[np.float64]:
        """Return the directed areas (tri_count, 3): integrals of the normal over each element."""
        if self.tri_middle is not None:
            return quadratic.area_vectors(self.points, self.cells)
        return check.area_vectors(self.points, self.triangles)

    def tri_normals(self) -> NDArray[np.float64]:
        """Return the unit normals (tri_count, 3) on the positive side of the elements; of six-node triangles the mean ones."""
        vector = self.tri_area_vectors()
        return vector / np.linalg.norm(vector, axis=1, keepdims=True)

    def enclosed_volume(self) -> float:
        """Return the volume enclosed by the closed surface [length³], positive with outward normals.

        :raises InputError: the surface is open.
        """
        if not self.is_closed:
            raise InputError(f"an open surface encloses no volume: {len(self.boundary_edges())} edges are free")
        if self.tri_middle is not None:
            return float(quadratic.volumes(self.points - self.points.mean(axis=0), self.cells).sum())
        return float(check.part_volumes(self.points, self.triangles, np.zeros(self.node_count, dtype=np.int32))[0])

    def components(self) -> NDArray[np.int32]:
        """Return one label per node (node_count,), from 0: nodes joined by triangles share it."""
        return node_parts(self.edges(), self.node_count)[1]


def _tolerance(
    points: NDArray[np.float64], triangles: NDArray[np.int32], digit: float | None, join: float | None, where: str
) -> Tolerance:
    """How near nodes of free edges are one."""
    if join is not None and not 0.0 < join < np.inf:
        raise InputError(f"{where}: join = {join!r} must be a distance above 0")
    return Tolerance.of(points, triangles, digit=digit, join=join)


def _checked(
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    where: str,
    repaired: bool,
    seams: Tolerance | None,
    middles: NDArray[np.int32] | None,
) -> tuple[NDArray[np.float64], EdgeTable]:
    """Area vectors and edges of triangles that pass the checks of elements, edges, bodies and, with a tolerance, seams."""
    hint = "" if repaired else HINT
    area_vector = check.area_vectors(points, triangles)
    tri_area = np.linalg.norm(area_vector, axis=1)
    check.check_elements(points, triangles, tri_area, where, hint, middles)
    table = edge_table(triangles, len(points))
    if middles is not None:
        edge_middles(middles, table, where)
        cells = np.concatenate([triangles, middles], axis=1)
        check_shape(points, cells, where)
        area_vector = quadratic.area_vectors(points, cells)
    check.check_edges(triangles, table, where, hint)
    check.check_bodies(points, triangles, table, tri_area, where, hint)
    if seams is not None:
        check_seams(points, triangles, table, seams, where, repaired)
    return area_vector, table


def _all(count: int) -> dict[str, NDArray[np.int32]]:
    return {"all": check.frozen(np.arange(count, dtype=np.int32))}


def _given_groups(
    node_count: int, table: EdgeTable, middles: NDArray[np.int32] | None, where: str
) -> dict[str, NDArray[np.int32]]:
    """The groups of nodes that every mesh has."""
    nodes, free = _all(node_count), table.tri_count == 1
    boundary = table.nodes[free].ravel()
    if middles is not None:
        boundary = np.concatenate([boundary, edge_middles(middles, table, where)[free]])
    if boundary.size:
        nodes["boundary"] = check.frozen(sorted_unique(boundary))
    return nodes


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
