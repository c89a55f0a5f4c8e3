"""Files of a run: steps for ParaView, a table, a summary; each is in place whole or not at all. Reads a run back.

``mesh.vtu`` holds the unstressed mesh with its groups, ``step_NNNN.vtu`` the state after each load step, ``steps.pvd`` their order,
``history.csv`` a row per load step, ``summary.json`` everything that is not an array. All are complete after every load step.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.results import CheckResult, ElementFields, RunResult, StepResult
from taichi_membrane.scene import Scene

FORMAT, FORMAT_VERSION = "taichi_membrane run", 1
SUMMARY, HISTORY, SERIES, MESH = "summary.json", "history.csv", "steps.pvd", "mesh.vtu"

_OURS = re.compile(r"(step_\d{4,}\.(vtu|png)|mesh\.vtu|steps\.pvd|history\.csv|curve\.png|animation\.gif)")
_TEMPORARY = re.compile(r"\..+\.\d+\.tmp")
_STRAINS = ("strain_warp", "strain_weft", "strain_shear")
_STRESSES = ("stress_warp", "stress_weft", "stress_shear")
_SCALARS = ("fold_strain", "taut_margin", "slack_margin", "major_stress", "minor_stress")


def probe_unit(scene: Scene, name: str) -> str:
    """Unit of a probe; empty for a share."""
    units = scene.units
    return {
        "displacement": units.length,
        "radius": units.length,
        "reaction": units.force,
        "volume": units.volume,
        "stress": units.stress,
        "area_share": "",
    }[scene.probes[name].kind]


def load_unit(scene: Scene, name: str) -> str:
    """Unit of a load's factor; empty where the direction is not a unit vector, so that the factor is a mere number."""
    load, units = scene.loads[name], scene.units
    if not math.isclose(math.hypot(*load.direction), 1.0, rel_tol=1e-6):
        return ""
    return units.force + {"total": "", "line": f"/{units.length}", "area": f"/{units.area}"}[load.kind]


class Writer:
    """Writes one run's files as the load steps end, so that an interrupted run keeps what it had.

    :param directory: made when missing; the files of an earlier run in it are removed.
    :param provenance: what really ran; goes into the summary.
    :param tri_fabric: (tri_count,) fabric number of each element.
    :raises InputError: the folder cannot be made or written, or holds something that is not a run of this program.
    """

    def __init__(
        self,
        directory: Path,
        scene: Scene,
        mesh: Mesh,
        *,
        provenance: dict[str, Any],
        tri_fabric: NDArray[np.int32],
    ) -> None:
        self.directory = directory
        self._scene, self._mesh, self._tri_fabric = scene, mesh, tri_fabric
        self._provenance = provenance
        self._steps: list[StepResult] = []  # without their arrays, which are in the files
        self._wrinkled: list[dict[str, int]] = []
        self._noted: list[Path] = []
        _claim(directory)
        self._write_summary({}, complete=False)  # first: from here on the folder is known to be a run
        _remove_stale(directory)
        _write_vtu(directory / MESH, _mesh_arrays(mesh, tri_fabric))

    def write_step(self, step: StepResult, seconds: dict[str, float]) -> list[Path]:
        """Write the files of one more load step.

        :param seconds: time spent in each phase so far.
        :return: the step's own file, then the tables that were brought up to date.
        """
        self._add_step(step)
        return [self._step_path(step), *self._write_tables(), self._write_summary(seconds, complete=False)]
