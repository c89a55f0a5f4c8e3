"""VTK's XML files of one piece or several: unstructured grids (.vtu) and polygons (.vtp), in all their encodings."""

from __future__ import annotations

import binascii
import lzma
import re
import zlib
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mesh.formats.raw import RawMesh
from taichi_membrane.mesh.formats.source import Source, several, shown
from taichi_membrane.mesh.formats.vtk_cells import add_cells, name_groups

Ints = NDArray[np.int64]
_TYPES = {f"{kind}{8 * size}": f"{kind[0].lower()}{size}" for kind in ("Int", "UInt") for size in (1, 2, 4, 8)}
_TYPES |= {"Float32": "f4", "Float64": "f8"}
_COMPRESSORS = {"": None, "vtkZLibDataCompressor": "zlib", "vtkLZMADataCompressor": "lzma"}
_POLYGONS = {"Verts": 2, "Lines": 4, "Strips": 6, "Polys": 7}
_LARGEST = 4_000_000_000  # bytes that one array may take; a header claims what it likes


@dataclass(eq=False)
class _File:
    source: Source
    root: ElementTree.Element
    appended: bytes
    appended_raw: bool

    def __post_init__(self) -> None:
        order = self.root.get("byte_order", "LittleEndian")
        self.order = ">" if order == "BigEndian" else "<"
        header = self.root.get("header_type", "UInt32")
        compressor = self.root.get("compressor", "")
        if header not in ("UInt32", "UInt64"):
            raise self.source.fault(f"header_type {shown(header)} is not read; allowed: UInt32, UInt64")
        if compressor not in _COMPRESSORS:
            raise self.source.fault(
                f"the compressor {shown(compressor)} is not read; save with vtkZLibDataCompressor or without compression"
            )
        self.header, self.compression = f"{self.order}u{4 if header == 'UInt32' else 8}", _COMPRESSORS[compressor]

    def array(self, item: ElementTree.Element) -> NDArray[Any]:
        """The numbers of a DataArray; (n, width) where it has several components."""
        name, kind = item.get("Name", ""), item.get("type", "")
        if kind not in _TYPES:
            raise self.source.fault(f"the array {shown(name)} is of type {shown(kind)}; allowed: {', '.join(_TYPES)}")
        match item.get("format", "ascii"):
            case "ascii":
                try:
                    words = np.array((item.text or "").split(), dtype="S")
                    values = words.astype(_TYPES[kind]) if words.size else np.empty(0, dtype=_TYPES[kind])
                except (ValueError, OverflowError):
                    raise self.source.fault(f"the array {shown(name)} holds what is no {kind}") from None
            case "binary":
                values = self._decoded("".join((item.text or "").split()).encode("ascii", "replace"), kind, name)
            case "appended":
                offset = item.get("offset", "")
                if not re.fullmatch(r"\d{1,18}", offset) or int(offset) >= len(self.appended):
                    raise self.source.fault(
                        f"the array {shown(name)} begins at {shown(offset)}, beyond the appended data"
                    )
                data = memoryview(self.appended)[int(offset) :]
                values = self._raw(data, kind, name) if self.appended_raw else self._decoded(bytes(data), kind, name)
            case other:
                raise self.source.fault(f"the array {shown(name)} has format {shown(other)}")
        width = item.get("NumberOfComponents") or "1"
        if not re.fullmatch(r"\d{1,6}", width) or values.size % max(int(width), 1):
            raise self.source.fault(f"the array {shown(name)} has {values.size} values in {width} components")
        return values.reshape(-1, int(width)) if int(width) > 1 else values

    def _decoded(self, text: bytes, kind: str, name: str) -> NDArray[Any]:
        """Base64. A header of compressed data is encoded by itself; one of plain data by itself or with them, its padding tells."""
        size = int(self.header[-1])

        def bytes_of(begin: int, count: int) -> bytes:
            part = text[begin : begin + 4 * -(-count // 3)]
            try:
                found = binascii.a2b_base64(part, strict_mode=True)[:count]
            except (binascii.Error, ValueError):
                found = b""
            if len(found) < count:
                raise self.source.fault(f"the array {shown(name)} is cut off or damaged")
            return found

        first = int(np.frombuffer(bytes_of(0, size), dtype=self.header)[0])
        if self.compression is None:
            self._bounded(first, name)
            ends = 4 * -(-size // 3)
            # Padding before the numbers begin: the header was encoded by itself.
            apart = text[ends - 1 : ends] == b"=" and size + first > 3 * ends // 4 - text[:ends].count(b"=")
            return self._typed(bytes_of(ends, first) if apart else bytes_of(0, size + first)[size:], kind, name)
        self._bounded(8 * first, name)
        head_size = (3 + first) * size
        head = bytes_of(0, head_size)
        total = int(np.frombuffer(head, dtype=self.header)[3:].sum())
        self._bounded(total, name)
        return self._unpacked(head, bytes_of(4 * -(-head_size // 3), total), kind, name)

    def _raw(self, data: memoryview, kind: str, name: str) -> NDArray[Any]:
        size = int(self.header[-1])
        if len(data) < size:
            raise self.source.fault(f"the array {shown(name)} is cut off")
        first = int(np.frombuffer(data[:size], dtype=self.header)[0])
        if self.compression is None:
            if len(data) < size + first:
                raise self.source.fault(f"the array {shown(name)} is cut off: {first} bytes announced")
            return self._typed(bytes(data[size : size + first]), kind, name)
        head = bytes(data[: (3 + first) * size]) if first < len(data) else b""
        if len(head) < (3 + first) * size:
            raise self.source.fault(f"the array {shown(name)} is cut off: {first} blocks announced")
        total = int(np.frombuffer(head, dtype=self.header)[3:].sum())
        return self._unpacked(head, bytes(data[len(head) : len(head) + total]), kind, name)

    def _unpacked(self, head: bytes, data: bytes, kind: str, name: str) -> NDArray[Any]:
        blocks, block_size, last_size, *sizes = np.frombuffer(head, dtype=self.header).tolist()
        whole = block_size * blocks if not last_size else block_size * (blocks - 1) + last_size
        self._bounded(whole, name)
        at, held = 0, []
        for number, size in enumerate(sizes):
            wanted = last_size if last_size and number == blocks - 1 else block_size
            try:
                if self.compression == "zlib":
                    found = zlib.decompressobj().decompress(data[at : at + size], wanted)
                else:
                    found = lzma.LZMADecompressor(memlimit=_LARGEST).decompress(data[at : at + size], wanted)
            except (zlib.error, lzma.LZMAError) as error:
                raise self.source.fault(f"the array {shown(name)} is damaged: {error}") from None
            if len(found) != wanted:
                raise self.source.fault(f"the array {shown(name)}: a block of {wanted} bytes holds {len(found)}")
            held.append(found)
            at += size
        return self._typed(b"".join(held), kind, name)

    def _bounded(self, size: int, name: str) -> None:
        if size > _LARGEST:
            raise self.source.fault(f"the array {shown(name)} claims {size} bytes, more than {_LARGEST}")

    def _typed(self, data: bytes, kind: str, name: str) -> NDArray[Any]:
        dtype = np.dtype(self.order + _TYPES[kind])
        if len(data) % dtype.itemsize:
            raise self.source.fault(f"the array {shown(name)} has {len(data)} bytes, no whole number of {kind}")
        return np.frombuffer(data, dtype=dtype).astype(dtype.newbyteorder("="))


def read(source: Source) -> RawMesh:
    """Read a .vtu or .vtp file; several pieces are joined as they are numbered.

    :raises InputError: other data, unknown encodings, counts that do not agree, damage.
    """
    file = _parsed(source)
    kind = file.root.get("type", "")
    if kind not in ("UnstructuredGrid", "PolyData"):
        raise source.fault(f"VTK data of type {shown(kind)} are not read: UnstructuredGrid or PolyData is needed")
    grid = file.root.find(kind)
    pieces = [] if grid is None else grid.findall("Piece")
    if not pieces:
        raise source.fault("the file holds no Piece")
    raw = RawMesh(np.empty((0, 3)))
    points, origin = [], [np.empty(0, dtype=np.int64)]
    cell_data: list[dict[str, NDArray[Any]]] = []
    point_data: list[dict[str, NDArray[Any]]] = []
    nodes_before = cells_before = 0
    for piece in pieces:
        own, count, cells = _piece(file, raw, piece, kind, nodes_before)
        point_data.append(_arrays(file, raw, piece.find("PointData"), len(own)))
        cell_data.append(_arrays(file, raw, piece.find("CellData"), count))
        points.append(own)
        origin.append(cells_before + cells)
        nodes_before, cells_before = nodes_before + len(own), cells_before + count
    raw.points = np.concatenate(points)
    name_groups(raw, np.concatenate(origin), _common(cell_data, raw), _common(point_data, raw))
    return raw


def _common(pieces: list[dict[str, NDArray[Any]]], raw: RawMesh) -> dict[str, NDArray[Any]]:
    """Arrays that all pieces have, one behind the other."""
    names = [name for name in pieces[0] if all(name in piece for piece in pieces)]
    lost = sorted({name for piece in pieces for name in piece} - set(names))
    if lost:
        raw.notes.append(f"not carried over: {', '.join(lost)}, which only some pieces have")
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in names}


def _parsed(source: Source) -> _File:
    """XML, and the bytes of raw appended data, which are no XML."""
    data, appended, is_raw = source.data, b"", False
    match = re.search(rb"<AppendedData[^>]*encoding\s*=\s*[\"'](raw|base64)[\"'][^>]*>\s*_", data)
    if match:
        end = data.rfind(b"</AppendedData>")
        if end < match.end():
            raise source.fault("the appended data have no end: the file is cut off")
        is_raw = match[1] == b"raw"
        appended = data[match.end() : end] if is_raw else b"".join(data[match.end() : end].split())
        data = data[: match.end()] + data[end:]
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise source.fault("the file declares entities, which VTK files never do")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise source.fault(f"the file is no well-formed XML: {error}") from None
    if root.tag != "VTKFile":
        raise source.fault(f"a VTKFile is expected, got {shown(root.tag)}")
    return _File(source, root, appended, is_raw)


def _arrays(file: _File, raw: RawMesh, parent: ElementTree.Element | None, length: int) -> dict[str, NDArray[Any]]:
    """Named arrays of numbers; each must have a value for every point or cell."""
    found: dict[str, NDArray[Any]] = {}
    for item in () if parent is None else parent:
        name = item.get("Name", "")
        if item.tag == "DataArray":
            found[name] = file.array(item)
            if len(found[name]) != length:
                raise file.source.fault(
                    f"the array {shown(name)} has {several(len(found[name]), 'value')}, {length} are needed"
                )
        elif item.tag == "Array":
            raw.notes.append(f"not carried over: the array {shown(name)} of type {shown(item.get('type', ''))}")
    return found


def _piece(
    file: _File, raw: RawMesh, piece: ElementTree.Element, kind: str, shift: int
) -> tuple[NDArray[np.float64], int, Ints]:
    """Points of a piece, its number of cells, and the cell of the file that each added cell comes from."""
    item = piece.find("Points/DataArray")
    points = np.empty((0, 3)) if item is None else np.asarray(file.array(item), dtype=np.float64)
    announced = {key: int(value) for key, value in piece.attrib.items() if re.fullmatch(r"\d{1,18}", value)}
    if points.ndim != 2 or points.shape[1] != 3 or announced.get("NumberOfPoints", len(points)) != len(points):
        told = f"{several(announced.get('NumberOfPoints', len(points)), 'point')} announced, an array of shape {points.shape} given"
        raise file.source.fault(told)
    sections = {"Cells": None} if kind == "UnstructuredGrid" else dict(_POLYGONS)
    origin, count = [np.empty(0, dtype=np.int64)], 0
    for tag, number in sections.items():
        arrays = {array.get("Name", ""): file.array(array) for array in piece.findall(f"{tag}/DataArray")}
        ends = arrays.get("offsets", np.empty(0)).ravel().astype(np.int64)
        nodes = arrays.get("connectivity", np.empty(0)).ravel().astype(np.int64)
        types = np.full(len(ends), number) if number else arrays.get("types", np.empty(0)).ravel().astype(np.int64)
        announced_cells = announced.get(f"NumberOf{tag}", len(ends))
        if not len(ends) == len(types) == announced_cells or (len(ends) and ends[-1] != len(nodes)):
            raise file.source.fault(
                f"{tag}: {several(announced_cells, 'cell')} announced, {len(ends)} offsets, {len(types)} types, "
                f"{len(nodes)} node numbers"
            )
        if nodes.size and (nodes.min() < 0 or nodes.max() >= len(points)):
            bad = nodes.min() if nodes.min() < 0 else nodes.max()
            raise file.source.fault(f"a cell uses node {bad}, but node numbers run from 0 to {len(points) - 1}")
        starts = np.concatenate(([0], ends[:-1])) if len(ends) else ends
        origin.append(count + add_cells(file.source, raw, types, starts, ends, nodes + shift))
        count += len(ends)
    return points, count, np.concatenate(origin)
