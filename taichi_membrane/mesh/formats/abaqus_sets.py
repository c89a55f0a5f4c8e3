"""Sets of an Abaqus input file: numbers, ranges, sets of sets, sets of instances; resolved when all is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, shown

if TYPE_CHECKING:
    from taichi_membrane.mesh.formats.abaqus import Placed

Ints = NDArray[np.int64]
_Kind = Literal["node", "element"]
_DEEPEST = 100  # sets inside each other; real files have two or three


@dataclass(eq=False)
class SetDefinition:
    """A set as the file gives it, before its members are looked up.

    :param ranges: (instance, first, last, step) of GENERATE.
    :param names: (instance, word, where): names of other sets, ``instance.number``, or numbers in an instance.
    :param of_elements: (instance, name, where) of element sets whose nodes belong to this node set.
    """

    name: str
    source: Source
    line: int
    labels: list[int] = field(default_factory=list)
    lines: dict[int, tuple[Source, int]] = field(default_factory=dict)
    ranges: list[tuple[str, int, int, int]] = field(default_factory=list)
    names: list[tuple[str, str, Source, int]] = field(default_factory=list)
    of_elements: list[tuple[str, str, Source, int]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class NamedSet:
    """A set whose members are known, as places in the points or numbers of cells of the whole file."""

    kind: _Kind
    instance: str
    name: str
    members: Ints


@dataclass(eq=False)
class _Sets:
    """Looks sets up in one scope after another; every set once."""

    placed: list[Placed]
    numbering: list[tuple[Numbering, Numbering]]
    corners: list[Ints] = field(default_factory=list)
    done: dict[tuple[_Kind, int, str], Ints] = field(default_factory=dict)
    open: list[tuple[_Kind, int, str]] = field(default_factory=list)

    def at(self, instance: str, source: Source, line: int) -> int:
        for number, item in enumerate(self.placed):
            if item.scope.name and item.scope.name.upper() == instance.upper():
                return number
        known = ", ".join(item.scope.name for item in self.placed if item.scope.name) or "(none)"
        raise source.fault(f"there is no instance {shown(instance)}; allowed: {known}", line)

    def definitions(self, kind: _Kind, scope: int) -> dict[str, list[SetDefinition]]:
        found: dict[str, list[SetDefinition]] = {}
        item = self.placed[scope]
        for one in (item.part, item.scope):
            sets = {} if one is None else one.node_sets if kind == "node" else one.element_sets
            for key, definition in sets.items():
                found.setdefault(key, []).append(definition)
        return found

    def members(self, kind: _Kind, scope: int, key: str) -> Ints:
        """Members of the set named ``key`` (in capitals) in a scope."""
        place = (kind, scope, key)
        if place in self.done:
            return self.done[place]
        definitions = self.definitions(kind, scope)[key]
        if place in self.open:
            raise definitions[0].source.fault(
                f"the {kind} set {shown(definitions[0].name)} holds itself", definitions[0].line
            )
        if len(self.open) > _DEEPEST:
            raise definitions[0].source.fault(f"sets of sets are nested deeper than {_DEEPEST}", definitions[0].line)
        self.open.append(place)
        held = [np.empty(0, dtype=np.int64)]
        for definition in definitions:
            held += self._of(definition, kind, scope)
        self.open.pop()
        self.done[place] = np.unique(np.concatenate(held))
        return self.done[place]

    def _of(self, own: SetDefinition, kind: _Kind, scope: int) -> list[Ints]:
        held = []
        if own.labels:
            labels = np.array(own.labels, dtype=np.int64)
            found = self._find(kind, scope, labels)
            if (found < 0).any():
                missing = int(labels[np.argmax(found < 0)])
                source, line = own.lines.get(missing, (own.source, own.line))
                raise source.fault(
                    f"the {kind} set {shown(own.name)} names {kind} {missing}, which is not defined", line
                )
            held.append(found)
        for instance, first, last, step in own.ranges:
            where = self.at(instance, own.source, own.line) if instance else scope
            numbering = self.numbering[where][0 if kind == "node" else 1]
            held.append(numbering.between(first, last, step) + self._first(kind, where))
        for instance, word, source, line in own.names:
            held.append(self._named(own, kind, scope, instance, word, source, line))
        for instance, name, source, line in own.of_elements:
            cells = self._named(own, "element", scope, instance, name, source, line)
            held += [self.corners[cell] for cell in cells.tolist()]
        return held

    def _named(
        self, own: SetDefinition, kind: _Kind, scope: int, instance: str, word: str, source: Source, line: int
    ) -> Ints:
        where = self.at(instance, source, line) if instance else scope
        if word.upper() in self.definitions(kind, where):
            return self.members(kind, where, word.upper())
        inside, _, rest = word.rpartition(".")
        if inside and not instance:
            where, word = self.at(inside, source, line), rest
            if word.upper() in self.definitions(kind, where):
                return self.members(kind, where, word.upper())
        if word.lstrip("+-").isdigit():
            found = self._find(kind, where, np.array([source.whole(word, line, "a number of a set")]))
            if found[0] >= 0:
                return found
        elif not inside and where != 0 and not instance and word.upper() in self.definitions(kind, 0):
            return self.members(kind, 0, word.upper())
        known = ", ".join(item[0].name for item in self.definitions(kind, where).values()) or "(none)"
        told = f"the set {shown(own.name)} names {shown(word)}, which is no {kind} and no {kind} set; sets: {known}"
        raise source.fault(told, line)

    def _find(self, kind: _Kind, scope: int, labels: Ints) -> Ints:
        found = self.numbering[scope][0 if kind == "node" else 1].find(labels)
        return np.where(found < 0, -1, found + self._first(kind, scope))

    def _first(self, kind: _Kind, scope: int) -> int:
        item = self.placed[scope]
        return item.first_point if kind == "node" else item.first_cell


def resolved(placed: list[Placed], numbering: list[tuple[Numbering, Numbering]], corners: list[Ints]) -> list[NamedSet]:
    """Every set of every scope with its members.

    :param corners: points of each cell.
    :raises InputError: a set of sets that goes in a ring, members that are not defined.
    """
    sets = _Sets(placed, numbering, corners)
    found = []
    kinds: tuple[_Kind, ...] = ("node", "element")
    for scope, item in enumerate(placed):
        for kind in kinds:
            for key, definitions in sets.definitions(kind, scope).items():
                found.append(NamedSet(kind, item.scope.name, definitions[0].name, sets.members(kind, scope, key)))
    return found


def name_sets(raw: RawMesh, sets: list[NamedSet], instances: dict[str, range]) -> None:
    """Give the sets to the mesh as groups.

    Sets of instances are named ``instance.set``; where there is one instance alone its sets go by their own names too, unless the
    assembly has a set of that name. Where there are several, each is a group of elements of its own.
    """
    own = {(item.kind, item.name.upper()) for item in sets if not item.instance}
    for item in sets:
        names = [item.name] if not item.instance else []
        if item.instance:
            alone = len(instances) == 1 and (item.kind, item.name.upper()) not in own
            names = [item.name] if alone else [f"{item.instance}.{item.name}"]
        for name in names:
            if item.kind == "node":
                raw.group_points(name, item.members)
            else:
                raw.group_cells(name, item.members)
    if len(instances) > 1:
        taken = {name for kind, name in own if kind == "element"}
        for name, cells in instances.items():
            if name.upper() in taken:
                raw.notes.append(f"the instance '{name}' gives no group: an element set of the assembly has its name")
            elif len(cells):
                raw.group_cells(name, cells)
