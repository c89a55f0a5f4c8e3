"""What a sweep runs: its trials, each with settings of its own, validated before anything runs."""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision
from taichi_membrane.parametric.scatter import Design, Scatter, draw, parse_scatter
from taichi_membrane.scene import MeshFile, Scene
from taichi_membrane.scene.file import read_data, resolve_scene, with_overrides
from taichi_membrane.scene.messages import not_one_of
from taichi_membrane.study.plan import parse_axis

VERSIONED = ("taichi-membrane", "taichi", "numpy", "scipy")  # whose versions decide the bits of a result
_SHOWN_ONLY = {"title", "description", "checks", "camera"}  # parts of a scene that change no number of a row
_RANGE = re.compile(r"([^:,]+):([^:,]+):(\d+)")
_TIE = re.compile(r"([^=]+)=(?:([^*=]+)\*)?([^*=]+)")
_MOST = 1_000_000  # trials; a plan is held in memory


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """How every trial is run; ``threads`` for Taichi and BLAS alike."""

    arch: Arch = "cpu"
    precision: Precision = "f64"
    threads: int = 1


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of a sweep.

    :param number: from 1, in the order of the plan.
    :param settings: key and value, as written, of what differs between trials, followers included.
    :param tri_count: number of triangles of its mesh.
    :param fingerprint: changes with whatever may change a number: scene, mesh file, conditions, versions.
    """

    number: int
    settings: Mapping[str, str]
    scene: Scene
    tri_count: int
    fingerprint: str

    @property
    def label(self) -> str:
        """Its settings in a line."""
        return " ".join(f"{key}={value}" for key, value in self.settings.items()) or "as it is"


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """A sweep that can be run.

    :param source: scene file, or name of the scene where it is an object.
    :param base: folder that a relative mesh path starts from.
    :param scatters: the distributions that were drawn from; ``design`` how.
    :param repeats: how often the drawn points are repeated, once for each point of the grid.
    """

    source: str
    base: Path
    trials: tuple[Trial, ...]
    conditions: Conditions
    fixed: tuple[str, ...]
    scatters: tuple[Scatter, ...] = ()
    design: Design | None = None
    seed: int = 0
    repeats: int = 1

    @property
    def scene(self) -> Scene:
        """The scene of the first trial: names and units are those of all."""
        return self.trials[0].scene

    @property
    def inputs(self) -> tuple[str, ...]:
        """The keys that differ between trials."""
        return tuple(self.trials[0].settings)

    @cached_property
    def digest(self) -> str:
        """Short name of the scene that is varied, whatever is varied in it."""
        return _digest([self.scene.name, self.scene.units.model_dump(), list(self.scene.probes)])


def build_sweep(
    scene: Scene | Path | str,
    *,
    vary: Sequence[str] = (),
    sample: Sequence[str] = (),
    table: Path | None = None,
    tie: Sequence[str] = (),
    fixed: Sequence[str] = (),
    runs: int = 100,
    seed: int = 0,
    design: Design = "latin",
    base: Path | None = None,
    conditions: Conditions | None = None,
) -> SweepPlan:
    """Expand grid, sample or table and validate every trial as a scene, and each mesh with its first trial; run nothing.

    :param vary: ``KEY=V1,V2,…``, ``KEY=FIRST:LAST:COUNT`` (evenly spaced) or ``KEY+KEY=V1:W1,V2:W2``; the last varies fastest.
    :param sample: as :func:`parse_scatter` reads them; every point of the grid gets all drawn points.
    :param table: CSV file with keys as heads and a trial in every row.
    :param tie: ``KEY=OTHER`` or ``KEY=FACTOR*OTHER``: KEY follows OTHER, which is varied or drawn.
    :param fixed: ``KEY=VALUE`` for all trials.
    :raises InputError: what some trial cannot be: a key, value or mesh; a key given twice; nothing to vary.
    """
    conditions = conditions or Conditions()
    source, data, base = _origin(scene, base)
    scatters = tuple(map(parse_scatter, sample))
    if table is not None and (vary or sample):
        raise InputError(f"--table {table}: a table is the whole plan; leave out --vary and --sample")
    if table is not None:
        points, repeats = _table(table), 1
    else:
        grid = _grid(vary)
        drawn = [
            dict(zip((s.key for s in scatters), map(repr, p), strict=True))
            for p in _drawn(scatters, design, runs, seed)
        ]
        _once([*(grid[0] if grid else ()), *(s.key for s in scatters)])
        points = [{**at, **point} for at, point in itertools.product(grid, drawn)]
        repeats = len(grid)
    points = [_tied(point, tie) for point in points]
    if not points or not points[0]:
        raise InputError("nothing to vary: give --vary, --sample or --table")
    if len(points) > _MOST:
        raise InputError(f"{len(points)} runs; at most {_MOST} are allowed")
    _once([*points[0], *(text.partition("=")[0].strip() for text in fixed)])
    trials = tuple(_trials(source, data, base, points, fixed, conditions))
    return SweepPlan(
        source=source, base=base, trials=trials, conditions=conditions, fixed=tuple(fixed), scatters=scatters,
        design=design if scatters else None, seed=seed, repeats=repeats,
    )  # fmt: skip


def _origin(scene: Scene | Path | str, base: Path | None) -> tuple[str, dict[str, Any], Path]:
    """Name, tables and mesh folder of a scene object, file or shipped scene."""
    if isinstance(scene, Scene):
        return scene.name, scene.model_dump(mode="json"), base or Path()
    path = resolve_scene(scene) if isinstance(scene, str) else scene
    return str(path), read_data(path), base or path.parent


def _grid(vary: Sequence[str]) -> list[dict[str, str]]:
    axes = [parse_axis(_spaced(text)) for text in vary]
    _once([key for axis in axes for key in axis.keys])
    return [
        dict(pair for axis, point in zip(axes, points, strict=True) for pair in zip(axis.keys, point, strict=True))
        for points in itertools.product(*(axis.points for axis in axes))
    ]


def _spaced(text: str) -> str:
    """``KEY=FIRST:LAST:COUNT`` written out, anything else as it is."""
    key, _, right = text.partition("=")
    form = _RANGE.fullmatch(right.strip())
    if form is None or "+" in key:
        return text
    try:
        first, last, count = float(form[1]), float(form[2]), int(form[3])
    except ValueError:
        return text
    if count > _MOST:
        raise InputError(f"--vary {text!r}: {count} values; at most {_MOST} are allowed")
    if count < 2 or first == last:
        raise InputError(f"--vary {text!r}: expected FIRST:LAST:COUNT with different ends and 2 values at least")
    # 12 digits: what is meant is 0.03, not 0.030000000000000002.
    return f"{key}={','.join(repr(float(f'{value:.12g}')) for value in np.linspace(first, last, count))}"


def _drawn(scatters: Sequence[Scatter], design: Design, runs: int, seed: int) -> list[tuple[float, ...]]:
    _once([scatter.key for scatter in scatters])
    return draw(scatters, design, runs, seed) if scatters else [()]


def _table(path: Path) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: the table cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(rows) < 2:
        raise InputError(f"{path}: a table has a line of keys and a line for each run; this one has {len(rows)} lines")
    keys = [key.strip() for key in rows[0]]
    _once(keys)
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(keys) or not all(cell.strip() for cell in row):
            found = sum(bool(cell.strip()) for cell in row)
            raise InputError(f"{path}: line {number} has {found} values for {len(keys)} keys")
    return [dict(zip(keys, (cell.strip() for cell in row), strict=True)) for row in rows[1:]]


def _tied(point: dict[str, str], ties: Sequence[str]) -> dict[str, str]:
    """The point with its followers."""
    point = dict(point)
    for text in ties:
        form = _TIE.fullmatch(text)
        if form is None:
            raise InputError(f"--tie {text!r}: expected KEY=OTHER or KEY=FACTOR*OTHER")
        key, factor, other = (part and part.strip() for part in form.groups())
        if other not in point:
            raise InputError(f"--tie {text!r}: {other!r} is not varied; {not_one_of(other, list(point))}")
        if key in point:
            raise InputError(f"--tie {text!r}: {key!r} has values of its own")
        try:
            point[key] = point[other] if factor is None else repr(float(factor) * float(point[other]))
        except ValueError:
            raise InputError(f"--tie {text!r}: {factor} × {point[other]} is no product of numbers") from None
    return point


def _once(keys: Sequence[str]) -> None:
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"{key}: given {keys.count(key)} times; once is enough")


def _trials(
    source: str,
    data: dict[str, Any],
    base: Path,
    points: Sequence[dict[str, str]],
    fixed: Sequence[str],
    how: Conditions,
) -> Iterator[Trial]:
    from taichi_membrane.execution.run import summarise

    tri_counts: dict[str, int] = {}
    files: dict[str, str] = {}
    versions = [f"{name} {metadata.version(name)}" for name in VERSIONED]
    for number, point in enumerate(points, 1):
        overrides = [*fixed, *(f"{key}={value}" for key, value in point.items())]
        scene = with_overrides(source, data, overrides)
        if not isinstance(scene.mesh, MeshFile) and scene.mesh.shape == "given":
            raise InputError(f"{source}: a sweep sends its meshes to other processes; save the mesh and name its file")
        key = scene.mesh.model_dump_json()
        if key not in tri_counts:
            try:
                tri_counts[key] = summarise(scene, base)[0].structure.mesh.tri_count
            except InputError as error:
                raise InputError(f"{source} with {' '.join(overrides)}: {error}") from error
        path = scene.mesh.path if isinstance(scene.mesh, MeshFile) else ""
        if path not in files:
            files[path] = hashlib.sha256((base / path).read_bytes()).hexdigest() if path else ""
        content = [scene.model_dump(mode="json", exclude=_SHOWN_ONLY), files[path], vars(how), versions]
        yield Trial(number=number, settings=point, scene=scene, tri_count=tri_counts[key], fingerprint=_digest(content))


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
