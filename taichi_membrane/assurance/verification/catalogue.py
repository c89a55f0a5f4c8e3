"""The verification cases by name, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from taichi_membrane.assurance.verification import (
    cables,
    curved,
    filled,
    films,
    forms,
    pressure,
    rigid,
    shrinkage,
    touch,
    tubes,
    wrinkling,
)
from taichi_membrane.assurance.verification.benchmark import Benchmark
from taichi_membrane.errors import InputError

# Functions, because a case computes its references when it is made.
CASES: dict[str, Callable[[], Benchmark]] = {
    "sphere": pressure.sphere,
    "cylinder": pressure.cylinder,
    "hencky": pressure.hencky,
    "disc": pressure.disc,
    "sphere_six": curved.sphere,
    "cylinder_six": curved.cylinder,
    "disc_six": curved.disc,
    "mylar": pressure.mylar,
    "airbag": pressure.airbag,
    "strip": wrinkling.strip,
    "annulus": wrinkling.annulus,
    "off_axis": tubes.off_axis,
    "cantilever": tubes.cantilever,
    "torsion": tubes.torsion,
    "end_plate": rigid.end_plate,
    "mast": rigid.mast,
    "shrink": shrinkage.shrink,
    "catenoid": films.catenoid,
    "scherk": films.scherk,
    "hypar": films.hypar,
    "found_film": forms.found_film,
    "bubble": forms.bubble,
    "catenary": cables.catenary,
    "pulley": cables.pulley,
    "balloon": filled.balloon,
    "plates": filled.plates,
    "pond": filled.pond,
    "pressed": touch.pressed,
    "pressed_sphere": touch.pressed_sphere,
    "filled_tube": touch.filled_tube,
    "capstan": touch.capstan,
}


def chosen(names: Sequence[str]) -> tuple[str, ...]:
    """The given names, or all of them where none is given, in the order of the report.

    :raises InputError: no case of that name.
    """
    for name in names:
        if name not in CASES:
            raise InputError(f"no verification case is called {name!r}; there are {', '.join(CASES)}")
    return tuple(name for name in CASES if name in names or not names)
