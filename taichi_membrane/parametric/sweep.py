"""Runs a sweep: trials to workers, rows to the disk as they arrive, then tables and pictures."""

from __future__ import annotations

import base64
import io
import os
import time
import zipfile
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

from taichi_membrane.errors import InputError
from taichi_membrane.names import Arch, Precision
from taichi_membrane.parametric.journal import RUNS, GrowingCsv, Journal, check_sweep_folder, write_tables
from taichi_membrane.parametric.plan import Conditions, SweepPlan, Trial, build_sweep
from taichi_membrane.parametric.pool import Answer, LocalPool
from taichi_membrane.parametric.rows import Row, SweepTable, row_of
from taichi_membrane.parametric.scatter import Design
from taichi_membrane.parametric.task import packed
from taichi_membrane.scene import Scene

Told = Callable[[Row, int, int, float], None]


def sweep(
    scene: Scene | Path | str,
    vary: Mapping[str, Sequence[Any] | str] | None = None,
    *,
    sample: Mapping[str, str] | None = None,
    table: Path | None = None,
    tie: Mapping[str, str] | None = None,
    fixed: Mapping[str, Any] | None = None,
    runs: int = 100,
    seed: int = 0,
    design: Design = "latin",
    out: Path | None = None,
    base: Path | None = None,
    arch: Arch = "cpu",
    precision: Precision = "f64",
    threads: int = 1,
    jobs: int | None = None,
    cluster: str | None = None,
    store: str | None = None,
    files: bool = False,
    progress: bool = True,
) -> SweepTable:
    """Run a scene many times with changed settings; a table with a row for every run, also for those that gave nothing.

    :param scene: a scene, its file, or the name of a shipped one.
    :param vary: values of each key, such as ``{"mesh.radius": [20, 25]}`` or ``{"stages.inflate.pressure": "0.02:0.08:7"}``: all
        combinations are run.
    :param sample: a distribution for each key, such as ``{"fabric.E_warp": "normal:4000:5%"}``; drawn with ``runs``,
        ``seed`` and ``design``.
    :param table: a CSV file with keys as heads and a run in every row, in place of both.
    :param tie: keys that follow others, such as ``{"fabric.E_weft": "0.6*fabric.E_warp"}``.
    :param out: folder for sweep.csv, sweep.json and pictures; what it holds already is not run again. Nothing is written when None.
    :param jobs: worker processes; as many as cores when None.
    :param cluster: a Dask scheduler's address, or ``local`` for one of its own.
    :param files: keep every run's files, in ``runs`` under ``out``; with ``store``, an address such as
        ``s3://…``, zipped there instead.
    :param progress: show a bar on standard error, or in a notebook.
    :raises InputError: settings that some run cannot have; another process at work in ``out``; a cluster that cannot be used.
    """
    plan = build_sweep(
        scene, vary=[f"{key}={_written(values)}" for key, values in (vary or {}).items()],
        sample=[f"{key}={text}" for key, text in (sample or {}).items()], table=table,
        tie=[f"{key}={text}" for key, text in (tie or {}).items()],
        fixed=[f"{key}={_literal(value)}" for key, value in (fixed or {}).items()],
        runs=runs, seed=seed, design=design, base=base, conditions=Conditions(arch=arch, precision=precision, threads=threads),
    )  # fmt: skip
    work = partial(run_sweep, plan, out=out, jobs=jobs, cluster=cluster, store=store, files=files)
    if not progress:
        return work()
    from taichi_membrane.parametric.progress import told_by_bar

    with told_by_bar(len(plan.trials)) as told:
        return work(told=told)


def run_sweep(
    plan: SweepPlan,
    *,
    out: Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    store: str | None = None,
    files: bool = False,
    told: Told = lambda row, done, total, remaining: None,
) -> SweepTable:
    """Run the trials of a plan that have no row yet, largest mesh first: smaller ones reuse its kernels.

    What has arrived is written also when this is interrupted.

    :param told: hears of each row as it arrives, how many there are, of how many, and the seconds still to go (estimated).
    """
    if files and out is None and store is None:
        raise InputError("files of runs need a folder to be kept in: give out, or store")
    if store is not None and cluster is None:
        _check_store(store)
    with ExitStack() as stack:
        journal = None
        if out is not None:
            from taichi_membrane.output.lock import sole_writer

            check_sweep_folder(out)
            stack.enter_context(sole_writer(out))
            journal = Journal(plan, out)
        rows = dict(journal.rows) if journal else {}
        left = sorted((t for t in plan.trials if t.number not in rows), key=lambda trial: -trial.tri_count)
        wanted = store or ("return" if files else "")
        answers = stack.enter_context(closing(_answers(plan, left, jobs, cluster, wanted)))
        try:
            _collect(plan, answers, rows, journal, out, told)
        finally:
            table = SweepTable(plan=plan, rows=tuple(rows[number] for number in sorted(rows)), directory=out)
            written = _report(table, out) if out is not None and rows else ()
        return SweepTable(plan=plan, rows=table.rows, directory=out, files=tuple(written))


def _check_store(store: str) -> None:
    """Refuse a folder that cannot be made, before anything runs; what lies elsewhere the workers find out."""
    if "://" in store:
        return
    try:
        Path(store).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--store {store}: the folder cannot be made: {error.strerror}") from error


def _answers(
    plan: SweepPlan, left: Sequence[Trial], jobs: int | None, cluster: str | None, files: str
) -> Generator[tuple[Trial, Answer]]:
    how, count = plan.conditions, jobs or os.cpu_count() or 1
    if not left:
        return
    if cluster is None:
        with LocalPool(jobs=min(count, len(left)), threads=how.threads) as pool:
            yield from pool.answers(left, lambda trial: packed(trial, plan.base, how, send_mesh=False, files=files))
        return
    from taichi_membrane.parametric.cluster import cluster_answers

    yield from cluster_answers(
        left, lambda trial: packed(trial, plan.base, how, send_mesh=True, files=files), address=cluster, jobs=count
    )


def _collect(
    plan: SweepPlan, answers: Iterator[tuple[Trial, Answer]], rows: dict[int, Row], journal: Journal | None,
    out: Path | None, told: Told,
) -> None:  # fmt: skip
    """Take the answers as they come."""
    started, kept, growing = time.monotonic(), len(rows), GrowingCsv(out / "sweep.csv") if out is not None else None
    for trial, answer in answers:
        row = row_of(trial, answer)
        if out is not None and "files" in answer:
            _unpack(answer["files"], out / RUNS / f"{trial.number:0{len(str(len(plan.trials)))}d}")
        rows[trial.number] = row
        if journal is not None and growing is not None:
            journal.add(row, answer)
            growing.show(journal.table(), row)
        new = len(rows) - kept
        remaining = (time.monotonic() - started) / new * (len(plan.trials) - len(rows))
        told(row, len(rows), len(plan.trials), remaining)


def _unpack(content: str, folder: Path) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(base64.b64decode(content))) as archive:
            archive.extractall(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error


def _report(table: SweepTable, out: Path) -> list[Path]:
    from taichi_membrane.parametric.figures import draw_sweep
    from taichi_membrane.parametric.summary import write_summary

    return [*write_tables(table, out), write_summary(table, out), *draw_sweep(table, out)]


def _written(values: Sequence[Any] | str) -> str:
    return values if isinstance(values, str) else ",".join(map(_literal, values))


def _literal(value: Any) -> str:
    """A Python value as TOML writes it."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_literal(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_literal, value))}]"
    return repr(float(value)) if hasattr(value, "dtype") and value.dtype.kind == "f" else str(value)
