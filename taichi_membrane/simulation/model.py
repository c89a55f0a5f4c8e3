"""From a scene to what the engine needs: the mesh with its groups, and a structure of fabrics, supports and loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import spatial

from taichi_membrane import bounds, fields, shapes
from taichi_membrane import mesh as meshes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.preparation import FabricConstants, Floats, Ints
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh import Mesh
from taichi_membrane.scene import Fabric, Load, Pressure, Rotation, Scene, Translation, VolumeProbe
from taichi_membrane.scene.drivers import kind_named
from taichi_membrane.simulation.chambers import Chamber, chambers_of, pressure_used, sides
from taichi_membrane.simulation.groups import group_nodes, group_triangles, pressed_triangles
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.members import cables_of, planes_of, with_cable_nodes
from taichi_membrane.simulation.results import ProbeFunction

# What a run keeps, in bytes: of each node and triangle (mesh and fields of the engine, double precision), and of each of them
# for every load step (its fields); besides, the record of a step.
_NODE_BYTES, _TRIANGLE_BYTES = 150, 250
_STEP_BYTES = 2000

_SHAPES: dict[str, Callable[..., Mesh]] = {
    "tube": shapes.tube,
    "arch": shapes.arch,
    "sphere": shapes.sphere,
    "disc": shapes.disc,
    "annulus": shapes.annulus,
    "wedge": shapes.wedge,
    "panel": shapes.panel,
    "cushion": shapes.cushion,
}


@dataclass(frozen=True)
class PrescribedMotion:
    """A node group whose displacement components ``components`` (0, 1, 2) follow a motion; see :mod:`taichi_membrane.scene`."""

    motion: Translation | Rotation
    nodes: Ints
    components: tuple[int, ...]

    def displacement(self, points: Floats, factor: float) -> Floats:
        """(len(nodes), 3) displacement of the group's nodes from their unstressed positions at a factor."""
        if isinstance(self.motion, Translation):
            return np.broadcast_to(factor * np.array(self.motion.direction), (len(self.nodes), 3))
        axis = np.array(self.motion.axis) / np.linalg.norm(self.motion.axis)
        arms = points[self.nodes] - np.array(self.motion.through)
        turn = spatial.transform.Rotation.from_rotvec(factor * axis, degrees=True)
        return np.asarray(turn.apply(arms) - arms)


@dataclass(frozen=True, kw_only=True)
class Model:
    """A scene made ready for the engine.

    :param structure: mesh, fabrics, supports and pressure surfaces.
    :param chambers: what each follower pressure acts on, in the order of the structure's chamber numbers.
    :param unit_forces: (n, 3) dead nodal forces at value 1 of each driver that has some, by names such as ``load.tip``.
    :param motions: prescribed motions of node groups.
    :param own_probes: what is measured at every load step beside the scene's probes, by name.
    """

    scene: Scene
    structure: Structure
    chambers: tuple[Chamber, ...]
    unit_forces: Mapping[str, Floats]
    motions: Mapping[str, PrescribedMotion]
    own_probes: Mapping[str, ProbeFunction] = field(default_factory=dict)

    def fabric_names(self) -> list[tuple[str, Fabric]]:
        """The scene's fabrics with the element group of each, in the order of the structure's fabric numbers."""
        return _fabric_list(self.scene)

    @property
    def pressure_names(self) -> tuple[str, ...]:
        """Name of each follower pressure, in the order of the structure's chamber numbers."""
        return tuple(chamber.name for chamber in self.chambers)

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
        return result

    def chamber_pressures(self, state: LoadState) -> Floats:
        """Value of each follower pressure."""
        return np.array([state.values[f"pressure.{name}"] for name in self.pressure_names])

    def reference_load(self, state: LoadState) -> float:
        """2-norm of all applied nodal forces, to which residuals are compared: pressure on the unstressed shape, and dead loads."""
        structure = self.structure
        values = np.append(self.chamber_pressures(state), 0.0)  # chamber -1 is no pressure
        on_triangles = values[structure.tri_chamber]
        if structure.tri_ahead is not None:
            on_triangles = on_triangles - values[structure.tri_ahead]
        pressing = preparation.nodal_pressure(structure.mesh, on_triangles)
        dead = self.nodal_loads(state)
        return float(np.sqrt(np.vdot(pressing, pressing) + np.vdot(dead, dead)))


