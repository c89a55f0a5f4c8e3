"""The only place that starts Taichi; says which back end and precision really run.

``ti.init`` is global and destroys every field made before it, so one process has one runtime. :func:`start` may be
called again with equal arguments and does nothing then; different arguments are refused.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
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


_started: tuple[tuple[object, ...], Runtime] | None = None


def start(*, arch: Arch = "cpu", precision: Precision = "f64", threads: int | None = None) -> Runtime:
    """Start Taichi once per process and return what really runs.

    :param arch: ``cpu``, ``gpu`` (any), or one of ``cuda``, ``vulkan``, ``metal``, ``opengl``.
    :param precision: floating-point type of the mechanics, ``f64`` or ``f32``. The renderer always uses f32.
    :param threads: CPU threads; all cores when None.
    :raises InputError: unknown names; a back end that is missing, or that Taichi would silently replace; a second
        start with other arguments.
    """
    global _started
    asked = (arch, precision, threads)
    if _started is not None:
        if _started[0] != asked:
            raise InputError(f"Taichi already runs as {_started[0]} in this process; it cannot change to {asked}")
        return _started[1]
    _check_names(arch, precision)
    ti = _import_taichi()
    if arch == "opengl":
        _refuse_crash(arch)
    options: dict[str, Any] = {"cpu_max_num_threads": threads} if threads else {}
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
    _started = (asked, runtime)
    return runtime


def current() -> Runtime:
    """The running runtime.

    :raises RuntimeError: when :func:`start` has not been called; models cannot be built before it.
    """
    if _started is None:
        raise RuntimeError("call taichi_membrane.engine.runtime.start() first")
    return _started[1]


def _check_names(arch: str, precision: str) -> None:
    for key, value, allowed in (("arch", arch, get_args(Arch)), ("precision", precision, get_args(Precision))):
        if value not in allowed:
            raise InputError(f"{key} = {value!r} is not one of {', '.join(allowed)}")


def _import_taichi() -> Any:
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # the banner goes to standard output, which is ours
    try:
        import taichi as ti
    except ImportError as error:
        raise InputError(f"Taichi cannot be imported: {error}. On Debian it needs the package libx11-6") from error
    _remember_positions()
    return ti


def _remember_positions() -> None:
    """Let Taichi write out each source position once.

    For messages that are rarely shown, Taichi 1.7.4 wraps the source text of every node it visits, and of each again wherever it is
    inlined or unrolled. Without that the cantilever's kernels came from the cache in 1.8 s instead of 2.1 s.
    """
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    written, known = ASTTransformerContext.get_pos_info, dict[tuple[object, ...], str]()

    def get_pos_info(self: Any, node: Any) -> str:
        function = (self.file, self.func.func.__name__, self.lineno_offset, self.indent)
        key = (*function, type(node), node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)
        if key not in known:
            known[key] = written(self, node)
        return known[key]

    ASTTransformerContext.get_pos_info = get_pos_info


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
