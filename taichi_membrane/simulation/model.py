"""From a scene to what the engine needs: the mesh with its groups, and a structure of fabrics, supports and loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import bounds, fields, shapes
from taichi_membrane import mesh as meshes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.body import Body
from taichi_membrane.mechanics.preparation import Floats, Ints
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.wet import rim_moves
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Scene, VolumeProbe
from taichi_membrane.simulation.bodies import PrescribedBody, bodies_of, moments_of, with_body_groups
from taichi_membrane.simulation.chambers import Chamber, chambers_of, sides
from taichi_membrane.simulation.dead_forces import unit_forces_of
from taichi_membrane.simulation.fabrics import fabrics_of, prestress_of, thickness_of
from taichi_membrane.simulation.groups import fabric_list
from taichi_membrane.simulation.growth import Growth, growth_of
from taichi_membrane.simulation.layers import grade_of
from taichi_membrane.simulation.load_state import LoadState, unloaded
from taichi_membrane.simulation.members import (
    cables_of,
    line_elements,
    ropes_of,
    springs_of,
    with_cable_nodes,
    with_member_nodes,
)
from taichi_membrane.simulation.obstacles import obstacles_of, walls_of
from taichi_membrane.simulation.results import ProbeFunction
from taichi_membrane.simulation.supports import PrescribedMotion, held_by_others, held_components, motions_of
from taichi_membrane.simulation.surface_loads import SurfaceLoads, surface_loads_of
from taichi_membrane.simulation.used_data import with_used_data
from taichi_membrane.simulation.warp import warp_directions

# What a run keeps, in bytes: of each node and triangle (mesh and fields of the engine, double precision), and of each of them
# for every load step (its fields); besides, the record of a step.
_NODE_BYTES, _TRIANGLE_BYTES = 150, 250
_STEP_BYTES = 2000
# Besides, of each triangle for every driver of stress-free strain.
_GROWTH_BYTES = 16

_SHAPES: dict[str, Callable[..., Mesh]] = {
    "tube": shapes.tube,
    "arch": shapes.arch,
    "sphere": shapes.sphere,
    "disc": shapes.disc,
    "annulus": shapes.annulus,
    "wedge": shapes.wedge,
    "panel": shapes.panel,
    "cushion": shapes.cushion,
    "arch_tent": shapes.arch_tent,
    "mattress": shapes.mattress,
    "hypar": shapes.hypar,
    "cone": shapes.cone,
    "drop_stitch": shapes.drop_stitch,
    "airbag": shapes.airbag,
    "water_tube": shapes.water_tube,
    "pumpkin": shapes.pumpkin,
    "hull": shapes.hull,
}


@dataclass(frozen=True, kw_only=True)
class Model:
    """A scene made ready for the engine.

    :param structure: mesh, fabrics, supports and pressure surfaces.
    :param chambers: what each follower pressure acts on, in the order of the structure's chamber numbers.
    :param surface: winds, loads per plan area and liquids.
    :param unit_forces: (n, 3) dead nodal forces at value 1 of each driver that has some, by names such as ``load.tip``.
    :param motions: prescribed motions of node groups.
    :param growth: shrinkages and temperatures.
    :param moved_bodies: rigid bodies of which a motion prescribes something.
    :param unit_moments: (bodies, 3) moments about fixed axes at value 1 of each driver that has some.
    :param own_probes: what is measured at every load step beside the scene's probes, by name.
    :param given: the mesh before form finding, where the structure's is the shape found.
    """

    scene: Scene
    structure: Structure
    chambers: tuple[Chamber, ...]
    surface: SurfaceLoads
    unit_forces: Mapping[str, Floats]
    motions: Mapping[str, PrescribedMotion]
    growth: Growth
    moved_bodies: tuple[PrescribedBody, ...] = ()
    unit_moments: Mapping[str, Floats] = field(default_factory=dict)
    own_probes: Mapping[str, ProbeFunction] = field(default_factory=dict)
    given: Mesh | None = None

    def fabric_names(self) -> list[tuple[str, Fabric]]:
        """The scene's fabrics with the element group of each, in the order of the structure's fabric numbers."""
        return fabric_list(self.scene)

    @property
    def pressure_names(self) -> tuple[str, ...]:
        """Name of each follower pressure, in the order of the structure's chamber numbers."""
        return tuple(chamber.name for chamber in self.chambers)

    @property
    def surface_drivers(self) -> tuple[str, ...]:
        """Names of the values of all loads on the surface, such as ``pressure.inside``, in the structure's order."""
        return (*(f"pressure.{name}" for name in self.pressure_names), *self.surface.drivers)

    def measured(self, probe: VolumeProbe) -> tuple[Ints, Floats, float]:
        """Triangles that enclose the volume of a probe, the share of each, and the volume at rest; 0 for an open one.

        :raises InputError: no such pressure, or one that is not used.
        """
        if probe.pressure is None:
            return np.arange(self.structure.mesh.tri_count), self.enclosing, self.rest_volume
        if probe.pressure not in self.pressure_names:
            raise InputError(
                f"probes: {probe.pressure!r} is no follower pressure that a stage uses; allowed: {', '.join(self.pressure_names)}"
            )
        chamber = self.chambers[self.pressure_names.index(probe.pressure)]
        rest = chamber.volume(self.structure.mesh.points) if chamber.is_closed else 0.0
        return chamber.triangles, chamber.sign.astype(np.float64), rest

    @cached_property
    def enclosing(self) -> Floats:
        """(tri_count,) share of each triangle's swept volume in that of the structure.

        A wall between two chambers has none; where elements branch, neither has what no pressure acts on.
        """
        behind, ahead = self.structure.tri_chamber >= 0, self.structure.tri_ahead
        before = np.zeros_like(behind) if ahead is None else ahead >= 0
        share = np.where(behind & before, 0.0, np.where(before, -1.0, 1.0))
        if self.chambers and len(self.structure.mesh.junction_edges()):
            share[~behind & ~before] = 0.0
        return share

    @cached_property
    def rest_volume(self) -> float:
        """Volume that the structure encloses at rest; 0 for an open one."""
        mesh, outer = self.structure.mesh, np.flatnonzero(self.enclosing)
        if mesh.is_closed and len(outer) == mesh.tri_count:
            return mesh.enclosed_volume()
        whole = Chamber("", mesh, outer, self.enclosing[outer].astype(np.int8))
        return whole.volume(mesh.points) if len(outer) and whole.is_closed else 0.0

    @cached_property
    def unloaded(self) -> LoadState:
        """The state before the first stage: chambers hold what fills them at rest, at the pressure outside."""
        points, values = self.structure.mesh.points, dict(unloaded(self.scene).values)
        for chamber in self.chambers:
            if f"amount.{chamber.name}" in values:
                values[f"amount.{chamber.name}"] = chamber.volume(points)
        return LoadState(values)

    def outside(self, state: LoadState, name: str) -> float:
        """Absolute pressure outside a chamber in a load state."""
        return state.values.get(f"ambient.{name}", self.scene.pressures[name].ambient or 0.0)

    def nodal_loads(self, state: LoadState) -> Floats:
        """(n, 3) dead nodal forces of all drivers."""
        total = np.zeros((self.structure.mesh.node_count, 3))
        for driver, unit in self.unit_forces.items():
            total += state.values[driver] * unit
        return total

    def moved(self, displacement: Floats, state: LoadState) -> Floats:
        """Displacements with the prescribed components at their values in a load state."""
        result = displacement.copy()
        for name, motion in self.motions.items():
            target = motion.displacement(self.structure.mesh.points, state.values[f"motion.{name}"])
            for c in motion.components:
                result[motion.nodes, c] = target[:, c]
        for one in self.moved_bodies:
            result[one.body.nodes] = one.displaced(displacement, state.values)
        return result

    def body_moments(self, state: LoadState) -> Floats:
        """(bodies, 3) moments about fixed axes of all drivers."""
        total = np.zeros((len(self.structure.bodies), 3))
        for driver, unit in self.unit_moments.items():
            total += state.values[driver] * unit
        return total

    def surface_values(self, state: LoadState) -> Floats:
        """Values of all loads on the surface: each follower pressure, then winds, loads per plan area, levels of liquids."""
        return np.array([state.values[driver] for driver in self.surface_drivers])

    def growth_values(self, state: LoadState) -> Floats:
        """Values of the drivers of stress-free strain."""
        return np.array([state.values[driver] for driver in self.growth.drivers])

    def reference_load(self, state: LoadState) -> float:
        """2-norm of all applied nodal forces, to which residuals are compared: those on the unstressed surface, and dead loads."""
        structure = self.structure
        values = np.append(self.surface_values(state)[: structure.chamber_count], 0.0)  # chamber -1 is no pressure
        on_triangles = values[structure.tri_chamber]
        if structure.tri_ahead is not None:
            on_triangles = on_triangles - values[structure.tri_ahead]
        acting = [preparation.nodal_pressure(structure.mesh, on_triangles), self.nodal_loads(state)]
        for name, force in self._resting.items():
            acting.append(state.values[f"load.{name}"] * force)
        for name in self.surface.waters:
            acting.append(self.surface.at_rest(name, state.values[f"load.{name}"]))
        for body, moment in zip(structure.bodies, self.body_moments(state), strict=True):
            acting.append(moment / body.radius)
        return float(np.sqrt(sum(np.vdot(force, force) for force in acting)))

    @cached_property
    def _resting(self) -> dict[str, Floats]:
        """(node_count, 3) nodal forces of winds and loads per plan area at value 1 on the unstressed shape."""
        return {name: self.surface.at_rest(name) for name in (*self.surface.winds, *self.surface.snows)}


