"""Contact of walls with each other: which node touches which triangle, brought up to date between the solves of a round.

Pairs, shares and normals are those of a state; the solve that follows moves it. After it they are looked for again, and the forces
that the found ones would make are compared with those that were assumed: what has turned, slid or changed hands shows there.
"""

from __future__ import annotations

import numpy as np

from taichi_membrane.mechanics.preparation import Floats
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mechanics.wall_crossing import crossings, passed
from taichi_membrane.mechanics.wall_search import Search, Touched, couples

# A side that reaches through another element by more than this share of its length has passed it. Sides of convex walls that are
# met by others may cross by what their facets are off the smooth shape, which is h/(8 R) of a side h.
THROUGH = 0.25


class WallContact:
    """Searches for a system's walls, and keeps what they touch."""

    def __init__(self, system: System) -> None:
        assert system.walls is not None
        self.system, self.term = system, system.walls
        self.tangent: Tangent | None = None
        self.upload()

    def upload(self) -> None:
        """Take over the structure that is now in the system's fields: nothing is touched yet."""
        count = self.system.node_count
        self.kept = Touched(partner=np.full((count, 2), -1), push=np.zeros((count, 2)))
        self.now = self.kept
        self.searches = self.patterns = self.crossed = 0
        self.fresh = True
        self.before = Search(self.term.walls, self.system.structure.points)

    def begin(self, bound: Floats) -> None:
        """Start a solve from what the last equilibrium touched.

        The first solve after an equilibrium makes the pattern anew, so that a run that was stopped goes on to the last bit.

        :param bound: (node_count,) stiffness of the nodes.
        """
        self.bound = bound
        self.now = self.kept
        self._place(fresh=self.fresh)
        self.fresh = False

    def let_go(self) -> None:
        """No contact."""
        self.term.upload(self.system.structure)

    def go_on(self, kept: Touched) -> None:
        """Take over what the present equilibrium, of an earlier analysis, touches."""
        self.kept, self.fresh, self.before = kept, True, self._search()

    def renew(self) -> None:
        """Bring pairs and multipliers up to the present state."""
        self.now = self._touched()
        self._place()

    def off(self) -> tuple[float, float]:
        """Size of the forces that pairs of the present state would change, and how far a node has passed its partner at most."""
        now, term = self._touched(), self.term
        found = self._search().partners(now.partner, self.before)
        self.searches += 1
        push = now.push[found.node, found.side]
        changed = term.spread(found, push) - term.spread(term.found, term.multiplier)
        deepest = float(np.max(np.where(push > 0.0, -found.gap, 0.0), initial=0.0))
        return float(np.hypot(np.linalg.norm(changed), np.linalg.norm(term.pushes() - term.multiplier))), deepest

    def accept(self) -> None:
        """Keep what the present equilibrium touches."""
        self.kept, self.fresh, self.before = self._touched(), True, self._search()

    def counts(self) -> dict[str, int]:
        """How many searches and patterns it has taken since this was asked last, and how many sides cross elements."""
        found = {"searches": self.searches, "patterns": self.patterns, "crossings": self.crossed}
        self.searches = self.patterns = 0
        return found

    def passed(self) -> str:
        """Why the present state is no result: walls that have passed through each other. Empty where none have."""
        place = self.system.structure.points + self.system.displacement()
        self.crossed, depth = crossings(self.term.walls, place)
        through = passed(self.term.walls, self.before.places, place)
        if len(through):
            return f"{len(through)} nodes have passed through walls, the first is node {through[0]}"
        if depth <= THROUGH:
            return ""
        return f"walls have passed through each other: {self.crossed} sides, the deepest by {depth:.2g} of its length"

    def _touched(self) -> Touched:
        """Partners and pushes at the present state, of the pairs that are set."""
        found = self.term.found
        partner, push = np.full_like(self.now.partner, -1), np.zeros_like(self.now.push)
        partner[found.node, found.side] = found.tri
        push[found.node, found.side] = self.term.pushes()
        return Touched(partner=partner, push=push)

    def _search(self) -> Search:
        return Search(self.term.walls, self.system.structure.points + self.system.displacement())

    def _place(self, *, fresh: bool = False) -> None:
        search = self._search()
        found = search.partners(self.now.partner, self.before)
        self.searches += 1
        self.term.set(found, self.bound[found.node], self.now.push[found.node, found.side])
        if self.tangent is not None and (fresh or not self.tangent.has(couples(self.term.walls, found))):
            pairs = search.pattern(found)
            if len(pairs) or len(self.tangent.couples):
                self.tangent.couple(pairs)
                self.patterns += 1
