"""What a mesh does with boundary layers: beside each line where the wall is disturbed, the layer's length and the size of elements.

Across a line the wall obeys N w'' = E t κ² w, with N the resultant across it, E the modulus along it (uniaxial, as N changes
little within the layer) and κ the normal curvature along it: a disturbance decays over l = √(N/(E t))/κ, r √(p r/(2 E t)) beside a
ring of a tube. Elements longer than :data:`.results.COARSEST` l do not see it, and a mesh cut in four hardly sees more.

A run takes N, its mean along the line, and κ from its last equilibrium. Before it N is p/(2 κ), as it is across the parallels of a
closed surface of revolution and the rings of a torus, and what prestress adds, and κ that of the shape at rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh import Mesh, surface_lines
from taichi_membrane.mesh.surface_lines import LineSide, Marks, SurfaceLine
from taichi_membrane.scene import Load
from taichi_membrane.simulation.accuracy import Layer, LayerSide
from taichi_membrane.simulation.load_state import stage_targets
from taichi_membrane.simulation.members import line_elements
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.results import StepResult

# Share of a unit vector along the wall's normal, at half of a line's nodes, from which a support or a load bends the wall.
_ACROSS = 0.3
# Radius of curvature over the size of the mesh from which a line is straight.
_STRAIGHT = 1e3
# Least curvature over the inverse of the mesh's size: a number that none is, to divide by.
_NO_CURVATURE = 1e-9


@dataclass(frozen=True, eq=False)
class _State:
    """What lengths of layers depend on.

    :param points: (node_count, 3) places of the nodes.
    :param pressure: (tri_count,) largest size of the pressure on each triangle; None where ``step`` tells the resultants.
    """

    points: Floats
    pressure: Floats | None
    step: StepResult | None


def told_layers(model: Model, steps: Sequence[StepResult] = ()) -> tuple[Layer, ...]:
    """The layers beside all lines of a model's mesh that are held, loaded, kinked, join a cap or another fabric, or bear a cable.

    :param steps: of a run, whose last equilibrium tells resultants and curvatures; without one, as foreseen at rest.
    """
    return tuple(layer for layer, _ in _told(model, steps))


def unseen(model: Model, steps: Sequence[StepResult]) -> tuple[tuple[Layer, ...], Marks]:
    """The layers that a mesh does not resolve, and (tri_count,) the triangles beside their lines, on sides that are too coarse."""
    found, marked = [], np.zeros(model.structure.mesh.tri_count, dtype=bool)
    for layer, line in _told(model, steps):
        if layer.resolved is False:
            found.append(layer)
            for told, side in zip(layer.sides, line.sides, strict=True):
                if told.resolved is False:
                    marked[side.triangles] = True
    return tuple(found), marked


def _told(model: Model, steps: Sequence[StepResult]) -> Iterator[tuple[Layer, SurfaceLine]]:
    """Each layer and its line."""
    structure = model.structure
    mesh = structure.mesh
    ended = [step for step in steps if step.converged]
    if ended:
        state = _State(mesh.points + ended[-1].displacement, None, ended[-1])
    else:
        state = _State(mesh.points, _largest_pressure(model), None)
    groups = {name: _marks(members, mesh.tri_count) for name, members in mesh.tri_groups.items()}
    for causes, line in _lines(model, state.points):
        sides = tuple(
            _side(structure, line, side, name, state)
            for side, name in zip(line.sides, _names(line, groups), strict=True)
        )
        place = mesh.points[mesh.edge_table.nodes[line.edges]].mean(axis=(0, 1))
        yield Layer(causes=causes, edge_count=len(line.edges), place=tuple(place.tolist()), sides=sides), line


def _lines(model: Model, points: Floats) -> Iterator[tuple[tuple[str, ...], SurfaceLine]]:
    """Lines of edges that are disturbed by the same causes, and these in words."""
    mesh = model.structure.mesh
    causes = {name: marked for name, marked in _disturbed(model, points).items() if marked.any()}
    if not causes:
        return
    names, marks = list(causes), np.array(list(causes.values()))
    combinations, first, which = np.unique(marks, axis=1, return_index=True, return_inverse=True)
    for number in np.argsort(first):
        own = combinations[:, number]
        if own.any():
            told = tuple(name for name, there in zip(names, own, strict=True) if there)
            for line in surface_lines.connected(mesh, which == number):
                yield told, line


def _disturbed(model: Model, points: Floats) -> dict[str, Marks]:
    """(edge_count,) what edges are disturbed, by the cause in words.

    :param points: (node_count, 3) where the nodes are while supports and loads act; kinks are those at rest.
    """
    scene, structure = model.scene, model.structure
    mesh = structure.mesh
    normal = surface_lines.node_normals(mesh, points)
    held = _held(structure, normal)
    groups = [one.group for one in scene.supports]
    groups += [one.group for one in scene.motions.values() if hasattr(one, "group")]
    groups += list(scene.bodies)
    causes = {f"{name} held": _across(mesh, mesh.node_groups[name], held) for name in dict.fromkeys(groups)}
    for name, load in scene.loads.items():
        if isinstance(load, Load) and load.kind != "area":
            direction = np.array(load.direction) / np.linalg.norm(load.direction)
            causes[f"loaded by {name}"] = _across(mesh, mesh.node_groups[load.group], np.abs(normal @ direction))
    for name, members in mesh.tri_groups.items():
        if name.startswith("cap_"):
            causes[f"joins {name}"] = surface_lines.between(mesh, _marks(members, mesh.tri_count).astype(np.int8))
    alike = np.array([structure.fabrics.index(one) for one in structure.fabrics])
    causes["fabrics meet"] = surface_lines.between(mesh, alike[structure.tri_fabric])
    for number, name in enumerate(scene.cables):
        causes[f"cable {name}"] = _under_cable(model, number)
    causes["kinked"] = surface_lines.kinks(mesh)
    causes["walls meet"] = mesh.edge_table.tri_count > 2
    return causes


def _marks(members: NDArray[np.integer], count: int) -> Marks:
    """(count,) True of members."""
    marked = np.zeros(count, dtype=bool)
    marked[members] = True
    return marked


def _held(structure: Structure, normal: Floats) -> Floats:
    """(node_count,) how much of the wall's normal is held."""
    if structure.node_frame is not None:
        normal = np.einsum("nij,nj->ni", structure.node_frame, normal)
    held = structure.node_held.copy()
    for body in structure.bodies:
        held[body.nodes] = True
    return np.asarray(np.linalg.norm(np.where(held, normal, 0.0), axis=1))


