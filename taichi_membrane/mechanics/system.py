"""One structure on the device: its nodes, and the sum of the terms that act on them. This is what solvers know.

A :class:`System` is built once per run; displacements, pressures and loads are set by methods.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.bodies import ORDINARY, RigidBodies
from taichi_membrane.mechanics.cables import CableTerm
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.nodes import Nodes, field_bytes
from taichi_membrane.mechanics.preparation import Floats, TriangleGeometry
from taichi_membrane.mechanics.pressure import Pressure
from taichi_membrane.mechanics.ropes import RopeTerm
from taichi_membrane.mechanics.six_node import SixNodeTriangles
from taichi_membrane.mechanics.snow import Snow
from taichi_membrane.mechanics.springs import SpringTerm
from taichi_membrane.mechanics.strain_offset import StrainOffset, self_stress_norm
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.terms import ElementTerm, NodeTerm, Term
from taichi_membrane.mechanics.touching import Touching, contact_terms, friction_terms
from taichi_membrane.mechanics.triangles import Triangles, swept_volumes
from taichi_membrane.mechanics.wall_contact import WallTerm
from taichi_membrane.mechanics.water import WaterTerm


@ti.data_oriented
class System(Nodes):
    """Nodes and terms of one structure; see the module text and :mod:`taichi_membrane.mechanics.terms`."""

    def __init__(self, structure: Structure) -> None:
        super().__init__(structure)
        self.pressure = Pressure(structure, self.fp, self.dtype)
        self.snow = Snow(structure, self.fp, self.dtype)
        self.water = WaterTerm(self, structure)
        self.offset = StrainOffset(structure, self.fp, self.dtype)
        self.triangles: Triangles | SixNodeTriangles
        if structure.mesh.order == 1:
            self.triangles = Triangles(self, self.offset, self.pressure, self.snow, self.water, structure)
        else:
            self.triangles = SixNodeTriangles(self, self.offset, self.pressure, structure)
        self.cables = CableTerm(self, structure) if self.features.cables else None
        self.ropes = RopeTerm(self, structure) if self.features.ropes else None
        self.contacts = contact_terms(self, structure)
        self.frictions = friction_terms(self, structure, self.contacts)
        self.rigid = (RigidBodies(self, structure),) if self.features.bodies else ()
        self.springs = SpringTerm(self, structure) if self.features.springs else None
        cables = [term for term in (self.cables, self.ropes) if term is not None]
        self.terms: tuple[ElementTerm, ...] = (self.triangles, *cables)
        self.walls = WallTerm(self, structure) if self.features.walls else None
        others = [term for term in (self.walls, self.springs) if term is not None]
        self.node_terms: tuple[NodeTerm, ...] = (*self.contacts, *self.frictions, *others)
        self.upload(structure)

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure fits these fields and the kernels compiled for them: same features, no larger."""
        parts = self._parts()
        return super().accepts(structure) and all(part.accepts(structure) for part in parts)

    def upload(self, structure: Structure) -> None:
        """Put a structure that :meth:`accepts` lets through in place of the present one, at rest."""
        super().upload(structure)
        self.tri_count = structure.mesh.tri_count
        for part in self._parts():
            part.upload(structure)

    def _parts(self) -> tuple[Term, ...]:
        """All that own fields beside the nodes."""
        return (self.offset, self.pressure, self.snow, self.water, *self.terms, *self.node_terms, *self.rigid)

    def fields(self) -> Iterator[tuple[str, Any]]:
        """Every Taichi field with its name."""
        for owner in (self, *self._parts()):
            yield from ((name, one) for name, one in vars(owner).items() if isinstance(one, ti.Field))

    def bytes_allocated(self) -> int:
        """Memory of all fields."""
        return sum(field_bytes(one) for _, one in self.fields())

    # ---- forces and bounds

    @ti.func
    def gathered_force(self, i):
        """Out-of-balance force at node ``i``: the sum of its slots, of node terms, and its dead load."""
        force = ti.Vector.zero(self.fp, 3)
        for s in range(self.node_slot_start[i], self.node_slot_start[i + 1]):
            force += self.slot_force[self.node_slot[s]]
        for term in ti.static(self.node_terms):
            force += term.force(i)
        if ti.static(self.features.loads):
            force += self.node_load[i]
        return force

    @ti.func
    def gathered_mass(self, i):
        """Fictitious mass of node ``i`` from the bounds in its slots; twice it bounds the stiffness there."""
        mass = ti.cast(0.0, self.fp)
        for s in range(self.node_slot_start[i], self.node_slot_start[i + 1]):
            mass += 0.5 * self.slot_force[self.node_slot[s]][0]
        for term in ti.static(self.node_terms):
            mass += 0.25 * term.bound(i)
        return mass

    @ti.func
    def acting_force(self, i):
        """Out-of-balance force on the freedoms that node ``i`` carries."""
        force = self.gathered_force(i)
        for rigid in ti.static(self.rigid):
            part = rigid.node_part[i]
            if part >= 0:
                force = rigid.part_force[part]
            elif part != ORDINARY:
                force = ti.Vector.zero(self.fp, 3)
        return force

    @ti.func
    def acting_mass(self, i):
        """Fictitious mass of the freedoms that node ``i`` carries; of one that carries none its own, which moves nothing."""
        mass = self.gathered_mass(i)
        for rigid in ti.static(self.rigid):
            part = rigid.node_part[i]
            if part >= 0:
                mass = rigid.part_mass[part]
            if mass <= 0.0:
                mass = ti.max(rigid.part_mass[0], 1e-30)  # of a node of a body that no element has: nothing moves by it
        return mass

    @ti.kernel
    def _forces_kernel(self, out: ti.types.ndarray()):
        for term in ti.static(self.terms):
            ti.loop_config(block_dim=self.block_dim)
            for e in range(term.count()):
                term.store_forces(e)
        ti.loop_config(block_dim=self.block_dim)
        for i in range(self.bounds[None].nodes):
            force = self.gathered_force(i)
            for c in ti.static(range(3)):
                out[i, c] = force[c]

    def out_of_balance(self) -> Floats:
        """(node_count, 3) out-of-balance forces, minus the gradient of the potential; at held nodes, minus the reactions."""
        out = np.zeros((self.node_count, 3), dtype=self.dtype)
        self._forces_kernel(out)
        return out.astype(np.float64)

    def balance(self) -> Floats:
        """(node_count, 3) out-of-balance forces on the freedoms, in the supports' axes; where held, minus the reactions."""
        forces = self.in_frames(self.out_of_balance())
        for rigid in self.rigid:
            for one, moment in zip(rigid.bodies, rigid.moments, strict=True):
                forces[one.carriers[1]] += moment / one.radius
        return forces

    # ---- energy

    @ti.kernel
    def _potential_kernel(self, out: ti.types.ndarray()):
        for block in range(self.triangles.bounds[None].blocks):
            total = ti.Vector.zero(self.fp, 2)
            for t in range(self.triangles.first(block), self.triangles.first(block + 1)):
                total += self.triangles.energy(t)
            for c in ti.static(range(2)):
                out[block, c] = total[c]

    @ti.kernel
    def _other_potential_kernel(self, out: ti.types.ndarray()):
        """Adds what terms beside the triangles store; a kernel of its own, so that without them nothing changes in the first."""
        for block in range(self.triangles.bounds[None].blocks):
            blocks = self.triangles.bounds[None].blocks
            total = ti.Vector.zero(self.fp, 2)
            for term in ti.static(self.terms[1:]):
                length = (term.count() + blocks - 1) // blocks
                for e in range(block * length, ti.min((block + 1) * length, term.count())):
                    total += term.energy(e)
            length = (self.bounds[None].nodes + blocks - 1) // blocks
            for i in range(block * length, ti.min((block + 1) * length, self.bounds[None].nodes)):
                for term in ti.static(self.node_terms):
                    total[0] += term.energy(i)
            for c in ti.static(range(2)):
                out[block, c] = out[block, c] + total[c]

    def potential_energy(self, loads: Floats) -> tuple[float, float]:
        """Total potential (stored energy less work of pressure and dead loads) and stored energy, force times length."""
        sums = np.zeros((self.triangles.block_count, 2), dtype=self.dtype)
        self._potential_kernel(sums)
        if len(self.terms) > 1 or self.node_terms:
            self._other_potential_kernel(sums)
        stored, work = sums.astype(np.float64).sum(axis=0)
        displacement = self.displacement()
        done = sum(rigid.work(displacement) for rigid in self.rigid)
        return float(stored - work - np.vdot(loads, displacement) - done), float(stored)

    # ---- what a run sets and asks

    def set_displacement(self, displacement: Floats) -> None:
        """Set all nodal displacements, (node_count, 3) lengths; nodes of a body have to lie as it does."""
        super().set_displacement(displacement)
        for rigid in self.rigid:
            rigid.settle(displacement)

    def set_surface_loads(self, values: Floats) -> None:
        """Set the values of all loads on the surface: each chamber's pressure, winds, loads per plan area, levels."""
        self.pressure.set(values[: self.structure.pressure_count])
        self.snow.set(values[self.structure.snow_values])
        self.water.set(values[self.structure.water_values])

    def surface_loads(self) -> Floats:
        """Present values of all loads on the surface, on which the tangent depends; pressures of the chambers first."""
        pressures = self.pressure.values()
        if not (self.snow.used or self.water.used):
            return pressures
        return np.concatenate([pressures, self.snow.values(), self.water.values()])

    def tangent_state(self) -> tuple[Floats, ...]:
        """All that a run sets and the tangent depends on: dead loads only where they turn rigid bodies."""
        return (
            self.displacement(),
            self.surface_loads(),
            self.growth(),
            *([self.loads] if self.rigid and self.features.loads else []),
            *(
                array
                for one in self.contacts
                for array in (one.rest_gap, one.stiffness, one.multiplier, np.array(one.value))
            ),
        )

    # ---- contact

    @ti.kernel
    def _contact_kernel(self, out: ti.types.ndarray()):
        for i in range(self.bounds[None].nodes):
            for number, term in ti.static(enumerate(self.contacts)):
                gap, normal, _curvature = term.distance(i)
                out[number, i, 0] = gap
                out[number, i, 1] = term.push(i, gap)
                for c in ti.static(range(3)):
                    out[number, i, 2 + c] = normal[c]

    def touching(self) -> Touching:
        """Gaps, contact forces and normals at the present displacements."""
        out = np.zeros((len(self.contacts), self.node_count, 5), dtype=self.dtype)
        if self.contacts:
            self._contact_kernel(out)
        values = out.astype(np.float64)
        friction = np.zeros((*values.shape[:2], 3))
        for one in self.frictions:
            friction[one.contact.number] = one.forces()
        return Touching(gap=values[..., 0], push=values[..., 1], normal=values[..., 2:], friction=friction)

    def place_obstacles(self, values: Mapping[str, float]) -> None:
        """Move obstacles, by the names of their motions."""
        for one in self.contacts:
            value = values.get(one.obstacle.name, 0.0)
            if value != one.value:
                one.place(value)

    @property
    def geometry(self) -> TriangleGeometry:
        """Geometry of the triangles at rest, where strain is sampled."""
        return self.triangles.geometry

    def element_state(self) -> ElementState:
        """Strain, stress and wrinkling state at every point of every triangle, at the present displacements."""
        return self.triangles.element_state()

    def cable_forces(self) -> Floats:
        """(n,) force of each straight piece of a cable, in the order of :attr:`.Structure.cable_sides`, tension positive."""
        forces = [one.forces() for one in (self.cables, self.ropes) if one is not None]
        return np.concatenate([np.zeros(0), *forces]) + 0.0  # no negative zeros

    def scale_thickness(self, fabric_number: int, factor: float) -> None:
        """Give one fabric so many times its thickness; 1 restores it."""
        self.triangles.scale_thickness(fabric_number, factor)

    def swept_volumes(self, displacement: Floats) -> Floats:
        """(tri_count,) volume each triangle has swept since rest."""
        return swept_volumes(self.structure, displacement)

    def set_growth(self, values: Floats) -> None:
        """Set the value of each driver of stress-free strain."""
        self.offset.set(values)

    def growth(self) -> Floats:
        """Present values of the drivers of stress-free strain."""
        return self.offset.now

    def stress_norm(self) -> float:
        """Size of the nodal forces of the elements by themselves at the present state."""
        level = np.linalg.norm(self.element_state().stress, axis=1) * self.structure.by_sample(self.structure.thickness)
        return float(np.sqrt((level**2 * self.geometry.area).sum()))

    def self_stress_norm(self, growth: Floats | None = None) -> float:
        """Size of the nodal forces that prestress and hindered stress-free strain balance, a scale for residuals.

        :param growth: values of the drivers of stress-free strain; those that are set when None.
        """
        return self_stress_norm(self.structure, self.offset.now if growth is None else growth)
