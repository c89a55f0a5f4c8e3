"""Where a scene's mesh comes from: a parametric shape, a file, or an object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from taichi_membrane.scene.adapt import Adapt
from taichi_membrane.scene.base import Count, Positive, PositiveLength, Record
from taichi_membrane.scene.built import (
    AirbagShape,
    ArchTentShape,
    ConeShape,
    DropStitchShape,
    HullShape,
    HyparShape,
    MattressShape,
    PumpkinShape,
    WaterTubeShape,
)

# What kind of triangles a mesh is made of, and where six-node ones sample strain.
Order = Literal[1, 2]
Points = Literal[3, 6]


class TubeGrade(Record):
    """Lengths of the bands of elements beside some rings of a tube, on both sides; they grow from there to those of even bands.

    A boundary layer beside a ring that is held, loaded or joins a cap reaches over l = r √(N/(E t)), N = p r/2; l/2 resolves it.
    Rings lie in line then: ``pattern`` must be ``alternating``, which suits six-node triangles, or ``diagonal``.
    """

    start: PositiveLength | None = None
    """Length of the bands beside the ring ``start`` [length]; even without it."""
    middle: PositiveLength | None = None
    """Length of the bands beside the ring ``middle`` [length]; even without it."""
    end: PositiveLength | None = None
    """Length of the bands beside the ring ``end`` [length]; even without it."""


class ArchGrade(Record):
    """Lengths of the bands of elements beside some rings of an arch, along the arc; as those of a tube."""

    start: PositiveLength | None = None
    """Length of the bands beside the ring ``start`` [length]; even without it."""
    crown: PositiveLength | None = None
    """Length of the bands beside the ring ``crown`` [length]; even without it."""
    end: PositiveLength | None = None
    """Length of the bands beside the ring ``end`` [length]; even without it."""


class TubeShape(Record):
    """A straight tube along +x from 0 to ``length``, with or without caps."""

    shape: Literal["tube"]
    """A straight tube."""
    radius: PositiveLength
    """Radius [length]."""
    length: PositiveLength
    """Length without caps [length]."""
    around: Annotated[int, Field(ge=3, le=20_000)]
    """Elements around."""
    along: Count
    """Rings of elements along it."""
    cap_start: Literal["none", "flat", "hemisphere"] = "none"
    """Cap at x = 0; flat and hemisphere caps close the tube."""
    cap_end: Literal["none", "flat", "hemisphere"] = "hemisphere"
    """Cap at the other end."""
    pattern: Literal["staggered", "diagonal", "alternating"] = "staggered"
    """How triangles lie: staggered rings, or squares cut by a diagonal; by ``alternating`` ones only with ``order = 2``."""
    grade: Literal["auto"] | TubeGrade | None = None
    """Shorter bands beside some rings: by their lengths, or ``auto``, l/2 beside all that are held, loaded or join a cap."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class ArchShape(Record):
    """A tube along a circular arc in the xz plane, feet on z = 0, open ends."""

    shape: Literal["arch"]
    """A tube along a circular arc."""
    span: PositiveLength
    """Distance of the feet's centres [length]."""
    radius: PositiveLength
    """Radius of the tube [length]."""
    around: Annotated[int, Field(ge=3, le=20_000)]
    """Elements around the tube."""
    along: Count
    """Rings of elements along the arc."""
    angle: Annotated[float, Field(gt=0, lt=360)] = 180.0
    """Angle of the arc [degrees]."""
    pattern: Literal["staggered", "diagonal", "alternating"] = "staggered"
    """How triangles lie: staggered rings, or squares cut by a diagonal; by ``alternating`` ones only with ``order = 2``."""
    grade: Literal["auto"] | ArchGrade | None = None
    """Shorter bands beside some rings: by their lengths, or ``auto``, l/2 beside all that are held or loaded."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class CushionShape(Record):
    """Two flat rectangular sheets in z = 0, seamed along their rim."""

    shape: Literal["cushion"]
    """Two sheets seamed along their rim."""
    width: PositiveLength
    """Side along x [length]."""
    height: PositiveLength
    """Side along y [length]."""
    along_x: Count
    """Squares along x."""
    along_y: Count
    """Squares along y."""
    pattern: Literal["diagonal", "alternating", "crossed"] = "alternating"
    """How squares are cut in triangles."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class PanelShape(Record):
    """A flat rectangle in z = 0 with a corner at the origin."""

    shape: Literal["panel"]
    """A flat rectangle."""
    width: PositiveLength
    """Side along x [length]."""
    height: PositiveLength
    """Side along y [length]."""
    along_x: Count
    """Squares along x."""
    along_y: Count
    """Squares along y."""
    pattern: Literal["diagonal", "alternating", "crossed"] = "diagonal"
    """How squares are cut in triangles."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class SphereShape(Record):
    """A sphere about the origin: a subdivided octahedron."""

    shape: Literal["sphere"]
    """A sphere."""
    radius: PositiveLength
    """Radius [length]."""
    divisions: Annotated[int, Field(ge=1, le=3000)]
    """Parts of each edge of the octahedron."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class DiscShape(Record):
    """A flat disc in z = 0 about the origin; ring k has ``sectors`` · k nodes."""

    shape: Literal["disc"]
    """A flat disc."""
    radius: PositiveLength
    """Radius [length]."""
    rings: Annotated[int, Field(ge=1, le=3000)]
    """Rings of elements."""
    sectors: Annotated[int, Field(ge=3, le=64)] = 6
    """Triangles at the centre."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class AnnulusShape(Record):
    """A flat ring in z = 0 about the origin, between two radii; nodes in staggered rings of ``around``."""

    shape: Literal["annulus"]
    """A flat ring."""
    inner: PositiveLength
    """Inner radius [length]."""
    outer: PositiveLength
    """Outer radius [length]."""
    around: Annotated[int, Field(ge=3, le=20_000)]
    """Elements around."""
    rings: Count
    """Rings of elements."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class WedgeShape(Record):
    """A sector of a flat disc in z = 0: apex at the origin, from the x axis counter-clockwise over ``angle`` degrees."""

    shape: Literal["wedge"]
    """A sector of a disc."""
    radius: PositiveLength
    """Radius [length]."""
    angle: Annotated[float, Field(gt=0, le=180)]
    """Angle at the apex [degrees]."""
    rings: Annotated[int, Field(ge=1, le=3000)]
    """Rings of elements."""
    around: Count = 1
    """Triangles at the apex."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class GivenMesh(Record):
    """The mesh is handed to :func:`taichi_membrane.execution.run` as an object."""

    shape: Literal["given"]
    """A mesh object, ``tm.run(scene, mesh=...)``."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


