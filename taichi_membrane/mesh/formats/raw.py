"""What a mesh file says, before anything is judged: points, cells in the order of the file, named groups, notes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_membrane.mesh.topology import sorted_unique

CellKind = Literal["vertex", "line", "line3", "triangle", "triangle6", "quad"]
# Nodes of each. Of six-node triangles corners come first, then the nodes from corner 0 to 1, 1 to 2, 2 to 0.
CORNERS: dict[CellKind, int] = {"vertex": 1, "line": 2, "line3": 3, "triangle": 3, "triangle6": 6, "quad": 4}
# Other cells by what they are called in messages; they have no place in a mesh of triangles.
SECOND_ORDER = (
    "second-order elements are not read, but for six-node triangles from gmsh, VTK and meshio: save these, or three-node triangles "
    "with straight sides"
)
SOLID = "solid elements are no membrane: save the surface alone"


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of one kind that follow each other in the file; ``nodes`` (n, corners) are places in the points."""

    kind: CellKind
    nodes: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CellGroup:
    """A named set of cells; numbers count all cells in the order of the file. One name may stand for several sets."""

    name: str
    members: NDArray[np.int64]


@dataclass(eq=False)
class RawMesh:
    """A file's content.

    :param points: (n, 3) positions as they are meant: local coordinate systems and instances are worked out.
    :param cells: blocks of cells in the order of the file.
    :param point_groups: named places in the points.
    :param cell_groups: named sets of cells.
    :param welded: points of equal position are one node: formats that have no node numbers say so.
    :param tri_warp: (cells, 3) warp direction of each cell, where the file says it.
    :param cell_fields: arrays of numbers that the file gives to its cells, (cells,) or (cells, k), by name.
    :param resolution: last digit of the coordinates [length], where the points cannot tell because they were transformed.
    :param cell_name: words for a cell in messages, from its number; such as "element 12 (line 40)".
    :param node_name: words for a point in messages, from its place.
    :param notes: what was not carried over, and what was decided, a line each.
    """

    points: NDArray[np.float64]
    cells: list[Cells] = field(default_factory=list)
    point_groups: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    cell_groups: list[CellGroup] = field(default_factory=list)
    welded: bool = False
    tri_warp: NDArray[np.float64] | None = None
    cell_fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    resolution: float | None = None
    cell_name: Callable[[int], str] | None = None
    node_name: Callable[[int], str] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def cell_count(self) -> int:
        """Number of cells of all kinds."""
        return sum(len(block.nodes) for block in self.cells)

    def add_cells(self, kind: CellKind, nodes: ArrayLike) -> range:
        """Append a block of cells; return their numbers."""
        first = self.cell_count
        array = np.asarray(nodes, dtype=np.int64).reshape(-1, CORNERS[kind])
        self.cells.append(Cells(kind, array))
        return range(first, first + len(array))

    def add_rows(self, rows: Iterable[tuple[CellKind, Sequence[int]]]) -> None:
        """Append cells of mixed kinds one by one, keeping their order."""
        held: list[Sequence[int]] = []
        kind: CellKind | None = None
        for next_kind, nodes in rows:
            if next_kind != kind and kind is not None:
                self.add_cells(kind, held)
                held = []
            kind = next_kind
            held.append(nodes)
        if kind is not None:
            self.add_cells(kind, held)

    def group_cells(self, name: str, members: ArrayLike) -> None:
        """Name a set of cells; an empty one is noted, not kept."""
        array = sorted_unique(np.asarray(members, dtype=np.int64).ravel())
        if array.size:
            self.cell_groups.append(CellGroup(name, array))
        else:
            self.notes.append(f"group '{name}' is empty and was left out")

    def group_points(self, name: str, members: ArrayLike) -> None:
        """Name a set of points; one of the same name grows, an empty one is noted, not kept."""
        array = sorted_unique(np.asarray(members, dtype=np.int64).ravel())
        if not array.size:
            self.notes.append(f"node group '{name}' is empty and was left out")
        elif name in self.point_groups:
            self.point_groups[name] = np.union1d(self.point_groups[name], array)
        else:
            self.point_groups[name] = array

    def group_by_value(
        self, name: str, values: NDArray[Any], cells: NDArray[np.int64], *, skip: int | None = None
    ) -> None:
        """Name the cells of each value of a whole number that the file gives to its cells: ``name_3``.

        :param cells: the cells' numbers, one for each value.
        :param skip: the value that means none.
        """
        found = sorted_unique(values)
        if found.size > MOST_VALUES:
            self.notes.append(
                f"'{name}' has {found.size} different values, more than {MOST_VALUES}: taken as numbering, not as groups"
            )
            return
        for value in found.tolist():
            if value != skip:
                self.group_cells(f"{name}_{value}", cells[values == value])


MOST_VALUES = 1000  # different values of a cell array beyond which it numbers the cells and groups nothing
