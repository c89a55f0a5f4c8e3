"""Combinations of load cases by a rule: one leads, others go along, and those that exclude each other never meet.

The form of codes of practice, say EN 1990's 6.10: G γ_G + Q₁ γ_Q + Σ Q_i γ_Q ψ_i. The factors are the user's.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from taichi_membrane.scene.base import LONGEST_NAME, MOST, Finite, Name, Record
from taichi_membrane.scene.case import Case

if TYPE_CHECKING:
    from taichi_membrane.scene.models import Scene


class Combinations(Record):
    """A rule that makes load cases of others. Each case of ``leading`` leads: with its factor there, beside those of ``always`` and
    those of ``accompanying`` that it does not exclude; where some of these exclude each other, once with each choice of as many
    as can act together. A case is named after the rule, the case that leads, and those that were chosen before others.
    """

    name: Name
    """Begins the names of the cases that it makes."""
    after: Name | None = None
    """Stage at whose end they start; the last one without it."""
    always: dict[Name, Finite] = {}
    """Factors of cases that are part of each, such as permanent loads."""
    leading: Annotated[dict[Name, Finite], Field(min_length=1, max_length=MOST)]
    """Factor of each case that leads, where it does."""
    accompanying: dict[Name, Finite] = {}
    """Factor of each case that goes along where another one leads."""
    exclusive: list[Annotated[list[Name], Field(min_length=2)]] = []
    """Lists of cases that never act together, such as wind from different sides."""

    def made(self) -> Iterator[Case]:
        """The cases, in order."""
        for leader, factor in self.leading.items():
            able = [one for one in self.accompanying if one != leader and not self._exclude(one, leader)]
            for chosen in self._together(able):
                combine = self.always | {leader: factor} | {one: self.accompanying[one] for one in chosen}
                choices = [one for one in chosen if any(self._exclude(one, other) for other in able)]
                title = " + ".join(f"{value:g} {name}" for name, value in combine.items())
                name = "_".join([self.name, leader, *choices])
                if len(name) > LONGEST_NAME:
                    raise ValueError(
                        f"combinations.{self.name}: a case would be called {name}, of more than {LONGEST_NAME} characters"
                    )
                yield Case(name=name, title=title, after=self.after, combine=combine)

    def _together(self, cases: list[str]) -> Iterator[list[str]]:
        """All sets of cases that do not exclude each other and to which none could be added."""
        if not cases:
            yield []
            return
        first, *rest = cases
        excluded = [one for one in rest if self._exclude(one, first)]
        for others in self._together([one for one in rest if one not in excluded]):
            yield [first, *others]
        if excluded:
            yield from (others for others in self._together(rest) if not set(others).isdisjoint(excluded))

    def _exclude(self, one: str, other: str) -> bool:
        return one != other and any(one in group and other in group for group in self.exclusive)


def expand(scene: Scene) -> None:
    """Put the cases that rules make in a scene's list, in place of the rules.

    :raises ValueError: a rule names what is no case, or makes more cases than a scene may have.
    """
    given = [case.name for case in scene.cases if not case.combine]
    for rule in scene.combinations:
        named = {
            "always": rule.always, "leading": rule.leading, "accompanying": rule.accompanying,
            "exclusive": [name for group in rule.exclusive for name in group],
        }  # fmt: skip
        for key, names in named.items():
            for name in names:
                if name not in given:
                    allowed = ", ".join(given) or "(none)"
                    where = f"combinations.{rule.name}.{key}"
                    raise ValueError(f"{where}: {name!r} is not a case that could be combined; allowed: {allowed}")
        for name in rule.always:
            for key in ("leading", "accompanying"):
                if name in named[key]:
                    raise ValueError(
                        f"combinations.{rule.name}.{key}: {name!r} is in 'always' too, with its own factor"
                    )
        for one in rule.made():
            if len(scene.cases) == MOST:
                raise ValueError(f"combinations.{rule.name}: with its cases the scene has more than {MOST}")
            scene.cases.append(one)
    scene.combinations.clear()
