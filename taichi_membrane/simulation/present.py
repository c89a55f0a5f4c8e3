"""What the fields of a load step are computed from: the state downloaded once, and what follows from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane import fields
from taichi_membrane.mechanics.element_state import ElementState
from taichi_membrane.mechanics.preparation import Floats, sample_sides
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mesh import Mesh
from taichi_membrane.mesh.quadratic import LUMPED, RULES, areas
from taichi_membrane.names import WRINKLED


@dataclass(frozen=True, kw_only=True, eq=False)
class Present:
    """A structure at one instant.

    :param displacement: (n, 3).
    :param reaction: (n, 3) support forces.
    :param contact_force: (n, 3) forces of planes and obstacles; ``contact_push`` (n,) sizes of what is across them, summed.
    :param elements: state at every point where strain is sampled.
    :param cable_force: force of every straight piece of a cable.
    :param free_strain: (m, 2) stress-free strain in warp and weft, where something drives it.
    :param allowed: (m, 3) resultants along warp, weft and of the major one that use up each element's fabric, where some have a
        strength: strength over safety factor and factor on effects; undefined of those without.
    """

    structure: Structure
    displacement: Floats
    reaction: Floats
    elements: ElementState
    contact_force: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    contact_push: Floats = field(default_factory=lambda: np.zeros(0))
    cable_force: Floats = field(default_factory=lambda: np.zeros(0))
    free_strain: Floats | None = None
    allowed: Floats | None = None

    def __getattr__(self, name: str) -> Any:
        """What the elements know of themselves, by name: of six-node ones the mean of their points, by area."""
        if name.startswith("_") or name in ("elements", "structure"):
            raise AttributeError(name)
        return self.structure.mean_of_samples(getattr(self.elements, name))

    @property
    def state(self) -> NDArray[np.int8]:
        """(m,) state of every triangle: taut or slack where all its points are, else wrinkled."""
        if self.structure.samples == 1:
            return self.elements.state
        points = self.point_state
        return np.where((points == points[:, :1]).all(axis=1), points[:, 0], WRINKLED).astype(np.int8)

    def _at_points(self, values: NDArray[Any]) -> NDArray[Any]:
        return values.reshape(-1, self.structure.samples)

    @property
    def point_state(self) -> NDArray[np.int8]:
        """(m, samples) state at each point of every triangle."""
        return self._at_points(self.elements.state)

    @property
    def point_taut_margin(self) -> Floats:
        """(m, samples) :attr:`ElementState.taut_margin` at each point."""
        return self._at_points(self.elements.taut_margin)

    @property
    def point_slack_margin(self) -> Floats:
        """(m, samples) :attr:`ElementState.slack_margin` at each point."""
        return self._at_points(self.elements.slack_margin)

    @property
    def point_major_stress(self) -> Floats:
        """(m, samples) major principal stress at each point."""
        return self._at_points(self._principal[0])

    def fields(self, extra: Collection[str] = ()) -> dict[str, NDArray[Any]]:
        """The values of all fields, by name, with the named optional ones."""
        return {one.name: one.of(self) for one in fields.of(extra)}

    @property
    def contact_pressure(self) -> Floats:
        """(n,) what obstacles push with across themselves over the node's area, a third of each deformed element around it."""
        size = self.contact_push
        if not size.any():
            return size
        area = node_area(self.structure.mesh, self.displacement)
        return np.divide(size, area, out=np.zeros_like(size), where=(size > 0.0) & (area > 0.0))

    @property
    def major_stress(self) -> Floats:
        """(m,) major principal stress (second Piola–Kirchhoff)."""
        return self.structure.mean_of_samples(self._principal[0])

    @property
    def minor_stress(self) -> Floats:
        """(m,) the other one."""
        return self.structure.mean_of_samples(self._principal[1])

    @cached_property
    def _principal(self) -> tuple[Floats, Floats, Floats]:
        """Major and minor stress, and the angle of the major one from the warp."""
        warp, weft, shear = self.elements.stress.T
        major, minor = _principal_values(warp, weft, shear)
        return major, minor, 0.5 * np.arctan2(shear, 0.5 * (warp - weft))

    @property
    def major_direction(self) -> Floats:
        """(m, 3) unit vectors of the deformed elements that those of the major stress at rest are carried to."""
        structure, (major, _, angle) = self.structure, self._principal
        geometry = structure.geometry
        unit = self._carried(np.cos(angle)[:, None] * geometry.warp + np.sin(angle)[:, None] * geometry.weft)
        if structure.samples == 1:
            return unit
        # A direction and its opposite are one: what has a mean is d⊗d, of points that bear something.
        weight = np.maximum(major, 0.0) + np.finfo(float).tiny
        mean = structure.mean_of_samples(weight[:, None, None] * unit[:, :, None] * unit[:, None, :])
        return np.asarray(np.linalg.eigh(mean)[1][:, :, 2])

    def _carried(self, tangent: Floats) -> Floats:
        """Unit vectors of the deformed elements that directions at rest, in their planes, are carried to; zero where none is."""
        structure = self.structure
        rest = sample_sides(structure.mesh, structure.points, structure.samples)
        first, second = rest[:, 2], -rest[:, 1]
        normal = np.cross(first, second)
        squared = np.einsum("ij,ij->i", normal, normal)
        along_first = np.einsum("ij,ij->i", np.cross(tangent, second), normal) / squared
        along_second = np.einsum("ij,ij->i", np.cross(first, tangent), normal) / squared
        now = sample_sides(structure.mesh, structure.points + self.displacement, structure.samples)
        moved = along_first[:, None] * now[:, 2] - along_second[:, None] * now[:, 1]
        length = np.linalg.norm(moved, axis=1, keepdims=True)
        return np.asarray(moved / np.where(length > 0.0, length, 1.0))

    @property
    def major_resultant(self) -> Floats:
        """(m,) major principal Cauchy stress resultant, force per deformed width."""
        return self.structure.mean_of_samples(self._principal_resultant[0])

    @property
    def minor_resultant(self) -> Floats:
        """(m,) the other one."""
        return self.structure.mean_of_samples(self._principal_resultant[1])

    @property
    def warp_resultant(self) -> Floats:
        """(m,) Cauchy stress resultant along the deformed warp: force across a cut square to it, per deformed width."""
        return self.structure.mean_of_samples(self._across_warp[0])

    @property
    def weft_resultant(self) -> Floats:
        """(m,) Cauchy stress resultant along the deformed weft, which shear turns out of square to the warp."""
        return self.structure.mean_of_samples(self._across_weft[0])

    @property
    def shear_resultant(self) -> Floats:
        """(m,) Cauchy shear stress resultant on a cut square to the deformed warp, positive towards the weft."""
        return self.structure.mean_of_samples(self._across_warp[1])

    @property
    def utilisation(self) -> Floats:
        """(m,) largest share of a strength that is used, at any point where strain is sampled; undefined without a strength."""
        assert self.allowed is not None  # the scene names the field only where it has strengths
        acting = (self._across_warp[0], self._across_weft[0], self._principal_resultant[0])
        limits = np.repeat(self.allowed, self.structure.samples, axis=0)
        share = (np.stack(acting, axis=1) / limits).max(axis=1).clip(0.0)
        return np.asarray(self._at_points(share).max(axis=1))

    @cached_property
    def _across_warp(self) -> tuple[Floats, Floats]:
        return self._along(self.structure.geometry.warp)

    @cached_property
    def _across_weft(self) -> tuple[Floats, Floats]:
        return self._along(self.structure.geometry.weft)

    def _along(self, rest: Floats) -> tuple[Floats, Floats]:
        """Normal and shear Cauchy resultants of a cut square to the deformed direction of a fabric's direction at rest."""
        (xx, yy, xy), along, across = self._resultant
        direction = self._carried(rest)
        c, s = np.einsum("ij,ij->i", direction, along), np.einsum("ij,ij->i", direction, across)
        return xx * c * c + yy * s * s + 2.0 * xy * c * s, (yy - xx) * c * s + xy * (c * c - s * s)

    @cached_property
    def _principal_resultant(self) -> tuple[Floats, Floats]:
        """Principal Cauchy stress resultants."""
        return _principal_values(*self._resultant[0])

    @cached_property
    def _resultant(self) -> tuple[tuple[Floats, Floats, Floats], Floats, Floats]:
        """Components xx, yy, xy of the Cauchy stress resultants, from the forces along the deformed sides, and their unit vectors.

        Side a with its vector s and force density q (its force over its length) bears q s⊗s of virtual work per virtual strain, so
        that N = Σ q s⊗s / A, A the deformed area: for Green's side strain t F S Fᵀ/J, t the thickness at rest.
        """
        side, density = side_forces(self.structure, self.displacement, self.elements.stress)
        length = np.linalg.norm(side, axis=2)
        normal = np.cross(side[:, 0], side[:, 1])
        double_area = np.linalg.norm(normal, axis=1)
        flat = double_area > 0.0  # one without area bears nothing
        along = side[:, 0] / np.where(length[:, :1] > 0.0, length[:, :1], 1.0)
        across = np.cross(normal, along) / np.where(flat, double_area, 1.0)[:, None]
        x, y = np.einsum("iaj,ij->ia", side, along), np.einsum("iaj,ij->ia", side, across)
        scale = np.where(flat, 2.0 / np.where(flat, double_area, 1.0), 0.0)
        if self.structure.samples > 1:
            scale = scale / np.tile(RULES[self.structure.samples].weights, self.structure.mesh.tri_count)
        xx, yy, xy = (scale * (density * one * other).sum(axis=1) for one, other in ((x, x), (y, y), (x, y)))
        return (xx, yy, xy), along, across


