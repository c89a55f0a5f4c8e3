"""What is added to an element's strain before the fabric answers: the strain that stands for prestress, less the stress-free one.

The wrinkling laws, energies and tangents need not know of either. The free fabric's relative extension e in warp and weft is the
sum of what shrinkage and warmth give; the strain of that extension is e for engineering side strain, e + e²/2 for Green's, so that
a free element changes its length by exactly e.
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.nodes import few, fill, room
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure


@ti.data_oriented
class StrainOffset:
    """The offsets: none, one for each fabric, or one for each element where they may differ within a fabric."""

    def __init__(self, structure: Structure, fp, dtype) -> None:
        self.fp, self.dtype, self.place = fp, dtype, structure.features().offset
        self.used = self.place != "none"
        if self.place == "by_fabric":
            self.fabric_prestrain = ti.Vector.field(3, fp, shape=few(len(structure.fabrics)))
        if self.place == "by_element":
            self.tri_offset = ti.Vector.field(3, fp, shape=room(structure.mesh.tri_count))

    def accepts(self, structure: Structure) -> bool:
        """Whether another structure of the same features fits these fields."""
        if self.place == "by_fabric":
            return len(structure.fabrics) <= self.fabric_prestrain.shape[0]
        return self.place == "none" or structure.mesh.tri_count <= self.tri_offset.shape[0]

    def upload(self, structure: Structure) -> None:
        """Take over a structure's prestress; nothing has grown or shrunk yet."""
        self.structure = structure
        self.now = np.zeros(structure.growth_count)
        if self.place == "by_fabric":
            offsets = [one.compliance() @ np.array(one.prestress) for one in structure.fabrics]
            fill(self.fabric_prestrain, np.array(offsets, dtype=self.dtype))
        if self.place == "by_element":
            self._fill()

    def set(self, values: Floats) -> None:
        """Set the value of each driver of stress-free strain."""
        if not np.array_equal(values, self.now):
            self.now = np.array(values)
            self._fill()

    def _fill(self) -> None:
        fill(self.tri_offset, strain_offsets(self.structure, self.now).astype(self.dtype))

    @ti.func
    def of(self, t, k):
        """What is added to the strain of triangle ``t``, of fabric ``k``."""
        offset = ti.Vector.zero(self.fp, 3)
        if ti.static(self.place == "by_fabric"):
            offset = self.fabric_prestrain[k]
        if ti.static(self.place == "by_element"):
            offset = self.tri_offset[t]
        return offset


def strain_offsets(structure: Structure, values: Floats) -> Floats:
    """(tri_count, 3) strain that stands for prestress, less the stress-free strain at values of its drivers.

    A prestress is the elastic answer to a strain.
    """
    prestrain = np.zeros((structure.mesh.tri_count, 3))
    for number, one in enumerate(structure.fabrics):
        members = structure.tri_fabric == number
        prestrain[members] = structure.prestress[members] @ one.compliance()
    prestrain[:, :2] -= structure.free_strain(values)
    return prestrain


def self_stress_norm(structure: Structure, values: Floats) -> float:
    """Size of the nodal forces that prestress and hindered stress-free strain balance, a scale for residuals where no load acts."""
    if structure.growth is None and structure.tri_prestress is None:
        level = np.array([np.linalg.norm(one.prestress) for one in structure.fabrics])[structure.tri_fabric]
    else:
        stress = strain_offsets(structure, values)
        for number, one in enumerate(structure.fabrics):
            members = structure.tri_fabric == number
            stress[members] = stress[members] @ one.stiffness()
        level = np.linalg.norm(stress, axis=1)
    level = level * structure.thickness
    squared = (level**2 * structure.tri_area).sum()
    if structure.cables is not None:
        squared += (structure.cables.prestress**2).sum()
    if structure.ropes is not None:
        squared += (structure.ropes.prestress**2).sum()
    return float(np.sqrt(squared))
