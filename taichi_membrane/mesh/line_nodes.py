"""Nodes that no triangle uses: loose points that lines use, and points that a scene adds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.check import frozen
from taichi_membrane.mesh.surface import Mesh


def with_line_nodes(mesh: Mesh, group: str) -> Mesh:
    """The mesh with the loose points of a group of lines as nodes, after its own; they keep the order they had.

    What else is loose is numbered after them, and groups of loose points become groups of nodes as far as their points do.
    """
    used = np.unique(mesh.lines[mesh.line_groups[group]])
    taken = used[used >= mesh.node_count]
    if not taken.size:
        return mesh
    loose = np.arange(mesh.node_count, mesh.node_count + len(mesh.loose_points))
    left = np.setdiff1d(loose, taken)
    total = mesh.node_count + len(taken)
    number = np.empty(mesh.node_count + len(loose), dtype=np.int32)
    number[np.concatenate((np.arange(mesh.node_count), taken, left))] = np.arange(len(number))
    nodes = {**mesh.node_groups, "all": np.arange(total, dtype=np.int32)}
    still_loose = {}
    for name, members in mesh.loose_groups.items():
        renumbered = np.sort(number[members])
        inside, outside = renumbered[renumbered < total], renumbered[renumbered >= total]
        if inside.size:
            nodes[name] = np.union1d(nodes.get(name, inside), inside).astype(np.int32)
        if outside.size:
            still_loose[name] = frozen(outside)
    out = replace(
        mesh,
        points=frozen(np.concatenate((mesh.points, mesh.loose_points[taken - mesh.node_count]))),
        node_groups={name: frozen(members) for name, members in nodes.items()},
        loose_points=frozen(mesh.loose_points[left - mesh.node_count]),
        loose_groups=still_loose,
        lines=frozen(number[mesh.lines]),
    )
    out.__dict__["_edges"] = mesh._edges  # same triangles: no need to sort them again
    return out


def with_added_nodes(mesh: Mesh, points: NDArray[np.float64], groups: Mapping[str, NDArray[Any]]) -> Mesh:
    """The mesh with more nodes after its own, which no triangle uses; loose points are numbered after them.

    :param points: (k, 3) places.
    :param groups: node groups to add, by the numbers the nodes get.
    """
    count, more = mesh.node_count, len(points)
    nodes = {**mesh.node_groups, **groups, "all": np.arange(count + more)}
    out = replace(
        mesh,
        points=frozen(np.concatenate((mesh.points, points))),
        node_groups={name: frozen(np.asarray(members, dtype=np.int32)) for name, members in nodes.items()},
        loose_groups={name: frozen((members + more).astype(np.int32)) for name, members in mesh.loose_groups.items()},
        lines=frozen(np.where(mesh.lines >= count, mesh.lines + more, mesh.lines).astype(np.int32)),
    )
    out.__dict__["_edges"] = mesh._edges  # same triangles: no need to sort them again
    return out
