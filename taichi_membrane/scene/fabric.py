"""The fabric of elements: moduli, thickness, wrinkling law, warp direction, prestress."""

from __future__ import annotations

import math
from typing import Self

from pydantic import model_validator

from taichi_membrane.names import SideStrain, WrinklingLaw
from taichi_membrane.scene.base import Direction, Finite, Positive, Record, Vector
from taichi_membrane.scene.element_field import ElementField, WarpSource


class Fabric(Record):
    """An isotropic (``E``, ``nu``) or orthotropic (``E_warp``, ``E_weft``, ``nu``, ``G``) fabric.

    ``nu`` is the contraction in weft per extension in warp. ``warp`` is a direction that is projected on each element (default: the
    shape's own), turned by ``warp_angle`` degrees about the normal. ``prestress`` is (warp, weft, shear) force per area.
    Thickness, prestress and warp may differ from element to element: ``{ field = "NAME" }`` takes them from the mesh.
    Vibration modes and self-weight need its mass: ``density`` is mass per volume, in force · time² / length⁴, or else
    ``mass_per_area`` that of the fabric with its coating.
    """

    E: Positive | None = None
    """Young's modulus of an isotropic fabric [force/length²]; leave out for an orthotropic one."""
    E_warp: Positive | None = None
    """Young's modulus along the warp [force/length²]."""
    E_weft: Positive | None = None
    """Young's modulus along the weft [force/length²]."""
    nu: Finite
    """Poisson's ratio: contraction in weft per extension in warp."""
    G: Positive | None = None
    """Shear modulus of an orthotropic fabric [force/length²]."""
    thickness: Positive | ElementField
    """Thickness [length]; stress times thickness is the resultant."""
    law: WrinklingLaw = "tension_field"
    """What compression does: ``tension_field`` wrinkles, ``clip`` (of the seed) has no energy, ``none`` bears it."""
    side_strain: SideStrain = "green"
    """Strain of a side: ``green``, or ``engineering`` as in the seed paper."""
    warp: Direction | WarpSource | None = None
    """Direction that is projected on each element as its warp, or where it comes from; without it the shape's own."""
    warp_angle: Finite = 0.0
    """Turns the warp about the normal [degrees]."""
    prestress: Vector | ElementField = (0.0, 0.0, 0.0)
    """Stress (warp, weft, shear) in the unstressed shape [force/length²]; a field has two or three components."""
    expansion: tuple[Finite, Finite] = (0.0, 0.0)
    """Relative extension in warp and weft per degree of ``temperatures`` [1/degree]."""
    density: Positive | None = None
    """Mass per volume [force · time²/length⁴], for vibration modes and self-weight."""
    mass_per_area: Positive | None = None
    """Mass per unstressed area [force · time²/length³], in place of ``density``."""

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.density is not None and self.mass_per_area is not None:
            raise ValueError(
                f"density = {self.density:g} and mass_per_area = {self.mass_per_area:g} both say the mass; give one of them"
            )
        return self

    @model_validator(mode="after")
    def _moduli(self) -> Self:
        if self.E is not None:
            extra = [name for name in ("E_warp", "E_weft", "G") if getattr(self, name) is not None]
            if extra:
                raise ValueError(f"E makes an isotropic fabric; leave out {', '.join(extra)}, or leave out E")
        else:
            missing = [name for name in ("E_warp", "E_weft", "G") if getattr(self, name) is None]
            if missing:
                raise ValueError(f"give E, or all of E_warp, E_weft and G ({', '.join(missing)} missing)")
        if not self.nu**2 * self.weft_modulus / self.warp_modulus < 1:
            limit = math.sqrt(self.warp_modulus / self.weft_modulus)
            raise ValueError(
                f"the compliance is not positive definite: nu = {self.nu:g} must lie between {-limit:g} and {limit:g} "
                f"(the square root of E_warp/E_weft)"
            )
        if self.E is not None and self.nu <= -1:
            raise ValueError(f"nu = {self.nu:g} must be above -1")
        return self

    @property
    def has_mass(self) -> bool:
        """Whether its mass is given."""
        return self.density is not None or self.mass_per_area is not None

    @property
    def prestressed(self) -> bool:
        """Whether it has a prestress."""
        return isinstance(self.prestress, ElementField) or any(self.prestress)

    @property
    def warp_modulus(self) -> float:
        """Young's modulus along the warp."""
        return float(self.E if self.E is not None else self.E_warp or 0.0)

    @property
    def weft_modulus(self) -> float:
        """Young's modulus along the weft."""
        return float(self.E if self.E is not None else self.E_weft or 0.0)

    @property
    def shear_modulus(self) -> float:
        """In-plane shear modulus."""
        return float(self.G) if self.G is not None else self.warp_modulus / (2 * (1 + self.nu))
