"""Workers on other machines, by Dask distributed: texts out, texts back, and nothing on a shared disk."""

from __future__ import annotations

import json
import queue
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack
from importlib import metadata
from typing import Any

from taichi_membrane.errors import InputError
from taichi_membrane.parametric.plan import VERSIONED, Trial
from taichi_membrane.parametric.pool import RETRIES, Answer
from taichi_membrane.parametric.task import carry_out

ALSO_COMPARED = ("distributed", "dask")  # scheduler and workers must speak one language
NO_WORKER = (
    60.0  # s without any worker, at the start or later, before a cluster is given up; a batch system may need longer
)
_LOOK = 1.0  # s between looks at the cluster where no answer comes
_AHEAD = 4  # trials handed out for each worker: enough that none waits, and few texts with meshes in memory
# As a text, since a worker that has no such module cannot unpickle a function of it and would end, and the client would wait.
_ASKED = (
    "[__import__('taichi_membrane.parametric.cluster', fromlist=['versions']).versions(), "
    "__import__('sys').version.split()[0]]"
)


def versions() -> dict[str, str]:
    """What decides results and speech, on this machine."""
    return {name: metadata.version(name) for name in (*VERSIONED, *ALSO_COMPARED)}


def cluster_answers(
    trials: Sequence[Trial], text: Callable[[Trial], str], *, address: str, jobs: int, patience: float | None = None
) -> Generator[tuple[Trial, Answer]]:
    """Each trial with its answer, as they end, begun in the order given.

    :param address: of a scheduler, such as ``tcp://host:8786``; ``local`` starts one here with ``jobs`` workers.
    :param patience: seconds to wait for a worker; :data:`NO_WORKER` when None.
    :raises InputError: Dask is not installed; no scheduler or worker there; a worker without this package or with other versions;
        scheduler or all workers lost on the way (what has arrived was given out before).
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("--cluster needs Dask: install 'taichi-membrane[cluster]'") from None
    patience = NO_WORKER if patience is None else patience
    with ExitStack() as stack:
        if address == "local":
            cluster = LocalCluster(n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None)
            stack.enter_context(cluster)
            place: Any = cluster
        else:
            place = address
        try:
            client = stack.enter_context(Client(place, timeout=patience, direct_to_workers=False))
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"--cluster {address}: no scheduler answers there: {error}") from error
        _wait_for_worker(client, address, patience)
        _compare(client, address)
        yield from _answers(client, trials, text, address, patience)


def _wait_for_worker(client: Any, address: str, patience: float) -> None:
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError:
        raise InputError(f"--cluster {address}: the scheduler has no worker after {patience:g} s") from None


def _compare(client: Any, address: str) -> None:
    """Refuse workers whose numbers would differ or that cannot work at all.

    :raises InputError: one of them, or a scheduler of another version.
    """
    here = versions()
    scheduler = client.get_versions()["scheduler"]["packages"]
    found = client.run(eval, _ASKED, on_error="return")
    wrong = [
        f"scheduler has {name} {scheduler.get(name)}, here it is {here[name]}"
        for name in ALSO_COMPARED
        if scheduler.get(name) != here[name]
    ]
    for worker, answer in found.items():
        if isinstance(answer, BaseException):
            wrong.append(f"worker {worker} cannot import taichi_membrane: {type(answer).__name__}: {answer}")
            continue
        theirs = answer[0]
        wrong += [
            f"worker {worker} has {name} {theirs[name]}, here it is {here[name]}"
            for name in here
            if theirs[name] != here[name]
        ]
    if wrong:
        raise InputError(f"--cluster {address}: {'; '.join(wrong)}")


def _answers(
    client: Any, trials: Sequence[Trial], text: Callable[[Trial], str], address: str, patience: float
) -> Generator[tuple[Trial, Answer]]:
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    out: dict[str, tuple[Trial, Any]] = {}
    waiting = iter(trials)
    done, last_worker = 0, time.monotonic()
    while True:
        while len(out) < _AHEAD * max(_worker_count(client), 1) and (trial := next(waiting, None)) is not None:
            future = client.submit(
                carry_out,
                text(trial),
                key=f"{trial.fingerprint}-{trial.number}-{id(ended)}",
                pure=False,
                retries=RETRIES,
            )
            out[future.key] = trial, future
            future.add_done_callback(ended.put)
        if not out:
            return
        try:
            future = ended.get(timeout=_LOOK)
        except queue.Empty:
            now = time.monotonic()
            last_worker = now if _worker_count(client) else last_worker
            if client.status != "running" or now - last_worker > patience:
                what = (
                    "the scheduler is gone" if client.status != "running" else f"no worker is left after {patience:g} s"
                )
                raise InputError(f"--cluster {address}: {what}; {_kept(done, len(trials))}") from None
            continue
        trial, future = out.pop(future.key)
        done += 1
        yield trial, _answer(future, address, done - 1, len(trials))
        future.release()


def _worker_count(client: Any) -> int:
    return len(client.scheduler_info(n_workers=-1)["workers"]) if client.status == "running" else 0


def _answer(future: Any, address: str, done: int, total: int) -> Answer:
    """What came back; a trial that ends every worker it is given to is one row, too."""
    if future.status == "finished":
        try:
            return {"attempts": 1, **json.loads(future.result(timeout=NO_WORKER))}
        except (OSError, TimeoutError) as error:
            reason = f"the answer was lost: {error}"
    elif future.status == "error":
        fault = future.exception()
        return {"outcome": "crashed", "reason": f"{type(fault).__name__}: {fault}", "attempts": RETRIES + 1}
    else:
        reason = f"the scheduler is gone ({future.status})"
    raise InputError(f"--cluster {address}: {reason}; {_kept(done, total)}")


def _kept(done: int, total: int) -> str:
    return f"{done} of {total} runs came back and are kept, the same command does the rest"
