"""What meshes made of another by cutting its triangles have in common: groups, lines and what is carried over to new nodes.

Nodes keep their numbers, new ones follow; nodes that no triangle uses, and loose points, come after these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from taichi_membrane.mesh.check import frozen
from taichi_membrane.mesh.line_nodes import with_added_nodes
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.topology import EdgeTable

Numbers = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Finer:
    """A mesh made of another by cutting its triangles.

    :param prolongation: (nodes, nodes of the coarse mesh) values at its nodes from those of the coarse mesh, by shape functions.
    """

    mesh: Mesh
    prolongation: sparse.csr_matrix


@dataclass(frozen=True, eq=False)
class NewNodes:
    """Nodes amid pairs of others, numbered after those of the coarse mesh's triangles.

    :param ends: (k, 2) pairs of nodes of the coarse mesh, lower number first, sorted.
    :param free: (k,) whether the new node lies on a free edge.
    :param inner: (k,) of six-node triangles the one whose inside it lies in; -1 on edges.
    :param count: number of the coarse mesh's nodes that its triangles use.
    """

    ends: Numbers
    free: NDArray[np.bool_]
    inner: Numbers
    count: int

    def groups(self, mesh: Mesh, groups: Mapping[str, Numbers]) -> dict[str, Numbers]:
        """Members of node groups on the fine mesh: those they had, and the new nodes between two of them.

        Of a group on free edges alone, as a rim, nodes within the surface are no part, say across a corner. Within a six-node
        triangle a new one is a member where the whole triangle is.
        """
        on_free, rim = np.zeros(self.count, dtype=bool), mesh.edge_table.tri_count == 1
        on_free[mesh.edge_table.nodes[rim]] = True
        if mesh.order == 2:
            on_free[mesh.edge_middles[rim]] = True
        found = {}
        for name, members in groups.items():
            members = members[members < self.count]
            if not members.size:
                continue
            inside = np.zeros(self.count, dtype=bool)
            inside[members] = True
            part = inside[self.ends].all(axis=1)
            if on_free[members].all():
                part &= self.free
            whole = np.asarray(inside[mesh.cells].all(axis=1))
            part &= (self.inner < 0) | whole[self.inner]
            found[name] = np.concatenate([members, self.count + np.flatnonzero(part)])
        return found

    def cut(self, lines: Numbers, number: Numbers) -> tuple[Numbers, Numbers]:
        """Lines by their new numbers, those between ends of a new node in two halves, and the old line of each.

        :param number: new number of each node and loose point of the coarse mesh.
        """
        size = len(number)
        keys = self.ends.astype(np.int64) @ np.array([size, 1])  # ascending
        own = np.sort(lines.astype(np.int64), axis=1) @ np.array([size, 1])
        at = np.minimum(np.searchsorted(keys, own), len(keys) - 1)
        cut = keys[at] == own
        first = np.column_stack([number[lines[cut, 0]], self.count + at[cut]])
        second = np.column_stack([self.count + at[cut], number[lines[cut, 1]]])
        pairs = np.concatenate([number[lines[~cut]], first, second])
        owner = np.concatenate([np.flatnonzero(~cut), np.flatnonzero(cut), np.flatnonzero(cut)])
        order = np.argsort(owner, kind="stable")
        return pairs[order], owner[order]


def edge_of_side(table: EdgeTable, tri_count: int) -> Numbers:
    """(tri_count, 3) number of the edge opposite each corner."""
    found = np.empty(3 * tri_count, dtype=np.int64)
    found[table.half_edges] = np.repeat(np.arange(len(table.nodes)), table.tri_count)
    return np.roll(found.reshape(-1, 3), 2, axis=1)  # half-edge c is opposite corner c + 2


def given_groups(mesh: Mesh) -> dict[str, Numbers]:
    """The groups of nodes that a mesh was given, without those that every mesh has."""
    return {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}


def tri_groups(mesh: Mesh, parent: Numbers) -> dict[str, Numbers]:
    """The groups of elements, by the coarse element that each fine one is a part of."""
    found: dict[str, Numbers] = {}
    for name, members in mesh.tri_groups.items():
        if name != "all":
            inside = np.zeros(mesh.tri_count, dtype=bool)
            inside[members] = True
            found[name] = np.flatnonzero(inside[parent])
    return found


def with_others(made: Mesh, mesh: Mesh, prolongation: sparse.csr_matrix, nodes: NewNodes) -> Finer:
    """The fine mesh with nodes that no triangle uses, loose points and lines of the coarse one; lines along edges are cut in two.

    :param made: what its triangles are made of, and ``prolongation`` from the nodes that the coarse triangles use.
    """
    count, groups = nodes.count, given_groups(mesh)
    extra = mesh.node_count - count
    total = made.node_count
    number = np.concatenate([np.arange(count), total + np.arange(extra + len(mesh.loose_points))])
    if extra:
        joined = {
            name: np.concatenate(
                [made.node_groups.get(name, np.zeros(0, dtype=np.int32)), number[members[members >= count]]]
            )
            for name, members in groups.items()
            if (members >= count).any()
        }
        made = with_added_nodes(made, mesh.points[count:], joined)
    if len(mesh.lines) or len(mesh.loose_points):
        lines, owner = nodes.cut(mesh.lines, number)
        made = replace(
            made,
            lines=frozen(lines.astype(np.int32)),
            line_groups={
                name: frozen(np.flatnonzero(np.isin(owner, members)).astype(np.int32))
                for name, members in mesh.line_groups.items()
            },
            loose_points=mesh.loose_points,
            loose_groups={
                name: frozen(number[members].astype(np.int32)) for name, members in mesh.loose_groups.items()
            },
        )
    whole = sparse.block_diag([prolongation, sparse.identity(extra, format="csr")], format="csr")
    return Finer(made, sparse.csr_matrix(whole))