class MeshFile(Record):
    """A triangle mesh in a file (docs/meshes.md lists the formats); a relative path is relative to the scene file.

    A mesh with a ``path`` needs no ``shape``. ``open_seams`` keeps free edges that lie on each other apart, as slits; without it
    they are refused, or joined by ``--repair``. ``join`` is how near nodes of free edges are one for ``--repair`` [length]; by the
    file's digits without it.
    """

    shape: Literal["file"] = "file"
    """A mesh file."""
    path: Annotated[str, Field(min_length=1, max_length=1000)]
    """Path, relative to the scene file."""
    scale: Positive = 1.0
    """Factor on its coordinates, say 1000 from metres to millimetres."""
    open_seams: bool = False
    """Keep free edges that lie on each other apart, as slits."""
    join: PositiveLength | None = None
    """Distance at which ``--repair`` joins free edges [length]; by the digits of the file without it."""
    order: Order = 1
    """1 for triangles of three nodes, flat and of one strain; 2 for curved ones of six, with nodes amid their sides."""
    points: Points = 3
    """Points at which a six-node triangle samples strain."""
    adapt: Adapt | None = None
    """Refine the mesh until the estimated error of a probe is small enough."""


def _shape_of_a_path(value: Any) -> Any:
    """Data of a mesh that has a path and no shape are those of a file."""
    if isinstance(value, Mapping) and "path" in value and "shape" not in value:
        return {"shape": "file", **value}
    return value


MeshSource = Annotated[
    TubeShape
    | ArchShape
    | CushionShape
    | PanelShape
    | SphereShape
    | DiscShape
    | AnnulusShape
    | WedgeShape
    | ArchTentShape
    | MattressShape
    | HyparShape
    | ConeShape
    | DropStitchShape
    | AirbagShape
    | WaterTubeShape
    | PumpkinShape
    | HullShape
    | MeshFile
    | GivenMesh,
    Field(discriminator="shape"),
    BeforeValidator(_shape_of_a_path),
]
