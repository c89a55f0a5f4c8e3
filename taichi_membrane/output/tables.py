"""The tables of load steps and of checks, as text: the command line and the page of a run show the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import driver_label, driver_names, driver_unit
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.accuracy import COARSEST, Adaption, Estimate, Layer, LayerSide, Round
from taichi_membrane.simulation.policy import told
from taichi_membrane.simulation.results import CheckResult, StepResult

_ROUND_OFF = 1e-12  # a table shows as 0 what is smaller than this share of its column's largest value

UNRESOLVED = f"not resolved (h/l above {COARSEST:g}): an error estimate does not contain it"


@dataclass(frozen=True)
class Column:
    """Header and cells of a table's column; columns of rank 0 are always shown, others where there is room, 1 before 2."""

    header: str
    cells: list[str]
    rank: int = 0

    @property
    def width(self) -> int:
        """Characters of the widest cell."""
        return max(map(len, [self.header, *self.cells]))


def check_columns(scene: Scene, checks: Sequence[CheckResult]) -> list[Column]:
    """The table of checks: value, reference or bounds, error, tolerance, verdict."""
    return [
        Column("check", [check.probe for check in checks]),
        Column("at", [f"{check.stage} {check.step}" for check in checks]),
        Column("value", ["not reached" if check.value is None else f"{check.value:.6g}" for check in checks]),
        Column("reference", [reference_text(scene, check) for check in checks]),
        Column("error", [error_text(check) for check in checks]),
        Column("tolerance", [tolerance_text(check) for check in checks]),
        Column("", ["pass" if check.passed else "FAIL" for check in checks]),
    ]


def reference_text(scene: Scene, check: CheckResult) -> str:
    """What a check's value should be: a reference, or bounds."""
    unit = probe_unit(scene, check.probe)
    if check.reference is not None:
        return with_unit(check.reference, unit)
    bounds = (("≥", check.at_least), ("≤", check.at_most))
    return ", ".join(f"{sign} {with_unit(bound, unit)}" for sign, bound in bounds if bound is not None)


def error_text(check: CheckResult) -> str:
    """Error of a check, in percent where its tolerance is relative; of bounds by how much the worse one is passed."""
    if check.error is None:
        return "-"
    return f"{100 * check.error:+.2g} %" if check.relative else f"{check.error:+.3g}"


def tolerance_text(check: CheckResult) -> str:
    """Tolerance of a check, in percent where it is relative; bounds have none."""
    if check.reference is None:
        return "-"
    return f"{100 * check.tolerance:.3g} %" if check.relative else f"{check.tolerance:.3g}"


def with_unit(value: float, unit: str) -> str:
    """A number with its unit; none after a mere number."""
    return f"{value:.6g} {unit}".rstrip()


def step_columns(scene: Scene, steps: Sequence[StepResult]) -> list[Column]:
    """The table of load steps in full width; what the steps change ranks above what stays the same."""
    counts = {stage.name: stage.steps for stage in scene.ramps}
    states = [step.elements.count() for step in steps]
    sizes = [len(step.elements.state) for step in steps]
    slack = [f"{count['slack'] / size:.1%}" for count, size in zip(states, sizes, strict=True)]
    solvers = [step.solver for step in steps]
    stability = [stability_text(step) for step in steps]
    ways = [told(step.trace) for step in steps]
    return [
        Column("step", [str(step.number) for step in steps]),
        Column("stage", [f"{step.stage} {step.stage_step}/{counts[step.stage]}" for step in steps]),
        *(
            number_column(_short(name), driver_unit(scene, name), [step.drivers[name] for step in steps])
            for name in driver_names(scene)
        ),
        *(
            number_column(
                name, probe_unit(scene, name) if name in scene.probes else "", [step.probes[name] for step in steps]
            )
            for name in (steps[0].probes if steps else scene.probes)
        ),
        replace(number_column("volume", scene.units.volume, [step.volume for step in steps]), rank=2),
        Column("wrinkled", [f"{count['wrinkled'] / size:.1%}" for count, size in zip(states, sizes, strict=True)]),
        Column("slack", slack, rank=_rank(slack)),
        Column("solver", solvers, rank=_rank(solvers)),
        Column("iterations", [str(step.iterations) for step in steps]),
        Column("stability", stability, rank=0 if any(word.startswith("unstable") for word in stability) else 3),
        Column("way", ways, rank=_rank(ways)),
        Column("residual", [f"{step.residual:.1e}" if step.converged else "FAILED" for step in steps]),
    ]


def _short(driver: str) -> str:
    """A driver's name without its kind, but where that is a chamber's, whose pressure has the bare name."""
    kind, _, name = driver.partition(".")
    return f"{name} {kind}" if kind in ("amount", "ambient") else name


def stability_text(step: StepResult) -> str:
    """The verdict on an equilibrium, with the number of unstable modes."""
    if step.stable is None:
        return "not told" if step.negative_pivots is None else "no divergence"
    return "stable" if step.stable else f"unstable ({step.negative_pivots})"


def stability_notes(steps: Sequence[StepResult]) -> list[tuple[str, str]]:
    """Load steps in a row of whose stability not all is known, and why."""
    notes = []
    for (why, verdict), group in groupby(steps, lambda step: (step.unknown.get("stable", ""), stability_text(step))):
        numbers = [step.number for step in group]
        if why:
            which = f"load step {numbers[0]}" if len(numbers) == 1 else f"load steps {numbers[0]} to {numbers[-1]}"
            notes.append((f"{verdict} of {which}" if verdict == "not told" else which, why))
    return notes