def build_mesh(scene: Scene, base: Path | None = None, *, repair: bool = False) -> Mesh:
    """The scene's mesh with its named groups.

    :param base: folder that a relative mesh path starts from (the scene file's); the current folder when None.
    :param repair: mend a mesh file where that is safe; ``Mesh.mended`` says what was done.
    :raises InputError: the shape's numbers, the mesh file or a group's condition are bad.
    """
    source = scene.mesh
    arguments = source.model_dump(exclude={"shape", "points", "adapt"})
    if source.shape == "file":
        path = (base or Path()) / source.path
        mesh = meshes.read_mesh(path, repair=repair, scale=source.scale, open_seams=source.open_seams, join=source.join)
    else:
        if source.shape == "given":
            raise InputError("mesh.shape = 'given' needs a mesh object: run(scene, mesh=...)")
        grade = arguments.pop("grade", None)
        mesh = _SHAPES[source.shape](**arguments)
        if grade is not None:
            sizes = grade_of(scene, mesh)
            mesh = _SHAPES[source.shape](**arguments, grade=sizes) if sizes else mesh
    return with_scene_groups(scene, mesh)


def _check_order(scene: Scene, mesh: Mesh) -> None:
    """Refuse a mesh whose triangles are not of the kind that the scene names."""
    if mesh.order != scene.order:
        told = {1: "three-node", 2: "six-node"}
        raise InputError(f"mesh.order = {scene.order}, but the mesh has {told[mesh.order]} triangles")