def build_mesh(scene: Scene, base: Path | None = None, *, repair: bool = False) -> Mesh:
    """The scene's mesh with its named groups.

    :param base: folder that a relative mesh path starts from (the scene file's); the current folder when None.
    :param repair: mend a mesh file where that is safe; ``Mesh.mended`` says what was done.
    :raises InputError: the shape's numbers, the mesh file or a group's condition are bad.
    """
    source = scene.mesh
    arguments = source.model_dump(exclude={"shape"})
    if source.shape == "file":
        path = (base or Path()) / source.path
        mesh = meshes.read_mesh(path, repair=repair, scale=source.scale, open_seams=source.open_seams, join=source.join)
    else:
        if source.shape == "given":
            raise InputError("mesh.shape = 'given' needs a mesh object: run(scene, mesh=...)")
        mesh = _SHAPES[source.shape](**arguments)
    return with_scene_groups(scene, mesh)


def with_scene_groups(scene: Scene, mesh: Mesh) -> Mesh:
    """The mesh with the loose points that cables use as nodes, and the groups that the scene chooses by coordinates.

    :raises InputError: a condition that cannot be read or that nothing meets; a name that is taken.
    """
    mesh = with_cable_nodes(scene, mesh)
    chosen: dict[str, dict[str, Ints]] = {"nodes": {}, "elements": {}}
    for name, group in scene.groups.items():
        chosen[group.kind][name] = meshes.select(mesh, group.where, kind=group.kind, key=f"groups.{name}.where")
    return meshes.with_groups(mesh, chosen["nodes"], chosen["elements"])


def build_model(scene: Scene, mesh: Mesh, own_probes: Mapping[str, ProbeFunction] | None = None) -> Model:
    """Fabrics, supports and loads of a scene on its mesh.

    :param own_probes: what to measure beside the scene's probes.
    :raises InputError: unknown groups, elements without a fabric, no warp direction, supports that leave a rigid motion.
    """
    _check_memory(scene, mesh)
    fabrics, tri_fabric = _fabrics(scene, mesh)
    chambers = chambers_of(scene, mesh)
    tri_chamber, tri_ahead = sides(chambers, mesh.tri_count)
    unit_forces = _unit_forces(scene, mesh)
    held, frame = _held(scene, mesh)
    motions = _motions(scene, mesh, held, frame)
    cables = cables_of(scene, mesh)
    left = meshes.rigid_motions_left(mesh, held, frame, None if cables is None else cables.nodes)
    if left:
        raise InputError(f"supports: the structure is free to move: {'; '.join(left)}")
    structure = Structure(
        mesh=mesh,
        fabrics=fabrics,
        tri_fabric=tri_fabric,
        tri_warp=_warp_directions(scene, mesh, tri_fabric, fabrics),
        node_held=held,
        node_frame=frame,
        tri_chamber=tri_chamber,
        tri_ahead=tri_ahead,
        loads=bool(unit_forces),
        cables=cables,
        planes=planes_of(scene, mesh),
    )
    return Model(
        scene=scene,
        structure=structure,
        chambers=chambers,
        unit_forces=unit_forces,
        motions=motions,
        own_probes=dict(own_probes or {}),
    )


def _check_memory(scene: Scene, mesh: Mesh) -> None:
    """Refuse now what could only fail after hours: all load steps are kept until the last one is drawn."""
    steps = sum(stage.steps for stage in scene.stages)
    node_bytes = _NODE_BYTES + fields.step_bytes("node") * steps + 24 * len(scene.loads)
    tri_bytes = _TRIANGLE_BYTES + fields.step_bytes("element") * steps
    short = bounds.shortage(mesh.node_count * node_bytes + mesh.tri_count * tri_bytes + _STEP_BYTES * steps)
    if short is not None:
        counts = (
            f"{steps} load steps of {mesh.node_count} nodes and {mesh.tri_count} elements with {len(scene.loads)} loads"
        )
        raise InputError(f"stages: the run {short}: {counts}; take fewer load steps or a coarser mesh")


def _fabric_list(scene: Scene) -> list[tuple[str, Fabric]]:
    """The scene's fabrics with the element group of each; the default fabric comes first, for all elements."""
    default = [("all", scene.fabric)] if scene.fabric is not None else []
    return [*default, *scene.fabrics.items()]


