"""NASTRAN bulk data: grid points in any coordinate system, shells, lines, groups by property."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.nastran_cards import Card, cards, control_sets
from taichi_membrane.mesh.formats.raw import SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, listed, several, shown
from taichi_membrane.mesh.precision import resolution

Floats = NDArray[np.float64]
# Elements that are read: kind, field of the property (0: none), first field of the nodes, number of nodes.
_ELEMENTS: dict[str, tuple[CellKind, int, int, int]] = {
    "CTRIA3": ("triangle", 2, 3, 3),
    "CTRIAR": ("triangle", 2, 3, 3),
    "CQUAD4": ("quad", 2, 3, 4),
    "CQUADR": ("quad", 2, 3, 4),
    "CROD": ("line", 2, 3, 2),
    "CTUBE": ("line", 2, 3, 2),
    "CBAR": ("line", 2, 3, 2),
    "CBEAM": ("line", 2, 3, 2),
    "CONROD": ("line", 0, 2, 2),
}
_SECOND_ORDER = ("CTRIA6", "CQUAD8", "CQUAD", "CTRIAX6", "CTRIAX", "CQUADX", "CBEAM3")
_SOLIDS = ("CHEXA", "CTETRA", "CPENTA", "CPYRAM", "CHEXA8", "CHEXA20", "CTETRA4")
# Cards with a C that are no elements, and masses, which have no shape.
_NO_ELEMENTS = (
    "CONM1",
    "CONM2",
    "CREEP",
    "CSET",
    "CSET1",
    "CYJOIN",
    "CYSYM",
    "CYSUP",
    "CYAX",
    "CONV",
    "CHBDYE",
    "CHBDYG",
)
_PROPERTIES = ("PSHELL", "PCOMP", "PCOMPG", "PROD", "PTUBE", "PBAR", "PBARL", "PBEAM", "PBEAML")
_SILENT = ("PARAM", "MDLPRM", "EIGRL", "EIGR", "EIGC")
# Fields of material angle and offset, and those of the thickness at the corners.
_OFFSETS = {"CTRIA3": (6, 7), "CTRIAR": (6, 7), "CQUAD4": (7, 8), "CQUADR": (7, 8)}
_THICKNESS = {"CTRIA3": (11, 12, 13), "CTRIAR": (11, 12, 13), "CQUAD4": (11, 12, 13, 14), "CQUADR": (11, 12, 13, 14)}


@dataclass(frozen=True, eq=False)
class _Grid:
    system: int
    numbers: tuple[float, float, float]
    card: Card


@dataclass(eq=False)
class _Systems:
    """Coordinate systems by number; origin and axes (rows) are worked out when they are asked for."""

    grids: dict[int, _Grid]
    by_points: dict[int, Card] = field(default_factory=dict)
    by_nodes: dict[int, tuple[Card, tuple[int, int, int]]] = field(default_factory=dict)
    known: dict[int, tuple[str, Floats, Floats]] = field(default_factory=dict)
    open: list[int] = field(default_factory=list)

    def position(self, grid: int, card: Card) -> Floats:
        """Where a grid point is."""
        if grid not in self.grids:
            raise card.source.fault(f"{card.name} uses grid point {grid}, which is not defined", card.line)
        own = self.grids[grid]
        return self.cartesian(own.system, own.numbers, own.card)

    def cartesian(self, system: int, numbers: tuple[float, float, float], card: Card) -> Floats:
        """The position of a point given in a system."""
        if system == 0:
            return np.array(numbers)
        shape, origin, axes = self._axes(system, card)
        a, b, c = numbers
        if shape == "C":
            a, b = a * np.cos(np.radians(b)), a * np.sin(np.radians(b))
        elif shape == "S":  # radius, angle from z, angle about z
            out, c = a * np.sin(np.radians(b)), np.radians(c)
            a, b, c = out * np.cos(c), out * np.sin(c), a * np.cos(np.radians(b))
        return origin + np.array([a, b, c]) @ axes

    def _axes(self, system: int, card: Card) -> tuple[str, Floats, Floats]:
        if system in self.known:
            return self.known[system]
        if system in self.open:
            raise card.source.fault(f"the coordinate system {system} is defined by itself", card.line)
        self.open.append(system)
        if system in self.by_points:
            own = self.by_points[system]
            below = own.whole(2, "the system it is given in", 0)
            three = [
                self.cartesian(below, (own.real(k, _A, 0.0), own.real(k + 1, _A, 0.0), own.real(k + 2, _A, 0.0)), own)
                for k in (3, 6, 9)
            ]
        elif system in self.by_nodes:
            own, nodes = self.by_nodes[system]
            three = [self.position(node, own) for node in nodes]
        else:
            raise card.source.fault(f"{card.name}: there is no coordinate system {system} in the file", card.line)
        self.open.pop()
        origin, on_z, in_xz = three
        z = on_z - origin
        y = np.cross(z, in_xz - origin)
        if not (
            np.linalg.norm(z) > 0.0 and np.linalg.norm(y) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(in_xz - origin)
        ):
            raise own.source.fault(f"{own.name} {system}: its three points lie on one line", own.line)
        z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
        self.known[system] = (own.name[-1], origin, np.stack((np.cross(y, z), y, z)))
        return self.known[system]


_A = "a coordinate"


@dataclass(eq=False)
class _Deck:
    """What the cards say, card by card."""

    source: Source
    grids: dict[int, _Grid] = field(default_factory=dict)
    default_system: int | None = None
    elements: dict[int, tuple[Card, CellKind, list[int]]] = field(default_factory=dict)
    property_of: dict[int, str] = field(default_factory=dict)
    materials: dict[int, int] = field(default_factory=dict)
    left_out: dict[str, tuple[int, int]] = field(default_factory=dict)
    turned: int = 0
    shifted: int = 0
    thick: int = 0
    thick_corners: int = 0
    held: int = 0
    properties: set[int] = field(default_factory=set)
    unnamed: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.systems = _Systems(self.grids)

    def take(self, card: Card) -> None:
        """Act on one card.

        :raises InputError: an element that is not read, a card that is wrong.
        """
        name = card.name
        if name == "GRID":
            self._grid(card)
        elif name == "GRDSET":
            self.default_system = card.whole(2, "the coordinate system", 0)
        elif name in ("CORD2R", "CORD2C", "CORD2S"):
            self._new_system(card.whole(1, "the system's number"), card)
            self.systems.by_points[card.whole(1, "the system's number")] = card
        elif name in ("CORD1R", "CORD1C", "CORD1S"):
            for first in (1, 5)[: 2 if card.word(5) else 1]:
                number = card.whole(first, "the system's number")
                self._new_system(number, card)
                nodes = tuple(card.whole(first + k, "a grid point") for k in (1, 2, 3))
                self.systems.by_nodes[number] = (card, (nodes[0], nodes[1], nodes[2]))
        elif name in _ELEMENTS:
            self._element(card)
        elif name in _PROPERTIES:
            self.properties.add(card.whole(1, "the property"))
            if name != "PSHELL":
                self._leave_out(card)
                return
            self.thick += bool(card.word(3))
            if card.word(2):
                self.materials[card.whole(1, "the property")] = card.whole(2, "the material")
        elif name in _SECOND_ORDER:
            raise card.source.fault(f"{name}: {SECOND_ORDER}", card.line)
        elif name in _SOLIDS:
            raise card.source.fault(f"{name}: {SOLID}", card.line)
        elif name.startswith(("CORD", "GRID")) or (name.startswith("C") and name not in _NO_ELEMENTS):
            told = (
                f"the card {shown(name)} is not one that is read: GRID, CORD1R/C/S, CORD2R/C/S, {', '.join(_ELEMENTS)}"
            )
            raise card.source.fault(told, card.line)
        elif name not in _SILENT:
            self._leave_out(card)

    def _leave_out(self, card: Card) -> None:
        count, line = self.left_out.get(card.name, (0, card.line))
        self.left_out[card.name] = (count + 1, line)

    def _new_system(self, number: int, card: Card) -> None:
        if number < 1 or number in self.systems.by_points or number in self.systems.by_nodes:
            raise card.source.fault(
                f"{card.name}: the coordinate system {number} is defined already, or below 1", card.line
            )

    def _grid(self, card: Card) -> None:
        number = card.whole(1, "the grid point's number")
        default = self.default_system or 0
        own = _Grid(
            card.whole(2, "the coordinate system", default),
            (card.real(3, _A, 0.0), card.real(4, _A, 0.0), card.real(5, _A, 0.0)),
            card,
        )
        self.held += card.word(7) not in ("", "0")
        before = self.grids.setdefault(number, own)
        if (before.system, before.numbers) != (own.system, own.numbers):
            raise card.source.fault(
                f"grid point {number} is at another place than on line {before.card.line}", card.line
            )

    def _element(self, card: Card) -> None:
        kind, at_property, first, count = _ELEMENTS[card.name]
        number = card.whole(1, "the element's number")
        if number in self.elements:
            raise card.source.fault(
                f"element {number} stands on line {self.elements[number][0].line} already", card.line
            )
        if card.name in ("CBAR", "CBEAM") and not card.word(first + 1).lstrip("+-").isdigit():
            raise card.source.fault(f"{card.name} {number}: two grid points are needed", card.line)
        nodes = [card.whole(first + k, f"grid point {k + 1}") for k in range(count)]
        self.elements[number] = (card, kind, nodes)
        if at_property:
            # The property of an element that names none is the one of the element's own number; there may be none.
            pid = card.whole(at_property, "the property", number)
            self.property_of[number] = f"pid_{pid}"
            if not card.word(at_property):
                self.unnamed[number] = pid
        if card.name in _OFFSETS:
            angle, offset = (card.word(at).strip("0.") for at in _OFFSETS[card.name])
            self.turned += angle != ""
            self.shifted += offset != ""
            self.thick_corners += any(card.word(at) for at in _THICKNESS[card.name])

    def finish(self) -> RawMesh:
        """All that was read, as one mesh."""
        if not self.grids:
            raise self.source.fault("the file holds no GRID")
        points = np.array([self.systems.cartesian(g.system, g.numbers, g.card) for g in self.grids.values()])
        labels = np.array(list(self.grids), dtype=np.int64)
        numbering = Numbering(labels)
        rows = []
        for number, (card, kind, nodes) in self.elements.items():
            at = numbering.find(np.array(nodes, dtype=np.int64))
            if (at < 0).any():
                missing = nodes[int(np.argmax(at < 0))]
                raise card.source.fault(
                    f"{card.name} {number} uses grid point {missing}, which is not defined", card.line
                )
            rows.append((kind, at.tolist()))
        raw = RawMesh(points, resolution=self._digits())
        raw.add_rows(rows)
        elements = list(self.elements)
        raw.cell_name = lambda cell: f"element {elements[cell]} (line {self.elements[elements[cell]][0].line})"
        raw.node_name = lambda node: f"grid point {labels[node]}"
        self._groups(raw, elements)
        self._notes(raw)
        return raw

    def _digits(self) -> float:
        """Last digit of the coordinates [length]; angles of curved systems count at their radius."""
        numbers = np.array([grid.numbers for grid in self.grids.values()])
        shapes = np.array([self.systems.known.get(grid.system, ("R",))[0] for grid in self.grids.values()])
        digits = []
        for shape, lengths, angles in (("R", [0, 1, 2], []), ("C", [0, 2], [1]), ("S", [0], [1, 2])):
            own = numbers[shapes == shape]
            if len(own):
                radius = float(np.abs(own[:, 0]).max())
                digits += [resolution(own[:, lengths]), np.radians(resolution(own[:, angles])) * radius]
        return float(max(digits))

    def _groups(self, raw: RawMesh, elements: list[int]) -> None:
        for number in [number for number, pid in self.unnamed.items() if pid not in self.properties]:
            del self.property_of[number]
        cells: dict[str, list[int]] = {}
        for cell, number in enumerate(elements):
            name = self.property_of.get(number)
            if name is not None:
                cells.setdefault(name, []).append(cell)
        for name, members in cells.items():
            raw.group_cells(name, members)
        by_material: dict[int, list[int]] = {}
        for pid, material in self.materials.items():
            by_material.setdefault(material, []).extend(cells.get(f"pid_{pid}", ()))
        for material, members in by_material.items():
            if members:
                raw.group_cells(f"mid_{material}", members)

    def _notes(self, raw: RawMesh) -> None:
        if self.thick:
            raw.notes.append(
                f"not carried over: PSHELL's thickness, of {several(self.thick, 'property', 'properties')}"
            )
        if self.turned:
            raw.notes.append(f"not carried over: the material angle of {self.turned} elements")
        if self.shifted:
            raw.notes.append(f"not carried over: the offset of {self.shifted} elements from their grid points")
        if self.thick_corners:
            raw.notes.append(f"not carried over: the thickness at the corners of {self.thick_corners} elements")
        if self.held:
            raw.notes.append(f"not carried over: the constraints (PS) of {several(self.held, 'grid point')}")
        sets, line = control_sets(self.source)
        if sets:
            raw.notes.append(f"not carried over: SET of the case control ({sets}, first on line {line})")
        if self.left_out:
            told = listed((f"{name} ({count}, first on line {at})" for name, (count, at) in self.left_out.items()), 12)
            raw.notes.append(f"not carried over: {told}")


def read(source: Source) -> RawMesh:
    """Read NASTRAN bulk data.

    :raises InputError: what it says cannot be carried over, or is wrong.
    """
    deck = _Deck(source)
    for card in cards(source):
        deck.take(card)
    return deck.finish()
