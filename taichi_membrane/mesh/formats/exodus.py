"""Exodus files (netCDF): element blocks and node sets as groups; needs the package netCDF4."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import CORNERS, SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, listed, several, shown

_KINDS: tuple[tuple[CellKind, str], ...] = (
    ("triangle", r"TRI(ANGLE)?3?|(TRI)?SHELL3|TRISHELL"),
    ("quad", r"QUAD4?|SHELL4?"),
    ("line", r"BAR2?|BEAM2?|TRUSS2?|EDGE2?|ROD2?"),
    ("vertex", r"SPHERE|POINT|CIRCLE"),
)
_SOLIDS = re.compile(r"(TET|HEX|WEDGE|PYRAMID)\w*")


def read(source: Source) -> RawMesh:
    """Read an Exodus file.

    :raises InputError: no netCDF file, solids, second-order elements, numbers that there are not.
    """
    import netCDF4

    try:
        with netCDF4.Dataset("mesh", memory=source.data) as file:
            file.set_auto_mask(False)
            return _mesh(source, file)
    except OSError as error:
        raise source.fault(f"this is no netCDF file, as Exodus files are, or it is damaged: {error}") from None


def _mesh(source: Source, file: Any) -> RawMesh:
    raw = RawMesh(_points(source, file))
    for number in range(1, _count(file, "num_el_blk") + 1):
        key = f"connect{number}"
        if key in file.variables:  # a block of no elements has none
            cells = _block(source, raw, file.variables[key], len(raw.points))
            raw.group_cells(_name(file, "eb", "block", number), np.asarray(cells))
    for number in range(1, _count(file, "num_node_sets") + 1):
        key = f"node_ns{number}"
        if key in file.variables:
            name = _name(file, "ns", "nodeset", number)
            nodes = np.asarray(file.variables[key][:], dtype=np.int64) - 1
            _within(source, nodes, len(raw.points), f"the node set {shown(name)}")
            raw.group_points(name, nodes)
    left_out = [_name(file, "ss", "sideset", number + 1) for number in range(_count(file, "num_side_sets"))]
    left_out += [f"element set {number + 1}" for number in range(_count(file, "num_elem_sets"))]
    left_out += [name for name in ("name_nod_var", "name_elem_var") if name in file.variables]
    if left_out:
        raw.notes.append(f"not carried over: {listed(left_out)}")
    return raw


def _count(file: Any, dimension: str) -> int:
    return len(file.dimensions[dimension]) if dimension in file.dimensions else 0


def _points(source: Source, file: Any) -> NDArray[np.float64]:
    if "coord" in file.variables:
        axes = [np.asarray(axis, dtype=np.float64) for axis in file.variables["coord"][:]]
    else:
        axes = [
            np.asarray(file.variables[f"coord{a}"][:], dtype=np.float64) for a in "xyz" if f"coord{a}" in file.variables
        ]
    if not 2 <= len(axes) <= 3:
        raise source.fault(f"the file has {several(len(axes), 'coordinate')} for each node, 2 or 3 are needed")
    return np.column_stack([*axes, *[np.zeros(len(axes[0]))] * (3 - len(axes))])


def _block(source: Source, raw: RawMesh, block: Any, node_count: int) -> range:
    """Append a block's elements; return their numbers."""
    name = str(getattr(block, "elem_type", "")).strip("\0 ").upper()
    nodes = np.asarray(block[:], dtype=np.int64) - 1
    kind = next((kind for kind, pattern in _KINDS if re.fullmatch(pattern, name)), None)
    if kind == "quad" and nodes.shape[1] == 3:
        kind = "triangle"  # SHELL says how many nodes in the shape alone
    if kind is None or nodes.ndim != 2 or nodes.shape[1] != CORNERS[kind]:
        reason = SOLID if _SOLIDS.fullmatch(name) else SECOND_ORDER
        raise source.fault(f"{block.name} holds elements {shown(name)} of {nodes.shape[-1]} nodes: {reason}")
    _within(source, nodes, node_count, block.name)
    return raw.add_cells(kind, nodes)


def _within(source: Source, nodes: NDArray[np.int64], count: int, what: str) -> None:
    bad = nodes[(nodes < 0) | (nodes >= count)]
    if bad.size:
        raise source.fault(f"{what} uses node {bad.flat[0] + 1}; the file has {several(count, 'node')}, from 1")


def _name(file: Any, kind: str, word: str, number: int) -> str:
    """The name of a block or set; of its number where it has none."""
    names = file.variables.get(f"{kind}_names")
    if names is not None and len(names) >= number:
        own = bytes(np.asarray(names[number - 1]).tobytes()).split(b"\0")[0].decode("utf-8", "replace").strip()
        if own:
            return own
    numbers = file.variables.get(f"{kind}_prop1")
    return f"{word}_{int(numbers[number - 1]) if numbers is not None and len(numbers) >= number else number}"
