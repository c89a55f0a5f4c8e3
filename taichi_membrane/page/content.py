"""What the page's viewer needs of a run: a head of plain data, and the packed block of its arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh
from taichi_membrane.names import STATE_NAMES
from taichi_membrane.output.curve import curve_steps, quantity_label, quantity_names
from taichi_membrane.output.tables import step_words
from taichi_membrane.page import geometry
from taichi_membrane.page.fields import DISPLACEMENT, REACTION, shown, unit
from taichi_membrane.page.pack import FULL_SCALE, Entry, Pack, finite_range
from taichi_membrane.pictures.colours import CABLE_RAMP, PALETTE, RAMP
from taichi_membrane.scene import Scene
from taichi_membrane.scene.drivers import driver_label
from taichi_membrane.simulation.load_marks import load_marks
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.results import Floats, RunResult, StepResult

# How far marks keep apart, in radii of all that is shown: near enough to tell the field, far enough to be told from each other.
WRINKLE_LINES, SUPPORTS, ARROWS = 0.03, 0.04, 0.25
_VIEWS = {
    "displacement": "displacement.size",
    "prestress": "prestress_warp",
    "free_strain": "free_strain_warp",
}  # the camera's field as the page calls it, where that differs


def head_and_block(result: RunResult) -> tuple[dict[str, Any], str]:
    """The head, ready for JSON, and the block as base64; the head's entries say where each array lies in the block."""
    scene, mesh, steps = result.scene, result.mesh, result.steps
    if mesh.order == 2:
        raise InputError("report: pages of runs with six-node triangles (mesh.order = 2) are not implemented")
    pack = Pack()
    centre, radius = geometry.bounding_sphere(mesh, steps)
    ranges = {field.name: finite_range([field.read(step) for step in steps]) for field in shown(scene)}
    held = np.flatnonzero(np.any([(step.reaction != 0.0).any(axis=1) for step in steps], axis=0))
    means = geometry.node_means(mesh)
    head = {
        "node_count": mesh.node_count,
        "element_count": mesh.tri_count,
        "units": {"length": scene.units.length, "force": scene.units.force, "stress": scene.units.stress},
        "centre": centre.tolist(),
        "radius": radius or 1.0,
        "camera": {"azimuth": scene.camera.azimuth, "elevation": scene.camera.elevation},
        "field": _VIEWS.get(scene.camera.field, scene.camera.field),
        "states": STATE_NAMES,
        "palette": np.rint(255 * PALETTE).astype(int).tolist(),
        "ramp": np.rint(255 * RAMP).astype(int).tolist(),
        "points": pack.add((mesh.points - centre).T, "f32"),
        "triangles": pack.add(mesh.triangles, "u32"),
        "fields": [
            {"name": f.name, "title": f.title, "unit": unit(scene, f.unit), "note": f.note,
             "low": ranges[f.name][0], "high": ranges[f.name][1]}
            for f in shown(scene)
        ],
        "vectors": [
            {"name": v.name, "title": v.title, "unit": unit(scene, v.unit), "note": "", "nodes": nodes}
            for v, nodes in ((DISPLACEMENT, None), (REACTION, pack.add(held, "u32")))
        ],
        "cables": _cables(pack, result),
        "steps": [_step(pack, scene, mesh, step, ranges, held, means) for step in steps],
        **_marks(pack, result, radius),
        "node_groups": _groups(pack, mesh.node_groups),
        "element_groups": _groups(pack, mesh.tri_groups),
        "quantities": [
            {"name": name, "label": quantity_label(scene, name), "values": [_plain(s.quantity(name)) for s in steps]}
            for name in quantity_names(scene)
        ],
        "curve": _curve(result),
    }  # fmt: skip
    return head, pack.text()


def _step(
    pack: Pack,
    scene: Scene,
    mesh: Mesh,
    step: StepResult,
    ranges: dict[str, tuple[float, float]],
    held: Any,
    means: csr_array,
) -> dict[str, Any]:
    elements = step.elements
    area = np.bincount(elements.state, weights=mesh.tri_areas(), minlength=3)
    return {
        "words": f"step {step.number}: {step_words(scene, step)}",
        "converged": step.converged,
        "shares": (area / area.sum()).tolist(),
        "state": pack.add(elements.state, "u8"),
        "cable_force": pack.add(step.cable_forces, "f32"),
        "direction": pack.add(geometry.direction_codes(mesh, step), "u8"),
        "taut_margin": _margin(pack, means @ elements.taut_margin),
        "slack_margin": _margin(pack, means @ elements.slack_margin),
        "fields": {f.name: pack.add_field(f.read(step), *ranges[f.name]) for f in shown(scene)},
        "extremes": {f.name: _extremes(f.read(step)) for f in shown(scene)},
        "vectors": {
            DISPLACEMENT.name: pack.add_vectors(step.displacement),
            REACTION.name: pack.add_vectors(step.reaction[held]),
        },
    }


