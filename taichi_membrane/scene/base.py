"""Common ground of the scene models: numbers, names, and a record that refuses keys it does not know."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetJsonSchemaHandler, TypeAdapter, ValidationError
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from taichi_membrane.scene import quantity

# Products of six such numbers, as areas squared and energies are, neither overflow nor vanish in double precision.
LARGEST, SMALLEST = 1e30, 1e-30


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"{value:g} must be at least {SMALLEST:g}")
    return value


def _has_length(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*value) < SMALLEST:
        raise ValueError(f"a direction needs a length above zero ({SMALLEST:g} at least)")
    return value


def _readable(value: str) -> str:
    """Refuse control characters: they would steer a terminal and break XML."""
    bad = next((c for c in value if not c.isprintable() and c not in "\n\t"), None)
    if bad is not None:
        raise ValueError(f"the text holds a character that cannot be printed, U+{ord(bad):04X}")
    return value


Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False), AfterValidator(_not_tiny)]
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Friction = Annotated[float, Field(ge=0, le=10, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
# Numbers that may as well be a text with a unit, by their dimension.
Length = Annotated[Finite, quantity.LENGTH]
PositiveLength = Annotated[Positive, quantity.LENGTH]
LengthFromZero = Annotated[NotNegative, quantity.LENGTH]
Force = Annotated[Finite, quantity.FORCE]
PositiveForce = Annotated[Positive, quantity.FORCE]
PerLength = Annotated[Finite, quantity.PER_LENGTH]
PositivePerLength = Annotated[Positive, quantity.PER_LENGTH]
PerLengthFromZero = Annotated[NotNegative, quantity.PER_LENGTH]
Stress = Annotated[Finite, quantity.STRESS]
PositiveStress = Annotated[Positive, quantity.STRESS]
PositiveVolume = Annotated[Positive, quantity.VOLUME]
PositivePerVolume = Annotated[Positive, quantity.PER_VOLUME]
PositiveAcceleration = Annotated[Positive, quantity.ACCELERATION]
PositiveMassPerArea = Annotated[Positive, quantity.MASS_PER_AREA]
PositiveMassPerVolume = Annotated[Positive, quantity.MASS_PER_VOLUME]
MassPerLengthFromZero = Annotated[NotNegative, quantity.MASS_PER_LENGTH]
Moment = Annotated[Finite, quantity.MOMENT]
Quantity = Annotated[Finite, quantity.ANY]  # of a dimension that other entries of the scene tell
PositiveQuantity = Annotated[Positive, quantity.ANY]
Place = tuple[Length, Length, Length]
ForceVector = tuple[Force, Force, Force]
MomentVector = tuple[Moment, Moment, Moment]
StressVector = tuple[Stress, Stress, Stress]
PerLengthVector = tuple[PerLength, PerLength, PerLength]
Direction = Annotated[Vector, AfterValidator(_has_length)]
GroupName = Annotated[str, Field(min_length=1, max_length=200)]  # groups of mesh files have names of any kind
Label = Annotated[str, Field(max_length=300), AfterValidator(_readable)]
Component = Literal["x", "y", "z"]
LONGEST_NAME = 60
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=LONGEST_NAME)]
_NAME = TypeAdapter[str](Name)
MOST = 1000  # entries of a table or list of a scene: each one may cost an array of the mesh's size
Count = Annotated[int, Field(ge=1, le=100_000)]


def is_name(text: str) -> bool:
    """Whether a scene allows it as a name."""
    try:
        _NAME.validate_python(text)
    except ValidationError:
        return False
    return True


@dataclass(frozen=True)
class AllowedNames:
    """Marks a text that must be one of some names, for the schema: they are asked for when it is made."""

    names: Callable[[], list[str]]

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {**handler(core), "enum": self.names()}


class Record(BaseModel):
    """A frozen record that refuses keys it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)
