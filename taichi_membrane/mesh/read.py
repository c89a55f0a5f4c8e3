"""The boundary around reading a mesh file: whatever a file does, it gives its content or one message."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane import bounds
from taichi_membrane.errors import InputError, kind_of_path
from taichi_membrane.mesh.formats.assemble import MeshParts, assemble
from taichi_membrane.mesh.formats.raw import RawMesh
from taichi_membrane.mesh.formats.source import Source

# Reading a file may take this many bytes, and this many for each of its own: numbers as text become Python objects on the
# way, and vtu files hold compressed data. A header that claims more than the file can hold meets the bound.
_ROOM, _GROWTH = 1_000_000_000, 100
# Some readers of meshio (Fluent, Tecplot, WKT) never end on a damaged file; text takes about 2 s per megabyte.
_PATIENCE, _SECONDS_PER_BYTE = 30.0, 1e-5

# The reader of each file extension that this program reads itself.
READERS = {
    ".inp": "abaqus",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".fem": "nastran",
    ".k": "dyna",
    ".key": "dyna",
    ".dyn": "dyna",
    ".msh": "gmsh",
    ".stl": "stl",
    ".obj": "obj",
    ".ply": "ply",
    ".off": "off",
    ".vtk": "vtk_legacy",
    ".vtu": "vtk_xml",
    ".vtp": "vtk_xml",
    ".mesh": "medit",
    ".mdpa": "mdpa",
    ".dxf": "dxf",
    ".3dm": "rhino",
    ".cgns": "cgns",
    ".e": "exodus",
    ".ex2": "exodus",
    ".exo": "exodus",
}
_PACKAGES = {
    "rhino": "rhino3dm",
    "cgns": "h5py",
    "exodus": "netCDF4",
}  # readers that need more than this program's own packages
# Extensions that meshio reads, and the package it needs beside itself. Its readers of other formats drop or mistake what is here
# carried over or refused, so they are not asked.
MESHIO = {
    ".med": "h5py",
    ".xdmf": "h5py",
    ".xmf": "h5py",
    ".h5m": "h5py",
    ".meshb": "",
    ".su2": "",
    ".avs": "",
    ".vol": "",
    ".xml": "",
    ".tec": "",
    ".wkt": "",
    ".post": "",
    ".dato": "",
}
# Extensions of the trade that are not read, and what to save instead.
_ELSEWHERE = (
    (
        (".ugrid", ".f3grid", ".unv", ".node", ".ele", ".hmf", ".neu", ".h5"),
        "save it as .msh, .vtu, .inp, .bdf or .med",
    ),
    (
        (".step", ".stp", ".iges", ".igs", ".brep", ".sat", ".x_t"),
        "it holds no mesh: mesh it (gmsh -2) and save it as .msh",
    ),
    ((".pvtu", ".pvtp", ".vtm", ".pvd", ".vtkhdf", ".case"), "open it in ParaView and save one .vtu or .vtp"),
    ((".dwg", ".skp"), "save it as .dxf, with 3DFACE or polyface meshes"),
    ((".blend", ".fbx", ".dae", ".3ds", ".glb", ".gltf", ".x3d", ".wrl", ".3mf", ".amf"), "save it as .obj or .stl"),
    ((".dat", ".txt", ".blk"), "name it .bdf (NASTRAN), .inp (Abaqus) or .k (LS-DYNA)"),
    ((".svg", ".pdf"), "it is a drawing in a plane and no mesh"),
)
_LONGEST_SAID = 500  # characters of another library's complaints that are repeated
EXTRA = "pip install 'taichi-membrane[mesh]'"


def read_parts(path: Path) -> MeshParts:
    """Read a mesh file; see :func:`taichi_membrane.mesh.read_mesh`.

    :raises InputError: for whatever reason the file cannot be read.
    """
    kind = kind_of_path(path)
    if kind != "file":
        fault = "there is no such mesh file" if kind == "missing" else f"a mesh file is needed, this is a {kind}"
        raise InputError(f"{path}: {fault}")
    reader = _reader(path)
    size = path.stat().st_size
    short = bounds.shortage(size)
    if short is not None:
        raise InputError(f"{path}: a mesh file of {size} bytes {short}")

    def read() -> MeshParts:
        source = Source.of(path)
        return assemble(source, reader(source))

    return _bounded(path, size, read)


def _reader(path: Path) -> Callable[[Source], RawMesh]:
    """What reads a file, told from its extension."""
    suffix = path.suffix.lower()
    if suffix == ".msh" and _begins(path, b"("):
        return _with_meshio  # Fluent's format of the same extension
    if suffix in READERS:
        module = READERS[suffix]
        if module in _PACKAGES:
            _need(path, _PACKAGES[module])
        read: Callable[[Source], RawMesh] = import_module(f"taichi_membrane.mesh.formats.{module}").read
        return read
    if suffix not in MESHIO:
        known = ", ".join(sorted({*READERS, *MESHIO}))
        remedy = next((words for suffixes, words in _ELSEWHERE if suffix in suffixes), "")
        if remedy:
            raise InputError(f"{path}: the file extension '{path.suffix}' is not one that is read: {remedy}")
        raise InputError(f"{path}: the file extension '{path.suffix}' is unknown; allowed: {known}")
    if MESHIO[suffix]:
        _need(path, MESHIO[suffix])
    return _with_meshio


def _begins(path: Path, mark: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(mark)) == mark


def _need(path: Path, package: str) -> None:
    if find_spec(package) is None:
        raise InputError(
            f"{path}: reading '{path.suffix}' needs the package {package}, which is not installed: {EXTRA}"
        )


def _with_meshio(source: Source) -> RawMesh:
    import meshio  # here, not above: it takes a quarter of a second that most runs do not need

    from taichi_membrane.mesh.formats.objects import from_meshio

    said = io.StringIO()
    try:
        # meshio prints its complaints and may end the process with SystemExit.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh: Any = meshio.read(source.path)
    except (MemoryError, InputError):
        raise
    except (Exception, SystemExit) as error:
        told = f"{type(error).__name__}: {error}" if isinstance(error, Exception) else ""
        reason = " ".join(f"{said.getvalue()} {told}".split())
        raise InputError(f"{source.shown}: the mesh cannot be read by meshio: {reason}") from None
    raw = from_meshio(mesh, source.shown)
    complaints = " ".join(said.getvalue().split())
    if complaints:
        raw.notes.append(f"meshio says: {complaints[:_LONGEST_SAID]}{'…' if len(complaints) > _LONGEST_SAID else ''}")
    return raw


def _bounded(path: Path, size: int, work: Callable[[], MeshParts]) -> MeshParts:
    """Do the work within bounds of time and memory; turn any failure into one message."""
    seconds = _PATIENCE + _SECONDS_PER_BYTE * size
    try:
        with (
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            bounds.at_most(_ROOM + _GROWTH * size),
            bounds.at_most_seconds(seconds),
        ):
            warnings.simplefilter("ignore")  # what is odd and matters is found by the readers and the checks
            return work()
    except InputError:
        raise
    except bounds.TooLong:
        raise InputError(
            f"{path}: the mesh cannot be read: its {size} bytes took more than {seconds:.3g} s; "
            "some readers never end on a damaged file"
        ) from None
    except MemoryError:
        raise InputError(
            f"{path}: the mesh cannot be read: its {size} bytes claim more than {(_ROOM + _GROWTH * size) / 1e9:.3g} GB of data"
        ) from None
    except Exception as error:  # a fault of a reader is the file's refusal to its user, not a traceback
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: the mesh cannot be read, the file may be damaged: {reason}") from None
