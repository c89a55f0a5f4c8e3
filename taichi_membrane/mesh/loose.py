"""What a mesh holds beside its triangles: line elements, and points that no triangle uses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.errors import InputError


@dataclass(frozen=True, eq=False)
class Loose:
    """Lines and loose points as :class:`taichi_membrane.mesh.Mesh` holds them; checked.

    :param node_count: number of nodes of the triangles, from which the numbers of loose points go on.
    """

    points: NDArray[np.float64]
    groups: Mapping[str, NDArray[np.int32]]
    lines: NDArray[np.int32]
    line_groups: Mapping[str, NDArray[np.int32]]
    node_count: int

    @property
    def parts(
        self,
    ) -> tuple[
        NDArray[np.float64], Mapping[str, NDArray[np.int32]], NDArray[np.int32], Mapping[str, NDArray[np.int32]]
    ]:
        """Points, their groups, lines, and their groups."""
        return self.points, self.groups, self.lines, self.line_groups

    def renumbered(self, new_number: NDArray[np.int32], node_count: int, where: str) -> Loose:
        """The same with other numbers of the triangles' nodes.

        :param new_number: the new number of each old node; -1 where it was left out.
        :raises InputError: a line uses a node that was left out.
        """
        shift = node_count - self.node_count
        everything = np.concatenate((new_number, np.arange(len(self.points), dtype=np.int32) + node_count))
        lines = everything[self.lines]
        bad = np.flatnonzero((lines < 0).any(axis=1))
        if bad.size:
            raise InputError(f"{where}: line {bad[0]} uses a node that no element uses; give it as one of loose_points")
        lines.setflags(write=False)
        groups = {name: members + np.int32(shift) for name, members in self.groups.items()}
        for members in groups.values():
            members.setflags(write=False)
        return Loose(self.points, groups, lines, self.line_groups, node_count)