def _fabrics(scene: Scene, mesh: Mesh) -> tuple[tuple[FabricConstants, ...], Ints]:
    constants, number_of = [], np.full(mesh.tri_count, -1, dtype=np.int32)
    default_given = scene.fabric is not None
    for number, (group, fabric) in enumerate(_fabric_list(scene)):
        elements = group_triangles(mesh, group, f"fabrics.{group}")
        taken = number_of[elements]
        clash = elements[taken > 0 if default_given else taken >= 0]
        if clash.size:
            raise InputError(
                f"fabrics.{group}: element {clash[0]} (and {clash.size - 1} others) already has a fabric from another group"
            )
        number_of[elements] = number
        constants.append(
            FabricConstants(
                e_warp=fabric.warp_modulus,
                e_weft=fabric.weft_modulus,
                poisson=fabric.nu,
                shear=fabric.shear_modulus,
                thickness=fabric.thickness,
                law=fabric.law,
                side_strain=fabric.side_strain,
                prestress=fabric.prestress,
            )
        )
    bare = np.flatnonzero(number_of < 0)
    if bare.size:
        raise InputError(
            f"fabrics: {bare.size} of {mesh.tri_count} elements have no fabric, the first is {bare[0]}; "
            "give [fabric] for all others, or a [fabrics.GROUP] for them"
        )
    return tuple(constants), number_of


def _warp_directions(scene: Scene, mesh: Mesh, tri_fabric: Ints, fabrics: tuple[FabricConstants, ...]) -> Floats:
    normals = mesh.tri_normals()
    corners = mesh.points[mesh.triangles]
    direction = corners[:, 1] - corners[:, 0]  # any direction will do where the fabric has none
    for number, (group, fabric) in enumerate(_fabric_list(scene)):
        elements = np.flatnonzero(tri_fabric == number)
        directed = not fabrics[number].isotropic or any(fabric.prestress)
        if fabric.warp is not None:
            direction[elements] = fabric.warp
        elif mesh.tri_warp is not None:
            direction[elements] = mesh.tri_warp[elements]
        elif directed:
            raise InputError(f"fabrics.{group}: this mesh has no warp direction of its own; give warp = [x, y, z]")
        if directed:
            checked = preparation.project_on_elements(direction, normals, elements, f"fabrics.{group}.warp")
            direction[elements] = _turned(checked, normals[elements], np.deg2rad(fabric.warp_angle))
        else:
            direction[elements] = _any_tangent(direction[elements], corners[elements], normals[elements])
    return direction


def _any_tangent(direction: Floats, corners: Floats, normals: Floats) -> Floats:
    """Directions for an isotropic fabric, where only output depends on them: the first side where the asked one is normal."""
    along = direction - np.einsum("ij,ij->i", direction, normals)[:, None] * normals
    poor = np.linalg.norm(along, axis=1) <= 1e-6 * np.linalg.norm(direction, axis=1)
    along[poor] = (corners[:, 1] - corners[:, 0])[poor]
    return along


def _turned(direction: Floats, normals: Floats, angle: float) -> Floats:
    """Tangent vectors turned by ``angle`` about the normals, counter-clockwise seen from the positive side."""
    return np.cos(angle) * direction + np.sin(angle) * np.cross(normals, direction)


def _held(scene: Scene, mesh: Mesh) -> tuple[NDArray[np.bool_], Floats | None]:
    """Held components of each node, and the axes they refer to: None while all supports are along x, y, z."""
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    normals: dict[int, list[Floats]] = {}
    for number, support in enumerate(scene.supports, 1):
        nodes = group_nodes(mesh, support.group, f"supports[{number}].group")
        for component in support.hold or "":
            held[nodes, "xyz".index(component)] = True
        if support.normal is not None:
            direction = np.array(support.normal) / np.linalg.norm(support.normal)
            for node in nodes:
                normals.setdefault(int(node), []).append(direction)
    if not normals:
        return held, None
    frame = np.tile(np.eye(3), (mesh.node_count, 1, 1))
    for node, directions in normals.items():
        along_axes = list(np.eye(3)[held[node]])
        # Right singular vectors: first a basis of all held directions, then of what is left free.
        _, values, rows = np.linalg.svd(np.array(directions + along_axes))
        rank = int((values > 1e-9).sum())
        frame[node] = rows
        held[node] = np.arange(3) < rank
    return held, frame