def layer_lines(layers: Sequence[Layer], unit: str) -> list[str]:
    """What a mesh does with boundary layers, a line for all lines of one kind: that whose elements are longest for their layer."""
    kinds: dict[tuple[str, ...], list[Layer]] = {}
    for layer in layers:
        kinds.setdefault(layer.causes, []).append(layer)
    lines = []
    for causes, found in kinds.items():
        worst = max(found, key=lambda one: max((side.ratio or 0.0 for side in one.sides), default=0.0))
        count = f" ({len(found)} lines)" if len(found) > 1 else ""
        text = f"{', '.join(causes)}{count}: {'; '.join(_layer_side(side, unit) for side in worst.sides)}"
        lines.append(f"{text}. WARNING: {UNRESOLVED}" if worst.resolved is False else text)
    return lines


def _layer_side(side: LayerSide, unit: str) -> str:
    """One side of a line in words."""
    size = f"{side.side} h = {side.size:.3g} {unit}"
    if side.length is None or side.ratio is None:
        return f"{size}, l unknown ({side.unknown})"
    return f"{size}, l = {side.length:.3g} {unit}, h/l = {side.ratio:.2g}"


def estimate_columns(scene: Scene, estimate: Estimate) -> list[Column]:
    """The table of error estimates: each probe on its own mesh and on that cut in four, and the error that these tell."""
    rows = [(step, name, one) for step in estimate.steps for name, one in step.probes.items()]
    units = [probe_unit(scene, name) if name in scene.probes else "" for _, name, _ in rows]
    shares = [100.0 * one.error / abs(one.value) if one.value else None for _, _, one in rows]
    return [
        Column("probe", [name for _, name, _ in rows]),
        Column("at", [f"{step.stage} {step.stage_step}" for step, _, _ in rows]),
        Column("value", [with_unit(one.value, unit) for (_, _, one), unit in zip(rows, units, strict=True)]),
        Column("cut in four", [f"{one.fine:.6g}" for _, _, one in rows]),
        Column("error", [f"{one.error:+.2g}" for _, _, one in rows]),
        Column("", ["-" if share is None else f"{share:+.2g} %" for share in shares]),
        Column("order taken", [f"{one.order:g}" for _, _, one in rows]),
    ]


def estimate_notes(estimate: Estimate, layers: Sequence[Layer]) -> list[str]:
    """Of which load steps errors are not known, and why; and what the estimates do not contain."""
    notes = [f"unknown at {one.stage} {one.stage_step}: {one.unknown}" for one in estimate.steps if one.unknown]
    if not any(step.probes for step in estimate.steps):
        return notes
    left_out = [f"the estimates do not contain {words}" for words in estimate.left_out]
    missed = [", ".join(causes) for causes in dict.fromkeys(one.causes for one in layers if one.resolved is False)]
    if missed:
        left_out.append(
            f"WARNING: the estimates do not contain what layers that are not resolved do ({'; '.join(missed)})"
        )
    return notes + left_out


def number_column(name: str, unit: str, values: list[float]) -> Column:
    """A column of numbers; round-off beside large values is shown as 0."""
    negligible = _ROUND_OFF * max(map(abs, values), default=0.0)
    cells = [f"{0.0 if abs(value) < negligible else value:.5g}" for value in values]
    return Column(f"{name} [{unit}]" if unit else name, cells, rank=_rank(cells))


def _rank(cells: list[str]) -> int:
    return 1 if len(set(cells)) > 1 else 2


def step_words(scene: Scene, step: StepResult) -> str:
    """A load step in one line: stage, what acts, and whether it is an equilibrium."""
    count = scene.ramp(step.stage).steps
    parts = [f"{step.stage} {step.stage_step}/{count}"]
    alone = len(step.pressures) == 1
    for driver, value in step.drivers.items():
        if value:
            words = "p" if driver.startswith("pressure.") and alone else _short(driver)
            parts.append(f"{words} = {value:.4g} {driver_label(scene, driver)}".rstrip())
    if not step.converged:
        parts.append("NOT CONVERGED: last equilibrium")
    elif step.limit is not None:
        parts.append("largest stable load")
    return ", ".join(parts)


def round_text(scene: Scene, probe: str, found: Round) -> str:
    """A mesh of a refinement in words."""
    unit = probe_unit(scene, probe)
    error = "error not known" if found.error is None else f"error {found.error:+.2g} {unit}"
    text = f"{probe} {with_unit(found.value, unit)}, {error}, allowed {found.allowed:.2g}"
    return f"{text}; layers not resolved: {'; '.join(found.layers)}" if found.layers else text


def adaption_columns(scene: Scene, adaption: Adaption) -> list[Column]:
    """The table of a refinement, a row for each mesh."""
    rounds, unit = adaption.rounds, probe_unit(scene, adaption.probe)
    return [
        Column("elements", [str(one.tri_count) for one in rounds]),
        Column(f"{adaption.probe} [{unit}]" if unit else adaption.probe, [f"{one.value:.6g}" for one in rounds]),
        Column("cut in four", ["-" if one.fine is None else f"{one.fine:.6g}" for one in rounds]),
        Column("error", ["unknown" if one.error is None else f"{one.error:+.2g}" for one in rounds]),
        Column("allowed", [f"{one.allowed:.2g}" for one in rounds]),
        Column("layers missed", [str(len(one.layers)) for one in rounds]),
        Column("seconds", [f"{one.seconds:.1f}" for one in rounds]),
    ]


def adaption_line(adaption: Adaption) -> str:
    """What became of a refinement."""
    told = f"{adaption.verdict}: {adaption.told}" if adaption.told else adaption.verdict
    if adaption.reached:
        return f"{told}: the estimated error of {adaption.probe} is within what is allowed; new nodes lie on {adaption.surface}"
    return f"NOT REACHED for {adaption.probe}: {told}; new nodes lie on {adaption.surface}"
