"""Where the error of a probe comes from: what each element is thought to contribute, which ranks them and estimates nothing.

The state carried over to the mesh cut in four is out of balance there by r: dual-weighted residuals (Becker and Rannacher 2001)
are what r works along z - P a, the adjoint on that mesh less the coarse one carried over. They are shared out by the coarse mesh's
shape functions, a partition of unity (Richter and Wick 2015), so that what neighbouring nodes undo does not count. Material, pull
and shape enter alike. Distances of stresses from recovered ones were tried and left: of a film of even tension, whose stress hardly
changes, they see nothing. So was r · P a, by which nodes moved to the true surface are out of balance alone: it halves where the
error of the shape is quartered, and leads to rims of far too many elements.
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.arrays import Floats
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.equilibrium import Equilibrium
from taichi_membrane.simulation.refined import Refined
from taichi_membrane.simulation.sensitivity import adjoint_of


def adjoint(equilibrium: Equilibrium, probe: str) -> Floats | None:
    """(node_count, 3) what unit forces at the nodes change a probe by at the present equilibrium; None where that is singular."""
    newton = equilibrium.newton
    factor = None if newton is None else newton.at_rest()
    if newton is None or factor is None:
        return None
    system = equilibrium.system
    found = adjoint_of(equilibrium.model, newton, factor, probe, system.displacement())
    return None if found is None else system.from_frames(found)


def indicator(
    mesh: Mesh, coarse: Floats, displacement: Floats, fine: Refined, equilibrium: Equilibrium, probe: str
) -> Floats | None:
    """(tri_count,) what elements are thought to contribute to a probe's error; None where the fine equilibrium is singular.

    :param coarse: (node_count, 3) adjoint on the mesh, at its equilibrium of ``displacement``.
    :param equilibrium: on the mesh cut in four, at its own end of the same load step.
    """
    weight, newton = adjoint(equilibrium, probe), equilibrium.newton
    if weight is None or newton is None:
        return None
    system = equilibrium.system
    position = system.displacement()
    system.set_displacement(fine.displacement(displacement))
    left = system.spread(newton.free_force())
    system.set_displacement(position)
    carry = fine.prolongation
    shared = carry.T @ (left * (weight - carry @ coarse)).sum(axis=1)
    cells = mesh.cells
    area = np.repeat(mesh.tri_areas(), cells.shape[1])
    around = np.bincount(cells.ravel(), weights=area, minlength=mesh.node_count)
    share = np.abs(shared) / np.where(around > 0.0, around, 1.0)
    return np.asarray((area * share[cells.ravel()]).reshape(cells.shape).sum(axis=1))
