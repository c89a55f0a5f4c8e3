"""Abaqus input files: nodes, elements and sets of a flat file, or of parts, their instances and an assembly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats import abaqus_words as words
from taichi_membrane.mesh.formats.abaqus_sets import SetDefinition, name_sets, resolved
from taichi_membrane.mesh.formats.abaqus_words import Keyword
from taichi_membrane.mesh.formats.frames import about_axis, to_cartesian
from taichi_membrane.mesh.formats.raw import CORNERS, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, listed, several, shown
from taichi_membrane.mesh.precision import resolution

_IDENTITY = (np.eye(3), np.zeros(3))


@dataclass(eq=False)
class Scope:
    """Nodes, elements and sets that are numbered and named by themselves: a flat file, a part, an instance, the assembly."""

    name: str = ""
    node_line: dict[int, tuple[Source, int]] = field(default_factory=dict)
    place: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, tuple[CellKind, list[str], Source, int]] = field(default_factory=dict)
    node_sets: dict[str, SetDefinition] = field(default_factory=dict)
    element_sets: dict[str, SetDefinition] = field(default_factory=dict)


@dataclass(eq=False)
class Placed:
    """A part where an instance puts it: its own content, and what the instance adds."""

    scope: Scope
    part: Scope | None = None
    turn: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    shift: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    first_point: int = 0
    first_cell: int = 0


class _Reader:
    """Takes keyword after keyword; knows which part, instance or assembly it is in."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.flat, self.assembly = Scope(), Scope()
        self.parts: dict[str, Scope] = {}
        self.instances: dict[str, Placed] = {}
        self.here = self.flat
        self.frame = _IDENTITY
        self.left_out: dict[str, tuple[int, int]] = {}
        self.notes: list[str] = []

    def take(self, keyword: Keyword) -> None:
        """Act on one keyword."""
        match keyword.name:
            case "NODE":
                self._nodes(keyword)
            case "ELEMENT":
                self._elements(keyword)
            case "NSET":
                self._set(keyword, "NSET", self.here.node_sets)
            case "ELSET":
                self._set(keyword, "ELSET", self.here.element_sets)
            case "SYSTEM":
                self._system(keyword)
            case "PART":
                name = keyword.need("NAME")
                if name.upper() in self.parts:
                    raise keyword.source.fault(f"part {shown(name)} is defined twice", keyword.line)
                self.here = self.parts[name.upper()] = Scope(name)
            case "INSTANCE":
                self._instance(keyword)
            case "ASSEMBLY" | "ENDINSTANCE":
                self.here = self.assembly
            case "ENDPART" | "ENDASSEMBLY":
                self.here = self.flat
            case name if name in words.GENERATES:
                raise keyword.source.fault(f"*{name} is not read: {words.GENERATES[name]}", keyword.line)
            case name if name not in words.SILENT:
                count, line = self.left_out.get(name, (0, keyword.line))
                self.left_out[name] = (count + 1, line)
        if keyword.name in ("PART", "INSTANCE", "ENDPART", "ENDINSTANCE"):
            self.frame = _IDENTITY

    def _nodes(self, keyword: Keyword) -> None:
        system = keyword.parameters.get("SYSTEM", "R").upper()[:1] or "R"
        if system not in "RCS":
            raise keyword.source.fault(f"*NODE SYSTEM must be R, C or S, got {shown(system)}", keyword.line)
        turn, shift = self.frame
        found = []
        for data, source, line in keyword.data:
            label = source.whole(data[0], line, "a node number")
            xyz = [source.real(word, line, "a coordinate") if word else 0.0 for word in data[1:4]]
            xyz += [0.0] * (3 - len(xyz))
            at = turn @ to_cartesian(system, xyz) + shift if system != "R" or self.frame is not _IDENTITY else xyz
            place = (float(at[0]), float(at[1]), float(at[2]))
            if self.here.place.setdefault(label, place) != place:
                before = self.here.node_line[label][1]
                raise source.fault(f"node {label} is at another place than on line {before}", line)
            self.here.node_line.setdefault(label, (source, line))
            found.append(label)
        if keyword.parameters.get("NSET"):
            self._grow(self.here.node_sets, keyword.parameters["NSET"], keyword).labels.extend(found)

    def _elements(self, keyword: Keyword) -> None:
        kind = words.element_kind(keyword.need("TYPE").upper(), keyword.source, keyword.line)
        corners, name = CORNERS[kind], keyword.parameters["TYPE"].upper()
        if words.SHAPES_ONLY.fullmatch(name):
            self.notes.append(
                f"elements of type {name} (line {keyword.line}) are rigid or bare surfaces; read for their shape"
            )
        extra = 1 if kind == "line" and name.startswith("B") else 0  # a beam's node that only turns its section
        held: list[str] = []
        found = []
        begin: tuple[Source, int] = (keyword.source, keyword.line)
        for data, source, line in keyword.data:
            begin = begin if held else (source, line)
            goes_on = data[-1] == ""
            held += data[:-1] if goes_on else data
            if goes_on and len(held) < corners + 1:
                continue
            label = source.whole(held[0], line, "an element number")
            if not corners + 1 <= len(held) <= corners + 1 + extra:
                told = f"element {label} has {several(len(held) - 1, 'node number')}, {name} needs {corners}"
                raise source.fault(told, line)
            if label in self.here.elements:
                raise source.fault(f"element {label} stands on line {self.here.elements[label][3]} already", line)
            self.here.elements[label] = (kind, held[1 : 1 + corners], *begin)
            found.append(label)
            held = []
        if held:
            raise begin[0].fault(f"element {held[0]} ends in the middle, {name} needs {corners} nodes", begin[1])
        if keyword.parameters.get("ELSET"):
            self._grow(self.here.element_sets, keyword.parameters["ELSET"], keyword).labels.extend(found)

    def _set(self, keyword: Keyword, parameter: str, sets: dict[str, SetDefinition]) -> None:
        own = self._grow(sets, keyword.need(parameter), keyword)
        instance = keyword.parameters.get("INSTANCE", "")
        if parameter == "NSET" and keyword.parameters.get("ELSET"):
            own.of_elements.append((instance, keyword.parameters["ELSET"], keyword.source, keyword.line))
        generate = "GENERATE" in keyword.parameters
        for data, source, line in keyword.data:
            if generate:
                numbers = [source.whole(word, line, "a number of GENERATE") for word in data if word]
                if len(numbers) not in (2, 3) or (len(numbers) == 3 and numbers[2] < 1) or numbers[1] < numbers[0]:
                    told = "first, last and a step of at least 1"
                    raise source.fault(f"GENERATE needs {told}, got {shown(', '.join(data))}", line)
                first, last, *step = numbers
                own.ranges.append((instance, first, last, step[0] if step else 1))
                continue
            for word in data:
                if word.lstrip("+-").isdigit() and not instance:
                    own.labels.append(source.whole(word, line, "a number of a set"))
                    own.lines.setdefault(own.labels[-1], (source, line))
                elif word:
                    own.names.append((instance, word.strip('"'), source, line))

    def _grow(self, sets: dict[str, SetDefinition], name: str, keyword: Keyword) -> SetDefinition:
        """The set of a name, made when it is new: a set named again grows."""
        return sets.setdefault(name.upper(), SetDefinition(name, keyword.source, keyword.line))

    def _system(self, keyword: Keyword) -> None:
        """A local system of coordinates for the nodes that follow: origin and a point on x, then one on the side of y."""
        rows = [[source.real(w, line, "a coordinate") for w in data if w] for data, source, line in keyword.data]
        if not rows:
            self.frame = _IDENTITY
            return
        numbers = [value for row in rows for value in row]
        if len(numbers) not in (3, 6, 9):
            raise keyword.source.fault(f"*SYSTEM needs 3, 6 or 9 coordinates, got {len(numbers)}", keyword.line)
        origin, turn = np.array(numbers[:3]), np.eye(3)
        if len(numbers) > 3:
            x = np.array(numbers[3:6]) - origin
            side = np.array(numbers[6:9]) - origin if len(numbers) == 9 else np.cross([0.0, 0.0, 1.0], x)
            z = np.cross(x, side)
            if not np.linalg.norm(z) > 0.0:
                raise keyword.source.fault("*SYSTEM gives points on one line, no axes", keyword.line)
            x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
            turn = np.column_stack((x, np.cross(z, x), z))
        self.frame = (turn, origin)

    def _instance(self, keyword: Keyword) -> None:
        name = keyword.need("NAME")
        if "LIBRARY" in keyword.parameters or "INSTANCE" in keyword.parameters:
            raise keyword.source.fault(
                "*INSTANCE from another analysis is not read: write the mesh into the file", keyword.line
            )
        part = self.parts.get(keyword.need("PART").upper())
        if part is None:
            raise keyword.source.fault(
                f"*INSTANCE names part {shown(keyword.need('PART'))}, which is not defined", keyword.line
            )
        if name.upper() in self.instances:
            raise keyword.source.fault(f"instance {shown(name)} is defined twice", keyword.line)
        placed = self.instances[name.upper()] = Placed(Scope(name), part)
        self.here = placed.scope
        rows = [[source.real(w, line, "a number") if w else 0.0 for w in data] for data, source, line in keyword.data]
        rows = [row[:-1] if len(row) in (4, 8) and row[-1] == 0.0 else row for row in rows]
        if len(rows) > 2 or (rows and len(rows[0]) > 3) or (len(rows) == 2 and len(rows[1]) != 7):
            raise keyword.source.fault(
                "*INSTANCE takes a line of 3 shifts, then a line of 7 numbers of a rotation", keyword.line
            )
        if rows:
            placed.shift = np.array(rows[0] + [0.0] * (3 - len(rows[0])))
        if len(rows) == 2:
            first, second = np.array(rows[1][:3]), np.array(rows[1][3:6])
            if not np.linalg.norm(second - first) > 0.0:
                raise keyword.source.fault("*INSTANCE turns about an axis without length", keyword.line)
            placed.turn = about_axis(second - first, rows[1][6])
            # The shift comes first, then the rotation about an axis through the first point.
            placed.shift = placed.turn @ (placed.shift - first) + first

    def finish(self) -> RawMesh:
        """All that was read, as one mesh.

        :raises InputError: parts without instances, elements of nodes and sets of members that are not defined.
        """
        placed = list(self.instances.values())
        if self.parts and not placed:
            names = listed(shown(part.name) for part in self.parts.values())
            if len(self.parts) > 1:
                raise self.source.fault(
                    f"{len(self.parts)} parts ({names}) and no instances, so nothing tells where they are"
                )
            self.notes.append(f"the part {names} has no instance; it is read as it stands")
            placed = [Placed(Scope(), next(iter(self.parts.values())))]
        instanced = {id(item.part) for item in placed}
        for part in self.parts.values():
            if id(part) not in instanced:
                told = f"part {shown(part.name)} has no instance: {several(len(part.elements), 'element')} left out"
                self.notes.append(told)
        if self.left_out:
            told = listed((f"*{name} ({count}, first on line {at})" for name, (count, at) in self.left_out.items()), 12)
            self.notes.append(f"not carried over: {told}")
        return _joined(self, [Placed(self.flat), *placed, Placed(self.assembly)])