def _cables(pack: Pack, result: RunResult) -> dict[str, Any]:
    """Nodes of the straight pieces of cables, and the range of the forces of those that are not slack; null where there is none."""
    nodes = line_elements(result.scene, result.mesh)[0]
    forces = np.concatenate([np.zeros(0), *(step.cable_forces for step in result.steps)])
    taut = forces[np.isfinite(forces) & (forces != 0.0)]
    return {
        "count": len(nodes),
        "nodes": pack.add(nodes, "u32"),
        "low": float(taut.min()) if taut.size else None,
        "high": float(taut.max()) if taut.size else None,
        "ramp": np.rint(255 * CABLE_RAMP).astype(int).tolist() if len(nodes) else [],
    }


def _extremes(values: Floats) -> tuple[int, int] | None:
    """Elements of the least and the largest finite value."""
    finite = np.flatnonzero(np.isfinite(values))
    return (int(finite[values[finite].argmin()]), int(finite[values[finite].argmax()])) if finite.size else None


def _margin(pack: Pack, values: Floats) -> Entry:
    """Only where a margin crosses zero is shown: any scale will do, and a sign must not be lost by rounding."""
    codes = np.rint(values * FULL_SCALE / (float(np.abs(values).max(initial=0.0)) or 1.0))
    return pack.add(np.where((codes == 0.0) & (values < 0.0), -1.0, codes), "i16")


def _marks(pack: Pack, result: RunResult, radius: float) -> dict[str, Any]:
    """Elements that may carry a wrinkle line, supported nodes, and loads with the nodes that carry an arrow."""
    scene, mesh, steps = result.scene, result.mesh, result.steps
    middles = mesh.points[mesh.triangles].mean(axis=1)
    holding = [mesh.node_groups[group] for group, _ in scene.holding]
    supported = np.unique(np.concatenate([np.zeros(0, dtype=np.int32), *holding]))
    loads = []
    for name in scene.loads:
        marks = load_marks(scene, mesh, name)
        if marks is None:
            continue
        nodes, direction = marks
        factors = [step.loads[name] for step in steps]
        loads.append(
            {
                "direction": direction.tolist(),
                "nodes": pack.add(nodes[geometry.apart(mesh.points[nodes], ARROWS * radius)], "u32"),
                "factors": [_plain(factor) for factor in factors],
                "labels": [
                    f"{name} {abs(factor):.4g} {driver_label(scene, f'load.{name}')}" for factor in factors
                ],  # the arrow turns
            }
        )
    return {
        "wrinkle_marks": {
            "elements": pack.add(geometry.apart(middles, WRINKLE_LINES * radius), "u32"),
            "half_length": 0.4 * WRINKLE_LINES * radius,
        },
        "supports": pack.add(supported[geometry.apart(mesh.points[supported], SUPPORTS * radius)], "u32"),
        "loads": loads,
    }


def _groups(pack: Pack, groups: Any) -> list[dict[str, Any]]:
    return [{"name": name, "members": pack.add(members, "u32")} for name, members in groups.items() if name != "all"]


def _curve(result: RunResult) -> dict[str, Any]:
    """The scene's curve; else the first probe over the first load, motion or pressure."""
    scene = result.scene
    curve = scene.curve
    if curve is None:
        names = quantity_names(scene)
        acting = [name for kind in ("load.", "motion.", "pressure.") for name in names if name.startswith(kind)]
        x, y = names[0], acting[0] if acting else "volume"
        plain = {"x_scale": 1.0, "y_scale": 1.0, "references": [], "lines": []}
        shown = [step.number for step in result.steps if step.converged]
        labels = {"x_label": quantity_label(scene, x), "y_label": quantity_label(scene, y)}
        return {"x": x, "y": y, **plain, **labels, "steps": shown}
    return {
        "x": _full_name(scene, curve.x),
        "y": _full_name(scene, curve.y),
        "x_scale": curve.x_scale,
        "y_scale": curve.y_scale,
        "x_label": curve.x_label or quantity_label(scene, curve.x),
        "y_label": curve.y_label or quantity_label(scene, curve.y),
        "references": [one.model_dump() for one in curve.references],
        "lines": [line.model_dump() for line in curve.lines],
        "steps": [step.number for step in curve_steps(result, curve)],
    }


def _full_name(scene: Scene, quantity: str) -> str:
    """``pressure`` alone is the scene's first one, unless a probe is called so."""
    return (
        f"pressure.{next(iter(scene.pressures))}"
        if quantity == "pressure" and quantity not in scene.probes
        else quantity
    )


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
