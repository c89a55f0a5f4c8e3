"""The straight way between two load states: equilibria on it with their stiffness, and whether two belong to one smooth path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.rim import symmetric
from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.policy import Policy
from taichi_membrane.solvers.in_contact import held_now
from taichi_membrane.solvers.newton import Newton
from taichi_membrane.solvers.path import PathPoint

# The force of a motion, of a liquid's level, or of stress-free strain is a difference over this share of the way, either side:
# rounding leaves 1e-10 of it. Ten times more changes the stiffness of a turned annulus and a pulled tent by 4e-4 at most, ten
# times less by 6e-6: nothing, against a resolution of 0.05.
_DIFFERENCE = 1e-6
# Free forces of a load that are this share of all its forces are round-off.
_NO_FORCE = 1e-12

Kind = Literal["consistent", "curved", "jump", "unknown", "contact"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """An equilibrium on a way.

    :param share: of the way, from 0 to 1.
    :param position: (node_count, 3) displacements.
    :param force: (node_count, 3) change of the free forces per share at fixed free displacements, in the supports' axes.
    :param stiffness: current stiffness dλ/dP; None where the tangent is singular.
    :param negative: negative eigenvalues of the tangent; None where it is singular.
    :param tangent: (node_count, 3) K⁻¹f, the free displacements' change per share; None where the tangent is singular.
    :param noise: the share that it is known to: with residuals r left, s f·K⁻¹r to first order.
    :param active: (obstacles, node_count) where there is contact; force and stiffness are those along the obstacles.
    :param multipliers: (obstacles, node_count) those of the obstacles there.
    """

    share: float
    position: Floats
    force: Floats
    stiffness: float | None
    negative: int | None
    tangent: Floats | None = None
    noise: float = 0.0
    active: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))
    multipliers: tuple[Floats, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether the tangent is known to be positive definite."""
        return self.negative == 0

    def alike(self, other: Rest, share: float) -> bool:
        """Whether the softer one of two has at least this share of the stiffer one's stiffness."""
        softer, stiffer = sorted(abs(end.stiffness or 0.0) for end in (self, other))
        return softer >= share * stiffer


@dataclass(frozen=True)
class Comparison:
    """What two equilibria's stiffnesses say about the way between them.

    :param kind: ``consistent``; ``curved`` (too curved to tell); ``jump`` (the secant is softer than both ends: a jump, or a limit,
        lies between); ``unknown`` (a tangent is singular); ``contact`` (nodes have met obstacles or left them in between: the
        stiffness has changed there, and says nothing of the way).
    :param slack: how much of the share the difference of secant and tangents comes to.
    :param noise: how much of the share residuals come to: what the two are not known better than.
    :param spread: share of the load displacement that parts of the structure take otherwise than both tangents foretell, of ends
        that are ``consistent``.
    :param shift: share of it that goes to other parts at the second end than at the first, likewise.
    """

    kind: Kind
    slack: float = 0.0
    noise: float = 0.0
    spread: float = 0.0
    shift: float = 0.0


@dataclass(frozen=True, eq=False)
class _Held:
    """What contact holds, (node_count, 3, 3) projections, and how nodes go with obstacles that move, (node_count, 3) per share."""

    held: Floats
    carried: Floats


