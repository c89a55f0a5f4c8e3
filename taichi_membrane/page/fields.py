"""What the page shows of elements and nodes: one list of fields with title, unit and where the numbers come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from taichi_membrane.scene import Scene
from taichi_membrane.simulation.results import Floats, StepResult

_SECOND = "second Piola-Kirchhoff: force per area of the unstressed fabric; of fabrics given per width, per width of it"
_CAUCHY = "Cauchy: force per width of the deformed fabric"


@dataclass(frozen=True)
class ElementField:
    """A number of each element.

    :param name: as in the step files; ``title`` is what a reader sees.
    :param read: (m,) values at a load step.
    :param note: what is measured, where the title leaves that open.
    """

    name: str
    title: str
    unit: Literal["", "fabric_stress", "resultant", "length"]
    read: Callable[[StepResult], Floats]
    note: str = ""


@dataclass(frozen=True)
class NodeVector:
    """A vector of each node; ``read`` gives (n, 3)."""

    name: str
    title: str
    unit: Literal["length", "force"]
    read: Callable[[StepResult], Floats]


def _part(name: str, column: int, step: StepResult) -> Floats:
    """A component of a field."""
    return step.fields[name][:, column]


ELEMENT_FIELDS = (
    ElementField("major_resultant", "major resultant", "resultant", lambda s: s.elements.major_resultant, _CAUCHY),
    ElementField("minor_resultant", "minor resultant", "resultant", lambda s: s.elements.minor_resultant, _CAUCHY),
    ElementField("warp_resultant", "resultant, warp", "resultant", lambda s: s.elements.warp_resultant, _CAUCHY),
    ElementField("weft_resultant", "resultant, weft", "resultant", lambda s: s.elements.weft_resultant, _CAUCHY),
    ElementField("shear_resultant", "resultant, shear", "resultant", lambda s: s.elements.shear_resultant, _CAUCHY),
    ElementField("major_stress", "major stress", "fabric_stress", lambda s: s.elements.major_stress, _SECOND),
    ElementField("minor_stress", "minor stress", "fabric_stress", lambda s: s.elements.minor_stress, _SECOND),
    ElementField("stress_warp", "stress, warp", "fabric_stress", lambda s: s.elements.stress[:, 0], _SECOND),
    ElementField("stress_weft", "stress, weft", "fabric_stress", lambda s: s.elements.stress[:, 1], _SECOND),
    ElementField("stress_shear", "stress, shear", "fabric_stress", lambda s: s.elements.stress[:, 2], _SECOND),
    ElementField("strain_warp", "strain, warp", "", lambda s: s.elements.strain[:, 0]),
    ElementField("strain_weft", "strain, weft", "", lambda s: s.elements.strain[:, 1]),
    ElementField("strain_shear", "strain, shear", "", lambda s: s.elements.strain[:, 2]),
    ElementField("fold_strain", "strain in folds", "", lambda s: s.elements.fold_strain),
)
# Those that only some runs have, by the field that they are of.
EXTRA_FIELDS = {
    "thickness": (ElementField("thickness", "thickness at rest", "length", lambda s: s.elements.thickness),),
    "prestress": tuple(
        ElementField(
            f"prestress_{name}", f"prestress, {name}", "fabric_stress", partial(_part, "prestress", column), _SECOND
        )
        for column, name in enumerate(("warp", "weft", "shear"))
    ),
    "utilisation": (
        ElementField(
            "utilisation",
            "utilisation",
            "",
            lambda s: s.elements.utilisation,
            "resultant × factor / (strength / safety)",
        ),
    ),
    "free_strain": tuple(
        ElementField(f"free_strain_{name}", f"stress-free strain, {name}", "", partial(_part, "free_strain", column))
        for column, name in enumerate(("warp", "weft"))
    ),
}
# The first one moves the nodes; of the second only nodes where it is not zero are kept.
DISPLACEMENT = NodeVector("displacement", "displacement", "length", lambda s: s.displacement)
REACTION = NodeVector("reaction", "support force", "force", lambda s: s.reaction)


def shown(scene: Scene) -> tuple[ElementField, ...]:
    """What the page shows of a scene's elements."""
    return (*ELEMENT_FIELDS, *(one for name in scene.extra_fields for one in EXTRA_FIELDS.get(name, ())))


def unit(scene: Scene, kind: Literal["", "fabric_stress", "resultant", "length", "force"]) -> str:
    """Label of a unit; empty for a mere number."""
    return "" if not kind else str(getattr(scene.field_units, kind))
