"""Dynamic relaxation with kinetic damping on a fictitious mass that bounds the stiffness.

The structure moves freely (no damping) with time step 1; whenever its kinetic energy passes a peak it is set back to that peak and
starts again from rest (eqs. 17-22 of the seed paper). Central differences are stable while 4 M ≥ K in the sense of the
highest eigenvalue. With k the bound of :func:`element.side_stiffness_bound` for each side, K ≤ 2 Σ k at each node, hence
M = ½ Σ k: the seed's eq. 19 with its inequality the right way round, and with the side-to-side coupling that its diagonal sum
leaves out.

A small residual alone is no equilibrium: a mode of frequency ω that is out of balance by r is M⁻¹ r/ω² away from it. From
rest to a peak is a quarter of a period, so the longest such swing, of n iterations, is that of the slowest mode seen: ω = π/(2n).
Converged is a state whose residual is small and whose energy ½ v·M v + ½ r·M⁻¹ r/ω² is small beside ½ ω² u·M u, that of the whole
displacement u.

Peak search, step back and the test of the residual happen on the device; the host looks at the result now and then, and tests
the energy when the residual is small enough.
"""

import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from taichi_membrane.device import runtime
from taichi_membrane.device.language import ti
from taichi_membrane.mechanics.bodies import ORDINARY
from taichi_membrane.mechanics.nodes import GROUPS, read
from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.solvers.record import Progress, Reference, SolveRecord, force_now

RUNNING, CONVERGED, NOT_FINITE = 0, 1, 2

# At convergence the kinetic energy must have died as well, to this share of the step's largest; and all energy that is left,
# to this share of that of the whole displacement in the slowest mode: a hundredth of the displacement.
_KINETIC_SHARE, _SETTLED_SHARE = 1e-2, 1e-4
# Where the energy refuses a state, it is looked at again when the residual has fallen by as much as it was too large, within these.
_LEAST_FALL, _LARGEST_FALL = 0.9, 0.1
# The host reads the device's verdict after this many iterations at most (a read costs about one iteration of a small mesh).
_POLL = 32
# Masses follow the geometry: refreshed at first every iteration, then at intervals that double while none grows by 1 %.
_LONGEST_REFRESH, _GROWTH = 256, 1.01
# What the device keeps of the iterations: whole numbers, and others.
_COUNTS = ("status", "peak", "iterations", "mass_grew", "swing", "longest_swing")
_NUMBERS = ("gain", "back", "energy", "energy_before", "energy_largest", "residual")
# A residual that has not fallen by a tenth in this many iterations has met round-off.
_STAGNATION, _STAGNATION_FALL = 20_000, 0.9


