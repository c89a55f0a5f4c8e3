"""The pictures of a run: one frame per load step with one camera and one colour range, the animation, and the curve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from taichi_membrane import fields
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.output.curve import curve_steps, quantity_label
from taichi_membrane.output.tables import step_words
from taichi_membrane.pictures import quarters
from taichi_membrane.pictures.camera import Camera as ViewCamera
from taichi_membrane.pictures.plots import Mark, ReferenceLine, Series, draw_curve
from taichi_membrane.pictures.render import Frame, Look, draw_frame, fit_camera, undeformed_outline, write_animation
from taichi_membrane.scene import Camera, Curve
from taichi_membrane.simulation.cases import envelope
from taichi_membrane.simulation.load_marks import load_marks
from taichi_membrane.simulation.load_state import of_kind
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.obstacle_lines import obstacle_lines
from taichi_membrane.simulation.results import RunResult, StepResult

ENVELOPE = "envelope.png"


def draw_run(result: RunResult, directory: Path, camera: Camera) -> Iterator[Path]:
    """Draw every step, then the animation and the curve; yields each file as it is in place."""
    scene, steps = result.scene, result.steps
    view, look = _view_of(result, camera)
    pictures, box, outline = [], _box(result, camera), None
    for step in steps:
        path, frame = directory / f"step_{step.number:04d}.png", _frame(result, step, camera, box)
        if outline is None:
            outline = undeformed_outline(frame, look=look, camera=view)
        draw_frame(frame, look=look, camera=view, path=path, outline=outline)
        pictures.append(path)
        yield path
    pictures = pictures[: len(result.stage_steps)]  # cases do not follow one another
    if len(pictures) > 1:
        write_animation(pictures, directory / "animation.gif")
        yield directory / "animation.gif"
    if draw_envelope(result, camera, directory / ENVELOPE):
        yield directory / ENVELOPE
    if scene.curve is not None:
        for kind in dict.fromkeys(scene.curve.formats):
            draw_run_curve(result, scene.curve, directory / f"curve.{kind}")
            yield directory / f"curve.{kind}"


def draw_envelope(result: RunResult, camera: Camera, path: Path) -> bool:
    """Draw the largest utilisation of every element over the load cases, or else the largest resultant, on the shape that the first
    case starts from; False, and no picture, where no case was reached."""
    over = envelope(result)
    if over is None:
        return False
    name = "utilisation" if "utilisation" in over.values else "major_resultant"
    values = np.nan_to_num(over.values[name], nan=0.0)  # undefined of fabrics without a strength
    start = result.start(over.cases[0])
    assert start is not None  # a case that was reached has started
    asked = camera.model_copy(update={"field": name, "directions": False, "loads": False})
    view, look = _view_of(replace(result, steps=(start,)), asked)
    frame = _frame(result, start, asked, _box(result, asked))
    high = float(values.max())
    frame = replace(
        frame, scalar=values if result.mesh.order == 1 else quarters.spread(values),
        scalar_label=fields.named(name).label(result.scene.field_units),
        subtitle=f"largest of {len(over.cases)} load cases ({', '.join(over.cases)}), on {start.stage} {start.stage_step}"
        + _magnified(camera),
    )  # fmt: skip
    draw_frame(frame, look=replace(look, scalar_range=(0.0, high or 1.0)), camera=view, path=path)
    return True


def draw_last_step(result: RunResult, camera: Camera, path: Path) -> None:
    """Draw the last step as :func:`draw_run` does, alone."""
    view, look = _view_of(result, camera)
    draw_frame(_frame(result, result.steps[-1], camera, _box(result, camera)), look=look, camera=view, path=path)


def _view_of(result: RunResult, camera: Camera) -> tuple[ViewCamera, Look]:
    """One camera and one look, with one colour range, for all steps of a run."""
    mesh, steps = result.mesh, result.steps
    view = fit_camera(
        [mesh.points, *(_shown(result, step, camera) for step in steps)],
        azimuth=camera.azimuth,
        elevation=camera.elevation,
        projection=camera.projection,
        size=camera.size,
    )
    look = Look(
        field="state" if fields.named(camera.field).picture == "states" else "scalar",
        azimuth=camera.azimuth,
        elevation=camera.elevation,
        projection=camera.projection,
        size=camera.size,
        show_outline=camera.outline,
        show_loads=camera.loads,
        show_supports=camera.supports,
        show_directions=camera.directions,
        show_axes=True,
        scalar_range=_scalar_range(steps, camera),
        cable_range=_cable_range(steps),
    )
    return view, look


def _scalar(step: StepResult, camera: Camera) -> Floats | None:
    """What the colour scale shows, of a vector its length; None where states are shown."""
    if fields.named(camera.field).picture == "states":
        return None
    values = step.fields[camera.field]
    if camera.field == "utilisation":  # undefined of fabrics without a strength
        values = np.nan_to_num(values, nan=0.0)
    return np.asarray(values if values.ndim == 1 else np.linalg.norm(values, axis=1))


def _scalar_range(steps: tuple[StepResult, ...], camera: Camera) -> tuple[float, float] | None:
    """One colour range for the whole run."""
    values = [scalar for scalar in (_scalar(step, camera) for step in steps) if scalar is not None]
    if not values:
        return None
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    return (float(low), float(high)) if high > low else (float(low), float(low) + (abs(float(low)) or 1.0))


def _cable_range(steps: tuple[StepResult, ...]) -> tuple[float, float] | None:
    """Least and largest force of a cable in the whole run, slack ones left out; None where there is none."""
    forces = np.concatenate([step.cable_forces for step in steps])
    taut = forces[forces != 0.0]
    return (float(taut.min()), float(taut.max())) if taut.size else None


def _shown(result: RunResult, step: StepResult, camera: Camera) -> Floats:
    """(n, 3) where nodes are drawn: displaced, so many times as the camera asks."""
    return np.asarray(result.mesh.points + camera.magnify * step.displacement)


def _box(result: RunResult, camera: Camera) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates of all that a run shows."""
    places = [result.mesh.points, *(_shown(result, step, camera) for step in result.steps)]
    return np.min([one.min(axis=0) for one in places], axis=0), np.max([one.max(axis=0) for one in places], axis=0)


