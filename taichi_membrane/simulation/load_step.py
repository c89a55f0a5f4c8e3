"""One load step: from a stable equilibrium to the next one, each part of the way verified; along the path where load control fails.

The states are few: ``_walk`` raises the load and compares ends, ``_follow`` goes by arc length from where that shows a jump or
finds nothing, ``_beyond`` looks behind a limit or a bifurcation, ``_relaxed`` lets relaxation try last, ``_direct`` is for starts
that nothing can be compared with. Each transition is a passage of the trace.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_membrane.simulation.load_state import LoadState
from taichi_membrane.simulation.policy import POLICY, Event, Passage, Policy
from taichi_membrane.simulation.reached import Reached
from taichi_membrane.simulation.stiffest import Stiffest
from taichi_membrane.simulation.way import Rest
from taichi_membrane.solvers.path import Path, PathEnd, PathPoint, Seen, follow
from taichi_membrane.solvers.record import Progress, SolveRecord, force_now, joined

if TYPE_CHECKING:
    from collections.abc import Callable

    from taichi_membrane.simulation.equilibrium import Equilibrium

    Report = Callable[[Progress], None] | None

# A branch is looked for so many times further away when there is none yet.
_NEARER = 4.0


class LoadStep:
    """One step of the load from ``before`` to ``after``.

    :param stiffest: of the course that the step is on; kept up.
    :param snaps: whether a jump to a stable state beyond a limit is taken, rather than the limit told as the result.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        before: LoadState,
        after: LoadState,
        stiffest: Stiffest,
        *,
        snaps: bool,
        report: Report,
        policy: Policy = POLICY,
    ) -> None:
        assert equilibrium.newton is not None
        self.equilibrium, self.newton, self.system = equilibrium, equilibrium.newton, equilibrium.system
        self.stiffest, self.snaps, self.report, self.policy = stiffest, snaps, report, policy
        self.way = equilibrium.way(before, after)
        # Neither motions nor what meets obstacles have a path that could be followed.
        self.pathless = self.way.moves or bool(self.system.contacts)
        self.start = self.system.displacement()
        self.records: list[SolveRecord] = []
        self.trace: list[Passage] = []

    def run(self) -> Reached:
        """Take the step. Where no equilibrium is found the membrane is back in the state it came from."""
        self.way.press(0.0)
        self.equilibrium.contact.begin()
        off = float(np.linalg.norm(self.newton.free_force()))
        balanced = off <= self.policy.balance * self.equilibrium.tolerance * force_now(
            self.equilibrium.reference(self.way.after)
        )
        origin = self.way.rest(0.0) if balanced else None
        if origin is not None and origin.stable and self.way.stays(origin):
            return self._stand(origin)
        if origin is None or not origin.stable or origin.stiffness is None:
            return self._direct()
        return self._walk(origin)

    # ---- load control

    def _direct(self) -> Reached:
        """From a start that nothing can be compared with: what is found has to be stable, and that is all that is known."""
        found = self._solve(1.0, relax=True)
        if found is None:
            return self._failed()
        if found.negative:
            return self._refuse(found)
        self._pass("unverified start", 1.0)
        return self._done(found)

    def _walk(self, a: Rest) -> Reached:
        """Raise the load part by part; the aims still ahead are a stack, those that were found too far away are kept."""
        aims, known = [1.0], {}  # type: tuple[list[float], dict[float, Rest]]
        while aims:
            aim = aims[-1]
            soft = not self.pathless and self._softened(a)
            b, kind = (None, "soft") if soft else self._attempt(a, aim, known.pop(aim, None))
            if b is None and kind == "failed" and a.share == 0.0 and not self.way.moves and self._at_apex(a):
                return self._direct()  # no path begins there
            if b is not None and kind in ("curved", "jump") and a.share == 0.0 and self._at_apex(a):
                first = self._off_apex(a)
                if first is None:  # the start's stiffness is no measure of the way from it, and no nearer one is found
                    self._pass("unverified start", aim)
                    a = b
                    aims.pop()
                else:
                    a, known[aim] = first, b
                continue
            if b is not None and kind == "curved" and aim - a.share > 2.0**-self.policy.parts:
                self._pass("bisected", 0.5 * (a.share + aim))
                known[aim] = b
                aims.append(0.5 * (a.share + aim))
            elif b is not None and (kind != "jump" or self.pathless):
                self._pass({"curved": "kink", "jump": "snap", "contact": "contact"}.get(kind, "load control"), aim)  # type: ignore[arg-type]
                a = b
                aims.pop()
            else:
                onward = self._follow(a, b) if not self.pathless else None
                if onward is None and b is None and kind == "failed":
                    onward = self._relaxed(a)
                if not isinstance(onward, Rest):
                    return onward or self._failed()
                a, aims, known = onward, [1.0] if onward.share < 1.0 else [], {}
        return self._done(a)

    def _attempt(self, a: Rest, aim: float, known: Rest | None) -> tuple[Rest | None, str]:
        """A stable equilibrium at an aim and how it compares with the last one; none, and ``failed``, where Newton finds none."""
        if known is not None and (kind := self.way.told(a, known, self.policy)) in ("consistent", "unknown"):
            return known, kind
        self.system.set_displacement(a.position)
        b = self._solve(aim)
        if b is None or b.negative:
            return None, "failed"
        kind = self.way.told(a, b, self.policy)
        if kind == "jump" and self.pathless and aim - a.share > 2.0**-self.policy.parts:
            kind = "curved"  # no path to follow: find the jump as nearly as parts can be
        return b, kind

    def _at_apex(self, a: Rest) -> bool:
        """Whether nothing carries and compression is not borne: there stiffness depends on the direction of the least move;
        or a liquid of given volume begins: the least of it wets a share of the surface.
        """
        if self.equilibrium.filling.begins(self.way.before, self.way.after):
            return True
        structure = self.system.structure
        no_cables = structure.cables is None and structure.ropes is None
        if all(fabric.law == "none" for fabric in structure.fabrics) and no_cables:
            return False
        self.system.set_displacement(a.position)
        return self.equilibrium.carries_nothing()

    def _off_apex(self, a: Rest) -> Rest | None:
        """A stable equilibrium just off a start that carries nothing, to compare with in its stead; None where none is found
        in as many iterations as the whole way has taken.
        """
        self.system.set_displacement(a.position)
        first = self._solve(2.0**-self.policy.parts, patience=self.records[-1].iterations)
        if first is None or not first.stable or first.stiffness is None:
            return None
        self._pass("unverified start", first.share)
        return first

    def _solve(self, share: float, *, relax: bool = False, patience: int | None = None) -> Rest | None:
        """Equilibrium at a share of the way by load control, off unstable ones where there are stable ones beside."""
        self._settle(share, relax=relax, patience=patience)
        if not self.records[-1].converged:
            return None
        found = self.way.rest(share)
        return self._off(share, relax=relax) if found.negative else found

    def _settle(self, share: float, *, relax: bool, patience: int | None = None) -> None:
        """Solve from the present state; by relaxation and Newton in turns where Newton alone fails and that is asked for."""
        start, state = self.system.displacement(), self.way.at(share)
        self.records.append(self.equilibrium.solve(state, self.report, patience=patience))
        if not self.records[-1].converged and relax and self.equilibrium.kind == "hybrid":
            self.system.set_displacement(start)
            self.records.append(self.equilibrium.solve(state, self.report, relax=True))

    def _off(self, share: float, *, relax: bool) -> Rest | None:
        """Where an unstable equilibrium's softest mode leads to; that equilibrium itself where it leads nowhere."""
        self._pass("unstable", share)
        unstable = self.system.displacement()
        self.newton.disturb()
        self._settle(share, relax=relax)
        if not self.records[-1].converged:
            self.system.set_displacement(unstable)
        return self.way.rest(share)

    # ---- along the path

    def _follow(self, a: Rest, b: Rest | None) -> Rest | Reached | None:
        """By arc length from a stable equilibrium: the aim, the limit before it, or a branch to go on from; None where it is lost.

        :param b: where load control has led: no first step goes further.
        """
        self._pass("path", a.share)
        path = self.equilibrium.path(self.way)
        self.system.set_displacement(a.position)
        begin = path.start(a.position, a.share)
        if begin is None or begin.negative > 0:
            return None
        longest = np.inf if b is None else float(np.linalg.norm(b.position - a.position))
        end = follow(
            path, begin, 1.0, see=self._seen, longest=longest or np.inf, shortest=self.policy.shortest,
            progress=self._progress,
        )  # fmt: skip
        self.records.append(end.record())
        if end.reason == "target":
            return self._land(path, end)
        relieved = self.equilibrium.relieved(self.way, end.last.factor)
        if relieved or end.upper is None:
            self._pass("lost", end.last.factor)
            self.system.set_displacement(end.last.position)
            return self._direct() if relieved else None  # what carries nothing has no limit, and foretells nothing
        self._pass("limit" if end.reason == "limit" else "bifurcation", end.last.factor)
        if sum(one.event == "branch" for one in self.trace) >= self.policy.branches:
            self._pass("lost", end.last.factor)
            return None
        return self._beyond(end) or self._within(end) or self._collapsed(end)

    def _land(self, path: Path, end: PathEnd) -> Rest | None:
        """The equilibrium at the aim, between two points of the path; verified as any other."""
        last, beyond = end.last, end.beyond
        assert beyond is not None
        for _ in range(self.policy.landings):
            share = (1.0 - last.factor) / (beyond.factor - last.factor)
            self.system.set_displacement(self.system.between(last.position, beyond.position, share))
            found = self._solve(1.0)
            if found is not None and not found.negative and self._compare(self.way.of_point(last), found) != "jump":
                self._pass("target", 1.0)
                return found
            nearer, _ = path.step(last, share * float(np.linalg.norm(beyond.advance)))
            if nearer is None or nearer.negative > 0:
                return None
            if nearer.factor < 1.0:
                last = nearer
            else:
                beyond = nearer
        return None

    def _beyond(self, end: PathEnd) -> Rest | None:
        """A stable state just above where the path ends: on a branch that goes on smoothly, or, where asked, beyond a snap."""
        if end.reason == "bifurcation" and (branch := self._branch(end)) is not None:
            self._pass("branch", branch.share)
            return branch
        if not self.snaps:
            return None
        assert end.upper is not None
        self.system.set_displacement(end.last.position)
        found = self._solve(min(1.0, end.upper + self.policy.above * self.way.load(end.upper)))
        if found is None or not found.stable:
            return None
        self._pass("snap", found.share)
        return found

    def _within(self, end: PathEnd) -> Rest | None:
        """The aim itself, where it lies inside a limit's bracket and is reached."""
        if end.upper is None or end.upper < 1.0:
            return None
        self.system.set_displacement(end.last.position)
        found = self._solve(1.0)
        if found is None or not found.stable or self._compare(self.way.of_point(end.last), found) == "jump":
            return None
        self._pass("target", 1.0)
        return found

    def _branch(self, end: PathEnd) -> Rest | None:
        """A stable state that a smooth path leads to from a bifurcation: above it, looked for further and further away.

        At most at the aim, which is reached from above where that is too near to tell the branch from what it leaves.
        """
        assert end.beyond is not None
        assert end.upper is not None
        last, highest = self.way.of_point(end.last), self.policy.above * self.way.load(end.upper)
        for k in reversed(range(self.policy.approaches)):
            height = highest * _NEARER**-k
            self.system.set_displacement(end.beyond.position)
            self.newton.disturb()
            found = self._solve(end.upper + height)
            if found is not None and found.stable and found.share > 1.0:
                found = self._solve(1.0)
            if (
                found is not None
                and found.stable
                and self._compare(last, found) != "jump"
                and self.way.near(last, found)
            ):
                return found  # on a branch: its stiffness tells most of the way to it
        return None

    # ---- where the load moves nothing

    def _stand(self, a: Rest) -> Reached:
        """At the same place, such as of a mast that is pushed along itself: stability alone can be lost."""
        if (bounds := self.way.stable_share(a, self.policy.shortest)) is None:
            return self._direct()
        lower, upper = bounds
        if upper is None:
            self._pass("load control", 1.0)
            self._settle(1.0, relax=False)
            return self._done(self.way.rest(1.0))
        self._pass("bifurcation", upper)
        if (branch := self._beside(a, upper)) is not None:
            self._pass("branch", branch.share)
            return self._walk(branch) if branch.share < 1.0 else self._direct()
        if self.snaps:
            return self._direct()
        self.system.set_displacement(a.position)
        self._settle(lower, relax=False)
        return Reached(joined(*self.records), lower, (lower, upper), trace=tuple(self.trace))

    def _beside(self, a: Rest, upper: float) -> Rest | None:
        """A stable branch just above a bifurcation: one that comes nearer with the load, as the square root of it or faster."""
        found: list[Rest] = []
        for height in (1.0, 1.0 / _NEARER):
            self.system.set_displacement(a.position)
            self.way.press(upper)
            self.newton.disturb()
            one = self._solve(upper + height * self.policy.above * self.way.load(upper))
            if one is None or not one.stable:
                return None
            found.append(one)
        far, near = (float(np.linalg.norm(one.position - a.position)) for one in found)
        return found[0] if near <= 0.5 * (1.0 + _NEARER**-0.5) * far else None

    # ---- relaxation

    def _relaxed(self, a: Rest) -> Rest | None:
        """What relaxation finds at the aim, where Newton and the path found nothing; verified as any other."""
        if self.equilibrium.kind != "hybrid":
            return None
        self.system.set_displacement(a.position)
        self.records.append(self.equilibrium.solve(self.way.after, self.report, relax=True))
        if not self.records[-1].converged:
            return None
        found = self.way.rest(1.0)
        kind = self._compare(a, found)
        if found.negative or not (self.pathless or kind in ("consistent", "unknown")):
            self._pass("refused", 1.0)
            return None
        self._pass("snap" if kind == "jump" else "relaxed", 1.0)
        return found

    # ---- ends

    def _done(self, found: Rest) -> Reached:
        self.system.set_displacement(found.position)
        self.equilibrium.contact.restore(found.multipliers)
        self.way.press(1.0)
        # What was tried in vain goes first: the record's verdict is that of its last part.
        records = sorted(self.records, key=lambda record: record.converged)
        return Reached(joined(*records), 1.0, trace=tuple(self.trace))

    def _collapsed(self, end: PathEnd) -> Reached:
        """At the last stable point below a limit."""
        assert end.lower is not None
        assert end.upper is not None
        self.system.set_displacement(end.last.position)
        self.way.press(end.last.factor)
        return Reached(
            joined(*self.records, end.record(again=True)),
            end.last.factor,
            (end.lower, end.upper),
            trace=tuple(self.trace),
        )

    def _refuse(self, found: Rest) -> Reached:
        """Back from an unstable equilibrium that nothing stable was found beside."""
        self._pass("refused", found.share)
        reason = f"the equilibrium found is unstable ({found.negative} negative pivots)"
        self.records.append(SolveRecord(False, reason, 0, self.records[-1].residual, 0.0, "newton"))
        return self._failed()

    def _failed(self) -> Reached:
        trouble = self.equilibrium.trouble()
        self.system.set_displacement(self.start)
        if not self.records or self.records[-1].converged:
            reason = "the path is lost, and what load control finds lies beyond a jump"
            self.records.append(SolveRecord(False, reason, 0, float("nan"), 0.0, "arc length"))
        return Reached(joined(*self.records), 0.0, trouble=trouble, trace=tuple(self.trace))

    # ---- helpers

    def _softened(self, a: Rest) -> bool:
        """Whether the structure is so soft, against the stiffest of its course, that load control is not worth trying."""
        return a.stiffness is not None and self.stiffest.take(self.way, a.stiffness) < self.policy.soft

    def _compare(self, a: Rest, b: Rest) -> str:
        return self.way.compare(a, b, self.policy.resolution).kind

    def _seen(self, a: PathPoint, b: PathPoint) -> Seen:
        """What is seen of the piece of the path between two points."""
        found = self.way.compare(first := self.way.of_point(a), second := self.way.of_point(b), self.policy.nearer)
        rises = b.negative == 0 and b.factor - a.factor > self.policy.shortest
        near = not rises or first.alike(second, self.policy.softening)
        return Seen(found.kind == "consistent" and near, found.slack, found.noise)

    def _progress(self, point: PathPoint) -> None:
        if self.report is not None:
            self.report(Progress(iteration=point.iterations, residual=point.residual, seconds=0.0))

    def _pass(self, event: Event, share: float) -> None:
        self.trace.append(Passage(event=event, share=share))