@ti.data_oriented
class Relaxation:
    """Dynamic relaxation of one system; owns velocities, masses and the energy history."""

    def __init__(self, system: System) -> None:
        m = system
        self.system = m
        self.fp = m.fp
        self.two_levels = not runtime.current().on_cpu
        nodes = m.node_rest.shape[0]
        self.node_velocity = ti.Vector.field(3, m.fp, shape=nodes)
        self.node_force = ti.Vector.field(3, m.fp, shape=nodes)
        self.node_mass = ti.field(m.fp, shape=nodes)
        control = ti.types.struct(**dict.fromkeys(_COUNTS, ti.i32), **dict.fromkeys(_NUMBERS, m.fp))
        self.control = control.field(shape=())
        if self.two_levels:
            self.group_sum = ti.Vector.field(2, m.fp, shape=GROUPS)

    # ---- kernels

    @ti.func
    def free_part(self, i, force):
        """The force at a node with its held components removed."""
        held = self.system.node_held[i]
        local = force
        if ti.static(self.system.features.slanted):
            local = self.system.node_frame[i] @ force
        free = ti.Vector([local[c] * ti.cast(1 - held[c], self.fp) for c in ti.static(range(3))])
        if ti.static(self.system.features.slanted):
            free = self.system.node_frame[i].transpose() @ free
        return free

    @ti.func
    def total_of_blocks(self):
        """Sum of the block sums in a fixed order (the groups, where there are two levels, are already summed)."""
        total = ti.Vector.zero(self.fp, 2)
        if ti.static(self.two_levels):
            ti.loop_config(serialize=True)
            for group in range(self.system.bounds[None].groups):
                total += self.group_sum[group]
        else:
            ti.loop_config(serialize=True)
            for block in range(self.system.bounds[None].node_blocks):
                total += self.system.block_sum[block]
        return total

    @ti.func
    def sum_group(self, group):
        """Second level of the block sums."""
        total = ti.Vector.zero(self.fp, 2)
        length = self.system.bounds[None].group_length
        for block in range(group * length, ti.min((group + 1) * length, self.system.bounds[None].node_blocks)):
            total += self.system.block_sum[block]
        self.group_sum[group] = total

    @ti.func
    def accelerate(self, i, gain, reference):
        """Velocity of node ``i`` half a step on (eq. 18); returns kinetic energy and squared residual over the reference."""
        force = self.free_part(i, self.system.acting_force(i))
        self.node_force[i] = force
        mass = self.node_mass[i]
        velocity = self.node_velocity[i] + gain / mass * force
        self.node_velocity[i] = velocity
        # Divided before it is squared: in single precision the square of a small structure's force is zero.
        relative = force / reference
        return ti.Vector([0.5 * mass * velocity.dot(velocity), relative.dot(relative)])

    @ti.func
    def judge(self, kinetic, squared_residual, tolerance):
        """Decide whether the energy has passed a peak, whether the state has converged, and how far to step back."""
        c = self.control[None]
        c.residual = ti.sqrt(squared_residual)
        c.iterations += 1
        c.swing += 1
        c.longest_swing = ti.max(c.longest_swing, c.swing)
        c.peak = 0
        if not (kinetic + squared_residual < ti.cast(ti.math.inf, self.fp)):
            c.status = NOT_FINITE
        elif c.residual <= tolerance and c.energy <= _KINETIC_SHARE * c.energy_largest:
            c.status = CONVERGED
        elif kinetic < c.energy:
            # Parabola through three energies at times -1, 0, 1; the peak lies within half a step of the middle one.
            curvature = c.energy_before - 2.0 * c.energy + kinetic
            offset = ti.cast(0.0, self.fp)
            if curvature < 0.0:
                offset = 0.5 * (c.energy_before - kinetic) / curvature
            c.back = 0.5 - ti.min(ti.max(offset, -0.5), 0.5)
            c.peak = 1
            c.swing = 0
            c.energy = 0.0
            c.energy_before = 0.0
        else:
            c.energy_before = c.energy
            c.energy = kinetic
            c.energy_largest = ti.max(c.energy_largest, kinetic)
        self.control[None] = c

    @ti.func
    def move(self, i, gain):
        """Move node ``i`` by one step (eq. 21), or back to the energy peak and to rest."""
        for rigid in ti.static(self.system.rigid):
            rigid.note(i, ti.Vector.zero(self.fp, 3))
        if self.control[None].peak == 1:
            before = self.node_velocity[i] - gain / self.node_mass[i] * self.node_force[i]
            self.shift(i, -self.control[None].back * before)
            self.node_velocity[i] = ti.Vector.zero(self.fp, 3)
        elif self.control[None].status == RUNNING:
            self.shift(i, self.node_velocity[i])

    @ti.func
    def shift(self, i, step):
        """Add to the displacement of node ``i``, or note the step of the freedoms of a body that it carries."""
        if ti.static(not self.system.features.bodies):
            self.system.add_displacement(i, step)
        for rigid in ti.static(self.system.rigid):
            if rigid.node_part[i] == ORDINARY:
                self.system.add_displacement(i, step)
            rigid.note(i, step)

    @ti.kernel
    def _iterate(self, tolerance: float, reference: float):
        for term in ti.static(self.system.terms):
            ti.loop_config(block_dim=self.system.block_dim)
            for e in range(term.count()):
                term.store_forces(e)
        for rigid in ti.static(self.system.rigid):
            for b in range(rigid.count):
                rigid.gather(b)
        for block in range(self.system.bounds[None].node_blocks):
            if self.control[None].status == RUNNING:
                gain = self.control[None].gain
                total = ti.Vector.zero(self.fp, 2)
                for i in range(self.system.first_node(block), self.system.first_node(block + 1)):
                    total += self.accelerate(i, gain, reference)
                self.system.block_sum[block] = total
        if ti.static(self.two_levels):
            for group in range(self.system.bounds[None].groups):
                self.sum_group(group)
        if self.control[None].status == RUNNING:
            total = self.total_of_blocks()
            self.judge(total[0], total[1], tolerance)
        ti.loop_config(block_dim=self.system.block_dim)
        for i in range(self.system.bounds[None].nodes):
            self.move(i, self.control[None].gain)
        for rigid in ti.static(self.system.rigid):
            for b in range(rigid.count):
                rigid.move(b)
        # The first velocity after a peak is half a step from rest.
        self.control[None].gain = ti.select(self.control[None].peak == 1, 0.5, 1.0)

    @ti.kernel
    def _refresh_mass(self, keep_larger: int):
        if ti.static(self.system.features.bodies):
            for term in ti.static(self.system.terms):
                for e in range(term.count()):
                    term.store_forces(e)
            for rigid in ti.static(self.system.rigid):
                for b in range(rigid.count):
                    rigid.gather(b)
        for term in ti.static(self.system.terms):
            ti.loop_config(block_dim=self.system.block_dim)
            for e in range(term.count()):
                term.store_bounds(e)
        for rigid in ti.static(self.system.rigid):
            for b in range(rigid.count):
                rigid.gather_mass(b)
        self.control[None].mass_grew = 0
        ti.loop_config(block_dim=self.system.block_dim)
        for i in range(self.system.bounds[None].nodes):
            mass = self.system.acting_mass(i)
            if keep_larger == 1:
                if mass >= _GROWTH * self.node_mass[i]:
                    self.control[None].mass_grew = 1  # whoever writes, it is the same number
                mass = ti.max(mass, self.node_mass[i])
            self.node_mass[i] = mass

    @ti.kernel
    def _begin(self, status: int):
        """No velocities, no history: one kernel, as each number written from the host would be one."""
        for i in self.node_velocity:
            self.node_velocity[i] = ti.Vector.zero(self.fp, 3)
        for number in ti.static(range(len(_COUNTS))):
            self.control.get_member_field(_COUNTS[number])[None] = 0
        for number in ti.static(range(len(_NUMBERS))):
            self.control.get_member_field(_NUMBERS[number])[None] = 0.0
        self.control[None].status = status
        self.control[None].gain = 0.5

    @ti.kernel
    def _go_on(self):
        """Run again after a convergence that the energy has refused."""
        self.control[None].status = RUNNING
        self.control[None].gain = 0.0  # this iteration's force has had its effect on the velocity

    @ti.kernel
    def _read_control(self, out: ti.types.ndarray()):
        for number in ti.static(range(len(_COUNTS))):
            out[number] = ti.cast(self.control.get_member_field(_COUNTS[number])[None], self.fp)
        for number in ti.static(range(len(_NUMBERS))):
            out[ti.static(len(_COUNTS) + number)] = self.control.get_member_field(_NUMBERS[number])[None]

    # ---- host

    def compile(self) -> None:
        """Compile the kernels without moving anything: the iteration runs once on a state that counts as converged."""
        self.start_from_rest()
        self._begin(CONVERGED)
        self._iterate(1.0, 1.0)

    def state(self) -> SimpleNamespace:
        """What the device has kept of the iterations so far."""
        out = np.empty(len(_COUNTS) + len(_NUMBERS), dtype=self.system.dtype)
        self._read_control(out)
        counts = {name: int(value) for name, value in zip(_COUNTS, out, strict=False)}
        return SimpleNamespace(**counts, **dict(zip(_NUMBERS, out[len(_COUNTS) :].tolist(), strict=True)))

    def masses(self) -> Floats:
        """(node_count,) fictitious masses at the present displacements; twice a mass bounds the stiffness at its node."""
        self._refresh_mass(0)
        return read(self.node_mass, self.system.node_count)

    def start_from_rest(self) -> None:
        """Forget velocities and energy history."""
        self._begin(RUNNING)
        self._refresh_mass(0)

    def _unsettled(self, start: Floats, reference: float) -> float:
        """Energy that is left over that of the whole displacement, both in the slowest mode; its root is a share of displacement.

        :param start: (node_count, 3) displacements that the solve began with: an unloaded structure ends with none.
        """
        count = self.system.node_count
        mass, force, velocity = (read(one, count) for one in (self.node_mass, self.node_force, self.node_velocity))
        slowness = max((2.0 / np.pi * self.state().longest_swing) ** 2, self._slowness_of_fabric())  # 1/ω²
        # Divided by the reference before they are squared: the squares of a small structure's forces are zero.
        unit = mass[:, None] / reference
        moving, moved, moved_before = (
            float((((unit * one) ** 2).sum(axis=1) / mass).sum())
            for one in (velocity, self.system.displacement(), start)
        )
        work = float((((force / reference) ** 2).sum(axis=1) / mass).sum())
        # As K ≤ 4 M, a load moves the structure by at least a quarter of its ratio to the mass; prestress may not move it at all.
        whole = max(moved, moved_before, 1.0 / (16.0 * mass.max()))
        return slowness * (moving + slowness * work) / whole

    def _slowness_of_fabric(self) -> float:
        """1/ω² of an element in its softest strain, at the mass that its stiffest asks for: the slowest mode is no faster.

        Where the load meets the stiffest strain alone, the residual hides slow modes, so that they are not seen to swing.
        """
        structure = self.system.structure
        to_tensor = np.array([1.0, 1.0, np.sqrt(0.5)])  # γ is √2 times the tensor's component
        ratios = []
        for k in np.unique(structure.tri_fabric):
            compliance = np.linalg.eigvalsh(structure.fabrics[k].compliance() * np.outer(to_tensor, to_tensor))
            ratios.append(compliance[-1] / max(compliance[0], np.finfo(float).eps * compliance[-1]))
        return 0.25 * float(max(ratios))

    def solve(
        self,
        *,
        tolerance: float,
        reference: Reference,
        max_iterations: int,
        report: Callable[[Progress], None] | None = None,
    ) -> SolveRecord:
        """Relax from the present displacements until the residual is below ``tolerance`` times ``reference`` and the energy agrees.

        :param reference: 2-norm of the acting nodal forces (force), to which the residual is compared; asked for at every look.
        :param report: called at every look of the host at the device.
        """
        started = time.perf_counter()
        self.start_from_rest()
        start, aim = self.system.displacement(), tolerance
        done, interval, next_refresh = 0, 1, 1
        best, best_at = np.inf, 0
        while done < max_iterations:
            batch = min(_POLL, next_refresh - done, max_iterations - done)
            now = force_now(reference)
            for _ in range(batch):
                self._iterate(aim, now)
            done += batch
            if done == next_refresh:
                self._refresh_mass(1)
            state = self.state()
            if report is not None:
                report(Progress(iteration=done, residual=state.residual, seconds=time.perf_counter() - started))
            if state.status == CONVERGED and (share := self._unsettled(start, now)) > _SETTLED_SHARE:
                aim = state.residual * min(max(float(np.sqrt(_SETTLED_SHARE / share)), _LARGEST_FALL), _LEAST_FALL)
                self._go_on()
                state.status = RUNNING
            if state.status != RUNNING or done - best_at > _STAGNATION:
                break
            if state.residual < _STAGNATION_FALL * best:
                best, best_at = state.residual, done
            if done == next_refresh:
                interval = max(interval // 2, 1) if state.mass_grew else min(2 * interval, _LONGEST_REFRESH)
                next_refresh = done + interval
        state = self.state()
        reason = {RUNNING: "iteration limit", CONVERGED: "residual", NOT_FINITE: "not finite"}[state.status]
        if state.status == RUNNING and done - best_at > _STAGNATION:
            reason = f"stagnated at a residual of {best:.1e}"
        if state.status == RUNNING and aim < tolerance:
            share = 100.0 * float(np.sqrt(self._unsettled(start, now)))
            reason += f"; displacements may be {share:.2g} % from equilibrium, though the residual is small enough"
        return SolveRecord(
            converged=state.status == CONVERGED,
            reason=reason,
            iterations=int(state.iterations),
            residual=float(state.residual) if np.isfinite(state.residual) else float("nan"),
            seconds=time.perf_counter() - started,
            method="relaxation",
        )
