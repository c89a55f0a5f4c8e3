"""CGNS files (HDF5) of one unstructured zone: sections and boundary conditions as groups; needs the package h5py."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import CORNERS, SECOND_ORDER, SOLID, CellKind, RawMesh
from taichi_membrane.mesh.formats.source import Source, listed, several, shown

Ints = NDArray[np.int64]
_DATA = " data"
_KINDS: dict[int, CellKind] = {2: "vertex", 3: "line", 5: "triangle", 7: "quad"}
_SECOND_ORDER, _MIXED = (4, 6, 8, 9, 24, 25, 26, 27, 28), 20


def read(source: Source) -> RawMesh:
    """Read a CGNS file.

    :raises InputError: no HDF5 file, several zones, structured zones, solids, second-order elements, counts that do not agree.
    """
    import h5py

    try:
        with h5py.File(io.BytesIO(source.data), "r") as file:
            return _mesh(source, file)
    except OSError as error:
        raise source.fault(f"this is no HDF5 file, as CGNS files are, or it is damaged: {error}") from None


def _labelled(group: Any, label: str) -> dict[str, Any]:
    """The children of a node that have a label of CGNS, by name."""
    return {name: item for name, item in group.items() if _label(item) == label}


def _label(item: Any) -> str:
    value = item.attrs.get("label", b"") if hasattr(item, "attrs") else b""
    return (value.decode("latin-1") if isinstance(value, bytes) else str(value)).strip("\0 ")


def _text(item: Any) -> str:
    return bytes(np.asarray(item[_DATA], dtype=np.uint8)).decode("latin-1").strip("\0 ") if _DATA in item else ""


def _mesh(source: Source, file: Any) -> RawMesh:
    zones = [zone for base in _labelled(file, "CGNSBase_t").values() for zone in _labelled(base, "Zone_t").items()]
    if len(zones) != 1:
        raise source.fault(
            f"{several(len(zones), 'zone')} ({listed(name for name, _ in zones)}), one is needed: join them"
        )
    name, zone = zones[0]
    kinds = [_text(item) for item in _labelled(zone, "ZoneType_t").values()]
    if kinds != ["Unstructured"]:
        raise source.fault(f"the zone {shown(name)} is not unstructured")
    coordinates: Any = next(iter(_labelled(zone, "GridCoordinates_t").values()), {})
    axes = [f"Coordinate{axis}" for axis in "XYZ"]
    missing = [axis for axis in axes if axis not in coordinates]
    if missing:
        raise source.fault(f"the zone {shown(name)} has no {', '.join(missing)}; curved coordinates are not read")
    raw = RawMesh(np.column_stack([np.asarray(coordinates[axis][_DATA], dtype=np.float64).ravel() for axis in axes]))
    place: dict[int, int] = {}
    for section, item in sorted(_labelled(zone, "Elements_t").items(), key=lambda pair: _range(pair[1])[0]):
        first, last = _range(item)
        cells = _section(source, raw, section, item, last - first + 1)
        place.update(zip(range(first, last + 1), cells, strict=True))
        raw.group_cells(section, list(cells))
    for conditions in _labelled(zone, "ZoneBC_t").values():
        for own, item in _labelled(conditions, "BC_t").items():
            _condition(source, raw, own, item, place)
    return raw


def _range(item: Any) -> tuple[int, int]:
    first, last = np.asarray(item["ElementRange"][_DATA], dtype=np.int64).ravel().tolist()
    return first, last


def _section(source: Source, raw: RawMesh, name: str, item: Any, count: int) -> range:
    """Append a section's elements; return their numbers."""
    number = int(np.asarray(item[_DATA]).ravel()[0])
    flat = np.asarray(item["ElementConnectivity"][_DATA], dtype=np.int64).ravel()
    if number == _MIXED:
        first, at, rows = raw.cell_count, 0, []
        while at < len(flat):
            kind = _kind(source, name, int(flat[at]))
            rows.append((kind, (flat[at + 1 : at + 1 + CORNERS[kind]] - 1).tolist()))
            at += 1 + CORNERS[kind]
        if len(rows) != count or at != len(flat):
            raise source.fault(f"the section {shown(name)} announces {count} elements and holds {len(rows)}")
        raw.add_rows(rows)
        return range(first, first + count)
    kind = _kind(source, name, number)
    if len(flat) != count * CORNERS[kind]:
        told = f"announces {several(count, kind)} and holds {several(len(flat), 'node number')}"
        raise source.fault(f"the section {shown(name)} {told}")
    return raw.add_cells(kind, flat - 1)


def _kind(source: Source, name: str, number: int) -> CellKind:
    if number not in _KINDS:
        reason = SECOND_ORDER if number in _SECOND_ORDER else SOLID
        raise source.fault(f"the section {shown(name)} holds elements of CGNS's type {number}: {reason}")
    return _KINDS[number]


def _condition(source: Source, raw: RawMesh, name: str, item: Any, place: dict[int, int]) -> None:
    """A boundary condition names points, or elements where it says so."""
    location = next((_text(child) for child in _labelled(item, "GridLocation_t").values()), "Vertex")
    for key in ("PointRange", "PointList", "ElementRange", "ElementList"):
        if key not in item:
            continue
        numbers = np.asarray(item[key][_DATA], dtype=np.int64).ravel()
        if key.endswith("Range"):
            if numbers.size != 2 or not 1 <= numbers[0] <= numbers[1] <= len(raw.points) + len(place):
                raise source.fault(f"the boundary condition {shown(name)} has the range {numbers.tolist()}")
            numbers = np.arange(numbers[0], numbers[1] + 1)
        if location == "Vertex" and key.startswith("Point"):
            if numbers.size and not (numbers.min() >= 1 and numbers.max() <= len(raw.points)):
                raise source.fault(f"the boundary condition {shown(name)} names points that there are not")
            raw.group_points(name, numbers - 1)
            return
        unknown = [number for number in numbers.tolist() if number not in place]
        if unknown:
            raise source.fault(f"the boundary condition {shown(name)} names element {unknown[0]}, which there is not")
        raw.group_cells(name, [place[number] for number in numbers.tolist()])
        return
