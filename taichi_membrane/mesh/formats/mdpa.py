"""Kratos model parts (.mdpa): nodes, membrane and cable elements, properties and sub model parts as groups."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from taichi_membrane.mesh.formats.raw import SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, listed, shown

_COUNTED = re.compile(r"(\w*?)([23])D(\d+)N?$")
_SURFACE = re.compile(r"membrane|shell|surface|plane|plate|triangle|quad|face", re.IGNORECASE)
_PARTS = (
    "SubModelPart",
    "SubModelPartNodes",
    "SubModelPartElements",
    "SubModelPartConditions",
    "SubModelPartGeometries",
)
_SKIPPED = (
    "ModelPartData", "NodalData", "ElementalData", "ConditionalData", "Table", "Mesh", "SubModelPartData",
    "SubModelPartTables", "SubModelPartProperties", "Constraints", "SubModelPartConstraints", "MasterSlaveConstraints",
)  # fmt: skip


@dataclass(eq=False)
class _Part:
    """A sub model part: its path of names, the numbers it holds and the lines they stand on."""

    name: str
    nodes: list[tuple[int, int]] = field(default_factory=list)
    elements: list[tuple[int, int]] = field(default_factory=list)


@dataclass(eq=False)
class _Reader:
    source: Source
    nodes: dict[int, list[float]] = field(default_factory=dict)
    elements: dict[int, tuple[CellKind, list[int], int, int]] = field(default_factory=dict)
    open: list[tuple[str, str, int]] = field(default_factory=list)
    stack: list[_Part] = field(default_factory=list)
    parts: dict[str, _Part] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)

    def begin(self, words: list[str], line: int) -> None:
        """A block opens."""
        kind, rest = words[0], " ".join(words[1:])
        if kind == "SubModelPart":
            name = f"{self.stack[-1].name}.{rest}" if self.stack else rest
            if not rest:
                raise self.source.fault("a SubModelPart has no name", line)
            self.stack.append(self.parts.setdefault(name, _Part(name)))
        elif kind in ("Conditions", "Geometries", "SubModelPartConditions", "SubModelPartGeometries") or (
            kind in _SKIPPED and kind != "ModelPartData"
        ):
            self.left_out.setdefault(f"{kind} {rest}".strip(), line)
        elif kind == "Elements" and not _COUNTED.search(rest):
            told = f"the type of elements {shown(rest)} tells no number of nodes, as MembraneElement3D3N does"
            raise self.source.fault(told, line)
        elif kind not in ("Nodes", "Elements", "Properties", "ModelPartData", *_PARTS):
            raise self.source.fault(f"the block {shown(kind)} is not one that is read", line)
        self.open.append((kind, rest, line))

    def end(self, words: list[str], line: int) -> None:
        """A block closes."""
        if not self.open or words[:1] != [self.open[-1][0]]:
            expected = f"End {self.open[-1][0]} (opened on line {self.open[-1][2]})" if self.open else "no End"
            raise self.source.fault(f"{expected} is expected, got End {' '.join(words)}", line)
        if self.open.pop()[0] == "SubModelPart":
            self.stack.pop()

    def row(self, words: list[str], line: int) -> None:
        """A line inside a block."""
        if not self.open:
            raise self.source.fault(f"{shown(' '.join(words))} stands outside of all blocks", line)
        kind, rest, _ = self.open[-1]
        match kind:
            case "Nodes":
                number = self.source.whole(words[0], line, "a node number")
                if len(words) != 4 or number in self.nodes:
                    told = (
                        "is defined twice"
                        if number in self.nodes
                        else f"has {len(words) - 1} coordinates, 3 are needed"
                    )
                    raise self.source.fault(f"node {number} {told}", line)
                self.nodes[number] = [self.source.real(word, line, "a coordinate") for word in words[1:]]
            case "Elements":
                self._element(words, rest, line)
            case "SubModelPartNodes" | "SubModelPartElements" if self.stack:
                own = self.stack[-1].nodes if kind == "SubModelPartNodes" else self.stack[-1].elements
                own += [(self.source.whole(word, line, "a number"), line) for word in words]
            case "SubModelPart":
                raise self.source.fault(f"{shown(' '.join(words))} stands in no block of the sub model part", line)

    def _element(self, words: list[str], name: str, line: int) -> None:
        numbers = [self.source.whole(word, line, "a number of an element") for word in words]
        match = _COUNTED.search(name)
        assert match is not None  # seen when the block began
        count = int(match[3])
        if len(numbers) != count + 2:
            told = f"{name} {numbers[0]} has {len(numbers)} numbers: its own, its properties and {count} nodes are expected"
            raise self.source.fault(told, line)
        kinds: dict[int, CellKind] = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}
        if count not in kinds:
            told = SECOND_ORDER if count in (6, 9) and _SURFACE.search(name) else SOLID
            raise self.source.fault(f"elements {shown(name)} of {count} nodes: {told}", line)
        if count == 4 and match[2] == "3" and not _SURFACE.search(name):
            raise self.source.fault(f"elements {shown(name)} of 4 nodes may be tetrahedra: {SOLID}", line)
        if numbers[0] in self.elements:
            raise self.source.fault(f"element {numbers[0]} stands on line {self.elements[numbers[0]][3]} already", line)
        self.elements[numbers[0]] = (kinds[count], numbers[2:], numbers[1], line)

    def finish(self) -> RawMesh:
        """All that was read, as one mesh."""
        if self.open:
            raise self.source.fault(f"the block {self.open[-1][0]} has no end: the file is cut off", self.open[-1][2])
        raw = RawMesh(np.array(list(self.nodes.values()), dtype=np.float64).reshape(-1, 3))
        nodes = Numbering(np.array(list(self.nodes), dtype=np.int64))
        elements = Numbering(np.array(list(self.elements), dtype=np.int64))
        rows: list[tuple[CellKind, list[int]]] = []
        for number, (kind, corners, _, line) in self.elements.items():
            rows.append((kind, self._found(nodes, corners, line, f"element {number} uses node")))
        raw.add_rows(rows)
        labels = list(self.elements)
        raw.cell_name = lambda cell: f"element {labels[cell]} (line {self.elements[labels[cell]][3]})"
        properties = np.array([item[2] for item in self.elements.values()], dtype=np.int64)
        raw.group_by_value("properties", properties, np.arange(len(properties)))
        for part in self.parts.values():
            for kind_of, held, numbering in (("node", part.nodes, nodes), ("element", part.elements, elements)):
                if not held:
                    continue
                wanted = [number for number, _ in held]
                at = numbering.find(np.array(wanted, dtype=np.int64))
                if (at < 0).any():
                    number, line = held[int(np.argmax(at < 0))]
                    told = f"the sub model part {shown(part.name)} names {kind_of} {number}, which is not defined"
                    raise self.source.fault(told, line)
                raw.group_points(part.name, at) if kind_of == "node" else raw.group_cells(part.name, at)
        if self.left_out:
            told = listed((f"{name} (line {line})" for name, line in self.left_out.items()), 12)
            raw.notes.append(f"not carried over: {told}")
        return raw

    def _found(self, nodes: Numbering, corners: list[int], line: int, what: str) -> list[int]:
        at = nodes.find(np.array(corners, dtype=np.int64))
        if (at < 0).any():
            raise self.source.fault(f"{what} {corners[int(np.argmax(at < 0))]}, which is not defined", line)
        return [int(place) for place in at]


def read(source: Source) -> RawMesh:
    """Read a Kratos model part.

    :raises InputError: blocks and elements that have no place in a mesh, numbers that are not defined, damage.
    """
    reader = _Reader(source)
    for line, text in enumerate(source.lines, 1):
        words = text.partition("//")[0].split()
        if not words:
            continue
        if words[0] == "Begin" and len(words) > 1:
            reader.begin(words[1:], line)
        elif words[0] == "End":
            reader.end(words[1:], line)
        else:
            reader.row(words, line)
    return reader.finish()
