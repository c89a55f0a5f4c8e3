"""The grid of a study: every combination of the varied settings, validated before anything runs."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import get_args

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import summarise
from taichi_membrane.names import Arch, Precision
from taichi_membrane.scene import MeshFile, Scene
from taichi_membrane.scene.file import load_scene
from taichi_membrane.scene.messages import not_one_of
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.study.references import ReferenceKind, reference_of

RUN_DEFAULTS = {"precision": "f64", "arch": "cpu", "threads": ""}  # settings of a run that are no keys of a scene
# Keys of the mesh that say what elements are, not how many.
_ELEMENT = ("mesh.order", "mesh.points")
# What changes no number of a run: a run need not be repeated when only these change.
_SHOWN_ONLY = {"title", "description", "checks", "curve", "camera"}


@dataclass(frozen=True)
class Axis:
    """Keys that are varied together and the values they take, one tuple per point of the grid."""

    keys: tuple[str, ...]
    points: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One combination of settings.

    :param varied: key and value, as written, of what changes over the study; ``fixed`` of what was set for all of it.
    :param tied: keys that change together with one of the mesh, such as forces that depend on its polygon: they belong to the mesh.
    :param tri_count: number of triangles of its mesh.
    :param stage: stage of the load step that is measured; ``step`` its number in the stage, from 1.
    :param last_done: measure the last step that was done instead where the stage, which may, ends before that one.
    """

    path: Path
    varied: Mapping[str, str]
    tied: frozenset[str]
    fixed: Mapping[str, str]
    scene: Scene
    tri_count: int
    stage: str
    step: int
    last_done: bool = False

    @property
    def settings(self) -> dict[str, str]:
        """All settings, those of the run with their defaults."""
        return {**RUN_DEFAULTS, **self.fixed, **self.varied}

    @property
    def overrides(self) -> list[str]:
        """The settings that are keys of the scene, as ``KEY=VALUE``."""
        return _overrides({**self.fixed, **self.varied})

    @property
    def label(self) -> str:
        """What tells this case from the others."""
        return _label(self._untied) or "as it is"

    @property
    def mesh(self) -> str:
        """The varied settings of the mesh."""
        return _label({key: value for key, value in self.varied.items() if key.startswith("mesh.")})

    @property
    def sequence(self) -> str:
        """The varied settings that change the problem or the pattern of the mesh: cases that differ here have no common limit."""
        return _label({key: value for key, value in self._untied.items() if _opens_sequence(key, value)})

    @property
    def problem(self) -> str:
        """The varied settings that change the problem, whatever the mesh."""
        opens = {key: value for key, value in self._untied.items() if _opens_sequence(key, value)}
        return _label({key: value for key, value in opens.items() if not key.startswith("mesh.")})

    @property
    def method(self) -> str:
        """The varied settings of how the problem is solved: all but mesh and problem."""
        return _label({k: v for k, v in self._untied.items() if not (k.startswith("mesh.") or _opens_sequence(k, v))})

    @property
    def _untied(self) -> dict[str, str]:
        return {key: value for key, value in self.varied.items() if key not in self.tied}

    @property
    def size(self) -> float:
        """Relative mesh size, 1/√N for N triangles."""
        return 1.0 / math.sqrt(self.tri_count)

    @cached_property
    def identity(self) -> str:
        """Short name of the settings: same settings, same name."""
        return _digest(self.settings)

    @cached_property
    def fingerprint(self) -> str:
        """Changes with whatever may change a number: scene, mesh file, settings, versions."""
        mesh = self.scene.mesh
        content = (self.path.parent / mesh.path).read_bytes() if isinstance(mesh, MeshFile) else b""
        versions = [f"{name} {metadata.version(name)}" for name in ("taichi-membrane", "taichi", "numpy", "scipy")]
        scene = self.scene.model_dump(mode="json", exclude=_SHOWN_ONLY)
        return _digest([scene, self.settings, versions, hashlib.sha256(content).hexdigest()])

    def check_reference(self, probe: str) -> float | None:
        """Reference of the scene's check of a probe at the measured load step, if it has one."""
        steps = _step_counts(self.scene)[self.stage]
        for check in self.scene.checks:
            number = check.step if check.step > 0 else steps + 1 + check.step
            if (check.probe, check.stage, number) == (probe, self.stage, self.step):
                return check.reference
        return None


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A study that can be run: its cases, the probes it measures, and what their values are compared with.

    :param reference: a value for each probe, or where it comes from.
    """

    path: Path
    cases: tuple[Case, ...]
    probes: tuple[str, ...]
    reference: ReferenceKind | Mapping[str, float]

    @property
    def varied(self) -> tuple[str, ...]:
        """The keys that change over the study."""
        return tuple(self.cases[0].varied)

    def unit(self, probe: str) -> str:
        """Unit of a probe; empty for a share."""
        return probe_unit(self.cases[0].scene, probe)


def parse_axis(text: str) -> Axis:
    """Read ``KEY=V1,V2`` or, for keys that change together, ``KEY+KEY=V1:W1,V2:W2``.

    Commas and colons inside brackets, braces or quotes belong to the value.

    :raises InputError: not of that form, a value missing or given twice.
    """
    left, sign, right = text.partition("=")
    keys = tuple(key.strip() for key in left.split("+"))
    if not sign or not all(keys):
        raise InputError(f"--vary {text!r}: expected KEY=V1,V2,... or KEY+KEY=V1:W1,V2:W2,...")
    points = tuple(tuple(_split(point, ":")) if len(keys) > 1 else (point,) for point in _split(right, ","))
    for point in points:
        if len(point) != len(keys) or not all(point):
            given = ":".join(point)
            raise InputError(f"--vary {text!r}: {given!r} has {sum(map(bool, point))} values for {len(keys)} keys")
        if points.count(point) > 1:
            raise InputError(f"--vary {text!r}: {':'.join(point)!r} is given {points.count(point)} times")
    return Axis(keys, points)


def build_plan(
    path: Path,
    vary: Sequence[str],
    *,
    fixed: Sequence[str] = (),
    probes: Sequence[str] = (),
    at: str | None = None,
    reference: str = "finest",
) -> Plan:
    """Expand the grid and validate every combination with its mesh; run nothing.

    :param vary: as :func:`parse_axis` reads them; the last varies fastest.
    :param fixed: ``KEY=VALUE`` for all cases.
    :param probes: probes to measure; all when empty.
    :param at: ``STAGE:STEP``, with the step counted from 1 or from the end with -1; the last load step when None.
    :param reference: a number, ``PROBE=VALUE,…``, ``finest``, ``extrapolated`` or ``check``.
    :raises InputError: a key, value, probe, load step or reference that some combination does not have.
    """
    axes = [parse_axis(text) for text in vary]
    constant = dict(map(_parse_fixed, fixed))
    keys = [*constant, *(key for axis in axes for key in axis.keys)]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"{key}: set or varied {keys.count(key)} times; once is enough")
    if not axes:
        raise InputError("--vary: a study needs at least one key to vary")
    tri_counts: dict[str, int] = {}
    tied = frozenset(itertools.chain.from_iterable(map(_tied, axes)))
    cases = tuple(_case(path, varied, tied, constant, at, tri_counts) for varied in _grid(axes))
    chosen = _probes(cases, probes, reference)
    return Plan(path=path, cases=cases, probes=chosen, reference=reference_of(cases, chosen, reference))


def _tied(axis: Axis) -> tuple[str, ...]:
    """The keys of an axis that its mesh decides: none where one mesh comes with different values."""
    of_mesh = [key.startswith("mesh.") for key in axis.keys]
    meshes = {tuple(itertools.compress(point, of_mesh)) for point in axis.points}
    if not any(of_mesh) or len(meshes) < len(axis.points):
        return ()
    return tuple(key for key, mesh in zip(axis.keys, of_mesh, strict=True) if not mesh)


def _grid(axes: Sequence[Axis]) -> Iterator[dict[str, str]]:
    for points in itertools.product(*(axis.points for axis in axes)):
        pairs = (zip(axis.keys, point, strict=True) for axis, point in zip(axes, points, strict=True))
        yield dict(itertools.chain.from_iterable(pairs))


def _case(
    path: Path,
    varied: dict[str, str],
    tied: frozenset[str],
    fixed: dict[str, str],
    at: str | None,
    tri_counts: dict[str, int],
) -> Case:
    """Validate one combination; meshes that were counted before are not built again."""
    settings = {**fixed, **varied}
    _check_run_settings(settings)
    overrides = _overrides(settings)
    scene = load_scene(path, overrides)
    key = scene.model_dump_json(exclude=_SHOWN_ONLY | {"solver"})
    if key not in tri_counts:
        try:
            model, _, _ = summarise(scene, path.parent)
        except InputError as error:
            raise InputError(f"{path} with {' '.join(overrides)}: {error}") from error
        tri_counts[key] = model.structure.mesh.tri_count
    stage, step = _load_step(scene, at)
    last_done = (at is None or at.endswith(":-1")) and next(s for s in scene.stages if s.name == stage).may_end_early
    return Case(
        path=path, varied=varied, tied=tied, fixed=fixed, scene=scene, tri_count=tri_counts[key], stage=stage, step=step,
        last_done=last_done,
    )  # fmt: skip


def _check_run_settings(settings: Mapping[str, str]) -> None:
    for key, allowed in (("precision", get_args(Precision)), ("arch", get_args(Arch))):
        if key in settings and settings[key] not in allowed:
            raise InputError(f"{key}: {settings[key]!r} is unknown; {not_one_of(settings[key], allowed)}")
    threads = settings.get("threads", "1")
    if not threads.isdecimal() or int(threads) < 1:
        raise InputError(f"threads: {threads!r} must be a whole number, at least 1")


def _load_step(scene: Scene, at: str | None) -> tuple[str, int]:
    counts = _step_counts(scene)
    if at is None:
        last = scene.stages[-1]
        return last.name, last.steps
    stage, sign, number = at.partition(":")
    if not sign or not re.fullmatch(r"-?\d+", number):
        raise InputError(f"--at {at!r}: expected STAGE:STEP, such as {scene.stages[-1].name}:-1")
    if stage not in counts:
        raise InputError(f"--at {at!r}: {stage!r} is not a stage of this scene; {not_one_of(stage, list(counts))}")
    step = int(number) if int(number) > 0 else counts[stage] + 1 + int(number)
    if int(number) == 0 or not 1 <= step <= counts[stage]:
        raise InputError(f"--at {at!r}: stage {stage!r} has {counts[stage]} steps, 1 to {counts[stage]} or -1")
    return stage, step


def _step_counts(scene: Scene) -> dict[str, int]:
    return {stage.name: stage.steps for stage in scene.stages}


def _probes(cases: Sequence[Case], asked: Sequence[str], reference: str) -> tuple[str, ...]:
    """The probes to measure; with the reference ``check`` and none asked for, those that have a check."""
    path = cases[0].path
    for case in cases:
        for probe in asked:
            if probe not in case.scene.probes:
                allowed = not_one_of(probe, list(case.scene.probes))
                raise InputError(f"--probe {probe!r}: not a probe of {path} ({case.label}); {allowed}")
    every = [name for name in cases[0].scene.probes if all(name in case.scene.probes for case in cases)]
    if reference == "check" and not asked:
        every = [name for name in every if all(case.check_reference(name) is not None for case in cases)]
        if not every:
            where = f"{cases[0].stage}:{cases[0].step}"
            raise InputError(f"--reference check: {path} has no check of any probe at {where}")
    if not every:
        raise InputError(f"{path}: the scene has no probes; a study measures [probes.NAME]")
    return tuple(dict.fromkeys(asked)) or tuple(every)


def _parse_fixed(text: str) -> tuple[str, str]:
    key, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not key:
        raise InputError(f"--set {text!r}: expected KEY=VALUE, such as mesh.around=64")
    return key, value


def _split(text: str, separator: str) -> list[str]:
    """Split at separators that are in no brackets, braces or quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        depth += 0 if quote else (character in "[{") - (character in "]}")
        if character == separator and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def _overrides(settings: Mapping[str, str]) -> list[str]:
    return [f"{key}={value}" for key, value in settings.items() if key not in RUN_DEFAULTS]


def _opens_sequence(key: str, value: str) -> bool:
    """Whether a setting is more than a finer mesh or another way to solve: another problem, or another kind of mesh."""
    if key in RUN_DEFAULTS or key.startswith("solver.") or re.fullmatch(r"stages[.\[][^.]+\.steps", key):
        return False
    return key in _ELEMENT or not (key == "mesh.path" or (key.startswith("mesh.") and _is_number(value)))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _label(settings: Mapping[str, str]) -> str:
    return " ".join(f"{key}={value}" for key, value in settings.items())


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
