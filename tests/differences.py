"""Forces against their energy, tangents against forces, masses against tangents: by central differences in every component."""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.solvers.relaxation import Relaxation


def check_components(system: System, *, to: float) -> None:
    """Forces come from the energy, the tangent from the forces, and masses bound it; at the system's present state."""
    u, step, count = system.displacement(), 1e-6, 3 * system.node_count
    matrix, balance = Tangent(system).matrix().toarray(), system.out_of_balance().ravel()
    slope, differences = np.zeros(count), np.zeros((count, count))
    for k, unit in enumerate(np.eye(count)):
        energies, balances = [], []
        for sign in (1.0, -1.0):
            system.set_displacement(u + sign * step * unit.reshape(u.shape))
            energies.append(system.potential_energy(np.zeros_like(u))[0])
            balances.append(system.out_of_balance().ravel())
        slope[k] = (energies[0] - energies[1]) / (2 * step)
        differences[:, k] = (balances[1] - balances[0]) / (2 * step)
    assert np.abs(slope + balance).max() < to * np.abs(balance).max()
    assert np.abs(differences - matrix).max() < to * np.abs(matrix).max()
    system.set_displacement(u)
    four_masses = 4.0 * np.repeat(Relaxation(system).masses(), 3)
    assert np.linalg.eigvalsh(np.diag(four_masses) - matrix).min() > 0.0
