"""Form finding: the shape in which membranes and cables are under given stress, whatever their stiffness.

The energy ∫ σ t dA of a uniform tension knows the surface alone: moving nodes within it changes nothing, so that its Hessian is
singular for flat meshes and as good as singular for others. Rounds of force densities are not: each takes the present shape as the
reference of the stress (constant second Piola–Kirchhoff stress; constant T/l of cables), which is a quadratic energy, positive
definite, and finds its equilibrium (K.-U. Bletzinger, E. Ramm, Int. J. Space Structures 14, 1999; of the area the iteration of U.
Pinkall and K. Polthier, Exp. Math. 2, 1993). Where a round moves nothing, stress refers to the shape it is in: it is Cauchy stress.
The first round is the linear force density method (H.-J. Schek, Comput. Methods Appl. Mech. Eng. 3, 1974).

Nodes drift within the surface far longer than the shape changes, and that matters to no one: the shape is found when the forces
that change it are in balance (:mod:`shape_space`). What is left within the surface is of the order of the elements' squared size;
the fabric takes it up by its stiffness, and the stresses that it then has, in equilibrium, are those of the rest shape.
Where no shape has the given stress everywhere, which is the rule for unequal warp and weft, they tell by how much.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.scene import Stage
from taichi_membrane.simulation import rest_shape
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.model import Model
from taichi_membrane.simulation.shape_space import ShapeSpace, answer
from taichi_membrane.solvers.record import Progress, SolveRecord, force_now

if TYPE_CHECKING:
    from taichi_membrane.simulation.equilibrium import Equilibrium, Report

# Moduli of the rounds over the stress: hardly anything resists, but a start that is slack somewhere stays regular.
_SOFT = 1e-3
_ROUNDS = 300
# An element that has shrunk to this share of its area in the mesh, against the mean, is taken for one of a neck that closes.
_CLOSED = 1e-2
# A surface that is so many times as large as in the mesh is one that its pressure drives on.
_GROWN = 30.0
_STRESS_TOLERANCE = 0.02
_SETTLINGS = 3
# How far above the tolerance rounds alone may end: as nodes drift within the surface they pull at it.
_DRIFT = 10.0
# Residual below which Newton's method is tried.
_NEAR = 0.1
_UNSTABLE = (
    "the shape is unstable: {} ways of moving it lower its energy; a film would leave it, for one with a wider neck, say, or "
    "close up"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Form:
    """A shape, found or not.

    :param model: the model at rest in it.
    :param stress: (tri_count, 3) in fabric axes; ``cable_force`` that of each straight piece of a cable.
    """

    model: Model
    stress: Floats
    cable_force: Floats
    record: SolveRecord


class Forming:
    """Finds the rest shape of a model at a load state.

    :param take: goes on with another model in the kernels compiled for this one.
    """

    def __init__(
        self, model: Model, equilibrium: Equilibrium, take: Callable[[Model], bool], stage: Stage, state: LoadState
    ) -> None:
        self.model, self.equilibrium, self.system, self._take = model, equilibrium, equilibrium.system, take
        self.stage, self.state = stage, state
        self.iterations = 0

    def find(self, report: Report) -> Form:
        """The shape, or the one reached with why it is none."""
        started = time.perf_counter()
        points, residual, trouble = self._rounds(report)
        if not trouble:
            points, residual, trouble = self._settle(points)
        here = rest_shape.asked(self.model, points)
        stress, cable_force = self._present(here)
        if not trouble:
            off, told = self._told(here, stress, cable_force)
            allowed = self.stage.stress_tolerance or _STRESS_TOLERANCE
            trouble = (
                f"no shape has this stress everywhere: {told}; off by {100 * off:.3g} % at most, where {100 * allowed:.3g} % are "
                "allowed (stress_tolerance)"
                if off > allowed
                else ""
            )
        final = rest_shape.found(self.model, points, stress, cable_force)
        self._use(final)
        record = SolveRecord(
            converged=not trouble, reason=trouble or f"form found: {told}", iterations=self.iterations, residual=residual,
            seconds=time.perf_counter() - started, method="form finding",
        )  # fmt: skip
        return Form(model=final, stress=stress, cable_force=cable_force, record=record)

    def _use(self, model: Model) -> None:
        """Bring a model at rest into the system, under the loads."""
        fits = self._take(model)
        assert fits  # the same elements and features
        self.equilibrium.apply(self.state)

    def _rounds(self, report: Report) -> tuple[Floats, float, str]:
        """Places, residual of the forces that change the shape, and why there is none.

        Rounds of force densities come near; then Newton's method moves nodes in the ways that change the shape, and no others.
        """
        points, first = self.model.structure.mesh.points, self.model.structure.geometry.area
        residual, bold = np.inf, True
        for number in range(_ROUNDS):
            here = rest_shape.soft(rest_shape.asked(self.model, points), _SOFT)
            self._use(here)
            space = ShapeSpace.of(here)
            force = space.components(self._free(here))
            before, residual = residual, self._relative(force)
            if report is not None:
                report(Progress(iteration=number, residual=residual, seconds=0.0))
            bold = bold or residual < before
            drifting = 1.0 if self.equilibrium.newton is not None else _DRIFT
            near = residual <= drifting * self.equilibrium.tolerance
            negative, step = self._newton(space, force) if near or (bold and residual < _NEAR) else (None, None)
            if near:
                return points, residual, _UNSTABLE.format(negative) if negative else ""
            if step is not None:
                moved = points + self.system.retract(np.zeros(step.shape), step)
                bold = residual < 0.5 * before or number == 0
                self.iterations += 1
            else:
                record = self.equilibrium.solve(self.state, None)
                if not record.converged:
                    record = self.equilibrium.solve(self.state, None, relax=True)
                self.iterations += record.iterations
                if not record.converged:
                    return points, residual, f"no shape found: round {number + 1} found no balance ({record.reason})"
                moved, bold = points + self.system.displacement(), True
            if trouble := _closed(here.structure, first, moved):
                return points, residual, trouble
            points = moved
        return points, residual, f"no shape found: after {_ROUNDS} rounds it still changes (residual {residual:.2g})"

    def _newton(self, space: ShapeSpace, force: Floats) -> tuple[int | None, Floats | None]:
        """How many ways lower the energy of the shape, and the movement that balances what changes it, where none does.

        Nothing is known without Newton's tangent, and where it is singular.
        """
        newton = self.equilibrium.newton
        if newton is None:
            return None, None
        tangent = newton.tangent.matrix()
        found = answer(space.stiffness(tangent), force)
        if found is None:
            return None, None
        return found.negative, space.movement(found.components, tangent) if found.negative == 0 else None

    def _free(self, model: Model) -> Floats:
        """(node_count, 3) out-of-balance forces on free freedoms, in the supports' axes."""
        return np.where(model.structure.node_held, 0.0, self.system.balance())

    def _relative(self, force: Floats) -> float:
        """Size of forces over that of what acts."""
        return float(np.linalg.norm(force)) / force_now(self.equilibrium.reference(self.state))

    def _settle(self, points: Floats) -> tuple[Floats, float, str]:
        """Places where the fabric's stiffness has taken up what is not in balance within the surface."""
        here, residual = rest_shape.asked(self.model, points), np.inf
        for _ in range(_SETTLINGS):
            self._use(here)
            record = self.equilibrium.solve(self.state, None)
            self.iterations += record.iterations
            if not record.converged:
                return points, record.residual, f"no shape found: the fabric finds no balance ({record.reason})"
            points = here.structure.mesh.points + self.system.displacement()
            moved = rest_shape.asked(self.model, points)
            stress = rest_shape.cauchy(
                here.structure, self.system.displacement(), self.system.element_state().stress, moved.structure
            )
            here = rest_shape.found(self.model, points, stress, self.system.cable_forces())
            self._use(here)
            residual = self._relative(self._free(here))
            if residual <= self.equilibrium.tolerance:
                break
        return points, residual, ""

    def _present(self, here: Model) -> tuple[Floats, Floats]:
        """Stresses and cable forces at rest in the shape that the system has now: those asked for where it has not settled."""
        structure = self.system.structure
        if structure.tri_prestress is not None and np.array_equal(structure.points, here.structure.points):
            return structure.tri_prestress, self.system.cable_forces()
        self._use(here)
        assert here.structure.tri_prestress is not None
        return here.structure.tri_prestress, self.system.cable_forces()

    def _told(self, asked: Model, stress: Floats, cable_force: Floats) -> tuple[float, str]:
        """Largest relative difference of what was found from what was asked, and the ranges in words."""
        worst, words, given = 0.0, [], asked.structure.prestress
        for number, (group, _) in enumerate(asked.fabric_names()):
            fabric, members = asked.structure.fabrics[number], asked.structure.tri_fabric == number
            if not members.any():
                continue
            largest = max(fabric.prestress[:2])
            tidy = np.where(np.abs(stress) < 1e-9 * largest, 0.0, stress)[members]
            worst = max(worst, float(np.abs(stress[members] - given[members]).max()) / largest)
            ranges = [
                f"{axis} {fabric.prestress[c]:.4g}, found {tidy[:, c].min():.5g} to {tidy[:, c].max():.5g}"
                for c, axis in enumerate(("warp", "weft", "shear"))
            ]
            name = "" if len(asked.fabric_names()) == 1 else f" of {group}"
            words.append(f"stress{name} asked in {'; '.join(ranges)}")
        nodes, owner = rest_shape.line_elements(asked.scene, asked.structure.mesh)
        ends = asked.structure.mesh.points[nodes]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        for number, (name, cable) in enumerate(asked.scene.cables.items()):
            mine = owner == number
            wanted = cable.force or cable.force_density
            if wanted is None:
                continue
            has = cable_force[mine] if cable.force is not None else cable_force[mine] / length[mine]
            worst = max(worst, float(np.abs(has - wanted).max()) / wanted)
            what = "force" if cable.force is not None else "force density"
            words.append(f"{what} of cable {name} asked {wanted:.4g}, found {has.min():.5g} to {has.max():.5g}")
        return worst, "; ".join(words)


def _closed(structure: Structure, first: Floats, points: Floats) -> str:
    """What a surface tells that closes up, where, and how far it has shrunk, or that grows on; empty where it does neither.

    :param first: (tri_count,) areas in the given mesh.
    """
    corners = points[structure.mesh.triangles]
    double = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(double, axis=1)
    growth = area.sum() / first.sum()
    if growth > _GROWN:
        return (
            f"no surface of this stress holds these loads: it grows on, to {growth:.3g} times its area in the mesh (a pressure "
            "above the largest that it bears)"
        )
    share = area / area.mean() * first.mean() / first
    worst = int(share.argmin())
    if share[worst] >= _CLOSED:
        return ""
    place = ", ".join(f"{value:.4g}" for value in corners[worst].mean(axis=0))
    return (
        f"no surface of this stress hangs in these supports: it closes up near ({place}), where element {worst} has shrunk to "
        f"{100 * area[worst] / first[worst]:.2g} % of its area (a neck between edges too far apart, or an edge that nothing holds)"
    )
