"""Files of a run: steps for ParaView, a table, a summary; each is in place whole or not at all. How to read them back is in
:mod:`taichi_membrane.output.reader`.

``mesh.vtu`` holds the mesh as it was given with its groups, ``step_NNNN.vtu`` the rest shape with the state after each load step,
``steps.pvd`` their order, ``history.csv`` a row per load step, ``summary.json`` everything that is not an array. All are up to
date after every load step, the summary last: what it lists is whole, and a run that is interrupted goes on from there.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import fields
from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.output.accuracy import adaption_record, estimate_record, layer_record
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.case_tables import case_records, write_cases
from taichi_membrane.output.lock import LOCK
from taichi_membrane.output.reader import (
    CABLE,
    DATA,
    FORMAT,
    FORMAT_VERSION,
    FRICTION,
    GROUP,
    MESH,
    MODE,
    PATH,
    PATH_ARRAYS,
    SUMMARY,
    WALL_ARRAYS,
    SavedRun,
    is_run,
    summary_checksum,
)
from taichi_membrane.output.records import field_notes, record
from taichi_membrane.output.tables import stability_text
from taichi_membrane.output.vtu import write_vtu
from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import driver_names, driver_unit
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.accuracy import Adaption
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.policy import told
from taichi_membrane.simulation.results import RunResult, Settings, StepResult
from taichi_membrane.simulation.utilisation import largest

HISTORY, SERIES = "history.csv", "steps.pvd"

_OURS = (
    r"(step_\d{4,}\.(vtu|png)|mesh\.vtu|steps\.pvd|history\.csv|cases\.csv|envelope\.(vtu|png)|curve\.png|animation\.gif|"
    r"report\.html)"
)
_TEMPORARY = rf"\.({_OURS}|summary\.json)\.\d+\.tmp"

Column = tuple[str, Callable[[StepResult], object]]


def step_path(directory: Path, number: int) -> Path:
    """File of a load step's arrays."""
    return directory / f"step_{number:04d}.vtu"


