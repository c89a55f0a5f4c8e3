"""LS-DYNA keyword files: nodes, shells, beams and belts, parts and sets."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from taichi_membrane.mesh.formats.dyna_words import Block, Card, blocks
from taichi_membrane.mesh.formats.raw import SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, listed, several, shown

_SHELL_OPTIONS = ("THICKNESS", "BETA", "MCID", "OFFSET", "DOF")
_LINES = ("BEAM", "SEATBELT")
_LINE_OPTIONS = ("THICKNESS", "SECTION", "PID", "OFFSET", "ORIENTATION", "SCALAR", "SCALR")
_MOVES = (
    "NODE_TRANSFORM",
    "NODE_SCALAR",
    "NODE_MERGE_SET",
    "INCLUDE_TRANSFORM",
    "NODE_RIGID_SURFACE",
)
_SILENT = ("KEYWORD", "TITLE", "COMMENT", "END")


@dataclass(eq=False)
class _Set:
    """A set: its name, the numbers it holds or the ranges, and where it stands."""

    kind: str
    name: str
    line: int
    source: Source
    members: list[int] = field(default_factory=list)
    ranges: list[tuple[int, int]] = field(default_factory=list)
    parts: list[int] = field(default_factory=list)
    sets: list[int] = field(default_factory=list)


@dataclass(eq=False)
class _Model:
    source: Source
    place: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[tuple[str, int], tuple[CellKind, list[int], int, Source, int]] = field(default_factory=dict)
    titles: dict[int, str] = field(default_factory=dict)
    sets: dict[tuple[str, int], _Set] = field(default_factory=dict)
    left_out: dict[str, tuple[int, int]] = field(default_factory=dict)
    thickness: int = 0
    held: int = 0

    def take(self, block: Block) -> None:
        """Act on one keyword with its cards."""
        name = block.name
        if name in _MOVES:
            raise block.source.fault(f"*{name} is not read: write the nodes where they are", block.line)
        if name.startswith("INCLUDE_"):
            raise block.source.fault(
                f"*{name} is not read: only *INCLUDE is; write what it brings into one file", block.line
            )
        if name == "NODE":
            self._nodes(block)
        elif name.startswith("ELEMENT_SHELL"):
            self._shells(block)
        elif name.startswith("ELEMENT_") and name.split("_")[1] in _LINES and not name.startswith("ELEMENT_SEATBELT_"):
            self._lines(block)
        elif name.startswith("ELEMENT_SOLID") or name.startswith("ELEMENT_TSHELL"):
            raise block.source.fault(f"*{name}: {SOLID}", block.line)
        elif name.startswith("ELEMENT_") and not name.startswith(
            ("ELEMENT_MASS", "ELEMENT_INERTIA", "ELEMENT_SEATBELT_")
        ):
            told = "is not one that is read: ELEMENT_SHELL, ELEMENT_BEAM, ELEMENT_SEATBELT"
            raise block.source.fault(f"*{name} {told}", block.line)
        elif name == "PART" or name in ("PART_INERTIA", "PART_CONTACT"):
            self._parts(block)
        elif name.startswith(("SET_NODE", "SET_SHELL", "SET_PART", "SET_BEAM")):
            self._set(block)
        elif name not in _SILENT:
            count, line = self.left_out.get(name, (0, block.line))
            self.left_out[name] = (count + 1, line)

    def _nodes(self, block: Block) -> None:
        for card in block.cards:
            words = card.fields((8, 16, 16, 16, 8, 8))
            label = card.whole(words, 0, "a node number")
            x, y, z = (card.real(words, k) for k in (1, 2, 3))
            self.held += any(word.strip("0. ") for word in words[4:6])
            if self.place.setdefault(label, (x, y, z)) != (x, y, z):
                raise card.source.fault(f"node {label} is defined before, at another place", card.line)

    def _shells(self, block: Block) -> None:
        options = block.name.split("_")[2:]
        unknown = [option for option in options if option not in _SHELL_OPTIONS]
        if unknown:
            raise block.source.fault(f"*{block.name}: the option {unknown[0]} is not read", block.line)
        after = 1 if {"THICKNESS", "BETA", "MCID"} & set(options) else 0
        after += ("OFFSET" in options) + ("DOF" in options)
        cards = _firsts(block, 1 + after, "shell")
        self.thickness += len(cards) if after else 0
        for card in cards:
            words = card.fields((8,) * 10)
            numbers = [card.whole(words, k, "a number of a shell", 0) for k in range(10)]
            if any(numbers[6:]):
                raise card.source.fault(f"shell {numbers[0]} has more than four nodes: {SECOND_ORDER}", card.line)
            corners = numbers[2:6]
            kind: CellKind = "quad"
            if corners[3] in (0, corners[2]):
                kind, corners = "triangle", corners[:3]
            self._element("shell", numbers[0], kind, corners, numbers[1], card.source, card.line)

    def _lines(self, block: Block) -> None:
        _kind, *options = block.name.split("_")[1:]
        unknown = [option for option in options if option not in _LINE_OPTIONS]
        if unknown:
            raise block.source.fault(f"*{block.name}: the option {unknown[0]} is not read", block.line)
        for card in _firsts(block, 1 + len(options), "element"):
            words = card.fields((8,) * 5)
            numbers = [card.whole(words, k, "a number of a line element") for k in range(4)]
            self._element("beam", numbers[0], "line", numbers[2:4], numbers[1], card.source, card.line)

    def _element(
        self, family: str, number: int, kind: CellKind, corners: list[int], part: int, source: Source, line: int
    ) -> None:
        if (family, number) in self.elements:
            raise source.fault(f"{family} {number} stands on line {self.elements[family, number][4]} already", line)
        self.elements[family, number] = (kind, corners, part, source, line)

    def _parts(self, block: Block) -> None:
        """A title, then the numbers of part, section and material; some kinds of part add cards."""
        at, cards = 0, block.cards
        while at + 1 < len(cards):
            card = cards[at + 1]
            number = card.whole(card.fields((10,) * 8), 0, "a part's number")
            if number in self.titles:
                raise card.source.fault(f"part {number} is defined before", card.line)
            self.titles[number] = cards[at].text.strip()
            at += {"PART": 2, "PART_CONTACT": 3, "PART_INERTIA": 5}[block.name]
            if block.name == "PART_INERTIA" and at - 3 < len(cards):  # a local system of coordinates is a card more
                head = cards[at - 3]
                at += head.whole(head.fields((10,) * 8), 4, "IRCS", 0) == 1

    def _set(self, block: Block) -> None:
        words = block.name.split("_")
        kind, options = words[1], set(words[2:]) - {"LIST", "COLLECT"}
        cards = list(block.cards)
        title = cards.pop(0).text.strip() if "TITLE" in options and cards else ""
        if not cards:
            raise block.source.fault(f"*{block.name} has no cards", block.line)
        head = cards.pop(0)
        number = head.whole(head.fields((10,) * 8), 0, "a set's number")
        options -= {"TITLE"}
        if options - {"GENERATE", "GENERAL", "ADD"}:
            raise block.source.fault(
                f"*{block.name} is not read: only lists, LIST_GENERATE, GENERAL and ADD are", block.line
            )
        own = self.sets.setdefault((kind, number), _Set(kind, title, block.line, block.source))
        for card in cards:
            fields = card.fields((10,) * 8)
            if "GENERAL" in options:
                option = fields[0].upper() if fields else ""
                numbers = [card.whole(fields, k, "a number", 0) for k in range(1, len(fields))]
                held = own.parts if option == "PART" else own.members
                if option not in ("NODE", "ELEM", "PART"):
                    raise card.source.fault(f"*{block.name}: the option {shown(option)} is not read", card.line)
                held += [value for value in numbers if value]
                continue
            numbers = [card.whole(fields, k, "a number", 0) for k in range(len(fields))]
            if "GENERATE" in options:
                pairs = zip(numbers[::2], numbers[1::2], strict=False)
                own.ranges += [(first, last) for first, last in pairs if first or last]
            elif "ADD" in options:
                own.sets += [value for value in numbers if value]
            else:
                own.members += [value for value in numbers if value]

    def finish(self) -> RawMesh:
        """All that was read, as one mesh."""
        raw = RawMesh(np.array(list(self.place.values()), dtype=np.float64).reshape(-1, 3))
        nodes = Numbering(np.array(list(self.place), dtype=np.int64))
        rows = []
        for (family, number), (kind, corners, _, source, line) in self.elements.items():
            at = nodes.find(np.array(corners, dtype=np.int64))
            if (at < 0).any():
                missing = corners[int(np.argmax(at < 0))]
                raise source.fault(f"{family} {number} uses node {missing}, which is not defined", line)
            rows.append((kind, at.tolist()))
        raw.add_rows(rows)
        labels = list(self.elements)
        raw.cell_name = lambda cell: f"{' '.join(map(str, labels[cell]))} (line {self.elements[labels[cell]][4]})"
        part_of = np.array([item[2] for item in self.elements.values()], dtype=np.int64)
        # A title that several things have names none of them; they go by their numbers.
        titles = Counter([*self.titles.values(), *(own.name for own in self.sets.values())])
        for part in np.unique(part_of).tolist():
            raw.group_cells(f"part_{part}", np.flatnonzero(part_of == part))
            title = self.titles.get(part, "")
            if title and titles[title] == 1:
                raw.group_cells(title, np.flatnonzero(part_of == part))
        for (of_what, number), own in self.sets.items():
            if not own.name or titles[own.name] > 1:
                own.name = f"set_{of_what.lower()}_{number}"
        several_named = [title for title, count in titles.items() if title and count > 1]
        if several_named:
            told = listed(map(shown, several_named))
            raw.notes.append(f"titles of several parts or sets, which go by their numbers alone: {told}")
        self._name_sets(raw, nodes, part_of)
        if self.held:
            raw.notes.append(f"not carried over: the constraints of {several(self.held, 'node')}")
        if self.thickness:
            raw.notes.append(f"not carried over: thickness, angle or offset of {self.thickness} shells")
        if self.left_out:
            told = listed((f"*{name} ({count}, first on line {at})" for name, (count, at) in self.left_out.items()), 12)
            raw.notes.append(f"not carried over: {told}")
        return raw

    def _name_sets(self, raw: RawMesh, nodes: Numbering, part_of: np.ndarray) -> None:
        families = {"SHELL": "shell", "BEAM": "beam"}
        cells = {
            kind: Numbering(
                np.array([n if f == family else -1 - k for k, (f, n) in enumerate(self.elements)], dtype=np.int64)
            )
            for kind, family in families.items()
        }
        for (kind, number), own in self.sets.items():
            members = self._members(own, nodes, cells, part_of, [number])
            raw.group_points(own.name, members) if kind == "NODE" else raw.group_cells(own.name, members)

    def _members(
        self, own: _Set, nodes: Numbering, cells: dict[str, Numbering], part_of: np.ndarray, open_sets: list[int]
    ) -> np.ndarray:
        numbers = np.array(own.members, dtype=np.int64)
        if own.kind == "PART":
            parts = [*own.members, *own.parts, *(n for a, b in own.ranges for n in _between(part_of, a, b))]
            held = [np.flatnonzero(np.isin(part_of, parts))]
            return np.concatenate(held + self._added(own, nodes, cells, part_of, open_sets))
        numbering = nodes if own.kind == "NODE" else cells[own.kind]
        at = numbering.find(numbers)
        if (at < 0).any():
            missing, what = int(numbers[at < 0][0]), own.kind.lower()
            raise own.source.fault(f"the set {shown(own.name)} names {what} {missing}, which is not defined", own.line)
        held = [at] + [numbering.between(first, last, 1) for first, last in own.ranges]
        in_parts = np.flatnonzero(np.isin(part_of, own.parts)) if own.parts else np.empty(0, dtype=np.int64)
        if own.kind == "NODE" and in_parts.size:
            elements = list(self.elements.values())
            held += [nodes.find(np.array(elements[cell][1], dtype=np.int64)) for cell in in_parts.tolist()]
        else:
            held.append(in_parts)
        return np.concatenate(held + self._added(own, nodes, cells, part_of, open_sets))

    def _added(
        self, own: _Set, nodes: Numbering, cells: dict[str, Numbering], part_of: np.ndarray, open_sets: list[int]
    ) -> list[np.ndarray]:
        """Members of the sets that a set adds."""
        held = []
        for number in own.sets:
            other = self.sets.get((own.kind, number))
            if other is None or number in open_sets:
                told = "which holds itself" if other is not None else "which is not defined"
                raise own.source.fault(f"the set {shown(own.name)} adds set {number}, {told}", own.line)
            held.append(self._members(other, nodes, cells, part_of, [*open_sets, number]))
        return held


def _firsts(block: Block, step: int, what: str) -> list[Card]:
    """The first card of each element of a block; blank lines at its end are none.

    :raises InputError: the number of cards is no multiple of those of an element.
    """
    cards = list(block.cards)
    while len(cards) % step and not cards[-1].text:
        cards.pop()
    if len(cards) % step:
        raise block.source.fault(f"*{block.name}: {len(cards)} cards, each {what} has {step}", block.line)
    return cards[::step]


def _between(numbers: np.ndarray, first: int, last: int) -> list[int]:
    return np.unique(numbers[(numbers >= first) & (numbers <= last)]).tolist()


def read(source: Source) -> RawMesh:
    """Read an LS-DYNA keyword file.

    :raises InputError: what it says cannot be carried over, or is wrong.
    """
    model = _Model(source)
    for block in blocks(source):
        model.take(block)
    return model.finish()
