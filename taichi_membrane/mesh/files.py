"""Meshes from files and from other libraries' objects, and back: reading and validating as one step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.mesh.check import MeshFault
from taichi_membrane.mesh.formats.assemble import MeshParts, assemble
from taichi_membrane.mesh.formats.objects import from_object as content_of
from taichi_membrane.mesh.formats.source import Source
from taichi_membrane.mesh.read import read_parts
from taichi_membrane.mesh.surface import Mesh
from taichi_membrane.mesh.write import write

_MOST_NAMED = 4  # elements and nodes of a fault whose names in the file are given


def read_mesh(
    path: str | Path, *, repair: bool = False, scale: float = 1.0, open_seams: bool = False, join: float | None = None
) -> Mesh:
    """Read a triangle mesh from a file; what each format carries over is in docs/meshes.md.

    Groups come from the sets, physical groups, parts, layers and whole-number arrays of the file. A group of triangles also gives a
    node group of its name. Line elements are ``lines`` with ``line_groups``; points of groups and lines that no triangle uses are
    ``loose_points``. Quadrilaterals are split along their shorter diagonal. ``notes`` says what was decided and not carried over.

    :param repair: mend what can be mended; see :meth:`Mesh.build`.
    :param scale: factor on all coordinates.
    :param open_seams: free edges that lie on each other stay apart, as slits.
    :param join: repair joins nodes of free edges up to this distance, in the units after scaling; by the file's digits when None.
    :raises InputError: the file is missing, of unknown format or damaged, says what cannot be carried over, or fails a check of
        :meth:`Mesh.build`. One message: file, place, cause, remedy.
    """
    return _built(read_parts(Path(path)), str(path), repair, scale, open_seams, join)


def from_object(thing: Any, *, repair: bool, scale: float, open_seams: bool, join: float | None) -> Mesh:
    """Convert a mesh object; see :meth:`Mesh.from_object`."""
    where = type(thing).__name__
    return _built(
        assemble(Source(Path(), b"", where), content_of(thing, where)), where, repair, scale, open_seams, join
    )


def save(mesh: Mesh, path: Path) -> None:
    """Write a mesh; see :meth:`Mesh.save`."""
    write(mesh, path)


def _built(parts: MeshParts, where: str, repair: bool, scale: float, open_seams: bool, join: float | None) -> Mesh:
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"{where}: scale = {scale!r} must be a number above 0")
    try:
        return Mesh.build(
            scale * parts.points,
            parts.triangles,
            parts.node_groups,
            parts.tri_groups,
            parts.tri_warp,
            where=where,
            repair=repair,
            open_seams=open_seams,
            join=join,
            digit=scale * parts.resolution,
            lines=parts.lines,
            line_groups=parts.line_groups,
            loose_points=scale * parts.loose_points,
            loose_groups=parts.loose_groups,
            notes=parts.notes,
            tri_fields=parts.tri_fields,
            tri_middle=parts.tri_middle,
        )
    except MeshFault as fault:
        names = _names(fault.elements, parts.element_name)
        names += (
            [] if repair else _names(fault.nodes, parts.node_name)
        )  # repair gives nodes other numbers, elements keep theirs
        if not names:
            raise
        raise InputError(f"{fault}. In the file: {', '.join(names)}") from None


def _names(numbers: tuple[int, ...], name: Callable[[int], str] | None) -> list[str]:
    return [] if name is None else [name(number) for number in numbers[:_MOST_NAMED]]
