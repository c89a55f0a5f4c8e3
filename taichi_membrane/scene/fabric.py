"""The fabric of elements: stiffness by area or by width, wrinkling law, warp direction, prestress."""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from taichi_membrane.names import SideStrain, WrinklingLaw
from taichi_membrane.scene import presets
from taichi_membrane.scene.base import (
    AllowedNames,
    Direction,
    Finite,
    Label,
    PerLengthVector,
    PositiveLength,
    PositiveMassPerArea,
    PositiveMassPerVolume,
    PositivePerLength,
    PositiveStress,
    Record,
    StressVector,
)
from taichi_membrane.scene.element_field import ElementField, WarpSource

# Keys of the moduli: for all directions, along warp, along weft, in shear.
_GIVEN = {
    "by area": ("E", "E_warp", "E_weft", "G"),
    "by width": ("stiffness", "stiffness_warp", "stiffness_weft", "G_t"),
}


def _nu_may_be_left_out(schema: dict[str, Any]) -> None:
    """Of the JSON schema of a fabric: a preset may give what is required."""
    schema.pop("required", None)


class Safety(Record):
    """A safety factor on strengths, which is the user's: none is built in."""

    factor: Annotated[float, Field(ge=1, le=1000)]
    """What strengths are divided by, at least 1: material, life, temperature and all else that the source asks for."""
    source: Annotated[Label, Field(min_length=1)]
    """Where it comes from."""


