"""What every result has to tell of each load step: a value, or why there is none."""

from __future__ import annotations

from taichi_membrane.simulation.results import RunResult


def assert_told(result: RunResult) -> None:
    """``stable``, ``derivatives``, ``modes`` and ``limit`` are each a value or a reason, never both and never neither."""
    for step in result.steps:
        values = {
            "stable": step.stable is not None,
            "derivatives": bool(step.derivatives),
            "modes": step.modes is not None,
            "limit": step.limit is not None,
        }
        where = f"{step.stage} {step.stage_step}"
        assert set(step.unknown) == {name for name, known in values.items() if not known}, where
        assert all(why.strip() for why in step.unknown.values()), where
