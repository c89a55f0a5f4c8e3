"""How much memory there is, and bounds on the memory and time that reading a file may take."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None  # type: ignore[assignment]

_CGROUP = Path("/sys/fs/cgroup/memory.max")
_REPEATED = 0.5  # seconds between two alarms


class TooLong(BaseException):
    """The time of :func:`at_most_seconds` is over. No Exception, lest the code that takes too long should catch it."""


def limit() -> int | None:
    """Bytes this process may ever hold: the machine's memory, or less where a limit is set; None where nothing tells."""
    bounds = []
    with suppress(AttributeError, ValueError, OSError):  # not on Windows
        bounds.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    if resource is not None:
        soft = resource.getrlimit(resource.RLIMIT_AS)[0]
        bounds += [soft] if soft != resource.RLIM_INFINITY else []
    with suppress(OSError, ValueError):  # no control group, or "max"
        bounds.append(int(_CGROUP.read_text()))
    return min(bounds, default=None)


def shortage(needed: float) -> str | None:
    """Both numbers in words where ``needed`` bytes are more than this process may hold; None where they may fit."""
    bound = limit()
    if bound is None or needed <= bound:
        return None
    return f"needs at least {needed / 1e9:.3g} GB of memory, and there are {bound / 1e9:.3g} GB"


@contextmanager
def at_most(extra: int) -> Iterator[None]:
    """Let the process grow by no more than ``extra`` bytes inside the block; beyond that it meets a MemoryError.

    The bound is on address space and needs Linux; elsewhere the block runs without one.
    """
    try:
        held = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    bound = held + extra
    resource.setrlimit(resource.RLIMIT_AS, (bound if soft == resource.RLIM_INFINITY else min(soft, bound), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextmanager
def at_most_seconds(seconds: float) -> Iterator[None]:
    """Raise :class:`TooLong` when the block takes longer.

    The bound needs an alarm signal: in other threads than the main one, on Windows, and where the program around this one uses
    the alarm itself, the block runs without one.
    """

    def ring(number: int, frame: FrameType | None) -> None:
        raise TooLong

    free = hasattr(signal, "SIGALRM") and signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
    if not free or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGALRM, ring)
    # Again and again: where Python runs a callback of its own, such as the garbage collector's, the exception is swallowed.
    signal.setitimer(signal.ITIMER_REAL, seconds, _REPEATED)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
