"""Truths that take minutes: computed by ``python -m taichi_membrane.assurance.verdicts.trace``, kept beside this file."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, get_args

from taichi_membrane.assurance.verdicts.case import UNKNOWN, Source, Truth

FILE = Path(__file__).with_name("truths.json")


@cache
def _entries() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text(encoding="utf-8"))["truths"])


def stored(name: str, *, branch: float = math.inf) -> Truth:
    """The truth of a case of that name; unknown where none was computed.

    :param branch: by what share a stable branch carries at most more where the path loses its stability under rising load.
    """
    entry = _entries().get(name)
    return UNKNOWN if entry is None else read(entry, branch)


def read(entry: dict[str, Any], branch: float) -> Truth:
    """A stored truth; see :func:`stored`.

    :raises ValueError: a kind or source that there is not.
    """
    if entry["kind"] not in ("limit", "holds") or entry["source"] not in get_args(Source):
        raise ValueError(f"no such truth: {entry}")
    found = Truth(**{key: entry[key] for key in ("kind", "name", "lower", "upper", "source") if key in entry})
    if not entry.get("branching"):
        return found
    if entry["target"] > found.lower:
        return replace(found, upper=found.upper + branch * abs(found.upper), remark="branching")
    return replace(found, lower=found.lower - branch * abs(found.lower), remark="branching")
