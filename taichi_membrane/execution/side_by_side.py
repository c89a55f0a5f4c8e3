"""Work that waits for other processes, several pieces at a time, results as they come."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(
    items: Sequence[Item], work: Callable[[Item], Result], *, jobs: int, stop: Callable[[], None]
) -> Generator[Result]:
    """The result of ``work`` on each item, as each ends, with ``jobs`` threads; they begin in the order of the items.

    :param stop: called where the caller leaves early or a piece of work fails; must make the work in progress end. What has not
        begun by then is dropped.
    """
    pool = ThreadPoolExecutor(jobs)
    waiting = [pool.submit(work, item) for item in items]
    try:
        for future in as_completed(waiting):
            yield future.result()
    except BaseException:  # Ctrl-C above all: leave no process behind
        stop()
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()
