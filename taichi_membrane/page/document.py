"""The page itself: verdict, viewer, tables, in one file that asks nothing of a network."""

from __future__ import annotations

import base64
import hashlib
import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from taichi_membrane.errors import InputError
from taichi_membrane.output.atomic import replacing
from taichi_membrane.output.case_tables import failed_lines
from taichi_membrane.output.tables import with_unit
from taichi_membrane.page.content import head_and_block
from taichi_membrane.page.tables import all_tables
from taichi_membrane.simulation.results import RunResult
from taichi_membrane.simulation.utilisation import by_stage, words

PAGE = "report.html"
_OUTCOMES = {
    "finished": ("good", "Finished: all stages were run to their end, and every load step converged."),
    "collapse": ("warning", "Collapse: the structure met its largest stable load before its last load."),
    "no collapse": ("bad", "No collapse: a stage that should meet its largest stable load met none."),
    "steps used up": ("bad", "Steps used up: a stage along the equilibrium path did not come to its loads."),
    "not converged": ("bad", "Not converged: no equilibrium was found; what is shown ends at the last one that was."),
    "interrupted": ("bad", "Interrupted: the run was stopped before its end."),
}


def write_page(result: RunResult, path: Path) -> int:
    """Write a run as one page of HTML; returns its size in bytes.

    :raises InputError: the run has no load steps; the file cannot be written.
    """
    text = page(result).encode("utf-8")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")
    with replacing(path) as temporary:
        temporary.write_bytes(text)
    return len(text)


def page(result: RunResult) -> str:
    """A run as a page of HTML.

    Nothing in it is run but the viewer: the policy names the hash of the script and of the style, and lets no request out.

    :raises InputError: the run has no load steps.
    """
    if not result.steps:
        raise InputError(f"{result.directory or result.scene.name}: this run has no load steps to show")
    scene = result.scene
    head, block = head_and_block(result)
    style, script = _shipped("page.css"), _shipped("viewer.js")
    policy = f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src data: blob:"
    title = escape(scene.title or scene.name)
    body = _shipped("body.html").format(
        title=title,
        description=f"<p>{escape(scene.description)}</p>" if scene.description else "",
        verdict=_verdict(result),
        facts=_facts(result),
        tables="\n".join(table.html() for table in all_tables(result)),
        last=len(result.steps) - 1,
        notice=escape(_shipped("THREE-LICENSE")),
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title>\n<style>{style}</style></head>\n<body>\n{body}\n"
        f'<script type="application/json" id="head">{_json(head)}</script>\n'
        f'<script type="text/plain" id="data">{block}</script>\n<script>{script}</script>\n</body></html>\n'
    )


def _shipped(name: str) -> str:
    return files("taichi_membrane.page").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}"


def _json(content: Any) -> str:
    """JSON that no name in it can end: without the sign that begins a tag."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _verdict(result: RunResult) -> str:
    """How the run ended and why, and which checks fail."""
    kind, words = _OUTCOMES[result.outcome]
    lines = [f'<p class="{kind}">{words}</p>']
    for step in result.steps:
        missed = step is result.stage_steps[-1] and result.outcome in ("no collapse", "steps used up")
        if not step.converged or step.limit is not None or missed:
            lines.append(f"<p>Step {step.number} ({escape(step.stage)} {step.stage_step}): {escape(step.reason)}</p>")
    if result.cases:
        failing_cases = failed_lines(result)
        reached = f"{len(result.cases) - len(failing_cases)} of {len(result.cases)} load cases are reached"
        lines.append(f'<p class="{"bad" if failing_cases else "good"}">{reached}.</p>')
        lines += [f"<p>{escape(line)}</p>" for line in failing_cases]
    if result.checks:
        failing = [check for check in result.checks if not check.passed]
        held = f"{len(result.checks) - len(failing)} of {len(result.checks)} checks hold"
        names = ", ".join(f"{check.probe} at {check.stage} {check.step}" for check in failing)
        lines.append(
            f'<p class="{"bad" if failing else "good"}">{held}{escape(f"; failing: {names}") if failing else ""}.</p>'
        )
    else:
        lines.append("<p>The scene has no checks.</p>")
    return "\n".join(lines)


def _facts(result: RunResult) -> str:
    """Size of the model and the largest values over all converged steps."""
    scene, mesh = result.scene, result.mesh
    facts = [("model", f"{mesh.tri_count} elements, {mesh.node_count} nodes, {len(result.steps)} load steps")]
    steps = [step for step in result.steps if step.converged]
    if steps:
        moved = [np.linalg.norm(step.displacement, axis=1) for step in steps]
        far = int(np.argmax([lengths.max() for lengths in moved]))
        strained = int(np.argmax([step.elements.major_resultant.max() for step in steps]))
        force = steps[strained].elements.major_resultant
        node, element = int(moved[far].argmax()), int(force.argmax())
        distance = with_unit(float(moved[far][node]), scene.units.length)
        largest = with_unit(float(force[element]), f"{scene.units.resultant} Cauchy")
        facts += [
            ("largest displacement", f"{distance}, step {steps[far].number}, node {node}"),
            ("largest resultant", f"{largest}, step {steps[strained].number}, element {element}"),
        ]
    used = list(by_stage(result).values())
    if used:
        step, most = max(used, key=lambda one: one[1].value)
        facts.append(("largest utilisation", f"{words(most, scene)}, step {step.number}"))
    return "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>" for name, text in facts)