def read(source: Source) -> RawMesh:
    """Read an Abaqus input file.

    :raises InputError: what it says cannot be carried over, or is wrong.
    """
    reader = _Reader(source)
    for keyword in words.keywords(source):
        reader.take(keyword)
    return reader.finish()


def _joined(reader: _Reader, placed: list[Placed]) -> RawMesh:
    points: list[NDArray[np.float64]] = []
    names: list[tuple[str, int]] = []
    labels: list[tuple[str, int, int]] = []
    rows: list[tuple[CellKind, list[int]]] = []
    numbering: list[tuple[Numbering, Numbering]] = []
    at: list[dict[int, int]] = []
    digits = 0.0
    for item in placed:
        scopes = [scope for scope in (item.part, item.scope) if scope is not None]
        place = {label: at for scope in scopes for label, at in scope.place.items()}
        elements = {label: element for scope in scopes for label, element in scope.elements.items()}
        twice = sum(len(s.place) + len(s.elements) for s in scopes) - len(place) - len(elements)
        if twice:
            raise reader.source.fault(f"instance {shown(item.scope.name)} defines a number that its part has already")
        own = np.array(list(place.values()), dtype=np.float64).reshape(-1, 3)
        digits = max(digits, resolution(own))
        moved = own if (item.turn == np.eye(3)).all() and not item.shift.any() else own @ item.turn.T + item.shift
        item.first_point, item.first_cell = len(names), len(labels)
        points.append(moved)
        names += [(item.scope.name, label) for label in place]
        nodes = Numbering(np.array(list(place), dtype=np.int64))
        numbering.append((nodes, Numbering(np.array(list(elements), dtype=np.int64))))
        at.append({label: number for number, label in enumerate(place, item.first_point)})
        for kind, corners, source, line in elements.values():
            rows.append((kind, [_node(word, item, placed, at, source, line) for word in corners]))
        labels += [(item.scope.name, label, element[3]) for label, element in elements.items()]
    raw = RawMesh(np.concatenate(points), resolution=digits, notes=reader.notes)
    raw.add_rows(rows)
    raw.cell_name = lambda cell: _element_name(*labels[cell])
    raw.node_name = lambda node: f"node {names[node][1]}" + (f" of {names[node][0]}" if names[node][0] else "")
    ends = [item.first_cell for item in placed[1:]] + [len(labels)]
    instances = {i.scope.name: range(i.first_cell, end) for i, end in zip(placed, ends, strict=True) if i.scope.name}
    name_sets(raw, resolved(placed, numbering, [np.array(nodes, dtype=np.int64) for _, nodes in rows]), instances)
    return raw


def _node(word: str, item: Placed, placed: list[Placed], at: list[dict[int, int]], source: Source, line: int) -> int:
    """The place of a node in the points; ``instance.number`` is a node of an instance read before."""
    inside, _, number = word.rpartition(".")
    label = source.whole(number, line, "a node number")
    for owner, places in zip(placed, at, strict=False):
        if label in places and (owner is item if not inside else owner.scope.name.upper() == inside.upper()):
            return places[label]
    raise source.fault(f"an element uses node {word}, which is not defined", line)


def _element_name(instance: str, label: int, line: int) -> str:
    return f"element {label}" + (f" of {instance}" if instance else "") + f" (line {line})"
