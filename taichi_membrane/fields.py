"""The fields of a load step, in one table: results, files, reading back, pictures and bounds on memory follow it.

A new field is one entry here; its value is what ``Present`` (in ``simulation/present.py``) has under its name, or the entry's own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

if TYPE_CHECKING:
    from numpy.typing import NDArray

# What a stress refers to, by the short word that stands beside its unit and ends the names of its arrays.
MEASURES = {
    "PK2": "second Piola–Kirchhoff: force per unstressed area (of fabrics given per width, per unstressed width), carried back to "
    "the unstressed fabric; for engineering side strain the stress that does work on it, the same to the order of the strain",
    "Cauchy": "Cauchy, true: force per deformed width",
}


Place = Literal["node", "element", "cable"]


class Units(Protocol):
    """Labels of a scene's units."""

    @property
    def length(self) -> str:
        """Of length."""

    @property
    def force(self) -> str:
        """Of force."""

    @property
    def stress(self) -> str:
        """Of force per area."""

    @property
    def fabric_stress(self) -> str:
        """Of the fabrics' stress: force per area, or of fabrics given per width that per width."""

    @property
    def resultant(self) -> str:
        """Of force per width."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """One quantity of a load step at every node, element (triangle), or straight piece of a cable.

    :param meaning: words for labels.
    :param unit: what it is measured in, by the name of a label of the scene's units; empty for a number.
    :param measure: key of :data:`MEASURES`, of a stress.
    :param components: names of its components; none for a scalar.
    :param split: files hold an array per component, and not one of vectors.
    :param whole: its values are small whole numbers.
    :param optional: only runs have it whose scene names it (``Scene.extra_fields``).
    :param sampled: elements have a value for each point where strain is sampled, and not one.
    :param picture: how it is drawn: ``states`` as coloured regions, ``scale`` by a colour scale (a vector by its length), or not.
    :param value: (count, components) or (count,) from a load step's state, a ``Present``; by default its attribute of that name.
    """

    name: str
    place: Place
    meaning: str
    unit: Literal["", "length", "force", "stress", "fabric_stress", "resultant"] = ""
    measure: Literal["", "PK2", "Cauchy"] = ""
    components: tuple[str, ...] = ()
    split: bool = False
    whole: bool = False
    optional: bool = False
    sampled: bool = False
    picture: Literal["", "states", "scale"] = ""
    value: Callable[[Any], NDArray[Any]] | None = None

    def of(self, present: Any) -> NDArray[Any]:
        """Its values at a load step."""
        values: NDArray[Any] = getattr(present, self.name) if self.value is None else self.value(present)
        return values

    def shape(self, node_count: int, tri_count: int, cable_count: int = 0, samples: int = 1) -> tuple[int, ...]:
        """Of its values on a mesh with so many pieces of cables, and points of each element."""
        count = {"node": node_count, "element": tri_count, "cable": cable_count}[self.place]
        if self.sampled:
            return (count, samples)
        return (count, len(self.components)) if self.components else (count,)

    @property
    def dtype(self) -> str:
        """Of its values, as NumPy names it."""
        return "int8" if self.whole else "float64"

    @property
    def bytes(self) -> int:
        """Memory for each node, element or piece."""
        return (1 if self.whole else 8) * (MOST_POINTS if self.sampled else len(self.components) or 1)

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of its arrays in files; a stress says its measure."""
        ends = f"_{self.measure.lower()}" if self.measure else ""
        return tuple(f"{self.name}_{one}{ends}" for one in self.components) if self.split else (f"{self.name}{ends}",)

    def unit_label(self, units: Units) -> str:
        """Unit and, of a stress, its measure; empty for a number."""
        return f"{getattr(units, self.unit)} {self.measure}".rstrip() if self.unit else ""

    def label(self, units: Units) -> str:
        """Words, with the unit in brackets."""
        unit = self.unit_label(units)
        return f"{self.words(units)} [{unit}]" if unit else self.meaning

    def words(self, units: Units) -> str:
        """What it is, where a stress is per width a resultant."""
        per_width = self.unit == "fabric_stress" and units.fabric_stress == units.resultant
        return self.meaning.replace("stress", "stress resultant", 1) if per_width else self.meaning


MOST_POINTS = 6  # of one element where strain is sampled
_XYZ, _FABRIC_AXES = ("x", "y", "z"), ("warp", "weft", "shear")

