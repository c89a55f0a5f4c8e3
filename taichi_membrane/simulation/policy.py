"""When a load step's result is accepted: the constants, and the trace of what a step went through.

Along a straight way between two load states, let λ be the share of the way, u the equilibrium at it, f = ∂(free force)/∂λ and
P = ∫ f · du the load displacement. The current stiffness s = dλ/dP = 1/(f · K⁻¹ f) (P. G. Bergan, Comput. Methods Appl. Mech. Eng.
17/18, 1979) falls smoothly to zero at a limit of the load. Between two equilibria a and b,

    e = (½ (s_a + s_b) − Δλ/ΔP) / max(|s_a|, |s_b|)

vanishes where λ(P) is a parabola. A structure that has jumped in between went a long way ΔP for little Δλ: e → ½ … 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Literal

Event = Literal[
    "load control",  # equilibrium found at the aim by raising the load, and verified
    "unverified start",  # found, and stable; but it started from no stable equilibrium with a tangent, so nothing can be compared
    "contact",  # found, and stable; nodes have met obstacles or left them on the way, so that its stiffness can't be compared
    "carried over",  # found from the state on a coarser mesh, and no less stable; the way to it is compared with nothing
    "unverified",  # found; with friction, which has no potential, or walls that touch each other it is compared with nothing
    "bisected",  # the way was cut in two: too curved to be verified in one
    "kink",  # still too curved at the shortest part, but without a sign of a jump
    "unstable",  # Newton came to an unstable equilibrium, and was pushed off it
    "path",  # followed by arc length from here
    "limit",  # the load has a maximum here
    "bifurcation",  # the path loses its stability here while the load still rises
    "branch",  # a stable path that branches off was taken
    "snap",  # jumped beyond a limit, as the stage asks for
    "target",  # the path reached the aim
    "lost",  # the path could not be followed further
    "relaxed",  # found by relaxation, stable and verified
    "refused",  # what was found is unstable, or lies beyond a jump: not taken
    "relief",  # a relief valve is open at the step's end, and has let out gas
]


@dataclass(frozen=True, kw_only=True)
class Passage:
    """One passage of a load step: what happened, and at which share of the way (of a stage's course, once it is in a result)."""

    event: Event
    share: float


Trace = tuple[Passage, ...]


def told(trace: Trace) -> str:
    """A trace in a few words: its passages in order, repeated ones once with their number."""
    words = []
    for event, group in groupby(one.event for one in trace):
        count = len(list(group))
        words.append(event if count == 1 else f"{event} ×{count}")
    return ", ".join(words)


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The constants of the step policy; each with what it was derived from.

    :param resolution: largest |e| that is accepted. A part between ends of equal stiffness s hides a jump of at most e/(1 − e) of
        its regular ΔP = Δλ/s, a nineteenth: smaller snaps, of single wrinkles, are below what a result resolves. At 0.1 one of 381
        verdict runs missed a limit; a sixth fewer iterations. λ ~ P³, the way a flat sheet stiffens, has |e| = 1/6 from its start
        and is cut once or twice; a collapse has ½ … 1: its verdict does not hang on it. A part that is only curved is not cut where
        a look halfway, which costs a factorisation, finds the structure stable and as both ends foretell (:meth:`.Way.foreseen`).
        Parts of the structure are held to the same: what nodes take of ΔP otherwise than their ends' tangents foretell, added up
        without signs, is looked at halfway above it, for e is a sum, in which a part that snaps and stiffens can cancel one that
        softens. A jump J of a part that had the share q of the tangents leaves 2 (1 − q) J/ΔP.
    :param shifted: largest share of ΔP that goes to other parts at one end than at the other, beyond which ends that compare well
        are looked at halfway too. A part just below its limit is soft, and its tangent foretells a jump of its own size J ≈ ½ q ΔP
        as if it were a smooth way; beyond it q is gone. So a jump of a twentieth is looked for. Of some 330 tents side by side half
        of it finds the same ones, twice of it misses two more.
    :param nearer: ``resolution`` between points of a path, which cost less than ends of load control and is where limits are. At
        0.05 a beam with its valve shut, followed in one step, passed a limit 3 % below the one it told.
    :param soft: share of the stiffest s met on the same course below which load control is not tried: Newton's steps grow as 1/s,
        and at a tenth the load is within about a percent of a parabola's limit (1 − λ/λ_max = (s/s₀)²).
    :param parts: halvings of a step; what is still curved at 2⁻¹⁰ of it is a kink, which no finer cut makes smooth.
    :param shortest: smallest arc length over the first one. A thousandth of the way is the width a limit is bracketed to; its
        size is a matter of cost.
    :param softening: a step of the path over which s changes by more than this share is looked for nearer, unless it rises by less
        than ``shortest`` of the way: e is measured by the stiffer end, and a jump hidden in it is a nineteenth of it at ends of
        equal stiffness only. Without, of a scattered mesh one run in four left the path, and its limit came out 9·10⁻³ too high.
    :param balance: residual over tolerance up to which a start counts as an equilibrium. Between the two stand the changes that a
        pressure's rounding or a shut valve bring; starts that are none, such as prestress let go, are off by 1e4 and more.
    :param above: share of the load above a point of bifurcation up to which a branch is looked for: ten times the width it is
        bracketed to. Further away what was left may be stable again.
    :param approaches: times that it is looked for, each four times as far as the one before: at first it may be nearer to what it
        leaves than residuals tell.
    :param branches: paths followed after one another, each branching off the one before; with more the path is lost. A matter of
        cost: each branches off at a higher load.
    :param landings: attempts to land on the aim from the path's points below and above it; each shortens the way by what it missed.
    """

    resolution: float = 0.05
    nearer: float = 0.02
    shifted: float = 0.1
    soft: float = 0.1
    parts: int = 10
    shortest: float = 1e-3
    softening: float = 0.5
    balance: float = 1e2
    above: float = 1e-2
    approaches: int = 4
    branches: int = 32
    landings: int = 8


POLICY = Policy()