def _motions(scene: Scene, mesh: Mesh, held: NDArray[np.bool_], frame: Floats | None) -> dict[str, PrescribedMotion]:
    """The prescribed motions; their components are added to the held ones.

    :raises InputError: a component that a support or another motion already governs.
    """
    motions = {}
    for name, motion in scene.motions.items():
        nodes = group_nodes(mesh, motion.group, f"motions.{name}.group")
        components = tuple("xyz".index(c) for c in motion.hold)
        if frame is not None and np.any(frame[nodes] != np.eye(3)):
            slanted = nodes[np.any(frame[nodes] != np.eye(3), axis=(1, 2))]
            raise InputError(f"motions.{name}: node {slanted[0]} has a slanted support; it cannot be moved too")
        chosen = np.ix_(nodes, np.array(components))
        taken = held[chosen]
        if taken.any():
            node, c = np.argwhere(taken)[0]
            raise InputError(
                f"motions.{name}: component {'xyz'[components[c]]} of node {nodes[node]} is already held by a support "
                "or moved by another motion"
            )
        held[chosen] = True
        motions[name] = PrescribedMotion(motion, nodes, components)
    return motions


def _unit_forces(scene: Scene, mesh: Mesh) -> dict[str, Floats]:
    """(n, 3) dead nodal forces at value 1 of each driver that has some."""
    found = {}
    for kind, unit_force in DEAD_FORCES.items():
        entry = kind_named(kind)
        for name, driver in entry.defined(scene).items():
            force = unit_force(scene, mesh, name, driver)
            if force is not None:
                found[f"{kind}.{name}"] = force
    return found


def _fixed_pressure(scene: Scene, mesh: Mesh, name: str, pressure: Pressure) -> Floats | None:
    """(n, 3) nodal forces of a pressure that keeps its direction, at value 1; None of others and of one that is never used."""
    if pressure.kind != "fixed" or not pressure_used(scene, name):
        return None
    share = np.zeros(mesh.tri_count)
    for elements, sign in zip(pressed_triangles(mesh, pressure, f"pressures.{name}"), (1.0, -1.0), strict=True):
        share[elements] += sign
    return preparation.nodal_pressure(mesh, share)


def _unit_load(scene: Scene, mesh: Mesh, name: str, load: Load) -> Floats:
    """(n, 3) nodal forces of a load at factor 1."""
    key = f"loads.{name}"
    force = np.zeros((mesh.node_count, 3))
    direction = np.array(load.direction)
    if load.kind == "area":
        return force + _tributary_area(mesh, group_triangles(mesh, load.group, f"{key}.group"))[:, None] * direction
    nodes = group_nodes(mesh, load.group, f"{key}.group")
    if load.kind == "line":
        return force + _tributary_length(mesh, nodes, key)[:, None] * direction
    if load.spread == "equal":
        share = np.zeros(mesh.node_count)
        share[nodes] = 1.0
    elif load.spread == "edges":
        share = _tributary_length(mesh, nodes, key)
    else:
        share = _tributary_area(mesh, np.arange(mesh.tri_count))
        share[np.setdiff1d(np.arange(mesh.node_count), nodes)] = 0.0
    return force + (share / share.sum())[:, None] * direction


def _tributary_area(mesh: Mesh, elements: Ints) -> Floats:
    """(n,) a third of the area of each of the elements around a node."""
    area = np.zeros(mesh.tri_count)
    area[elements] = mesh.tri_areas()[elements]
    return preparation.sum_to_nodes(mesh, np.repeat(area / 3.0, 3)[:, None])[:, 0]


def _tributary_length(mesh: Mesh, nodes: Ints, key: str) -> Floats:
    """(n,) half the length of the edges, of those with both ends in the group, that meet at a node."""
    member = np.zeros(mesh.node_count, dtype=bool)
    member[nodes] = True
    edges = mesh.edges()
    edges = edges[member[edges].all(axis=1)]
    if not len(edges):
        raise InputError(f"{key}.group: no mesh edge has both ends in this group of {len(nodes)} nodes")
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    total = np.bincount(edges.ravel(), weights=np.repeat(0.5 * length, 2), minlength=mesh.node_count)
    return np.asarray(total, dtype=np.float64)


# Dead nodal forces at value 1 by kinds of drivers; in this order they are summed.
DEAD_FORCES: dict[str, Callable[[Scene, Mesh, str, Any], Floats | None]] = {
    "load": _unit_load,
    "pressure": _fixed_pressure,
}