def _across(mesh: Mesh, nodes: NDArray[np.integer], share: Floats) -> Marks:
    """(edge_count,) the lines of a group of nodes at which something acts across the wall, not along it as at a plane of symmetry.

    :param share: (node_count,) how much of it acts along the normal.
    """
    marked = surface_lines.border(mesh, nodes)
    for line in surface_lines.connected(mesh, marked) if marked.any() else ():
        if np.median(share[np.unique(mesh.edge_table.nodes[line.edges])]) <= _ACROSS:
            marked[line.edges] = False
    return marked


def _under_cable(model: Model, number: int) -> Marks:
    """(edge_count,) edges that one of the scene's cables runs along."""
    mesh = model.structure.mesh
    pairs, owner = line_elements(model.scene, mesh)
    ends = mesh.edge_table.nodes
    if mesh.order == 2:
        ends = np.column_stack([ends[:, 0], mesh.edge_middles])
    keys = [np.sort(one, axis=1) @ np.array([mesh.node_count, 1]) for one in (ends, pairs[owner == number])]
    return np.isin(*keys)


def _names(line: SurfaceLine, groups: Mapping[str, Marks]) -> list[str]:
    """The smallest element group that each side lies in, with the direction in which it lies where two have one group.

    :param groups: (tri_count,) members of the element groups.
    """
    mesh, sides = line.mesh, line.sides
    sizes = {name: (len(mesh.tri_groups[name]), name == "all", name) for name in groups}
    names = [min(sizes[name] for name, inside in groups.items() if inside[side.triangles].all())[2] for side in sides]
    told = []
    for side, name in zip(sides, names, strict=True):
        away = line.across(side, mesh.points).mean(axis=0)
        k = int(np.argmax(np.abs(away)))
        clear = names.count(name) > 1 and abs(away[k]) > 0.5
        told.append(f"{name}, {'+-'[int(away[k] < 0.0)]}{'xyz'[k]}" if clear else name)
    return told


