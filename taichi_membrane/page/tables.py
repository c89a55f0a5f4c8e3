"""The page's tables; every text is escaped, as names of scenes, groups and files may hold anything."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from taichi_membrane.output.case_tables import case_columns, range_columns, reaction_columns, worst_reaction_columns
from taichi_membrane.output.tables import (
    adaption_columns,
    adaption_line,
    check_columns,
    estimate_columns,
    estimate_notes,
    layer_lines,
    stability_notes,
    step_columns,
)
from taichi_membrane.scene.drivers import kind_named
from taichi_membrane.scene.element_field import given_text
from taichi_membrane.simulation.reactions import support_forces
from taichi_membrane.simulation.results import RunResult


@dataclass(frozen=True)
class Table:
    """A table of text. ``identity`` names it in the page; ``steps`` is the load step that each row belongs to."""

    identity: str
    caption: str
    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    steps: Sequence[int] | None = None
    note: str = ""

    def html(self) -> str:
        """The table as HTML; empty where it has no rows."""
        if not self.rows:
            return ""
        kinds = [' class="number"' if all(map(_is_number, cells)) else "" for cells in zip(*self.rows, strict=True)]
        head = "".join(
            f'<th scope="col"{kind}>{escape(text)}</th>' for text, kind in zip(self.headers, kinds, strict=True)
        )
        steps: Iterable[int | None] = self.steps if self.steps is not None else [None] * len(self.rows)
        rows = "\n".join(_row(row, kinds, step) for row, step in zip(self.rows, steps, strict=True))
        note = f'<p class="quiet">{escape(self.note)}</p>' if self.note else ""
        return (
            f'<section><div class="wide"><table id="{self.identity}"><caption>{escape(self.caption)}</caption>'
            f"<thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table></div>{note}</section>"
        )


def _row(cells: Sequence[str], kinds: Sequence[str], step: int | None) -> str:
    mark = "" if step is None else f' data-step="{step}"'
    return f"<tr{mark}>{''.join(map(_cell, cells, kinds))}</tr>"


def _cell(text: str, kind: str) -> str:
    mark = ' class="bad"' if text in ("FAIL", "FAILED") else kind
    return f"<td{mark}>{escape(text)}</td>"


def _is_number(text: str) -> bool:
    """True for a number with or without unit, and for the words that stand in its place."""
    return "," not in text and (text.lstrip("+-")[:1].isdigit() or text in ("-", "FAILED", "not reached"))


def all_tables(result: RunResult) -> list[Table]:
    """Every table of the page, in order."""
    return [
        *_cases(result), _steps(result), _checks(result), _errors(result), _refined(result), _layers(result),
        _reactions(result), _at_rest(result),
        _supports(result), _loads(result), _fabrics(result), _provenance(result),
    ]  # fmt: skip


def _cases(result: RunResult) -> list[Table]:
    """Verdicts and numbers of the load cases, the worst case of each quantity, support forces."""
    if not result.cases:
        return []
    shown = (
        ("cases", "Load cases", case_columns(result), "Numbers are those at the end of each case that was reached."),
        ("worst", "Worst cases", range_columns(result), "Over the ends of the cases that were reached."),
        (
            "worst-reactions",
            "Largest support forces",
            worst_reaction_columns(result),
            "Forces of the supports on the membrane, as vectors where they are largest; least and largest vertical part.",
        ),
        (
            "case-reactions",
            "Support forces of load cases",
            reaction_columns(result),
            "Forces of the supports on the membrane.",
        ),
    )
    return [
        Table(
            name, caption, [c.header for c in columns], list(zip(*(c.cells for c in columns), strict=True)), None, note
        )
        for name, caption, columns, note in shown
    ]


def _steps(result: RunResult) -> Table:
    columns = step_columns(result.scene, result.steps)
    rows = list(zip(*(column.cells for column in columns), strict=True))
    note = "A row shows its step in the view. Residual: out-of-balance forces over applied forces."
    note += "".join(f" Stability, {which}: {why}." for which, why in stability_notes(result.steps))
    return Table("steps", "Load steps", [c.header for c in columns], rows, range(len(rows)), note)


def _checks(result: RunResult) -> Table:
    columns = check_columns(result.scene, result.checks)
    headers = [*(column.header or "verdict" for column in columns), "source of the reference"]
    cells = [*(column.cells for column in columns), [check.source for check in result.checks]]
    return Table("checks", "Checks", headers, list(zip(*cells, strict=True)))


def _errors(result: RunResult) -> Table:
    if result.estimate is None:
        return Table("errors", "Estimated errors", [], [])
    columns = estimate_columns(result.scene, result.estimate)
    rows = list(zip(*(column.cells for column in columns), strict=True))
    rows += [
        ("", f"{one.stage} {one.stage_step}", "unknown", "", "", "", "") for one in result.estimate.steps if one.unknown
    ]
    note = ". ".join(
        ["Load steps solved again on the mesh cut in four", *estimate_notes(result.estimate, result.layers)]
    )
    return Table("errors", "Estimated errors", [column.header or "share" for column in columns], rows, None, f"{note}.")


def _refined(result: RunResult) -> Table:
    """The meshes of a refinement."""
    if result.adaption is None:
        return Table("refined", "Refinement of the mesh", [], [])
    columns = adaption_columns(result.scene, result.adaption)
    rows = list(zip(*(column.cells for column in columns), strict=True))
    note = f"Errors by each mesh cut in four. {adaption_line(result.adaption)}."
    return Table("refined", "Refinement of the mesh", [column.header for column in columns], rows, None, note)


def _layers(result: RunResult) -> Table:
    lines = layer_lines(result.layers, result.scene.units.length)
    note = "l: distance over which a disturbance of the wall decays; h: height over the line of the elements beside it."
    return Table(
        "layers", "Boundary layers", ["line, and the wall on its sides"], [[line] for line in lines], None, note
    )


def _reactions(result: RunResult) -> Table:
    """Sum of the support forces of each held group, at each converged step."""
    scene, mesh, force = result.scene, result.mesh, result.scene.units.force
    rows, steps = [], []
    for number, step in enumerate(result.steps):
        if not step.converged:
            continue
        for group, total in support_forces(scene, mesh, step).items():
            values = (*total, np.linalg.norm(total))
            rows.append([str(step.number), group, *(f"{value:.5g}" for value in values)])
            steps.append(number)
    headers = ["step", "group", *(f"{name} [{force}]" for name in ("x", "y", "z", "size"))]
    note = "Forces of the supports on the membrane."
    note += (
        " A node of two groups counts in both, and once in the last row of a step." if len(scene.holding) > 1 else ""
    )
    return Table("reactions", "Support forces", headers, rows, steps, note)


def _at_rest(result: RunResult) -> Table:
    rows = []
    for step in result.steps:
        where = f"{step.stage} {step.stage_step}"
        if step.modes is not None:
            rows += [[where, f"{step.modes.kind} mode {k}", f"{v:.6g}"] for k, v in enumerate(step.modes.values, 1)]
            rows += [[where, f"{step.modes.kind} modes", step.modes.missing]] if step.modes.missing else []
        for probe, parts in step.derivatives.items():
            rows += [[where, f"d {probe} / d {parameter}", f"{value:.6g}"] for parameter, value in parts.items()]
    note = "Vibration: frequencies, one over the time unit of the density. Buckling: share of the stage at which it begins."
    return Table("rest", "Modes and derivatives", ["step", "quantity", "value"], rows, None, note)


def _supports(result: RunResult) -> Table:
    rows = [list(one) for one in result.scene.holding]
    return Table("supports-given", "Supports and motions", ["group of nodes", "what is held"], rows)


def _loads(result: RunResult) -> Table:
    scene = result.scene
    rows = [
        [f"pressure {name}", one.group if isinstance(one.group, str) else ", ".join(one.group), one.kind, ""]
        for name, one in scene.pressures.items()
    ]
    for name, load in scene.loads.items():
        direction = ", ".join(f"{part:g}" for part in load.towards or ())
        rows.append([f"load {name}", load.acts_on, load.kind, direction])
    for kind in (kind_named("shrinkage"), kind_named("temperature")):
        for name, item in kind.defined(scene).items():
            group = item.group if isinstance(item.group, str) else ", ".join(item.group)
            rows.append([f"{kind.name} {name}", group, kind.words(item), ""])
    return Table("loads-given", "Pressures and loads", ["name", "group", "kind", "direction"], rows)


def _fabrics(result: RunResult) -> Table:
    scene = result.scene
    default = {} if scene.fabric is None else {"all others" if scene.fabrics else "all": scene.fabric}
    fabrics = default | scene.fabrics
    stress, length = scene.field_units.fabric_stress, scene.units.length
    keys = next(iter(fabrics.values())).moduli_keys  # all fabrics of a scene are given in one way
    rows = [
        [group, *(f"{v:g}" for v in (one.warp_modulus, one.weft_modulus, one.shear_modulus, one.nu)),
         "-" if one.thickness is None else given_text(one.thickness), one.law, given_text(one.given_prestress)]
        for group, one in fabrics.items()
    ]  # fmt: skip
    headers = ["group", *(f"{key.replace('_', ' ')} [{stress}]" for key in keys[1:]), "nu", f"thickness [{length}]",
               "wrinkling law", f"prestress: warp, weft, shear [{stress}]"]  # fmt: skip
    return Table("fabrics", "Fabrics", headers, rows)


def _provenance(result: RunResult) -> Table:
    rows = [
        [name.replace("_", " "), _words(value)] for name, value in result.provenance.items() if value not in ("", None)
    ]
    rows += [[f"time: {phase}", f"{seconds:.1f} s"] for phase, seconds in result.seconds.items()]
    return Table("versions", "Versions, back end and time", ["what", "which"], rows)


def _words(value: object) -> str:
    return ", ".join(map(str, value)) or "none" if isinstance(value, list | tuple) else str(value)