class Way:
    """The straight way from one load state to another.

    :param press: sets pressures and loads of a load state, and prescribed displacements where they move.
    :param linear: whether the forces at fixed displacements are linear in the share, but for motions, with which they never are.
    :param round_off: what rounding leaves of the force of a way that may move nothing, from a difference over the given share.

    With obstacles, nodes that touch slide along them: force and stiffness are those on the freedoms that this leaves.
    """

    def __init__(
        self,
        newton: Newton,
        before: LoadState,
        after: LoadState,
        press: Callable[[LoadState], None],
        *,
        linear: bool = True,
        round_off: Callable[[float], float] | None = None,
    ) -> None:
        self.newton, self.system = newton, newton.system
        self.before, self.after, self._press, self._round_off = before, after, press, round_off
        self.moves = before.motions != after.motions
        self.pushes = before.obstacles != after.obstacles
        self.linear = linear and not self.moves and not self.pushes

    @property
    def looks(self) -> bool:
        """Whether :meth:`foreseen` can tell anything: of forces that are linear in the share, and without contact."""
        return self.linear and not self.system.contacts

    def at(self, share: float) -> LoadState:
        """The load state at a share of the way."""
        return self.before.toward(self.after, share)

    def load(self, share: float) -> float:
        """Size of the load at a share, along the way's direction, in shares: 1 at the end of a way that begins unloaded."""
        change, start = self.before.change(self.after), LoadState(dict.fromkeys(self.before.values, 0.0))
        return abs(float(start.change(self.before) @ change) / (float(change @ change) or 1.0) + share)

    def press(self, share: float) -> None:
        """Set the load state at a share of the way."""
        self._press(self.at(share))

    def force(self, share: float, active: NDArray[np.bool_] | None = None) -> Floats:
        """Change of the free forces per share at the present displacements; leaves the load state at ``share`` set.

        :param active: where there is contact, whose nodes go with obstacles that move; as it is when None.
        """
        contact = self._contact(active)
        position = self.system.displacement() if self.moves or self.pushes else None
        # Where they are linear a whole way's difference is exact.
        ahead, behind = (share + 1.0, share) if self.linear else (share + _DIFFERENCE, share - _DIFFERENCE)
        if not (self.linear or self.moves or self.pushes) and share == 0.0:
            behind = share  # there may be less than nothing behind it: of water, or of depth
        more = self._force_beside(ahead, ahead - share, position, contact)
        change = (more - self._force_beside(behind, behind - share, position, contact)) / (ahead - behind)
        if contact is not None:
            change -= np.einsum("nij,nj->ni", contact.held, change)
        if position is not None:
            self.system.set_displacement(position)
        if behind != share:
            self.press(share)
        if self._round_off is not None and np.linalg.norm(change) <= self._round_off(_DIFFERENCE):
            return np.zeros_like(change)  # stiffness against round-off would be no measure of anything
        return np.asarray(change)

    def _force_beside(self, share: float, change: float, position: Floats | None, contact: _Held | None) -> Floats:
        """Free forces at another share, with the nodes that obstacles carry along where these move."""
        if self.pushes and position is not None and contact is not None:
            self.system.set_displacement(position + change * contact.carried)
        self.press(share)
        return self.newton.free_force()

    def _contact(self, active: NDArray[np.bool_] | None) -> _Held | None:
        """What contact holds and carries at the present displacements; None without obstacles."""
        if not self.system.contacts:
            return None
        now = self.system.touching()
        active = now.active if active is None else active
        carried = np.zeros_like(now.normal[0])
        for one, touches, normal in zip(self.system.contacts, active, now.normal, strict=True):
            name = one.obstacle.name
            moved = one.obstacle.motion * (self.after.obstacles.get(name, 0.0) - self.before.obstacles.get(name, 0.0))
            carried += np.where(touches, normal @ moved, 0.0)[:, None] * normal
        return _Held(held_now(self.newton, active, now.normal), carried)

    def rest(self, share: float) -> Rest:
        """The present equilibrium at a share of the way; its factorised tangent is kept for the next step."""
        self.press(share)
        position = self.system.displacement()
        factor = self.newton.at_rest()
        force = self.force(share)
        if factor is None:
            return Rest(
                share=share, position=position, force=force, stiffness=None, negative=None, **self._touched()
            )  # fmt: skip
        return self._rest(share, position, force, factor.solve(force), factor.negative)

    def _touched(self) -> dict[str, Any]:
        """What a state says of contact."""
        multipliers = tuple(one.multiplier for one in self.system.contacts)
        return {"active": self.system.touching().active, "multipliers": multipliers}

    def stays(self, rest: Rest) -> bool:
        """Whether the load only changes the stiffness at an equilibrium, which it leaves in balance."""
        if self.moves:
            return False
        self.press(1.0)
        whole = self.system.balance()
        self.press(rest.share)
        whole = (whole - self.system.balance()) / (1.0 - rest.share)
        return float(np.linalg.norm(rest.force)) <= _NO_FORCE * float(np.linalg.norm(whole))

    def stable_share(self, rest: Rest, resolution: float) -> tuple[float, float | None] | None:
        """Bounds, at ``resolution``, of the share up to which a stable equilibrium that stays is stable; 1 and None at all.

        None where the tangent at the end is singular: nothing is known of stability there.
        """
        lower, upper = rest.share, 1.0
        negative = self._negative(rest, upper)
        if not negative:
            return None if negative is None else (1.0, None)
        while upper - lower > resolution * self.load(upper):
            middle = 0.5 * (lower + upper)
            # Singular is where stability is lost.
            lower, upper = (middle, upper) if self._negative(rest, middle) == 0 else (lower, middle)
        return lower, upper

    def _negative(self, rest: Rest, share: float) -> int | None:
        """Negative eigenvalues of the tangent where an equilibrium stays at another share; None where it is singular."""
        self.system.set_displacement(rest.position)
        self.press(share)
        factor = self.newton.at_rest()
        return None if factor is None else factor.negative

    def of_point(self, point: PathPoint) -> Rest:
        """A point of the path along this way."""
        self.system.set_displacement(point.position)
        return self._rest(point.factor, point.position, self.force(point.factor), point.tangent, point.negative)

    def _rest(self, share: float, position: Floats, force: Floats, tangent: Floats, negative: int) -> Rest:
        """The equilibrium that the membrane is in, of a tangent K⁻¹f."""
        compliance = float(np.vdot(force, tangent))
        stiffness = 1.0 / compliance if compliance != 0.0 and np.isfinite(compliance) else None
        noise = 0.0 if stiffness is None else abs(stiffness * float(np.vdot(self.newton.free_force(), tangent)))
        return Rest(
            share=share, position=position, force=force, stiffness=stiffness, negative=negative, tangent=tangent,
            noise=noise, **self._touched(),
        )  # fmt: skip

    def told(self, a: Rest, b: Rest, policy: Policy) -> Kind:
        """How two ends of a part of the way compare; where that can't tell whether it is smooth, halfway between them may."""
        found = self.compare(a, b, policy.resolution)
        doubtful = found.spread > policy.resolution or found.shift > policy.shifted
        if found.kind != "curved" and not (found.kind == "consistent" and doubtful and self.looks):
            return found.kind
        return "consistent" if self.foreseen(a, b, policy.resolution) else "curved"

    def compare(self, a: Rest, b: Rest, resolution: float) -> Comparison:
        """Whether a smooth path leads from one equilibrium to another, by :mod:`taichi_membrane.simulation.policy`'s e."""
        if a.stiffness is None or b.stiffness is None:
            return Comparison("unknown")
        if not np.array_equal(a.active, b.active):
            return Comparison("contact")
        largest = max(abs(a.stiffness), abs(b.stiffness))
        change, work = b.share - a.share, self._load_displacement(a, b)
        if work == 0.0:
            return Comparison("consistent" if change == 0.0 else "curved")
        secant = change / work
        deviation = 0.5 * (a.stiffness + b.stiffness) - secant
        noise = a.noise + b.noise
        slack = abs(deviation * work)
        if slack <= resolution * largest * abs(work) + noise:
            return Comparison("consistent", slack, noise, self._spread(a, b, work), self._shift(a, b))
        return Comparison("jump" if secant < min(a.stiffness, b.stiffness) else "curved", slack, noise)

    def foreseen(self, a: Rest, b: Rest, resolution: float) -> bool:
        """Whether halfway between two equilibria the structure is stable and where their tangents say, to ``resolution`` of ΔP.

        On the cubics u(P) and λ(P) that leave ``a`` and come to ``b`` along their tangents, free forces r are left halfway, and the
        structure is f·K⁻¹r of the load displacement from equilibrium. A smooth path leaves (ΔP)⁴ of it; a jump J in between
        leaves J/2, as halfway the cubics have gone half of it. Nothing is told where the cubic λ(P) is softer in between than at
        both ends, as it is where the structure snaps through, or stiffer, as where a snap begins at the limit itself.
        """
        if not self.looks or a.stiffness is None or b.stiffness is None:
            return False
        assert a.tangent is not None
        assert b.tangent is not None
        whole = self._load_displacement(a, b)
        # λ' is s_a (1 - x) + s_b x + bend x (1 - x), with the secant for its mean.
        bend = 6.0 * ((b.share - a.share) / whole - 0.5 * (a.stiffness + b.stiffness)) if whole != 0.0 else np.inf
        if abs(b.stiffness - a.stiffness) < abs(bend):
            return False
        position = self.system.displacement()
        step = 0.5 * self.system.difference(a.position, b.position)
        step += 0.125 * whole * (a.stiffness * a.tangent - b.stiffness * b.tangent)
        self.system.set_displacement(self.system.retract(a.position, step))
        self.press(0.5 * (a.share + b.share) + 0.125 * whole * (a.stiffness - b.stiffness))
        factor, left = self.newton.factorised(indefinite=True), self.newton.free_force()
        # Without a potential the symmetric part is asked: eigenvalues of what is no equilibrium are not worth their cost.
        stable = factor is not None and symmetric(factor).negative == 0
        off = np.inf if factor is None else abs(float(np.vdot(0.5 * (a.force + b.force), factor.solve(left))))
        self.system.set_displacement(position)
        self.press(b.share)
        return stable and off <= 0.5 * resolution * abs(whole)

    def _spread(self, a: Rest, b: Rest, work: float) -> float:
        """Σ |f · (Δu − ½ ΔP (s_a t_a + s_b t_b))| over |ΔP|, node by node: what parts do against one another does not cancel.

        The trapezoid of du/dP = s t, of tangents t = K⁻¹f; its sum without the sizes vanishes, as f · t = 1/s.
        """
        assert a.stiffness is not None
        assert b.stiffness is not None
        assert a.tangent is not None
        assert b.tangent is not None
        step = self.system.difference(a.position, b.position)
        off = step - 0.5 * work * (a.stiffness * a.tangent + b.stiffness * b.tangent)
        return float(np.abs(np.einsum("ni,ni->n", 0.5 * (a.force + b.force), off)).sum()) / abs(work)

    def _shift(self, a: Rest, b: Rest) -> float:
        """½ Σ |f · (s_a t_a − s_b t_b)|, node by node: each of the two sums to 1 without the sizes."""
        assert a.stiffness is not None
        assert b.stiffness is not None
        assert a.tangent is not None
        assert b.tangent is not None
        off = a.stiffness * a.tangent - b.stiffness * b.tangent
        return 0.5 * float(np.abs(np.einsum("ni,ni->n", 0.5 * (a.force + b.force), off)).sum())

    def near(self, a: Rest, b: Rest) -> bool:
        """Whether ``b``, on a path that branches off above ``a``, is no further from it than twice what its stiffness tells.

        So no jump hides that is longer than the regular way itself. True where a load that moves nothing has no stiffness.
        """
        return b.stiffness is None or 2.0 * (b.share - a.share) >= b.stiffness * self._load_displacement(a, b)

    def _load_displacement(self, a: Rest, b: Rest) -> float:
        """ΔP = ∫ f · du along the chord, by Simpson's rule.

        Exact for dead loads and for follower pressure, whose volume is cubic in u.
        """
        position = self.system.displacement()
        middle = 0.5 * (a.share + b.share)
        self.system.set_displacement(self.system.between(a.position, b.position, 0.5))
        mean = (a.force + 4.0 * self.force(middle, b.active) + b.force) / 6.0
        self.system.set_displacement(position)
        self.press(b.share)
        return float(np.vdot(mean, self.system.difference(a.position, b.position)))
