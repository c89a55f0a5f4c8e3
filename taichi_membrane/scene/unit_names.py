"""The units that a scene's numbers are in, and how labels name what is made of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from taichi_membrane.scene.base import Record


class Units(Record):
    """The consistent units all numbers of a scene are in. Texts with a unit of their own, such as ``"35 kPa"``, are converted to
    them, with the second as the unit of time; else only labels depend on them."""

    length: Literal["mm", "cm", "m", "in", "ft"]
    """Unit of every length."""
    force: Literal["N", "kN", "MN", "lbf"]
    """Unit of every force; stress and pressure are force per length²."""

    @property
    def stress(self) -> str:
        """Label of force per area."""
        return {("mm", "N"): "MPa", ("m", "N"): "Pa", ("m", "kN"): "kPa", ("m", "MN"): "MPa", ("in", "lbf"): "psi"}.get(
            (self.length, self.force), f"{self.force}/{self.length}²"
        )

    @property
    def fabric_stress(self) -> str:
        """Label of the fabrics' stress: force per area, of fabrics with a thickness."""
        return self.stress

    @property
    def volume(self) -> str:
        """Label of volume."""
        return f"{self.length}³"

    @property
    def resultant(self) -> str:
        """Label of force per width."""
        return "kN/m" if (self.length, self.force) == ("mm", "N") else f"{self.force}/{self.length}"

    @property
    def area(self) -> str:
        """Label of area."""
        return f"{self.length}²"

    @property
    def energy(self) -> str:
        """Label of force times length."""
        return f"{self.force}·{self.length}"


@dataclass(frozen=True)
class FieldUnits:
    """Labels of the fields of a scene.

    :param per_width: its fabrics are given by forces per width and have no thickness, so that their stress is per width too.
    """

    units: Units
    per_width: bool

    @property
    def length(self) -> str:
        """Of length."""
        return self.units.length

    @property
    def force(self) -> str:
        """Of force."""
        return self.units.force

    @property
    def stress(self) -> str:
        """Of force per area."""
        return self.units.stress

    @property
    def resultant(self) -> str:
        """Of force per width."""
        return self.units.resultant

    @property
    def fabric_stress(self) -> str:
        """Of the fabrics' stress."""
        return self.units.resultant if self.per_width else self.units.stress
