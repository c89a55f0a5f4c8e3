"""The verdict cases by name, in the order of the report."""

from __future__ import annotations

from collections.abc import Sequence

from taichi_membrane.assurance.verdicts import arches, columns, fabrics, joined, loading, motions, skew, snaps, tubes
from taichi_membrane.assurance.verdicts.case import Case, Size
from taichi_membrane.errors import InputError

_THEMES = (tubes, columns, arches, snaps, loading, motions, fabrics, skew, joined)
CASES: dict[str, Case] = {case.name: case for theme in _THEMES for case in theme.cases()}
FAMILIES = tuple(dict.fromkeys(case.family for case in CASES.values()))


def chosen(names: Sequence[str], size: Size) -> tuple[Case, ...]:
    """The named cases and families, or the set's where none is named.

    :raises InputError: nothing of that name.
    """
    for name in names:
        if name not in CASES and name not in FAMILIES:
            raise InputError(f"no verdict case or family is called {name!r}; families: {', '.join(FAMILIES)}")
    return tuple(
        case
        for case in CASES.values()
        if (case.belongs(size) if not names else case.name in names or (case.family in names and case.belongs(size)))
    )
