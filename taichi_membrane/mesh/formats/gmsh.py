"""Gmsh meshes of format 2.2 and 4.1, text and binary."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.gmsh_words import Words, sections
from taichi_membrane.mesh.formats.raw import CORNERS, SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Numbering, Source, several

Ints = NDArray[np.int64]
# Nodes of curved elements the other way round.
_TURNED = {"line3": [1, 0, 2], "triangle6": [2, 1, 0, 4, 3, 5]}
_KINDS: dict[int, tuple[CellKind, int]] = {
    15: ("vertex", 0), 1: ("line", 1), 2: ("triangle", 2), 3: ("quad", 2), 8: ("line3", 1), 9: ("triangle6", 2),
}  # fmt: skip
_SOLIDS = {4: "tetrahedra", 5: "hexahedra", 6: "prisms", 7: "pyramids"}


@dataclass(eq=False)
class _Content:
    """What the sections say; elements as rows of (type, physical tags, nodes, numbers); data by name as (numbers, values)."""

    names: dict[tuple[int, int], str] = field(default_factory=dict)
    physical: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    labels: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    points: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    blocks: list[tuple[CellKind, Ints, Ints, Ints]] = field(default_factory=list)
    data: dict[str, tuple[Ints, NDArray[np.float64]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read(source: Source) -> RawMesh:
    """Read a gmsh file.

    Physical groups become groups by their dimension: names that a curve and a surface share stay apart. An element that format 2.2
    writes once for each of its groups is one element of several groups.

    :raises InputError: other versions, partitions, second-order or solid elements, counts that do not agree, damage.
    """
    content = _Content()
    version = ""
    for name, words in sections(source):
        match name:
            case "MeshFormat":
                version = words.version
            case "PhysicalNames":
                _names(words, content)
            case "Entities":
                _entities(words, content)
            case "Nodes":
                _nodes_new(words, content) if version == "4.1" else _nodes_old(words, content)
            case "Elements":
                _elements_new(words, content) if version == "4.1" else _elements_old(words, content)
            case "ElementData" if not words.binary:
                _data(words, content)
            case "ParametricNodes":
                raise source.fault(
                    "nodes with parameters are not read: save with Mesh.SaveParametric = 0", words.line or None
                )
            case "PartitionedEntities":
                raise source.fault(
                    "a partitioned mesh is not read: unpartition it, or save it without partitions", words.line
                )
            case "Parametrizations" | "Periodic" | "Comments" | "GhostElements" | "InterpolationScheme":
                continue
            case _:
                content.notes.append(
                    f"not carried over: ${name} (line {words.line})" if words.line else f"not carried over: ${name}"
                )
    if not len(content.labels):
        raise source.fault("the file holds no $Nodes")
    return _mesh(source, content)


def _names(words: Words, content: _Content) -> None:
    for _ in range(words.count("physical names")):
        dimension, tag, name = words.named()
        before = content.names.setdefault((dimension, abs(tag)), name)
        if before != name:
            raise words.fault(f"physical group {tag} of dimension {dimension} is named '{before}' and '{name}'")
    words.end()


def _entities(words: Words, content: _Content) -> None:
    """Points have three coordinates, others two corners of a box; then come physical tags, then bounding entities."""
    counts = words.sizes(4)
    for dimension, count in enumerate(counts.tolist()):
        for _ in range(count):
            tag = int(words.integers(1)[0])
            words.reals(3 if dimension == 0 else 6)
            content.physical[dimension, tag] = words.integers(words.count("physical tags")).tolist()
            if dimension:
                words.integers(words.count("bounding entities"))
    words.end()


def _nodes_old(words: Words, content: _Content) -> None:
    content.labels, content.points = words.node_rows(words.count("nodes"))
    words.end()


def _nodes_new(words: Words, content: _Content) -> None:
    blocks, total, *_ = words.sizes(4).tolist()
    labels, points = [], []
    for _ in range(blocks):
        dimension, _tag, parametric = words.integers(3).tolist()
        count = words.count("nodes of a block")
        labels.append(words.tags(count))
        points.append(words.reals(count * (3 + (dimension if parametric else 0))).reshape(count, -1)[:, :3])
    content.labels = np.concatenate([np.empty(0, dtype=np.int64), *labels])
    content.points = np.concatenate([np.empty((0, 3)), *points])
    if len(content.labels) != total:
        raise words.fault(f"the file announces {several(total, 'node')} and holds {len(content.labels)}")
    words.end()


def _kind(words: Words, number: int, count: int) -> tuple[CellKind, int]:
    if number in _KINDS:
        return _KINDS[number]
    if number in _SOLIDS:
        raise words.fault(f"the file holds {_SOLIDS[number]}: {SOLID}")
    raise words.fault(f"elements of gmsh's type {number} ({count} or more): {SECOND_ORDER}")


def _elements_old(words: Words, content: _Content) -> None:
    """Consecutive elements of one type are one block; each row has its own tags."""
    total = words.count("elements")
    for number, labels, tags, nodes in words.element_runs(total):
        kind, _ = _kind(words, number, len(nodes))
        content.blocks.append((kind, nodes, tags, labels))
    held = sum(len(nodes) for _, nodes, _, _ in content.blocks)
    if held != total:
        raise words.fault(f"the file announces {several(total, 'element')} and holds {held}")
    words.end()


def _elements_new(words: Words, content: _Content) -> None:
    blocks, total, *_ = words.sizes(4).tolist()
    for _ in range(blocks):
        dimension, tag, number = words.integers(3).tolist()
        count = words.count("elements of a block")
        kind, of_kind = _kind(words, number, count)
        if of_kind != dimension:
            raise words.fault(f"elements of dimension {of_kind} in an entity of dimension {dimension}")
        corners = CORNERS[kind]
        labels, nodes = np.split(words.tags(count * (corners + 1)).reshape(count, -1), [1], axis=1)
        physical = content.physical.get((dimension, tag), [])
        if kind != "vertex" and physical and max(physical) < 0:  # all its groups have it the other way round
            nodes = nodes[:, _TURNED.get(kind, slice(None, None, -1))]
        if physical and min(physical) < 0 < max(physical):
            both = ", ".join(map(str, physical))
            content.notes.append(
                f"the physical groups {both} of entity {tag} have its elements in both orientations: kept as its own"
            )
        groups = np.tile(np.array(physical, dtype=np.int64), (count, 1))
        content.blocks.append((kind, nodes, groups, labels.ravel()))
    held = sum(len(nodes) for _, nodes, _, _ in content.blocks)
    if held != total:
        raise words.fault(f"the file announces {several(total, 'element')} and holds {held}")
    words.end()


def _data(words: Words, content: _Content) -> None:
    """Name and other texts, time and other numbers, then step, components and how many; an element and its values in each row."""
    texts = words.texts(words.count("texts"))
    words.reals(words.count("numbers"))
    settings = words.integers(words.count("whole numbers"))
    if not texts or len(settings) < 3 or not 0 < settings[1] <= 9 or settings[2] < 0:
        raise words.fault("a name, and the numbers of components (at most 9) and of elements are expected")
    width, count = int(settings[1]), int(settings[2])
    rows = words.reals(count * (width + 1)).reshape(count, width + 1)
    content.data[texts[0]] = (rows[:, 0].astype(np.int64), rows[:, 1:] if width > 1 else rows[:, 1])
    words.end()


def _place_data(source: Source, raw: RawMesh, content: _Content, labels: Ints, places: Ints) -> None:
    """Values of elements by their numbers; elements without one get none, which is no number.

    A number that two elements have tells of a row that lost a node, and took the next row's number for it.
    """
    numbering = Numbering(labels)
    order = np.argsort(labels, kind="stable")
    one, other = order[:-1], order[1:]
    twice = np.flatnonzero((labels[one] == labels[other]) & (places[one] != places[other]))
    if twice.size:
        raise source.fault(f"element {labels[one[twice[0]]]} is defined twice, with other nodes")
    for name, (of, values) in content.data.items():
        at = numbering.find(of)
        if (at < 0).any():
            raise source.fault(f"$ElementData '{name}' is of element {of[at < 0][0]}, which is not defined")
        field_of = np.full((raw.cell_count, *values.shape[1:]), np.nan)
        field_of[places[at]] = values
        raw.cell_fields[name] = field_of


def _mesh(source: Source, content: _Content) -> RawMesh:
    numbering = Numbering(content.labels)
    twice = numbering.repeated()
    if twice is not None:
        raise source.fault(f"node {content.labels[twice[0]]} is defined twice")
    raw = RawMesh(content.points, notes=content.notes)
    raw.node_name = lambda node: f"node {content.labels[node]}"
    members: dict[tuple[int, int], list[Ints]] = {}
    labels, places = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for kind in CORNERS:
        mine = [block[1:] for block in content.blocks if block[0] == kind and len(block[1])]
        own = [(nodes, tags) for nodes, tags, _ in mine]
        if not own:
            continue
        width = max(tags.shape[1] for _, tags in own)
        nodes = np.concatenate([block for block, _ in own])
        tags = np.concatenate([np.pad(t, ((0, 0), (0, width - t.shape[1]))) for _, t in own])
        at = numbering.find(nodes)
        if (at < 0).any():
            raise source.fault(f"a {kind} uses node {nodes[at < 0][0]}, which is not defined")
        row, kept = _merged(at, tags)
        numbers = np.array(raw.add_cells(kind, at[kept]))
        labels += [block[2] for block in mine]
        places.append(numbers[row])
        dimension = {"vertex": 0, "line": 1, "line3": 1}.get(kind, 2)
        for tag in np.unique(np.abs(tags[tags != 0])).tolist():
            which = (np.abs(tags) == tag).any(axis=1)
            members.setdefault((dimension, tag), []).append(np.unique(numbers[row[which]]))
    for (dimension, tag), cells in members.items():
        raw.group_cells(content.names.get((dimension, tag), f"physical_{tag}"), np.concatenate(cells))
    _place_data(source, raw, content, np.concatenate(labels), np.concatenate(places))
    for key, name in content.names.items():
        if key not in members:
            raw.notes.append(f"the physical group '{name}' (dimension {key[0]}, number {key[1]}) has no elements")
    return raw


def _merged(nodes: Ints, tags: Ints) -> tuple[Ints, Ints]:
    """For each element the number of the one it is kept as, and which elements are kept.

    Elements of the same nodes in the same order whose physical tags all differ are one element of several groups; of the same tag
    twice, they are duplicates, which the checks of a mesh refuse.
    """
    order = np.lexsort(nodes.T[::-1])
    new = np.concatenate(([True], (nodes[order][1:] != nodes[order][:-1]).any(axis=1)))
    same = np.empty(len(nodes), dtype=np.int64)
    same[order] = np.cumsum(new) - 1
    # How many elements of the same nodes and the same first tag come before: 0 for all but duplicates.
    key = np.column_stack((same, tags[:, 0] if tags.shape[1] else np.zeros(len(nodes), dtype=np.int64)))
    by_key = np.lexsort(key.T[::-1])
    begins = np.concatenate(([True], (key[by_key][1:] != key[by_key][:-1]).any(axis=1)))
    place = np.arange(len(nodes)) - np.maximum.accumulate(np.where(begins, np.arange(len(nodes)), 0))
    repeat = np.empty(len(nodes), dtype=np.int64)
    repeat[by_key] = place
    _, first, label = np.unique(same * (repeat.max(initial=0) + 1) + repeat, return_index=True, return_inverse=True)
    kept = np.sort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[label.ravel()], kept
