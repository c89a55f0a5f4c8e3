"""What the command line prints about a scene and about a run: tables that fit the width, and lists."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence, Sized
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from taichi_membrane.mesh import survey
from taichi_membrane.output.tables import (
    Column,
    check_columns,
    error_text,
    stability_notes,
    step_columns,
    tolerance_text,
    with_unit,
)
from taichi_membrane.scene import Cable, Fabric, Scene, Spring, Stage, Units
from taichi_membrane.scene.drivers import DRIVERS, driver_names, driver_unit, friction_words, stage_values
from taichi_membrane.scene.element_field import ElementField, given_text
from taichi_membrane.scene.texts import Conversion
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.chambers import surfaces
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.results import RunResult
from taichi_membrane.simulation.solver_choice import without_potential
from taichi_membrane.simulation.warp import least_angle

_GAP = 2  # blanks between columns


def print_run(console: Console, result: RunResult) -> None:
    """Print the load steps, the checks, times and files of a run."""
    for label, lines in (("mended", result.mesh.mended), ("noted", result.mesh.notes)):
        for line in lines:
            _print_wrapped(console, label, line)
    _print_steps(console, result)
    print_failed_steps(console, result)
    for line in relief_lines(result):
        _print_wrapped(console, "relief", line)
    for line in balance_lines(result):
        _print_wrapped(console, "balance", line)
    for line in wall_lines(result):
        _print_wrapped(console, "contact", line)
    _print_at_rest(console, result)
    _print_unknown(console, result)
    if result.checks:
        console.print()
        _print_table(console, check_columns(result.scene, result.checks))
        print_failed_checks(console, result)
        held = sum(check.passed for check in result.checks)
        _print_plain(console, f"{held} of {len(result.checks)} checks hold")
    console.print()
    spent = ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in result.seconds.items())
    real = result.provenance
    threads = f", {real['threads']} threads" if real["threads"] else ""
    if real["solver_reason"]:
        _print_wrapped(console, "solver", f"{real['solver']} alone: {real['solver_reason']}")
    _print_wrapped(console, "time", f"{spent} ({real['arch']}, {real['precision']}{threads})")
    if result.directory is not None:
        print_files(console, result.directory, result.files)


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


def wall_lines(result: RunResult) -> list[str]:
    """What contact of walls with each other took, and whether sides of elements cross, of the stages' ends."""
    ends = {step.stage: step for step in result.steps if step.converged and step.walls}
    return [
        f"of walls in {stage}: {sum(one.walls['searches'] for one in result.steps if one.stage == stage)} searches, "
        f"{sum(one.walls['patterns'] for one in result.steps if one.stage == stage)} patterns of the matrix; "
        f"{step.walls['crossings']} sides of elements cross others"
        for stage, step in ends.items()
    ]


def _print_at_rest(console: Console, result: RunResult) -> None:
    """Modes and derivatives at the last load step that has them."""
    with_modes = [step for step in result.steps if step.modes is not None]
    if with_modes and with_modes[-1].modes is not None:
        step, modes = with_modes[-1], with_modes[-1].modes
        what = (
            "frequencies [1/time]" if modes.kind == "vibration" else f"buckling at these shares of stage {step.stage}"
        )
        values = ", ".join(f"{value:.6g}" for value in modes.values) or "none"
        values += f" ({modes.missing})" if modes.missing else ""
        console.print()
        _print_wrapped(console, f"{what}, at {step.stage} {step.stage_step}:", values)
    with_derivatives = [step for step in result.steps if step.derivatives]
    if with_derivatives:
        step = with_derivatives[-1]
        parameters = list(next(iter(step.derivatives.values())))
        console.print()
        columns = [Column(f"at {step.stage} {step.stage_step}, d/d…", list(step.derivatives))]
        columns += [Column(p, [f"{of[p]:.6g}" for of in step.derivatives.values()]) for p in parameters]
        _print_table(console, columns)


def _print_unknown(console: Console, result: RunResult) -> None:
    """Why stability is not known of load steps, or not all of it, a line for each reason."""
    for which, why in stability_notes(result.steps):
        _print_wrapped(console, "stability", f"{which}: {why}")


