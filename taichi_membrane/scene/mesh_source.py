"""Where a scene's mesh comes from: a parametric shape, a file, or an object."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taichi_membrane.scene.base import Count, Positive, Record


class TubeShape(Record):
    """A straight tube along +x from 0 to ``length``, with or without caps."""

    shape: Literal["tube"]
    radius: Positive
    length: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    along: Count
    cap_start: Literal["none", "flat", "hemisphere"] = "none"
    cap_end: Literal["none", "flat", "hemisphere"] = "hemisphere"
    pattern: Literal["staggered", "diagonal"] = "staggered"


class ArchShape(Record):
    """A tube along a circular arc in the xz plane, feet on z = 0, open ends."""

    shape: Literal["arch"]
    span: Positive
    radius: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    along: Count
    angle: Annotated[float, Field(gt=0, lt=360)] = 180.0
    pattern: Literal["staggered", "diagonal"] = "staggered"


class CushionShape(Record):
    """Two flat rectangular sheets in z = 0, seamed along their rim."""

    shape: Literal["cushion"]
    width: Positive
    height: Positive
    along_x: Count
    along_y: Count
    pattern: Literal["diagonal", "alternating", "crossed"] = "alternating"


class PanelShape(Record):
    """A flat rectangle in z = 0 with a corner at the origin."""

    shape: Literal["panel"]
    width: Positive
    height: Positive
    along_x: Count
    along_y: Count
    pattern: Literal["diagonal", "alternating", "crossed"] = "diagonal"


class SphereShape(Record):
    """A sphere about the origin: a subdivided octahedron."""

    shape: Literal["sphere"]
    radius: Positive
    divisions: Annotated[int, Field(ge=1, le=3000)]


class DiscShape(Record):
    """A flat disc in z = 0 about the origin; ring k has ``sectors`` · k nodes."""

    shape: Literal["disc"]
    radius: Positive
    rings: Annotated[int, Field(ge=1, le=3000)]
    sectors: Annotated[int, Field(ge=3, le=64)] = 6


class AnnulusShape(Record):
    """A flat ring in z = 0 about the origin, between two radii; nodes in staggered rings of ``around``."""

    shape: Literal["annulus"]
    inner: Positive
    outer: Positive
    around: Annotated[int, Field(ge=3, le=20_000)]
    rings: Count


class WedgeShape(Record):
    """A sector of a flat disc in z = 0: apex at the origin, from the x axis counter-clockwise over ``angle`` degrees."""

    shape: Literal["wedge"]
    radius: Positive
    angle: Annotated[float, Field(gt=0, le=180)]
    rings: Annotated[int, Field(ge=1, le=3000)]
    around: Count = 1


class GivenMesh(Record):
    """The mesh is handed to :func:`taichi_membrane.execution.run` as an object."""

    shape: Literal["given"]


class MeshFile(Record):
    """A triangle mesh in a file (docs/meshes.md lists the formats); a relative path is relative to the scene file.

    ``open_seams`` keeps free edges that lie on each other apart, as slits; without it they are refused, or joined by ``--repair``.
    ``join`` is how near nodes of free edges are one for ``--repair`` [length]; by the file's digits without it.
    """

    shape: Literal["file"] = "file"
    path: Annotated[str, Field(min_length=1, max_length=1000)]
    scale: Positive = 1.0
    open_seams: bool = False
    join: Positive | None = None


MeshSource = Annotated[
    TubeShape
    | ArchShape
    | CushionShape
    | PanelShape
    | SphereShape
    | DiscShape
    | AnnulusShape
    | WedgeShape
    | MeshFile
    | GivenMesh,
    Field(discriminator="shape"),
]