class Fabric(Record):
    """An isotropic (``E``, ``nu``) or orthotropic (``E_warp``, ``E_weft``, ``nu``, ``G``) fabric with a ``thickness``; or one given
    per width, as sheets and biaxial tests have it: ``stiffness``, or ``stiffness_warp``, ``stiffness_weft`` and ``G_t``, and no
    thickness. All fabrics of a scene are given in one of these ways; its stresses are then forces per area, or per width.

    ``nu`` is the contraction in weft per extension in warp. ``warp`` is a direction that is projected on each element (default: the
    shape's own), turned by ``warp_angle`` degrees about the normal. ``prestress`` is (warp, weft, shear) force per area,
    ``pretension`` that per width. Thickness, prestress and warp may differ from element to element: ``{ field = "NAME" }`` takes
    them from the mesh. Vibration modes and self-weight need its mass: ``density`` is mass per volume, in force · time² / length⁴,
    or else ``mass_per_area`` that of the fabric with its coating.
    """

    model_config = ConfigDict(json_schema_extra=_nu_may_be_left_out)

    preset: Annotated[str, AllowedNames(presets.names)] | None = None
    """Name of a fabric of ``scene/fabrics.toml`` whose numbers, each with its source, stand where this one gives none. Its
    strengths count only beside a ``safety``."""
    E: PositiveStress | None = None
    """Young's modulus of an isotropic fabric [force/length²]; leave out for an orthotropic one."""
    E_warp: PositiveStress | None = None
    """Young's modulus along the warp [force/length²]."""
    E_weft: PositiveStress | None = None
    """Young's modulus along the weft [force/length²]."""
    nu: Finite
    """Poisson's ratio: contraction in weft per extension in warp."""
    G: PositiveStress | None = None
    """Shear modulus of an orthotropic fabric [force/length²]."""
    stiffness: PositivePerLength | None = None
    """Stiffness per width, E t, of an isotropic fabric [force/length]."""
    stiffness_warp: PositivePerLength | None = None
    """Stiffness per width along the warp [force/length]."""
    stiffness_weft: PositivePerLength | None = None
    """Stiffness per width along the weft [force/length]."""
    G_t: PositivePerLength | None = None
    """Shear stiffness per width of an orthotropic fabric [force/length]."""
    thickness: PositiveLength | ElementField | None = None
    """Thickness [length]; stress times thickness is the resultant. A fabric given per width has none."""
    law: WrinklingLaw = "tension_field"
    """What compression does: ``tension_field`` wrinkles, ``clip`` (of the seed) has no energy, ``none`` bears it."""
    side_strain: SideStrain = "green"
    """Strain of a side: ``green``, or ``engineering`` as in the seed paper."""
    warp: Direction | WarpSource | None = None
    """Direction that is projected on each element as its warp, or where it comes from; without it the shape's own."""
    warp_angle: Finite = 0.0
    """Turns the warp about the normal [degrees]."""
    prestress: StressVector | ElementField = (0.0, 0.0, 0.0)
    """Stress (warp, weft, shear) in the unstressed shape [force/length²]; a field has two or three components."""
    pretension: PerLengthVector | ElementField = (0.0, 0.0, 0.0)
    """The same of a fabric given per width, per unstressed width [force/length]."""
    expansion: tuple[Finite, Finite] = (0.0, 0.0)
    """Relative extension in warp and weft per degree of ``temperatures`` [1/degree]."""
    density: PositiveMassPerVolume | None = None
    """Mass per volume [force · time²/length⁴], for vibration modes and self-weight."""
    mass_per_area: PositiveMassPerArea | None = None
    """Mass per unstressed area [force · time²/length³], in place of ``density``."""
    strength: PositivePerLength | None = None
    """Strength in all directions, of a foil [force/length]: the major Cauchy resultant is compared with it, as ``utilisation``."""
    strength_warp: PositivePerLength | None = None
    """Strength along the warp [force/length], as of a strip test: the Cauchy resultant along the warp is compared with it."""
    strength_weft: PositivePerLength | None = None
    """Strength along the weft [force/length]."""
    strength_source: Label = ""
    """Where the strengths come from."""
    safety: Safety | None = None
    """What strengths are divided by, and why; a fabric with a strength needs it."""

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, given: Any) -> Any:
        return presets.filled(given)

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.density is not None and self.mass_per_area is not None:
            raise ValueError(
                f"density = {self.density:g} and mass_per_area = {self.mass_per_area:g} both say the mass; give one of them"
            )
        return self

    @model_validator(mode="after")
    def _strengths(self) -> Self:
        given = [name for name in ("strength", "strength_warp", "strength_weft") if getattr(self, name) is not None]
        if given not in ([], ["strength"], ["strength_warp", "strength_weft"]):
            raise ValueError(f"give strength, or both strength_warp and strength_weft; given are: {', '.join(given)}")
        if given and self.safety is None:
            raise ValueError(
                f'{given[0]} needs a safety factor to be compared with: give safety = {{ factor = ..., source = "..." }}'
            )
        if not given and (self.safety is not None or self.strength_source):
            raise ValueError(
                "safety and strength_source are for a fabric with a strength; give strength_warp and strength_weft"
            )
        return self

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        """By area with a thickness, or by width without."""
        given = {kind: [name for name in names if getattr(self, name) is not None] for kind, names in _GIVEN.items()}
        if self.per_width:
            others = given["by area"] + [name for name in ("thickness", "density") if getattr(self, name) is not None]
            others += ["prestress"] if _some(self.prestress) else []
            if others:
                raise ValueError(
                    f"{' and '.join(given['by width'])} {'is' if len(given['by width']) == 1 else 'are'} per width, and "
                    f"{' and '.join(others)} would need a thickness; leave out the one or the other (per width there are "
                    f"{', '.join(_GIVEN['by width'])}, pretension and mass_per_area)"
                )
        elif self.thickness is None:
            raise ValueError(
                "thickness is missing; or give the fabric per width: stiffness, or stiffness_warp, stiffness_weft and G_t"
            )
        elif _some(self.pretension):
            raise ValueError("pretension is for a fabric given per width; give prestress, force per area")
        return self

    @model_validator(mode="after")
    def _moduli(self) -> Self:
        whole, *parts = self.moduli_keys
        if getattr(self, whole) is not None:
            extra = [name for name in parts if getattr(self, name) is not None]
            if extra:
                raise ValueError(
                    f"{whole} makes an isotropic fabric; leave out {', '.join(extra)}, or leave out {whole}"
                )
        else:
            missing = [name for name in parts if getattr(self, name) is None]
            if missing:
                told = f"{parts[0]}, {parts[1]} and {parts[2]}"
                raise ValueError(f"give {whole}, or all of {told} ({', '.join(missing)} missing)")
        if not self.nu**2 * self.weft_modulus / self.warp_modulus < 1:
            limit = math.sqrt(self.warp_modulus / self.weft_modulus)
            raise ValueError(
                f"the compliance is not positive definite: nu = {self.nu:g} must lie between {-limit:g} and {limit:g} "
                f"(the square root of {parts[0]}/{parts[1]})"
            )
        if self.isotropic and self.nu <= -1:
            raise ValueError(f"nu = {self.nu:g} must be above -1")
        return self

    @property
    def per_width(self) -> bool:
        """Whether it is given by forces per width, without a thickness."""
        return any(getattr(self, name) is not None for name in _GIVEN["by width"])

    @property
    def moduli_keys(self) -> tuple[str, str, str, str]:
        """Keys of its moduli: for all directions, along warp, along weft, in shear."""
        return _GIVEN["by width" if self.per_width else "by area"]

    @property
    def isotropic(self) -> bool:
        """Whether one modulus is given for all directions."""
        return self.E is not None or self.stiffness is not None

    @property
    def given_thickness(self) -> float | ElementField:
        """Thickness; of a fabric given per width one unit of length, by which its moduli and stresses are those per width."""
        return 1.0 if self.thickness is None else self.thickness

    @property
    def given_prestress(self) -> tuple[float, float, float] | ElementField:
        """Prestress, force per area; of a fabric given per width that per width."""
        return self.pretension if self.per_width else self.prestress

    @property
    def has_mass(self) -> bool:
        """Whether its mass is given."""
        return self.density is not None or self.mass_per_area is not None

    @property
    def has_strength(self) -> bool:
        """Whether its strength is given, so that its utilisation is a result."""
        return self.strength is not None or self.strength_warp is not None

    @property
    def prestress_key(self) -> str:
        """Key of its prestress."""
        return "pretension" if self.per_width else "prestress"

    @property
    def prestressed(self) -> bool:
        """Whether it has a prestress."""
        return _some(self.given_prestress)

    @property
    def warp_modulus(self) -> float:
        """Young's modulus along the warp; of a fabric given per width its stiffness."""
        return self._modulus(1)

    @property
    def weft_modulus(self) -> float:
        """Young's modulus along the weft; of a fabric given per width its stiffness."""
        return self._modulus(2)

    @property
    def shear_modulus(self) -> float:
        """In-plane shear modulus; of a fabric given per width its stiffness."""
        return self.warp_modulus / (2 * (1 + self.nu)) if self.isotropic else self._modulus(3)

    def _modulus(self, number: int) -> float:
        """The modulus for all directions, or the one of a number."""
        return float(getattr(self, self.moduli_keys[0 if self.isotropic else number]) or 0.0)


def _some(stress: tuple[float, float, float] | ElementField) -> bool:
    """Whether a prestress is not zero."""
    return isinstance(stress, ElementField) or any(stress)
