"""Reads a finished or interrupted run back from its folder.

``summary.json`` carries a format version, a checksum of itself and those of ``mesh.vtu`` and of each load step's file. Only what
agrees with them is used.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from taichi_membrane import fields as tables
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.wall_search import Touched
from taichi_membrane.mesh import Mesh, placed, with_added_nodes
from taichi_membrane.mesh.check import frozen
from taichi_membrane.names import Outcome
from taichi_membrane.output.accuracy import adaption_of, cascade_of, estimate_of, layer_of
from taichi_membrane.scene import Scene
from taichi_membrane.scene.messages import mistakes
from taichi_membrane.simulation.accuracy import Adaption, Cascade, Estimate, Layer
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.policy import Passage
from taichi_membrane.simulation.results import Floats, ModeResult, Settings, StepResult
from taichi_membrane.simulation.state import PathState, State

FORMAT, FORMAT_VERSION = "taichi_membrane run", 9
SUMMARY, MESH = "summary.json", "mesh.vtu"
CABLE = "cable"  # array of the lines of mesh.vtu and of the steps' files: number of the cable in the scene
GROUP = "group:"  # begins the name of a 0/1 array in mesh.vtu that marks a group's members
DATA = "data:"  # begins the name of an array in mesh.vtu that the scene takes values of elements from
PATH = "path_"  # begins the names of what a stage by arc length goes on from
PATH_ARRAYS = ("path_tangent", "path_advance")
WALL_ARRAYS = ("wall_partner_", "wall_push_")  # with the number of a side, what a node touches of other walls
FRICTION = "friction_"  # with a number, the friction forces of an obstacle that a run goes on from
MODE = "mode_"  # begins the name of a mode shape in a step's file


@dataclass(frozen=True, kw_only=True)
class SavedRun:
    """A run as far as it came, to the last bit.

    :param mesh: in the rest shape, of a run that found it with ``given`` as it was before.
    :param steps: whole load steps; ``records`` is what the summary has of each.
    :param seconds: time spent in each phase so far.
    :param complete: all is done, the last summary included; nothing is left to do. ``outcome`` then tells how it ended.
    :param layers: boundary layers, of a run that has ended, and ``estimate`` errors, where they were asked for.
    :param adaption: what the mesh was refined for, where it was.
    :param own_probes: names of its probes beside the scene's.
    :param mesh_checksum: SHA-256 of mesh.vtu.
    :param files: what the run wrote, in order.
    """

    directory: Path
    scene: Scene
    mesh: Mesh
    given: Mesh
    steps: tuple[StepResult, ...]
    settings: Settings
    own_probes: tuple[str, ...]
    provenance: dict[str, Any]
    seconds: dict[str, float]
    complete: bool
    outcome: Outcome
    layers: tuple[Layer, ...]
    estimate: Estimate | None
    adaption: Adaption | None
    cascade: Cascade | None
    records: tuple[dict[str, Any], ...]
    mesh_checksum: str
    files: tuple[Path, ...]


def read_run(directory: Path) -> SavedRun:
    """A run with its load steps, as far as it came.

    :raises InputError: the folder is not a run of this program, or a file of it is missing or damaged.
    """
    summary = _summary(directory)
    scene = _scene(directory, summary)
    with _damage_told(directory):
        mesh_checksum = str(summary["mesh"]["sha256"])
        records = tuple(dict(record) for record in summary["steps"])
        mended, notes = (tuple(map(str, summary["mesh"][key])) for key in ("mended", "notes"))
        given = replace(_mesh(scene, directory / MESH, mesh_checksum), mended=mended, notes=notes)
        mesh = _rest(scene, directory, given, records)
        cable_count, held = len(line_elements(scene, mesh)[0]), tables.of(scene.extra_fields)
        return SavedRun(
            directory=directory,
            scene=scene,
            mesh=mesh,
            given=given,
            steps=tuple(_step(directory, mesh, cable_count, scene.samples, held, record) for record in records),
            settings=_settings(**summary["settings"]),
            own_probes=tuple(map(str, summary["own_probes"])),
            provenance=dict(summary["provenance"]),
            seconds=_numbers(summary["seconds"]),
            complete=bool(summary["complete"]),
            outcome=summary.get("outcome", "interrupted"),
            layers=tuple(map(layer_of, summary.get("layers", ()))),
            estimate=estimate_of(summary.get("estimate")),
            adaption=adaption_of(summary.get("adaption")),
            cascade=cascade_of(summary.get("cascade")),
            records=records,
            mesh_checksum=mesh_checksum,
            files=tuple(directory / Path(name).name for name in summary["files"]),
        )


def read_scene(directory: Path) -> Scene:
    """The scene of a run, overrides included.

    :raises InputError: the folder is not a run of this program, or its summary is damaged.
    """
    return _scene(directory, _summary(directory))


def is_complete(directory: Path) -> bool:
    """True when the run in a folder has ended and nothing of it is left to do.

    :raises InputError: the folder is not a run of this program, or its summary is damaged.
    """
    return bool(_summary(directory).get("complete"))


def is_run(directory: Path) -> bool:
    """True when the folder holds the summary of a run of this program."""
    try:
        content = json.loads((directory / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT


def _summary(directory: Path) -> dict[str, Any]:
    path = directory / SUMMARY
    if not directory.is_dir():
        raise InputError(f"{directory}: there is no such folder")
    if not path.is_file():
        raise InputError(f"{directory}: not the folder of a run: it has no {SUMMARY}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        checksum = content.pop("sha256", None) if isinstance(content, dict) else None
        agrees = checksum == summary_checksum(content)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged, not valid JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not the summary of a run of this program")
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        raise InputError(f"{path}: format version {version!r}, but this program reads version {FORMAT_VERSION}")
    if not agrees:
        raise InputError(f"{path}: damaged or changed: its checksum is not that of its content")
    return content


def summary_checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of a summary's content, apart from the checksum itself."""
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def file_checksum(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def _damage_told(directory: Path) -> Iterator[None]:
    """Tell what a summary lacks, or has of the wrong kind."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{directory / SUMMARY}: damaged: {type(error).__name__}: {error}") from error


def _settings(arch: Any, precision: Any, threads: Any, render: Any, estimate: Any = "", cascade: Any = 0) -> Settings:
    """What the run was asked for; the names are checked where Taichi is started."""
    count = None if threads is None else int(threads)
    return Settings(
        arch=arch, precision=precision, threads=count, render=bool(render), estimate=estimate, cascade=int(cascade)
    )


def _scene(directory: Path, summary: dict[str, Any]) -> Scene:
    data = summary.get("scene")
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{directory / SUMMARY}: damaged scene: {mistakes(error, data, Scene)}") from None


def _mesh(scene: Scene, path: Path, checksum: str) -> Mesh:
    content = _read_vtu(path, checksum)
    cells = {name: blocks[0] for name, blocks in content.cell_data.items()}
    kind = "triangle" if scene.order == 1 else "triangle6"
    found = content.cells_dict.get(kind)
    if found is None:
        raise InputError(f"{path}: damaged: no {kind} cells")
    triangles = found[:, :3]
    warp = cells.get("warp")
    count = int(found.max()) + 1  # nodes that only cables use come after those of triangles
    groups = _groups(content.point_data)
    mesh = Mesh.build(
        content.points[:count],
        triangles,
        {name: members for name, members in groups.items() if (members < count).all()},
        _groups(cells),
        warp,
        where=str(path),
        open_seams=True,  # the scene said what becomes of them when the run began
        tri_middle=None if scene.order == 1 else found[:, [4, 5, 3]],
        tri_fields={unquote(name.removeprefix(DATA)): held for name, held in cells.items() if name.startswith(DATA)},
    )
    if count < len(content.points):
        added = {name: members for name, members in groups.items() if name not in mesh.node_groups}
        mesh = with_added_nodes(mesh, content.points[count:], added)
        # In the order they had, which the run's next files have as well.
        mesh = replace(mesh, node_groups={name: mesh.node_groups[name] for name in ("all", *groups)})
    lines = content.cells_dict.get("line")
    if lines is not None:
        mesh = _with_lines(scene, mesh, lines, content.cell_data[CABLE][1])
    # They were unit vectors in the elements' planes already; made so once more, they would differ in the last bit.
    return mesh if warp is None else replace(mesh, tri_warp=frozen(np.asarray(warp, dtype=np.float64)))


def _rest(scene: Scene, directory: Path, given: Mesh, records: tuple[dict[str, Any], ...]) -> Mesh:
    """The mesh in the shape that displacements are counted from: the one found, where the run found one."""
    if not (scene.forms and records):
        return given
    path = directory / Path(str(records[0]["file"])).name
    points = np.asarray(_read_vtu(path, records[0]["sha256"]).points, dtype=np.float64)
    if points.shape != given.points.shape:
        raise InputError(f"{path}: damaged: {len(points)} points, but {len(given.points)} are expected")
    return placed(given, points)


def _with_lines(scene: Scene, mesh: Mesh, lines: NDArray[Any], owner: NDArray[Any]) -> Mesh:
    """The mesh with the lines that cables run along, in the groups that they name."""
    groups = {
        cable.lines: frozen(np.flatnonzero(owner == number).astype(np.int32))
        for number, cable in enumerate(scene.cables.values())
        if cable.lines is not None
    }
    return replace(mesh, lines=frozen(np.asarray(lines, dtype=np.int32)), line_groups=groups) if groups else mesh


def _groups(arrays: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    named = {unquote(name.removeprefix(GROUP)): mark for name, mark in arrays.items() if name.startswith(GROUP)}
    return {name: np.flatnonzero(mark) for name, mark in named.items() if name != "all"}


def _step(
    directory: Path, mesh: Mesh, cable_count: int, samples: int, held: list[tables.Field], record: dict[str, Any]
) -> StepResult:
    name = str(record["file"])
    # The name comes from a file that anybody may have edited: it must not lead out of the folder.
    path = directory / Path(name).name
    content = _read_vtu(path, record["sha256"])
    points = content.point_data
    cells, lines = (
        {name: blocks[k] for name, blocks in content.cell_data.items() if len(blocks) > k} for k in range(2)
    )
    if not cable_count:
        lines = {one: np.zeros(0) for field in tables.FIELDS if field.place == "cable" for one in field.arrays}

    def per_node(name: str) -> Floats:
        shape = (mesh.node_count,) if name.startswith(WALL_ARRAYS) else (mesh.node_count, 3)
        return _array(path, points, name, shape)

    fields: dict[str, NDArray[Any]] = {}
    for field in held:
        arrays = {"node": points, "element": cells, "cable": lines}[field.place]
        shape = field.shape(mesh.node_count, mesh.tri_count, cable_count, samples)
        parts = [_array(path, arrays, one, shape[:1] if field.split else shape) for one in field.arrays]
        fields[field.name] = (np.stack(parts, axis=1) if field.split else parts[0]).astype(field.dtype)
    return StepResult(
        number=int(record["number"]),
        stage=str(record["stage"]),
        stage_step=int(record["stage_step"]),
        drivers=_numbers(record["drivers"]),
        fields=fields,
        probes=_numbers(record["probes"]),
        volume=_number(record["volume"]),
        energy=None if record["energy"] is None else float(record["energy"]),
        solver=str(record["solver"]),
        converged=bool(record["converged"]),
        reason=str(record["reason"]),
        iterations=int(record["iterations"]),
        residual=_number(record["residual"]),
        cuts=int(record["cuts"]),
        negative_pivots=None if record["negative_pivots"] is None else int(record["negative_pivots"]),
        derivatives={name: _numbers(values) for name, values in record["derivatives"].items()},
        modes=None if record["modes"] is None else _modes(record["modes"], per_node),
        limit=None if record["limit"] is None else {key: (low, high) for key, (low, high) in record["limit"].items()},
        seconds=_number(record["seconds"]),
        trace=tuple(Passage(event=event, share=float(share)) for event, share in record["trace"]),
        unknown={str(name): str(why) for name, why in record["unknown"].items()},
        state=_state(record, fields["displacement"], per_node),
        contact_forces=_numbers(record["contact_forces"]),
        relieved=_numbers(record["relieved"]),
        balance={name: (_number(x), _number(y), _number(z)) for name, (x, y, z) in record["balance"].items()},
        imbalance=_number(record["imbalance"]),
        walls={str(name): int(count) for name, count in record["walls"].items()},
    )


def _modes(record: dict[str, Any], shape: Callable[[str], Floats]) -> ModeResult:
    """Modes from their record and the arrays of the step's file."""
    shapes = [shape(f"{MODE}{number}") for number in range(1, len(record["values"]) + 1)]
    values = tuple(map(_number, record["values"]))
    return ModeResult(
        kind=record["kind"],
        values=values,
        shapes=np.stack(shapes) if shapes else np.zeros((0, 0, 3)),
        missing=str(record.get("missing", "")),
    )


def _state(record: dict[str, Any], displacement: Floats, per_node: Callable[[str], Floats]) -> State:
    """What a load step hands on."""
    given = record["state"]
    path = None
    if given["path"] is not None:
        tangent, advance = map(per_node, PATH_ARRAYS)
        scalars = given["path"]
        path = PathState(
            factor=float(scalars["factor"]), tangent=tangent, advance=advance, negative=int(scalars["negative"]),
            length=float(scalars["length"]),
        )  # fmt: skip
    return State(
        displacement=displacement,
        drivers=_numbers(record["drivers"]),
        stiffest=float(given["stiffest"]),
        let_out=_numbers(given["let_out"]),
        path=path,
        touched=_touched(per_node) if given["walls"] else None,
        friction=tuple(per_node(f"{FRICTION}{number}") for number in range(int(given["friction"]))),
    )


def _touched(per_node: Callable[[str], Floats]) -> Touched:
    """What walls touch of each other."""
    partner, push = (np.stack([per_node(f"{name}{side}") for side in range(2)], axis=1) for name in WALL_ARRAYS)
    return Touched(partner=partner.astype(np.int64), push=push)


def _number(value: Any) -> float:
    """A number of the summary, where null stands for one that was not finite."""
    return math.nan if value is None else float(value)


def _numbers(values: dict[str, Any]) -> dict[str, float]:
    return {name: _number(value) for name, value in values.items()}


def _array(path: Path, arrays: dict[str, NDArray[Any]], name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    if name not in arrays:
        raise InputError(f"{path}: damaged: no array {name!r}")
    array = np.asarray(arrays[name], dtype=np.float64)
    if array.shape != shape:
        raise InputError(f"{path}: damaged: array {name!r} is {array.shape}, but {shape} is expected")
    return array


def _read_vtu(path: Path, checksum: str) -> Any:
    import meshio  # here, not above: it takes a quarter of a second that other commands do not need

    if not path.is_file():
        raise InputError(f"{path}: this file of the run is missing")
    if file_checksum(path) != checksum:
        raise InputError(f"{path}: damaged or changed: its checksum is not the one in {SUMMARY}")
    said = io.StringIO()
    try:
        # meshio prints its complaints and may end the process with SystemExit.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        told = f"{type(error).__name__}: {error}" if isinstance(error, Exception) else ""
        raise InputError(f"{path}: damaged: {' '.join(f'{said.getvalue()} {told}'.split())}") from None
