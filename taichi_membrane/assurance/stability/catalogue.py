"""The stress cases by name, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from taichi_membrane.assurance.stability import geometry, loading, material, state
from taichi_membrane.assurance.stability.case import Sweep
from taichi_membrane.errors import InputError

CASES: dict[str, Callable[[], Sweep]] = {
    make.__name__: make for theme in (material, geometry, state, loading) for make in theme.CASES
}


def chosen(names: Sequence[str]) -> tuple[str, ...]:
    """The given names, or all of them where none is given, in the order of the report.

    :raises InputError: no case of that name.
    """
    for name in names:
        if name not in CASES:
            raise InputError(f"no stress case is called {name!r}; there are {', '.join(CASES)}")
    return tuple(name for name in CASES if name in names or not names)
