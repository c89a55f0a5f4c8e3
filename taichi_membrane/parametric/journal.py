"""The files of a sweep: a line for every row as it arrives, from which a restart goes on, and the tables made of them."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterator
from dataclasses import fields
from importlib import metadata
from pathlib import Path
from typing import Any

from taichi_membrane.errors import InputError
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.lock import LOCK
from taichi_membrane.parametric.plan import VERSIONED, SweepPlan
from taichi_membrane.parametric.rows import HELD, Row, SweepTable, record, row_of
from taichi_membrane.parametric.statistics import importance, quantiles

JOURNAL, RUNS = "rows.jsonl", "runs"
FORMAT, FORMAT_VERSION = "taichi_membrane sweep", 1


def check_sweep_folder(directory: Path) -> None:
    """Make sure that a sweep may write here.

    :raises InputError: the folder holds files, but no sweep; or it is no folder.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: the output folder is a file")
    held = sorted(path.name for path in directory.iterdir() if path.name != LOCK) if directory.is_dir() else []
    if held and JOURNAL not in held:
        raise InputError(
            f"{directory}: the output folder holds {held[0]!r} but no earlier sweep; give an empty or new one"
        )


class Journal:
    """The rows on disk. Each is there for good when :meth:`add` returns, whatever happens to this process afterwards.

    Rows are known by the fingerprint of their trial, so a plan that changed keeps what it shares with the one before it.

    :raises InputError: the journal in the folder is that of another scene.
    """

    def __init__(self, plan: SweepPlan, directory: Path) -> None:
        self.plan, self._path = plan, directory / JOURNAL
        self._header = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "scene": plan.scene.name,
            "digest": plan.digest,
        }
        self.rows: dict[int, Row] = {}
        if self._path.exists():
            self._read()
        else:
            self._append(self._header)

    def _read(self) -> None:
        lines = list(self._lines())
        if not lines or lines[0].get("format") != FORMAT or lines[0].get("format_version") != FORMAT_VERSION:
            raise InputError(f"{self._path}: not the rows of a sweep of this version; give another folder")
        if lines[0].get("digest") != self.plan.digest:
            raise InputError(
                f"{self._path}: the sweep in this folder is of scene {lines[0].get('scene')!r} or has other probes or units, "
                f"this one is of {self.plan.scene.name!r}; give another folder"
            )
        found = {line["fingerprint"]: line["answer"] for line in lines[1:] if line["answer"]["outcome"] not in HELD}
        for trial in self.plan.trials:
            if trial.fingerprint in found:
                self.rows[trial.number] = row_of(trial, found[trial.fingerprint])

    def _lines(self) -> Iterator[dict[str, Any]]:
        """What is written; a last line cut off by a kill is dropped, and is cut from the file so that the next one is whole."""
        with self._path.open("rb+") as file:
            whole = 0
            for raw in file:
                try:
                    line = json.loads(raw) if raw.endswith(b"\n") else None
                except ValueError:
                    line = None
                if not isinstance(line, dict):
                    break
                whole += len(raw)
                yield line
            file.truncate(whole)

    def add(self, row: Row, answer: dict[str, Any]) -> None:
        """Write a row.

        :raises InputError: it cannot be written.
        """
        kept = {field.name for field in fields(Row)} - {"trial"}
        self._append(
            {
                "fingerprint": row.trial.fingerprint,
                "answer": {key: value for key, value in answer.items() if key in kept},
            }
        )
        self.rows[row.trial.number] = row

    def _append(self, content: dict[str, Any]) -> None:
        try:
            with self._path.open("ab") as file:
                file.write(json.dumps(content, ensure_ascii=False).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error

    def table(self) -> SweepTable:
        """The rows that are there, in the order of the plan."""
        rows = tuple(self.rows[number] for number in sorted(self.rows))
        return SweepTable(plan=self.plan, rows=rows, directory=self._path.parent)


class GrowingCsv:
    """``sweep.csv`` while a sweep runs: a line as each row arrives, in that order; :func:`write_tables` puts them in the plan's.

    A row with a limit of a factor that had none before changes the columns, and the file is written anew.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._heads: list[str] = []

    def show(self, table: SweepTable, row: Row) -> None:
        """Add a row, which is the newest of the table's.

        :raises InputError: it cannot be written.
        """
        flat = record(table, row)
        if list(flat) != self._heads:
            self._heads = list(flat)
            _replace(self._path, _csv(table))
            return
        try:
            with self._path.open("a", encoding="utf-8", newline="") as file:
                csv.DictWriter(file, self._heads, lineterminator="\n").writerow(flat)
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from error


def write_tables(table: SweepTable, directory: Path) -> list[Path]:
    """Write ``sweep.csv`` and ``sweep.json``, each whole or not at all; returns the files.

    :raises InputError: one of them cannot be written.
    """
    contents = {"sweep.csv": _csv(table), "sweep.json": _json(table)}
    for name, text in contents.items():
        _replace(directory / name, text)
    return [directory / name for name in contents]


def _replace(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _csv(table: SweepTable) -> str:
    records = table.records()
    text = io.StringIO()
    writer = csv.DictWriter(text, list(records[0]) if records else ["run"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def _json(table: SweepTable) -> str:
    plan = table.plan
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "scene": plan.source,
        "versions": {name: metadata.version(name) for name in VERSIONED},
        "conditions": vars(plan.conditions),
        "fixed": list(plan.fixed),
        "inputs": list(plan.inputs),
        "scatter": [vars(scatter) for scatter in plan.scatters],
        "design": plan.design,
        "seed": plan.seed,
        "asked": len(plan.trials),
        "done": len(table.rows),
        "apart": [{"run": row.trial.number, "why": row.apart, "reason": row.reason} for row in table.apart],
        "quantities": {quantity: table.unit(quantity) for quantity in table.quantities},
        "quantiles": [vars(found) for found in quantiles(table)],
        "importance": [vars(found) for found in importance(table)],
        "rows": [_row(row) for row in table.rows],
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _row(row: Row) -> dict[str, Any]:
    return {
        "run": row.trial.number,
        "fingerprint": row.trial.fingerprint,
        "settings": dict(row.trial.settings),
        "triangles": row.trial.tri_count,
        "apart": row.apart,
        **{key: value for key, value in vars(row).items() if key not in ("trial", "steps")},
    }