FIELDS: tuple[Field, ...] = (
    Field(name="displacement", place="node", meaning="displacement", unit="length", components=_XYZ, picture="scale"),
    Field(
        name="reaction", place="node", meaning="support force, of springs to the ground too; zero elsewhere",
        unit="force", components=_XYZ,
    ),
    Field(name="contact_force", place="node", meaning="force of obstacles", unit="force", components=_XYZ, optional=True),
    Field(
        name="contact_pressure", place="node", meaning="contact pressure", unit="stress", picture="scale",
        optional=True, value=lambda present: present.contact_pressure,
    ),
    Field(name="state", place="element", meaning="0 taut, 1 wrinkled, 2 slack", whole=True, picture="states"),
    Field(name="fold_strain", place="element", meaning="strain in folds", picture="scale"),
    Field(
        name="major_stress", place="element", meaning="major stress", unit="fabric_stress", measure="PK2", picture="scale"
    ),
    Field(name="minor_stress", place="element", meaning="minor stress", unit="fabric_stress", measure="PK2"),
    Field(
        name="major_direction", place="element", components=_XYZ,
        meaning="unit vector along the wrinkles: direction of the major stress, carried to the deformed element",
    ),
    Field(
        name="major_resultant", place="element", meaning="major stress resultant", unit="resultant", measure="Cauchy",
        picture="scale",
    ),
    Field(name="minor_resultant", place="element", meaning="minor stress resultant", unit="resultant", measure="Cauchy"),
    Field(
        name="warp_resultant", place="element", meaning="stress resultant along the warp", unit="resultant",
        measure="Cauchy", picture="scale",
    ),
    Field(
        name="weft_resultant", place="element", meaning="stress resultant along the weft", unit="resultant",
        measure="Cauchy", picture="scale",
    ),
    Field(
        name="shear_resultant", place="element", meaning="shear stress resultant at the warp", unit="resultant",
        measure="Cauchy", picture="scale",
    ),
    Field(
        # Resultant × factor / (strength / safety), the largest of warp and weft, or of the major one; undefined without a strength.
        name="utilisation", place="element", meaning="utilisation of the strength", picture="scale", optional=True,
    ),
    Field(
        name="taut_margin", place="element",
        meaning="minor principal trial stress over the larger modulus; negative where not taut",
    ),
    Field(name="slack_margin", place="element", meaning="major principal strain; negative where slack"),
    Field(
        name="stress", place="element", meaning="stress in fabric axes", unit="fabric_stress", measure="PK2",
        components=_FABRIC_AXES, split=True,
    ),
    Field(
        name="strain", place="element", meaning="strain in fabric axes, shear the engineering one",
        components=_FABRIC_AXES, split=True,
    ),
    Field(
        name="thickness", place="element", meaning="thickness at rest", unit="length", picture="scale", optional=True,
        value=lambda present: present.structure.thickness,
    ),
    Field(
        name="prestress", place="element", meaning="stress at zero strain in fabric axes", unit="fabric_stress", measure="PK2",
        components=_FABRIC_AXES, split=True, picture="scale", optional=True,
        value=lambda present: present.structure.prestress,
    ),
    Field(
        name="free_strain", place="element", meaning="stress-free strain in warp and weft", components=("warp", "weft"),
        split=True, picture="scale", optional=True,
    ),
    Field(name="point_state", place="element", meaning="state at points", whole=True, optional=True, sampled=True),
    Field(name="point_taut_margin", place="element", meaning="taut margin at points", optional=True, sampled=True),
    Field(name="point_slack_margin", place="element", meaning="slack margin at points", optional=True, sampled=True),
    Field(
        name="point_major_stress", place="element", meaning="major stress at points", unit="fabric_stress", measure="PK2",
        optional=True, sampled=True,
    ),
    Field(name="cable_force", place="cable", meaning="force of cables", unit="force"),
)  # fmt: skip


# Those of runs with six-node triangles.
AT_POINTS = tuple(field.name for field in FIELDS if field.sampled)


def of(extra: Collection[str]) -> list[Field]:
    """The fields of a run: all that are not optional, and the named ones."""
    return [field for field in FIELDS if not field.optional or field.name in extra]


def named(name: str) -> Field:
    """The entry of a field."""
    return next(field for field in FIELDS if field.name == name)


def drawn() -> list[str]:
    """Names of the fields that pictures can show; states first, which is what they show unless asked."""
    return sorted((field.name for field in FIELDS if field.picture), key=lambda name: named(name).picture != "states")


def step_bytes(place: Place, extra: Collection[str] = ()) -> int:
    """Memory that a load step takes for each node, element or piece of a cable, with the named optional fields."""
    return sum(field.bytes for field in of(extra) if field.place == place)