def print_failed_steps(console: Console, result: RunResult) -> None:
    """Print each load step that did not reach its load, and why: collapse, or no equilibrium found."""
    counts = {stage.name: stage.steps for stage in result.scene.stages}
    for step in result.steps:
        where = f"load step {step.number} ({step.stage} {step.stage_step}/{counts[step.stage]})"
        if not step.converged:
            _print_plain(console, f"NOT CONVERGED: {where}: {step.reason}", style="bold red")
        elif step.limit is not None:
            _print_plain(console, f"COLLAPSE: {where}: {step.reason.removeprefix('collapse: ')}", style="bold yellow")
        elif step is result.steps[-1] and result.outcome in ("no collapse", "steps used up"):
            _print_plain(console, f"{result.outcome.upper()}: {where}: {step.reason}", style="bold red")


def print_failed_checks(console: Console, result: RunResult) -> None:
    """Print each check that does not hold, with the source of its reference."""
    for check in result.checks:
        if not check.passed:
            where = f"{check.probe} at {check.stage} {check.step}"
            unit = probe_unit(result.scene, check.probe)
            found = (
                "not reached" if check.value is None else f"{with_unit(check.value, unit)} (error {error_text(check)})"
            )
            wanted = f"{with_unit(check.reference, unit)} within {tolerance_text(check)}"
            _print_plain(
                console, f"CHECK FAILS: {where}: {found}, reference {wanted}: {check.source}", style="bold red"
            )


def print_files(console: Console, directory: Path, files: Iterable[Path]) -> None:
    """Name the files that were written, numbered ones as a range."""
    _print_wrapped(console, f"wrote {directory}:", ", ".join(ranges([path.name for path in files])))


def ranges(names: Sequence[str]) -> list[str]:
    """Join names that differ in their number alone: ``step_0000.vtu … step_0006.vtu``; the order is that of the first of each."""

    def pattern(name: str) -> str:
        return re.sub(r"\d+", "#", name)

    order = {kind: number for number, kind in reversed(list(enumerate(map(pattern, names))))}
    grouped = groupby(sorted(names, key=lambda name: order[pattern(name)]), key=pattern)
    members = [list(group) for _, group in grouped]
    return [group[0] if len(group) == 1 else f"{group[0]} … {group[-1]}" for group in members]


def _print_steps(console: Console, result: RunResult) -> None:
    """The columns every reader needs, and of the others as many as fit the width."""
    columns = step_columns(result.scene, result.steps)
    shown = fitting(columns, console.width)
    _print_table(console, shown)
    if len(shown) < len(columns):
        place = "" if result.directory is None else " (in history.csv)"
        missing = ", ".join(column.header for column in columns if column not in shown)
        _print_wrapped(console, "not shown:", f"{missing}{place}")


def fitting(columns: Sequence[Column], width: int) -> list[Column]:
    """The columns that fit ``width`` characters, in order: all of rank 0, the others by rank while there is room."""
    room = width + _GAP - sum(column.width + _GAP for column in columns if column.rank == 0)
    chosen = []
    for column in sorted((column for column in columns if column.rank > 0), key=lambda column: column.rank):
        if column.width + _GAP <= room:
            room -= column.width + _GAP
            chosen.append(column)
    return [column for column in columns if column.rank == 0 or column in chosen]


def _print_table(console: Console, columns: Sequence[Column]) -> None:
    table = Table(box=None, padding=(0, _GAP, 0, 0), pad_edge=False, header_style="bold")
    for number, column in enumerate(columns):
        words = number < 2 or not any(cell[:1].isdigit() or cell[:1] in "+-" for cell in column.cells)
        table.add_column(Text(column.header), justify="left" if words else "right", overflow="fold")
    for row in zip(*(column.cells for column in columns), strict=True):
        table.add_row(*(Text(cell, style="bold red" if cell in ("FAIL", "FAILED") else "") for cell in row))
    console.print(table)


def _print_plain(console: Console, line: str, style: str = "") -> None:
    console.print(Text(line, style=style), soft_wrap=True)


def _print_wrapped(console: Console, label: str, text: str) -> None:
    """Fill lines up to the width, with a hanging indent; words are never broken."""
    indent = min(len(label) + 1, 12)
    lines = textwrap.wrap(
        f"{label} {text}", console.width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )
    _print_plain(console, "\n".join(lines))


