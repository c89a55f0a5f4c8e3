"""How pressurised fabric deforms, carries load, wrinkles and collapses.

``tm.run(scene)`` runs a :class:`Scene` and returns NumPy results. Importing this package starts nothing and prints nothing; Taichi
starts with the first run.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi_membrane.errors import InputError
    from taichi_membrane.execution.run import resume, run
    from taichi_membrane.mesh import Mesh, read_mesh
    from taichi_membrane.scene import Scene
    from taichi_membrane.scene.file import load_scene
    from taichi_membrane.simulation.results import RunResult

# Where each public name lives; looked up on first use, so that the command line starts before NumPy and SciPy are needed.
_HOME = {
    "InputError": "errors",
    "Mesh": "mesh",
    "RunResult": "simulation.results",
    "Scene": "scene",
    "load_scene": "scene.file",
    "read_mesh": "mesh",
    "resume": "execution.run",
    "run": "execution.run",
}

__all__ = ["InputError", "Mesh", "RunResult", "Scene", "load_scene", "read_mesh", "resume", "run"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
