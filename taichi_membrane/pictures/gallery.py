"""The pictures of a run: one frame per load step with one camera and one colour range, the animation, and the curve."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from taichi_membrane import fields
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.pictures.plots import Mark, ReferenceLine, Series, draw_curve
from taichi_membrane.pictures.render import Frame, Look, draw_frame, fit_camera, write_animation
from taichi_membrane.scene import Camera, Curve, Scene
from taichi_membrane.scene.drivers import driver_unit, kind_named
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.results import RunResult, StepResult


def draw_run(result: RunResult, directory: Path, camera: Camera) -> Iterator[Path]:
    """Draw every step, then the animation and the curve; yields each file as it is in place."""
    scene, mesh, steps = result.scene, result.mesh, result.steps
    view = fit_camera(
        [mesh.points, *(mesh.points + step.displacement for step in steps)],
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
    )
    pictures = []
    for step in steps:
        path = directory / f"step_{step.number:04d}.png"
        draw_frame(_frame(result, step, camera), look=look, camera=view, path=path)
        pictures.append(path)
        yield path
    if len(pictures) > 1:
        write_animation(pictures, directory / "animation.gif")
        yield directory / "animation.gif"
    if scene.curve is not None:
        draw_run_curve(result, scene.curve, directory / "curve.png")
        yield directory / "curve.png"


def _scalar(step: StepResult, camera: Camera) -> Floats | None:
    """What the colour scale shows, of a vector its length; None where states are shown."""
    if fields.named(camera.field).picture == "states":
        return None
    values = step.fields[camera.field]
    return np.asarray(values if values.ndim == 1 else np.linalg.norm(values, axis=1))


def _scalar_range(steps: tuple[StepResult, ...], camera: Camera) -> tuple[float, float] | None:
    """One colour range for the whole run."""
    values = [scalar for scalar in (_scalar(step, camera) for step in steps) if scalar is not None]
    if not values:
        return None
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    return (float(low), float(high)) if high > low else (float(low), float(low) + (abs(float(low)) or 1.0))


def _frame(result: RunResult, step: StepResult, camera: Camera) -> Frame:
    scene, mesh = result.scene, result.mesh
    count = next(stage.steps for stage in scene.stages if stage.name == step.stage)
    held = [mesh.node_groups[support.group] for support in scene.supports]
    points = mesh.points + step.displacement
    return Frame(
        points=points,
        reference=mesh.points,
        triangles=mesh.triangles,
        state=step.elements.state,
        taut_margin=step.elements.taut_margin,
        slack_margin=step.elements.slack_margin,
        wrinkle_direction=step.elements.major_direction,
        scalar=_scalar(step, camera),
        scalar_label=fields.named(camera.field).label(scene.units),
        title=scene.title or scene.name,
        subtitle=_subtitle(scene, step, count),
        length_unit=scene.units.length,
        arrows=_arrows(result, step, points),
        supports=np.unique(np.concatenate([np.zeros(0, dtype=np.int32), *held])),
    )


def _subtitle(scene: Scene, step: StepResult, count: int) -> str:
    parts = [f"{step.stage} {step.stage_step}/{count}"]
    alone = len(step.pressures) == 1
    for driver, value in step.drivers.items():
        kind, _, name = driver.partition(".")
        if value:
            parts.append(
                f"{'p' if kind == 'pressure' and alone else name} = {value:.4g} {_unit(scene, driver)}".rstrip()
            )
    if not step.converged:
        parts.append("NOT CONVERGED: last equilibrium")
    elif step.limit is not None:
        parts.append("largest stable load")
    return ", ".join(parts)


def _unit(scene: Scene, driver: str) -> str:
    """Unit of a driver's value, or what the value multiplies."""
    unit = driver_unit(scene, driver)
    return "× direction" if not unit and kind_named(driver.partition(".")[0]).scales else unit


def _arrows(result: RunResult, step: StepResult, points: Floats) -> tuple[tuple[Floats, Floats, str], ...]:
    """One arrow per acting load, at the middle of its group."""
    arrows = []
    for name, factor in step.loads.items():
        load = result.scene.loads[name]
        if factor == 0.0:
            continue
        groups = result.mesh.tri_groups if load.kind == "area" else result.mesh.node_groups
        nodes = groups[load.group] if load.kind != "area" else np.unique(result.mesh.triangles[groups[load.group]])
        direction = np.sign(factor) * np.array(load.direction) / np.linalg.norm(load.direction)
        label = f"{abs(factor) * float(np.linalg.norm(load.direction)):.4g} {result.scene.units.force}"
        arrows.append((points[nodes].mean(axis=0), direction, label if load.kind == "total" else name))
    return tuple(arrows)


def curve_values(result: RunResult, quantity: str) -> Floats:
    """A curve quantity at every converged step: a probe, ``volume``, ``pressure`` (the first) or a driver such as ``load.tip``."""
    steps = [step for step in result.steps if step.converged]
    if quantity in result.scene.probes:
        return np.array([step.probes[quantity] for step in steps])
    if quantity == "volume":
        return np.array([step.volume for step in steps])
    if quantity == "pressure":
        return np.array([next(iter(step.pressures.values())) for step in steps])
    return np.array([step.drivers[quantity] for step in steps])


def _quantity_label(scene: Scene, quantity: str) -> str:
    if quantity in scene.probes:
        words, unit = quantity.replace("_", " "), probe_unit(scene, quantity)
    elif quantity == "volume":
        words, unit = quantity, scene.units.volume
    elif quantity == "pressure":
        words, unit = quantity, scene.units.stress
    else:
        words, unit = quantity.replace(".", " "), _unit(scene, quantity)
    return f"{words} [{unit}]" if unit else words


def draw_run_curve(result: RunResult, curve: Curve, path: Path) -> None:
    """Draw ``curve.png``: the computed curve, references, lines, and the first step with wrinkles as a mark."""
    steps = [step for step in result.steps if step.converged]
    inside = np.array([curve.stage in (None, step.stage) for step in steps])
    if curve.stage is not None and inside.any():
        first = int(np.argmax(inside))
        inside[max(first - 1, 0)] = True
    x = curve.x_scale * curve_values(result, curve.x)[inside]
    y = curve.y_scale * curve_values(result, curve.y)[inside]
    marks = []
    wrinkled = [step.elements.count()["wrinkled"] > 0 for step, used in zip(steps, inside, strict=True) if used]
    if any(wrinkled) and not wrinkled[0]:
        first = wrinkled.index(True)
        marks.append(Mark(label="first step with wrinkles", x=float(x[first]), y=float(y[first])))
    draw_curve(
        path,
        series=[
            Series(label="computed", x=x, y=y, style="computed"),
            *(Series(label=r.label, x=np.array(r.x), y=np.array(r.y), style="reference") for r in curve.references),
        ],
        x_label=curve.x_label or _quantity_label(result.scene, curve.x),
        y_label=curve.y_label or _quantity_label(result.scene, curve.y),
        title=result.scene.title or result.scene.name,
        lines=[ReferenceLine(label=line.label, axis=line.axis, value=line.value) for line in curve.lines],
        marks=marks,
    )