def side_forces(structure: Structure, displacement: Floats, stress: Floats) -> tuple[Floats, Floats]:
    """(m, 3, 3) vectors of the deformed sides where strain is sampled, and (m, 3) force densities (force over length) along them.

    :param stress: (m, 3) second Piola–Kirchhoff stress in fabric axes.
    """
    geometry = structure.geometry
    side = sample_sides(structure.mesh, structure.points + displacement, structure.samples)
    length = np.linalg.norm(side, axis=2)
    green = structure.by_sample(structure.green)
    volume = geometry.area * structure.by_sample(structure.thickness)
    natural = volume[:, None] * np.einsum("iba,ib->ia", geometry.strain_matrix, stress)
    reach = np.where(green[:, None], geometry.side_length, length)
    return side, np.divide(natural, reach, out=np.zeros_like(natural), where=reach > 0.0)


def node_area(mesh: Mesh, displacement: Floats) -> Floats:
    """(n,) area of each node: a third of each deformed element around it; of six-node ones its lumped share."""
    if mesh.order == 2:
        share = (LUMPED * areas(mesh.points + displacement, mesh.cells)[:, None]).ravel()
        return np.bincount(mesh.cells.ravel(), weights=share, minlength=mesh.node_count).astype(np.float64, copy=False)
    corners = (mesh.points + displacement)[mesh.triangles]
    directed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    share = np.repeat(np.linalg.norm(directed, axis=1) / 6.0, 3)
    return np.bincount(mesh.triangles.ravel(), weights=share, minlength=mesh.node_count).astype(np.float64, copy=False)


def _principal_values(first: Floats, second: Floats, shear: Floats) -> tuple[Floats, Floats]:
    """Larger and smaller principal value of plane symmetric tensors."""
    mean, radius = 0.5 * (first + second), np.hypot(0.5 * (first - second), shear)
    return mean + radius, mean - radius
