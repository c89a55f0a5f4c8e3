"""What the command line prints about a scene that is not run: a list of what it amounts to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized

from rich.console import Console

from taichi_membrane.commands.printing import print_wrapped
from taichi_membrane.mesh import survey
from taichi_membrane.output.tables import layer_lines, with_unit
from taichi_membrane.scene import Cable, Fabric, Scene, Spring, Stage, Units
from taichi_membrane.scene.adapt import adapt_of
from taichi_membrane.scene.drivers import DRIVERS, driver_names, driver_unit, friction_words, stage_values
from taichi_membrane.scene.element_field import ElementField, given_text
from taichi_membrane.scene.texts import Conversion
from taichi_membrane.scene.units import probe_unit
from taichi_membrane.simulation.adaptable import surface_words
from taichi_membrane.simulation.chambers import surfaces
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.solver_choice import without_potential
from taichi_membrane.simulation.told_layers import told_layers
from taichi_membrane.simulation.warp import least_angle


def _converted(conversions: Sequence[Conversion]) -> list[str]:
    """What texts with a unit became; of those in the scene's units already, how many there are."""
    became = [(one, with_unit(one.value, one.unit)) for one in conversions]
    lines = [f"{one.key}: {one.text} is {told}" for one, told in became if told != one.text]
    same = len(became) - len(lines)
    return [*lines, *([f"{same} with the scene's own units, as written"] if same else [])]


def print_model(
    console: Console,
    model: Model,
    compiled_in: Sequence[str],
    left_out: Sequence[str],
    conversions: Sequence[Conversion] = (),
    presets: Sequence[tuple[str, str]] = (),
) -> None:
    """Print what a scene amounts to: units, sizes, groups, fabrics, what acts, what is compiled in.

    :param conversions: the texts with a unit of their own that the scene was written with.
    :param presets: numbers that its fabrics take from presets, each with its source, by the fabric's key.
    """
    scene, mesh = model.scene, model.structure.mesh
    units = scene.units
    open_kind = "open" if len(mesh.boundary_edges()) else "no free edges, walls meet"
    closed = f"closed, volume {mesh.enclosed_volume():.6g} {units.volume}" if mesh.is_closed else open_kind
    area = f"area {mesh.tri_areas().sum():.6g} {units.area}"
    lines = [
        ("scene", f"{scene.name}: {scene.title}" if scene.title else scene.name),
        (
            "units",
            f"{units.length}, {units.force}, stress and pressure in {units.stress}, force per width in {units.resultant}",
        ),
        *(("converted", line) for line in _converted(conversions)),
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
        *(("preset", f"{key}: {text}") for key, text in presets),
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
        *(("layers", line) for line in layer_lines(told_layers(model), units.length)),
        *(("adapt", line) for line in _adapt_lines(model)),
        *(("stage", _stage_line(scene, stage)) for stage in scene.stages),
        *(("case", f"{_stage_line(scene, scene.ramp(one.name))}, after {scene.start_of(one)}") for one in scene.cases),
        ("probes", ", ".join(scene.probes) or "none"),
        ("checks", str(len(scene.checks)) if scene.checks else "none"),
        ("compiled in", ", ".join(compiled_in) or "nothing beyond the linear element"),
        ("left out", ", ".join(left_out) or "nothing"),
    ]
    before = ""
    for label, text in lines:
        print_wrapped(console, f"{label if label != before else '':<11}", text)
        before = label


def _adapt_lines(model: Model) -> list[str]:
    """What the mesh will be refined for."""
    asked = adapt_of(model.scene)
    if asked is None:
        return []
    unit = probe_unit(model.scene, asked.probe)
    share = f"{100.0 * (asked.tolerance or 0.0):g} %" if asked.absolute is None else with_unit(asked.absolute, unit)
    return [
        f"until the estimated error of {asked.probe} at the end of {model.scene.stages[-1].name} is below {share}: at most "
        f"{asked.max_rounds} meshes and {asked.max_elements} elements; new nodes on {surface_words(model)}"
    ]


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
    return f"{moduli}{thickness}, wrinkling law {fabric.law}{prestress}{expansion}{_strength_words(scene, fabric)}"


def _strength_words(scene: Scene, fabric: Fabric) -> str:
    """Strengths with their source, and the safety factor with its."""
    if fabric.safety is None:
        return ""
    given = (fabric.strength, fabric.strength_warp, fabric.strength_weft)
    values = "/".join(f"{one:g}" for one in given if one is not None)
    source = fabric.strength_source or "no source given"
    return f", strength {values} {scene.units.resultant} ({source}) over safety {fabric.safety.factor:g} ({fabric.safety.source})"


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
