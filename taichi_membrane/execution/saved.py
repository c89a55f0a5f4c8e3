"""What a run that was stopped does not go on with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from taichi_membrane.errors import InputError

if TYPE_CHECKING:
    from taichi_membrane.output.reader import SavedRun
    from taichi_membrane.simulation.results import ProbeFunction


def refuse_other_probes(saved: SavedRun, given: Mapping[str, ProbeFunction]) -> None:
    """Refuse to go on without the functions that the run measured with: files do not hold them.

    :raises InputError: other names than those that the run was begun with.
    """
    if set(given) != set(saved.own_probes):
        begun, now = (", ".join(sorted(names)) or "none" for names in (saved.own_probes, given))
        raise InputError(
            f"{saved.directory}: this run was begun in Python with probes of its own: {begun}; given are: {now}; "
            "go on with resume(..., probes={...}) and the same functions"
        )


def refuse_other_bits(saved: SavedRun, provenance: dict[str, Any]) -> None:
    """Refuse to go on with what would round otherwise than what there is.

    :raises InputError: other versions, another back end, precision or solver.
    """
    for key in ("taichi_membrane", "taichi", "numpy", "scipy", "arch", "precision", "solver"):
        before, now = saved.provenance.get(key), provenance[key]
        if before != now:
            raise InputError(
                f"{saved.directory}: this run was begun with {key} {before}, and here it is {now}: the rest would not be "
                "what it would have been; run its scene again"
            )