def _side(structure: Structure, line: SurfaceLine, side: LineSide, name: str, state: _State) -> LayerSide:
    """The layer on one side of a line."""
    size = float(np.median(line.sizes(side)))

    def unknown(why: str) -> LayerSide:
        return LayerSide(side=name, size=size, length=None, unknown=why)

    curvature = line.curvature(side, state.points)
    told = np.isfinite(curvature)
    if not told.any():
        return unknown("its edges do not follow each other, so that no curvature is told")
    reach = float(np.linalg.norm(np.ptp(structure.points, axis=0)))
    curvature = np.maximum(np.where(told, curvature, np.median(curvature[told])), _NO_CURVATURE / reach)
    if np.median(curvature) * _STRAIGHT * reach <= 1.0:
        at_rest = ", at rest" if state.step is None else ""
        return unknown(f"not curved along the line{at_rest}")
    resultant = _resultant(structure, line, side, curvature, state)
    stiffness = _stiffness(structure, line, side)
    mean = float(np.average(np.maximum(resultant, 0.0), weights=line.lengths(side)))
    if mean <= 0.0:
        return unknown("no pull across the line is known" if state.step is None else "nothing pulls across the line")
    length = np.sqrt(mean / stiffness) / curvature
    return LayerSide(side=name, size=size, length=float(np.median(length)))


def _resultant(structure: Structure, line: SurfaceLine, side: LineSide, curvature: Floats, state: _State) -> Floats:
    """(k,) stress resultant across the edges of a side, force per width."""
    triangles, across = side.triangles, line.across(side, state.points)
    if state.step is not None:
        fields = state.step.fields
        share = np.einsum("ij,ij->i", fields["major_direction"][triangles], across) ** 2
        major, minor = fields["major_resultant"][triangles], fields["minor_resultant"][triangles]
        return np.asarray(share * major + (1.0 - share) * minor)
    assert state.pressure is not None
    warp, weft, shear = (structure.prestress[triangles] * structure.thickness[triangles, None]).T
    c, s = _angle(structure, triangles, line.across(side, structure.points))
    given = warp * c**2 + weft * s**2 + 2.0 * shear * c * s
    return np.asarray(given + 0.5 * state.pressure[triangles] / curvature)


def _stiffness(structure: Structure, line: SurfaceLine, side: LineSide) -> Floats:
    """(k,) E t of the fabric along the edges of a side, drawn in that direction alone."""
    triangles = side.triangles
    c, s = _angle(structure, triangles, line.along(side, structure.points))
    parts = np.column_stack([c**2, s**2, c * s])
    matrices = np.array([one.compliance() for one in structure.fabrics])[structure.tri_fabric[triangles]]
    return np.asarray(structure.thickness[triangles] / np.einsum("ki,kij,kj->k", parts, matrices, parts))


def _angle(structure: Structure, triangles: NDArray[np.integer], direction: Floats) -> tuple[Floats, Floats]:
    """Cosine and sine of the angle from the warp of triangles to unit vectors in them."""
    warp = structure.tri_warp[triangles]
    corners = structure.points[structure.mesh.triangles[triangles]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    warp = warp - np.einsum("ij,ij->i", warp, normal)[:, None] * normal
    warp /= np.linalg.norm(warp, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", warp, direction), np.einsum("ij,ij->i", np.cross(normal, warp), direction)


def _largest_pressure(model: Model) -> Floats:
    """(tri_count,) size of the largest pressure on each triangle that the scene's stages give."""
    structure, found = model.structure, np.zeros(model.structure.mesh.tri_count)
    for target in stage_targets(model.scene):
        values: Mapping[str, float] = target.pressures
        of_chamber = np.append([values[name] for name in model.pressure_names], 0.0)
        total = of_chamber[structure.tri_chamber]
        if structure.tri_ahead is not None:
            total = total - of_chamber[structure.tri_ahead]
        found = np.maximum(found, np.abs(total))
    return found
