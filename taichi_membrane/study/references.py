"""What the values of a study are compared with, as its option says: given numbers, the scene's checks, or what the study finds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, get_args

from taichi_membrane.errors import InputError
from taichi_membrane.scene.messages import not_one_of

if TYPE_CHECKING:
    from taichi_membrane.study.plan import Case

ReferenceKind = Literal["finest", "extrapolated", "check"]


def reference_of(cases: Sequence[Case], probes: Sequence[str], text: str) -> ReferenceKind | Mapping[str, float]:
    """What a study's option ``--reference`` asks for.

    :raises InputError: a word or form that is none, or one that some case does not have.
    """
    if text == "finest":
        return "finest"
    if text == "check":
        for case in cases:
            missing = [probe for probe in probes if case.check_reference(probe) is None]
            if missing:
                where = f"{case.stage}:{case.step}"
                raise InputError(f"--reference check: {case.path} has no check of probe {missing[0]!r} at {where}")
        return "check"
    if text == "extrapolated":
        for sequence in dict.fromkeys(case.sequence for case in cases):
            _check_extrapolation([case for case in cases if case.sequence == sequence])
        return "extrapolated"
    if "=" in text:
        return _given(probes, text)
    try:
        value = float(text)
    except ValueError:
        allowed = not_one_of(text, get_args(ReferenceKind))
        raise InputError(f"--reference {text!r}: neither a number nor a known word; {allowed}") from None
    if not math.isfinite(value):
        raise InputError(f"--reference {text!r}: must be a finite number")
    if len(probes) != 1:
        raise InputError(
            f"--reference {text}: a number needs one --probe, not {len(probes)}: {', '.join(probes)}; or give PROBE=VALUE,…"
        )
    return {probes[0]: value}


def _given(probes: Sequence[str], text: str) -> dict[str, float]:
    """References of several probes.

    :raises InputError: not of the form ``PROBE=VALUE,…``, a probe that is not measured, or one without a reference.
    """
    found = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in probes:
            raise InputError(f"--reference {part!r}: {name!r} is not measured; {not_one_of(name, list(probes))}")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = math.nan
        if not math.isfinite(found[name]):
            raise InputError(f"--reference {part!r}: {value!r} is no finite number; expected PROBE=VALUE")
    missing = [name for name in probes if name not in found]
    if missing:
        raise InputError(f"--reference {text!r}: no value for {', '.join(missing)}; give each, or choose with --probe")
    return found


def _check_extrapolation(cases: Sequence[Case]) -> None:
    """Richardson's extrapolation needs three meshes, each finer than the one before."""
    counts = {case.mesh: case.tri_count for case in cases}
    if len(set(counts.values())) < len(counts):
        raise InputError(f"--reference extrapolated: two meshes have the same number of triangles: {_counted(counts)}")
    if len(counts) < 3:
        raise InputError(f"--reference extrapolated: needs 3 meshes at least, not {len(counts)}: {_counted(counts)}")


def _counted(counts: Mapping[str, int]) -> str:
    return "; ".join(f"{mesh or 'as it is'}: {count}" for mesh, count in counts.items())