def _frame(result: RunResult, step: StepResult, camera: Camera, box: tuple[Floats, Floats]) -> Frame:
    scene, mesh = result.scene, result.mesh
    held = [mesh.node_groups[name] for name in (*(support.group for support in scene.supports), *scene.anchors)]
    points = _shown(result, step, camera)
    elements, scalar = step.elements, _scalar(step, camera)
    state, taut, slack, direction = (
        elements.state, elements.taut_margin, elements.slack_margin, elements.major_direction
    )  # fmt: skip
    if mesh.order == 2:
        state = quarters.states_by_quarter(elements.point_state)
        taut, slack = quarters.by_quarter(elements.point_taut_margin), quarters.by_quarter(elements.point_slack_margin)
        direction = quarters.spread(direction)
        if scalar is not None and fields.named(camera.field).place == "element":
            scalar = quarters.spread(scalar)
    return Frame(
        points=points,
        reference=mesh.points,
        triangles=mesh.flat_triangles,
        state=state,
        taut_margin=taut,
        slack_margin=slack,
        wrinkle_direction=direction,
        scalar=scalar,
        scalar_label=fields.named(camera.field).label(scene.field_units),
        cables=np.asarray(line_elements(scene, mesh)[0], dtype=np.int32),
        cable_force=step.cable_forces,
        cable_label=fields.named("cable_force").label(scene.field_units),
        title=scene.title or scene.name,
        subtitle=step_words(scene, step) + _magnified(camera),
        length_unit=scene.units.length,
        arrows=_arrows(result, step, points),
        supports=np.unique(np.concatenate([np.zeros(0, dtype=np.int32), *held])),
        obstacles=tuple(obstacle_lines(scene, mesh, of_kind(step.drivers, "obstacle"), box)),
    )


def _magnified(camera: Camera) -> str:
    return "" if camera.magnify == 1.0 else f", displacements × {camera.magnify:g}"


def _arrows(result: RunResult, step: StepResult, points: Floats) -> tuple[tuple[Floats, Floats, str], ...]:
    """One arrow per acting load, at the middle of its group; of those at one place and along one direction, one with all names."""
    arrows: list[tuple[Floats, Floats, str]] = []
    for name, factor in step.loads.items():
        load = result.scene.loads[name]
        marks = load_marks(result.scene, result.mesh, name) if factor != 0.0 else None
        if marks is None:
            continue
        nodes, along = marks
        size = float(np.linalg.norm(along))
        label = name
        if load.kind == "total":
            label = f"{abs(factor) * size:.4g} {result.scene.units.force}"
        origin, direction = points[nodes].mean(axis=0), np.sign(factor) * along / size
        for number, (place, way, text) in enumerate(arrows):
            if np.array_equal(place, origin) and np.allclose(way, direction, rtol=0.0, atol=1e-3):
                arrows[number] = (place, way, f"{text}, {label}")
                break
        else:
            arrows.append((origin, direction, label))
    return tuple(arrows)


def draw_run_curve(result: RunResult, curve: Curve, path: Path) -> None:
    """Draw the computed curve, references, lines, and the first step with wrinkles as a mark; PNG, SVG or PDF."""
    steps = curve_steps(result, curve)
    x = curve.x_scale * np.array([step.quantity(curve.x) for step in steps])
    y = curve.y_scale * np.array([step.quantity(curve.y) for step in steps])
    marks = []
    wrinkled = [step.elements.count()["wrinkled"] > 0 for step in steps]
    if any(wrinkled) and not wrinkled[0]:
        first = wrinkled.index(True)
        marks.append(Mark(label="first step with wrinkles", x=float(x[first]), y=float(y[first])))
    draw_curve(
        path,
        series=[
            Series(label="computed", x=x, y=y, style="computed"),
            *(Series(label=r.label, x=np.array(r.x), y=np.array(r.y), style="reference") for r in curve.references),
        ],
        x_label=curve.x_label or quantity_label(result.scene, curve.x),
        y_label=curve.y_label or quantity_label(result.scene, curve.y),
        title=result.scene.title or result.scene.name,
        lines=[ReferenceLine(label=line.label, axis=line.axis, value=line.value) for line in curve.lines],
        marks=marks,
    )
