"""Parts that meet in one structure: springs, cables that end or slide on rigid bodies, shut gas behind them, shrinkage, planes."""

from __future__ import annotations

import numpy as np
import pytest
from test_bodies import check_differences, check_masses, moved, with_bodies

from taichi_membrane.mechanics.preparation import Cables, Ropes, Springs
from taichi_membrane.mechanics.system import System

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def springs() -> Springs:
    """On nodes of both bodies, carriers and others, two at one of them, and on a node of the fabric."""
    direction = np.random.default_rng(6).normal(size=(6, 3))
    return Springs(
        nodes=np.array([0, 5, 5, 7, 9, 2]),
        stiffness=np.linspace(0.5, 2.0, 6),
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        kind=np.array([0, 1, 0, -1, 0, 0]),
    )


def cables() -> Cables:
    """From body to body, from a body to the fabric, and within a body."""
    return Cables(
        nodes=np.array([[5, 9], [7, 4], [0, 5]]),
        length=np.array([0.7, 0.9, 1.0]),
        stiffness=np.array([2.0, 3.0, 1.5]),
        prestress=np.array([0.1, 0.2, 0.3]),
        bar=np.array([False, True, True]),
    )


def ropes() -> Ropes:
    """Over the fabric from body to body, and a closed one over two nodes of a body."""
    return Ropes(
        chain=np.array([5, 4, 9, 7, 0, 6]),
        start=np.array([0, 3, 6]),
        closed=np.array([False, True]),
        length=np.array([1.0, 2.0]),
        stiffness=np.array([2.0, 1.5]),
        prestress=np.array([0.2, 0.1]),
    )


def test_members_act_on_the_freedoms_of_bodies() -> None:
    """Energy, forces and tangent agree, and masses bound the stiffness, with members at nodes of bodies that have turned."""
    system = System(with_bodies(springs=springs(), cables=cables(), ropes=ropes()))
    system.set_surface_loads(np.array([0.3]))
    system.set_displacement(moved(system, 0.05))
    check_differences(system, np.random.default_rng(1).normal(size=(12, 3)) * 0.1)
    for seed in range(3):
        system.set_displacement(moved(system, 0.2, seed))
        check_masses(system)