def print_model(
    console: Console,
    model: Model,
    compiled_in: Sequence[str],
    left_out: Sequence[str],
    conversions: Sequence[Conversion] = (),
) -> None:
    """Print what a scene amounts to: units, sizes, groups, fabrics, what acts, what is compiled in.

    :param conversions: the texts with a unit of their own that the scene was written with.
    """
    scene, mesh = model.scene, model.structure.mesh
    units = scene.units
    closed = f"closed, volume {mesh.enclosed_volume():.6g} {units.volume}" if mesh.is_closed else "open"
    area = f"area {mesh.tri_areas().sum():.6g} {units.area}"
    lines = [
        ("scene", f"{scene.name}: {scene.title}" if scene.title else scene.name),
        (
            "units",
            f"{units.length}, {units.force}, stress and pressure in {units.stress}, force per width in {units.resultant}",
        ),
        *(("converted", f"{one.key}: {one.text} is {with_unit(one.value, one.unit)}") for one in conversions),
        ("mesh", f"{scene.mesh.shape}: {mesh.node_count} nodes, {mesh.tri_count} elements, {area}, {closed}"),
        *(("mended", line) for line in mesh.mended),
        *(("noted", line) for line in mesh.notes),
        ("nodes", ", ".join(f"{name}: {len(members)}" for name, members in mesh.node_groups.items())),
        ("elements", ", ".join(f"{name}: {len(members)}" for name, members in mesh.tri_groups.items())),
        *(("lines", f"{len(mesh.lines)}{_counts(mesh.line_groups)}") for _ in range(bool(len(mesh.lines)))),
        *(
            ("loose", f"{len(mesh.loose_points)} points that no element uses{_counts(mesh.loose_groups)}")
            for _ in range(bool(len(mesh.loose_points)))
        ),
        *survey.lines_of(survey.survey(mesh), units.length, units.area, units.volume),
        *(("fabric", line) for line in [*_fabric_lines(scene), *_range_lines(model)]),
        *(
            ("support", f"{item.group}: {item.hold or f'normal {list(item.normal or ())}'} held")
            for item in scene.supports
        ),
        *(
            ("body", f"{name}: {item.group or item.lines}{', held ' if item.told else ''}{item.told}")
            for name, item in scene.bodies.items()
        ),
        *(("anchor", f"{name}: at {list(place)}") for name, place in scene.anchors.items()),
        *(("joint", f"{name}: at {list(place)}") for name, place in scene.joints.items()),
        *(("spring", f"{name}: {_spring_line(item, units)}") for name, item in scene.springs.items()),
        *((kind.name, f"{name}: {kind.words(item)}") for kind in DRIVERS for name, item in kind.defined(scene).items()),
        *(("pressure", line) for line in _potential_lines(model)),
        *(("chamber", line) for line in _chamber_lines(model)),
        *(("cable", f"{name}: {_cable_line(item)}") for name, item in scene.cables.items()),
        *(
            ("plane", f"{name}: through {list(item.through)}, for {item.group}{friction_words(item.friction)}")
            for name, item in scene.planes.items()
        ),
        *(
            ("obstacle", f"{name}: {item.kind}, for {item.group}{friction_words(item.friction)}")
            for name, item in scene.obstacles.items()
            if item.direction is None
        ),
        *([] if scene.contact is None else [("contact", f"of walls with each other: {_grouped(scene.contact.group)}")]),
        *(("stage", _stage_line(scene, stage)) for stage in scene.stages),
        ("probes", ", ".join(scene.probes) or "none"),
        ("checks", str(len(scene.checks)) if scene.checks else "none"),
        ("compiled in", ", ".join(compiled_in) or "nothing beyond the linear element"),
        ("left out", ", ".join(left_out) or "nothing"),
    ]
    before = ""
    for label, text in lines:
        _print_wrapped(console, f"{label if label != before else '':<11}", text)
        before = label


def _grouped(groups: str | list[str]) -> str:
    return groups if isinstance(groups, str) else ", ".join(groups)


def _potential_lines(model: Model) -> list[str]:
    """Whether the follower pressures have a potential, where there are any."""
    if not model.chambers:
        return []
    where = without_potential(model)
    return [f"without a potential in {where}: unsymmetric tangent, no energy" if where else "has a potential"]


def _chamber_lines(model: Model) -> list[str]:
    """Volume, area, sides and holes of what each follower pressure acts on."""
    units, lines = model.scene.units, []
    for chamber in model.chambers:
        parts = surfaces(chamber)
        holed = sum(not part.is_closed for part in parts)
        kind = "closed" if not holed else "open" if len(parts) == 1 else f"{holed} of them open"
        count = f"{len(parts)} surfaces, " if len(parts) > 1 else ""
        volume = f", volume {chamber.volume(model.structure.mesh.points):.6g} {units.volume}" if not holed else ""
        sides = [
            f"{side} {number} elements"
            for side, number in (("behind", int((chamber.sign > 0).sum())), ("before", int((chamber.sign < 0).sum())))
            if number
        ]
        area = f"area {chamber.area:.6g} {units.area}"
        lines.append(f"{chamber.name}: {count}{kind}{volume}, {area}, {' and '.join(sides)}")
    return lines


