"""What a run says beside its tables, a line each: relief valves, the balance of all forces, contact of walls."""

from __future__ import annotations

from taichi_membrane.output.tables import with_unit
from taichi_membrane.simulation.results import RunResult


def relief_lines(result: RunResult) -> list[str]:
    """Where relief valves opened, a line for each chamber and load step."""
    scene = result.scene
    return [
        f"of {name} opened at load step {step.number}, at {with_unit(step.pressures[name], scene.units.stress)}: let out "
        f"{with_unit(amount, scene.units.volume)} of gas at {with_unit(scene.pressures[name].ambient or 0.0, scene.units.stress)}"
        for step in result.steps
        for name, amount in step.relieved.items()
    ]


def balance_lines(result: RunResult) -> list[str]:
    """The resultants of all that acts at the end of each stage, and how nearly they cancel."""
    ends = {step.stage: step for step in result.steps if step.converged}
    unit = result.scene.units.force
    return [
        f"of forces at the end of {stage}: "
        + ", ".join(
            f"{name} ({', '.join(f'{part:.4g}' for part in vector)}) {unit}" for name, vector in step.balance.items()
        )
        + f"; together {step.imbalance:.1e} of the largest"
        for stage, step in ends.items()
    ]


def cascade_lines(result: RunResult) -> list[str]:
    """How the run came from coarse meshes to its own."""
    told = result.cascade
    if told is None:
        return []
    solved = zip(told.elements, told.iterations, told.seconds, strict=False)
    meshes = ", ".join(
        f"{elements} elements {iterations} iterations in {seconds:.1f} s" for elements, iterations, seconds in solved
    )
    rest = len(result.steps) - told.carried
    lines = [f"of meshes: {meshes}; {told.carried} of {len(result.steps)} load steps carried over"]
    if rest > 0:
        why = told.reason or "the coarse mesh comes no further"
        lines.append(f"FELL BACK for {rest} load steps, solved on the finest mesh alone: {why}")
    return lines


def wall_lines(result: RunResult) -> list[str]:
    """What contact of walls with each other took, and whether sides of elements cross, of the stages' ends."""
    ends = {step.stage: step for step in result.steps if step.converged and step.walls}
    return [
        f"of walls in {stage}: {sum(one.walls['searches'] for one in result.steps if one.stage == stage)} searches, "
        f"{sum(one.walls['patterns'] for one in result.steps if one.stage == stage)} patterns of the matrix; "
        f"{step.walls['crossings']} sides of elements cross others"
        for stage, step in ends.items()
    ]