class Writer:
    """Writes one run's files while the load steps end.

    :param directory: made when missing; what an earlier run left in it is removed.
    :param settings: what was asked for, and ``provenance`` what really ran; both go into the summary.
    :param tri_fabric: (tri_count,) fabric number of each element.
    :param mesh: as it was given, before form finding.
    :param saved: the run in ``directory`` to go on with.
    :param own_probes: names of probes beside the scene's.
    :param adaption: what the mesh was refined for.
    :raises InputError: the folder cannot be made or written, or holds files but no run of this program.
    """

    def __init__(
        self,
        directory: Path,
        scene: Scene,
        mesh: Mesh,
        *,
        settings: Settings,
        provenance: Mapping[str, Any],
        tri_fabric: NDArray[np.int32],
        saved: SavedRun | None = None,
        own_probes: Collection[str] = (),
        adaption: Adaption | None = None,
    ) -> None:
        self.directory = directory
        self._adaption = adaption
        self._scene, self._mesh, self._tri_fabric = scene, mesh, tri_fabric
        self._lines, self._cable = line_elements(scene, mesh)
        self._settings, self._provenance = settings, dict(provenance)
        self._own_probes = tuple(own_probes)
        self._columns = _columns(scene, self._own_probes)
        self._rows: list[list[object]] = []
        self._records: list[dict[str, Any]] = []
        self._noted: list[Path] = []
        self._mesh_checksum = ""
        if saved is None:
            _make_directory(directory)
            with replacing(directory / MESH) as temporary:
                self._mesh_checksum = self._write_mesh(temporary)
                self._write_summary({}, complete=False)  # first of all: from here on the folder is known to be a run
        else:
            self._mesh_checksum = saved.mesh_checksum
            self._records += saved.records
            self._rows += [self._row(step) for step in saved.steps]
            self._write_summary(saved.seconds, complete=False)
        self._write_tables()
        _remove_stale(directory, {path.name for path in self._files()})

    def write_step(self, step: StepResult, seconds: Mapping[str, float], rest: Mesh | None = None) -> list[Path]:
        """Write the files of one more load step.

        :param rest: the mesh in the shape that displacements are counted from; as it was given when None.
        :param seconds: time spent in each phase so far.
        :return: the step's own file, then those brought up to date.
        """
        path = step_path(self.directory, step.number)
        with replacing(path) as temporary:
            checksum = self._write_arrays(temporary, step, rest or self._mesh)
        self._records.append(record(step, path.name, checksum) | self._utilised(step, rest or self._mesh))
        self._rows.append(self._row(step))
        return [path, *self._write_tables(), self._write_summary(seconds, complete=False)]

    def note(self, path: Path) -> None:
        """Add a file that somebody else wrote to the list of the run's files."""
        self._noted.append(path)

    def finish(self, result: RunResult) -> list[Path]:
        """Write the last summary, and any load step whose writing was interrupted; returns all files of the run in order."""
        for step in result.steps[len(self._records) :]:
            self.write_step(step, result.seconds, result.mesh)
        self._write_tables()
        verdict = {
            "outcome": result.outcome,
            "converged": result.converged,
            "passed": result.passed,
            "checks": [asdict(check) for check in result.checks],
            "layers": [layer_record(layer) for layer in result.layers],
            "estimate": estimate_record(result.estimate),
            **({} if result.cascade is None else {"cascade": asdict(result.cascade)}),
        }
        self._adaption = result.adaption
        if result.scene.cases:
            verdict |= case_records(result)
            for path in write_cases(result, self.directory):
                self.note(path)
        self._write_summary(result.seconds, complete=result.outcome != "interrupted", verdict=verdict)
        return self._files()

    def _files(self) -> list[Path]:
        tables = [self.directory / name for name in (SUMMARY, HISTORY, SERIES, MESH)]
        return [*tables, *(self.directory / saved["file"] for saved in self._records), *self._noted]

    def _row(self, step: StepResult) -> list[object]:
        return [value(step) for _, value in self._columns]

    def _write_mesh(self, path: Path) -> str:
        mesh = self._mesh
        cells: dict[str, NDArray[Any]] = {"fabric": self._tri_fabric}
        if mesh.tri_warp is not None:
            cells["warp"] = mesh.tri_warp
        cells |= {DATA + quote(name): values for name, values in mesh.tri_fields.items()}
        marks = _group_marks(mesh.tri_groups, mesh.tri_count)
        return write_vtu(
            path,
            mesh,
            self._lines,
            _group_marks(mesh.node_groups, mesh.node_count),
            cells | marks,
            {CABLE: self._cable} | {name: np.zeros(len(self._lines), dtype=np.int8) for name in marks},
        )

    def _write_arrays(self, path: Path, step: StepResult, rest: Mesh) -> str:
        """Points are at rest and the displacement a vector, so that ParaView's Warp By Vector gives the deformed shape."""
        places: dict[str, dict[str, NDArray[Any]]] = {"node": {}, "element": {}, "cable": {CABLE: self._cable}}
        for field in fields.of(step.fields.keys()):
            values = step.fields[field.name]
            places[field.place] |= zip(field.arrays, values.T if field.split else [values], strict=True)
        points, cells = places["node"], places["element"]
        cells["fabric"] = self._tri_fabric
        if step.state.path is not None:
            points |= {name: getattr(step.state.path, name.removeprefix(PATH)) for name in PATH_ARRAYS}
        points |= {f"{FRICTION}{number}": forces for number, forces in enumerate(step.state.friction)}
        if step.state.touched is not None:
            both = zip(WALL_ARRAYS, (step.state.touched.partner, step.state.touched.push), strict=True)
            points |= {f"{name}{side}": values[:, side] for name, values in both for side in range(2)}
        if step.modes is not None:
            points |= {f"{MODE}{number}": shape for number, shape in enumerate(step.modes.shapes, 1)}
        return write_vtu(path, rest, self._lines, points, cells, places["cable"])

    def _utilised(self, step: StepResult, rest: Mesh) -> dict[str, Any]:
        """Where a step uses most of a strength, for its record, in scenes that have one."""
        if "utilisation" not in step.fields:
            return {}
        used = largest(self._scene, rest, step)
        return {"utilisation": None if used is None else asdict(used)}

    def _write_tables(self) -> list[Path]:
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow([header for header, _ in self._columns])
        table.writerows(self._rows)
        _write_text(self.directory / HISTORY, text.getvalue())
        root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
        collection = ElementTree.SubElement(root, "Collection")
        for saved in self._records:
            ElementTree.SubElement(
                collection, "DataSet", timestep=str(saved["number"]), group="", part="0", file=saved["file"]
            )
        ElementTree.indent(root)
        declared = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True).decode()
        _write_text(self.directory / SERIES, declared + "\n")
        return [self.directory / HISTORY, self.directory / SERIES]

    def _write_summary(
        self, seconds: Mapping[str, float], *, complete: bool, verdict: Mapping[str, Any] | None = None
    ) -> Path:
        mesh = self._mesh
        content = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "complete": complete,
            **(verdict or {}),
            **({} if self._adaption is None else {"adaption": adaption_record(self._adaption)}),
            "settings": asdict(self._settings),
            "provenance": self._provenance,
            "seconds": dict(seconds),
            "mesh": {
                "sha256": self._mesh_checksum,
                "node_count": mesh.node_count,
                "tri_count": mesh.tri_count,
                "closed": mesh.is_closed,
                "area": float(mesh.tri_areas().sum()),
                "mended": list(mesh.mended),
                "notes": list(mesh.notes),
                "node_groups": {name: len(members) for name, members in mesh.node_groups.items()},
                "tri_groups": {name: len(members) for name, members in mesh.tri_groups.items()},
            },
            "files": [path.name for path in self._files()],
            "fields": field_notes(self._scene, cables=len(self._lines) > 0),
            "probes": {name: probe_unit(self._scene, name) for name in self._scene.probes},
            "own_probes": self._own_probes,
            "steps": self._records,
            "scene": self._scene.model_dump(mode="json"),
        }
        path = self.directory / SUMMARY
        plain = _plain(content)
        sealed = {**plain, "sha256": summary_checksum(plain)}
        _write_text(path, json.dumps(sealed, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
        return path


def _columns(scene: Scene, own_probes: Collection[str]) -> list[Column]:
    """Headers of the history and where their values come from; units in brackets."""
    units = scene.units
    first: list[Column] = [
        ("step", lambda s: s.number),
        ("stage", lambda s: s.stage),
        ("stage_step", lambda s: s.stage_step),
        *((_header(name, driver_unit(scene, name)), _named("drivers", name)) for name in driver_names(scene)),
        (_header("volume", units.volume), lambda s: s.volume),
    ]
    last: list[Column] = [
        ("taut_count", lambda s: s.elements.count()["taut"]),
        ("wrinkled_count", lambda s: s.elements.count()["wrinkled"]),
        ("slack_count", lambda s: s.elements.count()["slack"]),
        ("iterations", lambda s: s.iterations),
        ("residual", lambda s: s.residual),
        (_header("potential_energy", units.energy), lambda s: s.energy),
        ("solver", lambda s: s.solver),
        ("converged", lambda s: s.converged),
        ("reason", lambda s: s.reason),
        ("cuts", lambda s: s.cuts),
        ("negative_pivots", lambda s: s.negative_pivots),
        ("stability", stability_text),
        ("trace", lambda s: told(s.trace)),
        ("seconds", lambda s: s.seconds),
    ]
    taken = {header.partition(" ")[0] for header, _ in [*first, *last]}
    named = {**{name: probe_unit(scene, name) for name in scene.probes}, **dict.fromkeys(own_probes, "")}
    probes: list[Column] = [
        (_header(f"probe.{name}" if name in taken else name, unit), _named("probes", name))
        for name, unit in named.items()
    ]
    return [*first, *probes, *last]


def _named(kind: str, name: str) -> Callable[[StepResult], object]:
    return lambda step: getattr(step, kind)[name]


def _header(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _plain(value: Any) -> Any:
    """The same in what JSON knows; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _group_marks(groups: Mapping[str, NDArray[np.int32]], count: int) -> dict[str, NDArray[Any]]:
    marks = {}
    for name, members in groups.items():
        mark = np.zeros(count, dtype=np.int8)
        mark[members] = 1
        # Groups from mesh files have any name; meshio does not escape what XML reserves.
        marks[GROUP + quote(name)] = mark
    return marks


def check_directory(directory: Path) -> None:
    """Make sure that a run may write here: a folder that is missing, empty, or holds an earlier run.

    :raises InputError: it holds other files and no run, or is no folder.
    """
    try:
        held = [path.name for path in directory.iterdir()] if directory.exists() else []
    except OSError as error:
        raise InputError(f"{directory}: the output folder cannot be read: {error.strerror}") from error
    foreign = sorted(name for name in held if name != LOCK and not re.fullmatch(_TEMPORARY, name))
    if foreign and not is_run(directory):
        raise InputError(
            f"{directory}: the output folder holds {foreign[0]!r} ({len(foreign)} files in all) but no {SUMMARY} of an "
            "earlier run; give an empty or new folder"
        )


def _make_directory(directory: Path) -> None:
    check_directory(directory)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: the output folder cannot be made: {error.strerror}") from error


def _remove_stale(directory: Path, ours_now: set[str]) -> None:
    for path in directory.iterdir():
        if re.fullmatch(f"{_OURS}|{_TEMPORARY}", path.name) and path.name not in ours_now:
            path.unlink()


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
