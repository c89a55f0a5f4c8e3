"""DXF drawings: 3DFACE, polyface and polygon meshes, lines; layers as groups; corners at one place are one node."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from taichi_membrane.mesh.formats.raw import CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, listed, several, shown

# What $INSUNITS says one unit is.
_UNITS = {
    1: "inch",
    2: "foot",
    4: "millimetre",
    5: "centimetre",
    6: "metre",
    7: "kilometre",
    10: "yard",
    14: "decimetre",
}


# Entities with an area that are not read: left out, the drawing would lack a part.
_NO_FACES = (
    "MESH", "REGION", "3DSOLID", "BODY", "SURFACE", "PLANESURFACE", "LOFTEDSURFACE", "EXTRUDEDSURFACE", "REVOLVEDSURFACE",
    "SWEPTSURFACE", "NURBSURFACE", "ACAD_PROXY_ENTITY",
)  # fmt: skip


@dataclass(eq=False)
class _Entity:
    """An entity: its name, its values by group code (the last of each, all of those that matter), the line it begins on."""

    name: str
    line: int
    values: dict[int, str] = field(default_factory=dict)


def _pairs(source: Source) -> Iterator[tuple[int, str, int]]:
    """Group codes with their values."""
    lines = source.lines
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    if len(lines) % 2:
        raise source.fault("a group code without a value ends the file: it is cut off", len(lines))
    for at in range(0, len(lines), 2):
        yield source.whole(lines[at], at + 1, "a group code"), lines[at + 1].strip(), at + 2


def _entities(source: Source) -> Iterator[tuple[str, _Entity]]:
    """All entities with the section they stand in."""
    section, own, variable = "", None, ""
    ended = False
    for code, value, line in _pairs(source):
        if code == 9:
            variable = value.upper()
        elif code == 70 and variable == "$INSUNITS":
            yield "HEADER", _Entity(variable, line, {70: value})
        if code != 0:
            if own is not None:
                own.values.setdefault(code, value)
            if own is not None and own.name == "SECTION" and code == 2:
                section = value.upper()
            continue
        if own is not None:
            yield section, own
        own = _Entity(value.upper(), line)
        if own.name in ("ENDSEC", "EOF"):
            section, ended = "", own.name == "EOF"
    if not ended:
        raise source.fault("the drawing has no EOF: it is cut off")


@dataclass(eq=False)
class _Drawing:
    source: Source
    points: list[list[float]] = field(default_factory=list)
    rows: list[tuple[CellKind, list[int]]] = field(default_factory=list)
    row_lines: list[int] = field(default_factory=list)
    layers: dict[str, list[int]] = field(default_factory=dict)
    left_out: dict[str, tuple[int, int]] = field(default_factory=dict)
    blocks: dict[str, bool] = field(default_factory=dict)
    block: str = ""
    polyline: _Entity | None = None
    vertices: list[_Entity] = field(default_factory=list)
    paper: int = 0
    unit: str = ""
    hidden: int = 0
    hidden_layers: list[str] = field(default_factory=list)

    def take(self, section: str, own: _Entity) -> None:
        """Act on one entity."""
        if section == "BLOCKS":
            self._in_block(own)
        elif section == "HEADER" and own.name == "$INSUNITS":
            self.unit = _UNITS.get(self._flag(own), "")
        elif section == "ENTITIES" and own.name not in ("VERTEX", "SEQEND") and own.values.get(67) == "1":
            self.paper += 1  # drawn on a sheet of paper, not in the model
        elif section == "ENTITIES" and own.name not in ("VERTEX", "SEQEND") and own.values.get(60) == "1":
            self.hidden += 1
        elif section == "TABLES" and own.name == "LAYER" and 2 in own.values:
            if self._flag(own) & 1 or own.values.get(62, "").startswith("-"):
                self.hidden_layers.append(own.values[2])
        elif section == "ENTITIES":
            self._in_drawing(own)

    def _in_block(self, own: _Entity) -> None:
        if own.name == "BLOCK":
            self.block = own.values.get(2, "")
            self.blocks[self.block] = False
        elif own.name in ("3DFACE", "LINE", "POLYLINE", "INSERT", *_NO_FACES):
            self.blocks[self.block] = True

    def _in_drawing(self, own: _Entity) -> None:
        source = self.source
        match own.name:
            case "SECTION":
                return
            case "3DFACE":
                corners = [self._point(own, k) for k in range(4) if k < 3 or 13 in own.values]
                if len(corners) == 4 and corners[3] in (corners[2], corners[0]):
                    corners.pop()
                self._cell(corners, own)
            case "LINE":
                self._cell([self._point(own, 0), self._point(own, 1)], own)
            case "POLYLINE":
                self.polyline, self.vertices = own, []
            case "VERTEX":
                self.vertices.append(own)
            case "SEQEND":
                if self.polyline is not None:  # else it ends one that is not shown, or the attributes of a block
                    self._polyline(self.polyline, self.vertices)
                self.polyline = None
            case "INSERT":
                name = own.values.get(2, "")
                if self.blocks.get(name, True):
                    told = f"the block {shown(name)} is inserted: explode blocks before saving"
                    raise source.fault(told, own.line)
                self._leave_out(own)
            case name if name in _NO_FACES:
                raise source.fault(f"{own.name} is not read: convert it to 3DFACE or a polyface mesh", own.line)
            case _:
                self._leave_out(own)

    def _leave_out(self, own: _Entity) -> None:
        count, line = self.left_out.get(own.name, (0, own.line))
        self.left_out[own.name] = (count + 1, line)

    def _point(self, own: _Entity, number: int) -> list[float]:
        """The coordinates of group codes 10, 20, 30, or 11, 21, 31 and so on."""
        found = []
        for axis in (10, 20, 30):
            word = own.values.get(axis + number)
            if word is None and axis != 30:
                raise self.source.fault(f"{own.name} has no coordinate {axis + number}", own.line)
            found.append(self.source.real(word or "0", own.line, f"coordinate {axis + number} of {own.name}"))
        return found

    def _cell(self, corners: list[list[float]], own: _Entity) -> None:
        kinds: dict[int, CellKind] = {2: "line", 3: "triangle", 4: "quad"}
        first = len(self.points)
        self.points += corners
        self.layers.setdefault(own.values.get(8, "0"), []).append(len(self.rows))
        self.rows.append((kinds[len(corners)], list(range(first, first + len(corners)))))
        self.row_lines.append(own.line)

    def _flag(self, own: _Entity, code: int = 70) -> int:
        return self.source.whole(own.values.get(code, "0"), own.line, f"group {code} of {own.name}")

    def _polyline(self, own: _Entity, vertices: list[_Entity]) -> None:
        flags = self._flag(own)
        if flags & 64:
            self._polyface(own, vertices)
        elif flags & 16:
            self._polygon_mesh(own, vertices, flags)
        elif flags & 8:
            at = [self._point(vertex, 0) for vertex in vertices if not self._flag(vertex) & 16]
            at += at[:1] if flags & 1 else []
            for pair in itertools.pairwise(at):
                self._cell(list(pair), own)
        else:
            self._leave_out(own)  # a flat curve in a plane of its own

    def _polyface(self, own: _Entity, vertices: list[_Entity]) -> None:
        """Positions, then faces of their numbers from 1; a negative number hides an edge, nothing more."""
        at = [self._point(vertex, 0) for vertex in vertices if self._flag(vertex) & 64]
        for vertex in vertices:
            if self._flag(vertex) & 64:
                continue
            numbers = [
                abs(self._flag(vertex, code)) for code in (71, 72, 73, 74) if vertex.values.get(code, "0").strip("-+ 0")
            ]
            if not 2 <= len(numbers) <= 4 or max(numbers) > len(at):
                told = f"a face of vertices {listed(numbers)} in a polyface mesh of {len(at)} vertices"
                raise self.source.fault(told, vertex.line)
            own_layer = vertex.values.get(8, "0") != "0"  # a face may lie in a layer other than its mesh's
            self._cell([at[number - 1] for number in numbers], vertex if own_layer else own)

    def _polygon_mesh(self, own: _Entity, vertices: list[_Entity], flags: int) -> None:
        """A grid of M by N positions, closed in either direction where its flag says so."""
        rows, columns = self._flag(own, 71), self._flag(own, 72)
        at = [self._point(vertex, 0) for vertex in vertices]
        if self._flag(own, 75):
            raise self.source.fault("a polygon mesh is smoothed: explode it to 3DFACE", own.line)
        if rows < 2 or columns < 2 or len(at) != rows * columns:
            raise self.source.fault(f"a polygon mesh of {rows} by {columns} has {len(at)} vertices", own.line)
        for i in range(rows if flags & 1 else rows - 1):
            for j in range(columns if flags & 32 else columns - 1):
                next_i, next_j = (i + 1) % rows, (j + 1) % columns
                places = (i * columns + j, next_i * columns + j, next_i * columns + next_j, i * columns + next_j)
                self._cell([at[place] for place in places], own)

    def finish(self) -> RawMesh:
        """All that was read, as one mesh; a quadrilateral with two corners at one place is a triangle."""
        if self.polyline is not None:
            raise self.source.fault("a POLYLINE has no SEQEND: the drawing is cut off", self.polyline.line)
        rows: list[tuple[CellKind, list[int]]] = []
        for kind, nodes in self.rows:
            places = [tuple(self.points[node]) for node in nodes]
            kept = [node for k, node in enumerate(nodes) if places[k] != places[k - 1]]
            rows.append(("triangle", kept) if kind == "quad" and len(kept) == 3 else (kind, nodes))
        raw = RawMesh(np.array(self.points, dtype=np.float64).reshape(-1, 3), welded=True)
        raw.add_rows(rows)
        raw.cell_name = lambda cell: f"{rows[cell][0]} {cell} (line {self.row_lines[cell]})"
        for layer, cells in self.layers.items():
            raw.group_cells(layer, cells)
        if self.unit:
            raw.notes.append(f"the drawing's unit is the {self.unit} ($INSUNITS); its numbers are taken as they stand")
        shown_layers = [name for name in self.hidden_layers if name in self.layers]
        if shown_layers:
            raw.notes.append(f"layers that are off or frozen, read like others: {listed(shown_layers)}")
        if self.hidden:
            raw.notes.append(f"not carried over: {several(self.hidden, 'invisible entity', 'invisible entities')}")
        if self.paper:
            raw.notes.append(f"not carried over: {several(self.paper, 'entity', 'entities')} of paper space")
        if self.left_out:
            told = listed((f"{name} ({count}, first on line {at})" for name, (count, at) in self.left_out.items()), 12)
            raw.notes.append(f"not carried over: {told}")
        return raw


def read(source: Source) -> RawMesh:
    """Read a DXF drawing in text.

    :raises InputError: binary DXF, blocks that are inserted, solids and surfaces, damage.
    """
    if source.data.startswith(b"AutoCAD Binary DXF"):
        raise source.fault("binary DXF is not read: save it as text (ASCII)")
    drawing = _Drawing(source)
    for section, entity in _entities(source):
        drawing.take(section, entity)
    return drawing.finish()
