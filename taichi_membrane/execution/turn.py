"""Runs of several threads take turns, and all of Taichi's work is done in one thread.

Taichi has one program in a process, whose kernels may be compiled only by the thread that started it. Where that is the main thread
its runs are done in place, where Ctrl-C reaches them. Where another thread asks first, a thread of our own starts Taichi and
does the runs of all that ask later.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from taichi_membrane.algebra import blas
from taichi_membrane.device import runtime
from taichi_membrane.errors import InputError

Result = TypeVar("Result")

_turn = threading.Lock()
_at_work: threading.Thread | None = None
_own = ThreadPoolExecutor(1, "taichi")  # makes its thread at the first call


def refuse_within() -> None:
    """Refuse what is asked for within a run.

    :raises InputError: this thread is at work for :func:`in_turn`, and what it asked for would wait for itself.
    """
    if threading.current_thread() is _at_work:
        raise InputError(
            "a run cannot start another one, say from its observer: Taichi does one at a time; start it when this one has ended"
        )


def in_turn(work: Callable[[], Result], stop: Callable[[], None] = lambda: None) -> Result:
    """The result of ``work``, done when all that was asked for earlier has ended, in the thread that Taichi works in.

    :param stop: makes the work end early with KeyboardInterrupt, where Ctrl-C reaches this thread and not the one at work.
    :raises InputError: it is asked for within other such work, which would wait for itself; a thread that called
        :func:`taichi_membrane.device.runtime.start` holds Taichi, and this is another one.
    """
    refuse_within()
    here = threading.current_thread()
    with _turn:
        owner = runtime.owner()
        if here is owner or (owner is None and here is threading.main_thread()):
            return _done(work)
        task = _own.submit(_done, work)
        try:
            return task.result()
        except KeyboardInterrupt:
            if not task.done():
                stop()
                task.exception()  # nobody else's turn before it has ended
            raise


def _done(work: Callable[[], Result]) -> Result:
    global _at_work
    _at_work = threading.current_thread()
    try:
        # A scalar product in two waits longer for the second than it takes, beside other work ten times.
        with blas.one_thread():
            return work()
    finally:
        _at_work = None