def with_scene_groups(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with the loose points that cables use as nodes, the groups that the scene chooses by coordinates, and, which no
    coordinates choose, anchors, joints and the nodes that divide cables.

    :raises InputError: a condition that cannot be read or that nothing meets; a name that is taken.
    """
    _check_order(scene, mesh)
    mesh = with_member_nodes(scene, mesh)
    chosen: dict[str, dict[str, Ints]] = {"nodes": {}, "elements": {}}
    for name, group in scene.groups.items():
        chosen[group.kind][name] = meshes.select(mesh, group.where, kind=group.kind, key=f"groups.{name}.where")
    mesh = with_cable_nodes(scene, meshes.with_groups(mesh, chosen["nodes"], chosen["elements"]))
    return with_body_groups(scene, mesh)


def build_model(scene: Scene, mesh: Mesh, own_probes: Mapping[str, ProbeFunction] | None = None) -> Model:
    """Fabrics, supports and loads of a scene on its mesh.

    :param own_probes: what to measure beside the scene's probes.
    :raises InputError: unknown groups, elements without a fabric, no warp direction, supports that leave a rigid motion.
    """
    _check_memory(scene, mesh)
    fabrics, tri_fabric = fabrics_of(scene, mesh)
    chambers = chambers_of(scene, mesh)
    tri_chamber, tri_ahead = sides(chambers, mesh.tri_count)
    surface = surface_loads_of(scene, mesh)
    growth = growth_of(scene, mesh, tri_fabric)
    held, frame = held_components(scene, mesh)
    motions = motions_of(scene, mesh, held, frame)
    cables = cables_of(scene, mesh)
    single = held.copy()
    bodies, moved_bodies = bodies_of(scene, mesh, held, frame)
    unit_forces = unit_forces_of(scene, mesh)
    springs, obstacles = springs_of(scene, mesh), obstacles_of(scene, mesh)
    _check_held(scene, mesh, held_by_others(single, frame, mesh.points, springs, obstacles), bodies)
    structure = Structure(
        mesh=with_used_data(scene, mesh),
        fabrics=fabrics,
        tri_fabric=tri_fabric,
        tri_warp=warp_directions(scene, mesh, tri_fabric, fabrics),
        node_held=held,
        node_frame=frame,
        tri_chamber=tri_chamber,
        tri_ahead=tri_ahead,
        loads=bool(unit_forces),
        cables=cables,
        ropes=ropes_of(scene, mesh),
        springs=springs,
        obstacles=obstacles,
        walls=walls_of(scene, mesh),
        wind=surface.wind,
        snow=surface.plan_loads,
        water=tuple(surface.waters.values()),
        bodies=bodies,
        tri_thickness=thickness_of(scene, mesh, tri_fabric),
        tri_prestress=_prestress(scene, mesh, tri_fabric, fabrics),
        growth=growth.array,
        sampling=max(scene.samples, 3),
    )
    _check_rims(structure, surface)
    return Model(
        scene=scene,
        structure=structure,
        chambers=chambers,
        surface=surface,
        unit_forces=unit_forces,
        motions=motions,
        growth=growth,
        moved_bodies=moved_bodies,
        unit_moments=moments_of(scene, bodies),
        own_probes=dict(own_probes or {}),
    )


def _prestress(
    scene: Scene, mesh: Mesh, tri_fabric: Ints, fabrics: Sequence[preparation.FabricConstants]
) -> Floats | None:
    """(tri_count, 3) prestress where it differs, or will, within a fabric: form finding gives each element its own."""
    given = prestress_of(scene, mesh, tri_fabric)
    if given is None and scene.forms:
        return np.array([one.prestress for one in fabrics])[tri_fabric]
    return given


def _check_held(
    scene: Scene, mesh: Mesh, held: tuple[NDArray[np.bool_], Floats | None], bodies: tuple[Body, ...]
) -> None:
    """Refuse supports that leave a rigid motion.

    :param held: (node_count, 3) what holds single nodes, and each node's axes if not x, y, z.
    """
    ties = [np.column_stack([one.nodes[:-1], one.nodes[1:]]) for one in bodies]
    joined = np.concatenate([*ties, line_elements(scene, mesh)[0]])
    clamps = [meshes.Clamp(int(one.nodes[0]), one.centre, one.held) for one in bodies]
    left = meshes.rigid_motions_left(mesh, *held, joined if len(joined) else None, clamps)
    if left:
        hint = "; planes hold what touches them at rest" if scene.touchable else ""
        raise InputError(f"supports: the structure is free to move: {'; '.join(left)}{hint}")


def _check_rims(structure: Structure, surface: SurfaceLoads) -> None:
    """Refuse liquids of given volume whose rim moves."""
    for name in surface.volumes:
        if rim_moves(structure, surface.waters[name]):
            raise InputError(
                f"loads.{name}.given = 'volume': the rim of its elements moves; hold it, or let it move in vertical planes that it "
                "lies in"
            )


def _check_memory(scene: Scene, mesh: Mesh) -> None:
    """Refuse now what could only fail after hours: all load steps are kept until the last one is drawn."""
    extra, steps = scene.extra_fields, sum(stage.steps for stage in scene.ramps)
    node_bytes = _NODE_BYTES + fields.step_bytes("node", extra) * steps + 24 * len(scene.loads)
    tri_bytes = _TRIANGLE_BYTES + fields.step_bytes("element", extra) * steps
    tri_bytes += _GROWTH_BYTES * (len(scene.shrinkages) + len(scene.temperatures))
    of_cables = fields.step_bytes("cable") * steps * len(line_elements(scene, mesh)[0])
    short = bounds.shortage(mesh.node_count * node_bytes + mesh.tri_count * tri_bytes + _STEP_BYTES * steps + of_cables)
    if short is not None:
        counts = (
            f"{steps} load steps of {mesh.node_count} nodes and {mesh.tri_count} elements with {len(scene.loads)} loads"
        )
        raise InputError(f"stages: the run {short}: {counts}; take fewer load steps or a coarser mesh")
