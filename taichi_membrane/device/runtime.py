"""The only place that starts Taichi; says which back end and precision really run.

``ti.init`` is global and destroys every field made before it, so one process has one runtime. :func:`start` may be
called again with equal arguments and does nothing then; different arguments are refused, and so are other threads: Taichi 1.7.4
compiles kernels in the thread that started it alone, and what another one begins leaves it broken.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Any, get_args

from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision


@dataclass(frozen=True, kw_only=True)
class Runtime:
    """What runs: the back end Taichi really chose, the precision of the mechanics and the number of CPU threads."""

    arch: str
    precision: Precision
    threads: int
    taichi_version: str

    @property
    def on_cpu(self) -> bool:
        """True when kernels run on the processor (node loops are then cut into a few long blocks)."""
        return self.arch in ("x64", "arm64")


_started: tuple[tuple[object, ...], Runtime, threading.Thread] | None = None


def start(*, arch: Arch = "cpu", precision: Precision = "f64", threads: int | None = None) -> Runtime:
    """Start Taichi once per process and return what really runs.

    :param arch: ``cpu``, ``gpu`` (any), or one of ``cuda``, ``vulkan``, ``metal``, ``opengl``.
    :param precision: floating-point type of the mechanics, ``f64`` or ``f32``. The renderer always uses f32.
    :param threads: CPU threads; all cores when None.
    :raises InputError: unknown names; a back end that is missing, or that Taichi would silently replace; a second
        start with other arguments, or by another thread.
    """
    global _started
    asked = (arch, precision, threads)
    if _started is not None:
        if _started[2] is not threading.current_thread():
            raise InputError(
                f"Taichi was started by the thread {_started[2].name!r} of this process and works in no other one, such as "
                f"{threading.current_thread().name!r}: run every scene there, or the first one in a thread, too"
            )
        if _started[0] != asked:
            raise InputError(f"Taichi already runs as {_started[0]} in this process; it cannot change to {asked}")
        return _started[1]
    _check_names(arch, precision)
    from taichi_membrane.device.language import ti

    if arch == "opengl":
        _refuse_crash(arch)
    options: dict[str, Any] = {"cpu_max_num_threads": threads} if threads else {}
    if arch == "cpu":
        # LLVM optimises all that Taichi does itself: the same bits and speed without, in half the time to compile.
        options["advanced_optimization"] = False
    fp = ti.f64 if precision == "f64" else ti.f32
    with contextlib.redirect_stdout(io.StringIO()):
        # fast_math off: the same bits on every machine that rounds by IEEE 754, and comparisons with NaN stay honest.
        ti.init(arch=getattr(ti, arch), default_fp=fp, fast_math=False, log_level=ti.ERROR, **options)
    actual = ti.cfg.arch
    _refuse_replacement(ti, arch, actual)
    count = int(ti.cfg.cpu_max_num_threads) if actual in (ti.x64, ti.arm64) else 0
    runtime = Runtime(
        arch=actual.name, precision=precision, threads=count, taichi_version=".".join(map(str, ti.__version__))
    )
    _started = (asked, runtime, threading.current_thread())
    return runtime


def owner() -> threading.Thread | None:
    """The thread that has started Taichi, the only one that it works in; None before that."""
    return None if _started is None else _started[2]


def current() -> Runtime:
    """The running runtime.

    :raises RuntimeError: when :func:`start` has not been called; models cannot be built before it.
    """
    if _started is None:
        raise RuntimeError("call taichi_membrane.device.runtime.start() first")
    return _started[1]


def _check_names(arch: str, precision: str) -> None:
    for key, value, allowed in (("arch", arch, get_args(Arch)), ("precision", precision, get_args(Precision))):
        if value not in allowed:
            raise InputError(f"{key} = {value!r} is not one of {', '.join(allowed)}")


def _refuse_crash(arch: Arch) -> None:
    """Taichi crashes where OpenGL finds no display or driver, and nothing can catch that: try it in another process first."""
    if not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        os.environ.setdefault("EGL_PLATFORM", "surfaceless")  # Mesa looks for a display otherwise
    trial = f"import taichi as ti; ti.init(arch=ti.{arch}, log_level=ti.ERROR)"
    done = subprocess.run([sys.executable, "-c", trial], capture_output=True, check=False)
    if done.returncode:
        raise _unavailable(arch, f"Taichi crashes when it starts it, code {done.returncode}")


def _unavailable(arch: Arch, why: str) -> InputError:
    others = ", ".join(repr(name) for name in get_args(Arch) if name not in (arch, "cpu"))
    return InputError(f"arch = {arch!r} is not available on this machine ({why}); use 'cpu', or try one of {others}")


def _refuse_replacement(ti: Any, arch: Arch, actual: Any) -> None:
    """Taichi falls back to the CPU when a back end is missing; a run must not claim a back end it did not use."""
    cpu = (ti.x64, ti.arm64)
    wanted = {"cpu": cpu, "gpu": (ti.cuda, ti.vulkan, ti.metal, ti.opengl)}.get(arch) or (getattr(ti, arch),)
    if actual not in wanted:
        ti.reset()
        raise _unavailable(arch, f"Taichi would use {actual.name!r} instead")
