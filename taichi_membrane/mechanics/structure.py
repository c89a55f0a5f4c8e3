"""A membrane structure as the engine sees it, and what is derived from it before anything is uploaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.algebra.elimination import Elimination, kept_elimination
from taichi_membrane.mechanics import preparation
from taichi_membrane.mechanics.body import Body, parts_of, reduced_pairs
from taichi_membrane.mechanics.features import Features, PressureKind, Variant
from taichi_membrane.mechanics.obstacle import Obstacle
from taichi_membrane.mechanics.preparation import (
    Cables,
    FabricConstants,
    Floats,
    Ints,
    PlanLoads,
    Ropes,
    Springs,
    TriangleGeometry,
    Water,
)
from taichi_membrane.mechanics.wall_search import Walls
from taichi_membrane.mesh import Mesh


@dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """A mesh with its fabrics, supports, pressed surfaces, cables, springs and obstacles; all that mechanics needs to know.

    A run sets the values of loads on the surface in one array: pressures of the chambers, then winds, loads per plan area, and
    levels of liquids.

    :param tri_fabric: (tri_count,) number of each triangle's fabric in ``fabrics``.
    :param tri_warp: (tri_count, 3) warp direction, projected on the element.
    :param node_held: (node_count, 3) True where a displacement component is held or prescribed; at nodes of rigid bodies what
        they say of the freedoms that they carry, see :attr:`Body.held`, and True where they carry none.
    :param node_frame: (node_count, 3, 3) rows are the axes that ``node_held`` refers to at each node; x, y, z when None.
    :param tri_chamber: (tri_count,) number of the chamber behind each triangle, whose pressure acts along its normal; -1 for none.
    :param loads: whether dead nodal loads will be given.
    :param tri_ahead: (tri_count,) number of the chamber before each triangle, whose pressure acts against its normal; -1 for none.
        None where all are -1.
    :param wind: (tri_count, n) pressure along each triangle's normal at value 1 of each wind.
    :param tri_thickness: (tri_count,) thickness at rest, where it differs within a fabric.
    :param tri_prestress: (tri_count, 3) stress at zero strain in fabric axes (warp, weft, shear), where it differs within a fabric.
    :param walls: elements that touch each other.
    :param sampling: points of a six-node triangle where strain is sampled, 3 or 6.
    :param growth: (tri_count, 2, n) relative extension of the free fabric in warp and weft at value 1 of each of its drivers.
    """

    mesh: Mesh
    fabrics: tuple[FabricConstants, ...]
    tri_fabric: Ints
    tri_warp: Floats
    node_held: NDArray[np.bool_]
    tri_chamber: Ints
    loads: bool = True
    node_frame: Floats | None = None
    tri_ahead: Ints | None = None
    cables: Cables | None = None
    ropes: Ropes | None = None
    springs: Springs | None = None
    obstacles: tuple[Obstacle, ...] = ()
    walls: Walls | None = None
    wind: Floats | None = None
    snow: PlanLoads | None = None
    water: tuple[Water, ...] = ()
    bodies: tuple[Body, ...] = ()
    tri_thickness: Floats | None = None
    tri_prestress: Floats | None = None
    growth: Floats | None = None
    sampling: int = 3

    @property
    def samples(self) -> int:
        """Points of each triangle where strain is sampled."""
        return 1 if self.mesh.order == 1 else self.sampling

    def by_sample(self, values: NDArray[Any]) -> NDArray[Any]:
        """What each triangle has, (tri_count, …), for each of its points in turn."""
        return values if self.samples == 1 else np.repeat(values, self.samples, axis=0)

    def mean_of_samples(self, values: Floats) -> Floats:
        """(tri_count, …) means, by area at rest, of what each point of the triangles has, (samples · tri_count, …)."""
        if self.samples == 1:
            return values
        by_tri = values.reshape(-1, self.samples, *values.shape[1:])
        return np.asarray(np.einsum("ts,ts...->t...", self.sample_weights, by_tri))

    @cached_property
    def sample_weights(self) -> Floats:
        """(tri_count, samples) share of each point's area in that of its triangle."""
        area = self.geometry.area.reshape(-1, self.samples)
        return np.asarray(area / area.sum(axis=1, keepdims=True))

    @property
    def points(self) -> Floats:
        """(node_count, 3) unstressed positions."""
        return self.mesh.points

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.mesh.node_count

    @cached_property
    def chamber_count(self) -> int:
        """Number of pressures."""
        ahead = -1 if self.tri_ahead is None else int(self.tri_ahead.max())
        return max(int(self.tri_chamber.max()), ahead) + 1

    @property
    def pressure_count(self) -> int:
        """Number of pressures: those of chambers, and winds."""
        return self.chamber_count + (0 if self.wind is None else self.wind.shape[1])

    @property
    def growth_count(self) -> int:
        """Number of drivers of stress-free strain."""
        return 0 if self.growth is None else self.growth.shape[2]

    @cached_property
    def thickness(self) -> Floats:
        """(tri_count,) thickness at rest."""
        if self.tri_thickness is not None:
            return self.tri_thickness
        return np.array([one.thickness for one in self.fabrics])[self.tri_fabric]

    @cached_property
    def green(self) -> NDArray[np.bool_]:
        """(tri_count,) whether the side strain is Green's."""
        return np.array([one.side_strain == "green" for one in self.fabrics])[self.tri_fabric]

    @property
    def prestress(self) -> Floats:
        """(tri_count, 3) stress at zero strain, in fabric axes."""
        if self.tri_prestress is not None:
            return self.tri_prestress
        return np.array([one.prestress for one in self.fabrics])[self.tri_fabric]

    def free_strain(self, values: Floats) -> Floats:
        """(tri_count, 2) strain in warp and weft of the free fabric, at values of the drivers of stress-free strain."""
        if self.growth is None:
            return np.zeros((self.mesh.tri_count, 2))
        extension = self.growth @ values
        return np.where(self.green[:, None], extension + 0.5 * extension**2, extension)

    @property
    def snow_values(self) -> slice:
        """Where the loads per plan area stand among the values of all loads on the surface."""
        return slice(self.pressure_count, self.pressure_count + (0 if self.snow is None else self.snow.share.shape[1]))

    @property
    def water_values(self) -> slice:
        """Where the levels of liquids stand among these values."""
        return slice(self.snow_values.stop, self.snow_values.stop + len(self.water))

    @cached_property
    def node_in_body(self) -> NDArray[np.bool_]:
        """(node_count,) whether each node belongs to a rigid body."""
        return np.asarray(parts_of(self.bodies, self.node_count)[:, 1] >= 0)

    @cached_property
    def node_fixed(self) -> NDArray[np.bool_]:
        """(node_count, 3) components of each node's own displacement that are held: at bodies none unless all of it is."""
        fixed = self.node_held.copy()
        for body in self.bodies:
            fixed[body.nodes] = body.held.all()
        return fixed

    @cached_property
    def geometry(self) -> TriangleGeometry:
        """Geometry of all triangles in their fabric axes, at each point where strain is sampled."""
        return preparation.triangle_geometry(self.mesh, self.tri_warp, samples=self.samples)

    @cached_property
    def tri_area(self) -> Floats:
        """(tri_count,) area at rest."""
        area = self.geometry.area
        return area if self.samples == 1 else area.reshape(-1, self.samples).sum(axis=1)

    @cached_property
    def slots(self) -> Ints:
        """Node of each slot: the triangles' nodes, then the cables' ends, then the nodes of those that slide."""
        parts: list[Ints] = [self.mesh.cells.ravel()]
        parts += [] if self.cables is None else [self.cables.nodes.ravel()]
        parts += [] if self.ropes is None else [self.ropes.chain]
        return np.concatenate(parts).astype(np.int32)

    @cached_property
    def pairs(self) -> Ints:
        """(n, 2) nodes of the rows and columns of each block that couples two ends of an element: triangles' (:func:`.pairs_of`),
        then cables, then every two nodes of those that slide."""
        parts: list[Ints] = [preparation.pairs_of(self.mesh.cells)]
        parts += [] if self.cables is None else [self.cables.nodes]
        parts += [] if self.ropes is None else [self.ropes.pairs]
        return np.concatenate(parts).astype(np.int32)

    @property
    def cable_start(self) -> tuple[int, int]:
        """Number of the first slot, and of the first pair, that are not triangles'."""
        count = self.mesh.tri_count
        return (3 * count, 3 * count) if self.mesh.order == 1 else (6 * count, 15 * count)

    @property
    def cable_sides(self) -> tuple[Ints, Floats]:
        """(n, 2) nodes of all straight pieces of cables, first of those with a force of their own, then of those that slide; and
        their unstressed lengths, of the latter as far as known: in equal shares."""
        nodes: list[Ints] = [np.zeros((0, 2), dtype=np.int32)]
        lengths = [np.zeros(0)]
        if self.cables is not None:
            nodes.append(self.cables.nodes)
            lengths.append(self.cables.length)
        if self.ropes is not None:
            counts = self.ropes.side_counts
            nodes.append(self.ropes.sides)
            lengths.append(np.repeat(self.ropes.length / counts, counts))
        return np.concatenate(nodes), np.concatenate(lengths)

    @cached_property
    def edges(self) -> Ints:
        """(edge_count, 2) nodes whose freedoms any element couples, the lower number first; sorted."""
        if self.cables is None and self.ropes is None and not self.bodies and self.mesh.order == 1:
            return self.mesh.edges()
        pairs = reduced_pairs(self.pairs, self.bodies, self.node_count) if self.bodies else self.pairs
        keys = np.unique(preparation.edge_keys(pairs, self.node_count))
        return np.column_stack(np.divmod(keys, self.node_count)).astype(np.int32)

    @cached_property
    def node_slots(self) -> tuple[Ints, Ints]:
        """The slots at each node; see :func:`preparation.gather_lists`."""
        return preparation.gather_lists(self.slots, self.node_count)

    @cached_property
    def edge_pairs(self) -> tuple[Ints, Ints]:
        """The pairs on each edge, but those that have a node in a body; see :func:`preparation.pair_lists`."""
        rows = self.elimination.edge_node[:, 1]
        if not self.bodies:
            return preparation.pair_lists(self.pairs, self.edges, rows, self.node_count)
        free = np.flatnonzero(~self.node_in_body[self.pairs].any(axis=1)).astype(np.int32)
        start, found = preparation.pair_lists(self.pairs[free], self.edges, rows, self.node_count)
        return start, np.where(found >= 0, free[np.maximum(found, ~found)], ~free[np.maximum(found, ~found)])

    @cached_property
    def pressure_edges(self) -> tuple[Ints, Floats]:
        """Edges (k, 2), of six-node triangles (k, 3) with the node amid each, where pressures end or jump, and how often the
        boundary of each runs along them, (k, pressure_count).

        A wind counts with the pressure at its value 1.
        """
        corners, table = self.mesh.triangles, self.mesh.edge_table
        along = np.where(corners < np.roll(corners, -1, axis=1), 1, -1).ravel()[table.half_edges]
        sense = np.zeros((len(table.start), self.pressure_count))
        for chambers, side in ((self.tri_chamber, 1), (self.tri_ahead, -1)):
            if chambers is not None:
                of_side = chambers[table.half_edges // 3]
                for number in range(self.chamber_count):
                    sense[:, number] += np.add.reduceat(np.where(of_side == number, side * along, 0), table.start)
        if self.wind is not None:
            blown = self.wind[table.half_edges // 3] * along[:, None]
            sense[:, self.chamber_count :] = np.add.reduceat(blown, table.start, axis=0)
        ends = np.flatnonzero(sense.any(axis=1))
        nodes = table.nodes[ends].astype(np.int64)
        if self.mesh.order == 2:
            nodes = np.column_stack([nodes, self.mesh.edge_middles[ends]])
        return nodes, sense[ends]

    @cached_property
    def elimination(self) -> Elimination:
        """Symbolic factorisation of the tangent."""
        return kept_elimination(self.points, self.edges)

    def prepare(self, *, matrix: bool) -> None:
        """Compute now what the engine will ask for; ``matrix`` with what only a direct solver needs."""
        _ = self.geometry, self.node_slots
        if matrix:
            _ = self.edge_pairs, self.elimination.additions, self.elimination.groups, self.elimination.entries

    def features(self) -> Features:
        """What this structure uses."""
        used = [self.fabrics[k] for k in np.unique(self.tri_fabric)]
        variants = tuple(dict.fromkeys(variant_of(fabric) for fabric in used))
        pressure: PressureKind
        if self.tri_ahead is not None:
            pressure = "by_side"
        elif np.all(self.tri_chamber < 0):
            pressure = "none"
        else:
            pressure = "uniform" if np.all(self.tri_chamber == 0) else "by_chamber"
        prestress = self.tri_prestress is not None or any(any(fabric.prestress) for fabric in used)
        by_element = self.tri_prestress is not None or self.growth is not None
        return Features(
            variants=variants,
            several_fabrics=len(self.fabrics) > 1,
            prestress=prestress,
            growth=self.growth is not None,
            offset="by_element" if by_element else "by_fabric" if prestress else "none",
            pressure=pressure,
            wind=self.wind is not None,
            snow=self.snow is not None,
            water=len(self.water),
            loads=self.loads,
            slanted=self.node_frame is not None,
            cables=self.cables is not None,
            ropes=self.ropes is not None,
            springs=self.springs is not None,
            obstacles=tuple(one.code for one in self.obstacles),
            walls=self.walls is not None,
            bodies=bool(self.bodies),
            samples=self.samples,
        )


def variant_of(fabric: FabricConstants) -> Variant:
    """The element code a fabric needs. A linear or clipped law needs no direction search, whatever its moduli."""
    return Variant(
        law=fabric.law,
        green=fabric.side_strain == "green",
        orthotropic=fabric.law == "tension_field" and not fabric.isotropic,
    )