def _cable_line(cable: Cable) -> str:
    """Where cables run."""
    place = cable.along or cable.lines or " to ".join(cable.nodes or ())
    kind = "sliding cable" if cable.sliding else cable.kind
    parts = f", {cable.parts} parts between two" if cable.parts > 1 else ""
    return f"{kind}, EA {cable.EA:g}, {'from ' if cable.nodes else 'along '}{place}{parts}"


def _spring_line(spring: Spring, units: Units) -> str:
    """What a spring resists, and where."""
    given, way = spring.stiffness, spring.direction
    each = f"{list(given)} in x, y, z" if isinstance(given, tuple) else f"{given:g} along {list(way or ())}"
    bears = "" if spring.kind == "both" else f", {spring.kind} only"
    return f"{each} [{units.force}/{units.length}]{bears}, at each node of {spring.group}"


def _counts(groups: Mapping[str, Sized]) -> str:
    """Names and sizes of groups, after a colon."""
    return f": {', '.join(f'{name}: {len(members)}' for name, members in groups.items())}" if groups else ""


def _fabric_lines(scene: Scene) -> list[str]:
    default = {"all" if not scene.fabrics else "all others": scene.fabric} if scene.fabric is not None else {}
    return [f"{group}: {_fabric_line(scene, fabric)}" for group, fabric in (default | scene.fabrics).items()]


def _fabric_line(scene: Scene, fabric: Fabric) -> str:
    stress, (whole, warp, weft, shear) = scene.field_units.fabric_stress, fabric.moduli_keys
    if fabric.isotropic:
        moduli = f"{whole} = {fabric.warp_modulus:g} {stress}, nu = {fabric.nu:g}"
    else:
        moduli = (
            f"{warp} = {fabric.warp_modulus:g}, {weft} = {fabric.weft_modulus:g}, {shear} = {fabric.shear_modulus:g} {stress}, "
            f"nu = {fabric.nu:g}"
        )
    prestress = (
        f", {fabric.prestress_key} [{given_text(fabric.given_prestress)}] {stress}" if fabric.prestressed else ""
    )
    expansion = f", expansion [{given_text(fabric.expansion)}] 1/K" if any(fabric.expansion) else ""
    thickness = "" if fabric.thickness is None else f", thickness {given_text(fabric.thickness)} {scene.units.length}"
    return f"{moduli}{thickness}, wrinkling law {fabric.law}{prestress}{expansion}"


def _range_lines(model: Model) -> list[str]:
    """What fabrics take from element to element: thickness, prestress, and how near the warp comes to a normal."""
    structure, units = model.structure, model.scene.units
    found = []
    for number, (group, fabric) in enumerate(model.fabric_names()):
        members = structure.tri_fabric == number
        if isinstance(fabric.thickness, ElementField) and members.any():
            values = structure.thickness[members]
            found.append(f"{group}: thickness from {values.min():g} to {values.max():g} {units.length}")
        if isinstance(fabric.given_prestress, ElementField) and members.any():
            low, high = (getattr(structure.prestress[members], which)(axis=0) for which in ("min", "max"))
            named = zip(("warp", "weft", "shear"), low, high, strict=True)
            found.append(
                f"{group}: {fabric.prestress_key} "
                + ", ".join(f"{k} {a:g} to {b:g}" for k, a, b in named)
                + f" {model.scene.field_units.fabric_stress}"
            )
        least = least_angle(model.scene, structure.mesh, structure.tri_fabric, number)
        if least is not None:
            found.append(f"{group}: warp at least {least[0]:.3g}° from the normal (element {least[1]})")
    return found


def _stage_line(scene: Scene, stage: Stage) -> str:
    asked = stage_values(driver_names(scene), stage)
    aims = [
        f"{name.replace('.', ' ')} to {with_unit(value, driver_unit(scene, name))}" for name, value in asked.items()
    ]
    aims += ["finds the rest shape"] if stage.kind == "form_find" else []
    aims += ["by arc length"] if stage.control == "arc_length" else []
    aims += [f"until {stage.until.replace('_', ' ')}"] if stage.until != "target" else []
    aims += [f"valve shut: {', '.join(stage.closed)}"] if stage.closed else []
    aims += [f"joined: {' and '.join(tube)}" for tube in stage.joined]
    return f"{stage.name}: {stage.steps} {'step' if stage.steps == 1 else 'steps'}, {', '.join(aims) or 'no change'}"
